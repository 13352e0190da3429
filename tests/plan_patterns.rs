//! What `plan-patterns` promises is what the twin's recording of it gives.

use crate::support::fringetool;
use std::path::Path;
use tempfile::TempDir;

/// A plate that faces the first projector of the demo, seen by its cameras at half their resolution.
const PLATE: &str = "format = \"fringecell-scene/1\"\n[[material]]\nname = \"matte\"\nalbedo = 0.7\n[[body]]\nname = \"plate\"\n\
    material = \"matte\"\nposition_mm = [0.0, 0.0, 15.0]\nrotation_deg = [0.0, 42.0, 0.0]\n\
    geometry = { shape = \"plane\", size_mm = [90.0, 90.0], thickness_mm = 5.0 }\n";
/// Well inside the plate.
const REGION: &str = "--near=0,0,15,33";

struct Cell {
    folder: TempDir,
}

impl Cell {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let rig = twin::thesis::rig(562, 375);
        files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
        std::fs::write(folder.path().join("scene.toml"), PLATE).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// Records what a `[[projector]]` table projects; its driver and cameras are those of the demo.
    fn record(&self, projector: &str, name: &str, seed: u64) {
        self.record_with(projector, name, seed, "");
    }

    /// The same with further settings of the twin.
    fn record_with(&self, projector: &str, name: &str, seed: u64, settings: &str) {
        let text = format!(
            "format = \"fringecell-config/1\"\nname = \"planned\"\nrig = \"rig.toml\"\npairs = [\"pair1\"]\n{}\n\
             [[camera]]\nname = \"cam1\"\ndriver = \"twin\"\n[[camera]]\nname = \"cam2\"\ndriver = \"twin\"\n\
             [twin]\nscene = \"scene.toml\"\nseed = {seed}\n[twin.settings]\nposition_scatter_mm = 0.0\nangle_scatter_deg = 0.0\n{settings}",
            projector.replace("[[projector]]", "[[projector]]\ndriver = \"twin\"")
        );
        std::fs::write(self.path("cell.toml"), text).unwrap();
        fringetool(&["simulate", &self.path("cell.toml"), "--out", &self.path(name)]).expect_success();
    }

    fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(self.path(name)).unwrap()).unwrap()
    }

    fn wrapped_rad(&self, recording: &str, out: &str) -> Vec<f32> {
        let arguments =
            ["unwrap", &self.path(recording), "--method", "reliability", "--out", &self.path(out)];
        fringetool(&arguments).expect_success();
        files::npy::read(Path::new(&self.path(&format!("{out}/proj1-cam1-x-wrapped.npy")))).unwrap().values
    }
}

const DEMO: &str = "[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\ncameras = [\"cam1\", \"cam2\"]\nsequence = [\n\
    { set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 },\n\
    { set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 },\n{ set = \"white\" }, { set = \"black\" },\n]\n";

/// Standard deviation of the noise in each of two recordings of the same.
fn scatter_rad(one: &[f32], two: &[f32]) -> f64 {
    let mut squares: Vec<f64> = one
        .iter()
        .zip(two)
        .filter(|(a, b)| a.is_finite() && b.is_finite())
        .map(|(a, b)| 0.5 * fringe::math::wrap_rad(f64::from(a - b)).powi(2))
        .collect();
    // The plate's sides and rim are darker than its face: the lower nine tenths are the face's.
    squares.sort_by(f64::total_cmp);
    let face = &squares[..squares.len() * 9 / 10];
    let n = face.len() as f64;
    // What a normal scatter leaves below the 90 % quantile of its square.
    let share = 0.9 - 2.0 * 1.644_853_6 * 0.103_135_6;
    (face.iter().sum::<f64>() / n * 0.9 / share).sqrt()
}

#[test]
fn a_plan_holds_for_noise_orders_and_points() {
    let cell = Cell::new();
    cell.record(DEMO, "first", 1);
    // What a user reads from a first recording.
    let (first, decoded) = (cell.path("first"), cell.path("first.json"));
    fringetool(&["decode", &first, "--camera", "cam1", "--json", &decoded, "--out", &cell.path("maps")])
        .expect_success();
    let view = cell.json("first.json")["views"][0].clone();
    let number = |key: &str| view[key].as_f64().unwrap_or_else(|| panic!("{key} in {view}"));
    let noise =
        format!("{},{}", number("noise_read_variance_dn2").max(0.0).sqrt(), number("noise_gain_dn").max(0.0));
    let (contrast, threshold) =
        (number("contrast_median_dn").to_string(), number("threshold_median_dn").to_string());
    assert!(number("u_threshold_median_dn") < 0.02 * number("contrast_median_dn"));
    let raster = files::npy::read(Path::new(&cell.path("maps/proj1-cam1-x-threshold.npy"))).unwrap();
    assert_eq!((raster.width_px, raster.height_px), (562, 375));
    assert!(Path::new(&cell.path("maps/proj1-cam1-x-wrong-order.npy")).exists());

    let (rig, plan, json) = (cell.path("rig.toml"), cell.path("plan.toml"), cell.path("plan.json"));
    let wanted =
        ["--want-u-um", "8", "--noise", &noise, "--modulation-dn", &contrast, "--background-dn", &threshold];
    let arguments =
        [&["plan-patterns", "--rig", &rig, "--out", &plan, "--json", &json][..], &wanted[..]].concat();
    let ran = fringetool(&arguments).expect_success();
    assert!(ran.stdout.contains("errors of the pattern cancel"), "{}", ran.stdout);
    let proposal = cell.json("plan.json")["proposals"][0].clone();
    let promised = |key: &str| proposal[key].as_f64().unwrap();
    assert!(promised("u_point_um") <= 8.0 && promised("wrong_order") <= 1e-6, "{proposal}");

    let table = std::fs::read_to_string(&plan).unwrap();
    cell.record(&table, "one", 11);
    cell.record(&table, "two", 12);
    // Phase noise: two recordings that differ by nothing else.
    let (one, two) = (cell.wrapped_rad("one", "u1"), cell.wrapped_rad("two", "u2"));
    let observed = scatter_rad(&one, &two);
    let ratio = observed / promised("sigma_phase_rad");
    assert!(
        (0.9..1.1).contains(&ratio),
        "phase noise {observed} rad, promised {}",
        promised("sigma_phase_rad")
    );

    // Orders: none is wrong where one in a million may be.
    let against =
        ["unwrap", &cell.path("one"), "--method", "reliability", "--anchor", "code", "--json", &json];
    fringetool(&against).expect_success();
    let anchored = &cell.json("plan.json")["views"][0]["against_code"];
    assert!(anchored["compared"].as_u64().unwrap() > 20_000 && anchored["different"] == 0, "{anchored}");

    // Points: the scatter about the plane of the plate.
    let (cloud, fit) = (cell.path("one.ply"), cell.path("fit.json"));
    fringetool(&["reconstruct", "--rig", &rig, "--pair", "pair1", "--out", &cloud, &cell.path("one")])
        .expect_success();
    fringetool(&["fit", "plane", &cloud, REGION, "--json", &fit]).expect_success();
    let scatter_um = cell.json("fit.json")["form_sigma_mm"].as_f64().unwrap() * 1e3;
    let ratio = scatter_um / promised("u_point_um");
    assert!(
        (0.8..1.2).contains(&ratio),
        "points scatter by {scatter_um} µm, promised {}",
        promised("u_point_um")
    );
}

/// A step of 1 mm on the plate, its edges turned by 5° against rows and columns.
const STEP_AT_MM: [f64; 3] = [0.334_565, 0.0, 15.371_572];
const STEP_TURNED_DEG: [f64; 3] = [4.487_112, 41.803_988, 6.714_389];
/// Width of the bins of the distance from an edge, mm.
const BIN_MM: f64 = 0.08;

/// Distances outwards from an edge of the step, and heights of the points near it, mm. `along_base`: one of the two edges along the base of the
/// cameras, else one across it.
fn near_edge(points: &[fringe::cloud::Point], along_base: bool, side: f64) -> Vec<(f64, f64)> {
    let [x, y, z] = STEP_TURNED_DEG.map(f64::to_radians);
    let world_from_step = nalgebra::UnitQuaternion::from_euler_angles(x, y, z);
    let middle = nalgebra::Point3::from(STEP_AT_MM);
    let in_step = points.iter().map(|point| world_from_step.inverse() * (point.position() - middle));
    in_step
        .map(|at| if along_base { (at.x, at.y, at.z) } else { (at.y, at.x, at.z) })
        .map(|(outwards, along, height)| (side * outwards - 20.0, along, height))
        .filter(|(outwards, along, _)| outwards.abs() < 4.0 && along.abs() < 16.0)
        .map(|(outwards, _, height)| (outwards, height))
        .collect()
}

/// Length from 10 to 90 % of the step, mm, from means over bins.
fn edge_mm(points: &[(f64, f64)]) -> f64 {
    let mean = |from: f64, to: f64| {
        let heights = || points.iter().filter(|(outwards, _)| (from..to).contains(outwards)).map(|(_, h)| *h);
        heights().sum::<f64>() / heights().count() as f64
    };
    let (low, high) = (mean(2.5, 4.0), mean(-4.0, -2.5));
    // Means over bins, numbered outwards from the edge.
    let share = |bin: i32| {
        let from = f64::from(bin) * BIN_MM;
        (mean(from, from + BIN_MM) - low) / (high - low)
    };
    // Where the share falls through a level, coming from the inside.
    let crossing = |level: f64| {
        let bin = (-12..12).find(|bin| share(*bin) >= level && share(bin + 1) < level).expect("an edge");
        f64::from(bin) + (share(bin) - level) / (share(bin) - share(bin + 1))
    };
    (crossing(0.1) - crossing(0.9)) * BIN_MM
}

#[test]
fn the_stated_resolution_is_that_of_a_step() {
    let cell = Cell::new();
    let step = format!(
        "[[body]]\nname = \"step\"\nmaterial = \"matte\"\nposition_mm = {STEP_AT_MM:?}\nrotation_deg = {STEP_TURNED_DEG:?}\n\
         geometry = {{ shape = \"box\", size_mm = [40.0, 40.0, 1.0] }}\n"
    );
    std::fs::write(cell.path("scene.toml"), format!("{PLATE}{step}")).unwrap();
    // A single ray a pixel would draw the edges as stairs.
    let fine = DEMO
        .replace("period_px = 16.0, steps = 10", "period_px = 6.0, steps = 24")
        .replace("bits = 7, stripe_px = 8.0", "bits = 8, stripe_px = 3.0");
    cell.record_with(&fine, "step", 3, "subsamples = 3\n");
    let (rig, cloud, json) = (cell.path("rig.toml"), cell.path("step.ply"), cell.path("plan.json"));
    fringetool(&["reconstruct", "--rig", &rig, "--pair", "pair1", "--out", &cloud, &cell.path("step")])
        .expect_success();
    let short = ["--camera-blur-px", "0.577", "--most-period-px", "6"];
    let ran = fringetool(&[&["plan-patterns", "--rig", &rig, "--json", &json][..], &short].concat())
        .expect_success();
    assert!(ran.stdout.contains("lateral resolution"), "{}", ran.stdout);
    let points = files::ply::read_cloud(cloud.as_ref()).unwrap().points;
    for (key, along_base) in [("step_mm", true), ("step_across_mm", false)] {
        let stated = cell.json("plan.json")["lateral_resolution"][key].as_f64().unwrap();
        let edges = [1.0, -1.0].map(|side| edge_mm(&near_edge(&points, along_base, side)));
        let measured = 0.5 * (edges[0] + edges[1]);
        assert!((measured / stated - 1.0).abs() < 0.1, "{key}: edges {edges:?} mm, stated {stated} mm");
    }
}

/// Numbers that cannot be are refused with flag or key, value and limit, on one line.
#[test]
fn a_plan_for_nonsense_is_refused() {
    let cell = Cell::new();
    let rig = cell.path("rig.toml");
    for (argument, word) in [
        ("--projector-gamma=0", "projector_gamma = 0"),
        ("--modulation-dn=-1", "modulation_dn = -1"),
        ("--camera-blur-px=NaN", "--camera-blur-px NaN"),
        ("--blur-px=-1", "--blur-px -1"),
        ("--want-u-um=0", "want_u_um = 0"),
        ("--most-period-px=5", "most_period_px = 5"),
    ] {
        let ran = fringetool(&["plan-patterns", "--rig", &rig, argument]);
        assert_eq!(ran.code, Some(2), "{argument}: {}", ran.stdout);
        assert!(ran.stderr.lines().count() == 1 && ran.stderr.contains(word), "{argument}: {}", ran.stderr);
    }
}
