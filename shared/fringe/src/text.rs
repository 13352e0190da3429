//! The message of a TOML reader on one line.

/// Line number, the line, and the message.
pub fn on_one_line(error: &toml::de::Error, text: &str) -> String {
    let start = error.span().map_or(0, |span| span.start);
    let number = text.get(..start).unwrap_or_default().matches('\n').count();
    let line: String = text.lines().nth(number).unwrap_or_default().trim().chars().take(60).collect();
    let message: Vec<&str> = error.message().split_whitespace().collect();
    format!("line {} ({line}): {}", number + 1, message.join(" "))
}
