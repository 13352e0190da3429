//! Fields of the Q-DAS ASCII transfer format (AQDEF): ASCII, as long as AQDEF allows, lines end in CR LF.

use super::acceptance::words::{one_line, plain};
use std::fmt::Write as _;

/// Longest number or short text that AQDEF allows.
pub const NUMBER: usize = 20;

/// Longest number of a part.
pub const PART: usize = 40;

/// Longest name of a part or characteristic.
pub const NAME: usize = 80;

/// Longest remark that AQDEF allows.
pub const REMARK: usize = 255;

/// A value of characteristic i with the attribute 0 (valid).
pub fn value(text: &mut String, i: usize, value: f64) {
    let _ = write!(text, "K0001/{i} {value}\r\nK0002/{i} 0\r\n");
}

/// A field with its key, cut to the longest text; nothing for an empty value.
pub fn field(text: &mut String, key: &str, value: &str, longest: usize) {
    // Every byte of the value is ASCII then, so that cutting cannot split a sign.
    let value: String = plain(&one_line(value)).chars().take(longest).collect();
    let value = value.trim();
    if !value.is_empty() {
        let _ = write!(text, "{key} {value}\r\n");
    }
}

/// Lower and upper limit of characteristic i (K2110, K2111) and whether each exists (K2120, K2121: 0 none, 1 limit).
pub fn limits(text: &mut String, i: usize, lower: Option<f64>, upper: Option<f64>) {
    for (limit, key, kind) in [(lower, "K2110", "K2120"), (upper, "K2111", "K2121")] {
        if let Some(limit) = limit {
            field(text, &format!("{key}/{i}"), &plain_number(limit), NUMBER);
        }
        field(text, &format!("{kind}/{i}"), if limit.is_some() { "1" } else { "0" }, NUMBER);
    }
}

/// A number without the digits that a sum of binary numbers leaves behind its ninth decimal.
pub fn plain_number(value: f64) -> String {
    let text = format!("{value:.9}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// `2026-01-31T08:00:00Z` as `31.01.2026/08:00:00`; nothing for other texts.
pub fn date(iso: &str) -> Option<String> {
    let (day, time) = iso.split_once('T')?;
    let mut parts = day.split('-');
    let (year, month, day) = (parts.next()?, parts.next()?, parts.next()?);
    let time = time.get(..8)?;
    Some(format!("{day}.{month}.{year}/{time}"))
}
