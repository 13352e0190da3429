//! One error for all files: which file, where in it, what is wrong, what helps.

use fringe::geometry::camera::CameraError;
use fringe::pattern::PatternError;
use std::fmt;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// What is wrong with a file, where it stands, and the likely remedy.
///
/// `Display` prints `file:line: key: problem; remedy` and leaves the cause (an operating-system or image error) to
/// `source`, so a printed chain states everything once.
#[derive(Debug)]
pub struct FileError {
    /// The file or folder.
    pub path: PathBuf,
    /// Line, counted from 1, where it is known.
    pub line: Option<usize>,
    /// Key in the file, such as `camera[0].from_world.rotation`; empty where there is none.
    pub key: String,
    /// The kind of fault with its values.
    pub problem: Box<Problem>,
    /// What the reader of the message can do; empty where that is plain.
    pub remedy: String,
}

/// The kinds of fault.
#[derive(Debug, Error)]
pub enum Problem {
    /// The operating system refused.
    #[error("cannot {action}")]
    Io {
        /// The operation that failed, for example "read".
        action: &'static str,
        /// The error of the operating system.
        #[source]
        source: std::io::Error,
    },
    /// An image that does not decode.
    #[error("is no readable image (damaged or truncated?)")]
    Image(#[source] Box<image::ImageError>),
    /// Not the language that the file should be written in.
    #[error("{0}")]
    Syntax(String),
    /// The text or file is larger than anything meant.
    #[error("is {found} bytes long, limit {limit}")]
    TooLarge {
        /// Size of the file, bytes.
        found: u64,
        /// Largest size accepted, bytes.
        limit: u64,
    },
    /// Another kind of file.
    #[error("format is \"{found}\", expected \"{expected}\"")]
    Format {
        /// As written; empty when absent.
        found: String,
        /// The format that is expected.
        expected: String,
    },
    /// A key that the format does not have.
    #[error("unknown key \"{name}\"; known here: {known}")]
    UnknownKey {
        /// The key as written.
        name: String,
        /// All that would be read.
        known: String,
    },
    /// A needed thing is absent.
    #[error("{0} is missing")]
    Missing(String),
    /// A value that cannot be meant.
    #[error("value {value} is not allowed: {limit}")]
    Value {
        /// The value as written.
        value: String,
        /// The values that are allowed.
        limit: String,
    },
    /// A name that refers to nothing.
    #[error("{kind} \"{name}\" is unknown; known: {known}")]
    UnknownName {
        /// What it should name.
        kind: &'static str,
        /// The name as written.
        name: String,
        /// All names that exist, as a list.
        known: String,
    },
    /// Two things with one name.
    #[error("{kind} \"{name}\" occurs twice")]
    Duplicate {
        /// What carries the name.
        kind: &'static str,
        /// The name that occurs twice.
        name: String,
    },
    /// Two places that must agree and do not.
    #[error("{what} disagree: {here}, but {there}")]
    Disagreement {
        /// The values that should agree.
        what: &'static str,
        /// One end, with its number.
        here: String,
        /// The other end, with its number.
        there: String,
    },
    /// A camera that cannot be.
    #[error("{0}")]
    Camera(CameraError),
    /// A pattern that cannot be decoded.
    #[error("{0}")]
    Pattern(PatternError),
    /// A sequence or settings that the decoder refuses.
    #[error(transparent)]
    Decode(fringe::decode::DecodeError),
    /// Parts of a cell that do not fit each other.
    #[error(transparent)]
    Schedule(cell::ScheduleError),
    /// An inspection plan that cannot be used.
    #[error(transparent)]
    Plan(metrology::inspection::PlanError),
    /// An acceptance plan or a rule set that cannot be used.
    #[error(transparent)]
    Acceptance(metrology::acceptance::AcceptanceError),
    /// A calibration target that cannot be.
    #[error(transparent)]
    Target(characterise::target::TargetError),
    /// A scene that the twin cannot trace.
    #[error(transparent)]
    Scene(twin::SceneError),
    /// A thing that this program does not do.
    #[error("{0}")]
    Unsupported(String),
}

impl FileError {
    /// A fault of a whole file.
    pub fn new(path: &Path, problem: Problem, remedy: impl Into<String>) -> Self {
        Self {
            path: path.to_owned(),
            line: None,
            key: String::new(),
            problem: Box::new(problem),
            remedy: remedy.into(),
        }
    }

    /// A refusal by the operating system.
    pub fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        let remedy = match source.kind() {
            std::io::ErrorKind::NotFound => "check the path",
            std::io::ErrorKind::PermissionDenied => "check the permissions",
            std::io::ErrorKind::StorageFull => "free space on the disk",
            _ => "",
        };
        Self::new(path, Problem::Io { action, source }, remedy)
    }

    /// The same fault at a key.
    #[must_use]
    pub fn at(mut self, key: impl Into<String>) -> Self {
        self.key = key.into();
        self
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        f.write_str(": ")?;
        if !self.key.is_empty() {
            write!(f, "{}: ", self.key)?;
        }
        write!(f, "{}", self.problem)?;
        if !self.remedy.is_empty() {
            write!(f, "; {}", self.remedy)?;
        }
        Ok(())
    }
}

impl std::error::Error for FileError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        std::error::Error::source(self.problem.as_ref())
    }
}

/// Names for a message: `cam1, cam2`, or `none`.
pub(crate) fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let joined = names.into_iter().collect::<Vec<_>>().join(", ");
    if joined.is_empty() { "none".to_owned() } else { joined }
}

/// `did you mean "…"?` when one of the known names is near enough, else the fallback.
pub(crate) fn did_you_mean<'a>(
    name: &str,
    known: impl IntoIterator<Item = &'a str>,
    fallback: &str,
) -> String {
    nearest(name, known).map_or_else(|| fallback.to_owned(), |near| format!("did you mean \"{near}\"?"))
}

/// The known name within a third of the letters, the first one of equals.
fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let limit = (name.chars().count() / 3).max(1);
    known
        .into_iter()
        .map(|candidate| (edit_distance(name, candidate), candidate))
        .filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Insertions, deletions, changes and swaps of neighbours (optimal string alignment).
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before: Vec<usize> = Vec::new();
    let mut last: Vec<usize> = (0..=b.len()).collect();
    for i in 0..a.len() {
        let mut row = vec![i + 1];
        for j in 0..b.len() {
            let mut best = (last[j] + usize::from(a[i] != b[j])).min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j] {
                best = best.min(before[j - 1] + 1);
            }
            row.push(best);
        }
        before = std::mem::replace(&mut last, row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_counts_insertions_deletions_changes_and_swaps() {
        assert_eq!(edit_distance("nmae", "name"), 1);
        assert_eq!(edit_distance("heigth_px", "height_px"), 1);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("cam1", "cam1"), 0);
    }

    #[test]
    fn a_near_name_is_offered_and_a_far_one_is_not() {
        assert_eq!(nearest("widht_px", ["width_px", "height_px"]), Some("width_px"));
        assert_eq!(nearest("zoom", ["width_px", "height_px"]), None);
        assert_eq!(did_you_mean("cam3", ["cam1"], "add it"), "did you mean \"cam1\"?");
    }

    #[test]
    fn a_message_says_file_line_key_problem_and_remedy() {
        let mut error =
            FileError::new(Path::new("a.toml"), Problem::Missing("rig".into()), "add it").at("cell");
        error.line = Some(3);
        assert_eq!(error.to_string(), "a.toml:3: cell: rig is missing; add it");
    }
}
