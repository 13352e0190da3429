//! Projectors that show at the same time: found where their light does not meet, and a wrong grouping shows in what is measured.

use crate::running::{Cell, json, pid_of, poke, results, text, wait};
use crate::support::{Ran, SMALL_PX, fringecell_in, fringetool, root};
use fringe::pattern::{Axis, stepping};
use serde_json::Value;
use std::fmt::Write as _;

/// A roof so steep that light from one side reaches nothing that the other side sees: a prism of triangles along y, ridge up.
fn roof() -> String {
    let (half, length, height) = (26.0, 55.0, 62.0);
    let ends = [-length, length].map(|y| [[-half, y, 0.0], [half, y, 0.0], [0.0, y, height]]);
    let [front, back] = ends;
    let mut triangles = vec![front, [back[1], back[0], back[2]]];
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        triangles.extend([[front[a], back[a], front[b]], [front[b], back[a], back[b]]]);
    }
    let mut text = "solid roof\n".to_owned();
    for triangle in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle {
            writeln!(text, "vertex {x:?} {y:?} {z:?}").unwrap();
        }
        text += "endloop\nendfacet\n";
    }
    text + "endsolid roof\n"
}

const SCENE: &str = "format = \"fringecell-scene/1\"\nname = \"roof\"\n[[material]]\nname = \"matte\"\nalbedo = 0.7\n\
                     [[body]]\nname = \"roof\"\nmaterial = \"matte\"\ngeometry = { shape = \"mesh\", file = \"roof.stl\" }\n";

/// Fringes, their numbers as Gray code, white and black.
const CODED: &str = "{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 }, \
                     { set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 }, { set = \"white\" }, { set = \"black\" }";

/// Two opposite sides of a cell around a part.
fn two_sides(scene: &str, schedule: &str, all_cameras: bool) -> String {
    sides_with(scene, schedule, all_cameras, [CODED, CODED])
}

/// The same with the sequences of both projectors.
fn sides_with(scene: &str, schedule: &str, all_cameras: bool, sequences: [&str; 2]) -> String {
    let mut text = "format = \"fringecell-config/1\"\nname = \"sides\"\nrig = \"sides-rig.toml\"\npairs = [\"pair1\", \"pair3\"]\n".to_owned();
    let cameras = ["cam1", "cam2", "cam5", "cam6"];
    for ((number, own), sequence) in [(1, 0..2), (3, 2..4)].into_iter().zip(sequences) {
        let seen = if all_cameras { &cameras[..] } else { &cameras[own] };
        writeln!(
            text,
            "[[projector]]\nname = \"proj{number}\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\ncameras = {seen:?}\n\
             sequence = [{sequence}]"
        )
        .unwrap();
    }
    for camera in cameras {
        writeln!(text, "[[camera]]\nname = \"{camera}\"\ndriver = \"twin\"").unwrap();
    }
    text + &format!("[twin]\nscene = {scene:?}\n[schedule]\n{schedule}\n")
}

/// A folder with both scenes and a rig of small cameras.
fn cell(name: &str) -> Cell {
    let cell = Cell::new(&format!("together-{name}"));
    let path = |name: &str| cell.small.folder.path().join(name);
    let rig = twin::thesis::rig_of_sides(4, SMALL_PX.0, SMALL_PX.1);
    files::rig_file::write_rig(&path("sides-rig.toml"), &rig, &toml::Table::new(), None).unwrap();
    std::fs::write(path("roof.stl"), roof()).unwrap();
    std::fs::write(path("roof.scene.toml"), SCENE).unwrap();
    std::fs::copy(root().join("configs/complex-artefact.scene.toml"), path("part.scene.toml")).unwrap();
    cell
}

fn schedule(cell: &Cell, text: &str, more: &[&str]) -> Ran {
    std::fs::write(cell.small.path("sides.toml"), text).unwrap();
    let arguments: Vec<&str> = ["schedule", "sides.toml"].iter().chain(more).copied().collect();
    fringecell_in(cell.small.folder.path(), &arguments)
}

/// Hashes and number of points of one cycle.
fn measured(cell: &Cell, text: &str) -> (serde_json::Value, u64) {
    std::fs::write(cell.small.path("sides.toml"), text).unwrap();
    let ran = cell.run("sides.toml", &["--cycles", "1"]);
    assert!(matches!(ran.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&ran.stderr));
    let result = json(&cell.out().join("result.json"));
    let points = std::fs::metadata(cell.out().join("cloud.ply")).map_or(0, |file| file.len());
    std::fs::remove_dir_all(cell.out()).unwrap();
    (result["hashes"].clone(), points)
}

/// Proves: on a roof two opposite projectors are found not to meet, take half of the patterns one after another, and give every byte that
/// they give alone; on a part whose top both light they stay alone, and when they are made to show together the twin draws the light of
/// both, so that frames and clouds are others, with far fewer points, and `schedule` names who meets.
#[test]
fn light_that_does_not_meet_is_shown_together_and_light_that_meets_spoils_the_measurement() {
    let cell = cell("meet");
    let auto = |scene: &str| two_sides(scene, "together = \"auto\"", false);
    let named = |scene: &str| two_sides(scene, "together = [[\"proj1\", \"proj3\"]]", false);
    let found = schedule(&cell, &auto("roof.scene.toml"), &[]).expect_success().stdout;
    assert!(
        found.starts_with("projectors together: proj1 + proj3: 19 patterns one after another instead of 38"),
        "{found}"
    );
    let none = schedule(&cell, &auto("part.scene.toml"), &[]).expect_success().stdout;
    assert!(none.starts_with("projectors together: proj1, proj3: 38 patterns"), "{none}");
    let met = schedule(&cell, &named("part.scene.toml"), &[]);
    assert_eq!(met.code, Some(1), "{}", met.stderr);
    assert!(
        met.stdout.contains("proj1 and proj3 meet: cam1 looks at proj1 and sees light of proj3 on "),
        "{}",
        met.stdout
    );
    let plan = cell.small.path("plan.json");
    schedule(&cell, &named("part.scene.toml"), &["--json", &plan]);
    crate::schema::assert_valid("schedule", plan.as_ref());
    let together = &json(plan.as_ref())["together"];
    assert_eq!(
        (&together["groups"], &together["patterns"], &together["patterns_alone"]),
        (&serde_json::json!([["proj1", "proj3"]]), &19.into(), &38.into())
    );
    assert_eq!(together["meetings"][0]["told_apart"], false, "{together}");
    schedule(&cell, &two_sides("roof.scene.toml", "", false), &["--json", &plan]).expect_success();
    assert_eq!(json(plan.as_ref())["together"], Value::Null);

    let alone = measured(&cell, &two_sides("roof.scene.toml", "", false));
    assert_eq!(measured(&cell, &auto("roof.scene.toml")), alone, "roof");
    let alone = measured(&cell, &two_sides("part.scene.toml", "", false));
    let wrong = measured(&cell, &named("part.scene.toml"));
    for output in ["frame/cam1", "frame/cam5", "cloud/pair1", "cloud/pair3"] {
        assert_ne!(wrong.0[output], alone.0[output], "{output}");
    }
    assert!(wrong.1 < alone.1 / 2, "{} bytes of points beside {}", wrong.1, alone.1);
}

/// Proves: a trial recording, in which all cameras look at each projector, tells the groups that the scene tells; one that lacks cameras is
/// refused.
#[test]
fn a_trial_recording_tells_which_projectors_meet() {
    let cell = cell("trial");
    for (scene, groups) in [
        ("roof.scene.toml", "together = [[\"proj1\", \"proj3\"]]"),
        ("part.scene.toml", "together = [[\"proj1\"], [\"proj3\"]]"),
    ] {
        std::fs::write(cell.small.path("trial.toml"), two_sides(scene, "", true)).unwrap();
        let (trial, out) = (cell.small.path("trial.toml"), cell.small.path("trial"));
        fringetool(&["simulate", &trial, "--out", &out]).expect_success();
        let told =
            schedule(&cell, &two_sides(scene, "", false), &["--trial", "trial"]).expect_success().stdout;
        assert!(told.contains(groups), "{told}");
        std::fs::remove_dir_all(&out).unwrap();
    }
    let refused = schedule(&cell, &two_sides("roof.scene.toml", "", false), &["--trial", "rec"]);
    assert_eq!(refused.code, Some(2));
    assert!(refused.stderr.contains("record all cameras with each projector"), "{}", refused.stderr);
}

/// Proves: groups that no part can allow, or of which names are wrong, are refused with the key and a remedy.
#[test]
fn groups_without_sense_are_refused() {
    let cell = cell("refused");
    for (together, all_cameras, words) in [
        ("[[\"proj1\", \"proj2\"]]", false, "\"proj2\""),
        ("[[\"proj1\", \"proj3\"], [\"proj1\"]]", false, "each projector may be in one group"),
        ("\"always\"", false, "\"auto\""),
        ("[[\"proj1\", \"proj3\"]]", true, "meet in camera \"cam1\", which looks at both"),
    ] {
        let text = two_sides("roof.scene.toml", &format!("together = {together}"), all_cameras);
        let ran = schedule(&cell, &text, &[]);
        assert_eq!(ran.code, Some(2), "{together}: {}", ran.stdout);
        assert!(
            ran.stderr.contains(words) && ran.stderr.contains("schedule.together"),
            "{together}: {}",
            ran.stderr
        );
    }
}

/// Hashes of each cycle that was ok, by its number.
fn hashes_of_cycles(cell: &Cell) -> Vec<(u64, Value)> {
    let ok = results(&cell.out()).into_iter().filter(|result| result["outcome"] == "ok");
    ok.map(|result| (result["cycle"].as_u64().unwrap(), result["hashes"].clone())).collect()
}

/// Proves: of a group, too, every byte is the same on one core and on four, after a camera's stage was killed, and in a replay.
#[test]
fn a_group_gives_the_same_bytes_on_any_cores_after_a_kill_and_in_a_replay() {
    let cell = cell("bytes");
    let config = |cores: usize| {
        let schedule = format!("together = [[\"proj1\", \"proj3\"]]\ncores = {cores}");
        std::fs::write(cell.small.path("sides.toml"), two_sides("roof.scene.toml", &schedule, false))
            .unwrap();
    };
    let record = cell.small.path("sides.record");
    config(1);
    let ran = cell.run("sides.toml", &["--cycles", "4", "--cycle-record", &record]);
    assert!(matches!(ran.status.code(), Some(0 | 1)), "{}", text(&ran.stderr));
    let once = hashes_of_cycles(&cell);
    assert_eq!(once.len(), 4);
    assert_ne!(once[0].1["frame/cam1"], once[1].1["frame/cam1"], "the part stands elsewhere in each cycle");
    fringetool(&["replay", &record]).expect_success();

    std::fs::remove_dir_all(cell.out()).unwrap();
    config(4);
    let run = cell.program("sides.toml", &["--cycles", "4"]).spawn().unwrap();
    poke("KILL", pid_of(&cell.until_a_cycle_begins(), "capture/cam5"));
    wait(run);
    let again = hashes_of_cycles(&cell);
    assert!((2..=3).contains(&again.len()), "one cycle or two were lost: {again:?}");
    for cycle in &again {
        assert!(once.contains(cycle), "cycle {}", cycle.0);
    }
}

/// Twelve steps of three sines that pass so many periods.
fn stepped(periods: u32) -> String {
    let set = |period_px: f64| {
        let set = stepping(Axis::X, period_px, 12, periods);
        let shifts: Vec<f64> = (0..12).map(|step| set.step_rad(step)).collect();
        format!(
            "{{ set = \"sine\", axis = \"x\", period_px = {period_px:?}, steps = 12, shifts_rad = {shifts:?} }}"
        )
    };
    [16.0, 100.0, 640.0].map(set).join(", ")
}

/// Distances from points of a cloud to the nearest one of another: that which 19 of 20 keep, mm.
fn usual_distance_mm(cloud: &[[f64; 3]], reference: &[[f64; 3]]) -> f64 {
    let square = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>();
    let nearest = |a: &[f64; 3]| reference.iter().map(|b| square(a, b)).fold(f64::INFINITY, f64::min);
    let mut found: Vec<f64> = cloud.iter().step_by(37).map(|point| nearest(point).sqrt()).collect();
    found.sort_by(f64::total_cmp);
    found[found.len() * 19 / 20]
}

/// Proves: projectors whose light meets are told apart by the numbers of periods of their steps: the points are those that they give one
/// after another but for the noise of the light that is added; with equal numbers they are not, and `schedule` names the steps that would.
#[test]
fn light_that_meets_is_told_apart_by_the_periods_of_its_steps() {
    let cell = cell("steps");
    let with = |schedule: &str, periods: [u32; 2], noise_seed: u32| {
        let sequences = periods.map(stepped);
        let text = sides_with("part.scene.toml", schedule, false, sequences.each_ref().map(String::as_str));
        // Both lights together stay below full scale.
        text.replace("[twin]", "[decode]\ncamera_noise = { read_noise_dn = 0.5, gain_dn = 0.024 }\n[twin]")
            + &format!("[twin.settings]\nexposure = 0.45\nnoise_seed = {noise_seed}\n")
    };
    let both = "together = [[\"proj1\", \"proj3\"]]";
    let apart = schedule(&cell, &with(both, [1, 5], 1), &[]).expect_success().stdout;
    assert!(apart.contains("36 patterns one after another instead of 72"), "{apart}");
    assert!(apart.contains("their steps tell them apart"), "{apart}");
    let found = schedule(&cell, &with("together = \"auto\"", [1, 5], 1), &[]).expect_success().stdout;
    assert!(found.starts_with("projectors together: proj1 + proj3: "), "{found}");
    let mixed = schedule(&cell, &with(both, [1, 1], 1), &[]);
    assert_eq!(mixed.code, Some(1));
    assert!(mixed.stdout.contains("proj3 shifts_rad = [0.000000, 2.617994, "), "{}", mixed.stdout);
    assert!(mixed.stdout.contains("the first harmonic that mixes is then number 5"), "{}", mixed.stdout);

    let points = |config: String| {
        std::fs::write(cell.small.path("sides.toml"), config).unwrap();
        let ran = cell.run("sides.toml", &["--cycles", "1"]);
        assert!(matches!(ran.status.code(), Some(0 | 1)), "{}", text(&ran.stderr));
        let cloud = files::ply::read_cloud(&cell.out().join("cloud.ply")).map(|cloud| cloud.points);
        std::fs::remove_dir_all(cell.out()).unwrap();
        cloud.map_or(Vec::new(), |points| points.iter().map(|p| p.position_mm).collect::<Vec<[f64; 3]>>())
    };
    let alone = points(with("", [1, 5], 1));
    let noise_mm = usual_distance_mm(&points(with("", [1, 5], 2)), &alone);
    let together = points(with(both, [1, 5], 2));
    let found_mm = usual_distance_mm(&together, &alone);
    let mixed = points(with(both, [1, 1], 2));
    let mixed_mm = if mixed.is_empty() { f64::INFINITY } else { usual_distance_mm(&mixed, &alone) };
    eprintln!(
        "points alone {}, told apart {}, mixed {}; distances of 95 %: noise {noise_mm:.4} mm, told apart {found_mm:.4} mm, mixed \
         {mixed_mm:.4} mm",
        alone.len(),
        together.len(),
        mixed.len()
    );
    assert!(together.len() * 100 > alone.len() * 97, "{} points beside {}", together.len(), alone.len());
    assert!(found_mm < 1.5 * noise_mm, "{found_mm} mm, noise alone {noise_mm} mm");
    assert!(mixed.len() < alone.len() / 2 || mixed_mm > 5.0 * noise_mm, "{mixed_mm} mm");
}
