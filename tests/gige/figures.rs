//! Figures of cameras on the network, and the storm: minutes, so on request only.

use super::{cell_of, checked_cell, run_json, serve};
use crate::support::SMALL_PX;
use devices::{Camera, CameraState, LinkCounts};
use ipc::os::{Usage, now_ns};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// What came of a stream.
#[derive(Default)]
struct Figures {
    frames: usize,
    seconds: f64,
    cpu_seconds: f64,
    link: LinkCounts,
    /// Hash of every frame, camera by camera, in order.
    hashes: Vec<u128>,
}

/// Takes cycles from the cameras of a configuration as a cell does, all cameras at once.
fn stream(config: &str, cycles: u64, hashed: bool) -> Figures {
    let cell = devices::load(Path::new(config), &cell::Options::default()).unwrap();
    let count = cell.graph.cameras.len();
    let mut cameras: Vec<Box<dyn Camera>> =
        (0..count).map(|number| devices::camera(&cell, number).unwrap()).collect();
    let mut projector = devices::projector(&cell).unwrap();
    let bytes = |camera: usize| {
        let node = &cell.graph.cameras[camera];
        (node.width_px * node.height_px) as usize
    };
    let mut buffers: Vec<Vec<u8>> = (0..count).map(|camera| vec![0; bytes(camera)]).collect();
    let mut figures = Figures::default();
    for cycle in 0..cycles {
        projector.begin(cycle, now_ns()).unwrap();
        for camera in &mut cameras {
            camera.begin(cycle).unwrap();
        }
        let (start_ns, before) = (now_ns(), Usage::now());
        for frame in 0..cell.graph.projectors[0].frames {
            projector.show(0, frame, now_ns()).unwrap();
            std::thread::scope(|scope| {
                for (camera, buffer) in cameras.iter_mut().zip(&mut buffers) {
                    scope.spawn(move || camera.expose(0, frame, buffer).unwrap());
                }
            });
            figures.frames += count;
            if hashed {
                figures.hashes.extend(buffers.iter().map(|buffer| ipc::output_hash(buffer)));
            }
        }
        figures.seconds += (now_ns() - start_ns) as f64 * 1e-9;
        figures.cpu_seconds += Usage::now().since(before).cpu_ns as f64 * 1e-9;
    }
    for camera in &mut cameras {
        let CameraState { link, .. } = camera.state();
        let link = link.unwrap_or_default();
        figures.link.packets += link.packets;
        figures.link.lost_packets += link.lost_packets;
        figures.link.resent_packets += link.resent_packets;
        figures.link.dropped_packets += link.dropped_packets;
    }
    figures
}

fn print(what: &str, figures: &Figures) {
    let Figures { frames, seconds, cpu_seconds, link, .. } = figures;
    println!(
        "{what}: {frames} frames in {seconds:.1} s, {:.1} frames/s, processor {:.0} % of a core, {} packets, {} lost, {} resent, {} dropped by the \
         receive buffer",
        *frames as f64 / seconds,
        100.0 * cpu_seconds / seconds,
        link.packets,
        link.lost_packets,
        link.resent_packets,
        link.dropped_packets
    );
}

#[test]
#[ignore = "minutes: cargo test --release --test main frames_over_loopback -- --ignored --nocapture"]
fn frames_over_loopback() {
    for (test, size_px, cameras, cycles) in [(20, (1124, 750), 4, 8), (21, (4496, 3000), 1, 3)] {
        let (_folder, simulated, live) = cell_of(test, size_px, cameras);
        let _served = serve(&simulated, test, &[]);
        let figures = stream(&live, cycles, false);
        print(&format!("{cameras} camera(s) of {} × {} px", size_px.0, size_px.1), &figures);
        assert_eq!(figures.link.lost_packets, 0);
    }
}

#[test]
#[ignore = "minutes: cargo test --release --test main ten_thousand_frames -- --ignored --nocapture"]
fn ten_thousand_frames_are_those_of_the_twin_whatever_the_network_does() {
    let (_folder, simulated, live) = cell_of(22, SMALL_PX, 2);
    let _served = serve(&simulated, 22, &["drop=100", "duplicate=97", "swap=89"]);
    // Two cameras, 14 frames a cycle.
    let cycles = 10_000_u64.div_ceil(28);
    let came = stream(&live, cycles, true);
    let twin = stream(&simulated, cycles, true);
    print("1 % dropped, 1 % twice, 1 % exchanged", &came);
    assert!(came.hashes.len() >= 10_000 && came.hashes == twin.hashes, "{} frames", came.hashes.len());
    assert!(came.link.resent_packets > 0);
}

/// Outcome and hashes of each cycle of a run.
fn outcomes(json: &Path) -> BTreeMap<u64, (String, Value)> {
    let text = std::fs::read_to_string(json).unwrap();
    let run: Value = serde_json::from_str(&text).unwrap();
    let results = run["results"].as_array().unwrap();
    let outcome = |result: &Value| {
        let outcome = result["outcome"].as_str().unwrap().to_owned();
        (result["number"].as_u64().unwrap(), (outcome, result["hashes"].clone()))
    };
    results.iter().map(outcome).collect()
}

/// Every cycle of a storm has one outcome; each that is ok gives the bytes of the twin.
fn storm(test: u8, cycles: u64) {
    let (folder, simulated, live) = checked_cell(test, None);
    let _served = serve(&simulated, test, &["drop=100", "duplicate=97", "swap=89", "storm=7"]);
    let came = outcomes(&run_json(folder.path(), &live, "net", cycles));
    let twin = outcomes(&run_json(folder.path(), &simulated, "twin", cycles));
    assert_eq!(came.len() as u64, cycles);
    // How often, and the first cycle.
    let mut reasons: BTreeMap<String, (usize, u64)> = BTreeMap::new();
    for (number, (outcome, hashes)) in &came {
        if outcome == "ok" {
            assert_eq!(hashes, &twin[number].1, "cycle {number} is ok and has other bytes than the twin");
        }
        // Numbers make one reason of many.
        let reason: String = outcome.chars().filter(|c| !c.is_ascii_digit()).collect();
        reasons.entry(reason).or_insert((0, *number)).0 += 1;
    }
    for (reason, (count, first)) in &reasons {
        println!("{count:4}, first cycle {first:3}: {reason}");
    }
    assert!(reasons.get("ok").is_some_and(|(ok, _)| *ok as u64 > cycles / 8), "{reasons:?}");
    assert!(reasons.len() > 1, "{reasons:?}");
}

#[test]
fn a_short_storm_on_the_network_gives_no_wrong_cloud() {
    storm(23, 12);
}

#[test]
#[ignore = "a quarter of an hour: cargo test --release --test main five_hundred_cycles -- --ignored --nocapture"]
fn five_hundred_cycles_of_a_storm_on_the_network_give_no_wrong_cloud() {
    // Fewer where a machine has less time.
    let cycles = std::env::var("STORM_CYCLES").ok().and_then(|text| text.parse().ok());
    storm(24, cycles.unwrap_or(500));
}
