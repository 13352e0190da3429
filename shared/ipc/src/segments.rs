//! The shared-memory segments of a cell: files in `/dev/shm`, where every user can create files.

use crate::error::IpcError;
use crate::runtime_folder::{file_error, names, untrusted, user};
use rustix::fs::{self, AtFlags, FileType, Mode, OFlags, Stat};
use rustix::io::Errno;
use std::collections::BTreeMap;
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};

/// Where Linux keeps named shared memory.
pub(crate) const SHARED_MEMORY: &str = "/dev/shm";

/// Segments with their sizes, bytes.
pub(crate) type Sizes = BTreeMap<String, u64>;

/// Removes the segments of this user whose names begin with a prefix.
pub(crate) fn remove(prefix: &str) -> Result<(), IpcError> {
    let folder = open()?;
    for (name, stat) in with_prefix(&folder, prefix)? {
        if stat.st_uid != user() || FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile {
            continue;
        }
        match fs::unlinkat(&folder, name.as_str(), AtFlags::empty()) {
            Ok(()) | Err(Errno::NOENT) => {}
            Err(error) => return Err(file_error(&path(&name), "removing", error.into())),
        }
    }
    Ok(())
}

/// Whether any file, of whichever user, begins with a prefix.
pub(crate) fn exist(prefix: &str) -> Result<bool, IpcError> {
    Ok(!with_prefix(&open()?, prefix)?.is_empty())
}

/// Memory of the segments of this user whose names begin with a prefix, bytes.
///
/// # Errors
/// [`IpcError::File`] where /dev/shm cannot be listed.
pub(crate) fn held_bytes(prefix: &str) -> Result<u64, IpcError> {
    let found = with_prefix(&open()?, prefix)?;
    // Blocks of 512 bytes, whatever the file system: a segment may be longer than what it holds.
    let bytes = |stat: &Stat| (stat.st_blocks as u64).saturating_mul(512);
    Ok(found.iter().filter(|(_, stat)| stat.st_uid == user()).map(|(_, stat)| bytes(stat)).sum())
}

/// Makes the segments with a prefix accessible to this user only; iceoryx2 creates one with mode 0666.
///
/// # Errors
/// [`IpcError::Untrusted`] if another user owns one of them.
pub(crate) fn protect(prefix: &str) -> Result<Sizes, IpcError> {
    let folder = open()?;
    for (name, stat) in with_prefix(&folder, prefix)? {
        if stat.st_uid != user() {
            return Err(untrusted(&path(&name), format!("belongs to user {}", stat.st_uid)));
        }
        let opened = fs::openat(
            &folder,
            name.as_str(),
            OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::CLOEXEC,
            Mode::empty(),
        );
        opened
            .and_then(|file| fs::fchmod(file, Mode::RUSR | Mode::WUSR))
            .map_err(|e| file_error(&path(&name), "setting the mode", e.into()))?;
    }
    sizes(&folder, prefix)
}

/// Checks that segments still have their owner, mode and size.
///
/// # Errors
/// [`IpcError::Untrusted`] for the first one that has changed.
pub(crate) fn check(prefix: &str, expected: &Sizes) -> Result<(), IpcError> {
    let folder = open()?;
    let found = with_prefix(&folder, prefix)?;
    for (name, size) in expected {
        let Some((_, stat)) = found.iter().find(|(found, _)| found == name) else {
            return Err(untrusted(&path(name), "was removed while the cell runs".into()));
        };
        let private =
            stat.st_uid == user() && !Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO);
        if !private || stat.st_size as u64 != *size {
            let reason = format!("was changed while the cell runs: {} bytes, before {size}", stat.st_size);
            return Err(untrusted(&path(name), reason));
        }
    }
    Ok(())
}

fn sizes(folder: &OwnedFd, prefix: &str) -> Result<Sizes, IpcError> {
    Ok(with_prefix(folder, prefix)?.into_iter().map(|(name, stat)| (name, stat.st_size as u64)).collect())
}

fn open() -> Result<OwnedFd, IpcError> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
    fs::open(SHARED_MEMORY, flags, Mode::empty())
        .map_err(|e| file_error(Path::new(SHARED_MEMORY), "opening", e.into()))
}

fn with_prefix(folder: &OwnedFd, prefix: &str) -> Result<Vec<(String, Stat)>, IpcError> {
    let all = names(folder.as_fd()).map_err(|e| file_error(Path::new(SHARED_MEMORY), "listing", e))?;
    let matching =
        all.into_iter().filter_map(|name| name.into_string().ok().filter(|n| n.starts_with(prefix)));
    // A segment may disappear meanwhile.
    let stat = |name: String| {
        let stat = fs::statat(folder, name.as_str(), AtFlags::SYMLINK_NOFOLLOW).ok()?;
        Some((name, stat))
    };
    Ok(matching.filter_map(stat).collect())
}

fn path(name: &str) -> PathBuf {
    Path::new(SHARED_MEMORY).join(name)
}
