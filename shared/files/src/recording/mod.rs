//! Recordings: a folder of frames and a `recording.toml` that states what was projected and who saw it.
//!
//! ```text
//! recording.toml
//! frames/<projector>/<camera>/<NNN>.png     NNN from 000, in order of projection; PNG or TIFF, 8- or 16-bit grey
//! ```
//! Beyond the contract a `[[projector]]` may carry `full_scale_dn` (one number, or a table by camera): the grey value at
//! which the sensor is full in 16-bit files, such as 4095 for 12 bits; without it 65535. 8-bit files are full at 255.
//!
//! Frames of several exposures (for shiny parts): `exposures_ms = [2.0, 8.0, 32.0]` in the `[[projector]]`, and beside `<NNN>.png`, which is
//! the first exposure, `<NNN>_1.png`, `<NNN>_2.png`. A program that only knows `<NNN>.png` reads the first exposure.

mod fit;
mod frames;
mod model;
mod read;
#[cfg(test)]
mod tests;
mod write;

pub use model::{
    FRAMES_FOLDER, RECORDING_FILE, RECORDING_FORMAT, RecordedCamera, RecordedProjector, RecordedRig,
    Recording,
};
pub use write::{ProjectorRecord, RecordingWriter, recording_text, set_text};

use crate::error::FileError;
use crate::rig_file::RigFile;
use std::path::Path;

impl Recording {
    /// Opens a recording folder (or its `recording.toml`) and checks that every frame is there.
    ///
    /// # Errors
    /// Not a recording, keys that are unknown or impossible, frames missing, extra, of unequal size or depth.
    pub fn open(folder: &Path) -> Result<Self, FileError> {
        read::open(folder)
    }

    /// The rig for this recording: sizes compared, pairs limited to those that were recorded, projectors resolved.
    ///
    /// # Errors
    /// A recorded camera that the rig does not know or has in another size; no pair at all; a pair without projector.
    pub fn rig(&self, rig_file: &RigFile) -> Result<RecordedRig, FileError> {
        fit::fit(self, rig_file)
    }
}
