//! Texts of reports: written into memory that stays, and never longer than a message.

use super::fault::{Fault, lost};
use ipc::header::MAX_TEXT_BYTES;

/// A text that is written again and again into the same memory.
#[derive(Debug)]
pub struct Text(Vec<u8>);

impl Text {
    /// Room for the longest text of an event.
    pub fn new() -> Self {
        Self(Vec::with_capacity(MAX_TEXT_BYTES))
    }

    /// A value as JSON.
    pub fn json<T: serde::Serialize>(&mut self, value: &T) -> Result<&str, Fault> {
        self.0.clear();
        serde_json::to_writer(&mut self.0, value).map_err(|e| lost(&e))?;
        std::str::from_utf8(&self.0).map_err(|e| lost(&e))
    }
}

/// Cuts a text at a character.
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
