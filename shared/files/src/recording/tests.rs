//! A recording comes back as it was written, and each kind of damage is reported with place and remedy.

use super::*;
use crate::rig_file::{read_rig, write_rig};
use crate::testing::{camera, rig};
use fringe::frame::{Frame, PixelBuffer};
use fringe::geometry::rig::Rig;
use fringe::pattern::{Axis, Direction, PatternSet};
use std::fs;
use std::path::PathBuf;

const SINE: PatternSet = PatternSet::Sine {
    axis: Axis::X,
    period_px: 16.0,
    steps: 3,
    first_step_rad: 0.25,
    direction: Direction::Backward,
    shifts_rad: Vec::new(),
};

fn frame(number: usize, width_px: u32) -> Frame {
    let pixels = (0..width_px as usize * 4).map(|i| (i * 7 + number) as u8).collect();
    Frame { width_px, height_px: 4, full_scale_dn: 255, pixels: PixelBuffer::Mono8(pixels) }
}

fn records() -> Vec<ProjectorRecord> {
    vec![ProjectorRecord {
        name: "proj1".into(),
        width_px: 64,
        height_px: 48,
        cameras: vec!["cam1".into(), "cam2".into()],
        sequence: vec![SINE, PatternSet::White {}],
        exposures_ms: Vec::new(),
        full_scale_dn: std::collections::BTreeMap::new(),
    }]
}

fn write(folder: &Path) {
    let mut writer = RecordingWriter::create(folder, &records()).unwrap();
    for camera in ["cam1", "cam2"] {
        for number in 0..4 {
            writer.write("proj1", camera, number, &frame(number, 6).view()).unwrap();
        }
    }
    writer.finish(&toml::Table::from_iter([("version".into(), "1".into())])).unwrap();
}

#[test]
fn a_recording_comes_back_as_it_was_written() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    for place in [dir.path().to_owned(), dir.path().join(RECORDING_FILE)] {
        let recording = Recording::open(&place).unwrap();
        assert_eq!(recording.projectors.len(), 1);
        assert_eq!(recording.projectors[0].sequence, records()[0].sequence);
        assert_eq!(recording.provenance["version"].as_str(), Some("1"));
        for number in 0..4 {
            assert_eq!(recording.load("proj1", "cam2", number).unwrap(), frame(number, 6));
        }
        assert!(recording.load("proj1", "cam2", 4).is_err());
        assert!(recording.load("proj1", "cam3", 0).is_err());
    }
}

#[test]
fn twelve_bits_in_a_file_of_sixteen_keep_their_full_scale() {
    let dir = tempfile::tempdir().unwrap();
    let mut records = records();
    records[0].sequence.truncate(1);
    let mut writer = RecordingWriter::create(dir.path(), &records).unwrap();
    let frame =
        Frame { width_px: 2, height_px: 1, full_scale_dn: 4095, pixels: PixelBuffer::Mono16(vec![0, 4095]) };
    for camera in ["cam1", "cam2"] {
        for number in 0..3 {
            writer.write("proj1", camera, number, &frame.view()).unwrap();
        }
    }
    writer.finish(&toml::Table::new()).unwrap();
    let recording = Recording::open(dir.path()).unwrap();
    assert_eq!(recording.load("proj1", "cam1", 2).unwrap(), frame);
}

#[test]
fn the_writer_refuses_what_would_not_be_a_recording() {
    let dir = tempfile::tempdir().unwrap();
    let mut writer = RecordingWriter::create(dir.path(), &records()).unwrap();
    writer.write("proj1", "cam1", 0, &frame(0, 6).view()).unwrap();
    assert!(writer.write("proj1", "cam1", 0, &frame(0, 6).view()).is_err(), "twice");
    assert!(writer.write("proj1", "cam1", 1, &frame(0, 7).view()).is_err(), "other size");
    assert!(writer.write("proj1", "cam1", 4, &frame(0, 6).view()).is_err(), "beyond the sequence");
    assert!(writer.write("proj2", "cam1", 0, &frame(0, 6).view()).is_err(), "unknown projector");
    let error = writer.finish(&toml::Table::new()).unwrap_err();
    assert!(error.to_string().contains("3 of 4 frames of camera \"cam1\""), "{error}");
    assert!(Recording::open(dir.path()).unwrap_err().to_string().contains("written last"));
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "frames of a recording that was broken off");
    fs::write(dir.path().join("note"), "mine").unwrap();
    let error = RecordingWriter::create(dir.path(), &records()).unwrap_err();
    assert!(error.to_string().contains("is not empty"), "{error}");
    let mut twice = records();
    twice[0].cameras[1] = twice[0].cameras[0].clone();
    let error = RecordingWriter::create(&dir.path().join("new"), &twice).unwrap_err();
    assert!(error.to_string().contains("camera \"cam1\" occurs twice"), "{error}");
    let mut outside = records();
    outside[0].cameras[0] = "../x".into();
    assert!(RecordingWriter::create(&dir.path().join("new"), &outside).is_err());
}

/// Damages a recording and returns the message.
fn broken(damage: impl Fn(&Path)) -> String {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    damage(dir.path());
    let error = Recording::open(dir.path()).unwrap_err();
    error.to_string()
}

fn edit(folder: &Path, from: &str, to: &str) {
    let path = folder.join(RECORDING_FILE);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "{from} is not in {text}");
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

type Damage = Box<dyn Fn(&Path)>;

const FRAMES: &str = "frames/proj1/cam1";

fn cam1(folder: &Path) -> PathBuf {
    folder.join(FRAMES)
}

fn copy(folder: &Path, to: &str) {
    fs::copy(cam1(folder).join("000.png"), cam1(folder).join(to)).unwrap();
}

#[test]
fn damaged_frames_are_told_with_file_found_and_expected() {
    let table: Vec<(Damage, &str)> = vec![
        (
            Box::new(|f| fs::remove_file(cam1(f).join("002.png")).unwrap()),
            "cam1: frames and sequence disagree: 3 frames are here (missing: 002), but the sequence of recording.toml has 4",
        ),
        (
            Box::new(|f| copy(f, "004.png")),
            "004.png: frames and sequence disagree: this is frame 004, but the",
        ),
        (
            Box::new(|f| copy(f, "0001.png")),
            "value \"0001\" is not allowed: frames are named by their number",
        ),
        (Box::new(|f| copy(f, "left.png")), "rename or remove it"),
        (Box::new(|f| copy(f, "001.tif")), "so is "),
        (
            Box::new(|f| {
                fs::remove_file(cam1(f).join("001.png")).unwrap();
                crate::image_file::write_png(&cam1(f).join("001.png"), &frame(0, 7).view()).unwrap();
            }),
            "this one is 7 × 4 px of 8 bits, but ",
        ),
        (
            Box::new(|f| fs::write(cam1(f).join("001.png"), b"").unwrap()),
            "001.png: is empty; record or copy it again",
        ),
        (
            Box::new(|f| fs::write(cam1(f).join("001.png"), b"no picture").unwrap()),
            "001.png: is of no known kind, expected PNG or TIFF",
        ),
        (
            Box::new(|f| {
                let bytes = fs::read(cam1(f).join("001.png")).unwrap();
                fs::write(cam1(f).join("001.png"), &bytes[..20]).unwrap();
            }),
            "001.png: is no readable image (damaged or truncated?)",
        ),
        (Box::new(|f| fs::remove_dir_all(cam1(f)).unwrap()), "proj1/cam1 of camera \"cam1\" is missing"),
        (Box::new(|f| fs::remove_file(f.join(RECORDING_FILE)).unwrap()), "recording.toml is missing"),
    ];
    for (damage, expected) in table {
        let message = broken(damage);
        assert!(message.contains(expected), "{message}\nlacks\n{expected}");
    }
}

#[test]
fn a_frame_cut_short_after_opening_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path());
    let recording = Recording::open(dir.path()).unwrap();
    let path = dir.path().join(FRAMES).join("001.png");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
    let error = recording.load("proj1", "cam1", 1).unwrap_err();
    assert!(error.to_string().contains("001.png: is no readable image"), "{error}");
}

#[test]
fn a_wrong_description_is_reported_with_line_and_key() {
    let table = [
        ("steps = 3", "steps = 2", "recording.toml:9: projector[0].sequence[0]: steps = 2: a phase needs"),
        ("period_px = 16.0", "period_px = nan", "period_px = NaN"),
        ("steps = 3", "stepps = 3", "did you mean \"steps\"?"),
        ("set = \"sine\"", "set = \"sinus\"", "unknown variant `sinus`"),
        ("width_px = 64", "width_px = 0", "recording.toml:5: projector[0].width_px: value 0 is not allowed"),
        ("width_px = 64", "width_px = -1", "recording.toml:5: width_px: "),
        ("\"cam1\", \"cam2\"", "\"cam1\", \"cam1\"", "camera \"cam1\" occurs twice"),
        ("\"cam1\", \"cam2\"", "\"cam1\", \"../cam2\"", "value \"../cam2\" is not allowed"),
        ("\"cam1\", \"cam2\"", "", "a camera is missing"),
        ("recording/1", "recording/2", "format is \"fringecell-recording/2\", expected"),
        ("name = \"proj1\"", "nmae = \"proj1\"", "did you mean \"name\"?"),
        ("[[projector]]", "[[projektor]]", "did you mean \"projector\"?"),
        ("width_px = 64", "width_px = 64\nfull_scale_dn = { cam3 = 4095 }", "did you mean \"cam1\"?"),
        ("width_px = 64", "width_px = 64\nfull_scale_dn = 10", "value 10 is not allowed: 255 … 65535"),
    ];
    for (from, to, expected) in table {
        let message = broken(|folder| edit(folder, from, to));
        assert!(message.contains(expected), "{message}\nlacks\n{expected}");
    }
}

#[test]
fn a_rig_is_fitted_to_what_was_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("scan");
    write(&folder);
    let recording = Recording::open(&folder).unwrap();
    let path = dir.path().join("rig.toml");
    let fit = |rig: &Rig| {
        write_rig(&path, rig, &toml::Table::new(), None).unwrap();
        recording.rig(&read_rig(&path).unwrap()).map_err(|error| error.to_string())
    };
    let mut good = rig(6, 4);
    good.pairs[0].projector = String::new();
    let fitted = fit(&good).unwrap();
    assert_eq!(fitted.rig.pairs.len(), 1, "pair2 was not recorded");
    assert_eq!(fitted.rig.pairs[0].projector, "proj1");
    assert_eq!(fitted.absent_pairs[0].name, "pair2");

    let other_size = fit(&rig(7, 4)).unwrap_err();
    assert!(other_size.contains("\"cam1\" was recorded with 6 × 4 px, but 7 × 4 px in "), "{other_size}");
    let mut renamed = rig(6, 4);
    renamed.cameras[1].name = "cam7".into();
    renamed.pairs[0].right = "cam7".into();
    let unknown = fit(&renamed).unwrap_err();
    assert!(unknown.contains("camera \"cam2\" is unknown; known: cam1, cam7, cam3, cam4"), "{unknown}");
    let mut alone = rig(6, 4);
    alone.pairs.remove(0);
    let none = fit(&alone).unwrap_err();
    assert!(none.contains("pair2 = cam3 + cam4, but the recording has proj1 lit cam1, cam2"), "{none}");
    let mut with_projector = rig(6, 4);
    with_projector.projectors = vec![camera("proj1", 100, 48)];
    assert!(
        fit(&with_projector).unwrap_err().contains("\"proj1\" was recorded with 64 × 48 px, but 100 × 48 px")
    );
}
