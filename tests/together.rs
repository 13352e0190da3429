//! Projectors that show at the same time: found where their light does not meet, and a wrong grouping shows in what is measured.

use crate::running::{Cell, json};
use crate::support::{Ran, SMALL_PX, fringecell_in, fringetool, root};
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

/// Two opposite sides of a cell around a part.
fn two_sides(scene: &str, schedule: &str, all_cameras: bool) -> String {
    let mut text = "format = \"fringecell-config/1\"\nname = \"sides\"\nrig = \"sides-rig.toml\"\npairs = [\"pair1\", \"pair3\"]\n".to_owned();
    let cameras = ["cam1", "cam2", "cam5", "cam6"];
    for (number, own) in [(1, 0..2), (3, 2..4)] {
        let seen = if all_cameras { &cameras[..] } else { &cameras[own] };
        writeln!(
            text,
            "[[projector]]\nname = \"proj{number}\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\ncameras = {seen:?}\n\
             sequence = [{{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 }}, \
             {{ set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 }}, {{ set = \"white\" }}, {{ set = \"black\" }}]"
        )
        .unwrap();
    }
    for camera in cameras {
        writeln!(text, "[[camera]]\nname = \"{camera}\"\ndriver = \"twin\"").unwrap();
    }
    text + &format!("[twin]\nscene = {scene:?}\n[schedule]\n{schedule}\n")
}

/// A folder with both scenes and a rig of small cameras.
fn cell() -> Cell {
    let cell = Cell::new("together");
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
    let cell = cell();
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
    let cell = cell();
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
    let cell = cell();
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
