//! What each imperfection of the cell adds to the point and to the feature, measured on the twin.

use super::scan::{Scan, scan};
use crate::Outcome;
use crate::bundled;
use crate::progress::Progress;
use crate::report::{check_outputs, emit_bare};
use crate::simulate::load_scene;
use anyhow::{Context, Result};
use fringe::geometry::camera::Lens;
use fringe::geometry::rig::Rig;
use metrology::inspection::{InspectionResult, Plan, Unit, evaluate};
use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::Serialize;
use std::path::Path;
use twin::{Scene, Twin, TwinSettings};

/// Points nearer than this to an edge of the part see both of its faces, mm.
const EDGE_MM: f64 = 1.0;
/// A point farther than this from every surface is an outlier, counted and left out of the root mean square, mm.
const OUTLIER_MM: f64 = 0.5;

/// One row of the table.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    name: &'static str,
    pub points: usize,
    /// Number of points away from edges, whose distances count.
    #[serde(rename = "judged")]
    evaluated: usize,
    pub outliers: usize,
    pub rms_um: f64,
    pub mean_um: f64,
    /// Scatter against the same scan without noise, over what the phase noise predicts.
    noise_ratio: Option<f64>,
    overlap_mean_um: f64,
    overlap_sd_um: f64,
    sphere_form_sigma_um: Vec<f64>,
    features: Vec<FeatureError>,
}

#[derive(Debug, Serialize)]
struct FeatureError {
    name: String,
    unit: Unit,
    error: Option<f64>,
    u: Option<f64>,
}

/// Runs the benchmark on the demo cell.
pub fn run(json: Option<&Path>) -> Result<Outcome> {
    check_outputs(&[("--json", json)], &[], None)?;
    let bench = Bench::demo()?;
    let cases = cases();
    let mut progress = Progress::new(cases.len(), "measuring");
    let mut rows = Vec::new();
    for case in cases {
        rows.push(bench.measure(case)?);
        progress.step();
    }
    drop(progress);
    print(&rows);
    emit_bare(json, &rows)?;
    Ok(Outcome::Done)
}

/// An imperfection alone, on top of the ideal twin.
pub(super) struct Case {
    pub name: &'static str,
    pub settings: TwinSettings,
    /// The same without random parts, to separate scatter from bias.
    pub quiet: Option<TwinSettings>,
    pub lens: bool,
}

fn cases() -> Vec<Case> {
    let real = TwinSettings { position_scatter_mm: 0.0, angle_scatter_deg: 0.0, ..TwinSettings::default() };
    let ideal = TwinSettings { exposure: real.exposure, ..TwinSettings::ideal() };
    let case = |name, settings| Case { name, settings, quiet: None, lens: true };
    let noise = TwinSettings { shot_noise: true, read_noise_e: real.read_noise_e, ..ideal.clone() };
    let silent = TwinSettings { shot_noise: false, read_noise_e: 0.0, vibration_um: 0.0, ..real.clone() };
    vec![
        Case { name: "ideal, no lens distortion", settings: ideal.clone(), quiet: None, lens: false },
        case("ideal (with lens distortion)", ideal.clone()),
        case("8-bit camera", TwinSettings { bits: 8, ..ideal.clone() }),
        case("8-bit projector", TwinSettings { projector_8bit: true, ..ideal.clone() }),
        // A point on a chip pixel in focus sees a staircase; only a footprint makes a phase of it.
        case(
            "DMD pixels in focus, footprint",
            TwinSettings { projector_pixels: true, subsamples: 4, ..ideal.clone() },
        ),
        case("projector blur 0.6 px", TwinSettings { projector_blur_px: 0.6, ..ideal.clone() }),
        case("gamma 2.2", TwinSettings { projector_gamma: 2.2, ..ideal.clone() }),
        case("camera blur 0.5 px", TwinSettings { camera_blur_px: 0.5, ..ideal.clone() }),
        case("pixel footprint, 4 × 4 rays", TwinSettings { subsamples: 4, ..ideal.clone() }),
        case("vibration 1 µm", TwinSettings { vibration_um: 1.0, ..ideal.clone() }),
        Case { name: "noise", settings: noise, quiet: Some(ideal), lens: true },
        Case { name: "all, as in the demo", settings: real.clone(), quiet: Some(silent.clone()), lens: true },
        Case {
            name: "all, 3 × 3 rays per pixel",
            settings: TwinSettings { subsamples: 3, ..real },
            quiet: Some(TwinSettings { subsamples: 3, ..silent }),
            lens: true,
        },
    ]
}

/// The demo's part before its cell.
pub(super) struct Bench {
    pub scene: Scene,
    pub plan: Plan,
    pub rig: Rig,
    pub sequence: Vec<fringe::pattern::PatternSet>,
}

impl Bench {
    /// Reads the demo's configuration.
    pub fn demo() -> Result<Self> {
        let config = bundled::load("configs/demo.toml")?;
        let twin_config = config.twin.as_ref().context("configs/demo.toml: has no [twin]")?;
        let scene = load_scene(None, twin_config)?;
        let plan = config.cell.recipes.first().and_then(|recipe| recipe.plan.clone());
        let plan = plan.context("configs/demo.toml: has no plan")?;
        Ok(Self { scene, plan, rig: twin_config.rig.clone(), sequence: twin::thesis::sequence() })
    }

    pub fn measure(&self, case: Case) -> Result<Row> {
        let mut rig = self.rig.clone();
        if !case.lens {
            rig.cameras
                .iter_mut()
                .chain(&mut rig.projectors)
                .for_each(|c| c.camera.distortion = Lens::default());
        }
        let twin = Twin::new(&self.scene, case.settings, &rig)?;
        let scanned = scan(&twin, &rig, &self.sequence, 0)?;
        let noise_ratio = match case.quiet {
            Some(quiet) => {
                let still = scan(&Twin::new(&self.scene, quiet, &rig)?, &rig, &self.sequence, 0)?;
                ratio(&scanned, &still)
            }
            None => None,
        };
        let distances = self.distances(&scanned, &twin.pose(0));
        let good: Vec<f64> = distances.iter().copied().filter(|d| d.abs() <= OUTLIER_MM).collect();
        let n = good.len().max(1) as f64;
        let mean = good.iter().sum::<f64>() / n;
        let result = evaluate(&self.plan, &scanned.points);
        let overlap = scanned.fusion.overlaps.first();
        Ok(Row {
            name: case.name,
            points: scanned.points.len(),
            evaluated: distances.len(),
            outliers: distances.len() - good.len(),
            rms_um: (good.iter().map(|d| d * d).sum::<f64>() / n).sqrt() * 1e3,
            mean_um: mean * 1e3,
            noise_ratio,
            overlap_mean_um: overlap.map_or(f64::NAN, |o| o.mean_mm * 1e3),
            overlap_sd_um: overlap.map_or(f64::NAN, |o| o.sd_mm * 1e3),
            sphere_form_sigma_um: form_sigmas(&result),
            features: self.feature_errors(&result),
        })
    }

    /// Signed distances of the points from the true surface, away from its edges, mm.
    fn distances(&self, scanned: &Scan, world_from_part: &Isometry3<f64>) -> Vec<f64> {
        let part_from_world = world_from_part.inverse();
        let all: Vec<Option<f64>> = scanned
            .points
            .par_iter()
            .map(|point| {
                let surface = self.scene.surface_distance(&(part_from_world * point.position()));
                (!surface.is_near_edge(EDGE_MM)).then_some(surface.signed_mm)
            })
            .collect();
        all.into_iter().flatten().collect()
    }

    fn feature_errors(&self, result: &InspectionResult) -> Vec<FeatureError> {
        let truth = self.scene.truth();
        let error = |name: &str, value: Option<f64>| Some(value? - truth.get(name)?.value);
        result
            .features
            .iter()
            .map(|f| FeatureError {
                name: f.name.clone(),
                unit: f.unit,
                error: error(&f.name, f.value),
                u: f.u,
            })
            .collect()
    }
}

/// Root mean square of (noisy − still)/σ over the pixels that both scans have.
pub(super) fn ratio(noisy: &Scan, still: &Scan) -> Option<f64> {
    let key = |p: &fringe::cloud::Point| (p.pair, p.pixel);
    let mut others = still.points.iter().peekable();
    let (mut sum, mut count) = (0.0, 0_usize);
    for point in &noisy.points {
        while others.next_if(|o| key(o) < key(point)).is_some() {}
        let Some(other) = others.next_if(|o| key(o) == key(point)) else { continue };
        let along = (point.position() - other.position()).dot(&other.normal_vector());
        if other.normal_vector().norm() > 0.5 && along.abs() < OUTLIER_MM && point.sigma_mm > 0.0 {
            sum += (along / f64::from(point.sigma_mm)).powi(2);
            count += 1;
        }
    }
    (count > 0).then(|| (sum / count as f64).sqrt())
}

fn form_sigmas(result: &InspectionResult) -> Vec<f64> {
    use metrology::inspection::FittedElement;
    let sigma = |fit: &FittedElement| match fit {
        FittedElement::Sphere(sphere) => Some(sphere.form.form_sigma_mm * 1e3),
        _ => None,
    };
    result.elements.iter().filter_map(|e| e.fit.as_ref().and_then(sigma)).collect()
}

fn print(rows: &[Row]) {
    println!(
        "{:32} {:>8} {:>8} {:>8} {:>8} {:>7} {:>9} {:>9}  sphere form σ [µm]",
        "imperfection", "points", "outliers", "rms [µm]", "mean", "σ ratio", "overlap", "± [µm]"
    );
    for row in rows {
        let ratio = row.noise_ratio.map_or_else(|| "–".to_owned(), |r| format!("{r:.3}"));
        let form: Vec<String> = row.sphere_form_sigma_um.iter().map(|s| format!("{s:.2}")).collect();
        println!(
            "{:32} {:>8} {:>8} {:>8.3} {:>+8.3} {:>7} {:>+9.3} {:>9.3}  {}",
            row.name,
            row.points,
            row.outliers,
            row.rms_um,
            row.mean_um,
            ratio,
            row.overlap_mean_um,
            row.overlap_sd_um,
            form.join(" ")
        );
    }
    println!("\nfeature errors, measured − true, in µm and mdeg (standard uncertainty in brackets)");
    for row in rows {
        let cells: Vec<String> = row.features.iter().map(cell).collect();
        println!("{:32} {}", row.name, cells.join("  "));
    }
    if let Some(row) = rows.first() {
        let names: Vec<&str> = row.features.iter().map(|f| f.name.as_str()).collect();
        println!("columns: {}", names.join(", "));
    }
}

fn cell(feature: &FeatureError) -> String {
    let milli = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| format!("{:+.2}", v * 1e3));
    let plain = |v: Option<f64>| v.map_or_else(|| "–".to_owned(), |v| format!("{:.2}", v * 1e3));
    format!("{} ({})", milli(feature.error), plain(feature.u))
}
