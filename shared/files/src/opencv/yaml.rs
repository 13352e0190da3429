//! The subset of YAML that FileStorage writes: keys at the margin, a matrix indented below its key.

use super::storage::{RawMatrix, Storage, number};
use crate::error::FileError;

/// Reads all top-level numbers and matrices.
pub(super) fn parse(text: &str, storage: &mut Storage) -> Result<(), FileError> {
    let mut lines = text.lines().filter(|line| !line.trim_start().starts_with('#')).peekable();
    while let Some(line) = lines.next() {
        let Some((key, value)) = key_value(line) else { continue };
        if !value.starts_with("!!opencv-matrix") {
            if let Some(value) = number(value) {
                storage.numbers.insert(key.to_owned(), value);
            }
            continue;
        }
        let mut raw = RawMatrix::default();
        let mut in_data = false;
        while let Some(line) = lines.next_if(|line| is_inside(line)) {
            match line.trim().split_once(':').filter(|_| !in_data) {
                Some(("rows", value)) => value.trim().clone_into(&mut raw.rows),
                Some(("cols", value)) => value.trim().clone_into(&mut raw.columns),
                Some(("dt", value)) => value.trim().clone_into(&mut raw.kind),
                Some(("data", value)) => {
                    in_data = true;
                    append(&mut raw.data, value);
                }
                _ if in_data => append(&mut raw.data, line),
                _ => {}
            }
        }
        storage.insert(key, &raw)?;
    }
    Ok(())
}

fn append(data: &mut String, line: &str) {
    data.push(' ');
    data.extend(line.chars().filter(|letter| !"[]".contains(*letter)));
}

fn is_inside(line: &str) -> bool {
    line.starts_with([' ', '\t']) || line.trim().is_empty()
}

/// A key at the margin.
fn key_value(line: &str) -> Option<(&str, &str)> {
    if line.starts_with([' ', '\t', '%', '-']) {
        return None;
    }
    let (key, value) = line.split_once(':')?;
    Some((key.trim().trim_matches('"'), value.trim()))
}
