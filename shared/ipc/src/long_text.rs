//! Texts that are longer than a message: sent in parts, joined again.

use crate::error::MessageError;

/// Longest text that is joined, bytes: the report on a fusion of 256 pairs has some 7 MB.
pub const MAX_JOINED_BYTES: usize = 64 << 20;

/// A text in parts of at most `limit` bytes, cut at characters; at least one part, which is empty for an empty text.
/// `limit` must have room for a character (4 bytes).
pub fn parts(text: &str, limit: usize) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        if text.len() <= limit.max(4) {
            rest = None;
            return Some(text);
        }
        let mut end = limit.max(4);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let (part, more) = text.split_at(end);
        rest = Some(more);
        Some(part)
    })
}

/// Joins the parts of a text.
#[derive(Debug, Default)]
pub struct Joined(String);

impl Joined {
    /// Adds a part that is not the last one.
    ///
    /// # Errors
    /// [`MessageError::Count`] for a text longer than [`MAX_JOINED_BYTES`].
    pub fn push(&mut self, part: &str) -> Result<(), MessageError> {
        let used = self.0.len() + part.len();
        if used > MAX_JOINED_BYTES {
            self.0.clear();
            return Err(MessageError::Count { used: used as u64, capacity: MAX_JOINED_BYTES as u64 });
        }
        self.0.push_str(part);
        Ok(())
    }

    /// The whole text with its last part; the next one begins anew.
    pub fn take(&mut self, last: &str) -> String {
        let mut text = std::mem::take(&mut self.0);
        text.push_str(last);
        text
    }

    /// Forgets what came: the text that it belongs to was broken off.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_short_and_join_to_the_same_text() {
        for text in ["", "a", "abcd", "abcde", "µµµµµµµ", "a€b€c€d€e€", &"0123456789é".repeat(1000)]
        {
            for limit in [4, 5, 7, 64, 100_000] {
                let all: Vec<&str> = parts(text, limit).collect();
                assert!(all.iter().all(|part| part.len() <= limit), "{limit}");
                assert!(all.len() <= 1 || all.iter().all(|part| !part.is_empty()));
                let (last, before) = all.split_last().unwrap();
                let mut joined = Joined::default();
                for part in before {
                    joined.push(part).unwrap();
                }
                assert_eq!(joined.take(last), text);
                assert_eq!(joined.take(""), "", "a text that was taken leaves nothing");
            }
        }
    }

    #[test]
    fn a_text_without_end_is_refused() {
        let part = "x".repeat(1 << 20);
        let mut joined = Joined::default();
        for _ in 0..64 {
            joined.push(&part).unwrap();
        }
        assert!(matches!(joined.push("x"), Err(MessageError::Count { .. })));
    }
}
