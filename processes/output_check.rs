//! Checks output paths before any work is done.

use anyhow::{Result, bail};
use std::path::Path;

/// Refuses outputs that cannot be written, that overwrite an input, or that are named twice. `made` is a folder that the
/// command will create.
///
/// # Errors
/// The first such output, with its option.
pub fn check_outputs(outputs: &[(&str, Option<&Path>)], inputs: &[&Path], made: Option<&Path>) -> Result<()> {
    let real = |path: &Path| path.canonicalize().or_else(|_| std::path::absolute(path));
    for (index, (flag, path)) in outputs.iter().enumerate() {
        let Some(path) = path else { continue };
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let absent = |folder: &&Path| !folder.is_dir() && made.is_none_or(|made| !folder.starts_with(made));
        if let Some(folder) = folder.filter(absent) {
            bail!(
                "{flag} {}: the folder {} does not exist; create it first",
                path.display(),
                folder.display()
            );
        }
        if path.is_dir() {
            bail!("{flag} {}: is a folder; name a file", path.display());
        }
        // Devices may be named several times.
        if path.exists() && !path.is_file() {
            continue;
        }
        let here = real(path)?;
        for input in inputs {
            if real(input)? == here {
                bail!("{flag} {}: would overwrite an input; name another file", path.display());
            }
        }
        for (other, same) in outputs[..index].iter().filter_map(|(other, path)| Some((other, (*path)?))) {
            if real(same)? == here {
                bail!("{flag} {}: is also the file of {other}; name two files", path.display());
            }
        }
    }
    Ok(())
}
