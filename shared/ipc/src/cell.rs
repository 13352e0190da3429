//! The place of a cell in the machine: a folder on tmpfs, a lock, a prefix of its own.
//!
//! `/dev/shm/fringecell-<cell>/` holds the lock, the socket for commands and iceoryx2's files; its segments lie beside it
//! as `/dev/shm/fc-<hash of the cell's name>.*`.
//! A Unix socket's path may have 107 bytes. iceoryx2 names a bell's socket folder + '/' + prefix + number + ".event" with
//! a number that grows with the ports of a process (31 digits for the tenth, 36 for the ten-millionth). A cell name of 32
//! leaves 12 bytes for the prefix: hence a hash.
//! The folder is on tmpfs on purpose: a tmp cleaner that removes the files but not the segments would leak memory for ever,
//! and a reboot removes both.

use crate::error::IpcError;
use crate::os;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::os::unix::fs::{DirBuilderExt, MetadataExt};
use std::path::{Path, PathBuf};

/// Where Linux keeps named shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// See the bytes of a socket's path above.
const MAX_NAME_BYTES: usize = 32;

/// Attempts to take the lock: another supervisor may be just removing it, or `status` just looking whether it is held.
const LOCK_ATTEMPTS: usize = 20;

/// Pause between two attempts.
const LOCK_PAUSE: std::time::Duration = std::time::Duration::from_millis(5);

/// A checked name of a cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CellName(String);

impl CellName {
    /// Checks a name.
    ///
    /// # Errors
    /// [`IpcError::CellName`].
    pub fn new(name: &str) -> Result<Self, IpcError> {
        let letters = name.bytes().all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_'));
        let begins = name.bytes().next().is_some_and(|b| b.is_ascii_alphanumeric());
        if letters && begins && name.len() <= MAX_NAME_BYTES {
            Ok(Self(name.to_owned()))
        } else {
            Err(IpcError::CellName(name.to_owned()))
        }
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The folder of the cell.
    pub fn folder(&self) -> PathBuf {
        Path::new(SHARED_MEMORY).join(format!("fringecell-{}", self.0))
    }

    /// What the names of its segments begin with.
    pub fn prefix(&self) -> String {
        // FNV-1a, folded to 40 bits: eight letters. Among a hundred cells of one machine two meet once in 2e8 machines.
        let hash = self
            .0
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325_u64, |h, byte| (h ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
        let folded = hash ^ (hash >> 40);
        let letters = b"abcdefghijklmnopqrstuvwxyz234567";
        let text: String = (0..8).map(|i| char::from(letters[((folded >> (5 * i)) & 31) as usize])).collect();
        format!("fc-{text}.")
    }

    /// What the paths of its segments begin with.
    pub fn segments(&self) -> String {
        format!("{SHARED_MEMORY}/{}", self.prefix())
    }

    /// The socket for `status`, `restart` and `stop`.
    pub fn socket(&self) -> PathBuf {
        self.folder().join("command")
    }

    fn lock_file(&self) -> PathBuf {
        self.folder().join("lock")
    }
}

/// The right to run a cell. Dropping it removes everything that the cell had in the machine.
#[derive(Debug)]
pub struct CellLock {
    name: CellName,
    lock: File,
}

impl CellLock {
    /// Takes the lock, then removes what an earlier killed run left.
    ///
    /// # Errors
    /// [`IpcError::Running`] when another supervisor holds it, [`IpcError::File`] when the folder cannot be used.
    pub fn take(name: &CellName) -> Result<Self, IpcError> {
        let mut refusal = IpcError::Running { cell: name.0.clone(), pid: "unknown".into() };
        for _ in 0..LOCK_ATTEMPTS {
            match try_lock(name) {
                Ok(Some(lock)) => {
                    let held = Self { name: name.clone(), lock };
                    held.wipe(false)?;
                    held.write_pid()?;
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

    /// The cell.
    pub fn name(&self) -> &CellName {
        &self.name
    }

    /// Refuses to start when the buffers could not be filled: writing beyond the end of tmpfs is a bus error.
    ///
    /// # Errors
    /// [`IpcError::Space`].
    pub fn check_space(&self, needed_bytes: u64) -> Result<(), IpcError> {
        let path = Path::new(SHARED_MEMORY);
        let free =
            os::free_bytes(path).map_err(|source| file_error(path, "asking for free space", source))?;
        if needed_bytes <= free {
            return Ok(());
        }
        Err(IpcError::Space { free_mb: free / 1_000_000, needed_mb: needed_bytes.div_ceil(1_000_000) })
    }

    fn write_pid(&self) -> Result<(), IpcError> {
        let path = self.name.lock_file();
        let write = || {
            let mut file = &self.lock;
            file.set_len(0)?;
            file.rewind()?;
            write!(file, "{}", std::process::id())
        };
        write().map_err(|source| file_error(&path, "writing the process id", source))
    }

    /// Removes segments and files of this cell; the lock and its folder too if `all`.
    fn wipe(&self, all: bool) -> Result<(), IpcError> {
        let shared = Path::new(SHARED_MEMORY);
        let prefix = self.name.prefix();
        for entry in list(shared)? {
            if entry.file_name().is_some_and(|n| n.to_string_lossy().starts_with(&prefix)) {
                remove(&entry)?;
            }
        }
        let folder = self.name.folder();
        let lock = self.name.lock_file();
        for entry in list(&folder)? {
            if entry != lock {
                remove(&entry)?;
            }
        }
        if all {
            remove(&lock)?;
            remove(&folder)?;
        }
        Ok(())
    }
}

impl Drop for CellLock {
    fn drop(&mut self) {
        // Nothing can be done about a failure here; the next start wipes again and reports it.
        let _ = self.wipe(true);
    }
}

/// The process id of the supervisor that holds a cell's lock.
pub fn running_pid(name: &CellName) -> Option<u32> {
    let file = File::open(name.lock_file()).ok()?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => read_pid(&file).parse().ok(),
        _ => None,
    }
}

/// The cells that run on this machine, by name.
pub fn running_cells() -> Vec<CellName> {
    let Ok(entries) = list(Path::new(SHARED_MEMORY)) else { return Vec::new() };
    let name = |path: &PathBuf| CellName::new(path.file_name()?.to_str()?.strip_prefix("fringecell-")?).ok();
    let mut cells: Vec<CellName> =
        entries.iter().filter_map(name).filter(|cell| running_pid(cell).is_some()).collect();
    cells.sort_by(|a, b| a.0.cmp(&b.0));
    cells
}

/// `None`: the folder vanished under us, try again.
fn try_lock(name: &CellName) -> Result<Option<File>, IpcError> {
    let folder = name.folder();
    match fs::DirBuilder::new().mode(0o700).create(&folder) {
        Err(e) if e.kind() != std::io::ErrorKind::AlreadyExists => {
            return Err(file_error(&folder, "creating the folder", e));
        }
        _ => {}
    }
    let path = name.lock_file();
    let file = match OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path) {
        Ok(file) => file,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(file_error(&path, "opening the lock", e)),
    };
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            return Err(IpcError::Running { cell: name.0.clone(), pid: read_pid(&file) });
        }
        Err(TryLockError::Error(e)) => return Err(file_error(&path, "locking", e)),
    }
    // The holder before us may have removed the file between our opening and our locking it: then this lock is of no use.
    let same = match (file.metadata(), fs::metadata(&path)) {
        (Ok(ours), Ok(there)) => ours.ino() == there.ino() && ours.dev() == there.dev(),
        _ => false,
    };
    Ok(same.then_some(file))
}

fn read_pid(mut file: &File) -> String {
    let mut text = String::new();
    match file.read_to_string(&mut text) {
        Ok(_) if !text.trim().is_empty() => text.trim().to_owned(),
        _ => "unknown".to_owned(),
    }
}

fn list(folder: &Path) -> Result<Vec<PathBuf>, IpcError> {
    let entries = fs::read_dir(folder).map_err(|e| file_error(folder, "listing", e))?;
    Ok(entries.filter_map(|entry| entry.ok().map(|e| e.path())).collect())
}

fn remove(path: &Path) -> Result<(), IpcError> {
    let result = match fs::symlink_metadata(path) {
        Ok(meta) if meta.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(e) => Err(e),
    };
    match result {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(file_error(path, "removing", e)),
        _ => Ok(()),
    }
}

fn file_error(path: &Path, action: &'static str, source: std::io::Error) -> IpcError {
    IpcError::File { path: path.to_owned(), action, source }
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

    #[test]
    fn buffers_beyond_the_machine_are_refused_with_both_numbers() {
        let held = CellLock::take(&name("space")).unwrap();
        let message = held.check_space(u64::MAX / 2).unwrap_err().to_string();
        assert!(message.contains("MB free") && message.contains("need up to"), "{message}");
        held.check_space(1).unwrap();
    }
}
