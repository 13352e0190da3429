//! Vertices of a PLY file that is text: a line each, with a number for each property. Programs write points that are nowhere as `nan`.

use super::{Vertex, damaged};
use crate::error::{FileError, Problem};
use ply_rs_bw::parser::Reader;
use ply_rs_bw::ply::{ElementDef, PropertyAccess, PropertyType, ScalarType};
use std::io::{BufRead, Read};
use std::path::Path;

/// A longer line is no vertex.
const LINE_LIMIT_BYTES: u64 = 1 << 16;

/// Whether every property of an element is one number.
pub(super) fn is_flat(element: &ElementDef) -> bool {
    element.properties.iter().all(|(_, property)| matches!(property.data_type, PropertyType::Scalar(_)))
}

/// Reads the vertices that the header counts; blank lines are passed over.
///
/// # Errors
/// A line with fewer or more numbers than properties, or with what is none; the end of the file before the last vertex.
pub(super) fn vertices<T: BufRead>(
    path: &Path,
    element: &ElementDef,
    reader: &mut Reader<T>,
) -> Result<Vec<Vertex>, FileError> {
    let mut vertices = Vec::with_capacity(element.count);
    let mut line = String::new();
    while vertices.len() < element.count {
        line.clear();
        let read = reader.get_mut().take(LINE_LIMIT_BYTES).read_line(&mut line);
        if read.map_err(|source| FileError::io(path, "read it as text", source))? == 0 {
            let found = format!("it ends after {} of {} vertices", vertices.len(), element.count);
            return Err(damaged(path, &found));
        }
        if !line.trim().is_empty() {
            let fault = |problem: String| damaged(path, &format!("vertex {}: {problem}", vertices.len() + 1));
            let count = line.split_ascii_whitespace().count();
            if count != element.properties.iter().count() {
                return Err(surplus(path, vertices.len(), count, element));
            }
            vertices.push(vertex(element, &line).map_err(fault)?);
        }
    }
    Ok(vertices)
}

/// The vertex of a line with as many words as there are properties.
fn vertex(element: &ElementDef, line: &str) -> Result<Vertex, String> {
    let mut vertex = Vertex::new();
    for ((name, property), word) in element.properties.iter().zip(line.split_ascii_whitespace()) {
        let none = || format!("\"{word}\" is no number of the property \"{name}\"");
        let PropertyType::Scalar(kind) = &property.data_type else { return Err(none()) };
        let _set = match kind {
            ScalarType::Double => vertex.set_double(name, word.parse().map_err(|_| none())?),
            ScalarType::Float => vertex.set_float(name, word.parse().map_err(|_| none())?),
            ScalarType::UChar => vertex.set_uchar(name, word.parse().map_err(|_| none())?),
            ScalarType::UShort => vertex.set_ushort(name, word.parse().map_err(|_| none())?),
            ScalarType::UInt => vertex.set_uint(name, word.parse().map_err(|_| none())?),
            ScalarType::Char | ScalarType::Short | ScalarType::Int => {
                vertex.set_int(name, word.parse().map_err(|_| none())?)
            }
        };
    }
    Ok(vertex)
}

fn surplus(path: &Path, number: usize, count: usize, element: &ElementDef) -> FileError {
    let properties = element.properties.iter().count();
    let problem = Problem::Disagreement {
        what: "header and body",
        here: format!("the header gives a vertex {properties} properties"),
        there: format!("the line of vertex {} has {count} values", number + 1),
    };
    FileError::new(path, problem, "correct the properties in the header, or write the file again")
}
