//! Whose turn it is in each lane of a schedule: one number per lane in memory that the processes of a cell share.
//!
//! The number holds the cycle and the place in the lane's order. Who has the place works, then passes the turn on. A stage
//! that dies with the turn loses its cycle, and the next cycle sets the numbers anew: there is no lock to be left taken.
#![allow(unsafe_code)]

use crate::cell::CellName;
use crate::error::IpcError;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsRawFd;
use std::path::PathBuf;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

/// Each number has a cache line of its own.
#[repr(align(64))]
struct Line(AtomicU64);

/// Bits of a number that hold the place; the cycle has the others. A million activations per lane.
const PLACE_BITS: u32 = 20;

/// A place in a lane's order in a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// Cycle on the wire.
    pub cycle: u64,
    /// Activations of the lane that are done.
    pub place: usize,
}

impl Turn {
    fn to_bits(self) -> u64 {
        (self.cycle << PLACE_BITS) | (self.place as u64 & ((1 << PLACE_BITS) - 1))
    }
}

/// The numbers of all lanes of a cell.
#[derive(Debug)]
pub struct Turns {
    start: NonNull<Line>,
    lanes: usize,
}

impl Turns {
    /// Makes the numbers; the supervisor does it once, before any stage starts.
    ///
    /// # Errors
    /// [`IpcError::File`].
    pub fn create(cell: &CellName, lanes: usize) -> Result<Self, IpcError> {
        let path = path(cell);
        let made = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&path);
        let file = made.map_err(|source| file_error(cell, "creating", source))?;
        let sized = file.set_len((lanes * size_of::<Line>()) as u64);
        sized.map_err(|source| file_error(cell, "making room in", source))?;
        map(&file, lanes).map_err(|source| file_error(cell, "mapping", source))
    }

    /// The numbers that the supervisor made.
    ///
    /// # Errors
    /// [`IpcError::File`], also for another number of lanes.
    pub fn open(cell: &CellName, lanes: usize) -> Result<Self, IpcError> {
        let opened = OpenOptions::new().read(true).write(true).open(path(cell));
        let file = opened.map_err(|source| file_error(cell, "opening", source))?;
        let there = file.metadata().map_err(|source| file_error(cell, "measuring", source))?.len();
        if there != (lanes * size_of::<Line>()) as u64 {
            let reason = format!("{there} bytes for {lanes} lanes");
            return Err(file_error(cell, "opening", io::Error::other(reason)));
        }
        map(&file, lanes).map_err(|source| file_error(cell, "mapping", source))
    }

    /// Gives the first place of some lanes to a cycle.
    pub fn begin(&self, lanes: impl IntoIterator<Item = usize>, cycle: u64) {
        for lane in lanes.into_iter().filter(|&lane| lane < self.lanes) {
            self.number(lane).store(Turn { cycle, place: 0 }.to_bits(), Ordering::Release);
        }
    }

    /// Whether it is this place's turn.
    pub fn is(&self, lane: usize, turn: Turn) -> bool {
        lane < self.lanes && self.number(lane).load(Ordering::Acquire) == turn.to_bits()
    }

    /// Whether this place of the same cycle has had its turn and passed it on.
    pub fn is_past(&self, lane: usize, turn: Turn) -> bool {
        let now = if lane < self.lanes { self.number(lane).load(Ordering::Acquire) } else { 0 };
        now >> PLACE_BITS == turn.cycle && now > turn.to_bits()
    }

    /// The same, or the lane is at a later cycle already: for work that may lag behind the lane by whole cycles.
    pub fn was_past(&self, lane: usize, turn: Turn) -> bool {
        lane < self.lanes && self.number(lane).load(Ordering::Acquire) > turn.to_bits()
    }

    /// Passes the turn on to the next place. Does nothing when the cycle is over meanwhile.
    pub fn pass(&self, lane: usize, turn: Turn) {
        if lane < self.lanes {
            let next = Turn { place: turn.place + 1, ..turn };
            let _over = self.number(lane).compare_exchange(
                turn.to_bits(),
                next.to_bits(),
                Ordering::AcqRel,
                Ordering::Acquire,
            );
        }
    }

    fn number(&self, lane: usize) -> &AtomicU64 {
        debug_assert!(lane < self.lanes);
        // SAFETY: the mapping holds `lanes` lines from the beginning of a page and lives as long as self; any bytes are a
        // number, and all processes touch them only as this atomic.
        unsafe { &(*self.start.as_ptr().add(lane)).0 }
    }
}

impl Drop for Turns {
    fn drop(&mut self) {
        // SAFETY: the mapping that `map` made, which nobody uses after this.
        unsafe { libc::munmap(self.start.as_ptr().cast(), self.lanes * size_of::<Line>()) };
    }
}

fn map(file: &File, lanes: usize) -> io::Result<Turns> {
    // SAFETY: a new mapping of an open file of that size; the file may be closed afterwards.
    let start = unsafe {
        libc::mmap(
            std::ptr::null_mut(),
            lanes * size_of::<Line>(),
            libc::PROT_READ | libc::PROT_WRITE,
            libc::MAP_SHARED,
            file.as_raw_fd(),
            0,
        )
    };
    if start == libc::MAP_FAILED {
        return Err(io::Error::last_os_error());
    }
    NonNull::new(start.cast())
        .map(|start| Turns { start, lanes })
        .ok_or_else(|| io::Error::other("no address"))
}

fn path(cell: &CellName) -> PathBuf {
    cell.folder().join("turns")
}

fn file_error(cell: &CellName, action: &'static str, source: io::Error) -> IpcError {
    IpcError::File { path: path(cell), action, source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::CellLock;

    #[test]
    fn the_turn_goes_round_between_processes_and_a_late_stage_of_an_old_cycle_cannot_pass_it() {
        let name = CellName::new(&format!("turns{}", std::process::id())).unwrap();
        let _lock = CellLock::take(&name).unwrap();
        let supervisor = Turns::create(&name, 3).unwrap();
        let stage = Turns::open(&name, 3).unwrap();
        assert!(Turns::open(&name, 2).is_err());
        supervisor.begin(0..3, 7);
        let first = Turn { cycle: 7, place: 0 };
        let second = Turn { cycle: 7, place: 1 };
        assert!(stage.is(1, first) && !stage.is(1, second) && !stage.is(3, first));
        stage.pass(1, first);
        assert!(supervisor.is(1, second) && supervisor.is(2, first));
        assert!(
            supervisor.is_past(1, first) && !supervisor.is_past(1, second) && !supervisor.is_past(2, first)
        );
        assert!(!supervisor.is_past(3, first), "a lane that there is not");
        supervisor.begin(0..3, 8);
        assert!(!stage.is_past(1, first), "another cycle's turns say nothing");
        assert!(stage.was_past(1, first) && !stage.was_past(3, first));
        stage.pass(1, second);
        assert!(supervisor.is(1, Turn { cycle: 8, place: 0 }));
        supervisor.begin([2], 9);
        assert!(stage.is(2, Turn { cycle: 9, place: 0 }) && !stage.is(1, Turn { cycle: 9, place: 0 }));
        assert!(!stage.was_past(1, Turn { cycle: 8, place: 0 }), "its turn has come but is not passed on");
    }
}
