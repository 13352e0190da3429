//! Files that grow by sealed lines: nobody changes, moves or takes out a line without its showing.
//!
//! ```text
//! {"format":"fringecell-trend/1",…}<TAB>sha256:<64 digits>
//! ```
//! The seal of a line is the SHA-256 of the seal before it (of the format's name for the first line), a line feed and the
//! line's JSON. So a line that was changed, moved, inserted or taken out shows at its place. What a seal without a secret
//! cannot show: a file that was sealed again from the first changed line on, or whose last lines were cut off; note
//! the last seal elsewhere, or use a key. With a key the seals are `hmac-sha256:`, which only its holders can make; cut
//! ends still need the note.

use crate::document::{read_bytes, read_text};
use crate::error::{FileError, Problem};
use crate::hash::{hmac_sha256_hex, sha256_hex};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;

/// A shorter key can be guessed.
const SHORTEST_KEY_BYTES: usize = 16;

/// A longer file is no key.
const LONGEST_KEY_BYTES: u64 = 4096;

/// What seals the lines.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Seal {
    /// SHA-256: shows damage and careless changes.
    Chain,
    /// HMAC with a secret: shows changes by all who do not hold it.
    Key(Vec<u8>),
}

impl Seal {
    /// Reads a key file; all its bytes are the key.
    ///
    /// # Errors
    /// Absent, or shorter than 16 or longer than 4096 bytes.
    pub fn read_key(path: &Path) -> Result<Self, FileError> {
        let key = read_bytes(path, LONGEST_KEY_BYTES)?;
        if key.len() < SHORTEST_KEY_BYTES {
            let problem = Problem::Value {
                value: format!("{} bytes", key.len()),
                limit: format!("a key has at least {SHORTEST_KEY_BYTES} bytes"),
            };
            return Err(FileError::new(path, problem, "make one: head -c 32 /dev/urandom > FILE"));
        }
        Ok(Self::Key(key))
    }

    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Chain => "sha256",
            Self::Key(_) => "hmac-sha256",
        }
    }

    pub(crate) fn of(&self, before: &str, json: &str) -> String {
        let text = format!("{before}\n{json}");
        let digits = match self {
            Self::Chain => sha256_hex(text.as_bytes()),
            Self::Key(key) => hmac_sha256_hex(key, text.as_bytes()),
        };
        format!("{}:{digits}", self.name())
    }
}

/// What remains to do about a damaged file.
const RESTORE: &str = "restore it from a copy, or begin a new file";

/// Lines of a file, read and verified.
#[derive(Debug, Clone, PartialEq)]
pub struct SealedLines<T> {
    /// All entries, the oldest line first.
    pub entries: Vec<T>,
    /// Seal of the last line: what the next one is sealed with.
    pub last_seal: String,
}

/// Reads and verifies a file of one format; an absent one is empty.
///
/// # Errors
/// A line whose seal is not that of its text and the line before: the message names the line.
pub fn read_sealed<T: DeserializeOwned>(
    path: &Path,
    seal: &Seal,
    format: &str,
) -> Result<SealedLines<T>, FileError> {
    let text = if path.exists() { read_text(path)? } else { String::new() };
    let mut lines = SealedLines { entries: Vec::new(), last_seal: format.to_owned() };
    let fault = |number: usize, problem: Problem, remedy: &str| {
        let mut fault = FileError::new(path, problem, remedy);
        fault.line = Some(number + 1);
        fault
    };
    if !text.is_empty() && !text.ends_with('\n') {
        let problem = Problem::Syntax("ends in the middle of a line".into());
        return Err(fault(text.lines().count().saturating_sub(1), problem, RESTORE));
    }
    for (number, line) in text.lines().enumerate() {
        let (problem, remedy) = match next(seal, &lines.last_seal, line) {
            Ok((json, found)) => match serde_json::from_str(json) {
                Ok(entry) => {
                    lines.entries.push(entry);
                    found.clone_into(&mut lines.last_seal);
                    continue;
                }
                Err(error) => (Problem::Syntax(error.to_string()), "was it written by a later version?"),
            },
            Err(fault) => fault,
        };
        return Err(fault(number, problem, remedy));
    }
    Ok(lines)
}

/// JSON and seal of a line that follows another.
fn next<'a>(seal: &Seal, before: &str, line: &'a str) -> Result<(&'a str, &'a str), (Problem, &'static str)> {
    let Some((json, found)) = line.split_once('\t') else {
        let problem = Problem::Syntax("has no seal: JSON, a tab and the seal are expected".into());
        return Err((problem, RESTORE));
    };
    let kind = found.split_once(':').map(|(kind, _)| kind);
    if kind != Some(seal.name()) {
        let problem = Problem::Disagreement {
            what: "seals",
            here: format!("this line is sealed by {}", kind.unwrap_or("nothing known")),
            there: format!("{} is asked for", seal.name()),
        };
        return Err((problem, "give --key for a file sealed with one, and leave it out for one that is not"));
    }
    if seal.of(before, json) != found {
        let problem = Problem::Syntax(
            "the seal does not fit this line and the one before: the file was changed here, or the key is another one"
                .into(),
        );
        return Err((problem, RESTORE));
    }
    Ok((json, found))
}

/// Appends an entry to an open file; the file grows by one whole line, or stays as it is. Returns the seal of the line.
///
/// # Errors
/// The line cannot be written.
pub fn append_sealed<T: Serialize>(
    path: &Path,
    file: &mut File,
    seal: &Seal,
    before: &str,
    entry: &T,
) -> Result<String, FileError> {
    let io = |action: &'static str| move |source| FileError::io(path, action, source);
    let json = serde_json::to_string(entry)
        .map_err(|error| FileError::new(path, Problem::Syntax(error.to_string()), ""))?;
    let sealed = seal.of(before, &json);
    let length = file.seek(SeekFrom::End(0)).map_err(io("inspect it"))?;
    let line = format!("{json}\t{sealed}\n");
    let written = file.write_all(line.as_bytes()).and_then(|()| file.sync_all());
    if written.is_err() {
        // A line that is half there would break the chain.
        let _ = file.set_len(length);
    }
    written.map_err(io("write it"))?;
    Ok(sealed)
}
