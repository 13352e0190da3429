//! Texts of reports: a reused buffer, and a limit for the length.

use super::fault::{Fault, cycle_fault};
use ipc::header::MAX_TEXT_BYTES;

/// A buffer for texts, reused without allocation.
#[derive(Debug)]
pub struct TextBuffer(Vec<u8>);

impl TextBuffer {
    /// A buffer with the capacity of the longest text of an event.
    pub fn new() -> Self {
        Self::with_capacity(MAX_TEXT_BYTES)
    }

    /// A buffer for longer texts.
    pub fn with_capacity(bytes: usize) -> Self {
        Self(Vec::with_capacity(bytes.max(MAX_TEXT_BYTES)))
    }

    /// Writes a value as JSON.
    pub fn json<T: serde::Serialize>(&mut self, value: &T) -> Result<&str, Fault> {
        self.0.clear();
        serde_json::to_writer(&mut self.0, value).map_err(|e| cycle_fault(&e))?;
        std::str::from_utf8(&self.0).map_err(|e| cycle_fault(&e))
    }
}

/// Cuts a text at a character boundary.
pub(super) fn shorten(text: &str, limit: usize) -> &str {
    let mut end = text.len().min(limit);
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    &text[..end]
}

#[cfg(test)]
mod tests {
    use super::shorten;

    #[test]
    fn a_long_reason_is_cut_at_a_character() {
        assert_eq!(shorten("abc", 10), "abc");
        assert_eq!(shorten("aµb", 2), "a");
        assert_eq!(shorten("aµb", 3), "aµ");
    }
}
