//! One camera, one projector: unwrapping, filters, reference planes, a rotation stage, through the real binary.

use crate::support::{Ran, fringetool, root};
use std::path::Path;
use tempfile::TempDir;

/// The single-view cell at a quarter of its resolution, still, with a scene of the test's own.
struct Cell {
    folder: TempDir,
}

impl Cell {
    fn new() -> Self {
        let folder = TempDir::new().unwrap();
        let mut rig = files::rig_file::read_rig(&root().join("configs/single-view-rig.toml")).unwrap().rig;
        let camera = &mut rig.cameras[0].camera;
        (camera.width_px, camera.height_px) = (503, 380);
        camera.focal_px = camera.focal_px.map(|f| f / 4.0);
        camera.principal_point_px = camera.principal_point_px.map(|c| c / 4.0);
        files::rig_file::write_rig(&folder.path().join("rig.toml"), &rig, &toml::Table::new(), None).unwrap();
        let cell = std::fs::read_to_string(root().join("configs/single-view.toml")).unwrap();
        let cell = cell
            .replace("single-view-rig.toml", "rig.toml")
            .replace("single-view-plate.scene.toml", "scene.toml")
            .replace("steps = 20", "steps = 8");
        let still = "\n[twin.settings]\nposition_scatter_mm = 0.0\nangle_scatter_deg = 0.0\n";
        std::fs::write(folder.path().join("cell.toml"), cell + still).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// Simulates a body (place, turn, geometry) into `name`.
    fn simulate(&self, name: &str, body: &str, more: &[&str]) {
        let scene = format!(
            "format = \"fringecell-scene/1\"\n[[material]]\nname = \"matte\"\nalbedo = 0.7\n[[body]]\nname = \"body\"\n\
             material = \"matte\"\n{body}\n"
        );
        std::fs::write(self.path("scene.toml"), scene).unwrap();
        let (cell, out) = (self.path("cell.toml"), self.path(name));
        let mut arguments = vec!["simulate", &cell, "--out", &out];
        arguments.extend(more);
        fringetool(&arguments).expect_success();
    }

    fn plane(&self, name: &str, z_mm: f64) {
        let geometry = "geometry = { shape = \"plane\", size_mm = [150.0, 150.0], thickness_mm = 5.0 }";
        self.simulate(name, &format!("position_mm = [0.0, 0.0, {z_mm:?}]\n{geometry}"), &[]);
    }

    fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(self.path(name)).unwrap()).unwrap()
    }
}

/// Recordings `z0`, `z10` … of planes at heights, in a folder.
pub fn planes(folder: &Path, heights_mm: &[f64]) {
    let cell = Cell::new();
    for z_mm in heights_mm {
        let name = format!("z{z_mm}");
        cell.plane(&name, *z_mm);
        let copied =
            std::process::Command::new("cp").arg("-r").arg(cell.path(&name)).arg(folder.join(&name)).status();
        assert!(copied.unwrap().success());
    }
}

fn refused(ran: &Ran, words: &[&str]) {
    assert_eq!(ran.code, Some(2), "{}{}", ran.stdout, ran.stderr);
    assert_eq!(ran.stderr.lines().count(), 1, "{}", ran.stderr);
    for word in words {
        assert!(ran.stderr.contains(word), "{word} is missing in: {}", ran.stderr);
    }
}

/// A plate before the camera: all methods find the orders that the code tells.
#[test]
fn neighbours_and_code_tell_the_same_orders() {
    let cell = Cell::new();
    cell.plane("rec", 10.0);
    let (rec, out, json) = (cell.path("rec"), cell.path("out"), cell.path("u.json"));
    for method in ["itoh", "goldstein", "quality", "reliability", "least-squares", "weighted-least-squares"] {
        let arguments =
            ["unwrap", &rec, "--method", method, "--anchor", "code", "--out", &out, "--json", &json];
        fringetool(&arguments).expect_success();
        let view = &cell.json("u.json")["views"][0];
        let against = &view["against_code"];
        assert!(against["compared"].as_u64().unwrap() > 5000, "{method}: {view}");
        assert_eq!(against["different"], 0, "{method}: {view}");
        assert_eq!(view["components"], view["absolute_components"], "{method}");
    }
    // What was written goes in again; its anchor may be a file as well.
    let (wrapped, unwrapped) =
        (cell.path("out/proj1-cam1-x-wrapped.npy"), cell.path("out/proj1-cam1-x-unwrapped.npy"));
    let again = ["unwrap", &wrapped, "--anchor", &unwrapped, "--json", &json];
    fringetool(&again).expect_success();
    assert_eq!(
        cell.json("u.json")["views"][0]["absolute_components"],
        cell.json("u.json")["views"][0]["components"]
    );

    // In degrees it lies beyond one turn of radians: refused until the unit is told, and then the same as in radians.
    let turns = npy(8, 8, |x, _| ((40 * x) % 360) as f32);
    std::fs::write(cell.path("degrees.npy"), turns).unwrap();
    let degrees = cell.path("degrees.npy");
    refused(&fringetool(&["unwrap", &degrees]), &["degrees.npy", "from 0 to 280", "--phase-unit"]);
    // Whole turns lie within radians, and jump by one.
    let parts = npy(41, 8, |x, _| ((x as f32) / 40.0 * 3.0) % 1.0);
    std::fs::write(cell.path("turns.npy"), parts).unwrap();
    refused(&fringetool(&["unwrap", &cell.path("turns.npy")]), &["turns.npy", "as whole turns do", "turn"]);
    refused(&fringetool(&["unwrap", &rec, "--phase-unit", "deg"]), &["--phase-unit", "recording"]);
    fringetool(&["unwrap", &degrees, "--phase-unit", "deg", "--json", &json]).expect_success();
    assert_eq!(cell.json("u.json")["views"][0]["discontinuities"], 0);

    refused(&fringetool(&["unwrap", &rec, "--method", "itoh", "--smooth"]), &["--smooth", "itoh"]);
    refused(&fringetool(&["unwrap", &wrapped, "--anchor", "code"]), &["--anchor code", "no code"]);
    std::fs::write(cell.path("nothing.npy"), npy(8, 8, |_, _| f32::NAN)).unwrap();
    std::fs::write(cell.path("some.npy"), npy(8, 8, |x, _| 0.1 * x as f32)).unwrap();
    let (nothing, some) = (cell.path("nothing.npy"), cell.path("some.npy"));
    refused(&fringetool(&["unwrap", &nothing]), &["nothing.npy: has no valid pixel", "right file?"]);
    refused(&fringetool(&["unwrap", &some, "--anchor", &nothing]), &["--anchor", "no finite value", "some"]);
    refused(
        &fringetool(&["unwrap", &wrapped, "--method", "quality", "--quality", "modulation"]),
        &["modulation"],
    );
    refused(&fringetool(&["unwrap", &rec, "--tolerance", "0", "--method", "least-squares"]), &["tolerance"]);
    std::fs::write(cell.path("bad.npy"), b"\x93NUMPY\x01\x00").unwrap();
    refused(&fringetool(&["unwrap", &cell.path("bad.npy")]), &["bad.npy", "NumPy"]);
}

#[test]
fn filters_are_named_counted_and_checked() {
    let cell = Cell::new();
    cell.plane("rec", 0.0);
    let (rec, rig, ply, json) =
        (cell.path("rec"), cell.path("rig.toml"), cell.path("a.ply"), cell.path("r.json"));
    let common =
        ["reconstruct", "--rig", &rig, "--method", "projector", "--out", &ply, "--json", &json, &rec];
    let sigma = |filters: &[&str]| {
        let arguments: Vec<&str> = common.iter().chain(filters).copied().collect();
        fringetool(&arguments).expect_success();
        let fit = cell.path("fit.json");
        let region = "--box=-40,-40,-20,40,40,20";
        fringetool(&["fit", "plane", &ply, region, "--json", &fit]).expect_success();
        cell.json("fit.json")["form_sigma_mm"].as_f64().unwrap()
    };
    let (plain, smooth) = (sigma(&[]), sigma(&["--filter", "spikes", "--filter", "gaussian:1"]));
    assert!(smooth < 0.6 * plain, "{smooth} and {plain} mm");
    assert_eq!(cell.json("r.json")["filters"][1]["filter"], "gaussian:1");
    for bad in ["sharpen", "gaussian:0", "median:1.5", "spikes:x"] {
        let ran = fringetool(&["decode", &rec, "--filter", bad]);
        assert_eq!(ran.code, Some(2), "{bad}: {}", ran.stderr);
    }
}

/// The numbers are those of `fit plane`; the report has a map and a histogram of every repeat.
#[test]
fn flatness_of_repeats_with_maps_and_histograms() {
    let cell = Cell::new();
    let geometry = "geometry = { shape = \"plane\", size_mm = [130.0, 110.0], thickness_mm = 5.0 }";
    let upright = format!("position_mm = [0.0, 0.0, 20.0]\nrotation_deg = [65.0, 0.0, 0.0]\n{geometry}");
    let (rig, region) = (cell.path("rig.toml"), "--near=0,0,20,40");
    let clouds = [("one", "21"), ("two", "22")].map(|(name, seed)| {
        let ply = cell.path(&format!("{name}.ply"));
        cell.simulate(name, &upright, &["--seed", seed]);
        let recording = cell.path(name);
        fringetool(&["reconstruct", "--rig", &rig, "--method", "projector", "--out", &ply, &recording])
            .expect_success();
        ply
    });
    let (report, json, fit) = (cell.path("flat.html"), cell.path("flat.json"), cell.path("fit.json"));
    let [one, two] = &clouds;
    fringetool(&["flatness", region, "--filter", "4", "--report", &report, "--json", &json, one, two])
        .expect_success();
    let found = cell.json("flat.json");
    for (number, cloud) in clouds.iter().enumerate() {
        fringetool(&["fit", "plane", cloud, region, "--json", &fit]).expect_success();
        let (plane, repeat) = (cell.json("fit.json"), &found["repeats"][number]);
        for key in ["points", "form_sigma_mm", "form_range_mm", "form_d95_mm"] {
            assert_eq!(plane[key], repeat[key], "{key} of repeat {number}");
        }
        let number = |key: &str| repeat[key].as_f64().unwrap();
        let ratio = number("form_sigma_mm") / number("sigma_stated_median_mm");
        assert!((0.8..1.3).contains(&ratio), "scatter over what is stated: {ratio}");
        assert!(number("flatness_filtered_mm") < 0.5 * number("form_range_mm"));
    }
    let html = std::fs::read_to_string(&report).unwrap();
    for (what, count) in
        [("aria-label=\"deviation map\"", 2), ("aria-label=\"histogram of deviations\"", 2), ("x, mm", 2)]
    {
        assert_eq!(html.matches(what).count(), count, "{what}");
    }
    assert!(html.contains("z, mm") && html.contains("Deviation, µm"));
    refused(&fringetool(&["flatness", "--near=500,0,0,1", one]), &["one.ply", "--near", "no point"]);
    refused(&fringetool(&["flatness", region, "--filter", "60", one]), &["one.ply", "--filter"]);
}

#[test]
fn heights_over_a_reference_plane() {
    let cell = Cell::new();
    let mut arguments =
        vec!["reference-plane".to_owned(), "calibrate".into(), "--out".into(), cell.path("cal")];
    for z in [0, 8, 16, 24] {
        let name = format!("z{z}");
        cell.plane(&name, f64::from(z));
        arguments.extend(["--plane".into(), format!("{z}={}", cell.path(&name))]);
    }
    arguments.extend(["--json".into(), cell.path("cal.json")]);
    fringetool(&arguments).expect_success();
    assert!(cell.json("cal.json")["calibrated"].as_u64().unwrap() > 20_000);
    cell.plane("object", 11.0);
    let (object, cal, npy, rig) =
        (cell.path("object"), cell.path("cal"), cell.path("h.npy"), cell.path("rig.toml"));
    let (cloud, picture) = (cell.path("h.ply"), cell.path("h.png"));
    let measure = ["reference-plane", "measure", &object, "--calibration", &cal, "--out", &npy];
    let more = ["--picture", &picture, "--rig", &rig, "--cloud", &cloud];
    fringetool(&[&measure[..], &more[..]].concat()).expect_success();
    let heights = files::npy::read(Path::new(&npy)).unwrap().values;
    let known = heights.iter().filter(|z| z.is_finite()).count();
    assert!(known > 20_000, "{known} heights");
    // Away from the plates' rims, where the camera sees their sides.
    let (fit, region) = (cell.path("fit.json"), "--box=-50,-50,0,50,50,20");
    fringetool(&["fit", "plane", &cloud, region, "--json", &fit]).expect_success();
    assert!((cell.json("fit.json")["offset_mm"].as_f64().unwrap() - 11.0).abs() < 0.02);

    assert_eq!(cell.json("cal.json")["rejected"].as_array().map(Vec::len), Some(4));
    let one = format!("0={}", cell.path("z0"));
    let bad = ["reference-plane", "calibrate", "--out", &cal, "--plane", &one, "--plane", &one];
    refused(&fringetool(&bad), &["3 coefficients"]);
    let bad =
        ["reference-plane", "calibrate", "--out", &cal, "--plane", &one, "--plane", &one, "--degree", "1"];
    refused(&fringetool(&bad), &["height 0", "twice"]);
    let second = format!("8={}", cell.path("z8"));
    let planes = ["--plane", &one, "--plane", &second, "--degree", "1", "--reject", "0"];
    let bad = [&["reference-plane", "calibrate", "--out", &cal][..], &planes[..]].concat();
    refused(&fringetool(&bad), &["rejection beyond 0", "above 0"]);
    refused(
        &fringetool(&["reference-plane", "measure", &object, "--calibration", &object]),
        &["reference-plane.toml"],
    );
}

#[test]
fn a_ball_tells_the_axis_and_views_come_together() {
    let cell = Cell::new();
    let ball = "position_mm = [22.0, 4.0, 25.0]\ngeometry = { shape = \"sphere\", diameter_mm = 30.0 }";
    let (rig, axis) = (cell.path("rig.toml"), "3,-2,0,0.05,0,1");
    let mut views = Vec::new();
    for angle in ["0", "50", "110", "200"] {
        let (name, ply) = (format!("at{angle}"), cell.path(&format!("at{angle}.ply")));
        cell.simulate(&name, ball, &["--stage-axis", axis, "--stage-deg", angle]);
        let rec = cell.path(&name);
        fringetool(&["reconstruct", "--rig", &rig, "--method", "projector", "--out", &ply, &rec])
            .expect_success();
        views.extend(["--view".to_owned(), format!("{angle}={ply}")]);
    }
    let stage = cell.path("stage.toml");
    let run = |what: &[&str], views: &[String]| {
        let arguments: Vec<String> = std::iter::once("rotation-stage")
            .chain(what.iter().copied())
            .map(str::to_owned)
            .chain(views.iter().cloned())
            .collect();
        fringetool(&arguments)
    };
    run(&["calibrate", "--out", &stage, "--diameter", "30"], &views).expect_success();
    let found = files::stage_file::read_stage(Path::new(&stage)).unwrap();
    let truth = nalgebra::Vector3::new(0.05, 0.0, 1.0).normalize();
    let off = (found.point_mm - nalgebra::Point3::new(3.0, -2.0, 0.0)).cross(&truth).norm();
    assert!(off < 0.03, "the axis passes by {off} mm");
    assert!(found.direction.cross(&truth).norm() < 2e-3, "{:?}", found.direction);

    let merged = cell.path("merged.ply");
    let ran = run(&["merge", "--stage", &stage, "--out", &merged], &views).expect_success();
    assert!(ran.stdout.contains("by the axis alone"), "a ball turns in itself: {}", ran.stdout);
    let fit = cell.path("fit.json");
    fringetool(&["fit", "sphere", &merged, "--within", "0.3", "--json", &fit]).expect_success();
    assert!((cell.json("fit.json")["diameter_mm"].as_f64().unwrap() - 30.0).abs() < 0.03);

    let same: Vec<String> = (0..3).flat_map(|_| views[..2].to_vec()).collect();
    refused(&run(&["calibrate", "--out", &cell.path("no.toml")], &same), &["do not determine the axis"]);
    assert!(!Path::new(&cell.path("no.toml")).exists());
    let two = &views[..4];
    refused(&run(&["calibrate", "--out", &cell.path("no.toml")], two), &["2 views"]);
    let bad = ["rotation-stage", "merge", "--stage", &stage, "--view", "x=y", "--out", &merged];
    assert_eq!(fringetool(&bad).code, Some(2));
}

/// A raster of single precision in NumPy's format, version 1.
fn npy(width: u32, height: u32, value: impl Fn(u32, u32) -> f32) -> Vec<u8> {
    let head = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    let length = (head.len() + 11).div_ceil(64) * 64 - 10;
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((length as u16).to_le_bytes());
    bytes.extend(format!("{head:<0$}\n", length - 1).into_bytes());
    for y in 0..height {
        bytes.extend((0..width).flat_map(|x| value(x, y).to_le_bytes()));
    }
    bytes
}
