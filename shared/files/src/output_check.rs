//! Checks output paths before any work is done.

use crate::error::FileError;
use crate::guard;
use crate::recording::{FRAMES_FOLDER, RECORDING_FILE};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// An output that would fail at the end, or destroy something.
#[derive(Debug, Error)]
pub enum OutputError {
    /// With its option, and what to do instead.
    #[error("{0}")]
    Refused(String),
    /// A path without meaning.
    #[error(transparent)]
    Io(#[from] std::io::Error),
    /// An output that the guard refuses, with its option.
    #[error("{flag}")]
    Guarded {
        /// Name of the option, such as `--out`.
        flag: String,
        /// The reason of the refusal.
        #[source]
        source: Box<FileError>,
    },
}

/// The folder with the frames of a recording that is an input, where a place lies within it: each file there is taken for a frame.
fn frames_around(place: &Path, inputs: &[&Path]) -> Option<PathBuf> {
    let recordings =
        inputs.iter().filter(|input| input.file_name().is_some_and(|name| name == RECORDING_FILE));
    let mut frames = recordings.filter_map(|file| file.parent()?.join(FRAMES_FOLDER).canonicalize().ok());
    // Of a place that is not there yet the nearest folder that is.
    let real = place.ancestors().find_map(|folder| folder.canonicalize().ok())?;
    frames.find(|frames| real.starts_with(frames))
}

/// Refuses a folder of outputs among the frames of a recording; see [`check_outputs`] for files.
///
/// # Errors
/// It lies there.
pub fn check_folder(flag: &str, folder: &Path, inputs: &[&Path]) -> Result<(), OutputError> {
    let Some(frames) = frames_around(&std::path::absolute(folder)?, inputs) else { return Ok(()) };
    Err(OutputError::Refused(format!(
        "{flag} {}: would lie among the frames of a recording, {}; name a place outside",
        folder.display(),
        frames.display()
    )))
}

/// Refuses outputs that cannot be written, that overwrite an input, or that are named twice. `made` is a folder that the
/// command will create.
///
/// # Errors
/// The first such output, with its option.
pub fn check_outputs(
    outputs: &[(&str, Option<&Path>)],
    inputs: &[&Path],
    made: Option<&Path>,
) -> Result<(), OutputError> {
    let refused = |flag: &str, path: &Path, why: &str| {
        Err(OutputError::Refused(format!("{flag} {}: {why}", path.display())))
    };
    let real = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path));
    for (index, (flag, path)) in outputs.iter().enumerate() {
        let Some(path) = path else { continue };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let absent = |folder: &&Path| !folder.is_dir() && made.is_none_or(|made| !folder.starts_with(made));
        if let Some(folder) = folder.filter(absent) {
            let why = format!("the folder {} does not exist; create it first", folder.display());
            return refused(flag, path, &why);
        }
        if path.is_dir() {
            return refused(flag, path, "is a folder; name a file");
        }
        // Devices may be named several times.
        if path.exists() && !path.is_file() {
            continue;
        }
        let here = real(path)?;
        if let Some(frames) = frames_around(&here, inputs) {
            let why = format!(
                "would lie among the frames of a recording, {}; name a place outside",
                frames.display()
            );
            return refused(flag, path, &why);
        }
        for input in inputs {
            if real(input)? == here || guard::same_file(input, path) {
                return refused(flag, path, "would overwrite an input; name another file");
            }
        }
        for (other, same) in outputs[..index].iter().filter_map(|(other, path)| Some((other, (*path)?))) {
            if real(same)? == here || guard::same_file(same, path) {
                return refused(flag, path, &format!("is also the file of {other}; name two files"));
            }
        }
        guard::announce(flag, path)
            .map_err(|source| OutputError::Guarded { flag: (*flag).to_owned(), source: Box::new(source) })?;
    }
    Ok(())
}
