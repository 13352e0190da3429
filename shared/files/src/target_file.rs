//! Calibration targets, `fringecell-target/1`: a board, or a body with several faces.

use crate::document::Document;
use crate::error::{FileError, Problem};
use characterise::target::{
    MAX_FACES, MarkerDictionary, TARGET_FORMAT, TargetBody, TargetFace, TargetKind, TargetSpec,
};
use fringe::math::{cos, sin};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;
use std::path::Path;

/// Farthest place of a face from the origin of its target, mm.
const MAX_PLACE_MM: f64 = 1e5;

/// A target with faces, as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawBody {
    #[serde(rename = "format")]
    _format: Option<String>,
    face: Vec<RawFace>,
}

/// A face, as written: the keys of a board, its name and its place.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawFace {
    name: String,
    position_mm: [f64; 3],
    rotation_deg: [f64; 3],
    #[serde(default)]
    fixed: bool,
    kind: TargetKind,
    columns: u32,
    rows: u32,
    pitch_mm: f64,
    diameter_mm: Option<f64>,
    dictionary: Option<MarkerDictionary>,
    marker_mm: Option<f64>,
    first_marker: Option<u32>,
}

/// Reads and checks a target, which may have faces.
///
/// # Errors
/// A file that cannot be read, or as [`parse_target`]; faces without a place or a name of their own, or that look alike.
pub fn read_target(path: &Path) -> Result<TargetBody, FileError> {
    let document = Document::read(path)?;
    let has_faces = toml::from_str::<toml::Table>(&document.text).is_ok_and(|t| t.contains_key("face"));
    if has_faces { parse_body(&document) } else { parse_target(&document).map(TargetBody::single) }
}

/// Checks a board that was read. The key `format` may be left out.
///
/// # Errors
/// Not TOML, another format, unknown or missing keys, numbers out of range.
pub fn parse_target(document: &Document) -> Result<TargetSpec, FileError> {
    let target: TargetSpec = document.parse_bare(TARGET_FORMAT)?;
    target.check().map_err(|error| {
        let key = error.key().to_owned();
        document.fault(&key, Problem::Target(error), "")
    })?;
    Ok(target)
}

/// Checks a target with faces that was read.
fn parse_body(document: &Document) -> Result<TargetBody, FileError> {
    let raw: RawBody = document.parse_bare(TARGET_FORMAT)?;
    if !(2..=MAX_FACES).contains(&raw.face.len()) {
        let (value, limit) = (raw.face.len().to_string(), format!("2 … {MAX_FACES} faces"));
        let remedy = "a single board needs no [[face]]: write its keys at the top";
        return Err(document.fault("face", Problem::Value { value, limit }, remedy));
    }
    for (number, face) in raw.face.iter().enumerate() {
        for (key, values, most) in
            [("position_mm", face.position_mm, MAX_PLACE_MM), ("rotation_deg", face.rotation_deg, 360.0)]
        {
            // Written so that a NaN is refused too.
            if let Some(value) = values.iter().find(|value| !(-most..=most).contains(*value)) {
                let problem =
                    Problem::Value { value: value.to_string(), limit: format!("-{most} … {most}") };
                return Err(document.fault(&format!("face[{number}].{key}"), problem, ""));
            }
        }
    }
    let body = TargetBody { faces: raw.face.into_iter().map(RawFace::face).collect() };
    body.check().map_err(|(number, error)| {
        let key = format!("face[{number}].{}", error.key());
        document.fault(&key, Problem::Target(error), "")
    })?;
    Ok(body)
}

impl RawFace {
    fn face(self) -> TargetFace {
        let [x, y, z] = self.position_mm;
        let target_from_middle =
            Isometry3::from_parts(Translation3::new(x, y, z), rotation(self.rotation_deg));
        let spec = TargetSpec {
            format: None,
            kind: self.kind,
            columns: self.columns,
            rows: self.rows,
            pitch_mm: self.pitch_mm,
            diameter_mm: self.diameter_mm,
            dictionary: self.dictionary,
            marker_mm: self.marker_mm,
            first_marker: self.first_marker,
        };
        TargetFace { name: self.name, spec, target_from_middle, fixed: self.fixed }
    }
}

/// Rz · Ry · Rx of three angles about x, y, z, as in a scene file.
fn rotation(about_deg: [f64; 3]) -> UnitQuaternion<f64> {
    let about = |axis: usize| {
        let half_rad = 0.5 * about_deg[axis].to_radians();
        let mut q = [cos(half_rad), 0.0, 0.0, 0.0];
        q[axis + 1] = sin(half_rad);
        UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]))
    };
    about(2) * about(1) * about(0)
}
