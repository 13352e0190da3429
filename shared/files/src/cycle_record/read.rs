//! Reading a record, up to its last complete cycle.

use super::block::{HEAD_BYTES, Head, KEY_BYTES, Kind};
use super::codec::decode;
use super::{CycleEntry, MAGIC, RECORD_VERSION, RecordHeader, ValueKey};
use crate::error::{FileError, Problem};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// A record that is being read.
#[derive(Debug)]
pub struct RecordReader {
    blocks: Blocks,
    /// Description of the run.
    pub header: RecordHeader,
}

/// A cycle of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedCycle {
    /// Outcome, verdict and activations of the cycle.
    pub entry: CycleEntry,
    /// Where its bytes lie, by activation.
    pub values: BTreeMap<u32, StoredValue>,
}

/// Where bytes lie in the record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredValue {
    /// Of the block's contents, the key included.
    offset: u64,
    length: u64,
    checksum: u64,
}

/// How a record ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// After a complete cycle.
    Whole,
    /// Within a cycle, which does not count: the run was killed, or still goes on. So many bytes belong to it.
    Torn(u64),
}

/// What a record gives next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Next {
    /// The next complete cycle.
    Cycle(RecordedCycle),
    /// There is no further one.
    End(Ending),
}

impl RecordReader {
    /// Opens a record and reads its header.
    ///
    /// # Errors
    /// No record, one of another version, or one that was broken off before its header was complete.
    pub fn open(path: &Path) -> Result<Self, FileError> {
        let mut blocks = Blocks::open(path)?;
        let broken = || refusal(path, "was broken off before its first cycle", "there is nothing to replay");
        let head = blocks.head()?.ok_or_else(broken)?;
        if head.kind != Kind::Header {
            return Err(blocks.damaged("does not begin with a header"));
        }
        let header = blocks.typed(head)?.ok_or_else(broken)?;
        Ok(Self { blocks, header })
    }

    /// The next complete cycle. The bytes of its values are not read yet.
    ///
    /// # Errors
    /// A damaged file, as opposed to one that ends early.
    pub fn next_cycle(&mut self) -> Result<Next, FileError> {
        let begin = self.blocks.at;
        let mut values: BTreeMap<ValueKey, StoredValue> = BTreeMap::new();
        loop {
            let torn = self.blocks.size - begin;
            let end = if torn == 0 { Ending::Whole } else { Ending::Torn(torn) };
            let Some(head) = self.blocks.head()? else { return Ok(Next::End(end)) };
            match head.kind {
                Kind::Header => return Err(self.blocks.damaged("has a second header")),
                Kind::Value => {
                    let Some((key, value)) = self.blocks.value(head)? else { return Ok(Next::End(end)) };
                    values.insert(key, value);
                }
                Kind::Cycle => {
                    let Some(entry) = self.blocks.typed::<CycleEntry>(head)? else {
                        return Ok(Next::End(end));
                    };
                    if values.keys().any(|key| key.cycle != entry.cycle) {
                        return Err(self.blocks.damaged("has bytes of another cycle before the end of one"));
                    }
                    let values = values.into_iter().map(|(key, value)| (key.activation, value)).collect();
                    return Ok(Next::Cycle(RecordedCycle { entry, values }));
                }
            }
        }
    }

    /// The bytes of a value.
    ///
    /// # Errors
    /// They are not those that were written.
    pub fn load(&mut self, value: &StoredValue) -> Result<Vec<u8>, FileError> {
        let back = self.blocks.at;
        self.blocks.seek(value.offset)?;
        let bytes = self.blocks.take(value.length)?;
        if xxh3_64(&bytes) != value.checksum {
            return Err(self.blocks.damaged("has a kept frame or output with a wrong checksum"));
        }
        self.blocks.seek(back)?;
        Ok(bytes[KEY_BYTES..].to_vec())
    }
}

/// The file as a row of blocks.
#[derive(Debug)]
struct Blocks {
    path: PathBuf,
    file: BufReader<File>,
    size: u64,
    /// Where the next byte is read.
    at: u64,
}

impl Blocks {
    fn open(path: &Path) -> Result<Self, FileError> {
        crate::document::refuse_named_pipe(path)?;
        let file = File::open(path).map_err(|source| FileError::io(path, "open it", source))?;
        let metadata = file.metadata().map_err(|source| FileError::io(path, "read it", source))?;
        if !metadata.is_file() {
            return Err(refusal(path, "is no file", "name a cycle record"));
        }
        let mut blocks =
            Self { path: path.to_owned(), file: BufReader::new(file), size: metadata.len(), at: 0 };
        let start = blocks.take(blocks.size.min(16))?;
        let version = start.strip_prefix(&MAGIC).and_then(|v| v.try_into().ok()).map(u32::from_le_bytes);
        match version {
            Some(RECORD_VERSION) => Ok(blocks),
            Some(other) => {
                let limit = format!("this program reads {RECORD_VERSION}");
                let problem = Problem::Value { value: other.to_string(), limit };
                let remedy = "replay it with the program that wrote it";
                Err(FileError::new(path, problem, remedy).at("version"))
            }
            None => Err(refusal(
                path,
                "is no cycle record",
                "name a file that `fringecell run --cycle-record FILE` wrote",
            )),
        }
    }

    /// The next head; `None` at the end, which a crash may have left anywhere.
    fn head(&mut self) -> Result<Option<Head>, FileError> {
        let left = self.size - self.at;
        if left < HEAD_BYTES as u64 {
            return Ok(None);
        }
        let bytes = self.take(HEAD_BYTES as u64)?;
        let fixed = bytes.as_slice().try_into().ok();
        match fixed.and_then(Head::from_bytes) {
            Some(head) if head.length > self.size - self.at => Ok(None),
            Some(head) => Ok(Some(head)),
            // A file system may have made room for what it never wrote: zeros to the end.
            None if self.rest_is_zero()? => Ok(None),
            None => Err(self.damaged("has no block where one must begin")),
        }
    }

    /// The contents of a block; `None` if it is the last one and was not written whole.
    fn typed<T: DeserializeOwned>(&mut self, head: Head) -> Result<Option<T>, FileError> {
        let bytes = self.take(head.length)?;
        if xxh3_64(&bytes) != head.checksum {
            let last = self.rest_is_zero()?;
            return if last { Ok(None) } else { Err(self.damaged("has a block with a wrong checksum")) };
        }
        decode(&bytes).map(Some).map_err(|reason| self.damaged(&format!("does not decode: {reason}")))
    }

    /// Where a value lies; `None` for an end within it.
    fn value(&mut self, head: Head) -> Result<Option<(ValueKey, StoredValue)>, FileError> {
        let offset = self.at;
        if head.length < KEY_BYTES as u64 {
            return Err(self.damaged("has a kept frame or output without number"));
        }
        let key = self.take(KEY_BYTES as u64)?;
        let Ok(key) = key.as_slice().try_into() else { return Ok(None) };
        self.seek(offset + head.length)?;
        let value = StoredValue { offset, length: head.length, checksum: head.checksum };
        Ok(Some((ValueKey::from_bytes(key), value)))
    }

    /// Reads so many bytes, which the caller knows to be there.
    fn take(&mut self, count: u64) -> Result<Vec<u8>, FileError> {
        let mut bytes = vec![0; count as usize];
        self.file.read_exact(&mut bytes).map_err(|source| FileError::io(&self.path, "read it", source))?;
        self.at += count;
        Ok(bytes)
    }

    fn seek(&mut self, to: u64) -> Result<(), FileError> {
        let moved = self.file.seek(SeekFrom::Start(to));
        moved.map_err(|source| FileError::io(&self.path, "read it", source))?;
        self.at = to;
        Ok(())
    }

    fn rest_is_zero(&mut self) -> Result<bool, FileError> {
        let back = self.at;
        let mut zero = true;
        while zero && self.at < self.size {
            let count = (self.size - self.at).min(1 << 16);
            zero = self.take(count)?.iter().all(|&b| b == 0);
        }
        self.seek(back)?;
        Ok(zero)
    }

    fn damaged(&self, what: &str) -> FileError {
        let text = format!("is damaged before byte {}: it {what}", self.at);
        refusal(&self.path, &text, "restore it from a copy; a crash cannot leave this")
    }
}

fn refusal(path: &Path, what: &str, remedy: &str) -> FileError {
    FileError::new(path, Problem::Unsupported(what.to_owned()), remedy)
}
