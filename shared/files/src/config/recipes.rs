//! The recipes of a cell.

use super::raw::RawRecipe;
use super::values::{referenced, value};
use super::{DEFAULT_RECIPE, Recipe, TextFile};
use crate::document::Document;
use crate::error::{FileError, Problem};

/// Recipes that a cell may have: each is held by the inspection at all times.
const MAX_RECIPES: usize = 1000;

/// Longest name, bytes: it stands in requests of at most 4 kB.
const MAX_NAME: usize = 64;

/// Reads all plans and checks the names.
pub(super) fn recipes(document: &Document, raw: &[RawRecipe]) -> Result<Vec<Recipe>, FileError> {
    if raw.len() > MAX_RECIPES {
        let problem = value(raw.len(), format!("at most {MAX_RECIPES} recipes"));
        return Err(document.fault("recipe", problem, "make two cells of it"));
    }
    let mut all: Vec<Recipe> = Vec::with_capacity(raw.len());
    for (index, recipe) in raw.iter().enumerate() {
        let key = |key: &str| format!("recipe[{index}].{key}");
        let name = recipe.name.as_str();
        if name.is_empty() || name.len() > MAX_NAME || name.chars().any(char::is_control) {
            let problem = value(format!("{name:?}"), format!("1 to {MAX_NAME} bytes of printable text"));
            return Err(document.fault(&key("name"), problem, "requests name the recipe by it"));
        }
        if name == DEFAULT_RECIPE || all.iter().any(|other| other.name == name) {
            let problem = Problem::Duplicate { kind: "recipe", name: name.to_owned() };
            let remedy =
                "\"default\" is the plan at the top of the configuration; every other name may be used once";
            return Err(document.fault(&key("name"), problem, remedy));
        }
        let plan = referenced(document, &key("plan"), &recipe.plan, TextFile::read)?;
        all.push(Recipe { name: name.to_owned(), plan });
    }
    Ok(all)
}
