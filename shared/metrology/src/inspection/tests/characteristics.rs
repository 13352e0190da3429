//! Geometrical characteristics of a synthetic part: closed form, scatter, what is refused.

use super::part::{ELEMENTS, Real};
use crate::inspection::{FeatureResult, Plan, evaluate};
use crate::verdict::Verdict;

/// A feature of one limit.
pub(super) fn limit(kind: &str, name: &str, element: &str, rest: &str) -> String {
    format!(
        "[[feature]]\nkind = \"{kind}\"\nname = \"{name}\"\nelement = \"{element}\"\nlimit_mm = 0.5\n{rest}\n"
    )
}

/// A feature with a tolerance.
pub(super) fn size(kind: &str, name: &str, of: &str, rest: &str) -> String {
    let unit = if matches!(kind, "angle" | "half-angle") { "deg" } else { "mm" };
    format!(
        "[[feature]]\nkind = \"{kind}\"\nname = \"{name}\"\n{of}\ntolerance_{unit} = [-0.5, 0.5]\n{rest}\n"
    )
}

fn plan(features: &[String]) -> Plan {
    Plan::from_toml(&format!("{ELEMENTS}\n{}", features.concat())).unwrap()
}

fn find<'a>(features: &'a [FeatureResult], name: &str) -> &'a FeatureResult {
    features.iter().find(|f| f.name == name).unwrap()
}

/// Sizes and places that points without noise give exactly.
fn exact_features() -> Vec<String> {
    let two = |a: &str, b: &str| format!("elements = [\"{a}\", \"{b}\"]");
    let one = |a: &str| format!("element = \"{a}\"");
    vec![
        size("size", "bore_d", &one("bore"), ""),
        size("size", "boss_d", &one("boss"), ""),
        size("size", "cone_d", &one("cone"), ""),
        size("half-angle", "cone_angle", &one("cone"), ""),
        size("size", "ball_d", &one("ball"), ""),
        size("size", "ring_d", &one("ring"), "size = \"ring-diameter\""),
        size("size", "tube_d", &one("ring"), "size = \"tube-diameter\""),
        size("distance", "ball_height", &two("top", "ball"), ""),
        size("distance", "bore_boss", &two("bore", "boss"), ""),
        size("distance", "bore_boss_x", &two("bore", "boss"), "along = [-1.0, 0.0, 0.0]"),
        size("distance", "corner_ball", &two("corner", "ball"), ""),
        size("distance", "width", &two("left", "right"), ""),
        size("distance", "foot", &two("ball_foot", "corner"), ""),
        size("angle", "square", &two("top", "front"), ""),
        size("angle", "upright", &two("boss", "top"), ""),
        limit("position", "bore_position", "bore", "datums = \"ABC\""),
        limit("position", "bore_rps", "bore", "datums = \"rps\""),
        limit("position", "mouth_position", "bore_mouth", "datums = \"ABC\""),
        limit("perpendicularity", "boss_perpendicularity", "boss", "datums = \"top\""),
        limit("parallelism", "right_parallelism", "right", "datums = \"left\"\nof = \"fit\""),
        limit("perpendicularity", "right_square", "right", "datums = \"ABC\"\nof = \"fit\""),
    ]
}

/// Values by hand: bore off by (0.03, 0.04) gives 0.1; boss tilted by 1 mrad over 19 mm gives 0.019; right side turned by
/// 1 mrad over 60 mm gives 0.06.
#[test]
fn without_noise_the_characteristics_are_those_of_the_drawing() {
    let real = Real {
        bore_off_mm: [0.03, 0.04],
        bore_diameter_mm: 12.05,
        boss_tilt_rad: [1e-3, 0.0],
        right_tilt_rad: 1e-3,
        ..Real::default()
    };
    let features = exact_features();
    let result = evaluate(&plan(&features), &real.cloud(3));
    for element in &result.elements {
        assert!(element.fit.is_some(), "{}: {:?}", element.name, element.reason);
    }
    let (sin, cos) = fringe::math::sincos(1e-3);
    let slope = sin / cos;
    let bore_boss = {
        let (dx, dy): (f64, f64) = (20.03, 25.04);
        (dx * dx + dy * dy).sqrt()
    };
    for (name, expected, tolerance) in [
        ("bore_d", 12.05, 1e-9),
        ("boss_d", 16.0, 1e-9),
        ("cone_d", 14.0, 1e-9),
        ("cone_angle", 30.0, 1e-9),
        ("ball_d", 10.0, 1e-9),
        ("ring_d", 20.0, 1e-9),
        ("tube_d", 6.0, 1e-9),
        ("ball_height", 20.0, 1e-9),
        ("bore_boss", bore_boss, 1e-3),
        ("bore_boss_x", 20.03, 1e-9),
        ("corner_ball", (90.0f64 * 90.0 + 30.0 * 30.0 + 20.0 * 20.0).sqrt(), 1e-9),
        ("foot", (90.0f64 * 90.0 + 30.0 * 30.0).sqrt(), 1e-9),
        ("square", 90.0, 1e-9),
        ("upright", 90.0 - 1e-3f64.to_degrees(), 1e-6),
        ("bore_position", 0.1, 1e-9),
        ("bore_rps", 0.1, 1e-9),
        ("mouth_position", 0.1, 1e-9),
        ("boss_perpendicularity", 19.0 * slope, 1e-8),
        ("right_parallelism", 60.0 * sin, 1e-8),
        ("right_square", 60.0 * sin, 1e-8),
    ] {
        let feature = find(&result.features, name);
        let value = feature.value.unwrap_or_else(|| panic!("{name}: {:?}", feature.reason));
        assert!((value - expected).abs() < tolerance, "{name}: {value} for {expected}");
    }
    let constructed = &result.constructed;
    assert!(constructed.iter().all(|c| c.point_mm.is_some()), "{constructed:?}");
    assert_eq!(result.features.len(), features.len());
}

/// Features whose uncertainty is that of the associated elements, with their true values.
fn of_elements() -> Vec<String> {
    let mut features = exact_features();
    features.push(limit("perpendicularity", "front_square", "front", "datums = \"top\"\nof = \"fit\""));
    features.push(limit("position", "ball_position", "ball", "datums = \"ABC\""));
    features.push(limit(
        "position",
        "bore_material",
        "bore",
        "datums = \"ABC\"\nmaximum_material = \"bore_d\"",
    ));
    features
}

/// Root mean square error about the true value over the stated uncertainty, for each feature.
fn coverage(seeds: u64) -> Vec<(String, f64)> {
    let real = Real {
        bore_off_mm: [0.03, 0.04],
        boss_tilt_rad: [2e-3, 0.0],
        right_tilt_rad: 1e-3,
        density: 1.2,
        ..Real::default()
    };
    let plan = plan(&of_elements());
    let truth = evaluate(&plan, &real.cloud(1));
    let noisy = Real { sigma_mm: 0.01, ..real };
    let mut sums = vec![(0.0, 0.0); plan.features.len()];
    for seed in 0..seeds {
        let result = evaluate(&plan, &noisy.cloud(seed + 100));
        for ((feature, truth), sum) in result.features.iter().zip(&truth.features).zip(&mut sums) {
            let value = feature.value.unwrap_or_else(|| panic!("{}: {:?}", feature.name, feature.reason));
            sum.0 += (value - truth.value.unwrap()).powi(2);
            sum.1 += feature.u.unwrap().powi(2);
        }
    }
    plan.features
        .iter()
        .zip(sums)
        .map(|(f, (squares, stated))| (f.name.clone(), (squares / stated).sqrt()))
        .collect()
}

/// Stated uncertainty beside the error of 60 clouds: known to 9 %, so the limits are three of that. What is zero by truth
/// (square front, ball in place) states up to 1.4 times too much between one and four of its uncertainties.
#[test]
fn characteristics_scatter_as_their_uncertainty_says() {
    for (name, ratio) in coverage(60) {
        let lowest = if matches!(name.as_str(), "front_square" | "ball_position") { 0.55 } else { 0.73 };
        assert!((lowest..1.27).contains(&ratio), "{name}: error over stated uncertainty = {ratio:.3}");
    }
}

/// The same over 1000 clouds, known to 2.2 %.
#[test]
#[ignore = "1000 clouds: cargo test --release -p fringe-metrology figures_of_characteristics -- --ignored --nocapture"]
#[expect(clippy::disallowed_macros, reason = "prints figures")]
fn figures_of_characteristics() {
    for (name, ratio) in coverage(1000) {
        eprintln!("{name:24} {ratio:.3}");
    }
}

/// Ranges of points, outlines and run-outs: their mean scatters as stated, or by less.
#[test]
fn ranges_and_outlines_state_no_less_than_they_scatter() {
    let one = |a: &str| format!("element = \"{a}\"");
    let features = vec![
        size("size", "rim_d", &one("rim"), ""),
        size("size", "slot_l", &one("slot"), "size = \"length\""),
        size("size", "slot_w", &one("slot"), "size = \"width\""),
        size("size", "window_l", &one("window"), "size = \"length\""),
        size("size", "window_w", &one("window"), "size = \"width\""),
        limit("position", "slot_position", "slot", "datums = \"ABC\"\nzone_direction = [0.0, 1.0, 0.0]"),
        limit("straightness", "trace_straight", "trace", ""),
        limit("flatness", "flat", "top", "filter_mm = 5.0\nreference = \"minimum-zone\""),
        limit("roundness", "round", "rim", "reference = \"minimum-zone\""),
        limit("cylindricity", "cylindrical", "boss", ""),
        limit("line-profile", "line_profile", "trace", "datums = \"ABC\""),
        limit("surface-profile", "cone_profile", "cone", "datums = \"ABC\"\nfilter_mm = 2.0"),
        limit("circular-runout", "boss_runout", "top", "datums = \"boss\"\nsection_mm = 5.0"),
        limit("total-runout", "top_runout", "top", "datums = \"boss\""),
        limit("parallelism", "right_points", "right", "datums = \"left\"\nfilter_mm = 4.0"),
    ];
    let plan = plan(&features);
    let mut sums = vec![[0.0; 3]; features.len()];
    let seeds = 60;
    for seed in 0..seeds {
        let result = evaluate(&plan, &Real { sigma_mm: 0.01, ..Real::default() }.cloud(seed));
        for (feature, [sum, squares, stated]) in result.features.iter().zip(&mut sums) {
            let value = feature.value.unwrap_or_else(|| panic!("{}: {:?}", feature.name, feature.reason));
            *sum += value;
            *squares += value * value;
            *stated += feature.u.unwrap().powi(2);
        }
    }
    let count = seeds as f64;
    for (feature, [sum, squares, stated]) in plan.features.iter().zip(&sums) {
        let mean = sum / count;
        let scatter = ((squares / count - mean * mean) * count / (count - 1.0)).max(0.0).sqrt();
        let ratio = scatter / (stated / count).sqrt();
        // Of its fourteen border points the window knows their scatter to a third.
        let most = if feature.name.starts_with("window") { 1.4 } else { 1.3 };
        assert!((0.3..most).contains(&ratio), "{}: scatter over stated = {ratio:.2} at {mean}", feature.name);
        // Sizes of outlines: the mean gap is made up for.
        if feature.name.contains("_l") && !feature.name.contains("profile")
            || feature.name.contains("_w")
            || feature.name == "rim_d"
        {
            let off = (mean - feature.nominal) / (stated / count).sqrt();
            assert!(off.abs() < 0.7, "{}: {mean} for {}, {off:.2} u", feature.name, feature.nominal);
        }
    }
}

/// A hole at its maximum material size has the tolerance of the drawing, a larger one as much more as it is larger.
#[test]
fn maximum_material_widens_the_limit_by_the_departure() {
    let features = |limit_mm: f64| {
        let position = limit("position", "place", "bore", "datums = \"ABC\"\nmaximum_material = \"bore_d\"");
        let size = "[[feature]]\nkind = \"size\"\nname = \"bore_d\"\nelement = \"bore\"\ntolerance_mm = [0.0, 0.1]\n";
        vec![size.to_owned(), position.replace("limit_mm = 0.5", &format!("limit_mm = {limit_mm:?}"))]
    };
    for (diameter, bonus) in [(12.0, 0.0), (12.06, 0.06), (12.3, 0.1), (11.95, 0.0)] {
        let real = Real { bore_off_mm: [0.03, 0.04], bore_diameter_mm: diameter, ..Real::default() };
        let result = evaluate(&plan(&features(0.05)), &real.cloud(2));
        let place = find(&result.features, "place");
        assert!((place.value.unwrap() - 0.1).abs() < 1e-9);
        assert!((place.upper.unwrap() - 0.05 - bonus).abs() < 1e-8, "{diameter}: {place:?}");
        assert_eq!(
            place.verdict,
            Some(if bonus > 0.05 { Verdict::Pass } else { Verdict::Fail }),
            "{diameter}"
        );
    }
}

/// Criteria order themselves: inscribed below least squares below circumscribed, the zone no wider than the range.
#[test]
fn criteria_of_a_noisy_boss_lie_around_its_diameter() {
    let value = |criterion: &str| {
        let text = format!("{ELEMENTS}\n{}", size("size", "d", "element = \"boss\"", ""));
        let text =
            text.replacen("name = \"boss\"", &format!("name = \"boss\"\ncriterion = \"{criterion}\""), 1);
        let result =
            evaluate(&Plan::from_toml(&text).unwrap(), &Real { sigma_mm: 0.01, ..Real::default() }.cloud(5));
        let feature = find(&result.features, "d").clone();
        assert!(feature.detail.unwrap().contains(criterion));
        (feature.value.unwrap(), feature.u.unwrap())
    };
    let [mean, zone, inner, outer] =
        ["least-squares", "minimum-zone", "maximum-inscribed", "minimum-circumscribed"].map(value);
    assert!(inner.0 < mean.0 - 0.03 && outer.0 > mean.0 + 0.03, "{inner:?} {mean:?} {outer:?}");
    assert!((zone.0 - mean.0).abs() < 0.02, "{zone:?}");
    assert!(inner.1 > mean.1 && outer.1 > mean.1 && zone.1 > mean.1);
}

/// What a plan must not say, with the words of the message.
#[test]
#[allow(clippy::too_many_lines, reason = "one line for each refusal")]
fn characteristics_that_mean_nothing_are_refused() {
    let one = |a: &str| format!("element = \"{a}\"");
    let system = |datums: &str| format!("[[datum_system]]\nname = \"X\"\ndatums = {datums}\n");
    let made = |kind: &str, elements: &str| {
        format!("[[element]]\nkind = \"{kind}\"\nname = \"made\"\nelements = {elements}\n")
    };
    let good = limit("position", "p", "bore", "datums = \"ABC\"");
    let table: Vec<(String, &[&str])> = vec![
        (
            made("intersection", "[\"left\", \"right\"]") + &good,
            &["element \"made\"", "parallel within", "limit 0.057°"],
        ),
        (made("intersection", "[\"ball\", \"ring\"]") + &good, &["sphere and torus have no intersection"]),
        (made("projection", "[\"boss\", \"top\"]") + &good, &["stands on the plane"]),
        (made("symmetry-plane", "[\"top\", \"left\"]") + &good, &["90.0° apart", "limit 45°"]),
        (made("fit-circle", "[\"ball\", \"ring\"]") + &good, &["2 elements, needs at least 3"]),
        (made("fit-line", "[\"ball\", \"made\"]") + &good, &["elements names \"made\""]),
        (made("projection", "[\"ball\", \"ball\"]") + &good, &["names \"ball\" twice"]),
        (system("[\"top\", \"nothing\"]") + &good, &["datum_system \"X\"", "\"nothing\""]),
        (system("[\"top\", \"top\"]") + &good, &["twice"]),
        (system("[]") + &good, &["datums is empty"]),
        (limit("position", "p", "bore", "datums = \"top\""), &["leave open: shift along", "add a datum"]),
        (
            system("[\"top\", \"boss\"]") + &limit("position", "p", "bore", "datums = \"X\""),
            &["turn about (0.00, 0.00, 1.00)"],
        ),
        (limit("position", "p", "top", "datums = \"ABC\""), &["hold \"top\", which is toleranced"]),
        (
            limit("position", "p", "bore", "datums = \"ABC\"\nmaximum_material = \"d\""),
            &["maximum_material = \"d\"", "kind \"size\" of element \"bore\""],
        ),
        (size("size", "d", &one("top"), ""), &["is a plane: it has no size"]),
        (size("size", "d", &one("slot"), ""), &["give size = \"length\" or \"width\""]),
        (size("angle", "a", "elements = [\"ball\", \"top\"]", ""), &["has no direction"]),
        (limit("flatness", "f", "boss", ""), &["a cylinder; name a plane"]),
        (limit("flatness", "f", "middle", ""), &["is made of others and has no points"]),
        (limit("roundness", "f", "rim", "filter_mm = 1.0\nreference = \"minimum-zone\""), &["leave one out"]),
        (
            limit("cylindricity", "f", "boss", "reference = \"maximum-inscribed\""),
            &["knows least-squares and minimum-zone"],
        ),
        (limit("parallelism", "f", "front", "datums = \"top\""), &["miss that by 90.000°", "angularity"]),
        (limit("perpendicularity", "f", "front", "datums = \"ball\""), &["a sphere, which has no direction"]),
        (limit("coaxiality", "f", "boss", "datums = \"bore\""), &["nominally 32.0156 mm from its datum"]),
        (
            limit("circular-runout", "f", "boss", "datums = \"top\"\nsection_mm = 1.0"),
            &["run-out needs one axis first"],
        ),
        (limit("circular-runout", "f", "boss", "datums = \"bore\"\nsection_mm = 0.0"), &["section_mm = 0"]),
        (limit("surface-profile", "f", "rim", ""), &["a circle; name a sphere"]),
        (
            limit("position", "p", "bore", "datums = \"ABC\"\nzone_direction = [0.0, 0.0, 0.0]"),
            &["zone_direction = 0"],
        ),
    ];
    for (text, words) in table {
        let error = Plan::from_toml(&format!("{ELEMENTS}\n{text}")).expect_err(&text).to_string();
        assert!(words.iter().all(|word| error.contains(word)) && !error.contains('\n'), "{text}\n{error}");
    }
    for (from, to, words) in [
        ("name = \"boss\"", "name = \"boss\"\nsector_deg = 90.0", "go together"),
        ("half_angle_deg = 30.0", "half_angle_deg = 70.0", "beyond the apex"),
        ("tube_diameter_mm = 6.0", "tube_diameter_mm = 60.0", "tube_diameter_mm = 60"),
        ("size_mm = [20.0, 8.0]", "size_mm = [8.0, 20.0]", "length, then width"),
        ("name = \"cone\"", "name = \"cone\"\ncriterion = \"minimum-zone\"", "a cone knows: least-squares"),
        ("band_mm = 4.0", "band_mm = 0.0", "band_mm = 0"),
    ] {
        assert!(ELEMENTS.contains(from), "{from}");
        let text = format!("{}\n{good}", ELEMENTS.replacen(from, to, 1));
        let error = Plan::from_toml(&text).expect_err(to).to_string();
        assert!(error.contains(words), "{to}: {error}");
    }
}

/// Elements that the cloud does not show: what depends on them states the reason, what does not is measured.
#[test]
fn an_empty_region_is_told_where_it_matters() {
    let features = of_elements();
    let cloud: Vec<_> = Real { density: 1.2, ..Real::default() }
        .cloud(1)
        .into_iter()
        .filter(|p| {
            let (x, y) = (p.position_mm[0] - 20.0, p.position_mm[1] - 10.0);
            (x * x + y * y).sqrt() > 6.5
        })
        .collect();
    let result = evaluate(&plan(&features), &cloud);
    for name in ["bore_d", "bore_position", "mouth_position", "bore_boss"] {
        let feature = find(&result.features, name);
        assert!(feature.value.is_none() && feature.verdict.is_none());
        assert!(feature.reason.as_ref().unwrap().contains("element bore: 0 points"), "{feature:?}");
    }
    assert!(find(&result.features, "boss_d").value.is_some());
    assert_ne!(result.verdict, Verdict::Pass);
    let pitch = result.constructed.iter().find(|c| c.name == "pitch").unwrap();
    assert!(pitch.point_mm.is_none() && pitch.reason.as_ref().unwrap().contains("element bore"));
}
