//! Sphere spacings that a characterised rig measures: by geometry alone all over the volume, and by measuring some.

use super::super::scan::{decode, views};
use anyhow::{Context, Result};
use cell::executor::PairMatcher;
use characterise::calibration::Calibration;
use files::document::Document;
use files::scene_file::parse_scene;
use fringe::fusion::{Fuser, FusionSettings};
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig, pictures};
use fringe::geometry::triangulate::triangulate;
use fringe::matching::MatchSettings;
use fringe::phase::PhaseMap;
use metrology::fit::{FitSettings, sphere};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use serde::Serialize;
use twin::{Twin, TwinSettings, thesis};

/// Centre to centre, mm.
pub const SPACING_MM: f64 = 120.0;
/// Of the spheres, mm.
const RADIUS_MM: f64 = 10.0;
/// Goal for the largest error of one calibration, mm.
const GOAL_MM: f64 = 0.004;
/// Half of the volume's edges, mm (thesis 5.3: 140 × 140 × 90).
const HALF_MM: [f64; 3] = [70.0, 70.0, 45.0];
/// Places of the bars of one direction along each axis.
const PLACES: i32 = 5;
/// Points on a cap, and cosine of its half angle: 55° about the mean line of sight, which both cameras see.
const CAP_POINTS: usize = 80;
const CAP_COSINE: f64 = 0.574;

/// Errors of spacings, all in mm.
#[derive(Debug, Clone, Default, Serialize)]
pub struct SpacingReport {
    /// Name of the pair.
    pub pair: String,
    /// Bars that both cameras see.
    pub bars: usize,
    /// Mean error of the spacing, mm.
    pub mean_mm: f64,
    /// Root mean square error.
    pub rms_mm: f64,
    /// Largest absolute error of the spacing, mm.
    pub max_mm: f64,
    /// Root mean square of the predicted standard uncertainty.
    pub u_rms_mm: f64,
    /// Largest predicted standard uncertainty.
    pub u_max_mm: f64,
    /// Calibrations whose largest error is within the goal of 4 µm.
    pub within_goal: usize,
}

/// Bars in thirteen directions on a grid in the volume, ends within it.
pub fn bars() -> Vec<[Point3<f64>; 2]> {
    let half = Vector3::from(HALF_MM);
    let step = |k: i32, room: f64| room * (2.0 * f64::from(k) / f64::from(PLACES - 1) - 1.0);
    let mut bars = Vec::new();
    // Of each direction and its opposite only the later one; 13 is the zero vector.
    for d in (14..27).map(|i| Vector3::new(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1).cast::<f64>()) {
        let arm = d / d.norm() * (0.5 * SPACING_MM);
        let room = half - arm.abs();
        if room.min() < 0.0 {
            continue;
        }
        for i in 0..PLACES.pow(3) {
            let place = [i % PLACES, i / PLACES % PLACES, i / PLACES.pow(2)];
            let middle = Vector3::from(thesis::VOLUME_CENTRE_MM)
                + Vector3::from_fn(|axis, _| step(place[axis], room[axis]));
            bars.push([Point3::from(middle - arm), Point3::from(middle + arm)]);
        }
    }
    bars
}

/// Sphere centres that the calibrated rig triangulates from the true pixels: no noise but that of the calibration.
pub fn by_geometry(found: &Calibration, truth: &Rig) -> Result<Vec<SpacingReport>> {
    truth.pairs.iter().map(|pair| one_pair(found, truth, pair)).collect()
}

/// Largest error of a sphere spacing over the volume that two views measure, mm.
pub fn worst_spacing(ours: [&Camera; 2], truth: [&Camera; 2]) -> f64 {
    let error = |ends: &[Point3<f64>; 2]| {
        let [Some(a), Some(b)] = ends.map(|end| centre(&end, truth, ours)) else { return 0.0 };
        ((b - a).norm() - SPACING_MM).abs()
    };
    bars().iter().map(error).fold(0.0, f64::max)
}

fn one_pair(found: &Calibration, truth: &Rig, pair: &Pair) -> Result<SpacingReport> {
    let place = |name: &str| {
        found
            .devices
            .iter()
            .position(|d| d.name == name)
            .with_context(|| format!("{name} was not calibrated"))
    };
    let indices = [place(&pair.left)?, place(&pair.right)?];
    let eyes = [&pair.left, &pair.right].map(|name| truth.camera(name));
    let [Some(left), Some(right)] = eyes else { anyhow::bail!("{}: no such cameras", pair.name) };
    let ours = indices.map(|i| &found.devices[i].camera);
    let mut report = SpacingReport { pair: pair.name.clone(), ..SpacingReport::default() };
    let (mut sum, mut squares, mut predicted) = (0.0, 0.0, 0.0);
    for ends in bars() {
        let centres = ends.map(|end| centre(&end, [left, right], ours));
        let [Some(a), Some(b)] = centres else { continue };
        let error = (b - a).norm() - SPACING_MM;
        let Some(u) = found.distance_u_mm([(&indices, &a), (&indices, &b)]) else { continue };
        report.bars += 1;
        sum += error;
        squares += error * error;
        predicted += u * u;
        report.max_mm = report.max_mm.max(error.abs());
        report.u_max_mm = report.u_max_mm.max(u);
    }
    let count = report.bars.max(1) as f64;
    (report.mean_mm, report.rms_mm) = (sum / count, (squares / count).sqrt());
    report.u_rms_mm = (predicted / count).sqrt();
    report.within_goal = usize::from(report.bars > 0 && report.max_mm <= GOAL_MM);
    Ok(report)
}

/// Centre of a sphere from the cap that faces both cameras; `None` unless both see the whole cap.
fn centre(at: &Point3<f64>, truth: [&Camera; 2], ours: [&Camera; 2]) -> Option<Point3<f64>> {
    let towards = truth.map(|c| (c.centre_mm() - at).normalize());
    let axis = (towards[0] + towards[1]).try_normalize(1e-9)?;
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &axis)?;
    let points: Option<Vec<Point3<f64>>> = (0..CAP_POINTS)
        .map(|i| {
            // Even over the cap: equal steps of height, the golden angle about the axis.
            let height = 1.0 - (1.0 - CAP_COSINE) * (i as f64 + 0.5) / CAP_POINTS as f64;
            let (sin, cos) = fringe::math::sincos(2.399_963_229_728_653 * i as f64);
            let flat = (1.0 - height * height).sqrt();
            let point = at + turn * Vector3::new(flat * cos, flat * sin, height) * RADIUS_MM;
            let pixel = |i: usize| truth[i].project(&point).filter(|q| truth[i].contains(*q));
            Some(triangulate((ours[0], pixel(0)?), (ours[1], pixel(1)?))?.position_mm)
        })
        .collect();
    Some(sphere(&points?, &FitSettings::default()).ok()?.center())
}

/// One bar as measured.
#[derive(Debug, Serialize)]
pub struct MeasuredBar {
    /// Its middle, mm in the true world.
    pub middle_mm: [f64; 3],
    /// Direction of the bar, unit vector.
    pub direction: [f64; 3],
    /// Error of the spacing with the calibrated rig for each pair and for both fused, mm.
    pub calibrated_mm: Vec<Option<f64>>,
    /// The same frames with the true rig: what the measurement alone adds.
    pub true_rig_mm: Vec<Option<f64>>,
}

/// Renders bars of spheres, decodes, matches and fits them with the found and with the true rig.
pub fn by_measuring(found: &Rig, truth: &Rig, seed: u64, step: &mut dyn FnMut()) -> Result<Vec<MeasuredBar>> {
    let centre = Vector3::from(thesis::VOLUME_CENTRE_MM);
    let places = [
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ([0.0, 0.0, -20.0], [1.0, 1.0, 0.0]),
        ([0.0, 0.0, 20.0], [1.0, -1.0, 0.0]),
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.5]),
        ([0.0, 0.0, 0.0], [0.0, 1.0, -0.5]),
    ];
    let one = |(number, (at, along)): (usize, &([f64; 3], [f64; 3]))| {
        let bar =
            measure(found, truth, centre + Vector3::from(*at), Vector3::from(*along), seed + number as u64);
        step();
        bar
    };
    places.iter().enumerate().map(one).collect()
}

fn measure(
    found: &Rig,
    truth: &Rig,
    at: Vector3<f64>,
    along: Vector3<f64>,
    seed: u64,
) -> Result<MeasuredBar> {
    let along = along.normalize();
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &along).context("no bar along −x")?;
    let scene = format!(
        "format = \"fringecell-scene/1\"\n[[material]]\nname = \"matt\"\nalbedo = 0.7\n[[body]]\nname = \"bar\"\n\
         material = \"matt\"\ngeometry = {{ shape = \"ball-bar\", diameters_mm = [{d}, {d}], spacing_mm = {SPACING_MM}, \
         rod_diameter_mm = 0.0 }}\n",
        d = 2.0 * RADIUS_MM
    );
    let scene = parse_scene(&Document { path: "bar".into(), text: scene })?;
    let settings =
        TwinSettings { seed, position_scatter_mm: 0.0, angle_scatter_deg: 0.0, ..TwinSettings::default() };
    let world_from_bar = Isometry3::from_parts(at.into(), turn);
    let twin = Twin::new(&scene, settings, &super::board::moved(truth, &world_from_bar))?;
    let sequence = thesis::sequence();
    let mut maps = Vec::new();
    for pair in &truth.pairs {
        let decoded = |camera: &str| decode(&twin, camera, &pair.projector, truth, &sequence, 0);
        maps.push((decoded(&pair.left)?, decoded(&pair.right)?));
    }
    let ends = [-0.5, 0.5].map(|side| Point3::from(at + along * (side * SPACING_MM)));
    Ok(MeasuredBar {
        middle_mm: at.into(),
        direction: along.into(),
        calibrated_mm: spacings(found, truth, &maps, ends)?,
        true_rig_mm: spacings(truth, truth, &maps, ends)?,
    })
}

/// Error of the spacing for each pair, then fused; `None` where a sphere has too few points.
fn spacings(
    rig: &Rig,
    truth: &Rig,
    maps: &[(Vec<PhaseMap>, Vec<PhaseMap>)],
    ends: [Point3<f64>; 2],
) -> Result<Vec<Option<f64>>> {
    // The worlds differ: the first camera is common to both.
    let first =
        |rig: &Rig| rig.cameras.first().map(|c| c.camera.camera_from_world).context("a rig has cameras");
    let ours_from_true = first(rig)?.inverse() * first(truth)?;
    let mut clouds = Vec::new();
    for (number, (pair, (left, right))) in rig.pairs.iter().zip(maps).enumerate() {
        let mut matcher = PairMatcher::new(rig, pair, number, &MatchSettings::default())?;
        clouds.push(matcher.cloud(&views(left), &views(right))?.0);
    }
    let slices: Vec<_> = clouds.iter().map(Vec::as_slice).collect();
    let mut fused = Vec::new();
    Fuser::of_pictures(pictures(&rig.pairs)).fuse(&slices, &FusionSettings::default(), &mut fused);
    let spacing = |points: &[fringe::cloud::Point]| {
        let centre = |end: &Point3<f64>| {
            let near = ours_from_true * end;
            let own: Vec<Point3<f64>> = points
                .iter()
                .map(fringe::cloud::Point::position)
                .filter(|p| (p - near).norm() < 1.1 * RADIUS_MM)
                .collect();
            let settings = FitSettings { max_reject_fraction: 0.03, ..FitSettings::default() };
            sphere(&own, &settings).ok().map(|fit| fit.center())
        };
        Some((centre(&ends[1])? - centre(&ends[0])?).norm() - SPACING_MM)
    };
    Ok(slices.iter().copied().chain([fused.as_slice()]).map(spacing).collect())
}
