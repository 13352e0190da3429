//! A calibration of the reference-plane method: a folder of rasters, described by `reference-plane.toml`, which is written last.
//!
//! ```toml
//! format = "fringecell-reference-plane/1"
//! projector = "proj1"
//! camera = "cam1"
//! axis = "x"
//! period_px = 16.0
//! range_mm = [0.0, 40.0]     # heights of the lowest and the highest plane
//! degree = 2                 # rasters reference.npy (rad) and k0.npy … k2.npy (mm per rad to the power of the number)
//! [provenance]
//! ```

use crate::atomic;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::npy::{self, Raster};
use crate::rig_file::quoted;
use characterise::reference_plane::{MOST_DEGREE, PlaneCalibration};
use fringe::pattern::Axis;
use fringe::phase::PhaseInfo;
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::Path;

/// Value of the key `format`.
pub const PLANE_FORMAT: &str = "fringecell-reference-plane/1";

/// Name of the file that makes a folder a calibration.
pub const PLANE_FILE: &str = "reference-plane.toml";

/// A calibration and whose it is.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaneFile {
    /// The projector that lit.
    pub projector: String,
    /// The camera that looked.
    pub camera: String,
    /// The polynomials that give heights.
    pub calibration: PlaneCalibration,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    #[serde(rename = "format")]
    _format: String,
    projector: String,
    camera: String,
    axis: Axis,
    period_px: f64,
    range_mm: [f64; 2],
    degree: usize,
    #[serde(default, rename = "provenance")]
    _provenance: toml::Table,
}

/// Reads a calibration.
///
/// # Errors
/// A file that is absent or of another kind, a degree or range that no calibration has, rasters of unequal size.
pub fn read_planes(folder: &Path) -> Result<PlaneFile, FileError> {
    let document = Document::read(&folder.join(PLANE_FILE))?;
    let raw: Raw = document.parse(PLANE_FORMAT)?;
    let value = |key: &str, value: String, limit: &str| {
        let problem = Problem::Value { value, limit: limit.into() };
        document.fault(key, problem, "make it again with `fringetool reference-plane calibrate`")
    };
    if !(1..=MOST_DEGREE).contains(&raw.degree) {
        return Err(value("degree", raw.degree.to_string(), "1 to 3"));
    }
    let [low, high] = raw.range_mm;
    if !(low.is_finite() && high.is_finite() && low < high) {
        return Err(value("range_mm", format!("{:?}", raw.range_mm), "two finite heights, rising"));
    }
    if !(raw.period_px > 0.0 && raw.period_px.is_finite()) {
        return Err(value("period_px", raw.period_px.to_string(), "above 0"));
    }
    let reference = npy::read(&folder.join("reference.npy"))?;
    let (width_px, height_px) = (reference.width_px, reference.height_px);
    let coefficient = |k: usize| {
        let path = folder.join(format!("k{k}.npy"));
        let raster = npy::read(&path)?;
        if (raster.width_px, raster.height_px) == (width_px, height_px) {
            return Ok(raster.values);
        }
        let problem = Problem::Disagreement {
            what: "sizes",
            here: format!("{} × {} px", raster.width_px, raster.height_px),
            there: format!("{width_px} × {height_px} px in reference.npy"),
        };
        Err(FileError::new(&path, problem, "do not mix calibrations"))
    };
    let coefficients = (0..=raw.degree).map(coefficient).collect::<Result<_, _>>()?;
    let info = PhaseInfo { width_px, height_px, axis: raw.axis, period_px: raw.period_px };
    let calibration =
        PlaneCalibration { info, range_mm: raw.range_mm, reference_rad: reference.values, coefficients };
    Ok(PlaneFile { projector: raw.projector, camera: raw.camera, calibration })
}

/// Writes a calibration; its numbers come back as the same bits.
///
/// # Errors
/// A folder that cannot be made or written.
pub fn write_planes(folder: &Path, file: &PlaneFile, provenance: &toml::Table) -> Result<(), FileError> {
    let PlaneCalibration { info, range_mm, reference_rad, coefficients } = &file.calibration;
    atomic::create_dir(folder)?;
    let raster = |values: &[f32]| Raster {
        width_px: info.width_px,
        height_px: info.height_px,
        values: values.to_vec(),
    };
    npy::write(&folder.join("reference.npy"), &raster(reference_rad))?;
    for (k, values) in coefficients.iter().enumerate() {
        npy::write(&folder.join(format!("k{k}.npy")), &raster(values))?;
    }
    let axis = if info.axis == Axis::X { "x" } else { "y" };
    let mut text = format!(
        "format = \"{PLANE_FORMAT}\"\nprojector = {}\ncamera = {}\naxis = \"{axis}\"\nperiod_px = {:?}\nrange_mm = {range_mm:?}\n\
         degree = {}\n",
        quoted(&file.projector),
        quoted(&file.camera),
        info.period_px,
        coefficients.len().saturating_sub(1)
    );
    let mut holder = toml::Table::new();
    holder.insert("provenance".into(), toml::Value::Table(provenance.clone()));
    let _ = write!(text, "\n{holder}");
    atomic::write(&folder.join(PLANE_FILE), text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calibration_comes_back_and_a_bad_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let file = PlaneFile {
            projector: "proj \"1\"".into(),
            camera: "cam1".into(),
            calibration: PlaneCalibration {
                info: PhaseInfo { width_px: 2, height_px: 1, axis: Axis::Y, period_px: 16.5 },
                range_mm: [-1.0, 40.0],
                reference_rad: vec![1.0, 2.0],
                coefficients: vec![vec![0.0, 0.1], vec![3.0, 4.0]],
            },
        };
        write_planes(dir.path(), &file, &toml::Table::new()).unwrap();
        assert_eq!(read_planes(dir.path()).unwrap(), file);
        let path = dir.path().join(PLANE_FILE);
        let text = std::fs::read_to_string(&path).unwrap();
        for (from, to, key) in [
            ("degree = 1", "degree = 4", "degree"),
            ("degree = 1", "degree = 2", "k2.npy"),
            ("[-1.0, 40.0]", "[40.0, 40.0]", "range_mm"),
            ("period_px = 16.5", "period_px = -1.0", "period_px"),
            ("axis", "axes", "axes"),
        ] {
            std::fs::write(&path, text.replace(from, to)).unwrap();
            assert!(read_planes(dir.path()).unwrap_err().to_string().contains(key), "{to}");
        }
    }
}
