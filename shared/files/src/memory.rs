//! How much memory there is, so that a file that does not fit is refused with both numbers before anything is read into it.

use crate::error::{FileError, Problem};
use std::fs;
use std::path::{Path, PathBuf};

/// Bytes that this process may still take: the least of what the machine has available, what its control groups allow, and what
/// is left of its address space (`ulimit -v`). `None` where the system reports none of them.
pub fn available() -> Option<u64> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| machine_bytes(&text));
    let address_space = fs::read_to_string("/proc/self/limits").ok().and_then(|text| limit_bytes(&text));
    let used = fs::read_to_string("/proc/self/status").ok().and_then(|text| kib_after(&text, "VmSize:"));
    let left = address_space.map(|limit| limit.saturating_sub(used.unwrap_or(0)));
    [machine, left, control_groups()].into_iter().flatten().min()
}

/// Refuses a file that needs more memory than there is.
///
/// # Errors
/// It does; the message has both numbers.
pub fn check(path: &Path, what: &str, needed: u64) -> Result<(), FileError> {
    match available() {
        Some(available) if needed > available => Err(too_large(path, what, needed, available)),
        _ => Ok(()),
    }
}

fn too_large(path: &Path, what: &str, needed: u64, available: u64) -> FileError {
    let problem = Problem::Unsupported(format!(
        "{what} need at least {} of memory, {} are available",
        in_words(needed),
        in_words(available)
    ));
    FileError::new(path, problem, "thin it out, cut it into parts, or use a machine with more memory")
}

fn in_words(bytes: u64) -> String {
    match bytes {
        0..1_000_000_000 => format!("{} MB", bytes.div_ceil(1_000_000)),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

/// Of a line such as `MemAvailable:   123456 kB`.
fn machine_bytes(meminfo: &str) -> Option<u64> {
    kib_after(meminfo, "MemAvailable:")
}

fn kib_after(text: &str, key: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(key))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok()?.checked_mul(1024)
}

/// `Max address space         8000000000           unlimited            bytes`.
fn limit_bytes(limits: &str) -> Option<u64> {
    let line = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// What the control groups of this process leave: version 2, or the memory controller of version 1; of its own group and of all
/// groups above it.
fn control_groups() -> Option<u64> {
    let text = fs::read_to_string("/proc/self/cgroup").ok()?;
    text.lines()
        .filter_map(|line| {
            let mut parts = line.splitn(3, ':');
            let (_, controllers, group) = (parts.next()?, parts.next()?, parts.next()?);
            let (root, limit, usage) = match controllers {
                "" => ("/sys/fs/cgroup", "memory.max", "memory.current"),
                names if names.split(',').any(|name| name == "memory") => {
                    ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes")
                }
                _ => return None,
            };
            group_bytes(Path::new(root), group, limit, usage)
        })
        .min()
}

fn group_bytes(root: &Path, group: &str, limit: &str, usage: &str) -> Option<u64> {
    let own: PathBuf = root.join(group.trim_start_matches('/'));
    let groups = own.ancestors().take_while(|folder| folder.starts_with(root));
    groups.filter_map(|folder| left_of(folder, limit, usage)).min()
}

/// What is left of one group. Cached files count as used, but give way.
fn left_of(folder: &Path, limit: &str, usage: &str) -> Option<u64> {
    let number = |name: &str| fs::read_to_string(folder.join(name)).ok()?.trim().parse::<u64>().ok();
    let cached = fs::read_to_string(folder.join("memory.stat")).ok().and_then(|text| {
        text.lines().find_map(|line| line.strip_prefix("inactive_file "))?.trim().parse::<u64>().ok()
    });
    let used = number(usage)?.saturating_sub(cached.unwrap_or(0));
    Some(number(limit)?.saturating_sub(used))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_the_system_are_read() {
        assert_eq!(machine_bytes("MemTotal: 9 kB\nMemAvailable:     2048 kB\n"), Some(2_097_152));
        let limits = "Limit    Soft Limit  Hard Limit  Units\nMax address space   8000   unlimited   bytes\n";
        assert_eq!(limit_bytes(limits), Some(8000));
        assert_eq!(
            limit_bytes("Max address space         unlimited            unlimited            bytes\n"),
            None
        );
        assert!(available().is_some_and(|bytes| bytes > 1_000_000));
    }

    #[test]
    fn the_smallest_of_all_groups_above_counts_and_cached_files_give_way() {
        let root = tempfile::tempdir().unwrap();
        let inner = root.path().join("a/b");
        std::fs::create_dir_all(&inner).unwrap();
        let write = |folder: &Path, name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
        write(&inner, "memory.max", "max\n");
        write(&inner, "memory.current", "5\n");
        assert_eq!(group_bytes(root.path(), "/a/b", "memory.max", "memory.current"), None);
        let outer = root.path().join("a");
        write(&outer, "memory.max", "1000\n");
        write(&outer, "memory.current", "700\n");
        assert_eq!(group_bytes(root.path(), "/a/b", "memory.max", "memory.current"), Some(300));
        write(&outer, "memory.stat", "anon 1\ninactive_file 200\n");
        assert_eq!(group_bytes(root.path(), "/a/b", "memory.max", "memory.current"), Some(500));
        assert_eq!(group_bytes(root.path(), "/", "memory.max", "memory.current"), None);
    }

    #[test]
    fn both_numbers_are_told() {
        let error =
            too_large(Path::new("a.ply"), "150000000 points", 8_400_000_000, 7_912_000_000).to_string();
        assert!(
            error.contains("a.ply: 150000000 points need at least 8.4 GB of memory, 7.9 GB are available"),
            "{error}"
        );
        assert!(check(Path::new("a.ply"), "points", u64::MAX).is_err());
    }
}
