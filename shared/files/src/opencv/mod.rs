//! OpenCV's FileStorage: calibrations of other programs, in its YAML or XML.
//!
//! Only what calibrations need is read: numbers and matrices (`opencv-matrix`) at the top level, by key. Everything
//! else in the file is passed over.

mod keys;
mod rig;
mod storage;
mod write;
mod xml;
mod yaml;

pub use keys::{CalibrationNames, rig_of_calibration};
pub(crate) use rig::opencv_from_lens;
pub use rig::{ViewKeys, ViewKind, lens_from_opencv, rig_from_opencv};
pub use storage::{Matrix, Storage};
pub use write::{Language, pair_text};

use crate::document::read_text;
use crate::error::{FileError, Problem};
use std::collections::BTreeMap;
use std::path::Path;

impl Storage {
    /// Reads a FileStorage file; YAML or XML is recognised by its first letters.
    ///
    /// # Errors
    /// Absent, neither YAML nor XML, or a matrix whose numbers are not numbers or not rows × columns many.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = read_text(path)?;
        let mut storage = Self { path: path.to_owned(), matrices: BTreeMap::new(), numbers: BTreeMap::new() };
        if text.trim_start().starts_with('<') {
            xml::parse(&text, &mut storage)?;
        } else if text.trim_start().starts_with("%YAML") {
            yaml::parse(&text, &mut storage)?;
        } else {
            let problem = Problem::Syntax("begins neither with %YAML nor with <".into());
            return Err(FileError::new(path, problem, "name a file that OpenCV's FileStorage wrote"));
        }
        Ok(storage)
    }
}

#[cfg(test)]
mod tests;
