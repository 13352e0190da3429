//! The images that were searched for the target; they are read again when drawn, since all of them would not fit into memory.

use anyhow::Result;
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::frame::{Frame, PixelBuffer};
use fringe::pattern::PatternSet;
use std::collections::BTreeSet;
use std::path::PathBuf;

/// An image of a camera, whether the target was found in it or not.
pub struct TargetImage {
    /// File, or recording and camera.
    pub place: String,
    /// Index of the camera.
    pub device: usize,
    /// Index of the pose.
    pub pose: usize,
    /// Why no target was found; `None` where it was.
    pub why: Option<String>,
    /// Where the image is read from.
    pub source: Source,
}

/// Where an image is stored.
pub enum Source {
    /// A single image file.
    File(PathBuf),
    /// The bright frame of a recording.
    Recorded(Box<(Recording, RecordedProjector, RecordedCamera)>),
}

impl TargetImage {
    /// Reads the image again.
    pub fn load(&self) -> Result<Frame> {
        match &self.source {
            Source::File(path) => Ok(files::image_file::read_foreign_frame(path, None)?),
            Source::Recorded(place) => bright_frame(&place.0, &place.1, &place.2),
        }
    }
}

/// The white frame, or the mean of the first sine set where there is none, or that of the frames of a code: with its inverse they are even light.
pub fn bright_frame(
    recording: &Recording,
    projector: &RecordedProjector,
    camera: &RecordedCamera,
) -> Result<Frame> {
    let mut first = 0;
    let (mut sines, mut codes) = (BTreeSet::new(), BTreeSet::new());
    for set in &projector.sequence {
        match set {
            PatternSet::White {} => return Ok(recording.load(&projector.name, &camera.name, first)?),
            PatternSet::Sine { .. } | PatternSet::Lines { .. } | PatternSet::Modulated { .. }
                if sines.is_empty() =>
            {
                sines.extend(first..first + set.frames());
            }
            // The first frequency has steps; the further frames are no even light.
            PatternSet::Micro { .. } if sines.is_empty() => sines.extend(first..first + 3),
            _ => {}
        }
        if matches!(set, PatternSet::Gray { .. }) {
            codes.extend(first..first + set.frames());
        }
        first += set.frames();
    }
    let frames = if sines.is_empty() { codes } else { sines }
        .iter()
        .map(|n| Ok(recording.load(&projector.name, &camera.name, *n)?))
        .collect::<Result<Vec<_>>>()?;
    mean(&frames).ok_or_else(|| {
        anyhow::anyhow!(
            "{}: projector \"{}\" shows neither white nor sines nor a code: the target cannot be seen",
            recording.document.path.display(),
            projector.name
        )
    })
}

fn mean(frames: &[Frame]) -> Option<Frame> {
    let first = frames.first()?;
    let views: Vec<_> = frames.iter().map(Frame::view).collect();
    // Sixteen bits, so that the mean of many frames keeps what it gained.
    let scale = f32::from(u16::MAX) / f32::from(first.full_scale_dn) / frames.len() as f32;
    let pixels = (0..views[0].pixels.len())
        .map(|i| (views.iter().map(|v| v.pixels.get(i)).sum::<f32>() * scale).round() as u16)
        .collect();
    let pixels = PixelBuffer::Mono16(pixels);
    Some(Frame { width_px: first.width_px, height_px: first.height_px, full_scale_dn: u16::MAX, pixels })
}
