//! Elements, inspection plans and comparisons with a coordinate measuring machine, on clouds made here.

use crate::support::{Ran, fringetool, root};
use fringe::cloud::Point;
use serde_json::Value;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A point with a normal.
fn point(position_mm: [f64; 3], normal: [f64; 3]) -> Point {
    let zero: Point = bytemuck::Zeroable::zeroed();
    Point { position_mm, normal: normal.map(|v| v as f32), sigma_mm: 0.01, modulation: 100.0, ..zero }
}

/// Even noise of ±`size` from a counter.
fn noise(counter: u64, size: f64) -> f64 {
    size * fringe::math::random::Key::new(3).symmetric(counter)
}

/// A cap of 20 mm diameter about (5, 6, 300) on a plate at z = 290, seen from above.
fn ball_on_plate() -> Vec<Point> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let mut points = Vec::new();
    for i in 0..3000_u32 {
        let z = 1.0 - 1.1 * f64::from(i) / 3000.0;
        let (sin, cos) = fringe::math::sincos(golden * f64::from(i));
        let across = (1.0 - z * z).sqrt();
        let normal = [across * cos, across * sin, z];
        let radius = 10.0 + noise(u64::from(i), 0.02);
        points.push(point([5.0 + radius * normal[0], 6.0 + radius * normal[1], 300.0 + radius * z], normal));
    }
    for i in 0..60_u32 {
        for j in 0..60_u32 {
            let counter = 10_000 + u64::from(60 * i + j);
            let place = [f64::from(i) - 24.5, f64::from(j) - 23.5, 290.0 + noise(counter, 0.02)];
            points.push(point(place, [0.0, 0.0, 1.0]));
        }
    }
    points
}

struct Workspace {
    folder: TempDir,
}

impl Workspace {
    fn new() -> Self {
        Self { folder: TempDir::new().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    fn cloud(&self, name: &str, points: &[Point]) -> String {
        files::ply::write_cloud(&self.path(name), points, &[]).unwrap();
        self.text(name)
    }

    fn file(&self, name: &str, contents: &str) -> String {
        std::fs::write(self.path(name), contents).unwrap();
        self.text(name)
    }

    fn json(&self, name: &str) -> Value {
        read(&self.path(name))
    }
}

fn read(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn refused(ran: &Ran, words: &[&str]) {
    assert_eq!(ran.code, Some(2), "stdout:\n{}\nstderr:\n{}", ran.stdout, ran.stderr);
    for word in words {
        assert!(ran.stderr.contains(word), "\"{word}\" is not in: {}", ran.stderr);
    }
    assert_eq!(ran.stderr.trim_end().lines().count(), 1, "{}", ran.stderr);
}

#[test]
fn a_ball_is_found_on_its_plate_and_its_keys_stay_what_others_rely_on() {
    let workspace = Workspace::new();
    let cloud = workspace.cloud("c.ply", &ball_on_plate());
    let out = workspace.text("fit.json");
    let base = ["--near", "5,6,300,14", "--within", "0.1", "--minimum-zone", "--json", &out];
    let fit = |element: &str, more: &[&str]| {
        let arguments = [&["fit", element, &cloud][..], &base, more].concat();
        fringetool(&arguments).expect_success();
        workspace.json("fit.json")
    };
    let sphere = fit("sphere", &[]);
    assert!((sphere["diameter_mm"].as_f64().unwrap() - 20.0).abs() < 0.01, "{sphere}");
    assert!(sphere["outside_margin"].as_u64().unwrap() > 100, "the plate is left out, and counted");
    let (zone, range) = (&sphere["minimum_zone_mm"], &sphere["form_range_mm"]);
    assert!(zone.as_f64().unwrap() <= range.as_f64().unwrap() && zone.as_f64().unwrap() > 0.03);
    for key in
        ["center_mm", "points", "rejected", "form_sigma_mm", "form_d95_mm", "u_center_mm", "u_diameter_mm"]
    {
        assert!(!sphere[key].is_null(), "{key}");
    }
    let fixed = fit("sphere", &["--radius", "10"]);
    assert_eq!((fixed["diameter_mm"].as_f64(), fixed["u_diameter_mm"].as_f64()), (Some(20.0), Some(0.0)));
    let plane = fit("plane", &[]);
    assert!((plane["offset_mm"].as_f64().unwrap() - 290.0).abs() < 0.01, "{plane}");
}

#[test]
fn regions_that_hold_no_such_element_are_refused_and_leave_no_file() {
    let workspace = Workspace::new();
    let ball = ball_on_plate();
    let (ball, plate) = ball.split_at(3000);
    let cloud = workspace.cloud("plate.ply", plate);
    let out = workspace.text("fit.json");
    let fit = |element: &str, cloud: &str, more: &[&str]| {
        fringetool(&[&["fit", element, cloud, "--json", &out][..], more].concat())
    };
    refused(&fit("sphere", &cloud, &[]), &["plate.ply", "sphere", "are they points of a plane"]);
    let few = workspace.cloud("few.ply", &[ball[0], ball[800], ball[1600], ball[2400]]);
    refused(&fit("sphere", &few, &[]), &["few.ply", "4 points, needs at least 5"]);
    refused(&fit("sphere", &workspace.cloud("none.ply", &[]), &[]), &["none.ply", "no point"]);
    refused(&fit("sphere", &cloud, &["--near", "900,0,0,1"]), &["within --near"]);
    refused(&fit("plane", &cloud, &["--radius", "3"]), &["--radius", "spheres only"]);
    refused(&fit("sphere", &cloud, &["--radius=-3"]), &["diameter_mm = -6"]);
    refused(&fit("sphere", &cloud, &["--within", "0"]), &["margin_mm = 0"]);
    refused(&fit("cone", &cloud, &["--minimum-zone"]), &["--minimum-zone"]);
    let mut torn = ball.to_vec();
    torn[7].position_mm[1] = f64::NAN;
    let ran = fit("sphere", &workspace.cloud("torn.ply", &torn), &[]).expect_success();
    assert!(ran.stderr.contains("1 point without finite"), "{}", ran.stderr);
    std::fs::remove_file(workspace.path("fit.json")).unwrap();
    let metres: Vec<Point> = ball.iter().map(|p| point(p.position_mm.map(|v| v * 1e-3), [0.0; 3])).collect();
    refused(
        &fit("sphere", &workspace.cloud("metres.ply", &metres), &[]),
        &["metres.ply", "is the file in metres?"],
    );
    let bytes = std::fs::read(workspace.path("plate.ply")).unwrap();
    std::fs::write(workspace.path("long.ply"), [&bytes[..], &bytes[..45]].concat()).unwrap();
    refused(
        &fit("plane", &workspace.text("long.ply"), &[]),
        &["long.ply", "3600 \"vertex\"", "45 bytes follow"],
    );
    assert!(!workspace.path("fit.json").exists());
}

/// A plan for the ball on its plate, where it nominally lies.
fn plan(tolerance_mm: f64) -> String {
    format!(
        r#"
format = "fringecell-plan/1"
name = "ball on plate"
[[element]]
kind = "sphere"
name = "ball"
center_mm = [5.02, 5.99, 300.01]
diameter_mm = 20.05
max_polar_deg = 90.0
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 500
[[element]]
kind = "plane"
name = "plate"
point_mm = [5.0, 6.0, 290.0]
normal = [0.0, 0.0, 1.0]
size_mm = [50.0, 50.0]
margin_mm = 0.5
normal_tolerance_deg = 20.0
min_points = 500
exclude = [{{ center_mm = [5.0, 6.0, 290.0], radius_mm = 6.0 }}]
[[feature]]
kind = "sphere-diameter"
name = "diameter"
element = "ball"
nominal_mm = 20.0
tolerance_mm = [-{tolerance_mm}, {tolerance_mm}]
[[feature]]
kind = "hemisphere-height"
name = "height"
sphere = "ball"
plane = "plate"
nominal_mm = 20.0
tolerance_mm = [-0.05, 0.05]
"#
    )
}

/// Proves: a ball is freed of what noise along the lines of sight does to it where the cloud says whence it was seen, and only there.
#[test]
fn a_ball_is_freed_of_noise_along_the_lines_of_sight() {
    let workspace = Workspace::new();
    // A camera above sees no more of it than that.
    let upper = plan(0.05).replace("max_polar_deg = 90.0", "max_polar_deg = 65.0");
    let (plan_path, out) = (workspace.file("plan.toml", &upper), workspace.text("m.json"));
    let seen = |comments: &[(&str, &str)]| {
        files::ply::write_cloud(&workspace.path("seen.ply"), &ball_on_plate(), comments).unwrap();
        fringetool(&["measure", &plan_path, &workspace.text("seen.ply"), "--json", &out, "--force"])
    };
    let diameter = |comments: &[(&str, &str)]| {
        seen(comments).expect_success();
        let feature = workspace.json("m.json")["features"][0].clone();
        (feature["value"].as_f64().unwrap(), feature["u"].as_f64().unwrap())
    };
    let pairs = ("pairs", "[\"p\"]");
    let from = |pair: &str, place: &str, limb: f64| {
        format!("{{\"{pair}\": {{\"own\": {{\"place_mm\": {place}, \"limb_rad\": {limb}}}}}}}")
    };
    let (plain_mm, u_mm) = diameter(&[pairs]);
    let above = from("p", "[5.0, 6.0, 700.0]", 0.0);
    let (freed_mm, same_u_mm) = diameter(&[pairs, ("viewpoints", &above)]);
    assert!(freed_mm > plain_mm + 1e-5 && freed_mm < plain_mm + u_mm, "{plain_mm}, {freed_mm}, u {u_mm}");
    assert_eq!(same_u_mm, u_mm);
    // Another pair's place, none, and one from below, where no camera sees these faces.
    for other in [from("q", "[5.0, 6.0, 700.0]", 0.0), "{}".into(), from("p", "[5.0, 6.0, -700.0]", 0.0)] {
        assert_eq!(diameter(&[pairs, ("viewpoints", &other)]).0, plain_mm, "{other}");
    }
    // Without the points near its limb less of it is left; where that would be most of it, all is taken.
    let points = |limb: f64| {
        seen(&[pairs, ("viewpoints", &from("p", "[5.0, 6.0, 700.0]", limb))]).expect_success();
        workspace.json("m.json")["elements"][0]["fit"]["points"].as_u64().unwrap()
    };
    let [all, clear, small] = [0.0, 0.005, 0.02].map(points);
    assert!(clear < all && clear > all / 2 && small == all, "{all}, {clear}, {small}");
    let wrong = seen(&[pairs, ("viewpoints", &from("p", "[5.0, 6.0]", 0.0))]);
    refused(&wrong, &["seen.ply", "viewpoints", "reconstruct the cloud again"]);
}

#[test]
fn a_plan_is_measured_on_a_cloud_and_compared_with_a_machine() {
    let workspace = Workspace::new();
    let cloud = workspace.cloud("c.ply", &ball_on_plate());
    let (plan_path, out) = (workspace.file("plan.toml", &plan(0.05)), workspace.text("m.json"));
    let ran = fringetool(&["measure", &plan_path, &cloud, "--json", &out]).expect_success();
    assert!(ran.stdout.contains("verdict: pass"), "{}", ran.stdout);
    let result = workspace.json("m.json");
    for (index, name) in ["diameter", "height"].iter().enumerate() {
        let feature = &result["features"][index];
        assert_eq!((feature["name"].as_str(), feature["verdict"].as_str()), (Some(*name), Some("pass")));
        assert!((feature["value"].as_f64().unwrap() - 20.0).abs() < 5.0 * feature["u"].as_f64().unwrap());
    }
    let deviation = result["features"][0]["deviation"].as_f64().unwrap();
    let shifted = plan(0.05).replace("nominal_mm = 20.0\ntolerance", "nominal_mm = 19.8\ntolerance");
    let wrong = workspace.file("wrong.toml", &shifted);
    let ran = fringetool(&["measure", &wrong, &cloud]);
    assert_eq!(ran.code, Some(1), "{}", ran.stdout);
    let elsewhere = plan(0.05).replace("center_mm = [5.02", "center_mm = [65.02");
    let ran = fringetool(&["measure", &workspace.file("elsewhere.toml", &elsewhere), &cloud]);
    assert_eq!(ran.code, Some(1), "{}", ran.stdout);
    assert!(ran.stdout.contains("verdict: indeterminate; 2 of 2 features not measured"), "{}", ran.stdout);
    let other = root().join("configs/complex-artefact.plan.toml");
    let ran = fringetool(&["measure", &other.display().to_string(), &cloud]);
    assert_eq!(ran.code, Some(1), "{}", ran.stdout);
    assert!(ran.stdout.contains("verdict: none, because the part was not found"), "{}", ran.stdout);
    let torn = workspace.file("torn.toml", &plan(0.05).replace("min_points = 500\n", "min_pints = 500\n"));
    refused(&fringetool(&["measure", &torn, &cloud]), &["torn.toml:", "min_pints", "did you mean"]);
    refused(&fringetool(&["measure", &cloud, &plan_path]), &["c.ply"]);
    refused(&fringetool(&["measure", &plan_path, &workspace.text("absent.ply")]), &["absent.ply"]);

    let table = workspace.file("cmm.csv", "name,value,unit,u\ndiameter,20.0,mm,0.001\nbore,3.0,mm,0.001\n");
    let (csv, json) = (workspace.text("table.csv"), workspace.text("table.json"));
    let ran = fringetool(&["cmm-compare", &out, &table, "--csv", &csv, "--json", &json]).expect_success();
    assert!(
        ran.stdout.contains("bore: not in the result") && ran.stdout.contains("height: not in the table")
    );
    let comparison = workspace.json("table.json");
    assert!((comparison["lines"][0]["deviation"].as_f64().unwrap() - deviation).abs() < 1e-12);
    assert!(std::fs::read_to_string(csv).unwrap().starts_with("name,unit,cmm,U_cmm,measured,"));
}

/// Table 5.2 as its own input: deviations, their uncertainties and normalised errors to the printed digits.
#[test]
fn the_thesis_table_comes_out_of_its_own_values() {
    let workspace = Workspace::new();
    let rows = [
        ("sphere1_diameter", "mm", 22.580, 0.121, 0.118, 0.123, 0.960),
        ("sphere2_diameter", "mm", 22.386, 0.120, 0.019, 0.123, 0.151),
        ("sphere_spacing", "mm", 112.534, 0.121, 0.087, 0.123, 0.698),
        ("hemisphere_diameter", "mm", 60.063, 0.120, -0.131, 0.366, -0.358),
        ("wedge1_inclination", "deg", 45.052, 0.008, 0.088, 0.035, 2.519),
        ("wedge2_inclination", "deg", 180.0 - 135.317, 0.006, -0.126, 0.037, -3.452),
    ];
    let features: Vec<Value> = rows
        .iter()
        .map(|(name, unit, value, expanded, ..)| {
            serde_json::json!({ "name": name, "value": value, "unit": unit, "u": 0.5 * expanded })
        })
        .collect();
    let result = workspace.file("result.json", &serde_json::json!({ "features": features }).to_string());
    let table = root().join("configs/complex-artefact.cmm.csv");
    let json = workspace.text("table.json");
    let ran = fringetool(&["cmm-compare", &result, table.to_str().unwrap(), "--json", &json]);
    assert_eq!(ran.code, Some(1), "the wedges disagree: {}{}", ran.stdout, ran.stderr);
    for (line, (name, _, _, _, deviation, expanded, e_n)) in
        workspace.json("table.json")["lines"].as_array().unwrap().iter().zip(rows)
    {
        let near = |key: &str, printed: f64, last: f64| (line[key].as_f64().unwrap() - printed).abs() <= last;
        assert!(near("deviation", deviation, 1e-9), "{name}: {line}");
        // Two values rounded to 1 µm, two uncertainties to 1 µm, and the last printed digit of E_n itself.
        let rounding = (1e-3 + 6e-4 * f64::abs(e_n)) / expanded + 5e-4;
        assert!(near("U_deviation", expanded, 6e-4) && near("E_n", e_n, rounding), "{name}: {line}");
    }
    for (csv, words) in [
        ("name,value,unit,u\nnothing,1,mm,1\n", "no line names a measured feature"),
        ("name,value,unit,u\nsphere1_diameter,22,deg,1\n", "write both in one unit"),
        ("name,value,unit,u\nsphere1_diameter,22,mm,-1\n", "u: value -1"),
        ("\u{feff}", "has no header row"),
    ] {
        let table = workspace.file("bad.csv", csv);
        refused(&fringetool(&["cmm-compare", &result, &table]), &["bad.csv", words]);
    }
    refused(&fringetool(&["cmm-compare", table.to_str().unwrap(), table.to_str().unwrap()]), &["cmm.csv"]);
}

#[test]
fn sampling_plans_are_written_for_parts_and_elements() {
    let workspace = Workspace::new();
    let out = workspace.text("plan.csv");
    let lines = |arguments: &[&str]| -> usize {
        fringetool(&[arguments, &["--out", &out]].concat()).expect_success();
        std::fs::read_to_string(&out).unwrap().lines().count() - 1
    };
    assert_eq!(lines(&["cmm-plan", "sphere", "--diameter", "22.4", "--points", "25"]), 25);
    assert_eq!(lines(&["cmm-plan", "plane", "--size", "60x20", "--points", "27", "--axis", "0,1,1"]), 27);
    assert_eq!(
        lines(&["cmm-plan", "cylinder", "--diameter", "10", "--height", "40", "--points", "100"]),
        110
    );
    let part = ["cmm-plan", "part", "configs/complex-artefact.plan.toml", "--points", "20"];
    assert!(lines(&part) >= 7 * 20);
    std::fs::remove_file(&out).unwrap();
    for (arguments, words) in [
        (&["cmm-plan", "sphere", "--diameter", "0"][..], "--diameter 0"),
        (&["cmm-plan", "sphere", "--diameter", "9", "--points", "0"], "--points 0"),
        (&["cmm-plan", "plane", "--size", "5x5", "--axis", "0,0,0"], "--axis"),
        (&["cmm-plan", "part", "absent.toml"], "absent.toml"),
    ] {
        refused(&fringetool(&[arguments, &["--out", &out]].concat()), &[words]);
    }
    assert!(!workspace.path("plan.csv").exists());
}
