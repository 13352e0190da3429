//! What the command lines of `fringecell` and `fringetool` share: the options that every command takes, where text and JSON
//! go, exit codes, completions and man pages.

mod arguments;
pub mod generate;
pub mod output;

pub use arguments::{Color, Global, parse};
pub use output::{error, exit_code, is_quiet, is_verbose, json, note, text};

use std::path::Path;

/// Whether a file name means standard output.
pub fn is_stdout(file: &Path) -> bool {
    file == Path::new("-")
}

/// Exit code of a measurement or test that fails its limit.
pub const LIMIT_FAILED: u8 = 1;

/// Exit code of invalid input, of an error of the machine, and of output that was lost.
pub const BAD_INPUT: u8 = 2;
