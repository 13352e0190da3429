//! A rig file against what its cameras see, and against other programs: `check-rig`, `export`, `import-rig`.

use crate::support::{Ran, Small, fringetool, root};
use files::rig_file::{read_rig, write_rig};
use fringe::geometry::rig::{Pair, Rig};
use std::path::Path;
use tempfile::TempDir;

/// Cameras of this size see some thousand windows of the part.
const SIZE_PX: (u32, u32) = (336, 224);

/// The twin's part under fringes along both axes, and its rig.
struct Lit {
    folder: TempDir,
    size_px: (u32, u32),
    /// Whether a third camera and the projector are a pair of the rig.
    side: bool,
}

impl Lit {
    fn new() -> Self {
        Self::of(SIZE_PX, 5)
    }

    /// With cameras of a size, and so many steps of the phase.
    fn of(size_px: (u32, u32), steps: u32) -> Self {
        Self::seen_by(size_px, steps, &["cam1", "cam2"])
    }

    /// Seen by these cameras, of which the first two are a pair, and a third one with the projector.
    fn seen_by(size_px: (u32, u32), steps: u32, cameras: &[&str]) -> Self {
        let pairs = &["pair1", "side"][..cameras.len() - 1];
        let drivers: Vec<String> =
            cameras.iter().map(|name| format!("{{ name = \"{name}\", driver = \"twin\" }}")).collect();
        let drivers = drivers.join(", ");
        let lit = Self { folder: TempDir::new().unwrap(), size_px, side: pairs.len() > 1 };
        lit.write_rig("rig.toml", |_| ());
        let scene = root().join("configs/complex-artefact.scene.toml");
        let cell = format!(
            r#"format = "fringecell-config/1"
name = "lit"
rig = "rig.toml"
pairs = {pairs:?}
projector = [{{ name = "proj1", driver = "twin", width_px = 608, height_px = 684, cameras = {cameras:?}, sequence = [
  {{ set = "sine", axis = "x", period_px = 16.0, steps = {steps} }}, {{ set = "gray", axis = "x", bits = 7, stripe_px = 8.0 }},
  {{ set = "sine", axis = "y", period_px = 16.0, steps = {steps} }}, {{ set = "gray", axis = "y", bits = 7, stripe_px = 8.0 }},
  {{ set = "white" }}, {{ set = "black" }},
] }}]
camera = [{drivers}]
[twin]
scene = {:?}
"#,
            scene.display().to_string()
        );
        std::fs::write(lit.path("cell.toml"), cell).unwrap();
        fringetool(&["simulate", &lit.path("cell.toml"), "--out", &lit.path("rec")]).expect_success();
        lit
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    /// The twin's rig, changed.
    fn write_rig(&self, name: &str, change: impl FnOnce(&mut Rig)) {
        let mut rig = twin::thesis::rig(self.size_px.0, self.size_px.1);
        let [side, left, right] = ["side", "cam3", "proj1"].map(str::to_owned);
        let side = Pair { name: side, left, right: right.clone(), projector: right };
        rig.pairs.extend(self.side.then_some(side));
        change(&mut rig);
        write_rig(self.path(name).as_ref(), &rig, &toml::Table::new(), None).unwrap();
    }

    fn check(&self, rig: &str, more: &[&str]) -> Ran {
        let (rig, recording) = (self.path(rig), self.path("rec"));
        let mut arguments = vec!["check-rig", &recording, "--rig", &rig];
        arguments.extend(more);
        fringetool(&arguments)
    }
}

/// The recording `lit` and its rig `lit-rig.toml` in a folder.
pub fn lit(folder: &Path) {
    let lit = Lit::new();
    std::fs::copy(lit.path("rig.toml"), folder.join("lit-rig.toml")).unwrap();
    let copied =
        std::process::Command::new("cp").arg("-r").arg(lit.path("rec")).arg(folder.join("lit")).status();
    assert!(copied.unwrap().success());
}

#[test]
fn a_knocked_camera_is_told_from_a_healthy_rig_and_the_trend_keeps_it() {
    let lit = Lit::new();
    let (trend, chart, json) = (lit.path("trend.txt"), lit.path("trend.svg"), lit.path("check.json"));
    let keep = ["--trend", &trend, "--picture", &chart, "--json", &json];
    let healthy = lit.check("rig.toml", &[&keep[..], &["--date", "2026-01-31"]].concat()).expect_success();
    assert!(healthy.stdout.contains("healthy") && !healthy.stdout.contains("NOT"), "{}", healthy.stdout);
    // 0.05° about an axis along the baseline moves the image by 0.6 px across it.
    lit.write_rig("knocked.toml", |rig| {
        let camera = &mut rig.cameras[1].camera;
        let turn = nalgebra::UnitQuaternion::from_euler_angles(f64::to_radians(0.05), 0.0, 0.0);
        camera.camera_from_world = turn * camera.camera_from_world;
    });
    let knocked = lit.check("knocked.toml", &keep);
    assert_eq!(knocked.code, Some(1), "{}{}", knocked.stdout, knocked.stderr);
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(result["healthy"], false);
    assert_eq!(result["suspects"], serde_json::json!(["cam2"]), "{}", knocked.stdout);
    let cause = &result["pairs"][0]["drift"]["causes"][0];
    assert_eq!(cause["name"], "rotation about x");
    let (value, u) =
        (cause["value"].as_f64().unwrap().to_degrees(), cause["u"].as_f64().unwrap().to_degrees());
    assert!((value + 0.05).abs() < 4.0 * u && u < 0.001, "{value}° ± {u}°");
    assert_eq!(std::fs::read_to_string(&trend).unwrap().lines().count(), 2);
    assert!(std::fs::read_to_string(&chart).unwrap().contains("2026-01-31"));
    let text = std::fs::read_to_string(&trend).unwrap();
    std::fs::write(&trend, text.replacen("\"healthy\":true", "\"healthy\":false", 1)).unwrap();
    let broken = lit.check("rig.toml", &keep);
    assert_eq!(broken.code, Some(2));
    assert!(broken.stderr.contains("trend.txt:1: the seal does not fit"), "{}", broken.stderr);
}

#[test]
fn a_knocked_camera_is_mended_from_several_recordings_that_are_no_copies() {
    // Smaller pictures leave lengths open.
    let lit = Lit::of((1124, 750), 10);
    let (rec, more, rig, out) =
        (lit.path("rec"), lit.path("more"), lit.path("knocked.toml"), lit.path("mended.toml"));
    let json = lit.path("mended.json");
    fringetool(&["simulate", &lit.path("cell.toml"), "--cycle", "3", "--out", &more]).expect_success();
    let turn_deg = 0.05;
    lit.write_rig("knocked.toml", |rig| {
        let camera = &mut rig.cameras[1].camera;
        let turn = nalgebra::UnitQuaternion::from_euler_angles(f64::to_radians(turn_deg), 0.0, 0.0);
        camera.camera_from_world = turn * camera.camera_from_world;
    });
    let mended = ["correct-rig", &rec, &more, "--rig", &rig, "--out", &out];
    let ran = fringetool(&[&mended[..], &["--json", &json]].concat()).expect_success();
    assert!(ran.stdout.contains(&format!("{more}: pair1: drift")), "{}", ran.stdout);
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    assert_eq!(
        (&result["model"], &result["recordings"]),
        (&"rotation".into(), &serde_json::json!([rec, more]))
    );
    let found = |of: &str| result[of][0].as_f64().unwrap().to_degrees();
    assert!(
        (found("drift") + turn_deg).abs() < 4.0 * found("u_drift"),
        "{} ± {}",
        found("drift"),
        found("u_drift")
    );
    let history = read_rig(out.as_ref()).unwrap().provenance;
    assert_eq!(history["corrections"][0]["recordings_sha256"].as_array().map(Vec::len), Some(2));
    // Both tell more than one: a wrong cause fits twice as many points worse. The uncertainty also holds the doubt about
    // the cause, which may grow by chance.
    let alone = lit.path("alone.json");
    fringetool(&["correct-rig", &rec, "--rig", &rig, "--out", &out, "--json", &alone]).expect_success();
    let single: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&alone).unwrap()).unwrap();
    let chi2_of = |result: &serde_json::Value, cause: &str| {
        let models = result["models"].as_array().unwrap();
        models.iter().find(|model| model["name"] == cause).unwrap()["chi2"].as_f64().unwrap()
    };
    for cause in ["focal length", "shift"] {
        let (both, one) = (chi2_of(&result, cause), chi2_of(&single, cause));
        assert!(both > 1.5 * one, "{cause}: {both} beside {one}");
    }
    // A copy under another name is no second measurement.
    let copy = lit.path("copy");
    assert!(std::process::Command::new("cp").args(["-r", &rec, &copy]).status().unwrap().success());
    let plan = root().join("configs/complex-artefact.plan.toml").display().to_string();
    let cases = [
        (vec![rec.as_str(), copy.as_str()], vec![], "has the same frames as"),
        (vec![&rec, &more, &copy], vec!["--length", &plan, "--length", &plan], "2 plans for 3 recordings"),
    ];
    for (recordings, options, expected) in cases {
        let rest = ["--rig", &rig, "--out", &lit.path("never.toml")];
        let ran = fringetool(&[&["correct-rig"][..], &recordings, &rest, &options].concat());
        assert!(ran.code == Some(2) && ran.stderr.contains(expected), "{}", ran.stderr);
        assert!(!Path::new(&lit.path("never.toml")).exists());
    }
    a_certified_length_is_read_and_may_be_wrong(&lit, &rec, &plan);
    // Nor does a misspelt view pass for one that has not drifted.
    let true_rig = lit.path("rig.toml");
    let ran = fringetool(&["correct-rig", &rec, "--rig", &true_rig, "--out", &out, "--view", "cam9"]);
    assert!(ran.code == Some(2) && ran.stderr.contains("--view cam9"), "{}", ran.stderr);
}

/// A camera that the rig file does not pair with the knocked one says where that stands as well, unless it moved itself.
#[test]
fn a_further_camera_helps_to_mend_and_one_that_moved_too_is_no_partner() {
    let lit = Lit::seen_by((1124, 750), 8, &["cam1", "cam2", "cam3"]);
    let (rec, out, json) = (lit.path("rec"), lit.path("mended.toml"), lit.path("mended.json"));
    let turn = |rig: &mut Rig, camera: usize, by_deg: f64| {
        let camera = &mut rig.cameras[camera].camera;
        let turn = nalgebra::UnitQuaternion::from_euler_angles(by_deg.to_radians(), 0.0, 0.0);
        camera.camera_from_world = turn * camera.camera_from_world;
    };
    lit.write_rig("one.toml", |rig| turn(rig, 1, 0.05));
    lit.write_rig("two.toml", |rig| (turn(rig, 1, 0.05), turn(rig, 2, 0.05)).1);
    let mend = |rig: &str| {
        fringetool(&["correct-rig", &rec, "--rig", &lit.path(rig), "--out", &out, "--json", &json])
    };
    let two = mend("two.toml");
    assert!(two.code == Some(2) && two.stderr.contains("more than one has drifted"), "{}", two.stderr);
    assert!(!Path::new(&out).exists() && !Path::new(&json).exists());
    let one = mend("one.toml").expect_success();
    assert!(one.stdout.contains("cam3-cam2 under proj1: drift"), "{}", one.stdout);
    let result: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let pair =
        |name: &str| result["pairs"].as_array().unwrap().iter().find(|pair| pair["name"] == name).cloned();
    assert_eq!(pair("cam3-cam2 under proj1").expect("the further camera")["healthy"], true);
    let (found, u) = (result["drift"][0].as_f64().unwrap(), result["u_drift"][0].as_f64().unwrap());
    assert!((found.to_degrees() + 0.05).abs() < 4.0 * u.to_degrees(), "{found} ± {u}");
    // Named by hand, the view is corrected by what did not move, and cam3 stays out.
    let named =
        fringetool(&["correct-rig", &rec, "--rig", &lit.path("two.toml"), "--out", &out, "--view", "cam2"]);
    assert!(!named.stdout.contains("cam3-cam2"), "{}{}", named.stdout, named.stderr);
}

/// A length counts where all pairs are healthy, and one that contradicts the residuals corrects nothing.
fn a_certified_length_is_read_and_may_be_wrong(lit: &Lit, rec: &str, plan: &str) {
    // Along its baseline a camera moves unseen.
    lit.write_rig("along.toml", |rig| {
        rig.projectors.clear();
        rig.pairs.truncate(1);
        let centre = rig.cameras[0].camera.centre_mm();
        let camera = &mut rig.cameras[1].camera;
        let away = (camera.centre_mm() - centre).normalize() * 0.5;
        camera.camera_from_world.translation.vector -= camera.camera_from_world.rotation * away;
    });
    let wrong = lit.path("wrong.plan.toml");
    let text = std::fs::read_to_string(plan).unwrap();
    assert!(text.contains("nominal_mm = 112.447"));
    std::fs::write(&wrong, text.replace("nominal_mm = 112.447", "nominal_mm = 113.447")).unwrap();
    let out = lit.path("never.toml");
    for (rig, plan, expected) in [
        ("rig.toml", plan, None),
        ("rig.toml", wrong.as_str(), Some("certified are 113.4470 mm")),
        ("along.toml", plan, Some("a view moved along its baseline")),
        ("knocked.toml", wrong.as_str(), Some("the residuals leave lengths open")),
    ] {
        let ran = fringetool(&["correct-rig", rec, "--rig", &lit.path(rig), "--length", plan, "--out", &out]);
        match expected {
            None => assert!(ran.expect_success().stdout.contains("nothing has drifted"), "{rig}"),
            Some(text) => assert!(ran.code == Some(2) && ran.stderr.contains(text), "{rig}: {}", ran.stderr),
        }
        assert!(!Path::new(&out).exists());
    }
}

#[test]
fn what_cannot_be_checked_says_what_is_missing() {
    let small = Small::new();
    let (rig, recording) = (small.path("rig.toml"), small.path("rec"));
    let covariance =
        format!("covariance = {{ file = \"c.json\", sha256 = \"{}\" }}\n[[camera]]", "0".repeat(64));
    let one_direction = ["check-rig", recording.as_str(), "--rig", rig.as_str()];
    for (arguments, expected) in [
        (vec![], "no projector shows fringes along both axes"),
        (vec!["--false-alarm", "2"], "invalid value '2' for '--false-alarm <P>'"),
        (vec!["--phase-error-px", "nan"], "invalid value 'nan' for '--phase-error-px <PX>'"),
        (vec!["--trend", "absent/trend.txt"], "the folder absent does not exist"),
        (vec!["--date", "yesterday"], "--date yesterday: is not a date"),
        (vec!["--picture", "c.svg"], "--trend"),
    ] {
        let ran = fringetool(&[one_direction.as_slice(), &arguments].concat());
        assert_eq!(ran.code, Some(2), "{arguments:?}: {}", ran.stderr);
        assert!(ran.stderr.contains(expected) && !ran.stderr.contains("panicked"), "{}", ran.stderr);
    }
    small.edit("rig.toml", "[[camera]]", &covariance);
    let ran = fringetool(&one_direction);
    assert_eq!(ran.code, Some(2));
    assert!(
        ran.stderr.contains("c.json: cannot open it") && ran.stderr.contains("names it as its covariance"),
        "{}",
        ran.stderr
    );
    // What needs no covariance goes on, and states it.
    let ran = small.reconstruct(&[]).expect_success();
    assert!(ran.stderr.contains("c.json"), "{}", ran.stderr);
}

#[test]
fn a_pair_goes_to_opencv_and_comes_back_with_its_digits() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let rig = twin::thesis::rig(336, 224);
    write_rig(path("rig.toml").as_ref(), &rig, &toml::Table::new(), None).unwrap();
    let (file, back) = (path("rig.toml"), path("back.toml"));
    fringetool(&["export", "--rig", &file, "--format", "opencv", "--out", &path("all")]).expect_success();
    let many = fringetool(&["export", "--rig", &file, "--out", &path("one.yml")]);
    assert!(many.code == Some(2) && many.stderr.contains("choose one with --pair"), "{}", many.stderr);
    for out in ["one.yml", "one.xml"] {
        let out = path(out);
        fringetool(&["export", "--rig", &file, "--pair", "pair2", "--out", &out]).expect_success();
        fringetool(&["import-rig", &out, "--views", "cam3,cam4", "--out", &back]).expect_success();
        let read = read_rig(back.as_ref()).unwrap().rig;
        for name in ["cam3", "cam4"] {
            let (a, b) = (rig.camera(name).unwrap(), read.camera(name).unwrap());
            assert_eq!(
                (a.focal_px, a.principal_point_px, a.distortion),
                (b.focal_px, b.principal_point_px, b.distortion)
            );
            let difference = a.camera_from_world * b.camera_from_world.inverse();
            assert!(difference.translation.vector.amax() < 1e-12 && difference.rotation.angle() < 1e-14);
        }
    }
    assert_eq!(std::fs::read(path("all/pair2.yml")).unwrap(), std::fs::read(path("one.yml")).unwrap());
    std::fs::remove_file(&back).unwrap();
    for (arguments, expected) in [
        (vec!["--views", "a,b,c"], "name one view or two"),
        (vec!["--views", "a/,b"], "back.toml"),
        (vec!["--size", "12"], "--size 12: write columns x rows"),
        (vec!["--unit-mm", "0"], "--unit-mm 0"),
    ] {
        let base = ["import-rig".to_owned(), path("one.yml"), "--out".to_owned(), back.clone()];
        let all: Vec<String> = base.into_iter().chain(arguments.iter().map(|a| (*a).to_owned())).collect();
        let ran = fringetool(&all);
        assert_eq!(ran.code, Some(2), "{arguments:?}: {}", ran.stderr);
        assert!(ran.stderr.contains(expected), "{}", ran.stderr);
        assert!(!Path::new(&back).exists());
    }
}

/// ROS has a file a camera, Kalibr one chain; both come back in millimetres with the names that they hold.
#[test]
fn a_rig_goes_to_ros_and_kalibr_and_comes_back() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let mut rig = twin::thesis::rig(336, 224);
    for named in &mut rig.cameras {
        named.camera.distortion.k[2] = 0.0;
    }
    let (file, back) = (path("rig.toml"), path("back.toml"));
    write_rig(file.as_ref(), &rig, &toml::Table::new(), None).unwrap();
    let compare = |names: [&str; 2], back: &str| {
        let read = read_rig(back.as_ref()).unwrap().rig;
        let step = |rig: &fringe::geometry::rig::Rig| {
            let [a, b] = names.map(|name| rig.camera(name).unwrap().camera_from_world);
            b * a.inverse()
        };
        let off = step(&rig) * step(&read).inverse();
        assert!(off.translation.vector.amax() < 1e-9 && off.rotation.angle() < 1e-12, "{names:?}: {off}");
        assert_eq!(read.camera(names[1]).unwrap().focal_px, rig.camera(names[1]).unwrap().focal_px);
    };
    fringetool(&["export", "--rig", &file, "--format", "ros", "--pair", "pair1", "--out", &path("ros")])
        .expect_success();
    let (left, right) = (path("ros/pair1-cam1.yaml"), path("ros/pair1-cam2.yaml"));
    fringetool(&["import-rig", &left, "--and", &right, "--out", &back]).expect_success();
    compare(["cam1", "cam2"], &back);
    let chain = path("camchain.yaml");
    fringetool(&["export", "--rig", &file, "--format", "kalibr", "--out", &chain]).expect_success();
    fringetool(&["import-rig", &chain, "--views", "cam1,cam2,cam3,cam4", "--out", &back, "--force"])
        .expect_success();
    compare(["cam1", "cam4"], &back);
    for (arguments, expected) in [
        (vec!["export", "--rig", &file, "--format", "ros", "--out", "x.yaml"], "name a folder"),
        (vec!["export", "--rig", &file, "--format", "kalibr", "--out", "x"], "Kalibr has one file"),
        (vec!["import-rig", &chain, "--views", "a,b", "--out", "x.toml"], "4 cameras are there"),
        (vec!["import-rig", &chain, "--size", "1x1", "--out", "x.toml"], "are for OpenCV's files"),
    ] {
        let ran = fringetool(&arguments);
        assert!(ran.code == Some(2) && ran.stderr.contains(expected), "{arguments:?}: {}", ran.stderr);
    }
}
