//! `compare`: deviations that are known beforehand; inputs that neither it nor `register` can mean.

use crate::support::{Ran, fringetool};
use std::fmt::Write as _;
use std::path::Path;
use tempfile::TempDir;

/// A wavy face of 20 mm × 16 mm without any symmetry, as points on a lattice.
pub fn face(step_mm: f64, place: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<[f64; 3]> {
    let count = |length: f64| (length / step_mm) as usize;
    let at = |i: usize, j: usize| {
        // Not quite a lattice: no two points are alike.
        let (x, y) =
            (step_mm * (i as f64 + 0.3 * (j % 7) as f64), step_mm * (j as f64 + 0.1 * (i % 5) as f64));
        [x, y, 1.5 * (0.3 * x + 0.2).sin() * (0.35 * y).cos() + 0.01 * x * y]
    };
    (0..count(16.0))
        .flat_map(|j| (0..count(20.0)).map(move |i| (i, j)))
        .map(|(i, j)| place(at(i, j)))
        .collect()
}

pub fn lifted(mm: f64) -> impl Fn([f64; 3]) -> [f64; 3] {
    move |[x, y, z]| [x, y, z + mm]
}

pub fn ply(points: &[[f64; 3]]) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", points.len());
    text.push_str("property double x\nproperty double y\nproperty double z\nend_header\n");
    for [x, y, z] in points {
        let _ = writeln!(text, "{x} {y} {z}");
    }
    text
}

/// The same as bytes, which may hold NaN.
fn binary_ply(points: &[[f64; 3]]) -> Vec<u8> {
    let text = ply(points).replace("ascii", "binary_little_endian");
    let header = text.find("end_header\n").unwrap() + "end_header\n".len();
    let values = points.iter().flatten().flat_map(|v| v.to_le_bytes());
    text.bytes().take(header).chain(values).collect()
}

/// A plate of 30 mm × 30 mm at z = 0, as text.
pub fn stl() -> String {
    let mut text = "solid plate\n".to_owned();
    for corners in [[[-5, -5], [25, -5], [25, 25]], [[-5, -5], [25, 25], [-5, 25]]] {
        text.push_str("facet normal 0 0 1\nouter loop\n");
        for [x, y] in corners {
            let _ = writeln!(text, "vertex {x} {y} 0");
        }
        text.push_str("endloop\nendfacet\n");
    }
    text + "endsolid plate\n"
}

pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(TempDir::new().unwrap())
    }

    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    pub fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_str(&std::fs::read_to_string(self.path(name)).unwrap()).unwrap()
    }
}

#[test]
fn a_cloud_is_compared_with_a_cloud_and_a_plate() {
    let folder = Folder::new();
    let flat = |z: f64| face(0.25, move |[x, y, _]| [x, y, z]);
    let cloud = folder.write("cloud.ply", ply(&flat(0.05)));
    let reference = folder.write("reference.ply", ply(&flat(0.0)));
    let plate = folder.write("plate.stl", stl());
    for reference in [&reference, &plate] {
        let (json, out, report) = (folder.path("a.json"), folder.path("out.ply"), folder.path("a.html"));
        let arguments = ["compare", &cloud, reference, "--json", &json, "--out", &out, "--report", &report];
        fringetool(&arguments).expect_success();
        let result = folder.json("a.json");
        let number = |key: &str| result[key].as_f64().unwrap();
        assert_eq!(result["count"], 64 * 80);
        for key in ["mean_mm", "median_mm", "min_mm", "max_mm", "rms_mm"] {
            assert!((number(key) - 0.05).abs() < 1e-9, "{key}: {}", number(key));
        }
        assert!(number("sd_mm") < 1e-9);
        let bars = result["histogram"]["counts"].as_array().unwrap().iter().map(|c| c.as_u64().unwrap());
        let beyond =
            result["histogram"]["below"].as_u64().unwrap() + result["histogram"]["above"].as_u64().unwrap();
        assert_eq!(bars.sum::<u64>() + beyond, 64 * 80);
        let coloured = std::fs::read(&out).unwrap();
        let header = String::from_utf8_lossy(&coloured[..1000]);
        assert!(
            header.contains("property float deviation") && header.contains("property uchar red"),
            "{header}"
        );
        let html = std::fs::read_to_string(&report).unwrap();
        assert!(
            html.contains("Histogram")
                && html.contains("data:image/png")
                && html.trim_end().ends_with("</html>")
        );
    }
}

/// Distances from the nearest point have no sign, and no tolerance band.
#[test]
fn distances_from_the_nearest_point_have_no_sign() {
    let folder = Folder::new();
    let flat = |z: f64| ply(&face(0.25, move |[x, y, _]| [x, y, z]));
    let (cloud, reference) =
        (folder.write("cloud.ply", flat(-0.05)), folder.write("reference.ply", flat(0.0)));
    let (json, report, plate) =
        (folder.path("a.json"), folder.path("a.html"), folder.write("plate.stl", stl()));
    for reference in [&reference, &plate] {
        let nearest = ["compare", &cloud, reference, "--method", "nearest", "--json", &json];
        fringetool(&[&nearest[..], &["--report", &report]].concat()).expect_success();
        let result = folder.json("a.json");
        assert_eq!((result["method"].as_str(), result["count"].as_u64()), (Some("nearest"), Some(64 * 80)));
        for key in ["min_mm", "mean_mm", "max_mm"] {
            assert!((result[key].as_f64().unwrap() - 0.05).abs() < 1e-9, "{key}: {}", result[key]);
        }
        assert!(std::fs::read_to_string(&report).unwrap().contains("without a sign"));
        assert_eq!(fringetool(&[&nearest[..], &["--tolerance", "0.1"]].concat()).code, Some(2));
    }
}

#[test]
fn what_is_too_far_is_counted() {
    let folder = Folder::new();
    let mut points = face(0.25, |[x, y, _]| [x, y, 0.01]);
    points.push([5.0, 5.0, 3.0]);
    let (cloud, plate) = (folder.write("cloud.ply", ply(&points)), folder.write("plate.stl", stl()));
    let json = folder.path("a.json");
    fringetool(&["compare", &cloud, &plate, "--max-distance", "1", "--json", &json]).expect_success();
    let result = folder.json("a.json");
    assert_eq!((result["count"].as_u64(), result["cut_too_far"].as_u64()), (Some(64 * 80), Some(1)));
    assert!(result["max_mm"].as_f64().unwrap() < 0.02);
}

/// A tolerance is a verdict: a point that is cut as too far lies outside, it does not vanish.
#[test]
fn a_tolerance_counts_what_is_cut_and_gives_the_exit_code() {
    let folder = Folder::new();
    let mut points = face(0.25, |[x, y, _]| [x, y, 0.01]);
    let (flat, plate) = (folder.write("flat.ply", ply(&points)), folder.write("plate.stl", stl()));
    points.push([5.0, 5.0, 3.0]);
    let cloud = folder.write("cloud.ply", ply(&points));
    let (json, report) = (folder.path("a.json"), folder.path("a.html"));
    let judged = |cloud: &str, more: &[&str]| {
        let words =
            [&["compare", cloud, &plate, "--max-distance", "1", "--json", &json, "--report", &report], more]
                .concat();
        let ran = fringetool(&words);
        (ran.code, ran.stdout)
    };
    assert_eq!(judged(&flat, &["--tolerance", "0.02"]).0, Some(0));
    assert_eq!(judged(&flat, &["--tolerance=-0.02,0.005"]).0, Some(1));
    // Without uncertainties there is no guard band, and no decision by the standard.
    let bare = fringetool(&["compare", &flat, &plate, "--tolerance", "0.02"]).expect_success();
    assert!(bare.stdout.contains("simple acceptance, not by ISO 14253-1"), "{}", bare.stdout);
    assert!(bare.stderr.contains("warning: ") && bare.stderr.contains("no guard band"), "{}", bare.stderr);
    let (code, stdout) = judged(&cloud, &["--tolerance", "0.02"]);
    assert!(code == Some(1) && stdout.contains("FAIL"), "{stdout}");
    let found = &folder.json("a.json")["conformity"];
    assert_eq!((found["verdict"].as_str(), found["too_far"].as_u64()), (Some("fail"), Some(1)));
    assert!(std::fs::read_to_string(&report).unwrap().contains("Proven outside"));
    assert_eq!(judged(&cloud, &["--tolerance", "0.02", "--allow-outside", "0.1"]).0, Some(0));
    for wrong in [
        &["--tolerance", "0.1,-0.1"][..],
        &["--tolerance", "nan"],
        &["--allow-outside", "5"],
        &["--tolerance", "1", "--allow-outside", "100"],
    ] {
        assert_eq!(judged(&flat, wrong).0, Some(2), "{wrong:?}");
    }
}

#[test]
fn m3c2_and_best_fit_find_what_was_done() {
    let folder = Folder::new();
    let reference = folder.write("reference.ply", ply(&face(0.2, lifted(0.0))));
    let cloud = folder.write("cloud.ply", ply(&face(0.2, lifted(0.1))));
    let json = folder.path("a.json");
    fringetool(&[
        "compare",
        &cloud,
        &reference,
        "--method",
        "m3c2",
        "--normal-scales",
        "1.5,3",
        "--json",
        &json,
    ])
    .expect_success();
    let result = folder.json("a.json");
    // Lifted along z, compared along normals that lean by up to 24°.
    assert!((0.09..0.1001).contains(&result["mean_mm"].as_f64().unwrap()), "{}", result["mean_mm"]);
    assert!(result["m3c2"]["lod95_median_mm"].as_f64().unwrap() > 0.0);
    fringetool(&["compare", &cloud, &reference, "--align", "best-fit", "--json", &json]).expect_success();
    let result = folder.json("a.json");
    assert!(result["rms_mm"].as_f64().unwrap() < 1e-3, "{}", result["rms_mm"]);
    assert!((result["best_fit"]["translation_mm"][2].as_f64().unwrap() + 0.1).abs() < 2e-3);
}

#[test]
fn datums_bring_a_scan_into_the_frame_of_the_part() {
    let small = crate::support::Small::new();
    small.reconstruct(&[]).expect_success();
    let (cloud, part, json) = (small.path("cloud.ply"), small.path("part.ply"), small.path("a.json"));
    // The small cameras see a forty-fifth of the points that the plan counts on, and of those the rims are left out.
    let plan =
        std::fs::read_to_string(crate::support::root().join("configs/complex-artefact.plan.toml")).unwrap();
    let plan_path = small.path("plan.toml");
    let counts = [("= 5000\n", "= 50\n"), ("= 2000\n", "= 20\n"), ("= 500\n", "= 25\n")];
    let plan = counts.iter().fold(plan, |plan, (whole, small)| plan.replace(whole, small));
    std::fs::write(&plan_path, plan).unwrap();
    let align = ["--align", "rps", "--plan", &plan_path];
    let mut first = vec!["compare", &cloud, &cloud, "--out", &part];
    first.extend(align);
    fringetool(&first).expect_success();
    // In the part's frame the spheres stand where the scene states, to within a fifth of the 1.4 mm between points; where
    // the twin had put the part they were up to two millimetres away.
    for (near, x, diameter) in
        [("-39.756,-39.756,32,10", -39.756, "22.462"), ("39.756,39.756,32,10", 39.756, "22.367")]
    {
        // With its known diameter: a few points of the cap cannot tell height and diameter apart.
        fringetool(&[
            "fit",
            "sphere",
            &part,
            "--near",
            near,
            "--diameter",
            diameter,
            "--reject",
            "0.03",
            "--json",
            &json,
        ])
        .expect_success();
        let text = std::fs::read_to_string(&json).unwrap();
        let fit: serde_json::Value = serde_json::from_str(&text).unwrap();
        for (axis, expected) in [x, x, 28.0].into_iter().enumerate() {
            let found = fit["center_mm"][axis].as_f64().unwrap();
            assert!((found - expected).abs() < 0.28, "axis {axis}: {found}, {expected}");
        }
    }
}

#[test]
fn what_cannot_be_meant_is_told_and_leaves_nothing() {
    let folder = Folder::new();
    let good = ply(&face(0.5, lifted(0.0)));
    let points = face(0.5, lifted(0.0));
    let scaled = |by: f64| ply(&points.iter().map(|p| p.map(|v| v * by)).collect::<Vec<_>>());
    let with_nan: Vec<[f64; 3]> = [[f64::NAN, 0.0, 0.0]].into_iter().chain(points.iter().copied()).collect();
    let cut = binary_ply(&points)[..500].to_vec();
    let degenerate = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 1 1 1\nvertex 1 1 1\nvertex 2 2 2\nendloop\nendfacet\n\
        endsolid a\n";
    let far: Vec<[f64; 3]> = points.iter().map(|[x, y, z]| [x + 500.0, *y, *z]).collect();
    let reference = folder.write("reference.ply", &good);
    let cases: [(&str, Vec<u8>, &[&str]); 12] = [
        ("empty.ply", ply(&[]).into(), &["empty.ply", "no point"]),
        ("one.ply", ply(&points[..1]).into(), &["one.ply", "1 point, ", "2"]),
        ("nan.ply", binary_ply(&with_nan), &[]),
        ("all_nan.ply", binary_ply(&[[f64::NAN; 3]; 9]), &["all_nan.ply", "no point"]),
        ("metres.ply", scaled(1e-3).into(), &["metres.ply", "metres", "1000"]),
        ("far.ply", ply(&far).into(), &["far.ply", "overlap", "best-fit"]),
        ("giant.ply", scaled(1e200).into(), &["giant.ply", "coordinate"]),
        ("truncated.ply", cut, &["truncated.ply", "truncated"]),
        ("text.ply", b"hello".to_vec(), &["text.ply", "PLY", "STL", "E57"]),
        ("broken.e57", b"ASTM-E57".to_vec(), &["broken.e57", "E57"]),
        ("mesh.stl", stl().into(), &["mesh.stl", "mesh", "PLY"]),
        ("folder", Vec::new(), &["folder"]),
    ];
    for (name, bytes, words) in cases {
        let cloud = if name == "folder" { folder.path(".") } else { folder.write(name, bytes) };
        let outs = ["out.ply", "a.json", "a.html"].map(|n| folder.path(n));
        let ran = fringetool(&[
            "compare", &cloud, &reference, "--out", &outs[0], "--json", &outs[1], "--report", &outs[2],
        ]);
        if words.is_empty() {
            assert_eq!(ran.code, Some(0), "{}", ran.stderr);
            assert!(ran.stderr.contains("without finite coordinates"), "{}", ran.stderr);
            for out in &outs {
                std::fs::remove_file(out).unwrap();
            }
            continue;
        }
        refused(name, &ran, if name == "folder" { &[] } else { words });
        assert!(outs.iter().all(|out| !Path::new(out).exists()), "{name} left something");
    }
    for (name, bytes, words) in [
        ("one.ply", ply(&points[..1]), ["one.ply", "1 point, "]),
        ("same.ply", ply(&[[1.0; 3]; 60]), ["same.ply", "coincide"]),
        ("flat.stl", degenerate.to_owned(), ["flat.stl", "area"]),
        ("cut.stl", stl()[..150].to_owned(), ["cut.stl", "STL"]),
    ] {
        let other = folder.write(name, bytes);
        let out = folder.path("out.ply");
        refused(name, &fringetool(&["compare", &reference, &other, "--out", &out]), &words);
        refused(name, &fringetool(&["register", &reference, "--to", &other, "--out", &out]), &words);
        assert!(!Path::new(&out).exists(), "{name} left something");
    }
    refusals_of_arguments(&folder, &reference);
}

fn refusals_of_arguments(folder: &Folder, reference: &str) {
    let mirror = folder.write("mirror.txt", "-1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    let nan = folder.write("nan.txt", "1 nan 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    let short = folder.write("short.json", "{ \"matrix\": [[1, 0, 0, 0]] }");
    let cloud = folder.write("cloud.ply", ply(&face(0.5, lifted(0.1))));
    let out = folder.path("out.ply");
    for (arguments, words) in [
        (vec!["--start", &mirror], vec!["mirror.txt", "is a reflection"]),
        (vec!["--start", &short], vec!["short.json", "16"]),
        (vec!["--start", &nan], vec!["nan.txt: matrix: entry NaN in row 1, column 2 is not finite"]),
        (vec!["--start", "nowhere.json"], vec!["nowhere.json"]),
        (vec!["--overlap", "7"], vec!["--overlap", "7"]),
    ] {
        let mut all = vec!["register", &cloud, "--to", reference, "--out", &out];
        all.extend(arguments);
        refused("register", &fringetool(&all), &words);
    }
    for (arguments, words) in [
        (vec!["--align", "rps"], vec!["--plan"]),
        (vec!["--max-distance=-1"], vec!["--max-distance", "above 0"]),
        (vec!["--towards", "0,0,0"], vec!["--towards"]),
        (vec!["--out", &cloud], vec!["--out", "overwrite"]),
    ] {
        let mut all = vec!["compare", &cloud, reference];
        all.extend(arguments);
        let ran = fringetool(&all);
        assert_eq!(ran.code, Some(2), "{}", ran.stderr);
        assert!(words.iter().all(|word| ran.stderr.contains(word)), "{words:?}: {}", ran.stderr);
    }
}

/// One point far outside would make the cubes of a grid larger than asked for.
#[test]
fn a_grid_too_fine_for_the_cloud_is_refused() {
    let folder = Folder::new();
    let mut points = face(0.5, lifted(0.0));
    points.push([3e6, 0.0, 0.0]);
    let far = folder.write("far.ply", ply(&points));
    points.push([3e7, 0.0, 0.0]);
    let beyond = folder.write("beyond.ply", ply(&points));
    let out = folder.path("out.ply");
    for (cloud, edge, words) in [
        (&far, "1", ["--decimate 1: ", "far.ply extends over 30", "the smallest edge for it is 1.44"]),
        (&beyond, "100", ["beyond.ply: point", "not within", "±1e7"]),
    ] {
        let ran = fringetool(&["convert", cloud, "--decimate", edge, "--out", &out]);
        refused("convert", &ran, &words);
    }
    fringetool(&["convert", &far, "--decimate", "1.45", "--out", &out]).expect_success();
}

/// Exit code 2 and one line that holds the words.
fn refused(name: &str, ran: &Ran, words: &[&str]) {
    assert_eq!(ran.code, Some(2), "{name}: {}{}", ran.stdout, ran.stderr);
    let messages: Vec<&str> = ran.stderr.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(messages.len(), 1, "{name}: {}", ran.stderr);
    assert!(words.iter().all(|word| ran.stderr.contains(word)), "{name}: {words:?}: {}", ran.stderr);
    assert!(!ran.stderr.contains("panicked"), "{name}: {}", ran.stderr);
}
