//! Single values that several tables share.

use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::rig_file::unknown;
use cell::configuration::Driver;
use std::path::{Path, PathBuf};

/// A value out of its limits.
pub(super) fn value(found: impl std::fmt::Display, limit: impl Into<String>) -> Problem {
    Problem::Value { value: found.to_string(), limit: limit.into() }
}

/// Reads a file that the document names, relative to it.
pub(super) fn referenced<T>(
    document: &Document,
    key: &str,
    target: &str,
    read: impl Fn(&Path) -> Result<T, FileError>,
) -> Result<T, FileError> {
    let path = resolve(document, key, target)?;
    if !path.exists() {
        let problem = Problem::Missing(format!("the file {}", path.display()));
        return Err(document.fault(key, problem, "paths are relative to the file that names them"));
    }
    read(&path)
}

fn resolve(document: &Document, key: &str, target: &str) -> Result<PathBuf, FileError> {
    let folder = document.path.parent().unwrap_or(Path::new(""));
    std::path::absolute(folder.join(target)).map_err(|source| {
        let problem = Problem::Io { action: "resolve the path", source };
        document.fault(key, problem, "")
    })
}

/// The driver of a camera by its name.
pub(super) fn camera_driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    let found = driver(document, key, name)?;
    if found.is_light() {
        let problem = Problem::Unsupported(format!("\"{name}\" drives projectors, not cameras"));
        return Err(document.fault(key, problem, "use \"genicam\" for a camera on the network"));
    }
    Ok(found)
}

/// The driver of a projector by its name.
pub(super) fn projector_driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    let found = driver(document, key, name)?;
    if found == Driver::Genicam {
        let problem = Problem::Unsupported("\"genicam\" drives cameras, not projectors".into());
        let remedy = "use \"screen\", \"lightcrafter\", or \"network\" and a program that shows the patterns";
        return Err(document.fault(key, problem, remedy));
    }
    Ok(found)
}

/// A driver by its name.
pub(super) fn driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    let found = Driver::ALL.into_iter().find(|driver| driver.name() == name);
    found.ok_or_else(|| unknown(document, key, "driver", name, Driver::ALL.map(Driver::name)))
}
