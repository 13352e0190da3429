//! Writing a record: appended cycle by cycle, each one whole or not there.

use super::block::{Head, Kind};
use super::codec::encode;
use super::{CycleEntry, MAGIC, RECORD_VERSION, RecordHeader, Seal, ValueKey};
use crate::error::{FileError, Problem};
use serde::Serialize;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use twox_hash::XxHash3_64;

/// A record that is being written.
#[derive(Debug)]
pub struct RecordWriter {
    path: PathBuf,
    file: File,
    /// Chain sum after the last block.
    chain: u64,
    /// End of the last complete cycle, and the chain sum there.
    complete: (u64, u64),
    /// A cycle of which a value could not be written: it will not be in the record.
    broken: Option<u64>,
    /// Cycles in the record and cycles that are lost.
    seal: Seal,
}

impl RecordWriter {
    /// Creates the file. An existing one is not touched: it may be the only trace of an earlier run.
    ///
    /// # Errors
    /// The file exists, or cannot be written.
    pub fn create(path: &Path, header: &RecordHeader) -> Result<Self, FileError> {
        let problem = |source| FileError::io(path, "write the cycle record", source);
        if path.is_file() || path.is_dir() {
            let problem = Problem::Unsupported("exists already".into());
            return Err(FileError::new(path, problem, "name a new file for the cycle record"));
        }
        // `create_new` keeps two runs that start together from sharing a file; a device is there before.
        let new = !path.exists();
        let file = File::options().write(true).create_new(new).open(path).map_err(problem)?;
        let mut start = MAGIC.to_vec();
        start.extend(RECORD_VERSION.to_le_bytes());
        let chain = XxHash3_64::oneshot(&start);
        let seal = Seal { cycles: 0, lost: 0 };
        let mut writer =
            Self { path: path.to_owned(), file, chain, complete: (0, chain), broken: None, seal };
        let key = ValueKey { cycle: 0, activation: 0 };
        let written =
            writer.file.write_all(&start).and_then(|()| writer.close_block(Kind::Header, key, header));
        match written {
            Ok(()) => Ok(writer),
            Err(source) => {
                if path.is_file() {
                    // A record without header is of no use, and it was not there before.
                    let _ = std::fs::remove_file(path);
                }
                Err(problem(source))
            }
        }
    }

    /// Appends bytes of the cycle that runs.
    ///
    /// # Errors
    /// They cannot be written; the record is then as it was after the last complete cycle.
    pub fn value(&mut self, key: ValueKey, bytes: &[u8]) -> Result<(), FileError> {
        if self.broken == Some(key.cycle) {
            return Ok(()); // said already
        }
        self.block(Kind::Value, key, bytes).map_err(|source| {
            self.broken = Some(key.cycle);
            self.undo(source)
        })
    }

    /// Closes a cycle and brings it to the disk. Says whether the cycle is in the record: not if a value of it was lost.
    ///
    /// # Errors
    /// It cannot be written; the record is then as it was after the last complete cycle.
    pub fn cycle(&mut self, entry: &CycleEntry) -> Result<bool, FileError> {
        if self.broken.take() == Some(entry.cycle) {
            self.seal.lost += 1;
            return Ok(false);
        }
        let key = ValueKey { cycle: entry.cycle, activation: u32::MAX };
        match self.close_block(Kind::Cycle, key, entry) {
            Ok(()) => {
                self.seal.cycles += 1;
                Ok(true)
            }
            Err(source) => {
                self.seal.lost += 1;
                Err(self.undo(source))
            }
        }
    }

    /// Seals the record: nothing may follow. A cycle that was not closed is left out.
    ///
    /// # Errors
    /// The seal cannot be written; the record then ends without one, after its last complete cycle.
    pub fn finish(mut self) -> Result<(), FileError> {
        let (end, chain) = self.complete;
        // A pipe or a device cannot go back; its reader leaves out what no entry closes.
        if self.chain != chain && self.file.set_len(end).is_ok() {
            let moved = self.file.seek(SeekFrom::Start(end));
            moved.map_err(|source| FileError::io(&self.path, "write the cycle record", source))?;
            self.chain = chain;
        }
        let (seal, key) = (self.seal, ValueKey { cycle: 0, activation: 0 });
        let closed = self.close_block(Kind::Seal, key, &seal);
        closed.map_err(|source| self.undo(source))
    }

    fn close_block<T: Serialize>(&mut self, kind: Kind, key: ValueKey, value: &T) -> io::Result<()> {
        let bytes = encode(value).map_err(io::Error::other)?;
        self.block(kind, key, &bytes)?;
        self.file.sync_data().or_else(|error| match error.kind() {
            // A pipe or a device has no disk behind it.
            io::ErrorKind::InvalidInput => Ok(()),
            _ => Err(error),
        })?;
        self.complete = (self.file.stream_position().unwrap_or(self.complete.0), self.chain);
        Ok(())
    }

    fn block(&mut self, kind: Kind, key: ValueKey, contents: &[u8]) -> io::Result<()> {
        let (head, chain) = Head::of(kind, key, contents).to_bytes(self.chain);
        self.file.write_all(&head)?;
        self.file.write_all(contents)?;
        self.chain = chain;
        Ok(())
    }

    /// Back to the last complete cycle. Where even that fails, the reader leaves out what no entry closes.
    fn undo(&mut self, source: io::Error) -> FileError {
        let (end, chain) = self.complete;
        let back = self.file.set_len(end);
        if back.and_then(|()| self.file.seek(SeekFrom::Start(end))).is_ok() {
            self.chain = chain;
        }
        FileError::io(&self.path, "write the cycle record", source)
    }
}
