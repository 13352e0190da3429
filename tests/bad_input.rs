//! Whatever is wrong with a recording or a rig file: one message that names it, exit code 2, no output file, no panic.

mod harm;

use crate::support::{Ran, Small, fringetool};
use harm::*;
use std::fs;

/// What breaks a small recording.
type Harm = fn(&Small);

/// One way to break the small recording, and the words that the message must contain.
struct Case {
    name: &'static str,
    harm: Harm,
    arguments: &'static [&'static str],
    words: &'static [&'static str],
}

const fn case(name: &'static str, harm: Harm, words: &'static [&'static str]) -> Case {
    Case { name, harm, arguments: &[], words }
}

const CASES: &[Case] = &[
    case("missing frame", |s| fs::remove_file(s.path(FRAME)).unwrap(), &["cam1", "003"]),
    case("truncated frame", |s| truncate(s, FRAME), &["003.png"]),
    case("frame of another size", |s| write_grey(s, FRAME, 50, 40), &["003.png", "50", "40", "168"]),
    case("not an image", |s| fs::write(s.path(FRAME), b"not an image").unwrap(), &["003.png"]),
    case("empty file", |s| fs::write(s.path(FRAME), b"").unwrap(), &["003.png"]),
    case("sine frames in the wrong order", |s| swap(s, 2, 7), &["cam1", "order"]),
    case("saturated frames", saturate, &["no point", "saturated"]),
    case("no light at all", darken, &["no point", "dark"]),
    case(
        "too few steps",
        |s| s.edit("rec/recording.toml", "steps = 10", "steps = 2"),
        &["recording.toml", "steps", "2", "3"],
    ),
    case(
        "fewer frames than the sequence says",
        |s| s.edit("rec/recording.toml", "steps = 10", "steps = 12"),
        &["cam1", "21", "19"],
    ),
    case(
        "more frames than the sequence says",
        |s| s.edit("rec/recording.toml", "steps = 10", "steps = 8"),
        &["cam1", "17"],
    ),
    case("no absolute code", no_code, &["absolute"]),
    case(
        "unknown set",
        |s| s.edit("rec/recording.toml", "\"gray\"", "\"grey\""),
        &["recording.toml", "grey"],
    ),
    case(
        "unknown key",
        |s| s.edit("rec/recording.toml", "width_px", "widht_px"),
        &["recording.toml", "widht_px"],
    ),
    case(
        "another format",
        |s| s.edit("rec/recording.toml", "recording/1", "recording/9"),
        &["recording/9", "recording/1"],
    ),
    case("no recording", |s| fs::remove_file(s.path("rec/recording.toml")).unwrap(), &["recording.toml"]),
    case("no folder", |s| fs::remove_dir_all(s.path("rec")).unwrap(), &["rec"]),
    case(
        "a name that leaves the folder",
        |s| s.edit("rec/recording.toml", "\"cam1\"", "\"../cam1\""),
        &["../cam1"],
    ),
    case(
        "not TOML",
        |s| fs::write(s.path("rig.toml"), "format = \"fringecell-rig/1\"\n[[camera").unwrap(),
        &["rig.toml"],
    ),
    case("no rig file", |s| fs::remove_file(s.path("rig.toml")).unwrap(), &["rig.toml"]),
    case(
        "pair with an unknown camera",
        |s| s.edit("rig.toml", "right = \"cam2\"", "right = \"cam9\""),
        &["rig.toml", "cam9"],
    ),
    case(
        "recorded camera that the rig does not know",
        |s| s.edit("rec/recording.toml", "\"cam2\"", "\"cam7\""),
        &["cam7"],
    ),
    case("mirrored rotation", mirror, &["rig.toml", "rotation", "mirror"]),
    case(
        "rotation that is none",
        |s| s.edit("rig.toml", "rotation = [[", "rotation = [[1"),
        &["rig.toml", "rotation", "orthonormal"],
    ),
    case(
        "camera of another size",
        |s| s.edit("rig.toml", "width_px = 168", "width_px = 336"),
        &["cam1", "336", "168"],
    ),
    case("focal length zero", zero_focal, &["rig.toml", "focal"]),
    case("not a number", |s| s.edit("rig.toml", "skew = 0.0", "skew = nan"), &["rig.toml", "skew"]),
    case("two cameras at one place", same_place, &["pair1"]),
    case("views without overlap", turn_away, &["no point"]),
    case("eight of ten sine frames that stayed black", |s| paint(s, 3..11, 0), &["recording.toml", "order"]),
    case("a frame that is a pipe", pipe, &["003.png", "pipe"]),
    case("recording.toml is a pipe", pipe_text, &["recording.toml", "pipe"]),
    case(
        "focal length beyond all telescopes",
        |s| focal(s, 1e300),
        &["rig.toml", "focal", "1000000000", "16800000"],
    ),
    case("focal length that would fill the memory", |s| focal(s, 1e7), &["pair1", "cells", "focal"]),
    case("focal length next to nothing", |s| focal(s, 1e-300), &["rig.toml", "focal"]),
    case("camera in another country", |s| far_away(s, 1e9), &["rig.toml", "translation", "1000000000"]),
    case("more pairs than a cloud can number", many_pairs, &["rig.toml", "pair", "300", "256"]),
    Case {
        name: "result over the cloud",
        harm: |_| {},
        arguments: &["--json", "{folder}/cloud.ply"],
        words: &["--json", "--out", "cloud.ply"],
    },
    Case {
        name: "result over the rig file",
        harm: |_| {},
        arguments: &["--json", "{folder}/rig.toml"],
        words: &["--json", "rig.toml", "input"],
    },
    Case {
        name: "a pair that does not exist",
        harm: |_| {},
        arguments: &["--pair", "pair9"],
        words: &["pair9", "pair1"],
    },
    Case {
        name: "projector method without projector",
        harm: drop_projectors,
        arguments: &["--method", "projector"],
        words: &["projector", "proj1"],
    },
    Case {
        name: "output folder that is a file",
        harm: |s| fs::write(s.path("file"), b"x").unwrap(),
        arguments: &["--json", "/dev/null/result.json"],
        words: &["/dev/null"],
    },
];

#[test]
fn every_fault_ends_in_a_message_and_no_file() {
    let original = Small::new();
    let mut failures = Vec::new();
    for case in CASES {
        let small = copy(&original);
        (case.harm)(&small);
        let arguments: Vec<String> =
            case.arguments.iter().map(|a| a.replace("{folder}/", &small.path(""))).collect();
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let ran = small.reconstruct(&arguments);
        if let Some(complaint) = complaint(case, &small, &ran) {
            failures.push(format!("{}: {complaint}\n    stderr: {}", case.name, ran.stderr.trim()));
        }
    }
    assert!(failures.is_empty(), "{} of {} cases:\n{}", failures.len(), CASES.len(), failures.join("\n"));
}

/// Proves: frames of the code that were exchanged are named and made up for; of the points that are left nearly all lie where they should.
#[test]
fn exchanged_frames_of_the_code_are_named_and_made_up_for() {
    let original = Small::new();
    let points = |small: &Small| files::ply::read_cloud(small.path("cloud.ply").as_ref()).unwrap().points;
    original.reconstruct(&[]).expect_success();
    let before = points(&original).len();
    // Where points should lie: all of them, those at rims and limbs too, which more noise lets through elsewhere.
    let cell = fs::read_to_string(original.path("cell.toml")).unwrap();
    fs::write(original.path("cell.toml"), cell + "[matching.surface]\nedge_px = 0\n").unwrap();
    let (cell, out, recording) =
        (original.path("cell.toml"), original.path("cloud.ply"), original.path("rec"));
    fringetool(&["reconstruct", "--config", &cell, "--out", &out, "--force", &recording]).expect_success();
    let expected = points(&original);
    assert!(expected.len() > before, "{} points, {before} without rims", expected.len());
    for (one, other, names) in
        [(15, 16, ["frame 6 of set 2", "frame 7 of set 2"]), (17, 18, ["set 3", "set 4"])]
    {
        let small = copy(&original);
        fs::remove_file(small.path("cloud.ply")).unwrap();
        swap(&small, one, other);
        let ran = small.reconstruct(&[]).expect_success();
        let said = [ran.stdout, ran.stderr].concat();
        assert!(said.contains("cam1") && names.iter().all(|name| said.contains(name)), "{said}");
        let found = points(&small);
        let square_mm2 =
            |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>();
        let is_there = |at: &[f64; 3]| expected.iter().any(|point| square_mm2(&point.position_mm, at) < 0.25);
        let right = found.iter().filter(|point| is_there(&point.position_mm)).count();
        let counts = format!("{names:?}: {right} right of {}, {before} before", found.len());
        assert!(right * 100 > found.len() * 98 && right * 100 > before * 60, "{counts}");
    }
}

fn complaint(case: &Case, small: &Small, ran: &Ran) -> Option<String> {
    if ran.code != Some(2) {
        return Some(format!("exit code {:?} instead of 2", ran.code));
    }
    if ran.stderr.contains("panicked") {
        return Some("it panicked".into());
    }
    let missing: Vec<_> = case.words.iter().filter(|word| !ran.stderr.contains(**word)).collect();
    if !missing.is_empty() {
        return Some(format!("the message lacks {missing:?}"));
    }
    let left: Vec<_> = fs::read_dir(small.folder.path())
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.contains("cloud"))
        .collect();
    (!left.is_empty()).then(|| format!("it left {left:?}"))
}

#[test]
fn arguments_that_make_no_sense_end_with_code_2() {
    for arguments in
        [&["reconstruct"][..], &["fit", "sphere", "absent.ply"], &["decode", "absent"], &["nonsense"]]
    {
        let ran = fringetool(arguments);
        assert_eq!(ran.code, Some(2), "{arguments:?}: {}", ran.stderr);
        assert!(!ran.stderr.contains("panicked"), "{arguments:?}: {}", ran.stderr);
    }
}

fn copy(original: &Small) -> Small {
    let folder = tempfile::TempDir::new().unwrap();
    copy_folder(original.folder.path(), folder.path());
    Small::within(folder)
}

fn copy_folder(from: &std::path::Path, to: &std::path::Path) {
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            fs::create_dir(&target).unwrap();
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), &target).unwrap();
        }
    }
}

/// Ways to make a simulation fail, the last two after its frames were begun, and a word of the message.
const BROKEN_OFF: &[(&str, Harm, &str)] = &[
    (
        "a set that cannot be generated",
        |s| s.edit("cell.toml", "{ set = \"white\" }", "{ set = \"random\" }"),
        "random",
    ),
    ("truth that cannot be written", |s| fs::create_dir(s.path("new.truth.toml")).unwrap(), "new.truth.toml"),
    ("camera inside of the part", |s| edit_rig(s, |t| inside(camera(t, 0))), "cam1"),
];

#[test]
fn a_simulation_that_fails_leaves_nothing() {
    let original = Small::new();
    for (name, harm, word) in BROKEN_OFF {
        let small = copy(&original);
        harm(&small);
        let (cell, out) = (small.path("cell.toml"), small.path("new"));
        let ran = fringetool(&["simulate", &cell, "--out", &out]);
        assert_eq!(ran.code, Some(2), "{name}: {}", ran.stderr);
        assert!(ran.stderr.contains(word), "{name}: {}", ran.stderr);
        assert!(!std::path::Path::new(&out).exists(), "{name}: it left frames");
    }
}

#[test]
fn an_import_that_fails_leaves_nothing_and_links_are_followed() {
    let small = Small::new();
    let layout = |number: &str| {
        format!(
            "format = \"fringecell-layout/1\"\n[[projector]]\nname = \"proj1\"\nwidth_px = 608\nheight_px = 684\n\
             sequence = [{{ set = \"sine\", axis = \"x\", period_px = 608.0, steps = 10 }}]\n[[projector.camera]]\n\
             name = \"cam1\"\nfiles = \"cam1/{number}.png\"\n"
        )
    };
    let (file, out, from) = (small.path("layout.toml"), small.path("new"), small.path("rec/frames/proj1"));
    let import = |number: &str| {
        fs::write(&file, layout(number)).unwrap();
        fringetool(&["import", &file, "--from", &from, "--out", &out])
    };
    let ran = import(&format!("{{{}}}", "n".repeat(70_000)));
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);

    let (link, place) = (small.path(&frame("cam1", 4)), small.path("rec/frames/proj1/cam1/x"));
    fs::rename(&link, &place).unwrap();
    std::os::unix::fs::symlink("x", &link).unwrap();
    import("{nnn}").expect_success();
    assert!(fs::metadata(format!("{out}/frames/proj1/cam1/004.png")).unwrap().is_file());
    fs::remove_dir_all(&out).unwrap();

    truncate(&small, &frame("cam1", 7));
    let ran = import("{nnn}");
    assert_eq!(ran.code, Some(2), "{}", ran.stderr);
    assert!(ran.stderr.contains("007.png"), "{}", ran.stderr);
    assert!(!std::path::Path::new(&out).exists(), "it left frames");
}

#[test]
fn a_cloud_that_never_ends_is_refused_at_its_start() {
    for cloud in ["/dev/zero", "/dev/urandom"] {
        let ran = fringetool(&["fit", "sphere", cloud]);
        assert_eq!(ran.code, Some(2), "{cloud}: {}", ran.stderr);
        assert!(ran.stderr.contains("device"), "{}", ran.stderr);
    }
}
