//! One guard for every output of every command: no input is overwritten, and nothing of another kind is replaced.
//!
//! Files are distinguished by device and inode, so that links and other spellings of a path do not deceive. A file that was
//! opened for reading ([`opened`]) is an input of the command and is not written to; a file that the command announced
//! as an output ([`announce`]) is not opened for reading, so that the command ends before it computes. What is there
//! already is replaced by the same kind of file only ([`Kind`]), unless that was asked for ([`replace_anything`]).
//! The state is that of the process, which runs one command.

use crate::error::{FileError, Problem};
use crate::kind::Kind;
use std::collections::BTreeSet;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

/// What is remembered of files written before the oldest are forgotten: a cell that serves writes without end.
const MADE_LIMIT: usize = 1 << 16;

/// A file, whatever its path. An inode number is used again after its file was removed; the time of birth, where the
/// file system knows it, distinguishes the two.
type FileId = (u64, u64, Option<SystemTime>);

#[derive(Debug)]
struct Known {
    /// Replace files of any kind.
    force: bool,
    /// Files that were read.
    inputs: BTreeSet<FileId>,
    /// Files that this process wrote: reading them again makes them no input.
    made: BTreeSet<FileId>,
    /// Files that are going to be written, each with its option.
    outputs: Vec<(FileId, String)>,
}

static KNOWN: Mutex<Known> =
    Mutex::new(Known { force: false, inputs: BTreeSet::new(), made: BTreeSet::new(), outputs: Vec::new() });

fn known() -> MutexGuard<'static, Known> {
    KNOWN.lock().unwrap_or_else(PoisonError::into_inner)
}

fn id(metadata: &Metadata) -> FileId {
    (metadata.dev(), metadata.ino(), metadata.created().ok())
}

/// Of a file that is there; devices and folders are none.
fn id_of(path: &Path) -> Option<FileId> {
    fs::metadata(path).ok().filter(Metadata::is_file).map(|metadata| id(&metadata))
}

/// Lets outputs replace files of any kind (`--force`). Inputs stay.
pub fn replace_anything() {
    known().force = true;
}

/// Whether outputs replace files of any kind.
pub fn replaces_anything() -> bool {
    known().force
}

/// Notes that a file was opened for reading.
///
/// # Errors
/// It is an output of the same command.
pub fn opened(path: &Path, metadata: &Metadata) -> Result<(), FileError> {
    if !metadata.is_file() {
        return Ok(());
    }
    let file = id(metadata);
    let mut known = known();
    if let Some((_, flag)) = known.outputs.iter().find(|(output, _)| *output == file) {
        return Err(overwritten(path, flag));
    }
    if !known.made.contains(&file) {
        known.inputs.insert(file);
    }
    Ok(())
}

/// Whether two paths lead to the same file; absent ones do not.
pub fn same_file(a: &Path, b: &Path) -> bool {
    id_of(a).is_some_and(|file| id_of(b) == Some(file))
}

/// Notes that the command is going to write a file, before it reads anything.
///
/// # Errors
/// It was read already, or another kind of file is there.
pub fn announce(flag: &str, path: &Path) -> Result<(), FileError> {
    let Some(file) = id_of(path) else { return Ok(()) };
    may_write(path, flag)?;
    let expected = if flag == "--json" { Some(Kind::Json) } else { Kind::of_name(path) };
    if let Some(expected) = expected
        && !known().force
    {
        let found = Kind::of_file(path)?;
        if !found.is_like(&expected) {
            return Err(other_kind(path, &found, &expected));
        }
    }
    known().outputs.push((file, flag.to_owned()));
    Ok(())
}

/// Notes that a file is open to be appended to: the command reads it before, which makes it no input.
pub fn appending(metadata: &Metadata) {
    let (file, mut known) = (id(metadata), known());
    known.outputs.retain(|(output, _)| *output != file);
    known.made.insert(file);
}

/// Whether a file may be written to.
///
/// # Errors
/// It is an input of the command. `flag` names the output, empty where no option does.
pub fn may_write(path: &Path, flag: &str) -> Result<(), FileError> {
    match id_of(path) {
        Some(file) if known().inputs.contains(&file) => Err(overwritten(path, flag)),
        _ => Ok(()),
    }
}

/// Whether a new file, written beside it, may take the place of one that may be there.
///
/// # Errors
/// It is an input of the command, or of another kind than the new one.
pub fn may_replace(path: &Path, new: &Path) -> Result<(), FileError> {
    may_write(path, "")?;
    if let Some(made) = id_of(new) {
        let mut known = known();
        known.inputs.remove(&made);
        if known.made.len() >= MADE_LIMIT {
            known.made.clear();
        }
        known.made.insert(made);
    }
    let Some(old) = id_of(path) else { return Ok(()) };
    if known().force || known().made.contains(&old) {
        return Ok(());
    }
    let (found, made) = (Kind::of_file(path)?, Kind::of_file(new)?);
    if found.gives_way_to(&made) { Ok(()) } else { Err(other_kind(path, &found, &made)) }
}

/// Whether a file with this content may take the place of one that may be there: asked before work that cannot be undone.
///
/// # Errors
/// As [`may_replace`].
pub fn may_become(path: &Path, content: &[u8]) -> Result<(), FileError> {
    may_write(path, "")?;
    if id_of(path).is_none() || known().force {
        return Ok(());
    }
    let (found, made) = (Kind::of_file(path)?, Kind::of(content));
    if found.gives_way_to(&made) { Ok(()) } else { Err(other_kind(path, &found, &made)) }
}

fn overwritten(path: &Path, flag: &str) -> FileError {
    let by = if flag.is_empty() { "an output" } else { flag };
    let problem = Problem::Unsupported(format!("is an input of this command; {by} would overwrite an input"));
    FileError::new(path, problem, "name another file")
}

fn other_kind(path: &Path, found: &Kind, made: &Kind) -> FileError {
    let problem = Problem::Unsupported(format!("is {found}; {made} would replace it"));
    FileError::new(path, problem, "name another file, or add --force to replace it")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::atomic;
    use crate::document::read_text;

    #[test]
    fn an_input_is_not_written_to_through_any_of_its_names() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        fs::write(path("in.txt"), "a\n").unwrap();
        fs::hard_link(path("in.txt"), path("hard")).unwrap();
        std::os::unix::fs::symlink("in.txt", path("link")).unwrap();
        fs::create_dir(path("sub")).unwrap();
        atomic::write(&path("in.txt"), b"a\n").unwrap();
        fs::write(path("in.txt"), "a\n").unwrap(); // still the file that the process made
        read_text(&path("in.txt")).unwrap();
        atomic::write(&path("in.txt"), b"a\n").unwrap();

        fs::write(path("other"), "a\n").unwrap();
        fs::hard_link(path("other"), path("hard2")).unwrap();
        std::os::unix::fs::symlink("other", path("link2")).unwrap();
        read_text(&path("link2")).unwrap();
        for name in ["other", "hard2", "link2", "./other", "sub/../hard2"] {
            let error = atomic::write(&path(name), b"a\n").unwrap_err().to_string();
            assert!(error.contains("would overwrite an input"), "{name}: {error}");
        }
        assert_eq!(fs::read(path("other")).unwrap(), b"a\n");
    }

    #[test]
    fn an_announced_output_is_not_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.json");
        fs::write(&path, "{}").unwrap();
        announce("--json", &path).unwrap();
        let error = read_text(&path).unwrap_err().to_string();
        assert!(error.contains("--json would overwrite an input"), "{error}");
        appending(&fs::metadata(&path).unwrap());
        read_text(&path).unwrap();
        announce("--json", &path).unwrap();
    }

    #[test]
    fn another_kind_of_file_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        fs::write(&path, "format = \"fringecell-rig/1\"\n").unwrap();
        let error = announce("--json", &path).unwrap_err().to_string();
        assert!(error.contains("is fringecell-rig (TOML); JSON would replace it"), "{error}");
        let write = |text: &str| atomic::write(&path, text.as_bytes()).map_err(|e| e.to_string());
        let error = write("format = \"fringecell-truth/1\"\n").unwrap_err();
        assert!(error.contains("add --force"), "{error}");
        assert!(fs::read_to_string(&path).unwrap().contains("rig"));
        fs::write(&path, "{}").unwrap();
        let error = write("format = \"fringecell-rig/2\"\n").unwrap_err();
        assert!(error.contains("is an empty object (JSON);"), "{error}");
        fs::write(&path, "format = \"fringecell-rig/1\"\n").unwrap();
        write("# newer\nformat = \"fringecell-rig/2\"\n").unwrap();
    }
}
