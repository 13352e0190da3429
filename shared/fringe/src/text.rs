//! Rules for texts that several crates share: names of cells, messages on one line.

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

/// Line number, the line, and the message.
pub fn on_one_line(error: &toml::de::Error, text: &str) -> String {
    let start = error.span().map_or(0, |span| span.start);
    let number = text.get(..start).unwrap_or_default().matches('\n').count();
    let line: String = text.lines().nth(number).unwrap_or_default().trim().chars().take(60).collect();
    let message: Vec<&str> = error.message().split_whitespace().collect();
    format!("line {} ({line}): {}", number + 1, message.join(" "))
}
