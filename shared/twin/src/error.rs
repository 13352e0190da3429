//! What can be wrong with a scene.

use crate::mesh::MeshError;
use crate::scene_file::FORMAT;
use thiserror::Error;

/// What is wrong with a scene; the caller adds the file.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SceneError {
    /// Not TOML, an unknown key, a missing key, a value of another type.
    #[error("{0}")]
    Syntax(String),
    /// Another format or version.
    #[error("format = \"{0}\" is not \"{FORMAT}\"")]
    Format(String),
    /// Nothing to see.
    #[error("the scene has no [[body]]")]
    NoBody,
    /// Two of a kind with one name.
    #[error("[[{kind}]] name = \"{name}\" occurs twice; names must be unique")]
    Duplicate {
        /// material, body, truth.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A body of an unknown material.
    #[error("[[body]] \"{body}\": material = \"{material}\" is not among the [[material]] names: {known}")]
    UnknownMaterial {
        /// The body.
        body: String,
        /// As written.
        material: String,
        /// Names that exist.
        known: String,
    },
    /// A number outside its range.
    #[error("[[{kind}]] \"{name}\": {key} = {value} must be {limit}")]
    Value {
        /// material, body, truth.
        kind: &'static str,
        /// Its name.
        name: String,
        /// The key.
        key: &'static str,
        /// As written.
        value: f64,
        /// What it may be.
        limit: String,
    },
    /// Lists that belong together differ in length.
    #[error("[[body]] \"{body}\": {a_len} diameters_mm but {b_len} offsets_mm; give one offset per sphere")]
    Lengths {
        /// The body.
        body: String,
        /// Number of diameters.
        a_len: usize,
        /// Number of offsets.
        b_len: usize,
    },
    /// The mesh file could not be had.
    #[error("[[body]] \"{body}\": file = \"{file}\": {reason}")]
    MeshFile {
        /// The body.
        body: String,
        /// As written.
        file: String,
        /// Of the loader.
        reason: String,
    },
    /// The mesh file is no mesh.
    #[error("[[body]] \"{body}\": file = \"{file}\"")]
    Mesh {
        /// The body.
        body: String,
        /// As written.
        file: String,
        /// What is wrong.
        source: MeshError,
    },
}
