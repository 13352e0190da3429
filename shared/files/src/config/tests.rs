//! A configuration that loads is whole; each gap is reported with line, key and both ends.

use super::*;
use crate::recording::{ProjectorRecord, RecordingWriter};
use crate::rig_file::write_rig;
use crate::testing::{camera, rig};
use fringe::frame::{FrameView, Pixels};
use std::fs;

const SEQUENCE: &str = r#"sequence = [
  { set = "sine", axis = "x", period_px = 16.0, steps = 3 },
  { set = "gray", axis = "x", bits = 3, stripe_px = 8.0 },
]"#;

fn twin_text() -> String {
    let projector = |name: &str, cameras: &str| {
        format!(
            "[[projector]]\nname = \"{name}\"\ndriver = \"twin\"\nwidth_px = 64\nheight_px = 48\ncameras = [{cameras}]\n{SEQUENCE}\n"
        )
    };
    let camera = |name: &str| format!("[[camera]]\nname = \"{name}\"\ndriver = \"twin\"\n");
    format!(
        "format = \"fringecell-config/1\"\nname = \"demo\"\nrig = \"rig.toml\"\ncycles = 2\n{}{}{}{}{}{}\
         [limits]\nstage_budget_ms = 700\n[twin]\nscene = \"scene.toml\"\nrig = \"truth.toml\"\nseed = 3\n\
         settings = {{ projector_gamma = 2.2 }}\n[schedule]\ncores = 4\n",
        projector("proj1", "\"cam1\", \"cam2\""),
        projector("proj2", "\"cam3\", \"cam4\""),
        camera("cam1"),
        camera("cam2"),
        camera("cam3"),
        camera("cam4"),
    )
}

/// A folder with a rig, the twin's true rig, a scene, and a recording of proj1 with cam1 and cam2.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let free = toml::Table::new();
    let mut truth = rig(6, 4);
    write_rig(&dir.path().join("rig.toml"), &truth, &free, None).unwrap();
    truth.projectors = vec![camera("proj1", 64, 48), camera("proj2", 64, 48)];
    write_rig(&dir.path().join("truth.toml"), &truth, &free, None).unwrap();
    fs::write(dir.path().join("scene.toml"), "scene").unwrap();
    let holder: toml::Table = toml::from_str(SEQUENCE).unwrap();
    let record = ProjectorRecord {
        name: "proj1".into(),
        width_px: 64,
        height_px: 48,
        cameras: vec!["cam1".into(), "cam2".into()],
        sequence: holder["sequence"].clone().try_into().unwrap(),
        exposures_ms: Vec::new(),
        full_scale_dn: std::collections::BTreeMap::new(),
    };
    let mut writer = RecordingWriter::create(&dir.path().join("scan"), &[record]).unwrap();
    let pixels = Pixels::Mono8(&[9; 24]);
    let view = FrameView { width_px: 6, height_px: 4, full_scale_dn: 255, pixels };
    for (camera, number) in ["cam1", "cam2"].iter().flat_map(|c| (0..6).map(move |n| (c, n))) {
        writer.write("proj1", camera, number, &view).unwrap();
    }
    writer.finish(&free).unwrap();
    dir
}

fn load(dir: &tempfile::TempDir, text: &str) -> Result<Config, String> {
    let path = dir.path().join("cell.toml");
    fs::write(&path, text).unwrap();
    Config::load(&path).map_err(|error| error.to_string())
}

#[test]
fn a_whole_configuration_is_resolved() {
    let dir = folder();
    let config = load(&dir, &twin_text()).unwrap();
    assert_eq!((config.cell.name.as_str(), config.cell.cycles), ("demo", Some(2)));
    assert_eq!(config.cell.rig.pairs.len(), 2);
    assert_eq!(config.cell.rig.pairs[1].projector, "proj2");
    assert_eq!(config.cell.limits.stage_budget_ms, 700);
    assert_eq!((config.cell.limits.cycle_deadline_ms, config.cell.limits.restarts_max), (20_000, 5));
    assert_eq!(
        config.cell.schedule,
        cell::configuration::ScheduleConfig {
            cores: 4,
            cycles_in_flight: 1,
            pin: false,
            realtime_priority: None,
            lock_memory: false
        }
    );
    assert_eq!((config.cell.cameras[3].width_px, config.cell.cameras[3].height_px), (6, 4));
    assert_eq!(config.cell.projectors[0].sequence.len(), 2);
    let twin = config.twin.unwrap();
    assert_eq!((twin.settings.seed, twin.scene.text.as_str(), twin.rig.projectors.len()), (3, "scene", 2));
    assert!(twin.scene.path.is_absolute());
}

#[test]
fn a_cell_may_run_some_of_the_pairs() {
    let dir = folder();
    let text = r#"format = "fringecell-config/1"
name = "one"
rig = "rig.toml"
pairs = ["pair1"]
projector = [{ name = "proj1", driver = "recording" }]
camera = [{ name = "cam1", driver = "recording" }, { name = "cam2", driver = "recording" }]
recording = { path = "scan", rate_hz = 20, loop = true }
"#;
    let config = load(&dir, text).unwrap();
    assert_eq!(config.cell.rig.pairs.len(), 1);
    assert_eq!(config.cell.projectors[0].cameras, ["cam1", "cam2"]);
    assert_eq!((config.cell.projectors[0].width_px, config.cell.projectors[0].sequence.len()), (64, 2));
    assert_eq!(config.cell.cycles, None);
    let recording = config.recording.unwrap();
    assert!(recording.repeat);
    assert_eq!(recording.recording.load("proj1", "cam2", 5).unwrap().width_px, 6);

    for (from, to, expected) in [
        ("\"recording\" }]\ncamera", "\"recording\", width_px = 65 }]\ncamera", "width_px = 65, but 64 in "),
        ("name = \"proj1\"", "name = \"proj2\"", "recorded projector \"proj2\" is unknown; known: proj1"),
        (
            "recording = {",
            "fusion = { radius_mm = nan }\nrecording = {",
            "fusion.radius_mm: value NaN is not allowed",
        ),
        (
            "recording = {",
            "fusion = { max_normal_angle_deg = -1.0 }\nrecording = {",
            "fusion.max_normal_angle_deg: value -1 is not allowed",
        ),
        ("rate_hz = 20", "rate_hz = -1", "recording.rate_hz: value -1 is not allowed"),
        (
            "path = \"scan\"",
            "path = \"scam\"",
            "scam is missing; paths are relative to the file that names them",
        ),
        ("recording = {", "# {", "[recording], which this driver needs, is missing"),
    ] {
        let error = load(&dir, &text.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
    let free = toml::Table::new();
    write_rig(&dir.path().join("rig.toml"), &rig(7, 4), &free, None).unwrap();
    let error = load(&dir, text).unwrap_err();
    assert!(error.contains("camera \"cam1\" has 7 × 4 px in the rig, but 6 × 4 px in "), "{error}");
}

/// What is changed in [`twin_text`], into what, and what the message then states.
const GAPS: &[(&str, &str, &str)] = &[
    (
        "name = \"demo\"",
        "name = \"De mo\"",
        "cell.toml:2: name: value \"De mo\" is not allowed: a cell name has 1",
    ),
    ("name = \"demo\"\n", "", "missing field `name`"),
    ("cycles = 2", "cycels = 2", "cell.toml:4: cycels: unknown key \"cycels\""),
    ("cycles = 2", "cycles = 0", "leave the key out to run until stopped"),
    ("cycles = 2", "cycles = -1", "cell.toml:4: cycles: "),
    ("rig = \"rig.toml\"", "rig = \"no.toml\"", "cell.toml:3: rig: the file "),
    ("rig = \"rig.toml\"", "rig = \"scene.toml\"", "scene.toml"),
    ("driver = \"twin\"", "driver = \"genicam\"", "\"genicam\" drives cameras, not projectors"),
    (
        "driver = \"twin\"",
        "driver = \"screen\"",
        "either output or position_px of projector \"proj1\" is missing",
    ),
    (
        "driver = \"twin\"",
        "driver = \"twn\"",
        "driver \"twn\" is unknown; known: twin, recording, genicam, network, screen, lightcrafter; did you mean",
    ),
    (
        "[\"cam1\", \"cam2\"]",
        "[\"cam1\"]",
        "projector[0].cameras: pair \"pair1\" takes camera \"cam2\", but projector \"proj1\" lights only cam1",
    ),
    (
        "[\"cam1\", \"cam2\"]",
        "[\"cam1\", \"cam9\"]",
        "[[camera]] \"cam9\" is unknown; known: cam1, cam2, cam3, cam4",
    ),
    ("[\"cam1\", \"cam2\"]", "[\"cam1\", \"cam1\"]", "camera \"cam1\" occurs twice"),
    ("[\"cam1\", \"cam2\"]", "[]", "a camera that takes frames of projector \"proj1\" is missing"),
    (
        "name = \"cam4\"",
        "name = \"cam5\"",
        "camera \"cam5\" is unknown; known: cam1, cam2, cam3, cam4; did you mean",
    ),
    ("name = \"proj2\"", "name = \"proj1\"", "view \"proj1\" occurs twice"),
    ("name = \"proj2\"", "name = \"proj3\"", "projector \"proj2\" is unknown; known: proj1, proj3"),
    ("steps = 3", "steps = 2", "projector[0].sequence[0]: steps = 2: a phase needs at least 3 steps"),
    ("bits = 3", "bits = 2", "numbers 32 projector pixels of 64"),
    (
        "  { set = \"gray\", axis = \"x\", bits = 3, stripe_px = 8.0 },\n",
        "",
        "axis X: no absolute fringe order over 64 projector pixels",
    ),
    ("width_px = 64\n", "", "width_px of projector \"proj1\" is missing; add width_px = …"),
    ("width_px = 64", "width_px = 63", "projector \"proj1\" has 63 × 48 px in this cell, but 64 × 48 px in "),
    ("stage_budget_ms = 700", "stage_budget_ms = 0", "limits.stage_budget_ms: value 0 is not allowed"),
    ("stage_budget_ms = 700", "stage_budget_ms = 30000", "within 20000 ms; raise cycle_deadline_ms"),
    ("cores = 4", "cores = 0", "schedule.cores: value 0 is not allowed: 1 … 1024"),
    ("cores = 4", "cycles_in_flight = 5", "schedule.cycles_in_flight: value 5 is not allowed: 1 … 4"),
    ("cores = 4", "realtime_priority = 99", "schedule.realtime_priority: value 99 is not allowed: 1 … 98"),
    ("rig = \"truth.toml\"", "rig = \"rig.toml\"", "projector \"proj1\" in the twin's rig"),
    ("scene = \"scene.toml\"", "scene = \"nowhere.toml\"", "twin.scene: the file "),
    ("cycles = 2", "pairs = [\"pair1\", \"pair9\"]", "pair \"pair9\" is unknown; known: pair1, pair2"),
    (
        "cycles = 2",
        "pairs = [\"pair1\"]",
        "camera \"cam3\" looks at projector \"proj2\", but no pair takes its phase",
    ),
    ("cycles = 2", "pairs = []", "a [[pair]] in "),
    ("cycles = 2", "cycles = [", "cell.toml:"),
];

#[test]
fn each_gap_is_reported_with_place_and_remedy() {
    let dir = folder();
    for (from, to, expected) in GAPS {
        let text = twin_text();
        assert!(text.contains(from), "{from}");
        let error = load(&dir, &text.replacen(from, to, 1)).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
    let without_cam4 = twin_text().replace("[[camera]]\nname = \"cam4\"\ndriver = \"twin\"\n", "");
    let without_cam4 = without_cam4.replace("\"cam3\", \"cam4\"", "\"cam3\"");
    let error = load(&dir, &without_cam4).unwrap_err();
    assert!(error.contains("needs camera \"cam4\", but this cell has no such [[camera]]"), "{error}");
    let two_worlds =
        twin_text().replacen("driver = \"twin\"\nwidth_px", "driver = \"recording\"\nwidth_px", 1);
    let two_worlds = format!("{two_worlds}[recording]\npath = \"scan\"\n");
    let error = load(&dir, &two_worlds).unwrap_err();
    assert!(error.contains("projector \"proj1\" has \"recording\", but camera \"cam1\""), "{error}");
}

#[test]
fn a_pattern_correction_is_of_the_projector_that_names_it() {
    let dir = folder();
    let table = fringe::pattern::LevelTable::new(vec![0.0, 0.7, 1.0]).unwrap();
    let mut correction = crate::correction::PatternCorrection {
        projector: Some("proj1".into()),
        source: crate::correction::TableSource::Response,
        gamma: None,
        coefficients: None,
        table: table.clone(),
        provenance: toml::Table::new(),
    };
    let file = dir.path().join("c.toml");
    let named =
        twin_text().replacen("name = \"proj1\"\n", "name = \"proj1\"\npattern_correction = \"c.toml\"\n", 1);
    assert!(load(&dir, &named).unwrap_err().contains("pattern_correction"));
    crate::correction::write_correction(&file, &correction).unwrap();
    let config = load(&dir, &named).unwrap();
    assert_eq!(config.cell.projectors[0].level_table.as_ref(), Some(&table));
    assert_eq!(config.corrected().collect::<Vec<_>>(), ["proj1"]);
    correction.projector = Some("proj2".into());
    crate::correction::write_correction(&file, &correction).unwrap();
    assert!(load(&dir, &named).unwrap_err().contains("was measured for \"proj2\""));
}

#[test]
fn recipes_have_names_of_their_own_and_plans_that_exist() {
    let dir = folder();
    let plan = include_str!("../../../../configs/complex-artefact.plan.toml");
    fs::write(dir.path().join("a.plan.toml"), plan).unwrap();
    fs::write(dir.path().join("b.plan.toml"), "text").unwrap();
    let recipe = |name: &str, plan: &str| format!("[[recipe]]\nname = {name:?}\nplan = \"{plan}\"\n");
    let with = |more: &str| load(&dir, &format!("{}{more}", twin_text()));
    let config = with(&(recipe("b", "a.plan.toml") + &recipe("a c", "a.plan.toml"))).unwrap();
    let names: Vec<&str> = config.cell.recipes.iter().map(|recipe| recipe.name.as_str()).collect();
    assert_eq!((names, config.plans[0].text.as_str()), (vec!["b", "a c"], plan));
    assert!(config.cell.recipes.iter().all(|recipe| recipe.plan.is_some()));
    let shares = twin_text().replace("cycles = 2\n", "cycles = 2\ncalibration_shares = \"part.json\"\n");
    let error = load(&dir, &shares).unwrap_err();
    assert!(error.contains("calibration_shares: the plan that the shares belong to is missing"), "{error}");
    for (more, expected) in [
        (recipe("b", "no.toml"), "recipe[0].plan"),
        (recipe("b", "b.plan.toml"), "b.plan.toml:1: "),
        (recipe("default", "a.plan.toml"), "recipe[0].name: recipe \"default\" occurs twice"),
        (
            recipe("b", "a.plan.toml") + &recipe("b", "a.plan.toml"),
            "recipe[1].name: recipe \"b\" occurs twice",
        ),
        (recipe("", "a.plan.toml"), "recipe[0].name"),
        (
            recipe("b", "a.plan.toml") + "calibration_shares = \"no.json\"\n",
            "recipe[0].calibration_shares: the file ",
        ),
        (recipe(&"x".repeat(65), "a.plan.toml"), "1 to 64 bytes"),
    ] {
        let error = with(&more).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
}

#[test]
fn settings_are_checked_before_anything_runs() {
    let dir = folder();
    for (table, expected) in [
        ("[decode]\nmax_sigma = 1\n", "decode.max_sigma: unknown key \"max_sigma\""),
        ("[decode]\nmax_sigma_rad = 9\n", "decode setting max_sigma_rad = 9: must be"),
        (
            "[matching]\nmax_step_px = -1.0\n",
            "matching.max_step_px: value -1 is not allowed: a positive number",
        ),
        ("[matching]\ndepth_mm = [5.0, 4.0]\n", "matching.depth_mm[1]: value 4 is not allowed"),
        (
            "[matching.surface]\nsmoothing_px = 4\n",
            "matching.surface.smoothing_px: value 4 is not allowed: 1, 3, 5 or 7",
        ),
        ("[matching]\nmax_stp_px = 1\n", "did you mean \"max_step_px\"?"),
    ] {
        let error = load(&dir, &format!("{}{table}", twin_text())).unwrap_err();
        assert!(error.contains(expected), "{error}\nlacks\n{expected}");
    }
}

/// Wherever this repository ships a configuration, it is whole.
#[test]
fn the_configurations_of_this_repository_load() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
    let mut loaded = 0;
    for entry in fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        let is_config = path.extension().is_some_and(|e| e == "toml")
            && fs::read_to_string(&path).unwrap().contains(&format!("\"{CONFIG_FORMAT}\""));
        if is_config {
            Config::load(&path).unwrap_or_else(|error| panic!("{error}"));
            loaded += 1;
        }
    }
    assert!(loaded > 0, "no configuration in {}", folder.display());
}
