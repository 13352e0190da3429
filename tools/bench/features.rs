//! Is the stated uncertainty true? Calibrations from drawn corner errors times placements of the demo's part: errors of features over what is
//! stated of them, and single points against the same scan without noise. The same pictures are measured with the rig as it truly is as well:
//! what differs is the calibration's alone, and what is left is the pictures'.

use super::accuracy::{Bench, ratio};
use super::calibrated::Calibrated;
use super::calibration::board::{Cell, Plan};
use super::scan::{PairMaps, decoded_often, joined};
use crate::Outcome;
use crate::measure::{OpenFootprints, feature_values};
use crate::numbers::within;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use anyhow::{Result, bail};
use characterise::calibration::{Followed, Mode};
use files::footprints_off::FootprintsOff;
use fringe::cloud::Point;
use fringe::decode::DecodeSettings;
use fringe::geometry::rig::{Named, Rig};
use fringe::math::random::{Key, normal_quantile};
use fringe::sensor::{Footprint, Sensor};
use metrology::inspection::{Feature, FeatureResult, evaluate};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use twin::{Twin, TwinSettings};

/// Most calibrations; further placements count their cycles from multiples of it, so that each calibration keeps its first one.
const CALIBRATIONS: u64 = 10_000;

#[derive(clap::Args)]
pub struct Args {
    /// Number of calibrations, each from corner errors of its own.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u64).range(3..=CALIBRATIONS))]
    trials: u64,
    /// Placements of the part that are measured with each calibration.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    placements: u64,
    /// Recordings of each placement, each with noise of its own; what the calibration does to it is found with the first one.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100))]
    recordings: u64,
    /// Seed of the first calibration; each further one takes the next seed.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Footprint of the cameras that the decoder takes, standard deviation; 0 leaves it to each recording.
    #[arg(long, value_name = "PX", default_value_t = 0.577)]
    footprint_px: f64,
    /// Standard uncertainty of that footprint: the decoder takes another one for each camera and trial, and the stated uncertainty holds it.
    #[arg(long, value_name = "PX", default_value_t = 0.0, value_parser = |text: &str| within(text, 0.0..=0.2))]
    u_footprint_px: f64,
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
    /// With the rig as it truly is: by the pictures alone.
    error_points: f64,
    /// What the calibration changes of the same pictures, the footprints of the cameras included.
    error_calibration: f64,
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
    /// The same of the errors by the pictures alone.
    ratio_points: f64,
    /// Root mean square of the calibration's share.
    u_calibration: f64,
    /// The same as `ratio`, of what the calibration changes over its share.
    ratio_calibration: f64,
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
    let decode = args.decode()?;
    let truth = bench.scene.truth();
    let mut trials: Vec<Vec<Trial>> = vec![Vec::new(); bench.plan.features.len()];
    let mut points = Vec::new();
    let mut progress = Progress::new((args.trials * args.placements * args.recordings) as usize, "measuring");
    for trial in 0..args.trials {
        let seed = args.seed + trial;
        let calibrated = Calibrated::new(&cell, seed)?;
        let modes = calibrated.modes()?;
        let sensors = args.sensors(&cell.rig, seed);
        for placement in 0..args.placements {
            let view = View {
                bench: &bench,
                rig: &cell.rig,
                decode: &decode,
                seed,
                cycle: trial + CALIBRATIONS * placement,
            };
            let seen = view.maps(args.recordings, &sensors)?;
            // With the footprints that the cameras have, where others were taken.
            let right =
                if sensors.is_empty() { None } else { Some(view.maps(args.recordings, &BTreeMap::new())?) };
            let scans: Vec<_> =
                seen.iter().map(|seen| joined(seen, &calibrated.rig)).collect::<Result<_>>()?;
            let first = &scans[0];
            if trial < args.point_trials && placement == 0 {
                let quiet = view.quiet(&sensors)?;
                points.extend(ratio(first, &joined(&quiet, &calibrated.rig)?));
            }
            let shares = shares(&bench, (&calibrated.rig, &modes), &sensors, &first.points);
            for (scan, right) in scans.iter().zip(right.as_ref().unwrap_or(&seen)) {
                let result = evaluate(&bench.plan, &scan.points);
                let by_points = evaluate(&bench.plan, &joined(right, &cell.rig)?.points);
                let features = result.features.iter().zip(&by_points.features);
                for ((list, (found, true_rig)), share) in trials.iter_mut().zip(features).zip(&shares) {
                    let known = truth.get(&found.name).map(|truth| truth.value);
                    list.extend(Trial::of(found, true_rig.value, *share, known));
                }
                progress.step();
            }
        }
    }
    drop(progress);
    let rows = bench.plan.features.iter().zip(trials).filter(|(_, trials)| trials.len() > 1);
    let rows: Vec<Row> = rows.map(|(feature, trials)| Row::of(feature, trials)).collect();
    print(&rows, &points);
    emit_bare(args.json.as_deref(), &Report { rows, points })?;
    Ok(Outcome::Done)
}

impl Args {
    /// How the decoder is set.
    fn decode(&self) -> Result<DecodeSettings> {
        let decode = DecodeSettings {
            max_contradiction: 1e6,
            footprint_px: (self.footprint_px > 0.0).then_some(self.footprint_px),
            ..DecodeSettings::default()
        };
        decode.check()?;
        if self.u_footprint_px > 0.0 && self.footprint_px < 3.0 * self.u_footprint_px {
            bail!(
                "--u-footprint-px {}: must be at most a third of --footprint-px, {}, since footprints are drawn about it",
                self.u_footprint_px,
                self.footprint_px
            );
        }
        Ok(decode)
    }

    /// Footprints that a calibration might have found instead of the true ones; none where they are certain.
    fn sensors(&self, rig: &Rig, seed: u64) -> BTreeMap<String, Sensor> {
        if self.u_footprint_px == 0.0 {
            return BTreeMap::new();
        }
        let drawn = |(number, camera): (usize, &Named)| {
            let off = self.u_footprint_px * normal_quantile(Key::new(400_000 + seed).open(number as u64));
            let sigma_px = [(self.footprint_px + off).max(0.0); 2];
            let footprint = Footprint { sigma_px, u_px: Some([self.u_footprint_px; 2]), field_px2: 0.0 };
            (camera.name.clone(), Sensor { footprint: Some(footprint), ..Sensor::default() })
        };
        rig.cameras.iter().enumerate().map(drawn).collect()
    }
}

/// What the cameras see of the part in one placement.
struct View<'a> {
    bench: &'a Bench,
    /// As it truly is.
    rig: &'a Rig,
    decode: &'a DecodeSettings,
    seed: u64,
    cycle: u64,
}

impl View<'_> {
    /// The phases of all pairs in each recording; `sensors` are what the decoder takes the cameras for.
    fn maps(&self, recordings: u64, sensors: &BTreeMap<String, Sensor>) -> Result<Vec<Vec<PairMaps>>> {
        self.decoded(self.settings(), recordings, sensors)
    }

    /// The same without noise.
    fn quiet(&self, sensors: &BTreeMap<String, Sensor>) -> Result<Vec<PairMaps>> {
        let quiet =
            TwinSettings { shot_noise: false, read_noise_e: 0.0, vibration_um: 0.0, ..self.settings() };
        Ok(self.decoded(quiet, 1, sensors)?.swap_remove(0))
    }

    fn settings(&self) -> TwinSettings {
        TwinSettings { seed: self.seed, ..TwinSettings::default() }
    }

    fn decoded(
        &self,
        settings: TwinSettings,
        recordings: u64,
        sensors: &BTreeMap<String, Sensor>,
    ) -> Result<Vec<Vec<PairMaps>>> {
        let twin = Twin::new(&self.bench.scene, settings, self.rig)?;
        let by_camera = |camera: &str| match sensors.get(camera) {
            Some(sensor) => DecodeSettings { footprint_px: None, sensor: *sensor, ..self.decode.clone() },
            None => self.decode.clone(),
        };
        decoded_often(&twin, self.rig, &self.bench.sequence, (self.cycle, recordings), &by_camera)
    }
}

/// The share of a calibrated rig in each feature, that of footprints included.
fn shares(
    bench: &Bench,
    (rig, modes): (&Rig, &[Mode]),
    sensors: &BTreeMap<String, Sensor>,
    points: &[Point],
) -> Vec<Option<f64>> {
    let footprints = if sensors.is_empty() {
        OpenFootprints::default()
    } else {
        OpenFootprints::new(rig, sensors, &FootprintsOff::new(), points)
    };
    let here = feature_values(&bench.plan, points);
    footprints.shares((modes, 1.0), &bench.plan, &Followed::new(rig, points), &here)
}

impl Trial {
    /// Absent where a feature was not found, or its true value is not known.
    fn of(
        found: &FeatureResult,
        true_rig: Option<f64>,
        u_calibration: Option<f64>,
        known: Option<f64>,
    ) -> Option<Self> {
        let (value, true_rig, known) = (found.value?, true_rig?, known?);
        Some(Self {
            error: value - known,
            error_points: true_rig - known,
            error_calibration: value - true_rig,
            u_points: found.u?,
            u_calibration: u_calibration?,
        })
    }

    fn u(self) -> f64 {
        self.u_points.hypot(self.u_calibration)
    }
}

impl Row {
    fn of(feature: &Feature, trials: Vec<Trial>) -> Self {
        let n = trials.len() as f64;
        let mean = |of: &dyn Fn(&Trial) -> f64| trials.iter().map(of).sum::<f64>() / n;
        let rms = |of: &dyn Fn(&Trial) -> f64| mean(&|trial| of(trial).powi(2)).sqrt();
        let over = |error: f64, u: f64| error / u.max(f64::MIN_POSITIVE);
        let mean_error = mean(&|trial| trial.error);
        Self {
            feature: feature.name.clone(),
            unit: feature.quantity.unit(),
            mean_error,
            scatter: rms(&|trial| trial.error - mean_error) * (n / (n - 1.0)).sqrt(),
            u: rms(&|trial| trial.u()),
            ratio: rms(&|trial| over(trial.error, trial.u())),
            ratio_points: rms(&|trial| over(trial.error_points, trial.u_points)),
            u_calibration: rms(&|trial| trial.u_calibration),
            ratio_calibration: rms(&|trial| over(trial.error_calibration, trial.u_calibration)),
            trials,
        }
    }
}

fn print(rows: &[Row], points: &[f64]) {
    println!(
        "{:24} {:>6} {:>11} {:>9} {:>9} {:>8} {:>13} {:>12} {:>18}",
        "feature (µm, mdeg)",
        "trials",
        "mean error",
        "scatter",
        "stated u",
        "error/u",
        "pictures only",
        "calibration",
        "calibration only"
    );
    for row in rows {
        println!(
            "{:24} {:>6} {:>+11.2} {:>9.2} {:>9.2} {:>8.2} {:>13.2} {:>12.2} {:>18.2}",
            row.feature,
            row.trials.len(),
            row.mean_error * 1e3,
            row.scatter * 1e3,
            row.u * 1e3,
            row.ratio,
            row.ratio_points,
            row.u_calibration * 1e3,
            row.ratio_calibration
        );
    }
    println!(
        "pictures only, calibration only: error over stated uncertainty with the rig as it truly is, and of what the calibration changes"
    );
    let list: Vec<String> = points.iter().map(|ratio| format!("{ratio:.3}")).collect();
    println!("single points, scatter over sigma: {}", list.join(" "));
}
