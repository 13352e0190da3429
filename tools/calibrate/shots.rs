//! The pictures that were looked at, to be read again when they are drawn: kept in memory they would be gigabytes.

use super::sights::bright_frame;
use anyhow::Result;
use fringe::frame::Frame;
use rig::recording::{RecordedCamera, RecordedProjector, Recording};
use std::path::PathBuf;

/// A picture of a camera, whether it shows the target or not.
pub struct Shot {
    /// File, or recording and camera.
    pub place: String,
    /// Camera.
    pub device: usize,
    /// Pose.
    pub pose: usize,
    /// Why there is no target in it.
    pub why: Option<String>,
    /// Where it is.
    pub source: Source,
}

/// Where a picture is.
pub enum Source {
    /// An image file.
    File(PathBuf),
    /// The bright frame of a recording.
    Recorded(Box<(Recording, RecordedProjector, RecordedCamera)>),
}

impl Shot {
    /// Reads the picture again.
    pub fn load(&self) -> Result<Frame> {
        match &self.source {
            Source::File(path) => Ok(rig::image_file::read_foreign_frame(path, None)?),
            Source::Recorded(place) => bright_frame(&place.0, &place.1, &place.2),
        }
    }
}
