//! Is the stated uncertainty true? Calibrations from drawn corner errors times placements of the demo's part: errors of features over what is
//! stated of them, and single points against the same scan without noise.

use super::accuracy::{Bench, ratio};
use super::calibrated::Calibrated;
use super::calibration::board::{Cell, Plan};
use super::scan::{Scan, scan_with};
use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use anyhow::Result;
use fringe::cloud::Point;
use fringe::decode::DecodeSettings;
use metrology::inspection::evaluate;
use rayon::prelude::*;
use serde::Serialize;
use std::path::PathBuf;
use twin::{Twin, TwinSettings};

#[derive(clap::Args)]
pub struct Args {
    /// Calibrations with a placement each.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(3..=10_000))]
    trials: u64,
    /// Seed of the first trial; each further trial takes the next one.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Footprint of the cameras that the decoder takes, standard deviation; 0 leaves it to each recording.
    #[arg(long, value_name = "PX", default_value_t = 0.577)]
    footprint_px: f64,
    /// How many of the trials are also measured without noise, for single points.
    #[arg(long, value_name = "N", default_value_t = 3)]
    point_trials: u64,
    #[command(flatten)]
    board: Plan,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// One feature of one trial, in the unit of the feature.
#[derive(Debug, Clone, Copy, Serialize)]
struct Trial {
    error: f64,
    /// By the scatter of the points, and by the calibration.
    u_points: f64,
    u_calibration: f64,
}

/// One feature over all trials.
#[derive(Debug, Serialize)]
struct Row {
    feature: String,
    unit: metrology::inspection::Unit,
    trials: Vec<Trial>,
    mean_error: f64,
    /// Sample standard deviation of the errors.
    scatter: f64,
    /// Root mean square of the stated uncertainties.
    u: f64,
    /// Root mean square of error over stated uncertainty.
    ratio: f64,
}

#[derive(Debug, Serialize)]
struct Report {
    rows: Vec<Row>,
    /// Root mean square of the scatter of single points over their sigma, trial by trial.
    points: Vec<f64>,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    let (bench, cell) = (Bench::demo()?, Cell::new(args.board.clone(), 1)?);
    let decode = DecodeSettings {
        max_contradiction: 1e6,
        footprint_px: (args.footprint_px > 0.0).then_some(args.footprint_px),
        ..DecodeSettings::default()
    };
    decode.check()?;
    let truth = bench.scene.truth();
    let mut rows: Vec<Row> = bench.plan.features.iter().map(Row::of).collect();
    let mut points = Vec::new();
    let mut progress = Progress::new(args.trials as usize, "measuring");
    for trial in 0..args.trials {
        let seed = args.seed + trial;
        let calibrated = Calibrated::new(&cell, seed)?;
        let settings = TwinSettings { seed, ..TwinSettings::default() };
        let measured = |settings: TwinSettings| -> Result<Scan> {
            let twin = Twin::new(&bench.scene, settings, &cell.rig)?;
            scan_with(&twin, &calibrated.rig, &bench.sequence, trial, &decode)
        };
        let scanned = measured(settings.clone())?;
        if trial < args.point_trials {
            let quiet = TwinSettings { shot_noise: false, read_noise_e: 0.0, vibration_um: 0.0, ..settings };
            points.extend(ratio(&scanned, &measured(quiet)?));
        }
        let shares = shares(&bench, &calibrated, &scanned.points)?;
        let result = evaluate(&bench.plan, &scanned.points);
        for ((row, found), share) in rows.iter_mut().zip(&result.features).zip(shares) {
            let known = truth.get(&found.name).map(|truth| truth.value);
            if let (Some(value), Some(u_points), Some(u_calibration), Some(known)) =
                (found.value, found.u, share, known)
            {
                row.trials.push(Trial { error: value - known, u_points, u_calibration });
            }
        }
        progress.step();
    }
    drop(progress);
    let rows: Vec<Row> = rows.into_iter().filter(|row| row.trials.len() > 1).map(Row::summed).collect();
    print(&rows, &points);
    emit_bare(args.json.as_deref(), &Report { rows, points })?;
    Ok(Outcome::Done)
}

/// The calibration's share in each feature.
fn shares(bench: &Bench, calibrated: &Calibrated, points: &[Point]) -> Result<Vec<Option<f64>>> {
    let values = |points: &[Point]| -> Vec<Option<f64>> {
        evaluate(&bench.plan, points).features.iter().map(|feature| feature.value).collect()
    };
    let here = values(points);
    let modes = calibrated.modes()?;
    let moved: Vec<Vec<Option<f64>>> = modes.par_iter().map(|mode| values(&mode.moved(points))).collect();
    let share = |index: usize| {
        let value = here[index]?;
        let squares = moved.iter().map(|moved| moved[index].map(|moved| (moved - value) * (moved - value)));
        Some(squares.sum::<Option<f64>>()?.sqrt())
    };
    Ok((0..here.len()).map(share).collect())
}

impl Row {
    fn of(feature: &metrology::inspection::Feature) -> Self {
        let unit = feature.quantity.unit();
        let feature = feature.name.clone();
        Self { feature, unit, trials: Vec::new(), mean_error: 0.0, scatter: 0.0, u: 0.0, ratio: 0.0 }
    }

    fn summed(self) -> Self {
        let n = self.trials.len() as f64;
        let mean = |of: &dyn Fn(&Trial) -> f64| self.trials.iter().map(of).sum::<f64>() / n;
        let square = |trial: &Trial| trial.u_points.powi(2) + trial.u_calibration.powi(2);
        let mean_error = mean(&|trial| trial.error);
        let scatter = (mean(&|trial| (trial.error - mean_error).powi(2)) * n / (n - 1.0)).sqrt();
        let u = mean(&square).sqrt();
        let ratio = mean(&|trial| trial.error.powi(2) / square(trial).max(f64::MIN_POSITIVE)).sqrt();
        Self { mean_error, scatter, u, ratio, ..self }
    }
}

fn print(rows: &[Row], points: &[f64]) {
    println!(
        "{:24} {:>6} {:>11} {:>9} {:>9} {:>12} {:>8}",
        "feature (µm, mdeg)", "trials", "mean error", "scatter", "stated u", "calibration", "error/u"
    );
    for row in rows {
        let n = row.trials.len() as f64;
        let share = (row.trials.iter().map(|trial| trial.u_calibration.powi(2)).sum::<f64>() / n).sqrt();
        println!(
            "{:24} {:>6} {:>+11.2} {:>9.2} {:>9.2} {:>12.2} {:>8.2}",
            row.feature,
            row.trials.len(),
            row.mean_error * 1e3,
            row.scatter * 1e3,
            row.u * 1e3,
            share * 1e3,
            row.ratio
        );
    }
    let list: Vec<String> = points.iter().map(|ratio| format!("{ratio:.3}")).collect();
    println!("single points, scatter over sigma: {}", list.join(" "));
}
