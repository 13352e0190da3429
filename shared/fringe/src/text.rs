//! Rules for names that several crates share.

/// Longest name of a cell, bytes: it becomes part of the paths of sockets, which the system limits to 107 bytes.
const CELL_NAME_BYTES: usize = 32;

/// What [`is_cell_name`] asks for.
pub const CELL_NAME: &str =
    "a cell name has 1 to 32 of the characters a-z, 0-9, '-' and '_' and begins with a letter or digit";

/// Whether a cell may have this name, wherever it is given: configuration, command line, shared memory.
pub fn is_cell_name(name: &str) -> bool {
    let letters = name.bytes().all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_'));
    letters && name.len() <= CELL_NAME_BYTES && name.bytes().next().is_some_and(|b| b.is_ascii_alphanumeric())
}
