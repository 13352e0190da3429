//! Fields of comma-separated values (RFC 4180).

use crate::acceptance::words::one_line;

/// One field on one line. A spreadsheet would run what begins with `=`, `+`, `-` or `@`: an apostrophe keeps it text.
pub fn field(text: &str) -> String {
    let text = one_line(text);
    let text = if text.starts_with(['=', '+', '-', '@']) { format!("'{text}") } else { text };
    if text.contains([',', '"', ';', '\'']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}
