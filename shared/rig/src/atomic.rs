//! Output files that are complete or absent.

use crate::error::{FileError, Problem};
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Tells the temporary files of one process apart; the process id tells processes apart.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Writes a file in one step: a temporary one beside it, flushed to the disk, then renamed over it.
///
/// # Errors
/// The folder is absent or cannot be written, or the disk is full; the old file, if any, is untouched then.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_with(path, |out| out.write_all(bytes))
}

/// As [`write`], for contents that come piece by piece.
///
/// # Errors
/// As [`write`], and whatever `fill` reports.
pub fn write_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), FileError> {
    let temporary = Temporary(beside(path)?);
    let written = || -> io::Result<()> {
        let mut out = BufWriter::with_capacity(1 << 16, File::create_new(&temporary.0)?);
        fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        fs::rename(&temporary.0, path)
    };
    written().map_err(|source| FileError::io(path, "write it", source))
}

/// Creates a folder and its parents.
///
/// # Errors
/// A parent is a file or cannot be written.
pub fn create_dir(path: &Path) -> Result<(), FileError> {
    fs::create_dir_all(path).map_err(|source| FileError::io(path, "create the folder", source))
}

/// Removed when dropped; after a successful rename there is nothing left to remove.
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0);
    }
}

fn beside(path: &Path) -> Result<PathBuf, FileError> {
    let Some(name) = path.file_name() else {
        return Err(FileError::new(
            path,
            Problem::Unsupported("is no file name".into()),
            "name a file to write",
        ));
    };
    if path.is_dir() {
        return Err(FileError::new(path, Problem::Unsupported("is a folder".into()), "name a file to write"));
    }
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    let mut temporary = std::ffi::OsString::from(".");
    temporary.push(name);
    temporary.push(format!(".{}-{number}.tmp", std::process::id()));
    Ok(path.with_file_name(temporary))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let mut names: Vec<_> =
            fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a");
        write(&path, b"old").unwrap();
        let error = write_with(&path, |out| {
            out.write_all(b"half")?;
            Err(io::Error::other("stopped"))
        });
        assert!(error.unwrap_err().to_string().ends_with("cannot write it"));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        write(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()), ["a"]);
    }

    #[test]
    fn an_absent_folder_is_reported() {
        let dir = tempfile::tempdir().unwrap();
        let error = write(&dir.path().join("no/a"), b"x").unwrap_err();
        assert!(error.to_string().contains("no/a: cannot write it; check the path"), "{error}");
        assert!(write(dir.path(), b"x").is_err());
    }
}
