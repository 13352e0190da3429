//! Calibration targets, `fringecell-target/1`.

use crate::document::Document;
use crate::error::{FileError, Problem};
use characterise::target::{TARGET_FORMAT, TargetSpec};
use std::path::Path;

/// Reads and checks a target.
///
/// # Errors
/// A file that cannot be read, or as [`parse_target`].
pub fn read_target(path: &Path) -> Result<TargetSpec, FileError> {
    parse_target(&Document::read(path)?)
}

/// Checks a target that was read. The key `format` may be left out.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, numbers out of range.
pub fn parse_target(document: &Document) -> Result<TargetSpec, FileError> {
    let target: TargetSpec = document.parse_bare(TARGET_FORMAT)?;
    target.check().map_err(|error| {
        let key = error.key().to_owned();
        document.fault(&key, Problem::Target(error), "")
    })?;
    Ok(target)
}
