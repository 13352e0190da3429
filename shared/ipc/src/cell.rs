//! The identity of a cell on its machine: name, lock, runtime folder, prefix of its segments.
//!
//! `/dev/shm/fringecell-<cell>/` holds the lock, the command socket and the files of iceoryx2. The segments are beside it as
//! `/dev/shm/fc-<hash of the cell name><random letters of the run>.*`. The folder is on tmpfs on purpose: a tmp cleaner that
//! removes the files but not the segments would leak memory, and a reboot removes both.
//!
//! Every user can create files in `/dev/shm`, so folder and segments are checked before use ([`crate::runtime_folder`],
//! [`crate::segments`]). The random letters make the names of a run unknown in advance.
//!
//! The path of a Unix socket has at most 107 bytes. iceoryx2 makes the path of a notification of the folder, '/', the prefix, a
//! number that grows with the ports of a process (31 digits for the tenth, 36 for the ten-millionth) and ".event". A cell name
//! of 32 bytes leaves 12 bytes for the prefix: hence a hash.

use crate::error::IpcError;
use crate::left_behind::left_behind;
use crate::os;
use crate::runtime_folder::{RuntimeFolder, file_error};
use crate::segments::{self, SHARED_MEMORY, Sizes};
use rustix::fs::OFlags;
use std::fs::{self, File, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::{Path, PathBuf};

/// Attempts to take the lock: another supervisor may be removing it, or a client may be checking it.
const LOCK_ATTEMPTS: usize = 20;

/// Pause between two attempts.
const LOCK_PAUSE: std::time::Duration = std::time::Duration::from_millis(5);

/// Part of the memory of a cell that its folder with the lock may take before the rest is asked for, bytes.
const FOLDER_BYTES: u64 = 64 << 10;

/// Name of the lock file.
const LOCK: &str = "lock";

/// Name of the file with the prefix of the run.
const PREFIX: &str = "prefix";

/// Letters of a prefix; six bits each.
const LETTERS: &[u8; 64] = b"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_";

/// Letters of a prefix for the cell name: of a hundred cells, two have the same ones on one of 200 000 machines.
const NAME_LETTERS: usize = 5;

/// Random letters of a prefix.
const RUN_LETTERS: usize = 3;

/// A valid cell name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellName(String);

impl CellName {
    /// Checks a name.
    ///
    /// # Errors
    /// [`IpcError::CellName`].
    pub fn new(name: &str) -> Result<Self, IpcError> {
        if fringe::text::is_cell_name(name) {
            Ok(Self(name.to_owned()))
        } else {
            Err(IpcError::CellName(name.to_owned()))
        }
    }

    /// The name of the cell.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The runtime folder of the cell.
    pub fn folder(&self) -> PathBuf {
        Path::new(SHARED_MEMORY).join(format!("fringecell-{}", self.0))
    }

    /// First letters of the names of its segments, the same in every run.
    pub fn prefix(&self) -> String {
        // FNV-1a, folded.
        let hash = self
            .0
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        format!("fc-{}", letters(hash ^ (hash >> 32), NAME_LETTERS))
    }

    /// First letters of the names of its segments in the current run.
    ///
    /// # Errors
    /// [`IpcError::File`] if no supervisor has started the cell, [`IpcError::Untrusted`] for a folder of another user.
    pub(crate) fn run_prefix(&self) -> Result<String, IpcError> {
        let folder = RuntimeFolder::open(&self.folder())?;
        let mut text = String::new();
        folder
            .open_file(PREFIX, OFlags::RDONLY)
            .and_then(|mut file| file.read_to_string(&mut text))
            .map_err(|e| file_error(&folder.path_of(PREFIX), "reading", e))?;
        Ok(text)
    }

    /// First letters of the paths of its segments.
    pub fn segments(&self) -> String {
        format!("{SHARED_MEMORY}/{}", self.prefix())
    }

    /// Path of the command socket.
    pub fn socket(&self) -> PathBuf {
        self.folder().join("command")
    }
}

/// The right to run a cell. Dropping it removes all files and segments of the cell.
#[derive(Debug)]
pub struct CellLock {
    name: CellName,
    folder: RuntimeFolder,
    lock: File,
    run_prefix: String,
    /// Segments that exist during the whole run, once protected.
    protected: Sizes,
}

impl CellLock {
    /// Takes the lock, then removes what a killed run left.
    ///
    /// # Errors
    /// [`IpcError::Running`] if another supervisor holds it, [`IpcError::NoSharedMemory`] without /dev/shm, [`IpcError::Untrusted`] if another user controls the folder,
    /// [`IpcError::File`] if the folder cannot be used.
    pub fn take(name: &CellName) -> Result<Self, IpcError> {
        let mut refusal = IpcError::Running { cell: name.0.clone(), pid: "unknown".into() };
        for _ in 0..LOCK_ATTEMPTS {
            match try_lock(name) {
                Ok(Some((folder, lock))) => {
                    folder.clear(LOCK)?;
                    segments::remove(&name.prefix())?;
                    let run_prefix = new_run_prefix(name)?;
                    let held = Self { name: name.clone(), folder, lock, run_prefix, protected: Sizes::new() };
                    held.write_files()?;
                    return Ok(held);
                }
                Ok(None) => {}
                Err(error @ IpcError::Running { .. }) => refusal = error,
                Err(error) => return Err(error),
            }
            std::thread::sleep(LOCK_PAUSE);
        }
        Err(refusal)
    }

    /// Name of the locked cell.
    pub fn name(&self) -> &CellName {
        &self.name
    }

    /// Makes the segments of the supervisor's node accessible to this user only.
    ///
    /// # Errors
    /// [`IpcError::Untrusted`] if another user owns one of them.
    pub fn protect_segments(&mut self) -> Result<(), IpcError> {
        self.protected = segments::protect(&self.run_prefix)?;
        Ok(())
    }

    /// Checks that the protected segments have not changed: iceoryx2 may not return if one is truncated.
    ///
    /// # Errors
    /// [`IpcError::Untrusted`].
    pub fn check_segments(&self) -> Result<(), IpcError> {
        segments::check(&self.run_prefix, &self.protected)
    }

    /// Checks that the buffers fit in shared memory: writing beyond the end of tmpfs is a bus error.
    ///
    /// # Errors
    /// [`IpcError::Space`].
    pub fn check_space(&self, needed_bytes: u64) -> Result<(), IpcError> {
        let path = Path::new(SHARED_MEMORY);
        let free =
            os::free_bytes(path).map_err(|source| file_error(path, "reading the free space", source))?;
        if needed_bytes.saturating_sub(FOLDER_BYTES) <= free {
            return Ok(());
        }
        let left = left_behind().into_iter().map(|left| format!("; {left}: {}", left.remove));
        Err(IpcError::Space {
            free_mb: free / 1_000_000,
            needed_mb: needed_bytes.div_ceil(1_000_000),
            left: left.collect(),
        })
    }

    fn write_files(&self) -> Result<(), IpcError> {
        let write = |mut file: &File, text: &str| {
            file.set_len(0)?;
            file.rewind()?;
            file.write_all(text.as_bytes())
        };
        write(&self.lock, &std::process::id().to_string())
            .map_err(|e| file_error(&self.folder.path_of(LOCK), "writing the process id", e))?;
        self.folder
            .open_file(PREFIX, OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL)
            .and_then(|file| write(&file, &self.run_prefix))
            .map_err(|e| file_error(&self.folder.path_of(PREFIX), "writing", e))
    }
}

impl Drop for CellLock {
    fn drop(&mut self) {
        // A failure cannot be handled here; the next start cleans up again and reports it.
        let _ = segments::remove(&self.name.prefix());
        let _ = self.folder.clear(LOCK).and_then(|()| self.folder.remove(LOCK));
    }
}

/// The process id of the supervisor that runs a cell of this user.
pub fn running_pid(name: &CellName) -> Option<u32> {
    let file = RuntimeFolder::open(&name.folder()).ok()?.open_file(LOCK, OFlags::RDONLY).ok()?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => read_pid(&file).parse().ok(),
        _ => None,
    }
}

/// The running cells of this user, sorted by name.
pub fn running_cells() -> Vec<CellName> {
    let Ok(entries) = fs::read_dir(SHARED_MEMORY) else { return Vec::new() };
    let cell = |entry: fs::DirEntry| {
        let name = CellName::new(entry.file_name().to_str()?.strip_prefix("fringecell-")?).ok()?;
        running_pid(&name).map(|_| name)
    };
    let mut cells: Vec<CellName> = entries.filter_map(|entry| cell(entry.ok()?)).collect();
    cells.sort_by(|a, b| a.0.cmp(&b.0));
    cells
}

/// A prefix that no file begins with.
fn new_run_prefix(name: &CellName) -> Result<String, IpcError> {
    for _ in 0..LOCK_ATTEMPTS {
        let prefix = format!("{}{}.", name.prefix(), letters(random()?, RUN_LETTERS));
        if !segments::exist(&prefix)? {
            return Ok(prefix);
        }
    }
    let reason = "has many files of another user under the prefix of this cell".into();
    Err(IpcError::Untrusted { path: PathBuf::from(format!("{SHARED_MEMORY}/{}", name.prefix())), reason })
}

pub(crate) fn random() -> Result<u64, IpcError> {
    let path = Path::new("/dev/urandom");
    let mut bytes = [0; 8];
    File::open(path)
        .and_then(|mut file| file.read_exact(&mut bytes))
        .map_err(|source| file_error(path, "reading", source))?;
    Ok(u64::from_ne_bytes(bytes))
}

fn letters(bits: u64, count: usize) -> String {
    (0..count).map(|i| char::from(LETTERS[((bits >> (6 * i)) & 63) as usize])).collect()
}

/// `None`: the folder was removed meanwhile; try again.
fn try_lock(name: &CellName) -> Result<Option<(RuntimeFolder, File)>, IpcError> {
    let folder = match RuntimeFolder::create(&name.folder()) {
        Err(IpcError::File { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => {
            let is_there = Path::new(SHARED_MEMORY).is_dir();
            return if is_there { Ok(None) } else { Err(IpcError::NoSharedMemory) };
        }
        other => other?,
    };
    let file = match folder.open_file(LOCK, OFlags::RDWR | OFlags::CREATE) {
        Ok(file) => file,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(file_error(&folder.path_of(LOCK), "opening the lock", e)),
    };
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(IpcError::Running { cell: name.0.clone(), pid: read_pid(&file) });
        }
        Err(TryLockError::Error(e)) => return Err(file_error(&folder.path_of(LOCK), "locking", e)),
    }
    // The previous holder may have removed the file between opening and locking; then this lock is void.
    Ok(folder.is_current(LOCK, &file).then_some((folder, file)))
}

fn read_pid(mut file: &File) -> String {
    let mut text = String::new();
    match file.read_to_string(&mut text) {
        Ok(_) if !text.trim().is_empty() => text.trim().to_owned(),
        _ => "unknown".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> CellName {
        // Tests of several checkouts may run at once.
        CellName::new(&format!("{text}{}", std::process::id())).unwrap()
    }

    #[test]
    fn names_that_could_reach_another_path_are_refused() {
        for bad in ["", "A", "-a", "a/b", "a.b", "..", "a b", "abcdefghijklmnopqrstuvwxyz-123456"] {
            assert!(CellName::new(bad).is_err(), "{bad}");
        }
        assert!(CellName::new("demo-2_b").is_ok());
    }

    #[test]
    fn the_second_supervisor_is_told_who_runs_the_cell() {
        let cell = name("lock");
        let held = CellLock::take(&cell).unwrap();
        let message = CellLock::take(&cell).unwrap_err().to_string();
        assert!(message.contains("already running, pid"), "{message}");
        assert_eq!(running_pid(&cell), Some(std::process::id()));
        drop(held);
        assert!(!cell.folder().exists());
        assert_eq!(running_pid(&cell), None);
        CellLock::take(&cell).unwrap();
    }

    #[test]
    fn what_a_killed_run_left_is_removed_and_nothing_else() {
        let (cell, other) = (name("wipe"), name("wipe-b"));
        let segment = |c: &CellName| Path::new(SHARED_MEMORY).join(format!("{}left.data", c.prefix()));
        fs::create_dir_all(cell.folder().join("services/x")).unwrap();
        fs::write(segment(&cell), "x").unwrap();
        fs::write(segment(&other), "x").unwrap();
        let held = CellLock::take(&cell).unwrap();
        assert!(!segment(&cell).exists() && !cell.folder().join("services").exists());
        assert!(segment(&other).exists());
        drop(held);
        drop(CellLock::take(&other).unwrap());
        assert!(!segment(&other).exists());
    }

    /// Proves: another user can neither choose what a run removes or writes, nor change the shared memory of a cell.
    #[test]
    fn files_of_another_user_are_neither_used_nor_removed() {
        use std::os::unix::fs::{MetadataExt, chown, symlink};
        const OTHER: u32 = 65_534;
        if crate::runtime_folder::user() != 0 {
            eprintln!("skipped: only root can make files of another user");
            return;
        }
        let cell = name("other");
        let target = std::env::temp_dir().join(format!("ipc-other-{}", std::process::id()));
        fs::create_dir_all(&target).unwrap();
        fs::write(target.join("precious"), "x").unwrap();
        symlink(&target, cell.folder()).unwrap();
        let error = CellLock::take(&cell).unwrap_err().to_string();
        assert!(error.contains("is not a folder") && error.contains("--cell"), "{error}");
        fs::remove_file(cell.folder()).unwrap();

        fs::create_dir(cell.folder()).unwrap();
        fs::write(cell.folder().join("precious"), "x").unwrap();
        chown(cell.folder(), Some(OTHER), Some(OTHER)).unwrap();
        let error = CellLock::take(&cell).unwrap_err().to_string();
        assert!(error.contains("belongs to user 65534, not to user 0"), "{error}");
        assert!(target.join("precious").exists() && cell.folder().join("precious").exists());
        assert_eq!(running_pid(&cell), None);
        fs::remove_dir_all(cell.folder()).unwrap();

        let foreign = Path::new(SHARED_MEMORY).join(format!("{}aaa.left", cell.prefix()));
        fs::write(&foreign, "x").unwrap();
        chown(&foreign, Some(OTHER), Some(OTHER)).unwrap();
        let mut held = CellLock::take(&cell).unwrap();
        assert!(foreign.exists());
        let _node = crate::port::Node::join(&cell, "supervisor").unwrap();
        held.protect_segments().unwrap();
        let own: Vec<_> = fs::read_dir(SHARED_MEMORY)
            .unwrap()
            .filter_map(Result::ok)
            .filter(|e| e.file_name().to_string_lossy().starts_with(&held.run_prefix))
            .collect();
        assert!(!own.is_empty());
        for entry in &own {
            assert_eq!(entry.metadata().unwrap().mode() & 0o777, 0o600, "{entry:?}");
        }
        held.check_segments().unwrap();
        File::options().write(true).open(own[0].path()).unwrap().set_len(1).unwrap();
        let error = held.check_segments().unwrap_err().to_string();
        assert!(error.contains("was changed while the cell runs"), "{error}");
        fs::remove_file(foreign).unwrap();
        fs::remove_dir_all(target).unwrap();
    }

    #[test]
    fn buffers_larger_than_shared_memory_are_refused_with_both_numbers() {
        let held = CellLock::take(&name("space")).unwrap();
        let message = held.check_space(u64::MAX / 2).unwrap_err().to_string();
        assert!(message.contains("MB free") && message.contains("need up to"), "{message}");
        held.check_space(1).unwrap();
    }
}
