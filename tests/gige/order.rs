//! Whose frames come when: a projector that fires the cameras, frames out of order, triggers that a camera missed.

use super::{checked_cell, hashes, run, serve};

#[test]
fn a_projector_that_fires_the_cameras_gives_the_bytes_of_the_twin() {
    let (folder, simulated, live) = checked_cell(7, Some(8.0));
    let twin = run(folder.path(), &simulated, "twin", "2");
    assert!(twin.status.success(), "{}", String::from_utf8_lossy(&twin.stderr));
    let served = serve(&simulated, 7, &["drop=11", "duplicate=13", "swap=7"]);
    let ran = run(folder.path(), &live, "net", "3");
    let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
    assert!(ran.status.success(), "{text}");
    drop(served);
    let shorter = run(folder.path(), &simulated, "third", "3");
    assert!(shorter.status.success());
    assert_eq!(hashes(folder.path(), "third"), hashes(folder.path(), "net"));
}

#[test]
fn frames_out_of_order_are_named_in_the_outcome_of_every_cycle() {
    for (test, period_ms, fault, reason) in [
        (8, None, "exchange=4", "frames 4 and 5 are exchanged"),
        (9, None, "lost=9", "frame 9 was lost"),
        (10, Some(8.0), "twice=10", "pattern 9 was taken twice"),
        (11, Some(8.0), "repeat=6", "frame 6 shows pattern 5 once more"),
    ] {
        let (folder, simulated, live) = checked_cell(test, period_ms);
        let served = serve(&simulated, test, &[fault]);
        let ran = run(folder.path(), &live, "net", "2");
        drop(served);
        let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(1), "{fault}: {text}");
        assert!(text.matches(reason).count() >= 2, "{fault}: {text}");
        assert!(!folder.path().join("net/cloud.ply").exists(), "{fault}: a cloud of wrong frames");
    }
}

#[test]
fn a_trigger_that_a_camera_missed_ends_the_cycle_with_its_reason() {
    let (folder, simulated, live) = checked_cell(12, Some(8.0));
    let served = serve(&simulated, 12, &["ignore-trigger=9"]);
    let ran = run(folder.path(), &live, "net", "1");
    drop(served);
    let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
    assert_eq!(ran.status.code(), Some(1), "{text}");
    assert!(text.contains("that the projector fires was lost"), "{text}");
}
