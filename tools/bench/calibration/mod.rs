//! What a calibration of the twin is worth: parameters in units of their predicted standard deviations, reprojection
//! errors, sphere spacings over the volume, and the time that it takes.

pub(super) mod bars;
pub(super) mod board;
mod scatter;
mod show;

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result};
use bars::{MeasuredBar, SpacingReport, by_geometry, by_measuring};
use board::{Cell, CornerError, Plan, SimulatedViews};
use characterise::calibration::{
    Calibration, CalibrationSettings, DeviceKind, Observations, TargetShape, calibrate,
};
use fringe::geometry::rig::{Named, Rig};
use scatter::{Scatter, ScatterReport};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Poses of the timing: as many as in the thesis (section 5.3.1).
const TIMED_POSES: usize = 46;

#[derive(clap::Args)]
pub struct Args {
    /// Number of calibrations with simulated corner errors.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(..=100_000))]
    trials: u64,
    /// Number of calibrations from rendered images.
    #[arg(long = "image-trials", alias = "images", value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(..=1000))]
    images: u64,
    #[command(flatten)]
    plan: Plan,
    /// What is adjusted of the target: nothing (`flat`), its bend (`bent`), or each of its points (`free`).
    #[arg(long, value_name = "flat|bent|free", default_value = "bent", value_parser = crate::calibrate::model::target_shape)]
    board: TargetShape,
    /// Rays per pixel along each axis. Edges of the print are exact with two or more.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=16))]
    subsamples: u32,
    /// Seed of the first trial; each further trial takes the next one.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Everything that was found.
#[derive(Debug, Serialize)]
struct Report {
    plan: Plan,
    board: TargetShape,
    /// Found less true positions in the images, cameras and projectors.
    corners: Vec<CornerReport>,
    /// Each calibration from images.
    from_images: Vec<ImageTrial>,
    image_scatter: Option<ScatterReport>,
    /// Calibrations from drawn errors of the same size.
    drawn_scatter: Option<ScatterReport>,
    /// Root mean square over all drawn trials, and the largest error of all, per pair.
    drawn_spacing: Vec<SpacingReport>,
    measured: Vec<MeasuredBar>,
    time: Time,
}

impl Report {
    fn new(args: &Args) -> Self {
        Self {
            plan: args.plan.clone(),
            board: args.board,
            corners: Vec::new(),
            from_images: Vec::new(),
            image_scatter: None,
            drawn_scatter: None,
            drawn_spacing: Vec::new(),
            measured: Vec::new(),
            time: Time::default(),
        }
    }
}

/// Errors of single points in the images.
#[derive(Debug, Serialize)]
struct CornerReport {
    devices: &'static str,
    points: usize,
    mean_px: [f64; 2],
    sd_px: [f64; 2],
    /// Root mean square of error over stated standard deviation.
    in_standard_deviations: f64,
    /// Correlation of the errors of neighbours on the board.
    correlation: f64,
}

/// One calibration from images.
#[derive(Debug, Serialize)]
struct ImageTrial {
    seed: u64,
    devices: Vec<DeviceReport>,
    sigma0: f64,
    outliers: usize,
    target_misfit: f64,
    spacing: Vec<SpacingReport>,
}

#[derive(Debug, Serialize)]
struct DeviceReport {
    name: String,
    rms_reprojection_px: f64,
    /// Mean distance, as the thesis tabulates it.
    mean_reprojection_px: f64,
    views: usize,
    points: usize,
}

#[derive(Debug, Default, Serialize)]
struct Time {
    poses: usize,
    detection_ms_per_image: f64,
    detection_s: f64,
    adjustment_4_cameras_s: f64,
    adjustment_all_s: f64,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    let cell = Cell::new(args.plan.clone(), args.subsamples)?;
    let mut report = Report::new(args);
    let mut all = Errors::default();
    let mut scatter = Scatter::default();
    let work = args.images as usize * args.plan.poses * 2 + args.trials as usize + 6;
    let mut progress = Progress::new(work, "calibrating");
    for trial in 0..args.images {
        let seed = args.seed + trial;
        let seen = cell.look(&args.plan.boards(seed, args.plan.poses), seed, &mut || progress.step())?;
        report.time.detection_ms_per_image = seen.detection.as_secs_f64() * 1e3 / seen.images as f64;
        let found = solve(&seen.observations, args.board)?;
        scatter.add(&found, &cell.devices())?;
        report.from_images.push(image_trial(seed, &found, &cell.rig)?);
        all.errors.extend(&seen.errors);
        all.observe(&seen, trial);
        if trial == 0 {
            let rig = rig_of(&found, &cell.rig);
            report.measured = by_measuring(&rig, &cell.rig, 1000 * seed, &mut || progress.step())?;
        }
    }
    let kinds = |kind: usize| all.report(kind, cell.rig.cameras.len());
    report.corners = (0..2).filter_map(kinds).collect();
    report.image_scatter = (args.images > 0).then(|| scatter.report());
    let noise_px = noise(&report.corners, &cell);
    drawn(args, &cell, &noise_px, &mut report, &mut progress)?;
    time(args, &cell, &noise_px, &mut report.time)?;
    drop(progress);
    show::print(&report);
    emit(args.json.as_deref(), &report)?;
    Ok(Outcome::Done)
}

/// A calibration with everything adjusted but the lens model.
pub(super) fn solve(observations: &Observations, target: TargetShape) -> Result<Calibration> {
    Ok(calibrate(observations, &CalibrationSettings { target, ..CalibrationSettings::default() })?)
}

/// Standard deviation of each device's points: as found in the images, or as the reference states it.
fn noise(corners: &[CornerReport], cell: &Cell) -> Vec<f64> {
    let of = |kind: usize, otherwise: f64| {
        corners.get(kind).map_or(otherwise, |c| ((c.sd_px[0].powi(2) + c.sd_px[1].powi(2)) * 0.5).sqrt())
    };
    let cameras = cell.rig.cameras.len();
    (0..cell.devices().len()).map(|i| if i < cameras { of(0, 0.006) } else { of(1, 0.012) }).collect()
}

/// Calibrations from drawn errors, each with poses of its own.
fn drawn(
    args: &Args,
    cell: &Cell,
    noise_px: &[f64],
    report: &mut Report,
    progress: &mut Progress,
) -> Result<()> {
    let mut scatter = Scatter::default();
    let mut spacing: Vec<SpacingReport> = Vec::new();
    for trial in 0..args.trials {
        let seed = args.seed + 100_000 + trial;
        let found = solve(&cell.draw(&args.plan.boards(seed, args.plan.poses), seed, noise_px), args.board)?;
        scatter.add(&found, &cell.devices())?;
        merge(&mut spacing, by_geometry(&found, &cell.rig)?);
        progress.step();
    }
    for pair in &mut spacing {
        let trials = args.trials.max(1) as f64;
        (pair.rms_mm, pair.u_rms_mm) = ((pair.rms_mm / trials).sqrt(), (pair.u_rms_mm / trials).sqrt());
        pair.mean_mm /= trials;
    }
    report.drawn_spacing = spacing;
    report.drawn_scatter = (args.trials > 0).then(|| scatter.report());
    Ok(())
}

/// Sums of squares, and the largest of all.
fn merge(sums: &mut Vec<SpacingReport>, trial: Vec<SpacingReport>) {
    if sums.is_empty() {
        let empty = |p: &SpacingReport| SpacingReport { pair: p.pair.clone(), ..SpacingReport::default() };
        *sums = trial.iter().map(empty).collect();
    }
    for (sum, own) in sums.iter_mut().zip(trial) {
        sum.bars = own.bars;
        sum.mean_mm += own.mean_mm;
        sum.rms_mm += own.rms_mm * own.rms_mm;
        sum.u_rms_mm += own.u_rms_mm * own.u_rms_mm;
        sum.within_goal += own.within_goal;
        sum.max_mm = sum.max_mm.max(own.max_mm);
        sum.u_max_mm = sum.u_max_mm.max(own.u_max_mm);
    }
}

fn image_trial(seed: u64, found: &Calibration, truth: &Rig) -> Result<ImageTrial> {
    let device = |(number, d): (usize, &characterise::calibration::CalibratedDevice)| {
        let own = found.views.iter().filter(|v| v.device == number).flat_map(|v| &v.residuals);
        let lengths: Vec<f64> =
            own.filter(|r| r.used).filter_map(|r| r.error_px).map(|[x, y]| x.hypot(y)).collect();
        DeviceReport {
            name: d.name.clone(),
            rms_reprojection_px: d.rms_reprojection_px,
            mean_reprojection_px: lengths.iter().sum::<f64>() / lengths.len().max(1) as f64,
            views: d.views,
            points: d.points,
        }
    };
    Ok(ImageTrial {
        seed,
        devices: found.devices.iter().enumerate().map(device).collect(),
        sigma0: found.sigma0,
        outliers: found.outliers.len(),
        target_misfit: found.target_misfit,
        spacing: by_geometry(found, truth)?,
    })
}

/// The found cameras with the pairs of the true rig; approach 2 needs no projector.
fn rig_of(found: &Calibration, truth: &Rig) -> Rig {
    let cameras = found.devices.iter().filter(|d| d.kind == DeviceKind::Camera);
    let cameras = cameras.map(|d| Named { name: d.name.clone(), camera: d.camera.clone() }).collect();
    Rig { cameras, projectors: Vec::new(), pairs: truth.pairs.clone(), ..Rig::default() }
}

/// Time of the adjustment; the detection was timed image by image.
fn time(args: &Args, cell: &Cell, noise_px: &[f64], time: &mut Time) -> Result<()> {
    let mut observations = cell.draw(&args.plan.boards(args.seed, TIMED_POSES), args.seed, noise_px);
    let started = Instant::now();
    solve(&observations, args.board).context("46 poses of all devices")?;
    time.adjustment_all_s = started.elapsed().as_secs_f64();
    let cameras = cell.rig.cameras.len();
    observations.devices.truncate(cameras);
    observations.views.retain(|v| v.device < cameras);
    let started = Instant::now();
    solve(&observations, args.board).context("46 poses of four cameras")?;
    time.adjustment_4_cameras_s = started.elapsed().as_secs_f64();
    time.poses = TIMED_POSES;
    time.detection_s = time.detection_ms_per_image * 1e-3 * (TIMED_POSES * cameras) as f64;
    Ok(())
}

/// Errors of all points in all images; poses of different trials are different poses.
#[derive(Default)]
struct Errors {
    errors: Vec<CornerError>,
}

impl Errors {
    /// Makes the last trial's poses its own.
    fn observe(&mut self, seen: &SimulatedViews, trial: u64) {
        let first = self.errors.len() - seen.errors.len();
        for error in &mut self.errors[first..] {
            error.pose += trial as usize * seen.observations.poses.len();
        }
    }

    fn report(&self, kind: usize, cameras: usize) -> Option<CornerReport> {
        let own: Vec<&CornerError> =
            self.errors.iter().filter(|e| usize::from(e.device >= cameras) == kind).collect();
        let count = own.len() as f64;
        if own.len() < 2 {
            return None;
        }
        let mean = own.iter().map(|e| e.error_px).sum::<nalgebra::Vector2<f64>>() / count;
        let variance = own
            .iter()
            .map(|e| (e.error_px - mean).component_mul(&(e.error_px - mean)))
            .sum::<nalgebra::Vector2<f64>>()
            / (count - 1.0);
        let ratio: f64 = own.iter().map(|e| e.error_px.component_div(&e.stated_px).norm_squared()).sum();
        let (mut products, mut pairs) = (0.0, 0.0);
        // Points of a view stand row by row.
        for (a, b) in own.iter().zip(&own[1..]) {
            if (a.device, a.pose, a.index.1, a.index.0 + 1) == (b.device, b.pose, b.index.1, b.index.0) {
                products += (a.error_px - mean)
                    .component_div(&variance.map(f64::sqrt))
                    .dot(&(b.error_px - mean).component_div(&variance.map(f64::sqrt)));
                pairs += 2.0;
            }
        }
        Some(CornerReport {
            devices: ["cameras", "projectors"][kind],
            points: own.len(),
            mean_px: mean.into(),
            sd_px: variance.map(f64::sqrt).into(),
            in_standard_deviations: (ratio / (2.0 * count)).sqrt(),
            correlation: products / f64::max(pairs, 1.0),
        })
    }
}
