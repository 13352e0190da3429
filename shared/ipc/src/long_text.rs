//! Texts that are longer than a message: sent in parts, joined again.

use crate::error::MessageError;
use crate::header::Event;

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

/// Which report a part belongs to: those of a process that died in the middle must not begin the next one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextKey {
    /// Process that sends it.
    pub pid: u32,
    /// Cycle that it reports on, as in messages.
    pub cycle: u64,
    /// Activation of the schedule that it reports on.
    pub activation: u32,
}

impl TextKey {
    /// The key of the report that this event is a part of.
    pub fn of(event: &Event) -> Self {
        Self { pid: event.pid, cycle: event.cycle, activation: event.activation }
    }
}

/// Joins the parts of a text. Parts of an earlier text that has no end are forgotten.
#[derive(Debug, Default)]
pub struct Joined {
    key: Option<TextKey>,
    text: String,
}

impl Joined {
    /// Adds a part that is not the last one.
    ///
    /// # Errors
    /// [`MessageError::Count`] for a text longer than [`MAX_JOINED_BYTES`].
    pub fn push(&mut self, key: TextKey, part: &str) -> Result<(), MessageError> {
        self.select(key);
        let used = self.text.len() + part.len();
        if used > MAX_JOINED_BYTES {
            self.text.clear();
            return Err(MessageError::Count { used: used as u64, capacity: MAX_JOINED_BYTES as u64 });
        }
        self.text.push_str(part);
        Ok(())
    }

    /// The whole text with its last part; the next one begins anew.
    pub fn take(&mut self, key: TextKey, last: &str) -> String {
        self.select(key);
        self.key = None;
        let mut text = std::mem::take(&mut self.text);
        text.push_str(last);
        text
    }

    fn select(&mut self, key: TextKey) {
        if self.key != Some(key) {
            self.key = Some(key);
            self.text.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: TextKey = TextKey { pid: 4, cycle: 7, activation: 2 };

    #[test]
    fn a_report_that_was_broken_off_does_not_begin_the_next_one() {
        let others =
            [TextKey { pid: 5, ..KEY }, TextKey { cycle: 8, ..KEY }, TextKey { activation: 3, ..KEY }];
        for next in others {
            let mut joined = Joined::default();
            joined.push(KEY, "{\"half\":").unwrap();
            assert_eq!(joined.take(next, "{}"), "{}");
            joined.push(KEY, "{\"half\":").unwrap();
            joined.push(next, "{\"a\":").unwrap();
            assert_eq!(joined.take(next, "1}"), "{\"a\":1}");
        }
    }

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
                    joined.push(KEY, part).unwrap();
                }
                assert_eq!(joined.take(KEY, last), text);
                assert_eq!(joined.take(KEY, ""), "", "a text that was taken leaves nothing");
            }
        }
    }

    #[test]
    fn a_text_without_end_is_refused() {
        let part = "x".repeat(1 << 20);
        let mut joined = Joined::default();
        for _ in 0..64 {
            joined.push(KEY, &part).unwrap();
        }
        assert!(matches!(joined.push(KEY, "x"), Err(MessageError::Count { .. })));
    }
}
