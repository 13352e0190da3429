//! Cameras by the system library Aravis: the simulated ones give the bytes of the twin, and its own simulated camera is found,
//! set and triggered. It has no simulated camera on USB.

use super::{cell, checked_cell, hashes, network, run, serve};
use crate::support::fringetool;
use devices::conformance::check_camera;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(20);

/// Side of a frame of the library's simulated camera, px.
const FAKE_PX: u32 = 512;

/// The configuration with cameras by Aravis.
fn by_aravis(config: &str) {
    let text = std::fs::read_to_string(config).unwrap();
    let text = text.replace("driver = \"genicam\"", "driver = \"genicam\"\ntransport = \"aravis\"");
    std::fs::write(config, text).unwrap();
}

fn said(ran: &Output) -> String {
    String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr)
}

#[test]
fn a_cell_by_aravis_gives_the_bytes_of_the_twin() {
    let (folder, simulated, live) = cell(24);
    by_aravis(&live);
    let twin = run(folder.path(), &simulated, "twin", "2");
    assert!(twin.status.success(), "{}", said(&twin));
    let served = serve(&simulated, 24, &["drop=11", "duplicate=13", "swap=7"]);
    let ran = run(folder.path(), &live, "net", "2");
    assert!(ran.status.success(), "{}", said(&ran));
    drop(served);
    assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "net"));
    let result = std::fs::read_to_string(folder.path().join("net/result.json")).unwrap();
    let result: serde_json::Value = serde_json::from_str(&result).unwrap();
    let state = &result["reports"]["frame/cam1"];
    let count = |key: &str| state["link"][key].as_u64().unwrap();
    assert!(count("packets") > 100 && count("resent_packets") > 10, "{state}");
    assert_eq!((count("lost_packets"), count("incomplete_frames")), (0, 0), "{state}");
    assert!(state["temperature_c"].is_number(), "{state}");
}

#[test]
fn a_sequence_that_the_projector_fires_comes_by_aravis() {
    let (folder, simulated, live) = checked_cell(25, Some(8.0));
    by_aravis(&live);
    let twin = run(folder.path(), &simulated, "twin", "2");
    assert!(twin.status.success(), "{}", said(&twin));
    let served = serve(&simulated, 25, &["drop=11", "duplicate=13", "swap=7"]);
    let ran = run(folder.path(), &live, "net", "2");
    drop(served);
    assert!(ran.status.success(), "{}", said(&ran));
    assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "net"));
}

#[test]
fn what_is_lost_for_good_ends_the_cycle_by_aravis_too() {
    for (test, faults, reason) in [
        (26, vec!["drop=11", "no-resend"], "is not complete ("),
        (27, vec!["ignore-trigger=9"], "no frame within"),
    ] {
        let (folder, simulated, live) = cell(test);
        by_aravis(&live);
        let served = serve(&simulated, test, &faults);
        let ran = run(folder.path(), &live, "net", "1");
        drop(served);
        assert_eq!(ran.status.code(), Some(1), "{faults:?}: {}", said(&ran));
        assert!(said(&ran).contains(reason), "{faults:?}: {}", said(&ran));
    }
}

/// A camera of the cell, opened as its stage does.
fn opened(config: &str) -> (Box<dyn devices::Camera>, usize, usize) {
    let cell = devices::load(Path::new(config), &cell::Options::default()).unwrap();
    devices::check(&cell).unwrap();
    let camera = &cell.config.cameras[0];
    let bytes = (camera.width_px * camera.height_px) as usize;
    (devices::camera(&cell, 0).unwrap(), cell.config.projectors[0].frames(), bytes)
}

#[test]
fn a_camera_by_aravis_does_the_duties_of_every_driver_and_is_found_again() {
    let (_folder, simulated, live) = cell(28);
    by_aravis(&live);
    let served = serve(&simulated, 28, &[]);
    let (mut camera, frames, bytes) = opened(&live);
    check_camera(camera.as_mut(), 0, frames, bytes, LIMIT).unwrap();
    drop(served);
    let mut out = vec![0; bytes];
    camera.begin(1).unwrap();
    let lost = camera.expose(0, 0, &mut out).unwrap_err().to_string();
    assert!(lost.starts_with("camera \"cam1\": "), "{lost}");
    let gone = camera.begin(2).unwrap_err().to_string();
    let [a, b, c] = network(28);
    assert!(gone.starts_with(&format!("camera \"cam1\": connecting to {a}.{b}.{c}.11: ")), "{gone}");
    let _served = serve(&simulated, 28, &[]);
    check_camera(camera.as_mut(), 0, frames, bytes, LIMIT).unwrap();
}

/// The library's own simulated camera, stopped when dropped.
struct Fake(Child);

impl Drop for Fake {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn fake(address: &str, serial: &str) -> Fake {
    let mut command = Command::new("arv-fake-gv-camera-0.8");
    command.args(["-i", address, "-s", serial]).stdout(Stdio::null()).stderr(Stdio::null());
    Fake(command.spawn().unwrap())
}

#[test]
#[cfg_attr(
    not(fake_camera),
    ignore = "needs arv-fake-gv-camera-0.8: apt-get install aravis-tools, then cargo test --features aravis --test main aravis"
)]
fn the_simulated_camera_of_aravis_is_found_set_and_triggered() {
    let (folder, _, live) = cell(29);
    let [a, b, c] = network(29);
    // It answers at the address of an adapter alone.
    let serial = format!("FC{}", std::process::id());
    let _fake = fake("127.0.0.1", &serial);
    let start = Instant::now();
    while !fringetool(&["cameras"]).stdout.contains(&serial) {
        assert!(start.elapsed() < LIMIT, "the camera does not answer");
    }
    let path = folder.path().join("fake.toml");
    let mut rig = twin::thesis::rig(FAKE_PX, FAKE_PX);
    rig.cameras.truncate(2);
    rig.projectors.truncate(1);
    rig.pairs.truncate(1);
    files::rig_file::write_rig(&folder.path().join("fake.rig.toml"), &rig, &toml::Table::new(), None)
        .unwrap();
    let text = std::fs::read_to_string(&live).unwrap().replace("rig.toml", "fake.rig.toml");
    let found = format!("address = \"{a}.{b}.{c}.11\"");
    let set = "exposure_us = 8000.0\npacket_bytes = 1400";
    let set = format!("transport = \"aravis\"\nserial = \"{serial}\"\n{set}");
    std::fs::write(&path, text.replace(&found, &set)).unwrap();
    let (mut camera, frames, bytes) = opened(path.to_str().unwrap());
    check_camera(camera.as_mut(), 0, frames, bytes, LIMIT).unwrap();
    assert_eq!(camera.set_exposure_us(5000.0).unwrap(), 5000.0);
    let link = camera.state().link.unwrap();
    assert!(link.packets > 0 && link.incomplete_frames == 0, "{link:?}");
}
