//! Output files that are complete or absent.

use crate::document::refuse_named_pipe;
use crate::error::{FileError, Problem};
use crate::guard;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Distinguishes the temporary files of one process; the process id distinguishes processes.
static COUNTER: AtomicU64 = AtomicU64::new(0);

/// Most symbolic links that follow each other, as in Linux.
const MOST_LINKS: usize = 40;

/// Writes a file in one step: a temporary one beside it, flushed to the disk, then renamed over it. Inputs and files of
/// another kind are not replaced ([`guard`]).
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
    if is_stream(path)? {
        let written = || -> io::Result<()> {
            let mut out = BufWriter::new(File::options().write(true).open(path)?);
            fill(&mut out)?;
            out.flush()
        };
        return written().map_err(|source| FileError::io(path, "write it", source));
    }
    let target = behind_links(path)?;
    guard::may_write(&target, "")?;
    let temporary = Temporary(beside(&target)?);
    let failed = |source| FileError::io(path, "write it", source);
    let written = || -> io::Result<()> {
        let mut out = BufWriter::with_capacity(1 << 16, File::create_new(&temporary.0)?);
        fill(&mut out)?;
        out.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
    };
    written().map_err(failed)?;
    guard::may_replace(&target, &temporary.0)?;
    fs::rename(&temporary.0, &target).map_err(failed)
}

/// Where symbolic links lead, one at a time: they stay, and the last one's target is written, also where it is not there yet.
fn behind_links(path: &Path) -> Result<PathBuf, FileError> {
    let mut target = path.to_owned();
    for _ in 0..=MOST_LINKS {
        if !target.is_symlink() {
            return Ok(target);
        }
        let next = fs::read_link(&target).map_err(|source| FileError::io(path, "follow the link", source))?;
        // An absolute target replaces the folder.
        target = target.parent().unwrap_or(Path::new("")).join(next);
    }
    let problem = Problem::Unsupported(format!("leads through more than {MOST_LINKS} symbolic links"));
    Err(FileError::new(path, problem, "name the file itself"))
}

/// Whether the path is a device or an unnamed pipe, such as `/dev/stdout`: written to, never replaced.
fn is_stream(path: &Path) -> Result<bool, FileError> {
    refuse_named_pipe(path)?;
    let Ok(metadata) = fs::metadata(path) else { return Ok(false) };
    Ok(!metadata.is_file() && !metadata.is_dir())
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
    fn devices_are_written_to_and_links_stay_links() {
        use std::os::unix::fs::FileTypeExt;
        write(Path::new("/dev/null"), b"x").unwrap();
        assert!(fs::metadata("/dev/null").unwrap().file_type().is_char_device());
        assert!(write(Path::new("/dev/full"), b"x").is_err());
        let dir = tempfile::tempdir().unwrap();
        let (link, place) = (dir.path().join("link"), dir.path().join("place"));
        fs::write(&place, b"list\nold").unwrap();
        std::os::unix::fs::symlink("place", &link).unwrap();
        write(&link, b"list\nnew").unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&place).unwrap(), b"list\nnew");
    }

    #[test]
    fn links_to_what_is_not_there_yet_stay_links() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        fs::create_dir(at("sub")).unwrap();
        symlink("sub/second", at("first")).unwrap();
        symlink("../place", at("sub/second")).unwrap();
        write(&at("first"), b"x").unwrap();
        assert!(at("first").is_symlink() && at("sub/second").is_symlink());
        assert_eq!(fs::read(at("place")).unwrap(), b"x");
        symlink("no/place", at("lost")).unwrap();
        let error = write(&at("lost"), b"x").unwrap_err().to_string();
        assert!(error.contains("lost: cannot write it; check the path"), "{error}");
        symlink("b", at("a")).unwrap();
        symlink("a", at("b")).unwrap();
        let error = write(&at("a"), b"x").unwrap_err().to_string();
        assert!(error.contains("more than 40 symbolic links"), "{error}");
        assert!(at("lost").is_symlink() && at("a").is_symlink());
    }

    #[test]
    fn an_absent_folder_is_reported() {
        let dir = tempfile::tempdir().unwrap();
        let error = write(&dir.path().join("no/a"), b"x").unwrap_err();
        assert!(error.to_string().contains("no/a: cannot write it; check the path"), "{error}");
        assert!(write(dir.path(), b"x").is_err());
    }
}
