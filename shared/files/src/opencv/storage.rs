//! Matrices and numbers by key, and their way from text.

use crate::error::{FileError, Problem, did_you_mean, list};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A matrix as written; several channels stand side by side in its columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    /// Number of rows of the matrix.
    pub rows: usize,
    /// Number of columns times number of channels.
    pub columns: usize,
    /// All values, row by row.
    pub data: Vec<f64>,
}

/// Numbers and matrices of a file, by key.
#[derive(Debug, Clone)]
pub struct Storage {
    /// Where they were read from.
    pub path: PathBuf,
    /// All matrices of the file, by key.
    pub matrices: BTreeMap<String, Matrix>,
    /// All single numbers of the file, by key.
    pub numbers: BTreeMap<String, f64>,
}

/// A matrix on its way from the file, before its parts are known to agree.
#[derive(Debug, Default)]
pub(super) struct RawMatrix {
    pub(super) rows: String,
    pub(super) columns: String,
    pub(super) kind: String,
    pub(super) data: String,
}

impl Storage {
    /// Takes what a second file holds.
    ///
    /// # Errors
    /// A key that both hold with different values.
    pub fn add(&mut self, other: Self) -> Result<(), FileError> {
        let differs = |key: &String| {
            self.matrices.get(key).is_some_and(|known| other.matrices.get(key) != Some(known))
                || self.numbers.get(key).is_some_and(|known| other.numbers.get(key) != Some(known))
        };
        if let Some(key) = other.matrices.keys().chain(other.numbers.keys()).find(|key| differs(key)) {
            let problem = Problem::Disagreement {
                what: "values",
                here: format!("\"{key}\" here"),
                there: format!("another one in {}", self.path.display()),
            };
            return Err(
                FileError::new(&other.path, problem, "name files of one calibration").at(key.as_str())
            );
        }
        self.matrices.extend(other.matrices);
        self.numbers.extend(other.numbers);
        Ok(())
    }

    /// A matrix by key.
    ///
    /// # Errors
    /// No such matrix; the message lists those that there are.
    pub fn matrix(&self, key: &str) -> Result<&Matrix, FileError> {
        self.matrices.get(key).ok_or_else(|| {
            let known = || self.matrices.keys().map(String::as_str);
            let problem = Problem::UnknownName { kind: "matrix", name: key.to_owned(), known: list(known()) };
            FileError::new(&self.path, problem, did_you_mean(key, known(), "name one of those"))
        })
    }

    /// A matrix of known size, row by row.
    ///
    /// # Errors
    /// As [`Self::matrix`], another size, or a number that is not finite.
    pub fn fixed<const R: usize, const C: usize>(&self, key: &str) -> Result<[[f64; C]; R], FileError> {
        let matrix = self.matrix(key)?;
        if (matrix.rows, matrix.columns) != (R, C) {
            let problem = Problem::Disagreement {
                what: "sizes",
                here: format!("the matrix has {} × {} numbers", matrix.rows, matrix.columns),
                there: format!("{R} × {C} are needed"),
            };
            return Err(FileError::new(&self.path, problem, "name another matrix").at(key));
        }
        self.finite(key, matrix)?;
        Ok(std::array::from_fn(|r| std::array::from_fn(|c| matrix.data[r * C + c])))
    }

    pub(super) fn finite(&self, key: &str, matrix: &Matrix) -> Result<(), FileError> {
        match matrix.data.iter().find(|value| !value.is_finite()) {
            None => Ok(()),
            Some(value) => {
                let problem =
                    Problem::Value { value: value.to_string(), limit: "finite numbers are needed".into() };
                Err(FileError::new(&self.path, problem, "did the calibration succeed?").at(key))
            }
        }
    }

    pub(super) fn insert(&mut self, key: &str, raw: &RawMatrix) -> Result<(), FileError> {
        let fault = |what: String| {
            FileError::new(&self.path, Problem::Syntax(what), "write the calibration again").at(key)
        };
        let size = |name: &str, text: &str| {
            text.trim().parse::<usize>().map_err(|_| fault(format!("{name} \"{}\" is no count", text.trim())))
        };
        let rows = size("rows", &raw.rows)?;
        let columns = size("cols", &raw.columns)?;
        let kind = raw.kind.trim().trim_matches('"');
        let channels = kind.trim_end_matches(|c: char| c.is_ascii_alphabetic());
        let channels = if channels.is_empty() { 1 } else { size("channels of dt", channels)? };
        let data = raw
            .data
            .split([',', ' ', '\t', '\r', '\n'])
            .filter(|word| !word.is_empty())
            .map(|word| number(word).ok_or_else(|| fault(format!("\"{word}\" is no number"))))
            .collect::<Result<Vec<f64>, _>>()?;
        let expected = rows.checked_mul(columns).and_then(|n| n.checked_mul(channels));
        if expected != Some(data.len()) {
            let size = if channels == 1 {
                format!("{rows} rows × {columns} cols")
            } else {
                format!("{rows} rows × {columns} cols × {channels} channels")
            };
            return Err(fault(format!("data has {} numbers, but the matrix has {size}", data.len())));
        }
        self.matrices.insert(key.to_owned(), Matrix { rows, columns: columns * channels, data });
        Ok(())
    }
}

/// A number as FileStorage writes it: `1.`, `.5`, `2.5e+03`, `.Nan`, `-.Inf`.
pub(super) fn number(word: &str) -> Option<f64> {
    match word {
        ".Nan" | ".NaN" | ".nan" => Some(f64::NAN),
        ".Inf" | "+.Inf" | ".inf" => Some(f64::INFINITY),
        "-.Inf" | "-.inf" => Some(f64::NEG_INFINITY),
        _ if word.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) => word.parse().ok(),
        _ => None,
    }
}
