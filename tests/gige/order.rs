//! Whose frames come when: a projector that fires the cameras, frames out of order, triggers that a camera missed.

use super::{checked_cell, hashes, run, serve};
use crate::support::SMALL_PX;
use devices::{Camera, LoadedCell};
use fringe::decode::{DecodeError, DecodeReport, Decoder, OrderEvent};
use fringe::frame::FrameView;
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use std::path::Path;

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

/// Decodes frames of the first projector's sequence as a cell does, each frame replaced by the one that the event leaves in its place.
fn decoded(
    cell: &LoadedCell,
    camera: usize,
    frames: &[Vec<u8>],
    event: OrderEvent,
) -> Result<DecodeReport, DecodeError> {
    let (light, node) = (&cell.config.projectors[0], &cell.graph.cameras[camera]);
    let settings = cell.config.settings.decode.of_camera(cell.config.rig.sensor(&node.name));
    let [width, height] = [node.width_px, node.height_px];
    let mut decoder = Decoder::new(&light.sequence, width, height, 255, light.size_px(), &settings)?;
    for index in 0..frames.len() {
        // As the served cameras do it: beyond the last pattern the first one comes again.
        let shown = event.shown(index).unwrap_or(0) % frames.len();
        decoder.push(index, &FrameView::from_bytes(width, height, 255, &frames[shown]).unwrap())?;
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X)?);
    decoder.finish(Axis::X, &mut map.view_mut())
}

/// The frames that a camera of the twin takes of a part.
fn frames_of(eye: &mut dyn Camera, cycle: u64, count: usize) -> Vec<Vec<u8>> {
    eye.begin(cycle).unwrap();
    let take = |frame: usize| {
        let mut pixels = vec![0; (SMALL_PX.0 * SMALL_PX.1) as usize];
        eye.expose(0, frame, &mut pixels).unwrap();
        pixels
    };
    (0..count).map(take).collect()
}

/// Proves: whatever single event happens to the order of the frames, it is named, or its frames are those of the sequence.
#[test]
fn every_event_of_a_storm_is_named() {
    let (_folder, simulated, _) = checked_cell(17, None);
    let cell = devices::load(Path::new(&simulated), &cell::Options::default()).unwrap();
    let count = cell.config.projectors[0].frames();
    let (mut named, mut others) = (0, Vec::new());
    for camera in 0..2 {
        let mut eye = devices::camera(&cell, camera).unwrap();
        let frames = frames_of(eye.as_mut(), camera as u64, count);
        for event in OrderEvent::all(count).step_by(2) {
            match decoded(&cell, camera, &frames, event) {
                Err(DecodeError::Order { event: told, .. }) if told == event => named += 1,
                Err(DecodeError::Order { event: told, .. }) => others.push(format!("{event}: {told}")),
                Err(error) => panic!("camera {camera}, {event}: {error}"),
                // The first bit is dark wherever this part is, as black is.
                Ok(report) => assert_eq!(event, OrderEvent::Exchanged(1, 7), "{:?}", report.order),
            }
        }
    }
    // The first pattern twice or a step too early, and the last one lost or twice, are the same frames by another name.
    assert!(others.len() <= 8 && named > 130, "{named} named, by another name: {others:#?}");
}

/// Proves: frames that show their patterns are no wrong code, however little of the code a part sees: parts of a storm whose frames were taken for
/// others before.
#[test]
fn frames_in_order_are_decoded_from_every_side_of_a_part() {
    let (_folder, simulated, _) = checked_cell(19, None);
    let cell = devices::load(Path::new(&simulated), &cell::Options::default()).unwrap();
    let count = cell.config.projectors[0].frames();
    let parts = [(0, vec![97, 112, 145, 209, 323, 453, 0, 1, 2]), (1, vec![330, 346, 0, 1, 2])];
    for (camera, cycles) in parts {
        let mut eye = devices::camera(&cell, camera).unwrap();
        for cycle in cycles {
            let frames = frames_of(eye.as_mut(), cycle, count);
            // An event beyond the sequence is none.
            let report = decoded(&cell, camera, &frames, OrderEvent::Foreign(count));
            let report = report.unwrap_or_else(|error| panic!("camera {camera}, cycle {cycle}: {error}"));
            // What is left are the edges of the part, a few pixels apart at this size.
            assert!(report.contradiction() < 0.25, "camera {camera}, cycle {cycle}: {report:?}");
        }
    }
}
