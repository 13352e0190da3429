//! A camera that plays the frames of a recording, and the pace at which they come.

use super::device::{Camera, Projector};
use crate::graph::Cell;
use anyhow::{Result, anyhow, bail};
use files::recording::Recording;
use fringe::frame::Pixels;
use ipc::payload::mono16_mut;

/// Reads one frame per exposure.
pub struct RecordedCamera {
    recording: Recording,
    repeat: bool,
    camera: String,
    projectors: Vec<String>,
}

impl RecordedCamera {
    /// Takes the recording that the configuration opened.
    pub fn new(cell: &Cell, camera: usize) -> Result<Self> {
        let config = &cell.config;
        let played =
            config.recording.as_ref().ok_or_else(|| anyhow!("the configuration has no [recording]"))?;
        Ok(Self {
            recording: played.recording.clone(),
            repeat: played.repeat,
            camera: config.cameras[camera].name.clone(),
            projectors: config.projectors.iter().map(|p| p.name.clone()).collect(),
        })
    }
}

impl Camera for RecordedCamera {
    fn begin(&mut self, cycle: u64) -> Result<()> {
        if cycle > 0 && !self.repeat {
            let folder = self.recording.folder.display();
            bail!("the recording {folder} is at its end; set recording.loop = true to begin again");
        }
        Ok(())
    }

    fn expose(&mut self, projector: usize, frame: usize, out: &mut [u8]) -> Result<()> {
        let loaded = self.recording.load(&self.projectors[projector], &self.camera, frame)?;
        let differs = |n: usize| anyhow!("frame {frame} has {n} pixels, the rig file says {}", out.len());
        match loaded.view().pixels {
            Pixels::Mono8(values) if values.len() == out.len() => out.copy_from_slice(values),
            Pixels::Mono16(values) if 2 * values.len() == out.len() => {
                mono16_mut(out)?.copy_from_slice(values);
            }
            other => return Err(differs(other.len())),
        }
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
    fn begin(&mut self, now_ns: u64) {
        self.due_ns = (self.period_ns > 0).then_some(now_ns);
    }

    fn due_ns(&self) -> Option<u64> {
        self.due_ns
    }

    fn show(&mut self, _projector: usize, _frame: usize, now_ns: u64) -> Result<()> {
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
        pace.begin(1000);
        assert_eq!(pace.due_ns(), Some(1000));
        pace.show(0, 0, 1000).unwrap();
        assert_eq!(pace.due_ns(), Some(10_001_000));
        pace.show(0, 1, 95_000_000).unwrap();
        assert_eq!(pace.due_ns(), Some(95_000_000));
        let mut free = Pace::new(0.0);
        free.begin(5);
        assert_eq!(free.due_ns(), None);
    }
}
