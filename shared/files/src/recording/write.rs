//! Writing a recording: frames first, `recording.toml` last, so that one that was broken off is recognisable.

use super::{FRAMES_FOLDER, RECORDING_FILE, RECORDING_FORMAT};
use crate::atomic;
use crate::error::{FileError, Problem};
use crate::image_file::{Channel, read_channel, read_header, write_png};
use crate::mosaic::Mosaic;
use crate::name::{check_name, duplicate};
use crate::rig_file::quoted;
use fringe::frame::FrameView;
use fringe::pattern::{PatternSet, frame_count};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// What will be recorded of one projector.
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectorRecord {
    /// Name, unique among the projectors.
    pub name: String,
    /// Columns of the projector, px.
    pub width_px: u32,
    /// Rows of the projector, px.
    pub height_px: u32,
    /// Names of the cameras that take frames.
    pub cameras: Vec<String>,
    /// Pattern sets, in the order of projection.
    pub sequence: Vec<PatternSet>,
    /// Exposure times where there are several; else empty.
    pub exposures_ms: Vec<f64>,
    /// For 16-bit frames of cameras that are full below 65535, by camera. [`RecordingWriter`] fills it in.
    pub full_scale_dn: BTreeMap<String, u16>,
}

/// Writes a recording frame by frame, in any order. One that is dropped before [`RecordingWriter::finish`] takes its
/// frames with it.
#[derive(Debug)]
pub struct RecordingWriter {
    folder: PathBuf,
    /// Whether the folder was made by this writer.
    made: bool,
    /// Whether the frames are part of a complete recording.
    finished: bool,
    projectors: Vec<ProjectorRecord>,
    /// Which frames are written, by projector and camera; those of the first exposure come first.
    written: Vec<Vec<Vec<bool>>>,
    /// Size and full scale of each camera, from its first frame.
    sizes: BTreeMap<String, (u32, u32, u16)>,
}

impl RecordingWriter {
    /// Makes the folders. The folder itself may exist but must be empty.
    ///
    /// # Errors
    /// A folder that holds something, names that cannot be folders, a place that cannot be written.
    pub fn create(folder: &Path, projectors: &[ProjectorRecord]) -> Result<Self, FileError> {
        let at = |problem| FileError::new(folder, problem, "");
        let cameras = projectors.iter().flat_map(|projector| &projector.cameras);
        for name in projectors.iter().map(|projector| &projector.name).chain(cameras) {
            check_name(name).map_err(at)?;
        }
        if let Some((_, name)) = duplicate(projectors.iter().map(|projector| projector.name.as_str())) {
            return Err(at(Problem::Duplicate { kind: "projector", name: name.to_owned() }));
        }
        for projector in projectors {
            if let Some((_, name)) = duplicate(projector.cameras.iter().map(String::as_str)) {
                return Err(at(Problem::Duplicate { kind: "camera", name: name.to_owned() }));
            }
        }
        refuse_used(folder)?;
        let empty = |projector: &ProjectorRecord| {
            let frames = frame_count(&projector.sequence) * projector.exposures_ms.len().max(1);
            vec![vec![false; frames]; projector.cameras.len()]
        };
        let writer = Self {
            folder: folder.to_owned(),
            made: !folder.exists(),
            finished: false,
            written: projectors.iter().map(empty).collect(),
            projectors: projectors.to_vec(),
            sizes: BTreeMap::new(),
        };
        for projector in projectors {
            for camera in &projector.cameras {
                atomic::create_dir(&folder.join(FRAMES_FOLDER).join(&projector.name).join(camera))?;
            }
        }
        Ok(writer)
    }

    /// Writes one frame; frames count on from one exposure to the next.
    ///
    /// # Errors
    /// Unknown names, a number beyond the sequence, a frame written twice or of another size, a full disk.
    pub fn write(
        &mut self,
        projector: &str,
        camera: &str,
        frame: usize,
        view: &FrameView<'_>,
    ) -> Result<(), FileError> {
        let place = self.place(projector, camera, frame).with_extension("png");
        let size = (view.width_px, view.height_px, view.full_scale_dn);
        let slot = self.slot(projector, camera, frame, size, &place)?;
        write_png(&place, view)?;
        *slot = true;
        Ok(())
    }

    /// Takes a frame from a foreign file: PNG and TIFF as they are,
    /// others, and channels of colour pictures, by conversion to PNG. `full_scale_dn` is for 16-bit files, as in [`crate::image_file::read_frame`];
    /// with a mosaic the file is the raw picture behind it.
    ///
    /// # Errors
    /// As [`Self::write`], or a file that is no frame.
    pub fn adopt(
        &mut self,
        projector: &str,
        camera: &str,
        frame: usize,
        file: &Path,
        (full_scale_dn, channel, mosaic): (Option<u16>, Channel, Option<Mosaic>),
    ) -> Result<(), FileError> {
        let content = match mosaic {
            None => read_channel(file, full_scale_dn, channel)?,
            Some(mosaic) => mosaic.frame(read_channel(file, full_scale_dn, Channel::Grey)?, channel),
        };
        let extension = file.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        let as_it_is = ["png", "tif", "tiff"].contains(&extension.as_str())
            && read_header(file).is_ok_and(|head| {
                !head.alpha && (channel == Channel::Grey || (!head.colour && mosaic.is_none()))
            });
        if !as_it_is {
            return self.write(projector, camera, frame, &content.view());
        }
        let place = self.place(projector, camera, frame).with_extension(extension);
        let size = (content.width_px, content.height_px, content.full_scale_dn);
        let slot = self.slot(projector, camera, frame, size, &place)?;
        if place.exists() {
            return Err(FileError::new(&place, Problem::Unsupported("exists already".into()), ""));
        }
        // A copy and no hard link: who writes over a frame of the recording must not write over the original.
        if let Err(source) = std::fs::copy(file, &place) {
            // Half a frame must not stay.
            let _ = std::fs::remove_file(&place);
            return Err(FileError::io(&place, "copy the frame", source));
        }
        *slot = true;
        Ok(())
    }

    /// Path of a frame, without extension.
    fn place(&self, projector: &str, camera: &str, frame: usize) -> PathBuf {
        let shown = self.projectors.iter().find(|p| p.name == projector);
        let count = shown.map_or(0, |p| frame_count(&p.sequence)).max(1);
        let (exposure, frame) = (frame / count, frame % count);
        let name = if exposure == 0 { format!("{frame:03}") } else { format!("{frame:03}_{exposure}") };
        self.folder.join(FRAMES_FOLDER).join(projector).join(camera).join(name)
    }

    /// The mark of a frame that may be written with this size and full scale.
    fn slot(
        &mut self,
        projector: &str,
        camera: &str,
        frame: usize,
        size: (u32, u32, u16),
        place: &Path,
    ) -> Result<&mut bool, FileError> {
        let at = |problem| FileError::new(place, problem, "");
        let index = self.projectors.iter().position(|p| p.name == projector);
        let index =
            index.and_then(|p| Some((p, self.projectors[p].cameras.iter().position(|name| name == camera)?)));
        let slot = index.and_then(|(p, c)| self.written[p][c].get_mut(frame));
        let Some(slot) = slot else {
            return Err(at(Problem::Unsupported("belongs to no frame of the sequence".into())));
        };
        let first = *self.sizes.entry(camera.to_owned()).or_insert(size);
        if size != first {
            return Err(at(Problem::Disagreement {
                what: "frames",
                here: format!("this one has {} × {} px, full at {} DN", size.0, size.1, size.2),
                there: format!("the first one had {} × {} px, {} DN", first.0, first.1, first.2),
            }));
        }
        Ok(slot)
    }

    /// Writes `recording.toml`, which makes the folder a recording.
    ///
    /// # Errors
    /// A frame was never written; a full disk.
    pub fn finish(mut self, provenance: &toml::Table) -> Result<PathBuf, FileError> {
        for (projector, cameras) in self.projectors.iter().zip(&self.written) {
            for (camera, frames) in projector.cameras.iter().zip(cameras) {
                let missing = frames.iter().filter(|written| !**written).count();
                if missing > 0 {
                    let problem = Problem::Missing(format!(
                        "{missing} of {} frames of camera \"{camera}\" under \"{}\"",
                        frames.len(),
                        projector.name
                    ));
                    return Err(FileError::new(&self.folder, problem, "the recording was broken off"));
                }
            }
        }
        for projector in &mut self.projectors {
            let scales = projector.cameras.iter().filter_map(|name| {
                let (_, _, full) = self.sizes.get(name)?;
                (![255, u16::MAX].contains(full)).then(|| (name.clone(), *full))
            });
            projector.full_scale_dn = scales.collect();
        }
        let text = recording_text(&self.projectors, provenance);
        let path = self.folder.join(RECORDING_FILE);
        atomic::write(&path, text.as_bytes())?;
        self.finished = true;
        Ok(path)
    }
}

impl Drop for RecordingWriter {
    fn drop(&mut self) {
        if self.finished {
            return;
        }
        let _ = std::fs::remove_dir_all(self.folder.join(FRAMES_FOLDER));
        if self.made {
            // Only when nothing else came to lie there.
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

fn refuse_used(folder: &Path) -> Result<(), FileError> {
    if !folder.exists() {
        return Ok(());
    }
    let mut entries =
        std::fs::read_dir(folder).map_err(|source| FileError::io(folder, "list the folder", source))?;
    if entries.next().is_none() {
        return Ok(());
    }
    let problem = Problem::Unsupported("is not empty".into());
    Err(FileError::new(folder, problem, "a recording is written to a new or empty folder"))
}

/// The text of `recording.toml`.
pub fn recording_text(projectors: &[ProjectorRecord], provenance: &toml::Table) -> String {
    let mut out = format!("format = \"{RECORDING_FORMAT}\"\n");
    for projector in projectors {
        let cameras = projector.cameras.iter().map(|name| quoted(name)).collect::<Vec<_>>().join(", ");
        let _ = write!(
            out,
            "\n[[projector]]\nname = {}\nwidth_px = {}\nheight_px = {}\ncameras = [{cameras}]\n",
            quoted(&projector.name),
            projector.width_px,
            projector.height_px,
        );
        if !projector.full_scale_dn.is_empty() {
            let scales = projector.full_scale_dn.iter().map(|(name, dn)| format!("{} = {dn}", quoted(name)));
            let _ = writeln!(out, "full_scale_dn = {{ {} }}", scales.collect::<Vec<_>>().join(", "));
        }
        if !projector.exposures_ms.is_empty() {
            let times: Vec<String> = projector.exposures_ms.iter().map(|ms| format!("{ms:?}")).collect();
            let _ = writeln!(out, "exposures_ms = [{}]", times.join(", "));
        }
        out.push_str("sequence = [\n");
        for set in &projector.sequence {
            let _ = writeln!(out, "  {},", set_text(set));
        }
        out.push_str("]\n");
    }
    if !provenance.is_empty() {
        let mut holder = toml::Table::new();
        holder.insert("provenance".into(), toml::Value::Table(provenance.clone()));
        let _ = write!(out, "\n{holder}");
    }
    out
}

/// One set as an inline table, `set` and `axis` in front as in the contract.
pub fn set_text(set: &PatternSet) -> String {
    // A set is a flat table of numbers and words, which TOML can always hold.
    let table = toml::Table::try_from(set).unwrap_or_default();
    let rank = |key: &str| match key {
        "set" => 0,
        "axis" => 1,
        _ => 2,
    };
    let mut entries: Vec<(&String, &toml::Value)> = table.iter().collect();
    entries.sort_by_key(|(key, _)| rank(key));
    let parts: Vec<String> = entries.iter().map(|(key, value)| format!("{key} = {value}")).collect();
    format!("{{ {} }}", parts.join(", "))
}
