//! Rules for names that several crates share.

/// Longest name of a cell, bytes: it becomes part of the paths of sockets, which the system limits to 107 bytes.
const CELL_NAME_BYTES: usize = 32;

/// What [`is_cell_name`] asks for.
pub const CELL_NAME: &str =
    "a cell name has 1 to 32 of the characters a-z, 0-9, '-' and '_' and begins with a letter or digit";

/// Whether a name shows as it is: no control characters, and none that are invisible or turn the direction of writing (Unicode
/// TR36, 2.5 and 2.6).
pub fn is_printable(name: &str) -> bool {
    let hidden = |c: char| matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}');
    !name.contains(|c: char| c.is_control() || hidden(c))
}

/// Whether a cell may have this name, wherever it is given: configuration, command line, shared memory.
pub fn is_cell_name(name: &str) -> bool {
    let letters = name.bytes().all(|b| matches!(b, b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_'));
    letters && name.len() <= CELL_NAME_BYTES && name.bytes().next().is_some_and(|b| b.is_ascii_alphanumeric())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_hide_something_are_not_printable() {
        for bad in ["a\u{202e}cba", "a\u{200b}b", "\u{1b}[31m", "a\nb", "a\0", "\u{feff}a"] {
            assert!(!is_printable(bad), "{bad:?}");
        }
        for good in ["", "part 7", "Gehäuse №4", "部品", "a–b"] {
            assert!(is_printable(good), "{good:?}");
        }
    }
}
