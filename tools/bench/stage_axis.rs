//! The axis of a rotation stage by ICP of the thesis' part, over seeds of noise and starting angles: its errors beside what is stated of them.

use super::scan::decode;
use crate::Outcome;
use crate::bundled;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use crate::rotation_stage::{View, axis_of_object};
use crate::simulate::load_scene;
use anyhow::{Context, Result};
use characterise::rotation_stage::StageAxis;
use files::config::Config;
use files::document::Document;
use fringe::cloud::Point;
use fringe::projector::{ProjectorMatcher, ProjectorSettings};
use nalgebra::{Point3, Vector3};
use serde::Serialize;
use std::path::{Path, PathBuf};
use twin::{Scene, Twin, TwinSettings};

/// Where the stage stands at each view.
const ANGLES_DEG: [f64; 4] = [0.0, 35.0, 70.0, 105.0];

/// From the first view of a run to that of the next.
const TURN_DEG: f64 = 29.0;

#[derive(clap::Args)]
pub struct Args {
    /// Number of runs, each with its own noise and first angle.
    #[arg(long = "trials", alias = "seeds", value_name = "N", default_value_t = 12)]
    seeds: u64,
    /// Factor by which the camera of the single-view system is reduced.
    #[arg(long, value_name = "N", default_value_t = 4)]
    reduce: u32,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Result of one seed.
#[derive(Serialize)]
struct Row {
    seed: u64,
    direction_error_rad: f64,
    u_direction_rad: f64,
    point_error_mm: f64,
    u_point_mm: f64,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    if !(1..=1000).contains(&args.seeds) {
        return super::out_of_range("--trials", args.seeds, "1 to 1000");
    }
    if !(1..=8).contains(&args.reduce) {
        return super::out_of_range("--reduce", args.reduce.into(), "1 to 8");
    }
    let bench = Bench::new(args.reduce)?;
    let mut progress = Progress::new(args.seeds as usize, "measuring");
    let mut rows = Vec::new();
    for seed in 1..=args.seeds {
        rows.push(bench.row(seed)?);
        progress.step();
    }
    drop(progress);
    println!("{:>5} {:>16} {:>8} {:>14} {:>8}", "seed", "direction µrad", "stated", "point µm", "stated");
    for r in &rows {
        println!(
            "{:>5} {:>16.1} {:>8.1} {:>14.2} {:>8.2}",
            r.seed,
            r.direction_error_rad * 1e6,
            r.u_direction_rad * 1e6,
            r.point_error_mm * 1e3,
            r.u_point_mm * 1e3
        );
    }
    let rms = |part: fn(&Row) -> f64| {
        (rows.iter().map(|r| part(r) * part(r)).sum::<f64>() / rows.len() as f64).sqrt()
    };
    // An error has two directions, what is stated is the worst one.
    let half = 0.5_f64.sqrt();
    let direction = [half * rms(|r| r.direction_error_rad), rms(|r| r.u_direction_rad)];
    let point = [half * rms(|r| r.point_error_mm), rms(|r| r.u_point_mm)];
    println!(
        "rms of one direction / stated: tilt {:.1} / {:.1} µrad = {:.2}; place {:.2} / {:.2} µm = {:.2}",
        direction[0] * 1e6,
        direction[1] * 1e6,
        direction[0] / direction[1],
        point[0] * 1e3,
        point[1] * 1e3,
        point[0] / point[1]
    );
    let result = serde_json::json!({ "runs": rows, "direction_rad": direction, "point_mm": point });
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}

struct Bench {
    config: Config,
    rig: fringe::geometry::rig::Rig,
    scene: Scene,
    axis: StageAxis,
}

impl Bench {
    fn new(reduce: u32) -> Result<Self> {
        let config = bundled::load("configs/single-view.toml")?;
        let twin = config.twin.as_ref().context("configs/single-view.toml: has no [twin]")?;
        let mut rig = twin.rig.clone();
        let camera = &mut rig.cameras.first_mut().context("no camera")?.camera;
        let factor = f64::from(reduce);
        (camera.width_px, camera.height_px) = (camera.width_px / reduce, camera.height_px / reduce);
        camera.focal_px = camera.focal_px.map(|f| f / factor);
        camera.principal_point_px = camera.principal_point_px.map(|c| (c + 0.5) / factor - 0.5);
        let mut part = twin.clone();
        part.scene = Document::read(&bundled::find(Path::new("configs/complex-artefact.scene.toml"))?.path)?;
        let scene = load_scene(None, &part)?;
        let axis = StageAxis {
            point_mm: Point3::new(3.0, -2.0, 0.0),
            direction: Vector3::new(0.05, 0.0, 1.0).normalize(),
        };
        Ok(Self { config, rig, scene, axis })
    }

    fn row(&self, seed: u64) -> Result<Row> {
        // Each run begins at another angle, so that the part shows other faces; each view has noise of its own.
        let angles = ANGLES_DEG.iter().map(|deg| deg + TURN_DEG * seed as f64);
        let views: Vec<View> =
            (0..).zip(angles).map(|(i, deg)| self.view(64 * seed + i, deg)).collect::<Result<_>>()?;
        let found = axis_of_object(&views, Some(self.axis))?;
        let off = Vector3::from(found.point_mm) - self.axis.point_mm.coords;
        let across = off - self.axis.direction * self.axis.direction.dot(&off);
        Ok(Row {
            seed,
            direction_error_rad: Vector3::from(found.direction).cross(&self.axis.direction).norm(),
            u_direction_rad: found.u_direction_rad,
            point_error_mm: across.norm(),
            u_point_mm: found.u_point_mm,
        })
    }

    fn view(&self, seed: u64, angle_deg: f64) -> Result<View> {
        let angle_rad = angle_deg.to_radians();
        let (position_scatter_mm, angle_scatter_deg) = (0.0, 0.0);
        let settings =
            TwinSettings { seed, position_scatter_mm, angle_scatter_deg, ..TwinSettings::default() };
        let twin =
            Twin::new(&self.scene, settings, &self.rig)?.on_stage(self.axis.turn(angle_rad).isometry());
        let projector = self.config.cell.projectors.first().context("no projector")?;
        let maps = decode(&twin, "cam1", &projector.name, &self.rig, &projector.sequence, 0)?;
        let (camera, lamp) = (self.rig.camera("cam1"), self.rig.projector(&projector.name));
        let (camera, lamp) = (camera.context("cam1")?, lamp.context("the projector")?);
        let mut matcher = ProjectorMatcher::new(camera, lamp, &ProjectorSettings::default())?;
        let mut points: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
        let report = matcher.run(maps.first().map(|m| m.view()).as_ref(), None, 0, &mut points)?;
        points.truncate(report.points as usize);
        Ok(View { name: format!("{angle_deg}°"), angle_deg, angle_rad, points })
    }
}
