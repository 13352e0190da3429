//! Files of `configs/` by their usual paths, inside and outside the repository.

use anyhow::Result;
use files::bundled::{DEMO, FOR_BENCHMARKS};
use files::config::Config;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A file that can be read until this is dropped.
pub struct Found {
    pub path: PathBuf,
    _copy: Option<TempDir>,
}

/// Finds a file. One of `configs/` that is not there is the copy that is part of the program, with the files that it names.
pub fn find(path: &Path) -> Result<Found> {
    let files = || DEMO.into_iter().chain(FOR_BENCHMARKS);
    let name = path.strip_prefix("configs").ok().and_then(Path::to_str);
    let bundled = name.filter(|name| files().any(|(known, _)| known == *name));
    let (Some(name), false) = (bundled, path.exists()) else {
        return Ok(Found { path: path.to_owned(), _copy: None });
    };
    let folder = tempfile::tempdir()?;
    for (name, text) in files() {
        files::atomic::write(&folder.path().join(name), text.as_bytes())?;
    }
    Ok(Found { path: folder.path().join(name), _copy: Some(folder) })
}

/// Loads a configuration of `configs/`.
pub fn load(path: &str) -> Result<Config> {
    Ok(Config::load(&find(Path::new(path))?.path)?)
}
