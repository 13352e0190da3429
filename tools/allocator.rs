//! Memory that is not there is an error with a message and exit code 2: by default the program would abort (SIGABRT). Large blocks lie on large
//! pages where the system has some: a picture is then some pages instead of some thousand, each of which costs a fault at its first use.
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write as _;

/// The system allocator; ends the program where it has no more memory. Files are complete or absent all the same.
struct Ending;

fn given(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() {
        end(bytes);
    }
    memory
}

/// Bytes of a large page. Where they are others, the advice is as good.
const LARGE: usize = 2 << 20;

/// Asks for large pages for a block that holds some.
fn advised(memory: *mut u8, bytes: usize) -> *mut u8 {
    let start = (memory as usize).next_multiple_of(LARGE);
    let end = (memory as usize + bytes) / LARGE * LARGE;
    if start < end {
        // SAFETY: the range lies within the new block, and the advice changes no byte of it. A system that refuses it goes on as before.
        unsafe { libc::madvise(start as *mut libc::c_void, end - start, libc::MADV_HUGEPAGE) };
    }
    memory
}

/// Says what is missing, without an allocation.
#[cold]
fn end(bytes: usize) -> ! {
    let mut text = [0_u8; 160];
    let mut rest = &mut text[..];
    let room = rest.len();
    // The text is shorter than its place.
    let _ = writeln!(
        rest,
        "error: no memory for {bytes} more bytes; use smaller inputs, fewer threads (RAYON_NUM_THREADS), or more memory"
    );
    let length = room - rest.len();
    // SAFETY: the text is valid for so many bytes, and the process ends.
    unsafe {
        libc::write(libc::STDERR_FILENO, text.as_ptr().cast(), length);
        libc::_exit(cli::BAD_INPUT.into());
    }
}

// SAFETY: every call is passed unchanged to the system allocator, which keeps the contract; null is never returned.
unsafe impl GlobalAlloc for Ending {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract.
        advised(given(unsafe { System.alloc(layout) }, layout.size()), layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract.
        advised(given(unsafe { System.alloc_zeroed(layout) }, layout.size()), layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the caller keeps the contract.
        given(unsafe { System.realloc(memory, layout, size) }, size)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Ending = Ending;
