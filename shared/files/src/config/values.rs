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

/// What to do where a driver of projectors is not part of the program.
const USE_NETWORK: &str = "use \"network\" and a program that shows the patterns";

/// The driver of a camera by its name.
pub(super) fn camera_driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    let problem = "\"network\" drives projectors, not cameras";
    driver_except(
        Driver::Network,
        document,
        key,
        name,
        [problem, "use \"genicam\" for a camera on the network"],
    )
}

/// The driver of a projector by its name.
pub(super) fn projector_driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    driver_except(
        Driver::Genicam,
        document,
        key,
        name,
        ["\"genicam\" drives cameras, not projectors", USE_NETWORK],
    )
}

/// A driver by its name; problem and remedy are those of the driver that the device cannot have.
fn driver_except(
    refused: Driver,
    document: &Document,
    key: &str,
    name: &str,
    [problem, remedy]: [&str; 2],
) -> Result<Driver, FileError> {
    let found = driver(document, key, name)?;
    if found == refused {
        return Err(document.fault(key, Problem::Unsupported(problem.into()), remedy));
    }
    Ok(found)
}

/// A driver by its name.
pub(super) fn driver(document: &Document, key: &str, name: &str) -> Result<Driver, FileError> {
    if let Some(driver) = Driver::ALL.into_iter().find(|driver| driver.name() == name) {
        return Ok(driver);
    }
    match name {
        "lightcrafter" | "screen" => {
            let problem = Problem::Unsupported(format!("driver \"{name}\" is not part of this version"));
            Err(document.fault(key, problem, USE_NETWORK))
        }
        _ => Err(unknown(document, key, "driver", name, Driver::ALL.map(Driver::name))),
    }
}
