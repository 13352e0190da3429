//! Triangles of a PLY file.

use super::{Skipped, damaged, open, refuse_surplus};
use crate::error::{FileError, Problem};
use nalgebra::Point3;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{PropertyAccess, PropertyAccessResult, PropertyType};
use std::path::Path;

/// The names that the list of a face's corners goes by.
const CORNER_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Reads the faces of a mesh as triangles, mm; polygons become fans. `None` for a file without faces: a point cloud.
///
/// # Errors
/// As [`super::read_cloud`]; a face with fewer than three corners, or with one that is no point of the file.
pub fn read_triangles(path: &Path) -> Result<Option<Vec<[Point3<f64>; 3]>>, FileError> {
    let (header, mut reader) = open(path)?;
    let is_list = |name: &&str| {
        let property = header.elements.get("face")?.properties.get(*name)?;
        matches!(property.data_type, PropertyType::List(..)).then_some(())
    };
    let has_faces = header.elements.get("face").is_some_and(|face| face.count > 0);
    if !has_faces || !CORNER_LISTS.iter().any(|name| is_list(name).is_some()) {
        return Ok(None);
    }
    let (mut corners, mut faces) = (Vec::new(), Vec::new());
    for (name, element) in &header.elements {
        let fault = |error: &dyn std::fmt::Display| damaged(path, error);
        match name.as_str() {
            "vertex" => {
                corners = Parser::<Corner>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| fault(&e))?;
            }
            "face" => {
                faces = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| fault(&e))?;
            }
            _ => {
                Parser::<Skipped>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(|e| fault(&e))?;
            }
        }
    }
    refuse_surplus(path, &header, &mut reader)?;
    let mut triangles = Vec::with_capacity(faces.len());
    for (number, face) in faces.iter().enumerate() {
        fan(&corners, &face.0, &mut triangles).map_err(|problem| {
            FileError::new(path, problem, "export the mesh again").at(format!("face[{number}]"))
        })?;
    }
    Ok(Some(triangles))
}

/// Cuts a polygon into triangles at its first corner.
fn fan(corners: &[Corner], face: &[i64], triangles: &mut Vec<[Point3<f64>; 3]>) -> Result<(), Problem> {
    let at = |index: i64| {
        let corner = usize::try_from(index).ok().and_then(|index| corners.get(index));
        corner.map(|c| Point3::from(c.0)).ok_or_else(|| Problem::Value {
            value: format!("corner {index}"),
            limit: format!("0 … {}, the points of the file", corners.len() as i64 - 1),
        })
    };
    let [first, rest @ ..] = face else {
        return Err(Problem::Missing("a face's list of corners".into()));
    };
    if rest.len() < 2 {
        return Err(Problem::Value { value: format!("{} corners", face.len()), limit: "3 or more".into() });
    }
    let first = at(*first)?;
    for pair in rest.windows(2) {
        triangles.push([first, at(pair[0])?, at(pair[1])?]);
    }
    Ok(())
}

/// A corner on its way from the file.
#[derive(Debug)]
struct Corner([f64; 3]);

impl PropertyAccess for Corner {
    fn new() -> Self {
        Self([0.0; 3])
    }

    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) else {
            return PropertyAccessResult::Ignored;
        };
        self.0[axis] = value;
        PropertyAccessResult::Set
    }

    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set_double(name, f64::from(value))
    }
}

/// A face on its way from the file.
#[derive(Debug)]
struct Face(Vec<i64>);

impl Face {
    fn set<T: Into<i64>>(&mut self, name: &str, values: Vec<T>) -> PropertyAccessResult {
        if !CORNER_LISTS.contains(&name) {
            return PropertyAccessResult::Ignored;
        }
        self.0 = values.into_iter().map(Into::into).collect();
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_list_char(&mut self, name: &str, values: Vec<i8>) -> PropertyAccessResult {
        self.set(name, values)
    }

    fn set_list_uchar(&mut self, name: &str, values: Vec<u8>) -> PropertyAccessResult {
        self.set(name, values)
    }

    fn set_list_short(&mut self, name: &str, values: Vec<i16>) -> PropertyAccessResult {
        self.set(name, values)
    }

    fn set_list_ushort(&mut self, name: &str, values: Vec<u16>) -> PropertyAccessResult {
        self.set(name, values)
    }

    fn set_list_int(&mut self, name: &str, values: Vec<i32>) -> PropertyAccessResult {
        self.set(name, values)
    }

    fn set_list_uint(&mut self, name: &str, values: Vec<u32>) -> PropertyAccessResult {
        self.set(name, values)
    }
}
