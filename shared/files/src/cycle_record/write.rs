//! Writing a record: appended cycle by cycle, each one whole or not there.

use super::block::{Head, Kind};
use super::codec::encode;
use super::{CycleEntry, MAGIC, RECORD_VERSION, RecordHeader, ValueKey};
use crate::error::{FileError, Problem};
use serde::Serialize;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A record that is being written.
#[derive(Debug)]
pub struct RecordWriter {
    path: PathBuf,
    file: File,
    /// End of the last complete cycle.
    complete: u64,
    /// A cycle of which a value could not be written: it will not be in the record.
    broken: Option<u64>,
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
        let file = File::options().write(true).create(true).truncate(false).open(path).map_err(problem)?;
        let mut writer = Self { path: path.to_owned(), file, complete: 0, broken: None };
        let mut start = MAGIC.to_vec();
        start.extend(RECORD_VERSION.to_le_bytes());
        let written = writer.file.write_all(&start).and_then(|()| writer.close_block(Kind::Header, header));
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
        let start = key.to_bytes();
        let head = Head::of(Kind::Value, &[&start, bytes]).to_bytes();
        let parts: [&[u8]; 3] = [&head, &start, bytes];
        let written = parts.into_iter().try_for_each(|part| self.file.write_all(part));
        written.map_err(|source| {
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
            return Ok(false);
        }
        match self.close_block(Kind::Cycle, entry) {
            Ok(()) => Ok(true),
            Err(source) => Err(self.undo(source)),
        }
    }

    fn close_block<T: Serialize>(&mut self, kind: Kind, value: &T) -> io::Result<()> {
        let bytes = encode(value).map_err(io::Error::other)?;
        self.file.write_all(&Head::of(kind, &[&bytes]).to_bytes())?;
        self.file.write_all(&bytes)?;
        self.file.sync_data().or_else(|error| match error.kind() {
            // A pipe or a device has no disk behind it.
            io::ErrorKind::InvalidInput => Ok(()),
            _ => Err(error),
        })?;
        self.complete = self.file.stream_position().unwrap_or(self.complete);
        Ok(())
    }

    /// Back to the last complete cycle. Where even that fails, the reader leaves out what no entry closes.
    fn undo(&mut self, source: io::Error) -> FileError {
        let back = self.file.set_len(self.complete);
        let _ = back.and_then(|()| self.file.seek(SeekFrom::Start(self.complete)));
        FileError::io(&self.path, "write the cycle record", source)
    }
}
