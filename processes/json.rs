//! Machine-readable results of the commands.

use crate::software::FRINGECELL;
use anyhow::Result;
use files::provenance::{Provenance, WithProvenance};
use files::result::write_json;
use serde::Serialize;
use std::path::Path;

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
