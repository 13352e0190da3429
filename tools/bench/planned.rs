//! Predictions of `plan-patterns` compared with results: the twin of the demo's cell projects proposals onto a plate that faces
//! the first projector, and points from the decoded phase are compared with the truth.

use super::scan::landed;
use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use anyhow::{Context, Result};
use cell::executor::{PairMatcher, Views};
use files::document::Document;
use files::scene_file::parse_scene;
use fringe::cloud::Point;
use fringe::decode::{DecodeSettings, Diagnosis};
use fringe::geometry::rig::{Pair, Rig};
use fringe::matching::MatchSettings;
use fringe::math::statistics;
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::PhaseMap;
use fringe::planning::geometry::{by_phase, by_projector, projector_px_per_camera_px};
use fringe::planning::{ORDERS, Proposal, Requirements, geometry::Depth, propose};
use fringe::surface::SurfaceSettings;
use metrology::fit::{FitSettings, plane};
use nalgebra::{Point2, Point3};
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::PathBuf;
use twin::{Scene, Twin, TwinSettings, View};

/// A plate that faces the first projector.
const PLATE: &str = "format = \"fringecell-scene/1\"\n[[material]]\nname = \"matte\"\nalbedo = 0.7\n[[body]]\nname = \"plate\"\n\
    material = \"matte\"\nposition_mm = [0.0, 0.0, 15.0]\nrotation_deg = [0.0, 42.0, 0.0]\n\
    geometry = { shape = \"plane\", size_mm = [90.0, 90.0], thickness_mm = 5.0 }\n";
/// Points farther from the middle of the plate do not count: its rim mixes two faces.
const INNER_MM: f64 = 35.0;
/// Most wrong orders, as a share of the pixels, of a risky proposal.
const RISKY: f64 = 0.02;

/// Light of the risky rows: a sixth leaves as much modulation as the decoder takes.
const DIM: f64 = 0.16;

#[derive(clap::Args)]
pub struct Args {
    /// Columns of the camera, px; the rows keep the aspect ratio. The demo has 1124.
    #[arg(long, value_name = "PX", default_value_t = 562)]
    width_px: u32,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// How points are made.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    Phase,
    Projector,
}

/// Predictions for a proposal and what was observed.
#[derive(Serialize)]
struct Row {
    case: String,
    order: &'static str,
    period_px: f64,
    steps: u32,
    frames: usize,
    phase_noise_rad: [f64; 2],
    pattern_error_rad: [f64; 2],
    point_um: [f64; 2],
    wrong_orders: [f64; 2],
    pixels: usize,
    points: usize,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    if !(64..=4496).contains(&args.width_px) {
        return super::out_of_range("--width-px", args.width_px.into(), "64 to 4496");
    }
    let rig = twin::thesis::rig(args.width_px, args.width_px * 750 / 1124);
    let scene = parse_scene(&Document { path: "plate".into(), text: PLATE.into() })?;
    let cases = [
        ("full light, 2 cameras, 10 µm", 1.0, Some(10.0), Way::Phase),
        ("full light, 2 cameras, 4 µm", 1.0, Some(4.0), Way::Phase),
        ("full light, projector, 10 µm", 1.0, Some(10.0), Way::Projector),
        ("full light, projector, 3 µm", 1.0, Some(3.0), Way::Projector),
        ("fifth of the light, 2 cameras, 20 µm", 0.2, Some(20.0), Way::Phase),
    ];
    let mut progress = Progress::new(cases.len() + 1, "measuring");
    let mut rows = Vec::new();
    for (name, exposure, want_u_um, way) in cases {
        let bench = Bench::new(&rig, &scene, exposure);
        let all = propose(&bench.wanted(way, want_u_um)?)?;
        rows.push(bench.row(name, all.first().context("no proposal")?, way)?);
        progress.step();
    }
    let dim = Bench::new(&rig, &scene, DIM);
    let all = propose(&dim.wanted(Way::Phase, None)?)?;
    for order in ORDERS {
        let risk = |p: &&Proposal| p.order == order.name() && p.wrong_order <= RISKY && p.usable;
        let Some(risky) = all.iter().filter(risk).max_by(|a, b| a.wrong_order.total_cmp(&b.wrong_order))
        else {
            continue;
        };
        rows.push(dim.row("sixth of the light, riskiest", risky, Way::Phase)?);
    }
    progress.step();
    drop(progress);
    print(&rows);
    emit_bare(args.json.as_deref(), &rows)?;
    Ok(Outcome::Done)
}

fn print(rows: &[Row]) {
    println!("predicted / observed");
    println!(
        "{:38} {:18} {:>6} {:>5} {:>6} {:>15} {:>15} {:>15} {:>21} {:>8}",
        "case",
        "order",
        "period",
        "steps",
        "frames",
        "noise mrad",
        "pattern mrad",
        "point µm",
        "wrong orders",
        "pixels"
    );
    for row in rows {
        let pair = |[predicted, observed]: [f64; 2]| format!("{predicted:.2} / {observed:.2}");
        println!(
            "{:38} {:18} {:>6} {:>5} {:>6} {:>15} {:>15} {:>15} {:>21} {:>8}",
            row.case,
            row.order,
            row.period_px,
            row.steps,
            row.frames,
            pair(row.phase_noise_rad.map(|v| v * 1e3)),
            pair(row.pattern_error_rad.map(|v| v * 1e3)),
            pair(row.point_um),
            format!("{:.1e} / {:.1e}", row.wrong_orders[0], row.wrong_orders[1]),
            row.pixels
        );
    }
}

/// The demo's cell, looking at the plate.
struct Bench<'a> {
    rig: &'a Rig,
    scene: &'a Scene,
    settings: TwinSettings,
}

/// One decoded recording of the twin.
struct DecodedRecording {
    view: View,
    map: PhaseMap,
    diagnosis: Vec<Diagnosis>,
    noise: [f64; 2],
}

impl<'a> Bench<'a> {
    fn new(rig: &'a Rig, scene: &'a Scene, exposure: f64) -> Self {
        let still =
            TwinSettings { position_scatter_mm: 0.0, angle_scatter_deg: 0.0, ..TwinSettings::default() };
        Self { rig, scene, settings: TwinSettings { exposure, ..still } }
    }

    fn twin(&self, seed: u64) -> Result<Twin> {
        Ok(Twin::new(self.scene, TwinSettings { seed, ..self.settings.clone() }, self.rig)?)
    }

    /// What a user reads from a recording with the demo's patterns (`decode --json`), and the geometry of the rig.
    fn wanted(&self, way: Way, want_u_um: Option<f64>) -> Result<Requirements> {
        let twin = self.twin(1)?;
        let seen = self.see(&twin, "cam1", &twin::thesis::sequence(), &DecodeSettings::default())?;
        let [left, right] = ["cam1", "cam2"].map(|name| self.rig.camera(name));
        let (left, right) = (left.context("cam1")?, right.context("cam2")?);
        let projector = self.rig.projector("proj1").context("proj1")?;
        let surface = SurfaceSettings::default();
        let depth: Option<Depth> = match way {
            Way::Phase => by_phase(left, right, projector, Axis::X, &surface),
            Way::Projector => by_projector(left, projector, Axis::X, &surface),
        };
        let TwinSettings { projector_blur_px, camera_blur_px, projector_gamma, .. } = self.settings;
        let scale = projector_px_per_camera_px(left, projector).context("views that cross")?;
        let camera2 = (camera_blur_px * camera_blur_px + 1.0 / 12.0) * scale * scale;
        let inner = inner(&twin, &seen)?;
        let median = |part: fn(&Diagnosis) -> f32| {
            let mut values: Vec<f32> = inner.iter().map(|i| part(&seen.diagnosis[*i])).collect();
            statistics::median(&mut values).map_or(0.0, f64::from)
        };
        Ok(Requirements {
            axis: Axis::X,
            extent_px: projector.width_px,
            full_scale_dn: f64::from(twin.settings().full_scale_dn()),
            modulation_dn: median(|d| d.contrast_dn),
            background_dn: median(|d| d.threshold_dn),
            read_noise_dn: seen.noise[0].max(0.0).sqrt(),
            gain_dn: seen.noise[1].max(0.0),
            blur_px: (projector_blur_px * projector_blur_px + camera2).sqrt(),
            projector_gamma,
            depth: depth.context("views that cross")?,
            most_period_px: None,
            want_u_um,
            most_wrong: 1e-6,
        })
    }

    fn see(
        &self,
        twin: &Twin,
        camera: &str,
        sequence: &[PatternSet],
        settings: &DecodeSettings,
    ) -> Result<DecodedRecording> {
        let view = twin.view_lit_by(camera, &["proj1"], 0)?;
        let seen = landed(twin, (&view, 0), "proj1", self.rig, sequence, settings)?.decoded(Axis::X)?;
        let noise = [seen.report.noise.read_variance_dn2, seen.report.noise.gain_dn];
        Ok(DecodedRecording { view, map: seen.map, diagnosis: seen.diagnosis, noise })
    }

    fn row(&self, case: &str, proposal: &Proposal, way: Way) -> Result<Row> {
        let order =
            ORDERS.into_iter().find(|o| o.name() == proposal.order).context("an order of the plan")?;
        let settings = DecodeSettings { order, max_contradiction: 1e6, ..DecodeSettings::default() };
        let sequence = &proposal.sequence;
        let twins = [self.twin(1)?, self.twin(2)?];
        let one = self.see(&twins[0], "cam1", sequence, &settings)?;
        let two = self.see(&twins[1], "cam1", sequence, &settings)?;
        let inner = inner(&twins[0], &one)?;
        let period_px = one.map.info.period_px;
        let (mut differences, mut means, mut count, mut wrong, mut seen) =
            (0.0, 0.0, 0_usize, 0_usize, 0_usize);
        for i in inner {
            let Some(at) = one.view.truth_coordinate("proj1", i)? else { continue };
            seen += 1;
            wrong += usize::from((f64::from(one.diagnosis[i].own_px) - at.x).abs() > 0.5 * period_px);
            let [a, b] = [&one, &two].map(|s| f64::from(s.map.phase_rad[i]) - at.x * TAU / period_px);
            // Two recordings that differ by their noise alone; a wrong order is counted, not averaged.
            if a.abs() < 0.5 * TAU && b.abs() < 0.5 * TAU {
                differences += 0.5 * (a - b) * (a - b);
                means += a * b;
                count += 1;
            }
        }
        let points = self.points(&twins[0], &one, sequence, &settings, way)?;
        let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
        // Fringes with so much noise that hardly any match is certain leave no points to evaluate.
        let scatter_mm =
            plane(&positions, &FitSettings::default()).map_or(f64::NAN, |fit| fit.form.form_sigma_mm);
        let n = count.max(1) as f64;
        Ok(Row {
            case: case.to_owned(),
            order: proposal.order,
            period_px: proposal.period_px,
            steps: proposal.steps,
            frames: proposal.frames,
            phase_noise_rad: [proposal.sigma_phase_rad, (differences / n).sqrt()],
            pattern_error_rad: [proposal.pattern_error_rad, (means / n).max(0.0).sqrt()],
            point_um: [proposal.u_point_um, scatter_mm * 1e3],
            wrong_orders: [proposal.wrong_order, wrong as f64 / seen.max(1) as f64],
            pixels: seen,
            points: points.len(),
        })
    }

    /// Points of the inner part of the plate.
    fn points(
        &self,
        twin: &Twin,
        one: &DecodedRecording,
        sequence: &[PatternSet],
        settings: &DecodeSettings,
        way: Way,
    ) -> Result<Vec<Point>> {
        let (right, other) = match way {
            Way::Phase => ("cam2", Some(self.see(twin, "cam2", sequence, settings)?)),
            Way::Projector => ("proj1", None),
        };
        let names = ["planned", "cam1", right, "proj1"].map(str::to_owned);
        let [name, left, right, projector] = names;
        let pair = Pair { name, left, right, projector };
        let mut matcher = PairMatcher::new(self.rig, &pair, 0, &MatchSettings::default())?;
        let other = Views::of(other.iter().map(|seen| seen.map.view()));
        let (points, _) = matcher.cloud(&Views::of([one.map.view()]), &other)?;
        let middle = Point3::new(0.0, 0.0, 15.0);
        Ok(points.into_iter().filter(|p| (p.position() - middle).norm() < INNER_MM).collect())
    }
}

/// Pixels that see the inner part of the plate.
fn inner(twin: &Twin, seen: &DecodedRecording) -> Result<Vec<usize>> {
    let width = seen.view.width_px() as usize;
    let mut inner = Vec::new();
    for index in 0..seen.map.info.len() {
        let pixel = Point2::new((index % width) as f64, (index / width) as f64);
        let hit = twin.truth_point("cam1", 0, pixel)?;
        let near = hit.is_some_and(|at| (at.world_mm - Point3::new(0.0, 0.0, 15.0)).norm() < INNER_MM);
        if near && !seen.diagnosis[index].wrong_order.is_nan() {
            inner.push(index);
        }
    }
    Ok(inner)
}
