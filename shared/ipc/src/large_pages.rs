//! Large pages for the buffers of a stage.
//!
//! A frame is some hundred pages of 4 kB, a phase map some thousand. Each has an entry of its own in the tables that the processor looks an
//! address up in, and on a virtual machine whose host watches which memory is idle, the first use after a pause costs some microseconds a
//! page. With pages of 2 MB both are five hundred times fewer.
#![allow(unsafe_code)]

use std::io;
use std::ops::Range;
use std::time::{Duration, Instant};

/// `MADV_COLLAPSE` of `linux/mman.h`: the kernel puts the pages together before the call returns.
const COLLAPSE: libc::c_int = 25;

/// Bytes of the smallest page of any kernel.
const SMALL: usize = 4096;

/// Bytes that one call joins. Each call waits for all processors, and only between two of them is the time looked at.
const AT_ONCE: usize = 64 << 20;

/// Where the kernel says whether it makes large pages, and of which size.
const SETTINGS: &str = "/sys/kernel/mm/transparent_hugepage";

/// Puts the shared memory that this process writes, of the mappings whose path begins with `prefix`, and its heap on large pages as far as
/// the kernel has some. Contents stay as they are. The heap grows by `room` bytes first, which later allocations get, see
/// [`crate::os::keep_freed_memory`]. What is not joined after `most`, as on a busy computer, stays as it is. Returns the bytes that lie on large pages
/// now; 0 before Linux 6.1, and where the system is set to make none.
///
/// # Errors
/// /proc cannot be read.
pub fn use_large_pages(prefix: &str, room: usize, most: Duration) -> io::Result<u64> {
    let begin = Instant::now();
    let in_time = || begin.elapsed() < most;
    let Some(size) = large_page() else { return Ok(0) };
    drop(std::hint::black_box(vec![0_u8; room]));
    let mut bytes = 0;
    for line in std::fs::read_to_string("/proc/self/maps")?.lines() {
        bytes += match Memory::parse(line, prefix) {
            Some(Memory::Shared(range)) => collapse_shared(&range, size, &in_time),
            Some(Memory::Heap(range)) => {
                collapse(range.start.next_multiple_of(size)..range.end, size, &in_time)
            }
            None => 0,
        };
    }
    Ok(bytes)
}

/// Bytes of a large page; `None` where there are none.
fn large_page() -> Option<usize> {
    let read = |name: &str| std::fs::read_to_string(format!("{SETTINGS}/{name}")).ok();
    if read("enabled")?.contains("[never]") {
        return None;
    }
    read("hpage_pmd_size")?.trim().parse().ok().filter(|size: &usize| size.is_power_of_two())
}

/// Memory that is put on large pages, by its addresses.
#[derive(Debug, PartialEq, Eq)]
enum Memory {
    /// Shared, from the beginning of its file.
    Shared(Range<usize>),
    Heap(Range<usize>),
}

impl Memory {
    /// A line of /proc/self/maps, `7f00-7f80 rw-s 00000000 00:1a 5 /dev/shm/name`; `None` for memory that stays as it is.
    fn parse(line: &str, prefix: &str) -> Option<Self> {
        let (range, rest) = line.split_once(' ')?;
        let (start, end) = range.split_once('-')?;
        let range = usize::from_str_radix(start, 16).ok()?..usize::from_str_radix(end, 16).ok()?;
        let (access, rest) = rest.split_once(' ')?;
        let from_begin = rest.starts_with("00000000 ");
        let is_named = rest.find('/').is_some_and(|name| rest[name..].starts_with(prefix));
        match access {
            "rw-s" if from_begin && is_named => Some(Self::Shared(range)),
            "rw-p" if rest.ends_with("[heap]") => Some(Self::Heap(range)),
            _ => None,
        }
    }
}

/// Puts the whole large pages of shared memory together. The kernel does that only where address and place in the file are alike in large pages,
/// so a second mapping that lies so stands in for the first one.
fn collapse_shared(range: &Range<usize>, size: usize, in_time: &dyn Fn() -> bool) -> u64 {
    let length = range.len() / size * size;
    if length == 0 {
        return 0;
    }
    let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_NORESERVE;
    // SAFETY: a new mapping at a place of the kernel's choice touches no memory of ours.
    let room = unsafe { libc::mmap(std::ptr::null_mut(), length + size, libc::PROT_NONE, flags, -1, 0) };
    if room == libc::MAP_FAILED {
        return 0;
    }
    let aligned = (room as usize).next_multiple_of(size);
    let flags = libc::MREMAP_MAYMOVE | libc::MREMAP_FIXED;
    // SAFETY: an old size of 0 maps the same shared pages once more and leaves the old mapping; the new place lies within `room`, which nobody
    // else knows. If another thread unmaps the old one first, the call fails.
    let second = unsafe {
        libc::mremap(range.start as *mut libc::c_void, 0, length, flags, aligned as *mut libc::c_void)
    };
    let bytes =
        if second == libc::MAP_FAILED { 0 } else { collapse(aligned..aligned + length, size, in_time) };
    // SAFETY: `room` and what was mapped into it belong to this function.
    unsafe { libc::munmap(room, length + size) };
    bytes
}

/// Puts the whole large pages of a range, which begins at such a page, together while there is time. Returns their bytes; what the kernel has no page
/// for stays as it is.
fn collapse(range: Range<usize>, size: usize, in_time: &dyn Fn() -> bool) -> u64 {
    // SAFETY: the ranges lie within a mapping of this process, and neither call changes a byte of it.
    let advise =
        |at: usize, length, advice| unsafe { libc::madvise(at as *mut libc::c_void, length, advice) == 0 };
    let end = range.start + range.len() / size * size;
    let (mut bytes, at_once) = (0, AT_ONCE.next_multiple_of(size));
    for start in (range.start..end).step_by(at_once) {
        let part = start..end.min(start + at_once);
        // Of a page that nobody has touched there is nothing to put together. Where there is no memory for it, this fails.
        let touched = in_time()
            && part.clone().step_by(size).all(|page| advise(page, SMALL, libc::MADV_POPULATE_WRITE));
        if !(touched && advise(start, part.len(), COLLAPSE)) {
            break;
        }
        bytes += part.len() as u64;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};

    #[test]
    fn shared_memory_that_is_written_and_the_heap_are_taken() {
        let parse = |line| Memory::parse(line, "/dev/shm/fc-a");
        let shared = |range| Some(Memory::Shared(range));
        assert_eq!(parse("7f00-7f80 rw-s 00000000 00:1a 5    /dev/shm/fc-a b.data"), shared(0x7f00..0x7f80));
        assert_eq!(parse("55-66 rw-p 00000000 00:00 0          [heap]"), Some(Memory::Heap(0x55..0x66)));
        for other in [
            "7f00-7f80 r--s 00000000 00:1a 5 /dev/shm/fc-a b.data",
            "7f00-7f80 rw-s 00001000 00:1a 5 /dev/shm/fc-a b.data",
            "7f00-7f80 rw-s 00000000 00:1a 5 /dev/shm/fc-b",
            "7f00-7f80 rw-p 00000000 00:00 0",
            "7f00-7f80",
            "",
        ] {
            assert_eq!(parse(other), None, "{other}");
        }
    }

    /// Memory that is mapped at a place that no large page may have, as that of other libraries is.
    #[test]
    fn contents_stay_and_other_mappings_see_them() {
        let length = (5 << 20) + 4096;
        let name = format!("/dev/shm/fringecell-large-pages-{}", std::process::id());
        let mut file = std::fs::File::options().read(true).write(true).create_new(true).open(&name).unwrap();
        let bytes: Vec<u8> = (0..length).map(|i: usize| (i * i / 4096 + i) as u8).collect();
        file.write_all(&bytes).unwrap();
        let access = libc::PROT_READ | libc::PROT_WRITE;
        let descriptor = std::os::fd::AsRawFd::as_raw_fd(&file);
        // SAFETY: a new mapping of a file that is as long, at a place of the kernel's choice.
        let mapped =
            unsafe { libc::mmap(std::ptr::null_mut(), length, access, libc::MAP_SHARED, descriptor, 0) };
        assert_ne!(mapped, libc::MAP_FAILED);
        // SAFETY: the mapping is that long, lives until the end of the test, and nothing else refers to it.
        let seen = unsafe { std::slice::from_raw_parts_mut(mapped.cast::<u8>(), length) };
        assert_eq!(use_large_pages(&name, 0, Duration::ZERO).unwrap(), 0, "joined without any time for it");
        use_large_pages(&name, 1 << 20, Duration::from_secs(60)).unwrap();
        assert!(seen == bytes.as_slice(), "the contents changed");
        // The whole large pages of the mapping and no more, unless the system has none to give.
        let size = large_page().unwrap_or(2 << 20);
        let start = mapped as usize;
        let shared = collapse_shared(&(start..start + length), size, &|| true);
        assert!([0, (length / size * size) as u64].contains(&shared), "{shared} bytes on pages of {size}");
        assert!(seen == bytes.as_slice(), "the contents changed the second time");
        seen[3 << 20] ^= 255;
        let mut read = Vec::new();
        std::fs::File::open(&name).unwrap().read_to_end(&mut read).unwrap();
        std::fs::remove_file(&name).unwrap();
        assert!(read == seen && read != bytes, "another mapping sees something else");
    }
}
