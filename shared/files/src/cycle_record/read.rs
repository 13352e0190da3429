//! Reading a record, up to its last complete cycle. Every byte is checked, also of values that nobody asks for.

use super::block::{HEAD_BYTES, Head, Kind};
use super::codec::decode;
use super::{CycleEntry, MAGIC, RECORD_VERSION, RecordHeader, Seal};
use crate::error::{FileError, Problem};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::fs::File;
use std::hash::Hasher;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use twox_hash::XxHash3_64;

/// A record that is being read.
#[derive(Debug)]
pub struct RecordReader {
    blocks: Blocks,
    /// Description of the run.
    pub header: RecordHeader,
    /// Cycles that were closed, damaged ones included.
    closed: u64,
    /// The last of them.
    last: Option<u64>,
}

/// A cycle of a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedCycle {
    /// Outcome, verdict and activations of the cycle.
    pub entry: CycleEntry,
    /// Where its bytes lie, by activation.
    pub values: BTreeMap<u32, StoredValue>,
}

/// A cycle whose bytes are not those that were written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DamagedCycle {
    /// Number of the cycle, from 0.
    pub cycle: u64,
    /// Its parts: an activation whose kept bytes are damaged; `None`: the entry with hashes and outcome.
    pub parts: Vec<Option<u32>>,
}

/// Where bytes lie in the record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoredValue {
    offset: u64,
    length: u64,
    checksum: u64,
}

/// How a record ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// With its seal: nothing is missing.
    Sealed(Seal),
    /// Without: the run was killed, still goes on, or the file was cut. So many bytes belong to no complete cycle.
    Torn(u64),
}

/// What a record gives next.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Next {
    /// The next complete cycle.
    Cycle(RecordedCycle),
    /// A cycle that is there and cannot be used; more may follow.
    Damaged(DamagedCycle),
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
        let head = blocks.head("in its header")?.ok_or_else(broken)?;
        if head.kind != Kind::Header {
            return Err(blocks.damaged("it does not begin with a header"));
        }
        let Some(bytes) = blocks.contents(head)? else {
            return Err(blocks.damaged("its header has a wrong checksum"));
        };
        let header = blocks.typed(&bytes)?;
        Ok(Self { blocks, header, closed: 0, last: None })
    }

    /// The next cycle that was closed, or the end.
    ///
    /// # Errors
    /// A file that cannot be read further because it is damaged, as opposed to one that ends early.
    pub fn next_cycle(&mut self) -> Result<Next, FileError> {
        let begin = self.blocks.at;
        let torn = Next::End(Ending::Torn(self.blocks.size - begin));
        let mut values = BTreeMap::new();
        let mut damaged = Vec::new();
        loop {
            let place = self.place();
            let Some(head) = self.blocks.head(&place)? else { return Ok(torn) };
            match head.kind {
                Kind::Header => return Err(self.blocks.damaged("it has a second header")),
                Kind::Value => {
                    let stored =
                        StoredValue { offset: self.blocks.at, length: head.length, checksum: head.checksum };
                    if !self.blocks.intact(head)? {
                        damaged.push(Some(head.key.activation));
                    }
                    values.insert(head.key, stored);
                }
                Kind::Cycle => {
                    let cycle = head.key.cycle;
                    if values.keys().any(|key| key.cycle != cycle) {
                        return Err(self
                            .blocks
                            .damaged("it has bytes of another cycle before the end of one"));
                    }
                    self.closed += 1;
                    self.last = Some(cycle);
                    let Some(bytes) = self.blocks.contents(head)? else {
                        damaged.push(None);
                        return Ok(Next::Damaged(DamagedCycle { cycle, parts: damaged }));
                    };
                    if !damaged.is_empty() {
                        return Ok(Next::Damaged(DamagedCycle { cycle, parts: damaged }));
                    }
                    let entry = self.blocks.typed(&bytes)?;
                    let values = values.into_iter().map(|(key, value)| (key.activation, value)).collect();
                    return Ok(Next::Cycle(RecordedCycle { entry, values }));
                }
                Kind::Seal => return self.seal(head),
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
        if XxHash3_64::oneshot(&bytes) != value.checksum {
            return Err(self.blocks.damaged("a kept frame or output has a wrong checksum"));
        }
        self.blocks.seek(back)?;
        Ok(bytes)
    }

    fn seal(&mut self, head: Head) -> Result<Next, FileError> {
        let Some(bytes) = self.blocks.contents(head)? else {
            return Err(self.blocks.damaged("its seal has a wrong checksum"));
        };
        let seal: Seal = self.blocks.typed(&bytes)?;
        if self.blocks.at != self.blocks.size {
            return Err(self.blocks.damaged("something follows its seal"));
        }
        if seal.cycles != self.closed {
            let text = format!("its seal counts {} cycles, and {} are there", seal.cycles, self.closed);
            return Err(self.blocks.damaged(&text));
        }
        Ok(Next::End(Ending::Sealed(seal)))
    }

    /// Where the reader is, for messages: cycles are counted from 1 for people.
    fn place(&self) -> String {
        match self.last {
            None => "in its first cycle".to_owned(),
            Some(last) => format!("after cycle {}", last + 1),
        }
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
    /// Chain sum after the last head.
    chain: u64,
}

impl Blocks {
    fn open(path: &Path) -> Result<Self, FileError> {
        crate::document::refuse_named_pipe(path)?;
        let (file, metadata) = crate::document::open_input(path)?;
        if !metadata.is_file() {
            return Err(refusal(path, "is no file", "name a cycle record"));
        }
        let size = metadata.len();
        let mut blocks = Self { path: path.to_owned(), file: BufReader::new(file), size, at: 0, chain: 0 };
        let start = blocks.take(blocks.size.min(16))?;
        blocks.chain = XxHash3_64::oneshot(&start);
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
    fn head(&mut self, place: &str) -> Result<Option<Head>, FileError> {
        let start = self.at;
        if self.size - start < HEAD_BYTES as u64 {
            return Ok(None);
        }
        let bytes = self.take(HEAD_BYTES as u64)?;
        let fixed = bytes.as_slice().try_into().ok();
        match fixed.and_then(|bytes| Head::from_bytes(bytes, self.chain)) {
            Some((head, _)) if head.length > self.size - self.at => Ok(None),
            Some((head, chain)) => {
                self.chain = chain;
                Ok(Some(head))
            }
            None => {
                // A file system may have made room for what it never wrote: zeros to the end.
                self.seek(start)?;
                if self.rest_is_zero()? {
                    return Ok(None);
                }
                Err(self.damaged(&format!("{place}, the head of a block is not the one that was written")))
            }
        }
    }

    /// The contents of a block; `None` if they are not those that were written.
    fn contents(&mut self, head: Head) -> Result<Option<Vec<u8>>, FileError> {
        let bytes = self.take(head.length)?;
        Ok((XxHash3_64::oneshot(&bytes) == head.checksum).then_some(bytes))
    }

    /// Reads over the contents of a block; whether they are those that were written.
    fn intact(&mut self, head: Head) -> Result<bool, FileError> {
        let (mut sum, mut left) = (XxHash3_64::new(), head.length);
        while left > 0 {
            let bytes = self.take(left.min(1 << 20))?;
            sum.write(&bytes);
            left -= bytes.len() as u64;
        }
        Ok(sum.finish() == head.checksum)
    }

    fn typed<T: DeserializeOwned>(&self, bytes: &[u8]) -> Result<T, FileError> {
        decode(bytes).map_err(|reason| self.damaged(&format!("a block does not decode: {reason}")))
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
        let text = format!("is damaged near byte {}: {what}", self.at);
        refusal(&self.path, &text, "restore it from a copy; a crash cannot leave this")
    }
}

fn refusal(path: &Path, what: &str, remedy: &str) -> FileError {
    FileError::new(path, Problem::Unsupported(what.to_owned()), remedy)
}
