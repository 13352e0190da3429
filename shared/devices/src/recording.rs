//! A camera that plays the frames of a recording, and the pace at which they come.

use crate::device::{Camera, Projector};
use crate::error::DeviceError;
use crate::load::LoadedCell;
use cell::configuration::ProjectorConfig;
use files::error::FileError;
use files::hash::sha256_hex;
use files::recording::Recording;
use fringe::frame::Pixels;

/// Reads one frame per exposure, and only as it was when the camera was opened.
pub struct RecordedCamera {
    recording: Recording,
    /// Hashes of the files, by projector and frame; empty where the camera did not look.
    files: Vec<Vec<u128>>,
    repeat: bool,
    camera: String,
    projectors: Vec<String>,
}

impl RecordedCamera {
    /// Takes the recording that the configuration opened.
    pub fn new(cell: &LoadedCell, camera: usize) -> Result<Self, DeviceError> {
        let config = &cell.config;
        let played = cell.file.recording.as_ref().ok_or(DeviceError::Missing("recording"))?;
        let (recording, name) = (played.recording.clone(), config.cameras[camera].name.clone());
        let of = |projector: &ProjectorConfig| {
            let frames = recording.projector(&projector.name).and_then(|p| p.camera(&name));
            let count = frames.map_or(0, |camera| camera.shown().count());
            (0..count).map(|frame| recording.file_hash(&projector.name, &name, frame)).collect()
        };
        let files = config.projectors.iter().map(of).collect::<Result<Vec<_>, FileError>>()?;
        let projectors = config.projectors.iter().map(|p| p.name.clone()).collect();
        Ok(Self { files, recording, repeat: played.repeat, camera: name, projectors })
    }

    /// One hash of all files.
    pub fn content(&self) -> String {
        let all: Vec<u8> = self.files.iter().flatten().flat_map(|hash| hash.to_le_bytes()).collect();
        sha256_hex(&all)
    }
}

impl Camera for RecordedCamera {
    fn begin(&mut self, cycle: u64) -> Result<(), DeviceError> {
        if cycle > 0 && !self.repeat {
            let folder = self.recording.folder.display();
            return Err(DeviceError::Frame(format!(
                "the recording {folder} is at its end; set recording.loop = true to begin again"
            )));
        }
        Ok(())
    }

    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<(), DeviceError> {
        let hash = self.files.get(projector).and_then(|files| files.get(frame)).copied();
        let hash = hash.ok_or(DeviceError::Missing("frame of the recording"))?;
        let name = &self.projectors[projector];
        let loaded = self.recording.load_unchanged(name, &self.camera, frame, hash)?;
        let view = loaded.view();
        let bytes: &[u8] = match view.pixels {
            Pixels::Mono8(values) => values,
            Pixels::Mono16(values) => bytemuck::cast_slice(values),
        };
        if bytes.len() != out.len() {
            return Err(DeviceError::Frame(format!(
                "frame {} of camera \"{}\" under projector \"{}\" has {} × {} px in {} bytes, {} bytes were expected; was \
                 the recording changed?",
                frame + 1,
                self.camera,
                self.projectors[projector],
                view.width_px,
                view.height_px,
                bytes.len(),
                out.len()
            )));
        }
        out.copy_from_slice(bytes);
        Ok(())
    }
}

/// Lets patterns follow each other at a rate, or as fast as they can.
pub struct Pace {
    period_ns: u64,
    due_ns: Option<u64>,
}

impl Pace {
    /// Frames per second; 0: as fast as possible.
    pub fn new(rate_hz: f64) -> Self {
        let period_ns = if rate_hz > 0.0 { (1e9 / rate_hz) as u64 } else { 0 };
        Self { period_ns, due_ns: None }
    }
}

impl Projector for Pace {
    fn begin(&mut self, _cycle: u64, now_ns: u64) -> Result<(), DeviceError> {
        self.due_ns = (self.period_ns > 0).then_some(now_ns);
        Ok(())
    }

    fn due_ns(&self) -> Option<u64> {
        self.due_ns
    }

    fn show(&mut self, _projector: usize, _frame: usize, now_ns: u64) -> Result<(), DeviceError> {
        // A late frame does not make the next ones hurry.
        self.due_ns = self.due_ns.map(|due| due.max(now_ns.saturating_sub(self.period_ns)) + self.period_ns);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_follow_at_the_rate_and_a_late_one_is_not_made_up_for() {
        let mut pace = Pace::new(100.0);
        pace.begin(0, 1000).unwrap();
        assert_eq!(pace.due_ns(), Some(1000));
        pace.show(0, 0, 1000).unwrap();
        assert_eq!(pace.due_ns(), Some(10_001_000));
        pace.show(0, 1, 95_000_000).unwrap();
        assert_eq!(pace.due_ns(), Some(95_000_000));
        let mut free = Pace::new(0.0);
        free.begin(0, 5).unwrap();
        assert_eq!(free.due_ns(), None);
    }
}
