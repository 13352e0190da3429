//! Machine-readable results of the commands.

use crate::software::FRINGECELL;
use anyhow::Result;
use files::guard;
use files::output_check::check_outputs;
use files::provenance::{Provenance, WithProvenance};
use files::result::write_json;
use serde::Serialize;
use std::path::Path;

/// Refuses a file that cannot be written, or is of another kind than the result will be, before anything is asked of a cell.
///
/// # Errors
/// As [`check_outputs`] and [`guard::may_become`].
pub fn check<T: Serialize>(file: Option<&Path>, example: &T) -> Result<()> {
    check_bare(file, &WithProvenance { result: example, provenance: Provenance::now(&FRINGECELL) })
}

/// The same for a result that has date and software already.
pub fn check_bare<T: Serialize>(file: Option<&Path>, example: &T) -> Result<()> {
    check_outputs(&[("--json", file)], &[], None)?;
    let Some(file) = file.filter(|file| !cli::is_stdout(file)) else { return Ok(()) };
    Ok(guard::may_become(file, &serde_json::to_vec(example)?)?)
}

/// Writes a result as JSON to a file, or to standard output for `-`, with date and software under `provenance`.
pub fn emit<T: Serialize>(file: Option<&Path>, result: &T) -> Result<()> {
    emit_bare(file, &WithProvenance { result, provenance: Provenance::now(&FRINGECELL) })
}

/// The same of a result that has date and software already.
pub fn emit_bare<T: Serialize>(file: Option<&Path>, result: &T) -> Result<()> {
    match file {
        Some(file) if cli::is_stdout(file) => Ok(cli::json(result)?),
        Some(file) => Ok(write_json(file, result)?),
        None => Ok(()),
    }
}
