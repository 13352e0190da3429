//! Spheres, bars and plans without measurement errors but those that a test asks for.

use super::super::*;
use fringe::cloud::Point;
use fringe::math;
use fringe::math::random::Key;
use nalgebra::{Point3, Vector3};
use std::fmt::Write as _;

pub(super) const PART_3: &str = include_str!("../../../../../configs/rules/vdi2634-3.toml");
pub(super) const ALL: [&str; 4] = [
    include_str!("../../../../../configs/rules/vdi2634-1.toml"),
    include_str!("../../../../../configs/rules/vdi2634-2.toml"),
    PART_3,
    include_str!("../../../../../configs/rules/iso10360-13.toml"),
];

/// Points per sphere and view: half of them antipodes of the others.
pub(super) const POINTS: usize = 2000;

/// A sphere that is `2 form` out of round, with the least-squares sphere known exactly: one pair of antipodes stands out
/// by `form`, one lies in by as much, so that neither sum nor moments of the residuals change. Each view and each place has other
/// points.
pub(super) fn ball_seen(centre: [f64; 3], diameter: f64, form: f64, view: usize) -> Vec<Point> {
    let half = POINTS / 2;
    let mut points = Vec::new();
    let key = centre.iter().fold(Key::new(view as u64), |key, v| key.with(v.to_bits()));
    for i in 0..half {
        let z = (i as f64 + 0.5 + 0.4 * key.symmetric(2 * i as u64)) / half as f64;
        let (sin, cos) =
            math::sincos(2.399_963_229_728_653 * i as f64 + 0.02 * key.symmetric(2 * i as u64 + 1));
        let ring = (1.0 - z * z).sqrt();
        let off = match i {
            0 => form,
            1 => -form,
            _ => 0.0,
        };
        for sign in [1.0, -1.0] {
            let out = Vector3::new(ring * cos, ring * sin, z) * sign;
            points.push(point(Point3::from(centre) + out * (0.5 * diameter + off)));
        }
    }
    points
}

pub(super) fn ball(centre: [f64; 3], diameter: f64, form: f64) -> Vec<Point> {
    ball_seen(centre, diameter, form, 0)
}

/// Five views of a sphere, the first with the whole form, each next with a tenth less.
pub(super) fn views(centre: [f64; 3], diameter: f64, form: f64) -> Vec<Vec<Point>> {
    (0..5).map(|view| ball_seen(centre, diameter, form * (1.0 - 0.1 * view as f64), view)).collect()
}

/// Where the spheres stand.
pub(super) const PLACES: [[f64; 3]; 3] = [[1.0, 2.0, 3.0], [30.0, -20.0, 5.0], [-30.0, 25.0, -15.0]];

/// Azimuth and elevation of the bar, degrees.
pub(super) const AXES: [[f64; 2]; 7] =
    [[45.0, 0.0], [135.0, 0.0], [45.0, 23.0], [135.0, 23.0], [45.0, -23.0], [135.0, -23.0], [25.0, 10.0]];

/// A bar about the middle of the volume.
pub(super) fn bar_at([azimuth, elevation]: [f64; 2], spacing_mm: f64) -> Vec<Point> {
    let ((sin_a, cos_a), (sin_e, cos_e)) =
        (math::sincos(azimuth.to_radians()), math::sincos(elevation.to_radians()));
    let half = Vector3::new(cos_a * cos_e, sin_a * cos_e, sin_e) * (0.5 * spacing_mm);
    let mut cloud = ball((-half).into(), 20.0, 0.0);
    cloud.extend(ball(half.into(), 20.0, 0.0));
    cloud
}

pub(super) fn point(at: Point3<f64>) -> Point {
    Point { position_mm: at.coords.into(), ..bytemuck::Zeroable::zeroed() }
}

pub(super) fn plan_text(limits: &str, positions: usize, spacing: f64, more: &str) -> String {
    let mut text = format!(
        r#"format = "fringecell-test/1"
name = "synthetic"
rule_set = "vdi2634-3"
reject_fraction = 0.0
{more}
[conditions]
operator = "test"
date = "2026-11-20"
instrument = "maker, type, 1"
temperature_c = 20.0
u_temperature_k = 0.0
zero_reason = "synthetic"
operating_mode = "synthetic"
cloud_filters = "none"
simulated = true
[volume]
sensor_mm = [140.0, 140.0, 90.0]
total_mm = [140.0, 140.0, 90.0]
center_mm = [0.0, 0.0, 0.0]
[limits]
{limits}
[[artefact]]
id = "ball"
kind = "sphere"
certificate = "C1"
certificate_date = "2026-01-01"
certificate_valid_until = "2026-12-31"
zero_reason = "synthetic"
diameters_mm = [20.0]
u_diameter_mm = 0.001
form_mm = 0.002
u_form_mm = 0.0
expansion_per_k = 0.0
u_expansion_per_k = 0.0
[[artefact]]
id = "bar"
kind = "ball-bar"
certificate = "C2"
certificate_date = "2026-01-01"
certificate_valid_until = "2026-12-31"
zero_reason = "synthetic"
diameters_mm = [20.0, 20.0]
u_diameter_mm = 0.001
spacings_mm = [{spacing:?}]
u_spacing_mm = 0.001
form_mm = 0.0
u_form_mm = 0.0
expansion_per_k = 0.0
u_expansion_per_k = 0.0
"#
    );
    write_positions(&mut text, positions);
    text
}

/// Sphere positions of five views each, then seven bars of one.
pub(super) fn write_positions(text: &mut String, spheres: usize) {
    for p in 0..spheres {
        let _ = writeln!(text, "[[position]]\nname = \"s{p}\"\nartefact = \"ball\"");
        for v in 0..5 {
            let _ = writeln!(text, "[[position.view]]\nname = \"v{v}\"\ncloud = \"s{p}v{v}.ply\"");
        }
    }
    for p in 0..7 {
        let _ = writeln!(text, "[[position]]\nname = \"b{p}\"\nartefact = \"bar\"");
        let _ = writeln!(text, "[[position.view]]\nname = \"v\"\ncloud = \"b{p}.ply\"");
    }
}

pub(super) fn parsed<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, AcceptanceError> {
    let one_line = |e: &toml::de::Error| e.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    let refused = |e| AcceptanceError::Plan { place: "line".into(), message: one_line(&e) };
    toml::from_str(text).map_err(refused)
}

impl TestPlan {
    /// As the reader of files does it; a text that is no plan has its own message there.
    pub(super) fn from_toml(text: &str) -> Result<Self, AcceptanceError> {
        let plan: Self = parsed(text)?;
        plan.check().map(|()| plan)
    }
}

impl RuleSet {
    /// As the reader of files does it.
    pub(super) fn from_toml(text: &str) -> Result<Self, AcceptanceError> {
        let rules: Self = parsed(text)?;
        rules.check().map(|()| rules)
    }
}

/// Sphere positions with these (size error, form) and bars with these spacing errors, mm.
pub(super) fn evaluate(
    text: &str,
    spheres: &[(f64, f64)],
    bars: &[f64],
) -> Result<TestReport, AcceptanceError> {
    let plan = TestPlan::from_toml(text)?;
    let rules = RuleSet::from_toml(PART_3)?;
    let mut evaluator = Evaluator::new(&plan, &rules)?;
    let (balls, rest) = plan.positions.split_at(spheres.len());
    for (index, (position, (size, form))) in balls.iter().zip(spheres).enumerate() {
        // Repeats of a position stand where it stands, but not to the nanometre.
        let [x, y, z] = PLACES[index % PLACES.len()];
        let clouds = views([x + 0.01 * (index / PLACES.len()) as f64, y, z], 20.0 + size, *form);
        evaluator.add(position, &clouds)?;
    }
    for ((position, error), axis) in rest.iter().zip(bars).zip(AXES) {
        let nominal = plan.artefacts[1].spacings_mm[0];
        evaluator.add(position, &[bar_at(axis, nominal + error)])?;
    }
    evaluator.finish(Vec::new(), Vec::new())
}

pub(super) fn one<'a>(report: &'a TestReport, symbol: &str) -> &'a Characteristic {
    report.characteristics.iter().find(|c| c.symbol == symbol).unwrap()
}

pub(super) const SPHERES: [(f64, f64); 3] = [(0.01, 0.004), (-0.03, 0.02), (0.02, 0.001)];
pub(super) const BARS: [f64; 7] = [0.001, 0.0, -0.002, 0.003, -0.04, 0.002, 0.005];
