//! What can be wrong with a scene.

use crate::mesh::MeshError;
use crate::scene_file::FORMAT;
use thiserror::Error;

/// What is wrong with a scene; the caller adds the file.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SceneError {
    /// Another format or version.
    #[error("format = \"{0}\" is not \"{FORMAT}\"")]
    Format(String),
    /// The scene has no body.
    #[error("the scene has no [[body]]")]
    NoBody,
    /// Two of a kind with one name.
    #[error("[[{kind}]] name = \"{name}\" occurs twice; names must be unique")]
    Duplicate {
        /// Kind of the table: material, body or truth.
        kind: &'static str,
        /// The name that occurs twice.
        name: String,
    },
    /// A body of an unknown material.
    #[error("[[body]] \"{body}\": material = \"{material}\" is not among the [[material]] names: {known}")]
    UnknownMaterial {
        /// Name of the body.
        body: String,
        /// Material named in the scene file.
        material: String,
        /// Names of the materials that exist.
        known: String,
    },
    /// A number outside its range.
    #[error("[[{kind}]] \"{name}\": {key} = {value} must be {limit}")]
    Value {
        /// Kind of the table: material, body or truth.
        kind: &'static str,
        /// Name of the table.
        name: String,
        /// Key of the value.
        key: &'static str,
        /// Value in the scene file.
        value: f64,
        /// What it may be.
        limit: String,
    },
    /// Lists that belong together differ in length.
    #[error("[[body]] \"{body}\": {a_len} diameters_mm but {b_len} offsets_mm; give one offset per sphere")]
    Lengths {
        /// Name of the body.
        body: String,
        /// Number of diameters given.
        a_len: usize,
        /// Number of offsets given.
        b_len: usize,
    },
    /// The mesh file could not be had.
    #[error("[[body]] \"{body}\": file = \"{file}\": {reason}")]
    MeshFile {
        /// Name of the body.
        body: String,
        /// Path in the scene file.
        file: String,
        /// Reason given by the loader.
        reason: String,
    },
    /// The mesh file is no mesh.
    #[error("[[body]] \"{body}\": file = \"{file}\"")]
    Mesh {
        /// Name of the body.
        body: String,
        /// Path in the scene file.
        file: String,
        /// What is wrong with the mesh.
        source: MeshError,
    },
}

impl SceneError {
    /// Kind and name of the table where the fault lies, and its key; any of them may be empty.
    pub fn place(&self) -> (&str, &str, &str) {
        match self {
            Self::Value { kind, name, key, .. } => (kind, name, key),
            Self::Duplicate { kind, name } => (kind, name, "name"),
            Self::UnknownMaterial { body, .. } => ("body", body, "material"),
            Self::Lengths { body, .. } | Self::MeshFile { body, .. } | Self::Mesh { body, .. } => {
                ("body", body, "geometry")
            }
            Self::Format(_) => ("format", "", ""),
            Self::NoBody => ("body", "", ""),
        }
    }
}
