//! Settings of the twin in a configuration and on the command line: what they change, what is refused, and how it is said.

use crate::support::{Ran, Small, fringetool};
use files::recording::Recording;
use fringe::pattern::PatternSet;
use std::path::Path;
use twin::TwinSettings;

/// A cell whose `[twin.settings]` is `settings`, and what simulating it states.
fn simulate(small: &Small, settings: &str, more: &[&str], out: &str) -> Ran {
    let text = std::fs::read_to_string(small.path("cell.toml")).unwrap();
    std::fs::write(small.path("turned.toml"), format!("{text}[twin.settings]\n{settings}\n")).unwrap();
    let (cell, out) = (small.path("turned.toml"), small.path(out));
    fringetool(&[&["simulate", &cell, "--out", &out][..], more].concat())
}

#[test]
fn settings_beyond_their_range_are_named_with_file_key_value_and_limit() {
    let small = Small::new();
    for (settings, words) in [
        ("defocus_px_per_mm = 1.5", ["twin.settings.defocus_px_per_mm", "1.5", "0 to 1"]),
        ("bounce_rays = 500", ["twin.settings.bounce_rays", "500", "0 to 256"]),
        ("drift_um = -2000.0", ["twin.settings.drift_um", "-2000", "-1000 to 1000"]),
        ("gloss = -1.0", ["twin.settings.gloss", "-1", "0 to 1000"]),
        ("vibration_um = nan", ["twin.settings.vibration_um", "NaN", "0 to 1000"]),
        ("defocus = 0.1", ["twin.settings", "\"defocus\"", "defocus_px_per_mm"]),
        ("bounce_rays = 1.5", ["twin.settings", "1.5", "u32"]),
    ] {
        let ran = simulate(&small, settings, &[], "no");
        assert_eq!(ran.code, Some(2), "{settings}: {}{}", ran.stdout, ran.stderr);
        assert_eq!(ran.stderr.lines().count(), 1, "{settings}: {}", ran.stderr);
        assert!(ran.stderr.contains("turned.toml"), "{settings}: {}", ran.stderr);
        for word in words {
            assert!(ran.stderr.contains(word), "{settings}: {word} is missing in {}", ran.stderr);
        }
        assert!(!Path::new(&small.path("no")).exists(), "{settings}");
    }
    for (flag, value, limit) in [
        ("--defocus-px-per-mm", "2", "0 to 1"),
        ("--bounce-rays", "257", "0 to 256"),
        ("--gloss", "2000", "0 to 1000"),
        ("--exposures", "0", "0.0001 to 10000"),
    ] {
        let ran = simulate(&small, "", &[flag, value], "no");
        assert_eq!(ran.code, Some(2), "{flag}: {}", ran.stdout);
        let told = [flag, value, limit].iter().all(|word| ran.stderr.contains(word));
        assert!(told && ran.stderr.lines().count() == 1, "{flag}: {}", ran.stderr);
    }
}

/// A setting in the file and the same setting as an option give the same bytes; without it the bytes differ.
#[test]
fn a_setting_in_the_file_equals_the_option_on_the_command_line() {
    let small = Small::new();
    let frame = |folder: &str| {
        std::fs::read(Path::new(&small.path(folder)).join("frames/proj1/cam1/003.png")).unwrap()
    };
    let plain = frame("rec");
    for (number, (settings, flag, value)) in [
        ("defocus_px_per_mm = 0.1", "--defocus-px-per-mm", "0.1"),
        ("bounce_rays = 4", "--bounce-rays", "4"),
        ("gloss = 0.5", "--gloss", "0.5"),
    ]
    .into_iter()
    .enumerate()
    {
        let (file, line) = (format!("file{number}"), format!("line{number}"));
        simulate(&small, settings, &[], &file).expect_success();
        simulate(&small, "", &[flag, value], &line).expect_success();
        assert!(frame(&file) == frame(&line), "{settings}");
        assert!(frame(&file) != plain, "{settings}");
    }
    simulate(&small, "drift_um = 40.0", &[], "drift").expect_success();
    assert!(frame("drift") != plain);
}

/// Exposures come back with their times and frames; the first stands where a recording of one exposure has it.
#[test]
fn exposures_are_recorded_with_their_times() {
    let small = Small::new();
    simulate(&small, "", &["--exposures", "1,0.25"], "hdr").expect_success();
    let recording = Recording::open(Path::new(&small.path("hdr"))).unwrap();
    let projector = &recording.projectors[0];
    assert_eq!(projector.exposures_ms, [10.0, 2.5]);
    let white = fringe::pattern::frame_count(
        &projector.sequence
            [..projector.sequence.iter().position(|s| matches!(s, PatternSet::White {})).unwrap()],
    );
    let mean = |exposure: usize| {
        let count = fringe::pattern::frame_count(&projector.sequence);
        let frame = recording.load("proj1", "cam1", exposure * count + white).unwrap();
        let fringe::frame::PixelBuffer::Mono8(values) = frame.pixels else { panic!("8 bits") };
        let black = 255.0 * TwinSettings::default().black_level;
        values.iter().map(|v| f64::from(*v)).sum::<f64>() / values.len() as f64 - black
    };
    let ratio = mean(1) / mean(0);
    assert!((ratio - 0.25).abs() < 0.01, "{ratio}");
    let plain = Recording::open(Path::new(&small.path("rec"))).unwrap();
    assert_eq!(
        recording.load("proj1", "cam2", 2).unwrap(),
        plain.load("proj1", "cam2", 2).unwrap(),
        "the first exposure is the plain recording"
    );
    for (times, words) in [
        ("[10.0, 10.0]", ["exposures_ms", "10", "each once"]),
        ("[10.0, 0.0]", ["exposures_ms", "0", "above 0 ms"]),
        ("[10.0, inf]", ["exposures_ms", "inf", "above 0 ms"]),
        ("[10.0, 2.5, 5.0]", ["hdr", "_2", "missing"]),
    ] {
        let file = small.path("hdr/recording.toml");
        let text = std::fs::read_to_string(&file).unwrap();
        std::fs::write(&file, text.replace("[10.0, 2.5]", times)).unwrap();
        let ran = fringetool(&["decode", &small.path("hdr")]);
        std::fs::write(&file, text).unwrap();
        assert_eq!(ran.code, Some(2), "{times}: {}", ran.stdout);
        assert_eq!(ran.stderr.lines().count(), 1, "{times}: {}", ran.stderr);
        for word in words {
            assert!(ran.stderr.contains(word), "{times}: {word} is missing in {}", ran.stderr);
        }
    }
}
