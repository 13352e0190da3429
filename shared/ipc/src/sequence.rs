//! Sequence gates: keep the activations of a lane in the order of the schedule, across processes.
//!
//! Each lane has one atomic counter in shared memory, which holds the cycle and the position in the lane's order. The stage
//! whose activation has that position works, then advances the counter. A stage that dies at its position loses the cycle,
//! and the next cycle resets the counter: there is no lock that could stay locked.
#![allow(unsafe_code)]

use crate::cell::CellName;
use crate::error::IpcError;
use crate::runtime_folder::RuntimeFolder;
use rustix::fs::{FallocateFlags, OFlags, fallocate};
use rustix::io::Errno;
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering};

/// Name of the file in the runtime folder.
const FILE: &str = "sequence";

/// A counter with a cache line of its own.
#[repr(align(64))]
struct Counter(AtomicU64);

/// Bits of a counter for the position (a million activations per lane); the others hold the cycle.
const POSITION_BITS: u32 = 20;

/// A position in the order of a lane, in one cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SequencePoint {
    /// Cycle as in messages.
    pub cycle: u64,
    /// Number of activations of the lane before this one.
    pub position: usize,
}

impl SequencePoint {
    fn to_bits(self) -> u64 {
        (self.cycle << POSITION_BITS) | (self.position as u64 & ((1 << POSITION_BITS) - 1))
    }
}

/// The gates of all lanes of a cell.
#[derive(Debug)]
pub struct SequenceGates {
    start: NonNull<Counter>,
    lanes: usize,
}

impl SequenceGates {
    /// Creates the gates. The supervisor does so once, before any stage starts.
    ///
    /// # Errors
    /// [`IpcError::File`].
    pub fn create(cell: &CellName, lanes: usize) -> Result<Self, IpcError> {
        let folder = RuntimeFolder::open(&cell.folder())?;
        let flags = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL;
        let file = folder.open_file(FILE, flags).map_err(|source| file_error(cell, "creating", source))?;
        let bytes = (lanes * size_of::<Counter>()) as u64;
        file.set_len(bytes).map_err(|source| file_error(cell, "resizing", source))?;
        // Now, while it is an error and no bus error at the first cycle.
        match fallocate(&file, FallocateFlags::empty(), 0, bytes) {
            Ok(()) | Err(Errno::OPNOTSUPP) => {}
            Err(error) => return Err(file_error(cell, "reserving the memory of", error.into())),
        }
        map(&file, lanes).map_err(|source| file_error(cell, "mapping", source))
    }

    /// Opens the gates that the supervisor created.
    ///
    /// # Errors
    /// [`IpcError::File`], also if the number of lanes differs.
    pub fn open(cell: &CellName, lanes: usize) -> Result<Self, IpcError> {
        let folder = RuntimeFolder::open(&cell.folder())?;
        let file =
            folder.open_file(FILE, OFlags::RDWR).map_err(|source| file_error(cell, "opening", source))?;
        let found = file.metadata().map_err(|source| file_error(cell, "reading the size of", source))?.len();
        if found != (lanes * size_of::<Counter>()) as u64 {
            let reason = format!("the file has {found} bytes, which is not the size for {lanes} lanes");
            return Err(file_error(cell, "opening", io::Error::other(reason)));
        }
        map(&file, lanes).map_err(|source| file_error(cell, "mapping", source))
    }

    /// Opens the first position of some lanes for a cycle.
    pub fn reset(&self, lanes: impl IntoIterator<Item = usize>, cycle: u64) {
        for lane in lanes.into_iter().filter(|&lane| lane < self.lanes) {
            self.counter(lane).store(SequencePoint { cycle, position: 0 }.to_bits(), Ordering::Release);
        }
    }

    /// Whether the lane is at this position.
    pub fn is_open(&self, lane: usize, point: SequencePoint) -> bool {
        lane < self.lanes && self.counter(lane).load(Ordering::Acquire) == point.to_bits()
    }

    /// Whether the lane is beyond this position, in the same cycle.
    pub fn is_done_in_cycle(&self, lane: usize, point: SequencePoint) -> bool {
        let now = if lane < self.lanes { self.counter(lane).load(Ordering::Acquire) } else { 0 };
        now >> POSITION_BITS == point.cycle && now > point.to_bits()
    }

    /// Whether the lane is beyond this position, in the same or a later cycle.
    pub fn is_done(&self, lane: usize, point: SequencePoint) -> bool {
        lane < self.lanes && self.counter(lane).load(Ordering::Acquire) > point.to_bits()
    }

    /// Opens the next position. Does nothing if the lane has left this position already, as in a later cycle.
    pub fn advance(&self, lane: usize, point: SequencePoint) {
        if lane < self.lanes {
            let next = SequencePoint { position: point.position + 1, ..point };
            let _previous = self.counter(lane).compare_exchange(
                point.to_bits(),
                next.to_bits(),
                Ordering::AcqRel,
                Ordering::Acquire,
            );
        }
    }

    fn counter(&self, lane: usize) -> &AtomicU64 {
        debug_assert!(lane < self.lanes);
        // SAFETY: the mapping holds `lanes` counters from the start of a page and lives as long as self; any bytes are a
        // valid counter, and all processes access them only as this atomic.
        unsafe { &(*self.start.as_ptr().add(lane)).0 }
    }
}

impl Drop for SequenceGates {
    fn drop(&mut self) {
        // SAFETY: the mapping that `map` created; it is not used after this.
        unsafe { libc::munmap(self.start.as_ptr().cast(), self.lanes * size_of::<Counter>()) };
    }
}

fn map(file: &File, lanes: usize) -> io::Result<SequenceGates> {
    // SAFETY: a new mapping of an open file of that size; the file may be closed afterwards.
    let start = unsafe {
        libc::mmap(
            std::ptr::null_mut(),
            lanes * size_of::<Counter>(),
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
        .map(|start| SequenceGates { start, lanes })
        .ok_or_else(|| io::Error::other("no address"))
}

fn file_error(cell: &CellName, action: &'static str, source: io::Error) -> IpcError {
    IpcError::File { path: cell.folder().join(FILE), action, source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::CellLock;

    #[test]
    fn gates_advance_between_processes_and_not_for_an_old_cycle() {
        let name = CellName::new(&format!("gates{}", std::process::id())).unwrap();
        let _lock = CellLock::take(&name).unwrap();
        let supervisor = SequenceGates::create(&name, 3).unwrap();
        let blocks = std::os::unix::fs::MetadataExt::blocks(&name.folder().join(FILE).metadata().unwrap());
        assert!(blocks > 0, "the first cycle needs shared memory that may not be there then");
        let stage = SequenceGates::open(&name, 3).unwrap();
        assert!(SequenceGates::open(&name, 2).is_err());
        supervisor.reset(0..3, 7);
        let first = SequencePoint { cycle: 7, position: 0 };
        let second = SequencePoint { cycle: 7, position: 1 };
        assert!(stage.is_open(1, first) && !stage.is_open(1, second) && !stage.is_open(3, first));
        stage.advance(1, first);
        assert!(supervisor.is_open(1, second) && supervisor.is_open(2, first));
        assert!(
            supervisor.is_done_in_cycle(1, first)
                && !supervisor.is_done_in_cycle(1, second)
                && !supervisor.is_done_in_cycle(2, first)
        );
        assert!(!supervisor.is_done_in_cycle(3, first), "no such lane");
        supervisor.reset(0..3, 8);
        assert!(!stage.is_done_in_cycle(1, first), "another cycle's gates say nothing");
        assert!(stage.is_done(1, first) && !stage.is_done(3, first));
        stage.advance(1, second);
        assert!(supervisor.is_open(1, SequencePoint { cycle: 8, position: 0 }));
        supervisor.reset([2], 9);
        assert!(
            stage.is_open(2, SequencePoint { cycle: 9, position: 0 })
                && !stage.is_open(1, SequencePoint { cycle: 9, position: 0 })
        );
        assert!(!stage.is_done(1, SequencePoint { cycle: 8, position: 0 }), "open, not done");
    }
}
