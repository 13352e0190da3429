//! A recording as it was read.

use crate::document::{Document, read_bytes};
use crate::error::{FileError, Problem};
use crate::image_file::{decode_frame, read_frame};
use crate::rig_file::resolve_pairs;
use fringe::frame::Frame;
use fringe::geometry::rig::{Pair, Rig};
use fringe::pattern::PatternSet;
use std::path::{Path, PathBuf};
use twox_hash::XxHash3_128;

/// Longest file of a frame: all pixels that a frame may have, uncompressed.
const FRAME_LIMIT_BYTES: u64 = 1 << 32;

/// Value of `format` in a recording.
pub const RECORDING_FORMAT: &str = "fringecell-recording/1";

/// Name of the file that makes a folder a recording; it is written last.
pub const RECORDING_FILE: &str = "recording.toml";

/// Folder of a recording that holds its frames.
pub const FRAMES_FOLDER: &str = "frames";

/// A recording whose frames are all there: counted, named and of equal size, but not yet decoded.
#[derive(Debug, Clone)]
pub struct Recording {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// `recording.toml`, for messages that point into it.
    pub document: Document,
    /// SHA-256 of `recording.toml`, hexadecimal.
    pub sha256: String,
    /// What lit, in the order of projection.
    pub projectors: Vec<RecordedProjector>,
    /// Anything else that was written down.
    pub provenance: toml::Table,
}

/// A projector of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedProjector {
    /// Name, unique among the projectors.
    pub name: String,
    /// Columns of the projector, px.
    pub width_px: u32,
    /// Rows of the projector, px.
    pub height_px: u32,
    /// Pattern sets, in the order of projection.
    pub sequence: Vec<PatternSet>,
    /// What became of the sets that miss frames, for people; empty where all are there.
    pub notes: Vec<String>,
    /// Exposure times, rising or not, of recordings that have several; else empty.
    pub exposures_ms: Vec<f64>,
    /// Cameras with frames of this projector.
    pub cameras: Vec<RecordedCamera>,
}

/// What one camera saw of one projector.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedCamera {
    /// Unique among the cameras of the projector.
    pub name: String,
    /// Columns of the frames, px.
    pub width_px: u32,
    /// Rows of the frames, px.
    pub height_px: u32,
    /// Bits of a grey value, 8 or 16.
    pub bits: u8,
    /// The grey value at which the sensor is full.
    pub full_scale_dn: u16,
    /// One file per frame of the sequence.
    pub frames: Vec<PathBuf>,
    /// The same for the second and further exposures.
    pub longer: Vec<Vec<PathBuf>>,
}

/// A rig fitted to what a recording holds.
#[derive(Debug, Clone)]
pub struct RecordedRig {
    /// The rig; its pairs are those that were recorded, in the order of the rig file, each with its projector.
    pub rig: Rig,
    /// Pairs of the rig file that were not recorded.
    pub absent_pairs: Vec<Pair>,
}

impl Recording {
    /// A projector by name.
    pub fn projector(&self, name: &str) -> Option<&RecordedProjector> {
        self.projectors.iter().find(|projector| projector.name == name)
    }

    /// Decodes one frame; frames count on from one exposure to the next.
    ///
    /// # Errors
    /// Unknown names, a number beyond the sequence, or a file that does not decode (truncated, changed since opened).
    pub fn load(&self, projector: &str, camera: &str, frame: usize) -> Result<Frame, FileError> {
        let (camera, path) = self.place(projector, camera, frame)?;
        camera.check(path, read_frame(path, camera.full_scale())?)
    }

    /// The hash of the file of one frame (xxh3, 128 bits): what a later reading must find again.
    ///
    /// # Errors
    /// As [`Self::load`].
    pub fn file_hash(&self, projector: &str, camera: &str, frame: usize) -> Result<u128, FileError> {
        let (_, path) = self.place(projector, camera, frame)?;
        Ok(XxHash3_128::oneshot(&read_bytes(path, FRAME_LIMIT_BYTES)?))
    }

    /// Decodes one frame whose file still is what it was when [`Self::file_hash`] was taken.
    ///
    /// # Errors
    /// As [`Self::load`]; a file that was changed meanwhile.
    pub fn load_unchanged(
        &self,
        projector: &str,
        camera: &str,
        frame: usize,
        hash: u128,
    ) -> Result<Frame, FileError> {
        let (of, path) = self.place(projector, camera, frame)?;
        let bytes = read_bytes(path, FRAME_LIMIT_BYTES)?;
        if XxHash3_128::oneshot(&bytes) != hash {
            let problem = Problem::Unsupported(format!(
                "frame {frame:03} of camera \"{camera}\" under projector \"{projector}\" was changed while the recording \
                 is played"
            ));
            return Err(FileError::new(
                path,
                problem,
                "restore the file, or stop the cell and start it again",
            ));
        }
        of.check(path, decode_frame(path, bytes, of.full_scale())?)
    }

    /// The camera and the file of a frame.
    fn place(
        &self,
        projector: &str,
        camera: &str,
        frame: usize,
    ) -> Result<(&RecordedCamera, &Path), FileError> {
        let absent =
            |what: String| FileError::new(&self.folder, Problem::Missing(what), "see recording.toml");
        let camera = self
            .projector(projector)
            .and_then(|projector| projector.camera(camera))
            .ok_or_else(|| absent(format!("projector \"{projector}\" with camera \"{camera}\"")))?;
        let (path, count) = (camera.shown().nth(frame), camera.shown().count());
        let path =
            path.ok_or_else(|| absent(format!("frame {frame} of {count} of camera \"{}\"", camera.name)))?;
        Ok((camera, path))
    }

    /// Which cameras saw which projector, as [`resolve_pairs`] takes it.
    pub(super) fn resolve(&self, rig_path: &Path, rig: &mut Rig) -> Result<(), FileError> {
        let names: Vec<(String, Vec<String>)> = self
            .projectors
            .iter()
            .map(|p| (p.name.clone(), p.cameras.iter().map(|camera| camera.name.clone()).collect()))
            .collect();
        let lit: Vec<_> = names.iter().map(|(name, cameras)| (name.as_str(), cameras.as_slice())).collect();
        resolve_pairs(rig_path, rig, &lit)
    }
}

impl RecordedProjector {
    /// A camera by name.
    pub fn camera(&self, name: &str) -> Option<&RecordedCamera> {
        self.cameras.iter().find(|camera| camera.name == name)
    }
}

impl RecordedCamera {
    /// All frames, exposure by exposure.
    pub fn shown(&self) -> impl Iterator<Item = &PathBuf> {
        self.frames.iter().chain(self.longer.iter().flatten())
    }

    /// The full scale as the files cannot say it.
    fn full_scale(&self) -> Option<u16> {
        (self.bits == 16).then_some(self.full_scale_dn)
    }

    /// Refuses a frame of another size than when the recording was opened.
    fn check(&self, path: &Path, frame: Frame) -> Result<Frame, FileError> {
        let (found, expected) = ((frame.width_px, frame.height_px), (self.width_px, self.height_px));
        if found != expected {
            let problem = Problem::Disagreement {
                what: "sizes",
                here: format!("this frame has {} × {} px", found.0, found.1),
                there: format!("{} × {} px when the recording was opened", expected.0, expected.1),
            };
            return Err(FileError::new(path, problem, "do not change a recording while it is read"));
        }
        Ok(frame)
    }
}
