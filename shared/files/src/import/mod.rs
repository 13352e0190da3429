//! Imports: foreign folders of frames, and the calibration beside them, as a recording and a rig file.

mod file_names;
mod layout;

use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::hash::sha256_hex;
use crate::opencv::{Storage, rig_from_opencv};
use crate::raw_image::RawImage;
use crate::recording::{ProjectorRecord, RECORDING_FILE, Recording, RecordingWriter};
use crate::rig_file::{read_rig, write_rig};
use crate::sequence::check_sequence;
use cell::pixel_format::PixelFormat;
use file_names::numbered;
use fringe::geometry::rig::Pair;
use fringe::pattern::frame_count;
pub use layout::LAYOUT_FORMAT;
use layout::{Channels, RawCamera, RawLayout, RawPair, RawProjector, RawRig};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What an import wrote.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImportReport {
    /// Folder of the new recording.
    pub recording: PathBuf,
    /// The rig file, if the layout names a calibration.
    pub rig: Option<PathBuf>,
    /// Number of frames written.
    pub frames: usize,
}

/// Imports a foreign folder: writes a recording, and `rig.toml` in it if the layout names a calibration.
///
/// The result is opened again, so that what this returns is a recording that can be read, with a rig that fits.
///
/// # Errors
/// A layout that names what is not there, frames that are no frames, a calibration that is none, a used folder.
pub fn import(layout: &Path, source: &Path, out: &Path) -> Result<ImportReport, FileError> {
    let document = Document::read(layout)?;
    let raw: RawLayout = document.parse(LAYOUT_FORMAT)?;
    if raw.projector.is_empty() {
        let problem = Problem::Missing("[[projector]]".into());
        return Err(document.fault("projector", problem, "describe each projector and its sequence"));
    }
    let files = raw
        .projector
        .iter()
        .enumerate()
        .map(|(index, projector)| frame_files(&document, index, projector, source))
        .collect::<Result<Vec<_>, _>>()?;
    let rig = raw.rig.as_ref().map(|rig| read_calibration(&document, rig, source)).transpose()?;
    let records: Vec<ProjectorRecord> = raw.projector.iter().map(RawProjector::record).collect();
    let made = !out.exists();
    let writer = RecordingWriter::create(out, &records)?;
    let written = write(writer, &document, &raw, &files, rig.as_ref(), out);
    if written.is_err() {
        // The folder was new or empty; what lies in it now is of no use.
        let _ = std::fs::remove_dir_all(out.join("frames"));
        let _ = std::fs::remove_file(out.join(RECORDING_FILE));
        let _ = std::fs::remove_file(out.join("rig.toml"));
        if made {
            let _ = std::fs::remove_dir(out);
        }
    }
    written
}

/// Frames first, then what makes them a recording, then the rig; all is read again.
fn write(
    mut writer: RecordingWriter,
    document: &Document,
    raw: &RawLayout,
    files: &[Vec<Vec<PathBuf>>],
    rig: Option<&fringe::geometry::rig::Rig>,
    out: &Path,
) -> Result<ImportReport, FileError> {
    let mut frames = 0;
    for (projector, cameras) in raw.projector.iter().zip(files) {
        for (camera, files) in projector.camera.iter().zip(cameras) {
            for (number, file) in files.iter().enumerate() {
                let channel = camera.channel.of(number);
                let how = (camera.full_scale_dn, channel, camera.mosaic);
                match &camera.raw {
                    Some(raw) => {
                        let frame = raw.read(file, raw_format(document, camera, raw)?)?;
                        let frame = match camera.mosaic {
                            Some(mosaic) => mosaic.frame(frame, channel),
                            None => frame,
                        };
                        writer.write(&projector.name, &camera.name, number, &frame.view())?;
                    }
                    None => writer.adopt(&projector.name, &camera.name, number, file, how)?,
                }
                frames += 1;
            }
        }
    }
    let mut provenance = raw.provenance.clone();
    provenance.insert("layout_sha256".into(), sha256_hex(document.text.as_bytes()).into());
    writer.finish(&provenance)?;
    let recording = Recording::open(out)?;
    let rig = match rig {
        None => None,
        Some(rig) => {
            let path = out.join("rig.toml");
            write_rig(&path, rig, &provenance, None)?;
            recording.rig(&read_rig(&path)?)?;
            Some(path)
        }
    };
    Ok(ImportReport { recording: recording.folder, rig, frames })
}

/// The format of a camera's raw files.
fn raw_format(document: &Document, camera: &RawCamera, raw: &RawImage) -> Result<PixelFormat, FileError> {
    raw.format().map_err(|fault| {
        let (key, problem, remedy) = *fault;
        document.fault_of(["camera", &camera.name, &format!("raw.{key}")], problem, &remedy)
    })
}

impl RawProjector {
    fn record(&self) -> ProjectorRecord {
        ProjectorRecord {
            name: self.name.clone(),
            width_px: self.width_px,
            height_px: self.height_px,
            cameras: self.camera.iter().map(|camera| camera.name.clone()).collect(),
            sequence: self.sequence.clone(),
            exposures_ms: Vec::new(),
            full_scale_dn: BTreeMap::new(),
        }
    }
}

/// The files of each camera, in order of projection; all exist.
fn frame_files(
    document: &Document,
    index: usize,
    projector: &RawProjector,
    source: &Path,
) -> Result<Vec<Vec<PathBuf>>, FileError> {
    let key = format!("projector[{index}]");
    check_sequence(document, &key, [projector.width_px, projector.height_px], &projector.sequence)?;
    let count = frame_count(&projector.sequence);
    let of_camera = |(number, camera): (usize, &RawCamera)| {
        let key = format!("{key}.camera[{number}]");
        if let Channels::Each(list) = &camera.channel
            && list.len() != count
        {
            let problem = Problem::Disagreement {
                what: "channel and sequence",
                here: format!("{} channels are listed", list.len()),
                there: format!("the sequence has {count} frames"),
            };
            return Err(document.fault(&format!("{key}.channel"), problem, "one channel, or one per frame"));
        }
        let names = match (&camera.files, &camera.list) {
            (Some(pattern), None) => numbered(document, &key, pattern, camera, &projector.sequence)?,
            (None, Some(list)) if list.len() == count && camera.first.is_none() => list.clone(),
            (None, Some(list)) if camera.first.is_none() => {
                let problem = Problem::Disagreement {
                    what: "list and sequence",
                    here: format!("{} files are listed", list.len()),
                    there: format!("the sequence has {count} frames"),
                };
                return Err(document.fault(&format!("{key}.list"), problem, "one file per frame"));
            }
            _ => {
                let problem = Problem::Unsupported("needs files (with first), or list, not both".into());
                return Err(document.fault(&key, problem, "name the file of each frame"));
            }
        };
        let paths: Vec<PathBuf> = names.iter().map(|name| source.join(name)).collect();
        match paths.iter().find(|path| !path.is_file()) {
            None => Ok(paths),
            Some(absent) => {
                let problem = Problem::Missing(format!("the file {}", absent.display()));
                Err(document.fault(&key, problem, "paths are relative to the source folder"))
            }
        }
    };
    projector.camera.iter().enumerate().map(of_camera).collect()
}

fn read_calibration(
    document: &Document,
    raw: &RawRig,
    source: &Path,
) -> Result<fringe::geometry::rig::Rig, FileError> {
    let storage = Storage::read(&source.join(&raw.opencv))?;
    if !raw.view.iter().any(|view| view.rotation.is_none() && view.translation.is_none()) {
        let problem = Problem::Missing("a view without pose".into());
        return Err(document.fault("rig.view", problem, "the view that is the world frame has no rotation"));
    }
    let pair = |raw: &RawPair| Pair {
        name: raw.name.clone(),
        left: raw.left.clone(),
        right: raw.right.clone(),
        projector: raw.projector.clone(),
    };
    rig_from_opencv(&storage, &raw.view, raw.pair.iter().map(pair).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::opencv::{Language, pair_text};
    use crate::testing::camera;
    use fringe::frame::PixelBuffer;
    use fringe::pattern::PatternSet;

    const LAYOUT: &str = r#"format = "fringecell-layout/1"
provenance = { origin = "test" }
[[projector]]
name = "proj1"
width_px = 64
height_px = 48
sequence = [{ set = "sine", axis = "x", period_px = 16.0, steps = 3 }]
[[projector.camera]]
name = "left"
files = "L/{nn}.png"
first = 1
[[projector.camera]]
name = "right"
list = ["R/c.bmp", "R/a.bmp", "R/b.bmp"]
[rig]
opencv = "c.yml"
view = [
  { name = "left", width_px = 6, height_px = 4, matrix = "M1", distortion = "D1" },
  { name = "right", width_px = 6, height_px = 4, matrix = "M2", distortion = "D2", rotation = "R", translation = "T" },
]
pair = [{ name = "pair1", left = "left", right = "right" }]
"#;

    fn source() -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("L")).unwrap();
        std::fs::create_dir(dir.path().join("R")).unwrap();
        let grey = |value: u8| image::GrayImage::from_pixel(6, 4, image::Luma([value]));
        for number in 1..4_u8 {
            grey(number).save(dir.path().join(format!("L/{number:02}.png"))).unwrap();
        }
        for (name, value) in [("c", 10), ("a", 11), ("b", 12)] {
            grey(value).save(dir.path().join(format!("R/{name}.bmp"))).unwrap();
        }
        let (left, mut right) = (camera("left", 6, 4).camera, camera("right", 6, 4).camera);
        right.camera_from_world.translation.vector.x -= 80.0;
        std::fs::write(dir.path().join("c.yml"), pair_text(&left, &right, Language::Yaml).unwrap()).unwrap();
        dir
    }

    fn run(layout: &str) -> Result<(tempfile::TempDir, ImportReport), String> {
        let source = source();
        let path = source.path().join("layout.toml");
        std::fs::write(&path, layout).unwrap();
        let out = source.path().join("out");
        let report = import(&path, source.path(), &out).map_err(|error| error.to_string())?;
        Ok((source, report))
    }

    #[test]
    fn foreign_frames_and_calibration_become_a_recording_and_a_rig() {
        let (_source, report) = run(LAYOUT).unwrap();
        assert_eq!(report.frames, 6);
        let recording = Recording::open(&report.recording).unwrap();
        for (camera, base) in [("left", 1_u8), ("right", 10)] {
            for number in 0..3_u8 {
                let frame = recording.load("proj1", camera, number as usize).unwrap();
                assert_eq!(frame.pixels, PixelBuffer::Mono8(vec![base + number; 24]));
            }
        }
        let rig = recording.rig(&read_rig(&report.rig.unwrap()).unwrap()).unwrap().rig;
        assert_eq!(rig.pairs[0].projector, "proj1");
        assert_eq!(recording.provenance["origin"].as_str(), Some("test"));
    }

    #[test]
    fn patterns_count_frames_sets_and_steps() {
        let sequence = "[{ set = \"sine\", axis = \"x\", period_px = 16.0, steps = 3 }, { set = \"white\" }]";
        let sequence: Vec<PatternSet> =
            toml::from_str::<toml::Table>(&format!("s = {sequence}")).unwrap()["s"]
                .clone()
                .try_into()
                .unwrap();
        let names = |text: &str| {
            let camera: RawCamera = toml::from_str(&format!("name = \"c\"\n{text}")).unwrap();
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("layout.toml");
            std::fs::write(&path, LAYOUT).unwrap();
            let document = Document::read(&path).unwrap();
            numbered(&document, "key", camera.files.as_deref().unwrap(), &camera, &sequence)
                .map_err(|error| error.to_string())
        };
        let turns = names("files = \"{nn}.png\"\nfirst = 1\nevery = 2").unwrap();
        assert_eq!(turns, ["01.png", "03.png", "05.png", "07.png"]);
        let sets = names("files = \"s{s}/{ii}.png\"\nfirst_set = 1\nfirst_step = 1").unwrap();
        assert_eq!(sets, ["s1/01.png", "s1/02.png", "s1/03.png", "s2/01.png"]);
        assert!(names("files = \"plain.png\"").is_err());
        assert!(names("files = \"{ns}.png\"").is_err());
    }

    /// The same four grey values as each kind of file.
    #[test]
    fn every_kind_of_file_becomes_the_same_frame() {
        let dir = tempfile::tempdir().unwrap();
        let values = [10_u8, 60, 120, 250];
        let grey = image::GrayImage::from_raw(2, 2, values.to_vec()).unwrap();
        for name in ["a.png", "a.bmp", "a.pgm", "a.tif"] {
            grey.save(dir.path().join(name)).unwrap();
        }
        // Of one grey value, so that compression changes nothing.
        image::GrayImage::from_pixel(2, 2, image::Luma([60])).save(dir.path().join("a.jpg")).unwrap();
        let rgba = values.iter().flat_map(|v| [0, *v, 0, 7]).collect();
        image::RgbaImage::from_raw(2, 2, rgba).unwrap().save(dir.path().join("rgba.png")).unwrap();
        std::fs::write(dir.path().join("a.raw"), [&[0; 16][..], &values].concat()).unwrap();
        std::fs::write(dir.path().join("b.raw"), [0x0a, 0xc0, 0x03, 0x78, 0xa0, 0x0f]).unwrap();
        let raw = |format: &str, header: usize| {
            format!(
                "raw = {{ width_px = 2, height_px = 2, pixel_format = \"{format}\", header_bytes = {header} }}"
            )
        };
        for (name, keys, expected) in [
            ("a.png", String::new(), values),
            ("a.bmp", String::new(), values),
            ("a.pgm", String::new(), values),
            ("a.tif", String::new(), values),
            ("a.jpg", String::new(), [60; 4]),
            ("rgba.png", "channel = \"green\"".into(), values),
            ("a.raw", raw("Mono8", 16), values),
            ("b.raw", raw("Mono12p", 0), values),
        ] {
            let layout = format!(
                "format = \"fringecell-layout/1\"\n[[projector]]\nname = \"p\"\nwidth_px = 64\nheight_px = 48\n\
                 sequence = [{{ set = \"white\" }}]\n[[projector.camera]]\nname = \"c\"\nlist = [\"{name}\"]\n{keys}\n"
            );
            let path = dir.path().join("layout.toml");
            std::fs::write(&path, layout).unwrap();
            let out = dir.path().join(format!("of-{name}"));
            let report = import(&path, dir.path(), &out).unwrap();
            let frame = Recording::open(&report.recording).unwrap().load("p", "c", 0).unwrap();
            let found: Vec<u8> = (0..4).map(|i| frame.view().pixels.get(i) as u8).collect();
            assert_eq!(found, expected, "{name}");
        }
    }

    #[test]
    fn layouts_that_fit_nothing_are_told_so() {
        for (from, to, expected) in [
            ("first = 1", "first = 2", "L/04.png is missing; paths are relative to the source folder"),
            ("{nn}", "{n", "a pattern has one place for the number"),
            ("{nn}", "{x}", "a pattern has one place for the number"),
            ("first = 1", "first = 18446744073709551615", "first"),
            ("\"R/c.bmp\", ", "", "2 files are listed, but the sequence has 3 frames"),
            ("first = 1", "list = []", "needs files (with first), or list, not both"),
            (
                "matrix = \"M1\"",
                "matrix = \"Ml\"",
                "matrix \"Ml\" is unknown; known: D1, D2, E, F, M1, M2, P1, P2, Q, R, R1, R2, R_world, T, T_world; did you mean",
            ),
            ("width_px = 6,", "width_px = 7,", "\"left\" was recorded with 6 × 4 px, but 7 × 4 px in "),
            (", rotation = \"R\"", "", "one of rotation and translation of \"right\" is missing"),
            (
                "right = \"right\" }",
                "right = \"rigth\" }",
                "\"rigth\" is unknown; known: left, right; did you mean",
            ),
            ("steps = 3", "steps = 2", "steps = 2"),
            (
                "first = 1",
                "channel = [\"red\", \"blue\"]",
                "2 channels are listed, but the sequence has 3 frames",
            ),
            ("first = 1", "mosaic = \"rgbg\"", "rgbg"),
            ("matrix = \"M1\"", "matrx = \"M1\"", "did you mean \"matrix\"?"),
        ] {
            assert!(LAYOUT.contains(from), "{from}");
            let error = run(&LAYOUT.replacen(from, to, 1)).unwrap_err();
            assert!(error.contains(expected), "{error}\nlacks\n{expected}");
        }
    }
}
