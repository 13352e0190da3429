//! A private folder below a directory that every user can write, such as `/dev/shm`.
//!
//! Another user may have created the folder, a link or a file under any name beforehand. So a folder or file is used or
//! removed only after a check of the owner, through handles that follow no links.

use crate::error::IpcError;
use rustix::fs::{self, AtFlags, Dir, FileType, Mode, OFlags};
use rustix::io::Errno;
use std::ffi::{CStr, CString};
use std::fs::File;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Deepest folder that is removed; iceoryx2 creates two levels.
const MAX_DEPTH: usize = 8;

/// Longest time for removing the contents of a folder.
const REMOVE_TIMEOUT: Duration = Duration::from_secs(10);

/// A folder that belongs to this user and that no other user can write.
#[derive(Debug)]
pub(crate) struct RuntimeFolder {
    handle: OwnedFd,
    path: PathBuf,
}

impl RuntimeFolder {
    /// Creates the folder with mode 0700, or opens the one that this user has.
    pub(crate) fn create(path: &Path) -> Result<Self, IpcError> {
        match fs::mkdir(path, Mode::RWXU) {
            Ok(()) | Err(Errno::EXIST) => Self::open(path),
            Err(error) => Err(file_error(path, "creating the folder", error.into())),
        }
    }

    /// Opens the folder that this user has.
    pub(crate) fn open(path: &Path) -> Result<Self, IpcError> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let handle = match fs::open(path, flags, Mode::empty()) {
            Ok(handle) => handle,
            Err(Errno::NOTDIR | Errno::LOOP) => return Err(untrusted(path, "is not a folder".into())),
            Err(error) => return Err(file_error(path, "opening the folder", error.into())),
        };
        let stat = fs::fstat(&handle).map_err(|e| file_error(path, "checking the owner", e.into()))?;
        if stat.st_uid != user() {
            return Err(untrusted(path, format!("belongs to user {}, not to user {}", stat.st_uid, user())));
        }
        if Mode::from_raw_mode(stat.st_mode).intersects(Mode::WGRP | Mode::WOTH) {
            return Err(untrusted(path, "can be written by other users".into()));
        }
        fs::fchmod(&handle, Mode::RWXU).map_err(|e| file_error(path, "setting the mode", e.into()))?;
        Ok(Self { handle, path: path.to_owned() })
    }

    /// Path of a file in the folder.
    pub(crate) fn path_of(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Opens a regular file of this user in the folder; creates it with mode 0600 if `flags` say so.
    pub(crate) fn open_file(&self, name: &str, flags: OFlags) -> io::Result<File> {
        let flags = flags | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let file = fs::openat(&self.handle, name, flags, Mode::RUSR | Mode::WUSR)?;
        let stat = fs::fstat(&file)?;
        if FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile && stat.st_uid == user() {
            Ok(file.into())
        } else {
            Err(io::Error::other("it is not a regular file of this user"))
        }
    }

    /// Whether the file and the folder are still those at their paths, and not removed since.
    pub(crate) fn is_current(&self, name: &str, file: &File) -> bool {
        let same = |a: rustix::io::Result<fs::Stat>, b: rustix::io::Result<fs::Stat>| match (a, b) {
            (Ok(a), Ok(b)) => (a.st_dev, a.st_ino) == (b.st_dev, b.st_ino),
            _ => false,
        };
        same(fs::fstat(file), fs::statat(&self.handle, name, AtFlags::SYMLINK_NOFOLLOW))
            && same(fs::fstat(&self.handle), fs::lstat(&self.path))
    }

    /// Removes everything in the folder except one entry.
    pub(crate) fn clear(&self, except: &str) -> Result<(), IpcError> {
        let deadline = Instant::now() + REMOVE_TIMEOUT;
        for name in names(self.handle.as_fd()).map_err(|e| file_error(&self.path, "listing", e))? {
            if name.as_bytes() != except.as_bytes() {
                let path = self.path.join(name.to_string_lossy().as_ref());
                remove(self.handle.as_fd(), &name, MAX_DEPTH, deadline)
                    .map_err(|e| file_error(&path, "removing", e))?;
            }
        }
        Ok(())
    }

    /// Removes the last entry and the folder itself.
    pub(crate) fn remove(&self, last: &str) -> Result<(), IpcError> {
        for result in [fs::unlinkat(&self.handle, last, AtFlags::empty()), fs::rmdir(&self.path)] {
            match result {
                Ok(()) | Err(Errno::NOENT) => {}
                Err(error) => return Err(file_error(&self.path, "removing", error.into())),
            }
        }
        Ok(())
    }
}

/// Effective user id of this process.
pub(crate) fn user() -> u32 {
    rustix::process::geteuid().as_raw()
}

/// Names of the entries of a folder.
pub(crate) fn names(folder: BorrowedFd<'_>) -> io::Result<Vec<CString>> {
    let mut names = Vec::new();
    for entry in Dir::read_from(folder)? {
        let entry = entry?;
        if !matches!(entry.file_name().to_bytes(), b"." | b"..") {
            names.push(entry.file_name().to_owned());
        }
    }
    Ok(names)
}

/// Removes a file, a link itself, or a folder with its contents.
fn remove(folder: BorrowedFd<'_>, name: &CStr, depth: usize, deadline: Instant) -> io::Result<()> {
    if Instant::now() > deadline {
        return Err(io::Error::new(io::ErrorKind::TimedOut, "the folder has too many entries"));
    }
    match fs::unlinkat(folder, name, AtFlags::empty()) {
        Ok(()) | Err(Errno::NOENT) => return Ok(()),
        // Linux reports ISDIR, POSIX allows PERM.
        Err(Errno::ISDIR | Errno::PERM) if depth > 0 => {}
        Err(error) => return Err(error.into()),
    }
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
    let inner = fs::openat(folder, name, flags, Mode::empty())?;
    for entry in names(inner.as_fd())? {
        remove(inner.as_fd(), &entry, depth - 1, deadline)?;
    }
    match fs::unlinkat(folder, name, AtFlags::REMOVEDIR) {
        Ok(()) | Err(Errno::NOENT) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

/// A file that another user may control.
pub(crate) fn untrusted(path: &Path, reason: String) -> IpcError {
    IpcError::Untrusted { path: path.to_owned(), reason }
}

/// An operation on a file that failed.
pub(crate) fn file_error(path: &Path, action: &'static str, source: io::Error) -> IpcError {
    IpcError::File { path: path.to_owned(), action, source }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};

    fn parent(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("runtime-folder-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir(&path).unwrap();
        path
    }

    #[test]
    fn a_folder_is_private_and_its_contents_are_removed_without_following_links() {
        let parent = parent("clear");
        let (outside, path) = (parent.join("outside"), parent.join("cell"));
        std::fs::create_dir(&outside).unwrap();
        std::fs::write(outside.join("kept"), "x").unwrap();
        let folder = RuntimeFolder::create(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().mode() & 0o777, 0o700);
        std::fs::create_dir_all(path.join("a/b")).unwrap();
        std::fs::write(path.join("a/b/file"), "x").unwrap();
        symlink(&outside, path.join("link")).unwrap();
        symlink(&outside, path.join("a/link")).unwrap();
        std::fs::write(path.join("lock"), "").unwrap();
        folder.clear("lock").unwrap();
        assert_eq!(std::fs::read_dir(&path).unwrap().count(), 1);
        folder.remove("lock").unwrap();
        assert!(!path.exists() && outside.join("kept").exists());
        std::fs::remove_dir_all(parent).unwrap();
    }

    #[test]
    fn links_and_folders_that_others_can_write_are_refused() {
        let parent = parent("untrusted");
        let (real, link) = (parent.join("real"), parent.join("link"));
        std::fs::create_dir(&real).unwrap();
        symlink(&real, &link).unwrap();
        let error = RuntimeFolder::create(&link).unwrap_err();
        assert!(matches!(error, IpcError::Untrusted { .. }), "{error}");
        let folder = RuntimeFolder::create(&real).unwrap();
        symlink("/etc/hostname", real.join("file")).unwrap();
        assert!(folder.open_file("file", OFlags::RDWR | OFlags::CREATE).is_err());
        std::fs::set_permissions(&real, std::fs::Permissions::from_mode(0o777)).unwrap();
        let error = RuntimeFolder::create(&real).unwrap_err().to_string();
        assert!(error.contains("can be written by other users"), "{error}");
        std::fs::remove_dir_all(parent).unwrap();
    }
}
