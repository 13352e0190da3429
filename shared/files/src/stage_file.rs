//! The axis of a rotation stage.
//!
//! ```toml
//! format = "fringecell-stage/1"
//! point_mm = [x, y, z]       # a point of the axis, world frame
//! direction = [x, y, z]      # unit vector; a positive angle turns right-handed about it
//! u_point_mm = 0.01          # optional, for people: standard uncertainties, residual, views, arm
//! [provenance]
//! ```

use crate::document::Document;
use crate::error::{FileError, Problem};
use characterise::rotation_stage::{StageAxis, StageCalibration};
use nalgebra::Vector3;
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::Path;

/// Value of `format` in a stage file.
pub const STAGE_FORMAT: &str = "fringecell-stage/1";

/// How far a written direction may be off unit length: six digits.
const UNIT_TOLERANCE: f64 = 1e-5;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    #[serde(rename = "format")]
    _format: String,
    point_mm: [f64; 3],
    direction: [f64; 3],
    #[serde(rename = "u_point_mm")]
    _u_point_mm: Option<f64>,
    #[serde(rename = "u_direction_rad")]
    _u_direction_rad: Option<f64>,
    #[serde(rename = "rms_mm")]
    _rms_mm: Option<f64>,
    #[serde(rename = "views")]
    _views: Option<usize>,
    #[serde(rename = "arm_mm")]
    _arm_mm: Option<f64>,
    #[serde(default, rename = "provenance")]
    _provenance: toml::Table,
}

/// Reads the axis.
///
/// # Errors
/// Absent, not of this format, unknown keys, numbers that are not finite, a direction that is no unit vector.
pub fn read_stage(path: &Path) -> Result<StageAxis, FileError> {
    let document = Document::read(path)?;
    let raw: Raw = document.parse(STAGE_FORMAT)?;
    if let Some(value) = raw.point_mm.iter().find(|v| !v.is_finite() || v.abs() > 1e6) {
        let problem = Problem::Value { value: value.to_string(), limit: "finite, within 1e6 mm".into() };
        return Err(document.fault("point_mm", problem, "give a point of the axis in mm"));
    }
    let direction = Vector3::from(raw.direction);
    let unit = direction.try_normalize(0.5).filter(|_| (direction.norm() - 1.0).abs() < UNIT_TOLERANCE);
    let direction = unit.ok_or_else(|| {
        let problem = Problem::Value { value: format!("{:?}", raw.direction), limit: "a unit vector".into() };
        document.fault("direction", problem, "divide it by its length")
    })?;
    Ok(StageAxis { point_mm: raw.point_mm.into(), direction })
}

/// Writes a calibration; numbers come back as the same bits.
///
/// # Errors
/// A folder that is absent or cannot be written.
pub fn write_stage(path: &Path, found: &StageCalibration, provenance: &toml::Table) -> Result<(), FileError> {
    let mut text = format!(
        "format = \"{STAGE_FORMAT}\"\npoint_mm = {:?}\ndirection = {:?}\nu_point_mm = {:?}\nu_direction_rad = {:?}\n\
         rms_mm = {:?}\nviews = {}\narm_mm = {:?}\n",
        found.point_mm,
        found.direction,
        found.u_point_mm,
        found.u_direction_rad,
        found.rms_mm,
        found.views,
        found.arm_mm
    );
    let mut holder = toml::Table::new();
    holder.insert("provenance".into(), toml::Value::Table(provenance.clone()));
    let _ = write!(text, "\n{holder}");
    crate::atomic::write(path, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_comes_back_and_bad_ones_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("stage.toml");
        let found = StageCalibration {
            point_mm: [1.25, -3.5, 1.0 / 3.0],
            direction: [0.0, 0.6, 0.8],
            u_point_mm: 0.01,
            u_direction_rad: 1e-4,
            rms_mm: 0.02,
            views: 6,
            arm_mm: 40.0,
        };
        write_stage(&path, &found, &toml::Table::new()).unwrap();
        assert_eq!(read_stage(&path).unwrap().point_mm, found.axis().point_mm);
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, key) in [
            ("[0.0, 0.6, 0.8]", "[0.0, 0.6, 0.9]", "direction"),
            ("[0.0, 0.6, 0.8]", "[nan, 0.6, 0.8]", "direction"),
            ("[1.25,", "[inf,", "point_mm"),
            ("views", "veiws", "veiws"),
            ("fringecell-stage/1", "fringecell-rig/1", "format"),
        ] {
            std::fs::write(&path, text.replace(from, to)).unwrap();
            assert!(read_stage(&path).unwrap_err().to_string().contains(key), "{to}");
        }
    }
}
