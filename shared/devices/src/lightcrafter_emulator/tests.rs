//! The driver against boards that refuse whatever the guides do not document, and tell what their mirrors show.

use super::{Board, BoardFaults, Dlpc350, Dlpc900, Emulator, SharedEmulator};
use crate::light::Light;
use crate::lightcrafter::LightCrafter;
use crate::lightcrafter::REPORT_BYTES;
use cell::configuration::{Driver, LightCrafterSettings, ProjectorConfig};
use cell::lightcrafter::{Controller, Led, PatternSource, draw, image_count, places};
use fringe::pattern::{Axis, PatternSet};

fn projector(controller: Controller, size_px: [u32; 2], one_bit: bool) -> ProjectorConfig {
    let usb = controller == Controller::Dlpc900;
    let exposure_us = controller.least_exposure_us(8);
    let sequence = vec![
        PatternSet::sine(Axis::X, 16.0, 4),
        PatternSet::gray(Axis::Y, 3, 8.0),
        PatternSet::White {},
        PatternSet::Black {},
    ];
    ProjectorConfig {
        lightcrafter: Some(LightCrafterSettings {
            controller,
            source: if usb { PatternSource::Usb } else { PatternSource::Flash },
            exposure_us,
            period_us: exposure_us,
            led: Led::of_name("green").unwrap(),
            one_bit,
            first_image: if usb { 0 } else { 2 },
            settle_ms: 0,
            device: None,
            screen: None,
        }),
        ..ProjectorConfig::new("proj1", Driver::LightCrafter, size_px, sequence)
    }
}

/// A DLPC350 whose flash has two images of others in front of those of the projector.
fn flashed(projector: &ProjectorConfig) -> Dlpc350 {
    let one_bit = projector.lightcrafter.as_ref().unwrap().one_bit;
    let placed = places(projector.pattern_bits(one_bit).unwrap());
    let empty = vec![0; (projector.width_px * projector.height_px * 3) as usize];
    let mut images = vec![empty; image_count(&placed)];
    for (frame, place) in placed.iter().enumerate() {
        draw(&mut images[place.image], *place, &projector.image_u8(frame).unwrap().unwrap());
    }
    images.splice(0..0, [vec![7; 30], vec![9; 30]]);
    Dlpc350::new(images)
}

fn small() -> ProjectorConfig {
    projector(Controller::Dlpc350, [91, 57], false)
}

fn plugged(board: impl Board + 'static, faults: BoardFaults) -> SharedEmulator {
    SharedEmulator::new(Emulator::new(board, faults))
}

fn open(projector: &ProjectorConfig, board: &SharedEmulator) -> Result<LightCrafter, String> {
    let settings = projector.lightcrafter.as_ref().unwrap();
    LightCrafter::over(Box::new(board.clone()), "emulated", projector, settings).map_err(|e| e.to_string())
}

fn expect_every_frame(projector: &ProjectorConfig, board: &SharedEmulator) {
    let mut light = open(projector, board).unwrap();
    light.darken().unwrap();
    assert_eq!(board.lock().shown(), None);
    // Forwards, then in an order that jumps between images.
    let frames = projector.frames();
    for frame in (0..frames).chain((0..frames).map(|n| n * 5 % frames)) {
        light.show(frame).unwrap();
        let shown = board.lock().shown();
        assert!(shown == Some(projector.image_u8(frame).unwrap().unwrap()), "frame {frame}");
    }
    let beyond = light.show(frames).unwrap_err().to_string();
    assert!(beyond.contains("has no frame 10"), "{beyond}");
    light.darken().unwrap();
    assert_eq!(board.lock().shown(), None);
    assert_eq!(board.lock().violations(), [] as [String; 0]);
}

#[test]
fn a_dlpc350_shows_each_frame_from_its_flash() {
    for one_bit in [false, true] {
        let projector = projector(Controller::Dlpc350, [91, 57], one_bit);
        let board = plugged(flashed(&projector), BoardFaults::default());
        expect_every_frame(&projector, &board);
    }
}

/// Proves: the sequence that the board shows by itself is that of the projector, image after image, once, with dark times and without.
#[test]
fn a_dlpc350_runs_its_sequence_from_flash() {
    for (one_bit, dark_us) in [(false, 0), (true, 0), (false, 300)] {
        let mut projector = projector(Controller::Dlpc350, [91, 57], one_bit);
        let settings = projector.lightcrafter.as_mut().unwrap();
        // As long as an image takes from flash while three patterns of the one before it stand.
        settings.exposure_us = 70_000;
        settings.period_us = 70_000 + dark_us;
        let board = plugged(flashed(&projector), BoardFaults::default());
        let mut light = open(&projector, &board).unwrap();
        for _ in 0..2 {
            light.darken().unwrap();
            assert!(board.lock().take_sequence().is_none());
            light.run().unwrap();
            let (shown, period_us) = board.lock().take_sequence().unwrap();
            let expected: Vec<Vec<u8>> =
                (0..projector.frames()).map(|frame| projector.image_u8(frame).unwrap().unwrap()).collect();
            assert!(shown == expected && period_us == 70_000 + dark_us);
        }
        assert_eq!(board.lock().violations(), [] as [String; 0]);
    }
}

/// Proves: a board whose images come too late is refused by the emulated one, as the configuration does before.
#[test]
fn images_that_are_not_loaded_in_time_are_no_sequence() {
    let projector = small();
    let board = plugged(flashed(&projector), BoardFaults::default());
    let mut light = open(&projector, &board).unwrap();
    let error = light.run().unwrap_err().to_string();
    assert!(error.contains("command 0x1a24 (start or stop): the board refuses it"), "{error}");
    assert!(board.lock().violations()[0].contains("not loaded when its turn comes"));
}

#[test]
fn a_dlpc900_shows_each_frame_that_was_sent_to_one_controller_or_two() {
    for (hardware, size_px, one_bit) in
        [(1, [1920, 1080], false), (1, [1920, 1080], true), (2, [2560, 1600], false), (5, [1024, 768], true)]
    {
        let projector = projector(Controller::Dlpc900, size_px, one_bit);
        let board = plugged(Dlpc900::new(hardware), BoardFaults::default());
        expect_every_frame(&projector, &board);
    }
}

#[test]
fn a_board_of_another_size_or_with_too_few_images_is_refused() {
    let wide = projector(Controller::Dlpc900, [2560, 1600], true);
    let error = open(&wide, &plugged(Dlpc900::new(1), BoardFaults::default())).err().unwrap();
    assert!(error.contains("DLP6500 of 1920 × 1080 px") && error.contains("2560 × 1600"), "{error}");
    let unknown = open(&wide, &plugged(Dlpc900::new(3), BoardFaults::default())).err().unwrap();
    assert!(unknown.contains("0x03 is none of"), "{unknown}");
    let projector = small();
    let error =
        open(&projector, &plugged(Dlpc350::new(vec![vec![0; 9]; 4]), BoardFaults::default())).err().unwrap();
    assert!(error.contains("image 4 (from 0) is needed, the flash has 4"), "{error}");
}

#[test]
fn what_goes_wrong_on_the_cable_is_told_with_the_command() {
    let refuse = BoardFaults { refuse: Some(0x1a24), ..BoardFaults::default() };
    let silent = BoardFaults { silent: Some(0x1a31), ..BoardFaults::default() };
    let short = BoardFaults { short: Some(0x1a0a), ..BoardFaults::default() };
    let forget = BoardFaults { forget: Some(0x1a29), ..BoardFaults::default() };
    let vanish = BoardFaults { vanish_after: Some(40), ..BoardFaults::default() };
    let projector = small();
    for (faults, expected) in [
        (refuse, "command 0x1a24 (start or stop): the board refuses it"),
        (silent, "command 0x1a31 (control of the pattern table): no answer within 1 s"),
        (short, "command 0x1a0a (status of the hardware): an answer of 10 bytes, reports have 64"),
        (forget, "command 0x1a29 (exposure and period): [8d, 20, 00, 00"),
        (vanish, "no such device"),
    ] {
        let board = plugged(flashed(&projector), faults);
        let found = open(&projector, &board).and_then(|mut light| {
            (0..projector.frames()).try_for_each(|frame| light.show(frame)).map_err(|e| e.to_string())
        });
        let error = found.unwrap_err();
        assert!(error.contains(expected), "{error} lacks {expected}");
        assert!(error.starts_with("projector \"proj1\" (dlpc350 at emulated): "), "{error}");
    }
}

#[test]
fn a_dlpc900_that_vanishes_while_images_are_sent_is_told() {
    let projector = projector(Controller::Dlpc900, [1024, 768], true);
    let faults = BoardFaults { vanish_after: Some(300), ..BoardFaults::default() };
    let error = open(&projector, &plugged(Dlpc900::new(5), faults)).err().unwrap();
    assert!(error.contains("data of an image") && error.contains("no such device"), "{error}");
}

#[test]
fn settings_that_the_board_itself_refuses_are_told_by_name() {
    let mut projector = small();
    let board = plugged(flashed(&projector), BoardFaults::default());
    // The configuration refuses it before; the board has the last word.
    projector.lightcrafter.as_mut().unwrap().exposure_us = 500;
    projector.lightcrafter.as_mut().unwrap().period_us = 600;
    let error = open(&projector, &board).unwrap().show(0).unwrap_err().to_string();
    assert!(error.contains("finds faults in: exposure or period, period less exposure below 230"), "{error}");
}

#[test]
fn the_bytes_of_a_pattern_are_those_of_the_guides_example() {
    use crate::lightcrafter::{dlpc350, dlpc900};
    use cell::lightcrafter::Place;
    // DLPU018J section 5, step 2: pattern 0, 200 µs, red, one bit, no dark time, image 0, bit 0.
    let mut board = projector(Controller::Dlpc900, [1920, 1080], true).lightcrafter.unwrap();
    board.led = Led::of_name("red").unwrap();
    (board.exposure_us, board.period_us) = (200, 200);
    let place = Place { image: 0, bit: 0, bits: 1 };
    let bytes = dlpc900::definition(&board, 0, place);
    assert_eq!(bytes, [0x00, 0x00, 0xc8, 0x00, 0x00, 0x11, 0, 0, 0, 0, 0, 0]);
    // Step 3 has its second pattern in bit 1: 0x0800 behind the dark time.
    let second = dlpc900::definition(&board, 1, Place { bit: 1, ..place });
    assert_eq!(second[10..], [0x00, 0x08]);
    // DLPU010, pattern table: bits 8 … 11 depth, 12 … 14 light, 2 … 7 number, 18 exchange of images.
    let place = Place { image: 0, bit: 16, bits: 8 };
    let entry = dlpc350::entry(&board, place, true);
    assert_eq!(entry, 2 << 2 | 8 << 8 | 1 << 12 | 1 << 18);
    // Bit 17 makes the mirrors dark after the exposure.
    board.period_us = 500;
    assert_eq!(dlpc350::entry(&board, place, false), 2 << 2 | 8 << 8 | 1 << 12 | 1 << 17);
}

#[test]
fn reports_of_a_long_message_follow_each_other_without_a_header() {
    struct Log(Vec<(u16, Vec<u8>)>);
    impl Board for Log {
        fn write(&mut self, command: u16, data: &[u8]) -> Result<(), String> {
            self.0.push((command, data.to_vec()));
            Ok(())
        }
        fn read(&mut self, _command: u16) -> Result<Vec<u8>, String> {
            Ok(self.0.last().map(|(_, data)| data.clone()).unwrap_or_default())
        }
        fn shown(&self) -> Option<Vec<u8>> {
            None
        }
    }
    for length in [0_usize, 1, 57, 58, 59, 121, 122, 123, 506] {
        let mut emulator = Emulator::new(Log(Vec::new()), BoardFaults::default());
        let data: Vec<u8> = (0..length).map(|n| n as u8 | 1).collect();
        let mut message = vec![0x40, 1];
        message.extend(((length + 2) as u16).to_le_bytes());
        message.extend([0x34, 0x1a]);
        message.extend(&data);
        for part in message.chunks(REPORT_BYTES) {
            let mut report = [0; REPORT_BYTES];
            report[..part.len()].copy_from_slice(part);
            emulator.take(&report).unwrap();
        }
        assert!(emulator.violations().is_empty(), "{:?}", emulator.violations());
        let mut ask = [0; REPORT_BYTES];
        ask[..6].copy_from_slice(&[0xc0, 2, 2, 0, 0x34, 0x1a]);
        emulator.take(&ask).unwrap();
        emulator.answers.pop_front();
        let found: Vec<u8> = emulator.answers.iter().flatten().copied().collect();
        assert_eq!(found[4..4 + length], data, "{length}");
    }
}
