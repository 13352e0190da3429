//! Where text and JSON go. No other place of the programs writes to standard output or standard error.
//!
//! Standard output has either text for people or one JSON document, never both: with `--json -` the text goes to standard
//! error. `--quiet` silences all but errors. Output that is lost, because the device is full or nobody reads it, stops no work:
//! it becomes an error with its reason when the program ends.

use crate::BAD_INPUT;
use serde::Serialize;
use std::fmt::{Arguments, Display};
use std::io::{self, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// What the command line states about the output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Settings {
    /// Whether only errors are printed.
    pub quiet: bool,
    /// Whether each step is printed as well.
    pub verbose: bool,
    /// Standard output has a JSON document and nothing else.
    pub json_on_stdout: bool,
}

static SETTINGS: OnceLock<Settings> = OnceLock::new();
static COLOR: AtomicBool = AtomicBool::new(false);

/// The first error of standard output.
static LOST: OnceLock<io::Error> = OnceLock::new();

/// Whether there is no standard output.
static ABSENT: AtomicBool = AtomicBool::new(false);

/// When the program began.
static BEGIN: OnceLock<Instant> = OnceLock::new();

pub(crate) fn set(settings: Settings, version: &str) {
    // The command line is parsed once.
    let _ = SETTINGS.set(settings);
    let _ = BEGIN.set(Instant::now());
    if settings.verbose {
        note(format_args!("{version}\n"));
    }
}

pub(crate) fn set_color(color: bool) {
    COLOR.store(color, Ordering::Relaxed);
}

fn settings() -> Settings {
    SETTINGS.get().copied().unwrap_or_default()
}

/// States that the program was started without standard output: what it prints there is lost, which is an error.
pub fn without_stdout() {
    ABSENT.store(true, Ordering::Relaxed);
}

/// What a write to standard output would fail with, where there is none.
pub(crate) fn is_there() -> io::Result<()> {
    let absent = ABSENT.load(Ordering::Relaxed);
    if absent { Err(io::Error::other("it is closed")) } else { Ok(()) }
}

/// Whether `--quiet` was given.
pub fn is_quiet() -> bool {
    settings().quiet
}

/// Whether `--verbose` was given.
pub fn is_verbose() -> bool {
    settings().verbose
}

/// Whether standard error has colours.
pub fn has_color() -> bool {
    COLOR.load(Ordering::Relaxed)
}

/// Prints a result as text for people. Returns whether it was written: the reader may be gone.
pub fn text(text: Arguments) -> bool {
    let settings = settings();
    if settings.quiet {
        return true;
    }
    if settings.json_on_stdout {
        note(text);
        return true;
    }
    to_stdout(|out| out.write_fmt(text))
}

/// Prints a note or warning, if standard error is there.
pub fn note(text: Arguments) {
    if !settings().quiet {
        let _ = Stderr.write_fmt(text);
    }
}

/// Prints an error, if standard error is there.
pub fn error(error: impl Display) {
    let prefix = if has_color() { "\x1b[1;31merror:\x1b[0m" } else { "error:" };
    let _ = writeln!(Stderr, "{prefix} {}", printable(&error.to_string()));
}

/// A text with control characters, as the name of a file may hold, in the notation of Rust; ends of lines and tabs stay.
pub fn printable(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_control() && !['\n', '\t'].contains(&c) {
            shown.extend(c.escape_unicode());
        } else {
            shown.push(c);
        }
    }
    shown
}

/// Prints a result as JSON to standard output.
///
/// # Errors
/// A value that JSON cannot hold.
pub fn json<T: Serialize + ?Sized>(value: &T) -> Result<(), serde_json::Error> {
    let text = serde_json::to_string_pretty(value)?;
    to_stdout(|out| writeln!(out, "{text}"));
    Ok(())
}

/// Prints what was asked for itself, such as a completion script.
pub fn raw(bytes: &[u8]) {
    to_stdout(|out| out.write_all(bytes));
}

fn to_stdout(write: impl FnOnce(&mut io::StdoutLock) -> io::Result<()>) -> bool {
    let mut out = io::stdout().lock();
    match is_there().and_then(|()| write(&mut out)).and_then(|()| out.flush()) {
        Ok(()) => true,
        Err(error) => {
            let _ = LOST.set(error);
            false
        }
    }
}

/// Writes the rest of the output.
pub(crate) fn finish(print: impl FnOnce() -> io::Result<()>) -> Option<&'static io::Error> {
    let written = print().and_then(|()| io::stdout().flush());
    if let Err(error) = written {
        let _ = LOST.set(error);
    }
    LOST.get()
}

/// The exit code of a program that would end with `code`: output that was lost is an error, with its reason.
pub(crate) fn code_after(lost: Option<&io::Error>, code: u8) -> u8 {
    let Some(lost) = lost else { return code };
    error(format_args!("standard output: {lost}"));
    BAD_INPUT
}

/// The exit code at the end of a program: of its result, or of its lost output. The one place where an error is printed: the
/// whole chain on one line.
pub fn exit_code(result: anyhow::Result<u8>) -> u8 {
    let code = result.unwrap_or_else(|reason| {
        error(format_args!("{reason:#}"));
        BAD_INPUT
    });
    if is_verbose()
        && let Some(begin) = BEGIN.get()
    {
        let memory = peak_memory_mb().map_or_else(String::new, |mb| format!(", at most {mb} MB of memory"));
        note(format_args!("{:.2} s{memory}\n", begin.elapsed().as_secs_f64()));
    }
    code_after(finish(|| Ok(())), code)
}

/// The most memory that this process had at once, MB.
fn peak_memory_mb() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix(" kB")?.parse().ok()?;
    Some((kib * 1024).div_ceil(1_000_000))
}

/// Standard error that never fails: neither a closed terminal nor a full device ends a program.
#[derive(Debug, Clone, Copy)]
pub struct Stderr;

impl Write for Stderr {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _ = io::stderr().write_all(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        let _ = io::stderr().flush();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_do_not_reach_the_terminal() {
        assert_eq!(printable("a\x1b[31m\u{9b}ä.ply:\n\tb\r"), "a\\u{1b}[31m\\u{9b}ä.ply:\n\tb\\u{d}");
    }

    #[test]
    fn lost_output_is_exit_code_2_whatever_the_command_says() {
        let full = io::Error::from_raw_os_error(28);
        assert_eq!(code_after(None, 1), 1);
        assert_eq!(code_after(Some(&full), 0), 2);
        assert_eq!(code_after(Some(&full), 1), 2);
    }
}
