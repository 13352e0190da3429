//! The recipes of a cell.

use super::raw::RawConfig;
use super::values::{referenced, value};
use crate::calibration_shares::CalibrationShares;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::plan_file::parse_plan;
use cell::configuration::{DEFAULT_RECIPE, Recipe};
use fringe::geometry::rig::Pair;
use fringe::geometry::viewpoint::Viewpoints;
use std::path::Path;

/// Recipes that a cell may have: each is held by the inspection at all times.
const MAX_RECIPES: usize = 1000;

/// Longest name, bytes: it stands in requests of at most 4 kB.
const MAX_NAME: usize = 64;

/// The plan of the configuration first, then its further recipes, with the files of all; without either one that measures
/// nothing. `edge_px`: what its clouds leave out at the rims of faces; `viewpoints`: whence its pairs see.
pub(super) fn recipes(
    document: &Document,
    raw: &RawConfig,
    rig: (&str, &Path, &[Pair]),
    (edge_px, viewpoints): (u32, &[Option<Viewpoints>]),
) -> Result<(Vec<Recipe>, Vec<Document>), FileError> {
    if raw.recipe.len() > MAX_RECIPES {
        let problem = value(raw.recipe.len(), format!("at most {MAX_RECIPES} recipes"));
        return Err(document.fault("recipe", problem, "make two cells of it"));
    }
    let (mut all, mut files) = (Vec::new(), Vec::new());
    let mut add = |name: &str, table: &str, path: &str, shares: Option<&str>| {
        let file = referenced(document, &format!("{table}plan"), path, Document::read)?;
        let mut plan = parse_plan(&file)?.with_rims_left_out(edge_px).with_viewpoints(viewpoints.to_vec());
        let sha256 = sha256_hex(file.text.as_bytes());
        files.push(file);
        let mut shares_sha256 = None;
        if let Some(path) = shares {
            let key = format!("{table}calibration_shares");
            let shares = referenced(document, &key, path, CalibrationShares::read)?;
            plan = shares.join(plan, &sha256, rig)?;
            shares_sha256 = Some(sha256_hex(shares.document.text.as_bytes()));
            files.push(shares.document);
        }
        all.push(Recipe {
            name: name.to_owned(),
            plan: Some(plan),
            plan_sha256: Some(sha256),
            calibration_shares_sha256: shares_sha256,
        });
        Ok(())
    };
    if let Some(plan) = &raw.plan {
        add(DEFAULT_RECIPE, "", plan, raw.calibration_shares.as_deref())?;
    } else if raw.calibration_shares.is_some() {
        let problem = Problem::Missing("the plan that the shares belong to".into());
        return Err(document.fault("calibration_shares", problem, "name it as `plan`, or leave the key out"));
    }
    for (index, recipe) in raw.recipe.iter().enumerate() {
        check_name(document, index, raw)?;
        let shares = recipe.calibration_shares.as_deref();
        add(&recipe.name, &format!("recipe[{index}]."), &recipe.plan, shares)?;
    }
    if all.is_empty() {
        let name = DEFAULT_RECIPE.to_owned();
        all.push(Recipe { name, plan: None, plan_sha256: None, calibration_shares_sha256: None });
    }
    Ok((all, files))
}

fn check_name(document: &Document, index: usize, raw: &RawConfig) -> Result<(), FileError> {
    let key = format!("recipe[{index}].name");
    let name = raw.recipe[index].name.as_str();
    if name.is_empty() || name.len() > MAX_NAME || !fringe::text::is_printable(name) {
        let problem = value(format!("{name:?}"), format!("1 to {MAX_NAME} bytes of printable text"));
        return Err(document.fault(&key, problem, "requests name the recipe by it"));
    }
    if name == DEFAULT_RECIPE || raw.recipe[..index].iter().any(|other| other.name == name) {
        let problem = Problem::Duplicate { kind: "recipe", name: name.to_owned() };
        let remedy =
            "\"default\" is the plan at the top of the configuration; every other name may be used once";
        return Err(document.fault(&key, problem, remedy));
    }
    Ok(())
}
