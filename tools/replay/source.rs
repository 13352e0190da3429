//! The frames of a replay: those in the record, or those that the drivers give again.

use anyhow::Result;
use cell::Cell;
use cell::Retention;
use cell::executor::{Frames, SourceError};
use cell::schedule::Work;
use devices::Driven;
use devices::LoadedCell;
use files::cycle_record::{RecordReader, RecordedCycle};
use std::collections::BTreeMap;

/// Where frames come from.
pub enum Source<'a> {
    /// From recording or twin.
    Driven(Driven<'a>),
    /// From the cycle record.
    Recorded {
        /// The cell whose frames these are.
        cell: &'a Cell,
        /// Those of one cycle, by activation.
        frames: BTreeMap<usize, Vec<u8>>,
    },
}

impl<'a> Source<'a> {
    /// Frames that the record holds are preferred: they are what was measured.
    pub fn new(cell: &'a LoadedCell, kept: Retention) -> Result<Self> {
        Ok(match kept {
            Retention::Hashes => Self::Driven(Driven::new(cell)?),
            Retention::Frames | Retention::All => Self::Recorded { cell, frames: BTreeMap::new() },
        })
    }

    /// Gets the frames of a cycle ready.
    pub fn load(&mut self, reader: &mut RecordReader, cycle: &RecordedCycle) -> Result<()> {
        match self {
            Self::Driven(driven) => Ok(driven.begin(cycle.entry.cycle)?),
            Self::Recorded { cell, frames } => {
                frames.clear();
                for (&number, value) in &cycle.values {
                    let activation = cell.schedule.activations.get(number as usize);
                    if activation.is_some_and(|a| matches!(a.work, Work::Expose { .. })) {
                        frames.insert(number as usize, reader.load(value)?);
                    }
                }
                Ok(())
            }
        }
    }
}

impl Frames for Source<'_> {
    fn expose(&mut self, activation: usize, out: &mut [u8]) -> Result<(), SourceError> {
        match self {
            Self::Driven(driven) => driven.expose(activation, out),
            Self::Recorded { frames, .. } => {
                let frame = frames.get(&activation).ok_or("the record does not hold this frame")?;
                if frame.len() != out.len() {
                    let (here, there) = (frame.len(), out.len());
                    return Err(format!("the frame has {here} bytes, the configuration wants {there}").into());
                }
                out.copy_from_slice(frame);
                Ok(())
            }
        }
    }
}
