//! Clouds in, features out.

use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;

use super::artefact::{Setup, Solid, TRUTH, pose};
use crate::fit::tests::Noise;
use crate::inspection::{FeatureResult, InspectionResult, Plan, deviations, evaluate};
use crate::verdict::Verdict;
use fringe::cloud::Point;

const PLAN: &str =
    include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/complex-artefact.plan.toml"));

fn plan() -> Plan {
    Plan::from_toml(PLAN).unwrap()
}

fn find<'a>(result: &'a InspectionResult, name: &str) -> &'a FeatureResult {
    result.features.iter().find(|f| f.name == name).unwrap()
}

/// Largest place error of the pose over the part's volume, mm.
fn pose_error_mm(result: &InspectionResult, truth: &Isometry3<f64>) -> f64 {
    let found = result.alignment.as_ref().unwrap().world_from_part();
    let corners = [[-55.0, -55.0, 0.0], [55.0, -55.0, 0.0], [0.0, 55.0, 40.0]].map(nalgebra::Point3::from);
    corners.iter().map(|c| (found * c - truth * c).norm()).fold(0.0, f64::max)
}

/// The demo plan with the flatness of single points.
fn unfiltered() -> Plan {
    Plan::from_toml(&PLAN.replace("filter_mm = 2.5\n", "")).unwrap()
}

/// Stated uncertainty beside scatter: 50 poses and noises. χ² per feature has 50 degrees of freedom, a standard
/// deviation of 0.2 about 1; the limits are three of that, and over all 400 values three of 0.07.
#[test]
fn features_scatter_as_their_uncertainty_says() {
    let plan = unfiltered();
    let mut squares = [0.0; TRUTH.len()];
    let mut ranges = Vec::new();
    let mut u_range = 0.0;
    for seed in 0..50 {
        let setup = Setup::new(seed);
        let result = evaluate(&plan, &setup.cloud());
        assert!(result.alignment.is_some(), "seed {seed}: {:?}", result.alignment_failure);
        assert!(pose_error_mm(&result, &setup.world_from_part) < 0.01, "seed {seed}");
        for ((name, truth), sum) in TRUTH.iter().zip(&mut squares) {
            let feature = find(&result, name);
            let (value, u) = (feature.value.unwrap(), feature.u_noise.unwrap());
            *sum += ((value - truth) / u).powi(2) / 50.0;
        }
        let flatness = find(&result, "base_flatness");
        ranges.push(flatness.value.unwrap());
        u_range += flatness.u_noise.unwrap().powi(2) / 50.0;
    }
    for ((name, _), chi) in TRUTH.iter().zip(&squares) {
        assert!((0.4..1.6).contains(chi), "{name}: χ²/n = {chi} of {squares:?}");
    }
    let all = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.79..1.21).contains(&all), "{all} from {squares:?}");
    let mean = ranges.iter().sum::<f64>() / 50.0;
    let scatter = (ranges.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / 49.0).sqrt();
    assert!((0.6..1.3).contains(&(scatter / u_range.sqrt())), "flatness: {scatter} for {}", u_range.sqrt());
}

/// Without noise the features are exact, whatever the pose.
#[test]
fn without_noise_the_features_are_true() {
    for seed in 0..5 {
        let setup = Setup { sigma_mm: 0.0, pitch_mm: 1.0, ..Setup::new(seed) };
        let result = evaluate(&loosened(4), &setup.cloud());
        for (name, truth) in TRUTH {
            let value = find(&result, name).value.unwrap();
            assert!((value - truth).abs() < 1e-8, "{name}: {value}");
        }
        assert!(find(&result, "base_flatness").value.unwrap() < 1e-9);
        assert_eq!(result.verdict, Verdict::Pass);
    }
}

/// The demo plan for a cloud thinner by a factor.
fn loosened(factor: usize) -> Plan {
    let mut plan = plan();
    plan.elements.iter_mut().for_each(|e| e.min_points /= factor);
    plan
}

/// 3 mm and 3° about every axis, in every direction, with 5 % of the points anywhere in the volume.
#[test]
fn the_part_is_found_from_the_edge_of_the_search() {
    for seed in 0..16 {
        let mut noise = Noise(seed + 99);
        let mut setup = Setup { pitch_mm: 1.0, ..Setup::new(seed) };
        let sign = |bit: u64| if seed >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let turn = Vector3::new(sign(0), sign(1), sign(2) * sign(3)) * (3f64.to_radians() / 3f64.sqrt());
        setup.world_from_part =
            Isometry3::new(Vector3::new(sign(3), sign(2), sign(1)) * (3.0 / 3f64.sqrt()), turn);
        let mut cloud = setup.cloud();
        for _ in 0..cloud.len() / 20 {
            let place = [150.0, 150.0, 60.0].map(|size| size * (noise.uniform() - 0.5));
            let normal = noise.direction().map(|v| v as f32).into();
            cloud.push(Point { position_mm: [place[0], place[1], place[2] + 15.0], normal, ..cloud[0] });
        }
        let result = evaluate(&loosened(4), &cloud);
        assert!(result.alignment.is_some(), "seed {seed}: {:?}", result.alignment_failure);
        assert!(pose_error_mm(&result, &setup.world_from_part) < 0.03, "seed {seed}");
        for (name, truth) in TRUTH {
            let feature = find(&result, name);
            let (value, u) = (feature.value.unwrap(), feature.u.unwrap());
            assert!((value - truth).abs() < 5.0 * u, "seed {seed}, {name}: {value} ± {u}");
        }
    }
}

#[test]
fn a_small_sphere_and_a_steep_wedge_fail() {
    let mut setup = Setup::new(4);
    for (name, body) in &mut setup.bodies {
        match body {
            Solid::Sphere { radius, .. } if *name == "sphere1" => *radius -= 0.05,
            Solid::Convex(faces) if *name == "step" => faces.iter_mut().for_each(|(n, d)| *d += 0.2 * n.z),
            _ => {}
        }
    }
    let result = evaluate(&plan(), &setup.cloud());
    assert_eq!(result.verdict, Verdict::Fail);
    let small = find(&result, "sphere1_diameter");
    assert_eq!(small.verdict, Some(Verdict::Fail));
    assert!((small.deviation.unwrap() + 0.1).abs() < 0.01);
    assert_eq!(find(&result, "step_height").verdict, Some(Verdict::Fail));
    assert_eq!(find(&result, "sphere2_diameter").verdict, Some(Verdict::Pass));
}

/// What is missing is named, what does not depend on it is measured, and the part does not pass.
#[test]
fn missing_elements_are_named_and_never_pass() {
    let result = evaluate(&plan(), &Setup::new(1).without(&["step"]).cloud());
    let step = find(&result, "step_height");
    assert_eq!((step.verdict, step.value, step.u), (None, None, None));
    assert!(step.reason.as_ref().unwrap().contains("element step: 0 points in its region"));
    assert_eq!(find(&result, "sphere1_diameter").verdict, Some(Verdict::Pass));
    assert_eq!(result.verdict, Verdict::Indeterminate);

    let result = evaluate(&plan(), &Setup::new(1).without(&["sphere1", "post1"]).cloud());
    assert!(result.alignment.is_none());
    assert!(result.alignment_failure.as_ref().unwrap().contains("element sphere1"), "{result:?}");
    assert!(result.features.iter().all(|f| f.verdict.is_none() && f.reason.is_some()));
    assert_eq!(result.verdict, Verdict::Indeterminate);
}

/// One line per cloud that is not the part.
#[test]
fn clouds_that_are_not_the_part_are_refused_with_a_reason() {
    let whole = Setup { pitch_mm: 1.0, ..Setup::new(2) }.cloud();
    let changed = |f: &dyn Fn(&mut Point)| -> Vec<Point> {
        let mut cloud = whole.clone();
        cloud.iter_mut().for_each(f);
        cloud
    };
    let mut noise = Noise(5);
    let junk: Vec<Point> = whole
        .iter()
        .map(|p| {
            let normal = noise.direction().map(|v| v as f32).into();
            let place = [120.0, 120.0, 60.0].map(|size| size * (noise.uniform() - 0.5));
            Point { position_mm: place, normal, ..*p }
        })
        .collect();
    let far = Setup { world_from_part: pose(&mut Noise(1), 0.0, 0.0), pitch_mm: 1.0, ..Setup::new(2) };
    let far = Setup { world_from_part: Isometry3::translation(25.0, 0.0, 0.0), ..far }.cloud();
    let table: [(&str, Vec<Point>, &str); 6] = [
        ("empty", Vec::new(), "0 points"),
        ("NaN", changed(&|p| p.position_mm = [f64::NAN; 3]), "0 points"),
        ("infinite", changed(&|p| p.position_mm = [f64::INFINITY; 3]), "0 points"),
        ("no normals", changed(&|p| p.normal = [0.0; 3]), "element base: 0 points in its region ("),
        ("far away", far, "element"),
        ("junk", junk, "element"),
    ];
    for (case, cloud, words) in table {
        let result = evaluate(&loosened(4), &cloud);
        assert_ne!(result.verdict, Verdict::Pass, "{case}");
        assert!(result.features.iter().all(|f| f.verdict.is_none()), "{case}: {result:?}");
        let reason = result.alignment_failure.unwrap();
        assert!(reason.contains(words), "{case}: {reason}");
    }
}

/// A sphere through four places leaves no residual: copies of them are no measurement, however many there are.
#[test]
fn copies_of_few_points_are_no_measurement() {
    let plan = Plan::from_toml(
        "format = \"fringecell-plan/1\"\nname = \"ball\"\n[[element]]\nkind = \"sphere\"\nname = \"s\"\n\
         center_mm = [0.0, 0.0, 0.0]\ndiameter_mm = 20.0\nmargin_mm = 1.0\nmin_points = 10\n[[feature]]\n\
         kind = \"sphere-diameter\"\nname = \"d\"\nelement = \"s\"\nnominal_mm = 20.0\ntolerance_mm = [-0.1, 0.1]\n",
    )
    .unwrap();
    let mut noise = Noise(3);
    let mut point = |_: usize| {
        let out = noise.direction();
        let off = 10.0 + 0.01 * noise.normal();
        Point {
            position_mm: out.map(|v| off * v).into(),
            normal: out.map(|v| v as f32).into(),
            sigma_mm: 0.01,
            modulation: 80.0,
            pair: 0,
            pixel: 0,
            shared_mm: 0.0,
        }
    };
    let four: Vec<Point> = (0..4).map(&mut point).collect();
    let many: Vec<Point> = (0..40).map(&mut point).collect();
    let result = evaluate(&plan, &four.iter().cycle().take(20).copied().collect::<Vec<_>>());
    let found = find(&result, "d");
    assert!(
        found.value.is_none() && found.reason.as_ref().unwrap().contains("at 4 different places, needs 10")
    );
    assert_eq!(find(&evaluate(&plan, &many), "d").verdict, Some(Verdict::Pass));
}

#[test]
fn the_same_cloud_gives_the_same_bits_and_a_readable_result() {
    let cloud = Setup { pitch_mm: 1.0, ..Setup::new(8) }.cloud();
    let (plan, json) = (loosened(4), |r: &InspectionResult| serde_json::to_value(r).unwrap());
    let (first, second) = (evaluate(&plan, &cloud), evaluate(&plan, &cloud));
    assert_eq!(first, second);
    let written = json(&first);
    for key in ["name", "value", "unit", "u", "lower", "upper", "verdict"] {
        assert!(written["features"][0].get(key).is_some(), "{key}");
    }
    assert_eq!(written["features"][0]["lower"], 22.462 - 0.05);
    assert_eq!(written["elements"][0]["fit"]["kind"], "sphere");
    let points = &first.elements[0].points;
    assert!(points.windows(2).all(|w| w[0].index < w[1].index));
    assert!(points.iter().all(|p| (p.from_fit_mm - p.from_nominal_mm).abs() < 0.05));
}

/// What another process draws from the result that it received is what the inspection saw: the same points at the same
/// distances, but for those at the border of a region that a last hundredth of a margin moved.
#[test]
fn the_deviations_of_a_received_result_are_those_of_the_inspection() {
    let (plan, cloud) = (plan(), Setup::new(8).cloud());
    let result = evaluate(&plan, &cloud);
    let received: InspectionResult = serde_json::from_str(&serde_json::to_string(&result).unwrap()).unwrap();
    assert_eq!(received.features, result.features);
    assert_eq!(received.alignment, result.alignment);
    let drawn = deviations(&plan, &received.alignment.unwrap(), &received.elements, &cloud);
    let mut seen = std::collections::BTreeMap::new();
    for point in result.elements.iter().flat_map(|e| &e.points) {
        seen.entry(point.index).or_insert(point.from_fit_mm);
    }
    let same = drawn.iter().filter(|(index, mm)| seen.get(index).is_some_and(|s| (s - mm).abs() < 1e-5));
    let same = same.count();
    let most = seen.len().max(drawn.len());
    assert!(same > 5_000 && same * 1000 > 995 * most, "{same} of {most}");
    assert!(drawn.windows(2).all(|w| w[0].0 < w[1].0));
}

/// A part that stands elsewhere by plan, without an alignment: the placement maps part to world.
#[test]
fn a_placement_says_where_the_part_stands() {
    let placed = PLAN.replace(
        "[settings]",
        "[placement]\nrotation = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]\n\
         translation_mm = [10.0, 20.0, 5.0]\n[settings]",
    );
    let mut plan = Plan::from_toml(&placed).unwrap();
    plan.elements.iter_mut().for_each(|e| e.min_points /= 10);
    let world_from_part = plan.world_from_part;
    let cloud = Setup { world_from_part, pitch_mm: 1.0, ..Setup::new(3) }.cloud();
    let aligned = evaluate(&plan, &cloud);
    plan.datums = None;
    let trusted = evaluate(&plan, &cloud);
    for result in [aligned, trusted] {
        assert!(result.alignment.as_ref().unwrap().offset_mm < 0.01);
        assert!(pose_error_mm(&result, &world_from_part) < 0.01);
        let spacing = find(&result, "sphere_spacing").value.unwrap();
        assert!((spacing - 112.447).abs() < 0.01, "{spacing}");
    }
}

/// The obtuse angle is the supplement; its uncertainty and the decision are those of the acute one.
#[test]
fn the_supplement_of_an_angle_is_measured_on_request() {
    let obtuse = PLAN.replace("nominal_deg = 44.809", "supplement = true\nnominal_deg = 135.191");
    let cloud = Setup::new(5).cloud();
    let (acute, obtuse) = (evaluate(&plan(), &cloud), evaluate(&Plan::from_toml(&obtuse).unwrap(), &cloud));
    let (a, b) = (find(&acute, "wedge2_inclination"), find(&obtuse, "wedge2_inclination"));
    assert!((a.value.unwrap() + b.value.unwrap() - 180.0).abs() < 1e-12);
    assert_eq!((a.u, a.verdict), (b.u, b.verdict));
}

/// A stated system uncertainty joins in squares and widens the guard band until nothing can be proven.
#[test]
fn system_uncertainty_widens_the_guard_band() {
    let mut plan = plan();
    plan.features[0].u_system = 0.04;
    let result = evaluate(&plan, &Setup::new(5).cloud());
    let feature = &result.features[0];
    assert!((feature.u.unwrap() - (0.0016 + feature.u_noise.unwrap().powi(2)).sqrt()).abs() < 1e-15);
    assert_eq!(feature.verdict, Some(Verdict::Indeterminate));
    assert_eq!(result.verdict, Verdict::Indeterminate);
    // What the calibration adds does the same beside it.
    let result = evaluate(&plan.with_calibration(&[Some(0.03)]), &Setup::new(5).cloud());
    let feature = &result.features[0];
    assert!((feature.u.unwrap() - (0.0025 + feature.u_noise.unwrap().powi(2)).sqrt()).abs() < 1e-15);
    assert_eq!((feature.u_system, feature.u_calibration), (0.04, Some(0.03)));
    assert_eq!(result.features[1].u_calibration, None);
}

proptest! {
    /// Whatever the cloud: a result, each feature with a value or a reason, never a panic.
    #[test]
    fn no_cloud_makes_the_inspection_panic(places in prop::collection::vec(
        (prop::array::uniform3(prop_oneof![-60.0..60.0f64, Just(0.0), Just(f64::NAN), Just(1e300)]),
         prop::array::uniform3(prop_oneof![-1.0..1.0f32, Just(0.0), Just(f32::NAN)])), 0..300)) {
        let cloud: Vec<Point> = places
            .into_iter()
            .map(|(position_mm, normal)| Point {
                position_mm, normal, sigma_mm: 0.0, modulation: 0.0, pair: 0, pixel: 0, shared_mm: 0.0,
            })
            .collect();
        let mut plan = plan();
        plan.elements.iter_mut().for_each(|e| { e.min_points = 10; e.normal_tolerance_rad = None; e.margin_mm = 30.0; });
        for datums in [plan.datums, None] {
            plan.datums = datums;
            let result = evaluate(&plan, &cloud);
            for feature in &result.features {
                prop_assert_ne!(feature.value.is_some(), feature.reason.is_some());
                prop_assert_eq!(feature.value.is_none(), feature.verdict.is_none());
            }
            // What a stage states, the supervisor must be able to read.
            let text = serde_json::to_string(&result).unwrap();
            prop_assert!(serde_json::from_str::<InspectionResult>(&text).is_ok(), "{text}");
        }
    }
}
