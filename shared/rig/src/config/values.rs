//! Single values that several tables share.

use super::Driver;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::rig_file::unknown;

/// A value out of its limits.
pub(super) fn value(found: impl std::fmt::Display, limit: impl Into<String>) -> Problem {
    Problem::Value { value: found.to_string(), limit: limit.into() }
}

/// A driver by its name.
pub(super) fn driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    const KNOWN: [&str; 2] = ["twin", "recording"];
    match name {
        "twin" => Ok(Driver::Twin),
        "recording" => Ok(Driver::Recording),
        "genicam" | "lightcrafter" | "screen" => {
            let problem = Problem::Unsupported(format!("driver \"{name}\" is not part of this version"));
            Err(document.fault(key, problem, "use \"twin\" or \"recording\""))
        }
        _ => Err(unknown(document, key, "driver", name, KNOWN)),
    }
}
