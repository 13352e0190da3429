//! What several exposures give on a shiny part: share of valid pixels and error, one exposure against all.

use super::shown::Shown;
use crate::Outcome;
use crate::bundled;
use crate::report::{check_outputs, emit_bare};
use crate::simulate::load_scene;
use anyhow::{Context, Result};
use cell::executor::PhaseMethod;
use fringe::decode::{DecodeSettings, Exposed, merge_exposures};
use fringe::phase::PhaseMap;
use serde::Serialize;
use std::f32::consts::PI;
use std::path::PathBuf;
use twin::{Twin, TwinSettings};

#[derive(clap::Args)]
pub struct Args {
    /// Strength of the gloss added to all surfaces.
    #[arg(long, value_name = "F", default_value_t = 1.5)]
    gloss: f64,
    /// Exposures, as factors of the twin's exposure.
    #[arg(long, value_name = "F", value_delimiter = ',', default_value = "0.2,0.8,3.2")]
    exposures: Vec<f64>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Row {
    exposures: String,
    valid_share: f64,
    rms_rad: f64,
    wrong_orders: f64,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    let config = bundled::load("configs/demo.toml")?;
    let twin_config = config.twin.as_ref().context("configs/demo.toml: has no [twin]")?;
    let scene = load_scene(None, twin_config)?;
    let rig = &twin_config.rig;
    let sequence = twin::thesis::sequence();
    let (mut maps, mut rows, mut last): (Vec<PhaseMap>, Vec<Row>, Option<Shown>) =
        (Vec::new(), Vec::new(), None);
    for (number, exposure) in args.exposures.iter().enumerate() {
        // Another seed is another noise; the part does not scatter here.
        let settings = TwinSettings {
            seed: 1 + number as u64,
            exposure: *exposure,
            gloss: args.gloss,
            position_scatter_mm: 0.0,
            angle_scatter_deg: 0.0,
            ..TwinSettings::default()
        };
        let twin = Twin::new(&scene, settings, rig)?;
        let shown = Shown::new(&twin, rig, "cam1", "proj1", &sequence)?;
        let (map, _) = shown.decode(&DecodeSettings::default(), PhaseMethod::default())?;
        rows.push(row(&shown, &map, format!("{exposure}"))?);
        maps.push(map);
        last = Some(shown);
    }
    let shown = last.context("--exposures: at least one is needed")?;
    let exposed: Vec<Exposed> =
        maps.iter().zip(&args.exposures).map(|(map, e)| Exposed { map, exposure_ms: *e }).collect();
    let first = maps.first().context("--exposures: at least one is needed")?;
    let (mut merged, mut best_of) = (PhaseMap::new(first.info), vec![0; maps.len()]);
    merge_exposures(&exposed, &mut merged.view_mut(), &mut best_of);
    rows.push(row(&shown, &merged, "all, merged".into())?);
    println!("{:16} {:>9} {:>12} {:>11}", "exposure", "valid %", "phase mrad", "wrong ppm");
    for row in &rows {
        println!(
            "{:16} {:>9.2} {:>12.2} {:>11.0}",
            row.exposures,
            row.valid_share * 100.0,
            row.rms_rad * 1e3,
            row.wrong_orders * 1e6
        );
    }
    emit_bare(args.json.as_deref(), &rows)?;
    Ok(Outcome::Done)
}

fn row(shown: &Shown, map: &PhaseMap, exposures: String) -> Result<Row> {
    let (errors, lit) = shown.errors_rad(map)?;
    let valid: Vec<f32> = errors.into_iter().filter(|e| !e.is_nan()).collect();
    let right: Vec<f64> = valid.iter().filter(|e| e.abs() < PI).map(|e| f64::from(*e)).collect();
    let n = right.len().max(1) as f64;
    Ok(Row {
        exposures,
        valid_share: valid.len() as f64 / lit.max(1) as f64,
        rms_rad: (right.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
        wrong_orders: (valid.len() - right.len()) as f64 / valid.len().max(1) as f64,
    })
}
