//! Projector boards through the programs: an emulated board at a Unix socket lights the scene of the twin, and what goes wrong with
//! it ends the cycle with a reason.

use crate::gige::{hashes, run, serve};
use crate::lights::{Witness, cell, images, load, points};
use crate::running::text;
use crate::screen::{Display, pixels};
use crate::support::fringecell_in;
use devices::lightcrafter_emulator::{
    BoardFaults, Dlpc350, Dlpc900, Emulator, SharedEmulator, picture_of_display,
};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

fn keys(controller: &str, socket: &str, more: &str) -> String {
    format!(
        "driver = \"lightcrafter\"\ncontroller = \"{controller}\"\nexposure_us = 10000\ndevice = \"{socket}\"\n{more}"
    )
}

/// A socket in a folder of its own: paths of sockets are short.
fn socket() -> (tempfile::TempDir, String) {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("board").display().to_string();
    (folder, path)
}

/// The images that `fringetool patterns` writes for the flash.
fn flash(config: &str, folder: &Path) -> Vec<Vec<u8>> {
    let out = folder.join("patterns");
    crate::support::fringetool(&["patterns", config, "--out", out.to_str().unwrap()]).expect_success();
    let mut files: Vec<_> = std::fs::read_dir(out.join("proj1"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "bmp"))
        .collect();
    files.sort();
    files.iter().map(|file| image::open(file).unwrap().into_rgb8().into_raw()).collect()
}

/// Exposure for which the served twin is as bright as the twin itself.
const EXPOSURE_US: f64 = 10000.0;

#[test]
fn a_cell_with_a_board_gives_the_bytes_of_the_twin() {
    for (test, controller, size_px, more) in [
        (40, "dlpc350", [912, 1140], "settle_ms = 1"),
        (41, "dlpc900", [1024, 768], "one_bit = true\nsettle_ms = 0"),
    ] {
        let (_sockets, socket) = socket();
        let (folder, twin, live) = cell(test, size_px, &keys(controller, &socket, more), EXPOSURE_US);
        let emulator = match controller {
            "dlpc350" => Emulator::new(Dlpc350::new(flash(&live, folder.path())), BoardFaults::default()),
            _ => Emulator::new(Dlpc900::new(5), BoardFaults::default()),
        };
        let board = SharedEmulator::new(emulator);
        let simulated = run(folder.path(), &twin, "twin", "2");
        assert!(simulated.status.success(), "{}", text(&simulated.stderr));
        let served = serve(&twin, test, &[]);
        let mut witness = Witness::new(test, images(&load(&live)));
        let _answering = board
            .serve(Path::new(&socket), move |board| {
                if let Some(picture) = board.shown() {
                    witness.sees(&picture);
                }
            })
            .unwrap();
        let ran = run(folder.path(), &live, "board", "2");
        assert!(ran.status.success(), "{}{}", text(&ran.stdout), text(&ran.stderr));
        drop(served);
        let (there, here) = (points(folder.path(), "twin"), points(folder.path(), "board"));
        assert!(here.len() > 1000 && there == here, "{} and {} bytes", there.len(), here.len());
        assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "board"));
        assert_eq!(board.lock().violations(), [] as [String; 0], "{controller}");
    }
}

/// Proves: a sequence that the board shows by itself, of the patterns sent to it or of those in flash, fires the cameras in its own time.
#[test]
fn a_board_that_fires_the_cameras_gives_the_bytes_of_the_twin() {
    for (test, controller, size_px, period_ms, more) in [
        (44, "dlpc900", [1024, 768], 40, ""),
        // While three patterns of an image stand the next one is loaded.
        (45, "dlpc350", [912, 1140], 70, "settle_ms = 200\n"),
    ] {
        let (_sockets, socket) = socket();
        let more =
            format!("period_us = {period_ms}000\ntrigger = \"sequenced\"\nperiod_ms = {period_ms}.0\n{more}");
        let keys = keys(controller, &socket, &more).replace("= 10000", &format!("= {period_ms}000"));
        let (folder, twin, live) = cell(test, size_px, &keys, EXPOSURE_US);
        let simulated = run(folder.path(), &twin, "twin", "2");
        assert!(simulated.status.success(), "{}", text(&simulated.stdout));
        let served = serve(&twin, test, &[]);
        let (patterns, mut witness) = (images(&load(&live)), Witness::new(test, Vec::new()));
        let emulator = match controller {
            "dlpc350" => Emulator::new(Dlpc350::new(flash(&live, folder.path())), BoardFaults::default()),
            _ => Emulator::new(Dlpc900::new(5), BoardFaults::default()),
        };
        let board = SharedEmulator::new(emulator);
        let answering = board.serve(Path::new(&socket), move |board| {
            if let Some((shown, period_us)) = board.take_sequence() {
                assert!(shown == patterns, "the sequence of the board is another one");
                witness.runs(shown.len(), period_us);
            }
        });
        let ran = run(folder.path(), &live, "board", "2");
        drop((served, answering));
        assert!(ran.status.success(), "{controller}: {}{}", text(&ran.stdout), text(&ran.stderr));
        assert_eq!(points(folder.path(), "twin"), points(folder.path(), "board"), "{controller}");
        assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "board"), "{controller}");
        assert_eq!(board.lock().violations(), [] as [String; 0], "{controller}");
    }
}

/// Proves: patterns on a screen behind the video input of a board light the scene of the twin, and a board without a signal is told.
#[test]
#[cfg_attr(not(xvfb), ignore = "no Xvfb: install it, then cargo test --test main lightcrafter::")]
fn a_board_behind_a_screen_gives_the_bytes_of_the_twin() {
    let (size_px, test) = ([912, 1140], 46);
    let display = Display::start(size_px, &[]);
    let (_sockets, socket) = socket();
    let more = format!(
        "source = \"video\"\ndisplay = \"{}\"\nposition_px = [0, 0]\nrefresh_hz = 100\ndelay_refreshes = 1",
        display.name
    );
    let (folder, twin, live) = cell(test, size_px, &keys("dlpc350", &socket, &more), EXPOSURE_US);
    let simulated = run(folder.path(), &twin, "twin", "2");
    assert!(simulated.status.success(), "{}", text(&simulated.stderr));
    let served = serve(&twin, test, &[]);
    let (client, plugged) = (display.client(), Arc::new(AtomicBool::new(true)));
    let cable = plugged.clone();
    let video = move || {
        let bgr = pixels(&client, size_px).filter(|_| cable.load(Ordering::Relaxed))?;
        Some(picture_of_display(&bgr))
    };
    let board = SharedEmulator::new(Emulator::new(Dlpc350::with_video(video), BoardFaults::default()));
    let mut witness = Witness::new(test, images(&load(&live)));
    let _answering = board.serve(Path::new(&socket), move |board| {
        if let Some(picture) = board.shown() {
            witness.sees(&picture);
        }
    });
    let ran = run(folder.path(), &live, "board", "2");
    let violations = board.lock().violations().to_vec();
    assert!(ran.status.success(), "{violations:?}\n{}{}", text(&ran.stdout), text(&ran.stderr));
    assert_eq!(points(folder.path(), "twin"), points(folder.path(), "board"));
    assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "board"));
    assert_eq!(violations, [] as [String; 0]);
    plugged.store(false, Ordering::Relaxed);
    let dark = run(folder.path(), &live, "dark", "1");
    drop(served);
    let said = text(&dark.stdout) + &text(&dark.stderr);
    assert_eq!(dark.status.code(), Some(1), "{said}");
    assert!(said.contains("main status"), "{:?} {said}", board.lock().violations());
}

#[test]
fn a_board_that_is_not_there_or_vanishes_is_told_by_name() {
    let (_sockets, socket) = socket();
    let (folder, twin, live) = cell(42, [1024, 768], &keys("dlpc900", &socket, "settle_ms = 0"), EXPOSURE_US);
    let served = serve(&twin, 42, &[]);
    let absent = run(folder.path(), &live, "absent", "1");
    let said = text(&absent.stdout) + &text(&absent.stderr);
    assert_eq!(absent.status.code(), Some(1), "{said}");
    // A path that is no socket is looked for among the devices of the USB.
    assert!(said.contains("projector \"proj1\": no board is connected (USB 0451:c900)"), "{said}");
    // The cable comes out in the middle of the sequence.
    let faults = BoardFaults { vanish_after_starts: Some(4), ..BoardFaults::default() };
    let board = SharedEmulator::new(Emulator::new(Dlpc900::new(5), faults));
    let mut witness = Witness::new(42, images(&load(&live)));
    let _answering = board.serve(Path::new(&socket), move |board| {
        if let Some(picture) = board.shown() {
            witness.sees(&picture);
        }
    });
    let lost = run(folder.path(), &live, "lost", "1");
    drop(served);
    let said = text(&lost.stdout) + &text(&lost.stderr);
    assert_eq!(lost.status.code(), Some(1), "{said}");
    assert!(said.contains("projector \"proj1\" (dlpc900 at "), "{said}");
    assert!(!folder.path().join("lost/cloud.ply").exists());
}

/// Size of the board, keys of the projector, exposure of the cameras, and what the message holds.
type Board = ([u32; 2], String, f64, Vec<&'static str>);

const BOARD: &str = "controller = \"dlpc350\"\nexposure_us = 8334";

/// Boards that cannot be, and one that can.
fn boards() -> Vec<Board> {
    let board = BOARD;
    vec![
        ([912, 1140], board.to_owned(), 16668.0, vec![]),
        (
            [912, 1140],
            "exposure_us = 8334".into(),
            16668.0,
            vec!["projector[0]", "controller of projector", "add controller ="],
        ),
        (
            [912, 1140],
            "controller = \"dlpc300\"".into(),
            1e4,
            vec!["controller", "dlpc300", "dlpc350, dlpc900"],
        ),
        (
            [608, 684],
            board.to_owned(),
            16668.0,
            vec!["projector[0].width_px", "608 × 684 px", "912 × 1140 px"],
        ),
        (
            [912, 1140],
            board.replace("8334", "8000"),
            16000.0,
            vec![
                "projector[0].exposure_us",
                "8000 µs",
                "8333 µs and more for patterns of 8 bits",
                "write exposure_us = 8333",
            ],
        ),
        (
            [912, 1140],
            format!("{board}\nperiod_us = 8400"),
            16800.0,
            vec!["projector[0].period_us", "8400 µs", "exposure_us = 8334, or 8564 µs and more"],
        ),
        (
            [912, 1140],
            format!("{board}\nsource = \"usb\""),
            16668.0,
            vec!["projector[0].source", "\"usb\"", "\"flash\" or \"video\" with the dlpc350"],
        ),
    ]
}

/// Boards that are to run their sequence by themselves.
fn running_boards() -> Vec<Board> {
    let board = BOARD;
    vec![
        (
            [912, 1140],
            format!(
                "{board}\nsource = \"video\"\noutput = \"HDMI-1\"\ntrigger = \"sequenced\"\nperiod_ms = 10.0"
            ),
            5000.0,
            vec!["projector[0].trigger", "shows frame by frame", "\"flash\" or \"usb\""],
        ),
        (
            [912, 1140],
            format!("{board}\ntrigger = \"sequenced\"\nperiod_ms = 8.334"),
            5000.0,
            vec![
                "projector[0].exposure_us",
                "8334 µs",
                "83334 µs and more: while 3 patterns of an image stand",
                "takes 250 ms",
            ],
        ),
        (
            [912, 1140],
            format!("{board}\ntrigger = \"sequenced\"\nperiod_ms = 8.334\nsettle_ms = 25"),
            5000.0,
            vec![],
        ),
    ]
}

/// More of them: keys of one board or source under another, and times.
fn more_boards() -> Vec<Board> {
    vec![
        (
            [1024, 768],
            "controller = \"dlpc900\"\nexposure_us = 5000\ntrigger = \"sequenced\"\nperiod_ms = 6.0".into(),
            4000.0,
            vec!["projector[0].period_ms", "6 ms", "5 ms, the period of the board"],
        ),
        (
            [912, 1140],
            format!("{BOARD}\nled = \"infrared\""),
            16668.0,
            vec!["projector[0].led", "infrared", "white"],
        ),
        (
            [912, 1140],
            format!("{BOARD}\noutput = \"HDMI-1\""),
            16668.0,
            vec!["projector[0].output", "source = \"video\""],
        ),
        (
            [912, 1140],
            format!("{BOARD}\nfirst_image = 300"),
            16668.0,
            vec!["projector[0].first_image", "300", "0 … 255"],
        ),
        (
            [912, 1140],
            format!("{BOARD}\nsettle_ms = -1"),
            16668.0,
            vec!["projector[0].settle_ms", "-1", "0 … 10000 ms"],
        ),
        (
            [912, 1140],
            BOARD.to_owned(),
            10000.0,
            vec!["camera[0].exposure_us", "10000 µs", "a multiple of 8334 µs", "write exposure_us = 8334"],
        ),
        (
            [912, 1140],
            format!("{BOARD}\nsource = \"video\"\noutput = \"HDMI-1\"\nrefresh_hz = 120.5"),
            8298.75,
            vec![
                "projector[0].exposure_us",
                "8334 µs",
                "at most 8298 µs, a refresh of the video at 120.5 Hz",
            ],
        ),
        (
            [912, 1140],
            format!("{BOARD}\nsource = \"video\""),
            16667.0,
            vec!["projector[0]", "either output or position_px", "xrandr"],
        ),
        (
            [1024, 768],
            "controller = \"dlpc900\"\nexposure_us = 4065\nsettle_ms = 10000".into(),
            4065.0,
            vec!["limits.cycle_deadline_ms", "60000 ms", "at least 140057 ms", "14 frames"],
        ),
    ]
}

/// Proves: a sequence that no board can hold, or run by itself, is refused when the configuration is read.
#[test]
fn a_schedule_refuses_more_patterns_than_a_board_has_room_for() {
    let board = |controller: &str, more: &str| {
        format!("driver = \"lightcrafter\"\ncontroller = \"{controller}\"\nexposure_us = 70000\n{more}")
    };
    let runs = "trigger = \"sequenced\"\nperiod_ms = 70.0\nsettle_ms = 200";
    let many = |bits: usize| format!("{{ set = \"white\" }},\n  {}", "{ set = \"black\" },\n  ".repeat(bits));
    let one_bit = format!("{runs}\none_bit = true");
    // Beside the 14 frames of the sequence.
    for (controller, size_px, more, extra, expected) in [
        ("dlpc350", [912, 1140], runs, 114, ""),
        (
            "dlpc350",
            [912, 1140],
            runs,
            115,
            "129 patterns of a sequence that runs by itself is not allowed: at most 128 with the dlpc350",
        ),
        ("dlpc900", [1024, 768], &one_bit, 236, ""),
        (
            "dlpc900",
            [1024, 768],
            &one_bit,
            237,
            "251 patterns of a sequence that runs by itself is not allowed: at most 250 with the dlpc900",
        ),
        ("dlpc900", [1024, 768], "", 60, "25 images of 24 bits in its memory is not allowed: at most 17"),
    ] {
        let exposure_us = if more.is_empty() { 70_000.0 } else { 60_000.0 };
        let (folder, _, live) = cell(47, size_px, &board(controller, more), exposure_us);
        let text = std::fs::read_to_string(&live).unwrap();
        std::fs::write(&live, text.replace("{ set = \"white\" },", &many(extra))).unwrap();
        let ran = fringecell_in(folder.path(), &["schedule", &live]);
        let code = if expected.is_empty() { Some(0) } else { Some(2) };
        assert_eq!(ran.code, code, "{controller}, {extra} more: {}", ran.stderr);
        assert!(ran.stderr.contains(expected), "{controller}, {extra} more: {}", ran.stderr);
    }
}

#[test]
fn a_schedule_refuses_what_the_board_cannot_show() {
    let keys = |more: &str| format!("driver = \"lightcrafter\"\n{more}");
    for (size_px, more, exposure_us, expected) in
        boards().into_iter().chain(running_boards()).chain(more_boards())
    {
        let (folder, _, live) = cell(43, size_px, &keys(&more), exposure_us);
        let ran = fringecell_in(folder.path(), &["schedule", &live]);
        if expected.is_empty() {
            ran.expect_success();
            continue;
        }
        assert_eq!(ran.code, Some(2), "{more}: {}", ran.stderr);
        let said = ran.stderr;
        for part in expected {
            assert!(said.contains(part), "{more}: {said} lacks {part}");
        }
    }
}
