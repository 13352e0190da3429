//! CAD in STEP through the programs: reference of a comparison, source of a plan, faces by number, faults.

use crate::support::{fringetool, root};
use files::step_file::read_part;
use serde_json::Value;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn sample(name: &str) -> PathBuf {
    root().join("tests/step").join(name)
}

fn text(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

/// Points on the whole surface of the plate, moved out by some micrometres, with normals.
fn cloud(path: &Path, out_mm: f64) {
    let part = read_part(&sample("plate.step"), Some(0.002)).unwrap();
    let mut lines = String::new();
    let mut count = 0;
    for [a, b, c] in part.all_triangles() {
        let normal = (b - a).cross(&(c - a));
        let area = 0.5 * normal.norm();
        if area < 1e-9 {
            continue;
        }
        let normal = normal / normal.norm();
        // Four points a square millimetre, at places that fill a triangle evenly.
        let points = (4.0 * area).ceil().max(1.0) as u32;
        for k in 0..points {
            let (u, v) = ((f64::from(k) + 0.5) / f64::from(points), (f64::from(k) * 0.618_034 + 0.25) % 1.0);
            let s = u.sqrt();
            let p = a.coords * (1.0 - s) + b.coords * (s * (1.0 - v)) + c.coords * (s * v) + normal * out_mm;
            let _ = writeln!(lines, "{} {} {} {} {} {}", p.x, p.y, p.z, normal.x, normal.y, normal.z);
            count += 1;
        }
    }
    let head = format!(
        "ply\nformat ascii 1.0\nelement vertex {count}\nproperty double x\nproperty double y\nproperty double z\n\
         property float nx\nproperty float ny\nproperty float nz\nend_header\n"
    );
    std::fs::write(path, head + &lines).unwrap();
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A cloud 0.02 mm outside of all faces: bosses are larger, bores smaller, and the plan of the CAD finds each of them.
#[test]
fn a_plan_from_cad_measures_what_the_cloud_has() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    cloud(&at("cloud.ply"), 0.02);
    let (plan, picture, drafted) = (at("plan.toml"), at("plan.png"), at("plan.json"));
    let part = text(&sample("plate.step"));
    let arguments = [
        "plan-from-cad",
        &part,
        "--out",
        &text(&plan),
        "--picture",
        &text(&picture),
        "--json",
        &text(&drafted),
    ];
    let ran = fringetool(&arguments).expect_success();
    assert!(ran.stdout.contains("1 solid") && ran.stdout.contains("fillet"), "{}", ran.stdout);
    let drafted = json(&drafted);
    let kept = drafted["elements"].as_array().unwrap().iter().filter(|e| e["left_out"].is_null()).count();
    assert!(kept >= 12, "{drafted}");
    let measured = at("measured.json");
    fringetool(&["measure", &text(&plan), &text(&at("cloud.ply")), "--json", &text(&measured)])
        .expect_success();
    let measured = json(&measured);
    let mut sizes = 0;
    for feature in measured["features"].as_array().unwrap() {
        let (name, value) = (feature["name"].as_str().unwrap(), feature["value"].as_f64().unwrap());
        if name.ends_with("diameter") {
            // Bores of 12 mm and 8 mm lose twice the shift.
            assert!([11.96, 7.96].iter().any(|d| (value - d).abs() < 0.004), "{name}: {value}");
            sizes += 1;
        }
    }
    assert_eq!(sizes, 3, "{measured}");
}

/// What the cell cannot see stays out by its name, with all features on it; a name that is none is refused with those that are.
#[test]
fn elements_stay_out_by_name() {
    let folder = TempDir::new().unwrap();
    let (plan, part) = (folder.path().join("plan.toml"), text(&sample("plate.step")));
    let draft =
        |names: &str| fringetool(&["plan-from-cad", &part, "--without", names, "--out", &text(&plan)]);
    let refused = draft("plane1,bottom");
    assert_eq!(refused.code, Some(2));
    assert!(
        refused.stderr.contains("--without bottom") && refused.stderr.contains("plane3"),
        "{}",
        refused.stderr
    );
    assert!(!plan.exists());
    draft("plane1,plane3").expect_success();
    let written = std::fs::read_to_string(&plan).unwrap();
    assert!(
        !written.contains("\"plane1\"") && !written.contains("\"plane3\"") && written.contains("\"plane2\"")
    );
}

#[test]
fn a_comparison_with_step_states_the_distance_of_its_triangles() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| text(&folder.path().join(name));
    cloud(&folder.path().join("cloud.ply"), 0.02);
    let (part, cloud) = (text(&sample("plate.step")), at("cloud.ply"));
    let ran = fringetool(&["compare", &cloud, &part, "--chord-mm", "0.002", "--json", &at("compared.json")]);
    let ran = ran.expect_success();
    assert!(ran.stderr.contains("within 0.002 mm of the surfaces"), "{}", ran.stderr);
    let compared = json(&folder.path().join("compared.json"));
    let mean = compared["mean_mm"].as_f64().unwrap_or_else(|| panic!("{compared}"));
    assert!((mean - 0.02).abs() < 0.002, "{mean}");
    let refused = fringetool(&["compare", &cloud, &cloud, "--chord-mm", "0.002"]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("is no STEP file"), "{}", refused.stderr);
}

/// An element of a plan may be a face of the file itself.
#[test]
fn a_face_of_the_file_is_an_element_by_its_number() {
    let folder = TempDir::new().unwrap();
    cloud(&folder.path().join("cloud.ply"), 0.0);
    std::fs::copy(sample("plate.step"), folder.path().join("part.step")).unwrap();
    let part = read_part(&sample("plate.step"), None).unwrap();
    let bore = part.features().into_iter().find(|f| f.internal && f.geometry.kind() == "cylinder").unwrap();
    let plan = |face: &str| {
        let text = format!(
            "format = \"fringecell-plan/1\"\nname = \"p\"\n[[element]]\nkind = \"cad-face\"\nname = \"bore\"\n\
             file = \"part.step\"\nface = \"{face}\"\ninset_mm = 1.0\nmargin_mm = 0.3\nnormal_tolerance_deg = 20.0\n\
             min_points = 100\n[[feature]]\nkind = \"size\"\nname = \"d\"\nelement = \"bore\"\ntolerance_mm = [-0.05, 0.05]\n"
        );
        std::fs::write(folder.path().join("plan.toml"), text).unwrap();
        let (plan, cloud) = (text_of(&folder, "plan.toml"), text_of(&folder, "cloud.ply"));
        fringetool(&["measure", &plan, &cloud])
    };
    let ran = plan(&format!("#{}", bore.faces[0])).expect_success();
    assert!(ran.stdout.contains("pass"), "{}", ran.stdout);
    let refused = plan("#1");
    assert_eq!(refused.code, Some(2));
    assert!(
        refused.stderr.contains("face = \"#1\"") && refused.stderr.contains("it has #"),
        "{}",
        refused.stderr
    );
}

fn text_of(folder: &TempDir, name: &str) -> String {
    text(&folder.path().join(name))
}

#[test]
fn what_is_not_read_is_refused_before_anything_is_written() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("plan.toml");
    let stl = folder.path().join("part.step");
    std::fs::write(&stl, "solid part\nendsolid\n").unwrap();
    let gone = folder.path().join("none.step");
    let damaged = folder.path().join("damaged.step");
    let text_of_loft = std::fs::read_to_string(sample("loft.step")).unwrap();
    std::fs::write(&damaged, text_of_loft.replace("(7,7),(2,2)", "(7,6),(2,2)")).unwrap();
    for (file, words) in
        [(damaged, "its knots count 13 times"), (stl, "is no STEP file"), (gone, "none.step")]
    {
        let ran = fringetool(&["plan-from-cad", &text(&file), "--out", &text(&out)]);
        assert_eq!(ran.code, Some(2), "{}", ran.stdout);
        assert!(ran.stderr.contains(words) && ran.stderr.lines().count() == 1, "{}", ran.stderr);
        assert!(!out.exists());
    }
}
