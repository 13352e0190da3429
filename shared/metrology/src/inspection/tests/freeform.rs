//! A freeform surface against its mesh: profile by hand, in a datum system, and its scatter.

use crate::inspection::{InspectionResult, Plan, PlanError, RawPlan, Surfaces, evaluate};
use crate::spatial::TriangleMesh;
use fringe::cloud::Point;
use fringe::math;
use fringe::synthetic::Noise;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::fmt::Write as _;

/// Height of the surface, mm.
fn height(x: f64, y: f64) -> f64 {
    3.0 * math::sin(0.15 * x) + 0.02 * y * y
}

/// Its upper side as triangles over 60 mm × 40 mm.
fn mesh() -> TriangleMesh {
    let at = |i: i32, j: i32| {
        let (x, y) = (f64::from(i) - 30.0, f64::from(j) - 20.0);
        Point3::new(x, y, height(x, y))
    };
    let quads = (0..60).flat_map(|i| (0..40).map(move |j| (i, j)));
    let corners: Vec<[Point3<f64>; 3]> = quads
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    TriangleMesh::new(&corners).unwrap()
}

const BALLS: [[f64; 3]; 3] = [[-45.0, 0.0, 5.0], [45.0, -20.0, 0.0], [40.0, 25.0, -5.0]];

/// Points on triangles of the surface and on three balls beside it, lifted along the normal by a bump of this height in one
/// place, after a motion.
fn cloud(bump_mm: f64, sigma_mm: f64, seed: u64, motion: &Isometry3<f64>) -> Vec<Point> {
    let mut noise = Noise(seed);
    let mut points = Vec::new();
    let mut push = |at: Point3<f64>, normal: Vector3<f64>| {
        let (at, normal) = (motion * at, motion * normal);
        let zero: Point = bytemuck::Zeroable::zeroed();
        points.push(Point { position_mm: at.coords.into(), normal: normal.map(|v| v as f32).into(), ..zero });
    };
    for triangle in mesh().triangles() {
        let middle = Point3::from(triangle.corners.iter().map(|c| c.coords).sum::<Vector3<f64>>() / 3.0);
        let bump = if middle.coords.xy().norm() < 5.0 { bump_mm } else { 0.0 };
        push(middle + triangle.normal * (bump + sigma_mm * noise.gauss()), triangle.normal);
    }
    for ball in BALLS {
        for i in 0..400 {
            let z = 1.0 - 1.2 * (f64::from(i) + 0.5) / 400.0;
            let (sin, cos) = math::sincos(2.399_963 * f64::from(i));
            let across = (1.0 - z * z).sqrt();
            let normal = Vector3::new(across * cos, across * sin, z);
            push(Point3::from(ball) + normal * (4.0 + sigma_mm * noise.gauss()), normal);
        }
    }
    points
}

fn plan(more: &str) -> Result<Plan, PlanError> {
    let mut text = "format = \"fringecell-plan/1\"\nname = \"freeform\"\n".to_owned();
    for (index, [x, y, z]) in BALLS.iter().enumerate() {
        let _ = write!(
            text,
            "[[element]]\nkind = \"sphere\"\nname = \"ball{index}\"\ncenter_mm = [{x:?}, {y:?}, {z:?}]\ndiameter_mm = 8.0\n\
             margin_mm = 1.0\nmin_points = 100\n"
        );
    }
    text += "[[element]]\nkind = \"surface\"\nname = \"skin\"\nfile = \"skin.stl\"\nmargin_mm = 1.0\nnormal_tolerance_deg = 30.0\n\
             min_points = 1000\n[[datum_system]]\nname = \"balls\"\ndatums = [\"ball0\", \"ball1\", \"ball2\"]\n\
             [[feature]]\nkind = \"surface-profile\"\nname = \"here\"\nelement = \"skin\"\nlimit_mm = 0.3\n\
             [[feature]]\nkind = \"surface-profile\"\nname = \"by balls\"\nelement = \"skin\"\ndatums = \"balls\"\nlimit_mm = 0.3\n";
    let raw: RawPlan = toml::from_str(&(text + more)).unwrap();
    Plan::with_surfaces(raw, &Surfaces::from([("skin.stl".to_owned(), mesh())]))
}

fn values(result: &InspectionResult) -> [(f64, f64); 2] {
    [0, 1].map(|i| {
        let feature = &result.features[i];
        (feature.value.unwrap_or_else(|| panic!("{:?}", feature.reason)), feature.u.unwrap())
    })
}

/// A bump of 0.1 mm is a profile of 0.2 mm, wherever the part lies when the balls say it; a dent counts as much.
#[test]
fn a_bump_is_twice_its_height_in_the_system_of_the_datums() {
    let plan = plan("").unwrap();
    let turn = UnitQuaternion::from_euler_angles(2e-3, -1e-3, 3e-3);
    let moved = Isometry3::from_parts(Vector3::new(0.05, -0.04, 0.06).into(), turn);
    for bump in [0.1, -0.1] {
        let [(here, _), (by_balls, _)] =
            values(&evaluate(&plan, &cloud(bump, 0.0, 1, &Isometry3::identity())));
        assert!((here - 0.2).abs() < 1e-9 && (by_balls - 0.2).abs() < 1e-9, "{here} {by_balls}");
        let [(here, _), (by_balls, _)] = values(&evaluate(&plan, &cloud(bump, 0.0, 1, &moved)));
        assert!((by_balls - 0.2).abs() < 1e-6, "{by_balls}");
        assert!(here > 0.25, "{here}");
    }
    let skin = &evaluate(&plan, &cloud(0.1, 0.0, 1, &moved)).elements[3];
    let fit = skin.fit.as_ref().unwrap();
    assert_eq!((fit.kind(), fit.direction(), fit.sizes().len()), ("surface", None, 0));
    assert!(fit.form().points > 4000);
}

/// The stated uncertainty beside the scatter of many clouds: it holds the datums' share. The points of a bump are no tail of noise,
/// so that the statement errs on the safe side there.
#[test]
fn the_profile_scatters_as_stated_or_by_less() {
    let plan = plan("").unwrap();
    let mut sums = [[0.0; 3]; 2];
    let seeds = 40;
    for seed in 0..seeds {
        let found = values(&evaluate(&plan, &cloud(0.1, 0.005, seed, &Isometry3::identity())));
        for (sum, (value, u)) in sums.iter_mut().zip(found) {
            *sum = [sum[0] + value, sum[1] + value * value, sum[2] + u * u];
        }
    }
    for [sum, squares, stated] in sums {
        let count = f64::from(seeds as u32);
        let scatter = ((squares - sum * sum / count) / (count - 1.0)).sqrt();
        let ratio = scatter / (stated / count).sqrt();
        assert!((0.3..1.25).contains(&ratio), "{ratio}");
    }
}

#[test]
fn a_freeform_surface_has_a_profile_alone() {
    let feature = |kind: &str, rest: &str| format!("[[feature]]\nkind = \"{kind}\"\nname = \"f\"\n{rest}\n");
    for (more, words) in [
        (feature("size", "element = \"skin\"\ntolerance_mm = [0.0, 1.0]"), "has no size"),
        (
            feature("distance", "elements = [\"skin\", \"ball0\"]\ntolerance_mm = [0.0, 1.0]"),
            "surface-profile alone",
        ),
        (
            feature("position", "element = \"skin\"\ndatums = \"balls\"\nlimit_mm = 1.0"),
            "surface-profile alone",
        ),
        (
            feature("surface-profile", "element = \"skin\"\ndatums = \"skin\"\nlimit_mm = 1.0"),
            "surface-profile alone",
        ),
        (
            "[[element]]\nkind = \"middle-point\"\nname = \"m\"\nelements = [\"skin\", \"ball0\"]\n".into(),
            "freeform surface",
        ),
    ] {
        let error = plan(&more).unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{more}: {error}");
    }
}
