//! Eight cameras and four projectors around a part: all of it is seen, and all pairs agree.

use crate::running::{Cell, json};
use crate::support::{SMALL_PX, fringetool, root};
use fringe::geometry::rig::Rig;
use std::fmt::Write as _;

fn config(name: &str) -> std::path::PathBuf {
    root().join("configs").join(name)
}

fn write(path: &std::path::Path, rig: &Rig) {
    files::rig_file::write_rig(path, rig, &toml::Table::new(), None).unwrap();
}

/// Proves: the rig file is the one that the documentation says it is.
#[test]
fn the_rig_of_quadrants_is_four_sides_of_the_thesis() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("rig.toml");
    write(&path, &twin::thesis::rig_of_sides(4, 1124, 750));
    let kept = std::fs::read_to_string(config("quadrants-rig.toml")).unwrap();
    assert!(kept.starts_with(&std::fs::read_to_string(path).unwrap()));
}

/// Proves: four pairs of small cameras measure together what two see half of, each two of them overlap without a step, and offline the
/// recording gives the same cloud.
#[test]
fn four_pairs_see_a_part_all_around_and_agree() {
    let cell = Cell::new("quadrants");
    let path = |name: &str| cell.small.folder.path().join(name);
    write(&path("quadrants-rig.toml"), &twin::thesis::rig_of_sides(4, SMALL_PX.0, SMALL_PX.1));
    for name in ["quadrants.toml", "complex-artefact.plan.toml", "complex-artefact.scene.toml"] {
        std::fs::copy(config(name), path(name)).unwrap();
    }
    let recording = cell.small.path("recording");
    let ran = cell.run("quadrants.toml", &["--cycles", "1", "--record", &recording]);
    assert!(matches!(ran.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&ran.stderr));
    let result = json(&cell.out().join("result.json"));
    assert_eq!(result["outcome"], "ok");
    let overlaps = result["overlaps"].as_array().unwrap();
    assert_eq!(overlaps.len(), 6, "each two of four pairs");
    for overlap in overlaps {
        let [count, mean_mm, sd_mm] = ["count", "mean_mm", "sd_mm"].map(|key| overlap[key].as_f64().unwrap());
        // Of four clouds every third cell is compared.
        assert!(count > 100.0 && mean_mm.abs() < 4.0 * sd_mm / count.sqrt() + 0.005, "{overlap}");
    }
    let cloud = cell.out().join("cloud.ply");
    let points = files::ply::read_cloud(&cloud).unwrap().points;
    // The flank of the hemisphere, quarter by quarter.
    let mut quarters = [0; 4];
    for point in &points {
        let [x, y, z] = point.position_mm.map(f64::from);
        if (x * x + y * y).sqrt() < 31.0 && (8.0..20.0).contains(&z) {
            quarters[usize::from(x < 0.0) + 2 * usize::from(y < 0.0)] += 1;
        }
    }
    assert!(quarters.iter().all(|count| *count > 50), "{quarters:?}");
    let offline = cell.small.path("offline.ply");
    let configuration = cell.small.path("quadrants.toml");
    fringetool(&["reconstruct", "--config", &configuration, "--out", &offline, &recording]).expect_success();
    let offline = files::ply::read_cloud(offline.as_ref()).unwrap().points;
    let bytes = |points: &[fringe::cloud::Point]| bytemuck::cast_slice::<_, u8>(points).to_vec();
    assert!(bytes(&offline) == bytes(&points), "live and offline clouds differ");
}

/// A cell of the first sides of eight around the part, each a pair with its projector.
fn sides(pairs: usize) -> String {
    let names: Vec<String> = (1..=pairs).map(|n| format!("pair{n}")).collect();
    let mut text = format!(
        "format = \"fringecell-config/1\"\nname = \"sides\"\nrig = \"sides-rig.toml\"\nplan = \"complex-artefact.plan.toml\"\n\
         pairs = {names:?}\n[limits]\nstage_budget_ms = 300000\ncycle_deadline_ms = 900000\n"
    );
    for side in 1..=pairs {
        let cameras = [2 * side - 1, 2 * side].map(|n| format!("cam{n}"));
        writeln!(
            text,
            "[[projector]]\nname = \"proj{side}\"\ndriver = \"twin\"\nwidth_px = 608\nheight_px = 684\ncameras = {cameras:?}\n\
             sequence = [{{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 10 }}, \
             {{ set = \"gray\", axis = \"x\", bits = 7, stripe_px = 8.0 }}, {{ set = \"white\" }}, {{ set = \"black\" }}]"
        )
        .unwrap();
        for camera in cameras {
            writeln!(text, "[[camera]]\nname = {camera:?}\ndriver = \"twin\"").unwrap();
        }
    }
    text + "[twin]\nscene = \"complex-artefact.scene.toml\"\nseed = 1\n"
}

/// Processor time of the stages whose name begins so, in a cycle, ms.
fn processor_ms(result: &serde_json::Value, stage: &str) -> f64 {
    let stages = result["stages"].as_array().unwrap().iter();
    let own = stages.filter(|row| row["name"].as_str().unwrap().starts_with(stage));
    own.map(|row| row["cpu_ns"].as_f64().unwrap() * 1e-6).sum()
}

#[test]
#[ignore = "prints figures, some minutes: cargo test --release --test main cost_against_pairs -- --ignored --nocapture"]
fn cost_against_pairs() {
    let cell = Cell::new("pairs");
    let path = |name: &str| cell.small.folder.path().join(name);
    write(&path("sides-rig.toml"), &twin::thesis::rig_of_sides(8, 562, 375));
    for name in ["complex-artefact.plan.toml", "complex-artefact.scene.toml"] {
        std::fs::copy(config(name), path(name)).unwrap();
    }
    println!(
        "pairs | points | decode | matching | fusion | inspection | all, ms | all but inspection, a pair"
    );
    for pairs in [1, 2, 4, 8] {
        std::fs::write(path("sides.toml"), sides(pairs)).unwrap();
        let ran = cell.run("sides.toml", &["--cycles", "4"]);
        assert!(matches!(ran.status.code(), Some(0 | 1)), "{}", String::from_utf8_lossy(&ran.stderr));
        // The first cycle makes buffers.
        let warm = &crate::running::results(&cell.out())[1..];
        let median = |of: &dyn Fn(&serde_json::Value) -> f64| {
            let mut values: Vec<f64> = warm.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let names = ["decode", "matching", "fusion", "inspection"];
        let [decode, matching, fusion, inspection] = names.map(|name| median(&|r| processor_ms(r, name)));
        let points = median(&|r| r["points"].as_f64().unwrap_or(0.0));
        let flow = decode + matching + fusion;
        println!(
            "{pairs} | {points} | {decode:.1} | {matching:.1} | {fusion:.1} | {inspection:.1} | {:.1} | {:.1}",
            flow + inspection,
            flow / pairs as f64
        );
        std::fs::remove_dir_all(cell.out()).unwrap();
    }
}
