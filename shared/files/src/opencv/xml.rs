//! FileStorage as XML: `<opencv_storage>` with one element per key.

use super::storage::{RawMatrix, Storage, number};
use crate::error::{FileError, Problem};
use quick_xml::Reader;
use quick_xml::events::Event;

/// Deepest nesting that is followed; calibrations have four levels.
const DEPTH_LIMIT: usize = 64;

/// Reads all top-level numbers and matrices.
pub(super) fn parse(text: &str, storage: &mut Storage) -> Result<(), FileError> {
    let mut reader = Reader::from_str(text);
    let mut path: Vec<String> = Vec::new();
    let mut matrix: Option<RawMatrix> = None;
    let mut plain = String::new();
    loop {
        let at = usize::try_from(reader.buffer_position()).unwrap_or(0);
        let event = reader.read_event().map_err(|error| fault(text, storage, at, error.to_string()))?;
        match event {
            Event::Start(element) => {
                let name = element.name().as_ref().to_owned();
                path.push(name);
                if path.len() > DEPTH_LIMIT {
                    return Err(fault(
                        text,
                        storage,
                        at,
                        format!("is nested deeper than {DEPTH_LIMIT} levels"),
                    ));
                }
                if path.len() == 2 {
                    let is_matrix = element
                        .attributes()
                        .flatten()
                        .any(|a| a.key.as_ref() == "type_id" && a.value.as_ref() == "opencv-matrix");
                    matrix = is_matrix.then(RawMatrix::default);
                    plain.clear();
                }
            }
            Event::Text(content) => match (path.as_slice(), &mut matrix) {
                ([_, _, part], Some(raw)) => raw.fill(part, content.as_ref()),
                ([_, _], None) => plain.push_str(content.as_ref()),
                _ => {}
            },
            Event::End(_) => {
                if let [_, key] = path.as_slice() {
                    close(storage, key, matrix.take(), plain.trim())?;
                }
                path.pop();
            }
            Event::Eof => break,
            _ => {}
        }
    }
    if path.is_empty() {
        Ok(())
    } else {
        Err(fault(text, storage, text.len(), "ends before its root is closed".into()))
    }
}

impl RawMatrix {
    fn fill(&mut self, part: &str, content: &str) {
        match part {
            "rows" => self.rows.push_str(content),
            "cols" => self.columns.push_str(content),
            "dt" => self.kind.push_str(content),
            "data" => self.data.push_str(content),
            _ => {}
        }
    }
}

fn close(storage: &mut Storage, key: &str, matrix: Option<RawMatrix>, plain: &str) -> Result<(), FileError> {
    if let Some(raw) = matrix {
        return storage.insert(key, &raw);
    }
    if let Some(value) = number(plain) {
        storage.numbers.insert(key.to_owned(), value);
    }
    Ok(())
}

fn fault(text: &str, storage: &Storage, at: usize, what: String) -> FileError {
    let mut fault = FileError::new(&storage.path, Problem::Syntax(what), "write the calibration again");
    fault.line = Some(text.as_bytes()[..at.min(text.len())].split(|byte| *byte == b'\n').count());
    fault
}
