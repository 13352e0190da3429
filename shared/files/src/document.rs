//! Text files and TOML documents, read whole, with messages that point into them.

use crate::culprit::culprit;
use crate::error::{FileError, Problem, did_you_mean};
use crate::guard;
use crate::memory;
use crate::surplus::surplus;
use serde::de::DeserializeOwned;
use std::fs::{File, Metadata};
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Longest configuration-like text: a thousand times the longest one meant, and still nothing for a machine to hold.
pub const TEXT_LIMIT_BYTES: u64 = 8 << 20;

/// Reads a text file (UTF-8, a byte-order mark is dropped).
///
/// # Errors
/// Absent, not a file, longer than [`TEXT_LIMIT_BYTES`], or not UTF-8.
pub fn read_text(path: &Path) -> Result<String, FileError> {
    let bytes = read_bytes(path, TEXT_LIMIT_BYTES)?;
    let text = String::from_utf8(bytes).map_err(|error| {
        let line = error.as_bytes()[..error.utf8_error().valid_up_to()].split(|b| *b == b'\n').count();
        let mut fault = FileError::new(
            path,
            Problem::Syntax("is no UTF-8 text".into()),
            "save it as UTF-8, or name another file",
        );
        fault.line = Some(line);
        fault
    })?;
    Ok(text.strip_prefix('\u{feff}').map_or(text.clone(), str::to_owned))
}

/// Reads a whole file of at most `limit` bytes.
///
/// # Errors
/// Absent, not a file, or longer than the limit.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, FileError> {
    refuse_named_pipe(path)?;
    let (file, metadata) = open_input(path)?;
    if metadata.is_dir() {
        return Err(FileError::new(
            path,
            Problem::Unsupported("is a folder, not a file".into()),
            "name a file",
        ));
    }
    if metadata.len() <= limit {
        memory::check(path, &format!("{} bytes", metadata.len()), metadata.len())?;
    }
    let mut bytes = Vec::new();
    // One byte beyond the limit shows a longer file, also where the metadata do not know the length (pipes).
    file.take(limit + 1).read_to_end(&mut bytes).map_err(|source| FileError::io(path, "read it", source))?;
    if bytes.len() as u64 > limit {
        let found = metadata.len().max(bytes.len() as u64);
        return Err(FileError::new(path, Problem::TooLarge { found, limit }, "is this the right file?"));
    }
    Ok(bytes)
}

/// Opens a file that is going to be read, and notes it as an input ([`guard`]).
///
/// # Errors
/// Absent, not permitted, or an output of the same command.
pub(crate) fn open_input(path: &Path) -> Result<(File, Metadata), FileError> {
    let file = File::open(path).map_err(|source| FileError::io(path, "open it", source))?;
    let metadata = file.metadata().map_err(|source| FileError::io(path, "inspect it", source))?;
    guard::opened(path, &metadata)?;
    Ok((file, metadata))
}

/// Refuses a named pipe, which would wait for a writer for ever. Pipes of the shell (`/dev/stdin`, `<(…)`) have no name.
///
/// # Errors
/// A named pipe.
pub(crate) fn refuse_named_pipe(path: &Path) -> Result<(), FileError> {
    let pipe = std::fs::metadata(path).is_ok_and(|m| m.file_type().is_fifo()) && path.canonicalize().is_ok();
    if pipe {
        let problem = Problem::Unsupported("is a named pipe".into());
        return Err(FileError::new(path, problem, "name a file"));
    }
    Ok(())
}

/// Refuses what is there but no file: folders, devices, pipes. What is absent passes, for the caller to report.
///
/// # Errors
/// A folder, device or pipe.
pub(crate) fn refuse_special(path: &Path) -> Result<(), FileError> {
    let what = match std::fs::metadata(path) {
        Ok(metadata) if metadata.is_dir() => "is a folder, not a file",
        Ok(metadata) if !metadata.is_file() => "is a device or a pipe, not a file",
        _ => return Ok(()),
    };
    Err(FileError::new(path, Problem::Unsupported(what.into()), "name a file"))
}

/// A TOML text with the path that messages name.
#[derive(Debug, Clone)]
pub struct Document {
    /// The path as it was given.
    pub path: PathBuf,
    /// The whole text of the file.
    pub text: String,
}

impl Document {
    /// Reads the text; nothing is parsed yet.
    ///
    /// # Errors
    /// As [`read_text`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Ok(Self { path: path.to_owned(), text: read_text(path)? })
    }

    /// Parses strictly, after the key `format` proved that this is the kind of file that the caller wants.
    ///
    /// # Errors
    /// Not TOML, another format, unknown, missing or mistyped keys.
    pub fn parse<T: DeserializeOwned>(&self, format: &str) -> Result<T, FileError> {
        let found = self.format()?.unwrap_or_default();
        if found != format {
            let problem = Problem::Format { found: found.clone(), expected: format.to_owned() };
            let remedy = if found.is_empty() {
                format!("add the line: format = \"{format}\"")
            } else {
                "name a file of that format".to_owned()
            };
            return Err(self.fault("format", problem, remedy));
        }
        self.parsed()
    }

    /// The same where the key `format` may be left out.
    ///
    /// # Errors
    /// As [`Self::parse`].
    pub fn parse_bare<T: DeserializeOwned>(&self, format: &str) -> Result<T, FileError> {
        match self.format()? {
            Some(_) => self.parse(format),
            None => self.parsed(),
        }
    }

    fn parsed<T: DeserializeOwned>(&self) -> Result<T, FileError> {
        let parsed = toml::from_str(&self.text).map_err(|error| self.placed_fault::<T>(&error))?;
        match surplus::<T>(&self.text) {
            Some((key, message)) => {
                Err(self.fault(&key, Problem::Syntax(message), "take out what is too much"))
            }
            None => Ok(parsed),
        }
    }

    /// The key `format` as written.
    fn format(&self) -> Result<Option<String>, FileError> {
        let table = DeTable::parse(&self.text).map_err(|error| self.toml_fault(&error))?;
        let format = table.get_ref().get("format").and_then(|value| value.get_ref().as_str());
        Ok(format.map(str::to_owned))
    }

    /// A fault at a key of the table of this kind and name, such as the `[[element]]` with the name "top"; each may be empty.
    pub(crate) fn fault_of(&self, [kind, name, key]: [&str; 3], problem: Problem, remedy: &str) -> FileError {
        let table = self.index_of(kind, name).map_or(kind.to_owned(), |index| format!("{kind}[{index}]"));
        let dot = if table.is_empty() || key.is_empty() { "" } else { "." };
        self.fault(&format!("{table}{dot}{key}"), problem, remedy)
    }

    /// A fault at a key of a table such as `element "top"`. `unknown` is a name that nothing has, and the known names, separated by
    /// commas.
    pub(crate) fn fault_at(
        &self,
        (place, key): (&str, &str),
        unknown: Option<(&str, &str)>,
        problem: Problem,
    ) -> FileError {
        let (kind, name) = place.split_once(" \"").unwrap_or((place, ""));
        let name = name.split('"').next().unwrap_or("");
        let remedy = unknown.map(|(name, known)| did_you_mean(name, known.split(", "), ""));
        self.fault_of([kind, name, key], problem, &remedy.unwrap_or_default())
    }

    /// Number of the table in its list.
    fn index_of(&self, kind: &str, name: &str) -> Option<usize> {
        let all = DeTable::parse(&self.text).ok()?;
        let tables = all.get_ref().get(kind)?.get_ref().as_array()?;
        let is_called = |table: &Spanned<DeValue<'_>>| {
            let named =
                |key: &str| table.get_ref().get(key).is_some_and(|v| v.get_ref().as_str() == Some(name));
            ["name", "id", "symbol"].iter().any(|key| named(key))
        };
        tables.iter().position(is_called)
    }

    /// A fault at a key such as `camera[0].name`; the line is looked up.
    pub fn fault(&self, key: &str, problem: Problem, remedy: impl Into<String>) -> FileError {
        let mut fault = FileError::new(&self.path, problem, remedy).at(key);
        fault.line = self.line_of(key);
        fault
    }

    /// Turns a part that was read as a free table into its meaning.
    ///
    /// # Errors
    /// Unknown, missing or mistyped keys, named with the key of the table before them.
    pub fn typed<T: DeserializeOwned>(&self, key: &str, table: toml::Table) -> Result<T, FileError> {
        table.try_into().map_err(|error: toml::de::Error| {
            let mut fault = self.toml_fault(&error);
            fault.key = match (key, fault.key.as_str()) {
                (key, "") => key.to_owned(),
                (key, inner) => format!("{key}.{inner}"),
            };
            fault.line = self.line_of(&fault.key).or_else(|| self.line_of(key));
            fault
        })
    }

    /// The fault of a whole document. Where its place is only the head of a table, the key in it is looked for.
    fn placed_fault<T: DeserializeOwned>(&self, error: &toml::de::Error) -> FileError {
        let mut fault = self.toml_fault(error);
        let at_head = error.span().is_some_and(|span| self.key_at(span.start).is_empty());
        if let Some(key) = at_head.then(|| culprit::<T>(&self.text)).flatten() {
            fault.line = self.line_of(&key).or(fault.line);
            if fault.key.is_empty() {
                fault.key = key;
            }
        }
        fault
    }

    fn toml_fault(&self, error: &toml::de::Error) -> FileError {
        let message = error.message().trim_end().replace('\n', " ");
        let mut fault = match unknown_field(&message) {
            Some((name, known)) => {
                let remedy = did_you_mean(&name, known.iter().map(String::as_str), "remove it");
                let problem = Problem::UnknownKey { name: name.clone(), known: known.join(", ") };
                FileError::new(&self.path, problem, remedy).at(name)
            }
            None => FileError::new(&self.path, Problem::Syntax(message), ""),
        };
        if let Some(span) = error.span() {
            fault.line = Some(self.line_at(span.start));
            if fault.key.is_empty() {
                fault.key = self.key_at(span.start);
            }
        }
        fault
    }

    /// What stands before the `=` of the line at an offset: enough to find the place by eye.
    fn key_at(&self, offset: usize) -> String {
        let before = self.text.get(..offset).unwrap_or("");
        let start = before.rfind('\n').map_or(0, |at| at + 1);
        let line = self.text[start..].lines().next().unwrap_or("");
        line.split_once('=').map_or("", |(key, _)| key).trim().to_owned()
    }

    fn line_at(&self, offset: usize) -> usize {
        let end = offset.min(self.text.len());
        self.text.as_bytes()[..end].split(|byte| *byte == b'\n').count()
    }

    /// Line of a key path; of its nearest ancestor when the key itself is absent.
    fn line_of(&self, key: &str) -> Option<usize> {
        let table = DeTable::parse(&self.text).ok()?;
        let mut here: Option<&Spanned<DeValue<'_>>> = None;
        for step in steps(key) {
            let next = match (step, here) {
                (Step::Key(name), None) => table.get_ref().get(name),
                (Step::Key(name), Some(value)) => {
                    value.get_ref().as_table().and_then(|table| table.get(name))
                }
                (Step::Index(index), Some(value)) => value.get_ref().get(index),
                (Step::Index(_), None) => None,
            };
            if next.is_none() {
                break;
            }
            here = next;
        }
        here.map(|value| self.line_at(value.span().start))
    }
}

enum Step<'a> {
    Key(&'a str),
    Index(usize),
}

fn steps(key: &str) -> Vec<Step<'_>> {
    key.split('.')
        .flat_map(|part| {
            let mut pieces = part.split('[');
            let name = pieces.next().filter(|name| !name.is_empty()).map(Step::Key);
            let indices = pieces.filter_map(|p| p.trim_end_matches(']').parse().ok().map(Step::Index));
            name.into_iter().chain(indices).collect::<Vec<_>>()
        })
        .collect()
}

/// Takes serde's message for an unknown key apart: the key, and those that are known.
fn unknown_field(message: &str) -> Option<(String, Vec<String>)> {
    let rest = message.strip_prefix("unknown field `")?;
    let (name, rest) = rest.split_once('`')?;
    let known = rest.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    Some((name.to_owned(), known))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Demo {
        #[allow(dead_code)]
        format: String,
        item: Vec<Item>,
    }

    #[derive(Debug, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Item {
        width_px: u32,
    }

    fn document(text: &str) -> Document {
        Document { path: "demo.toml".into(), text: text.into() }
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line_and_the_nearest_known_one() {
        let error = document("format = \"f/1\"\n[[item]]\nwidht_px = 3\n").parse::<Demo>("f/1").unwrap_err();
        assert_eq!(
            error.to_string(),
            "demo.toml:3: widht_px: unknown key \"widht_px\"; known here: width_px; did you mean \"width_px\"?"
        );
    }

    #[test]
    fn another_format_is_told_before_its_keys_are_found_unknown() {
        let error = document("format = \"g/1\"\nzoom = 3\n").parse::<Demo>("f/1").unwrap_err();
        assert!(
            error.to_string().starts_with("demo.toml:1: format: format is \"g/1\", expected \"f/1\""),
            "{error}"
        );
        let error = document("zoom = 3\n").parse::<Demo>("f/1").unwrap_err();
        assert!(error.to_string().contains("add the line: format = \"f/1\""), "{error}");
    }

    #[test]
    fn a_fault_finds_the_line_of_its_key() {
        let text = document("format = \"f/1\"\n[[item]]\nwidth_px = 3\n[[item]]\nwidth_px = 4\n");
        let demo: Demo = text.parse("f/1").unwrap();
        assert_eq!(demo.item[1].width_px, 4);
        assert_eq!(text.line_of("item[1].width_px"), Some(5));
        assert_eq!(text.line_of("item[1].absent"), text.line_of("item[1]"));
        assert_eq!(text.line_of("nothing"), None);
    }

    #[test]
    fn a_mistyped_value_is_reported_with_line_and_key() {
        let error =
            document("format = \"f/1\"\n[[item]]\nwidth_px = \"3\"\n").parse::<Demo>("f/1").unwrap_err();
        assert!(error.to_string().starts_with("demo.toml:3: width_px: invalid type"), "{error}");
    }

    #[test]
    fn a_folder_a_binary_file_and_an_absent_file_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        assert!(read_text(dir.path()).unwrap_err().to_string().contains("is a folder"));
        assert!(read_text(&dir.path().join("none")).unwrap_err().to_string().contains("check the path"));
        let binary = dir.path().join("b");
        std::fs::write(&binary, b"ab\n\xff\xfe").unwrap();
        assert!(read_text(&binary).unwrap_err().to_string().contains("b:2: is no UTF-8 text"));
    }

    #[test]
    fn a_file_beyond_the_limit_is_refused_with_both_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("long");
        std::fs::write(&path, [0; 20]).unwrap();
        assert!(read_bytes(&path, 19).unwrap_err().to_string().contains("is 20 bytes long, limit 19"));
        assert_eq!(read_bytes(&path, 20).unwrap().len(), 20);
    }
}
