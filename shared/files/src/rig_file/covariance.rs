//! The parameter covariance beside a rig file.

use super::RigFile;
use crate::document::read_bytes;
use crate::error::{FileError, Problem, list};
use crate::hash::sha256_hex;
use fringe::math::linear::{Dense, pivoted_root};
use fringe::sensor::Sensor;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Value of `format` in a covariance file.
pub const COVARIANCE_FORMAT: &str = "fringecell-covariance/1";

/// A covariance of two hundred devices has some hundred megabytes of digits; nothing meant is longer.
const MOST_BYTES: u64 = 256 << 20;

/// Names the file beside `rig.toml` that carries the parameter covariance.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CovarianceRef {
    /// Relative to the rig file.
    pub file: String,
    /// Of its bytes, hexadecimal.
    pub sha256: String,
}

/// The covariance of the parameters of all devices of a rig, as the calibration wrote it.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    /// Where it was read from.
    pub path: PathBuf,
    /// Devices, in the order of the matrix.
    pub devices: Vec<String>,
    /// Parameters of each device, in the order of the matrix.
    pub parameters: Vec<String>,
    /// Standard uncertainties of what is known of sensors, by camera.
    pub sensors: BTreeMap<String, SensorUncertainty>,
    /// Square; parameter i of device d stands in row d · parameters + i. There may be further rows after them.
    matrix: Vec<Vec<f64>>,
}

/// Standard uncertainties of a camera's footprint and noise, as the covariance file states them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SensorUncertainty {
    /// Of the footprint along x and y, px.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_footprint_px: Option<[f64; 2]>,
    /// Of read noise and gain, DN.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_noise_dn: Option<[f64; 2]>,
}

impl SensorUncertainty {
    /// The uncertainties that a sensor carries.
    pub fn of(sensor: &Sensor) -> Self {
        Self {
            u_footprint_px: sensor.footprint.and_then(|footprint| footprint.u_px),
            u_noise_dn: sensor.noise_u_dn,
        }
    }
}

/// The covariance file as written, before it is checked.
#[derive(Deserialize)]
struct RawCovariance {
    format: String,
    devices: Vec<String>,
    parameters: Vec<String>,
    matrix: Vec<Vec<f64>>,
    #[serde(default)]
    sensors: BTreeMap<String, SensorUncertainty>,
}

/// Where the covariance of a rig file is written: beside it, with its name.
pub fn covariance_beside(rig: &Path) -> PathBuf {
    let mut file = rig.file_stem().unwrap_or_default().to_owned();
    file.push(".covariance.json");
    rig.with_file_name(file)
}

impl Covariance {
    /// The part that belongs to some devices, in the order given, row by row; `None` for a device that it does not hold.
    pub fn part(&self, devices: &[&str]) -> Option<Vec<f64>> {
        let count = self.parameters.len();
        let mut places = Vec::new();
        for name in devices {
            let first = self.devices.iter().position(|device| device == name)? * count;
            places.extend(first..first + count);
        }
        Some(places.iter().flat_map(|row| places.iter().map(|column| self.matrix[*row][*column])).collect())
    }
}

impl RigFile {
    /// What is known of the sensors of all cameras, with the uncertainties of the covariance where it can be read: a rig that was
    /// copied alone still measures.
    pub fn sensors(&self) -> BTreeMap<String, Sensor> {
        let mut sensors = self.rig.sensors.clone();
        let covariance = if sensors.is_empty() { None } else { self.read_covariance().ok().flatten() };
        for (camera, known) in covariance.iter().flat_map(|covariance| &covariance.sensors) {
            let Some(sensor) = sensors.get_mut(camera) else { continue };
            if let Some(footprint) = &mut sensor.footprint {
                footprint.u_px = known.u_footprint_px;
            }
            sensor.noise_u_dn = known.u_noise_dn;
        }
        sensors
    }

    /// Reads the covariance that the rig file names; `None` when it names none.
    ///
    /// # Errors
    /// The file is absent, its SHA-256 is another one than the rig file states, or it holds no covariance.
    pub fn read_covariance(&self) -> Result<Option<Covariance>, FileError> {
        let Some(reference) = &self.covariance else { return Ok(None) };
        let path = self.path.with_file_name(&reference.file);
        let remedy = "copy it beside the rig file again, or calibrate again";
        let bytes = read_bytes(&path, MOST_BYTES).map_err(|mut fault| {
            fault.remedy = format!("{} names it as its covariance; {remedy}", self.path.display());
            fault
        })?;
        let found = sha256_hex(&bytes);
        if found != reference.sha256.to_ascii_lowercase() {
            let problem = Problem::Disagreement {
                what: "covariance and rig file",
                here: format!("this file has the SHA-256 {found}"),
                there: format!("{} has {}", self.path.display(), reference.sha256),
            };
            return Err(FileError::new(
                &path,
                problem,
                format!("it was changed or belongs to another rig: {remedy}"),
            ));
        }
        parse(path, &bytes, &self.views()).map(Some)
    }

    /// Names of all cameras and projectors.
    fn views(&self) -> Vec<&str> {
        self.rig.cameras.iter().chain(&self.rig.projectors).map(|view| view.name.as_str()).collect()
    }
}

fn parse(path: PathBuf, bytes: &[u8], views: &[&str]) -> Result<Covariance, FileError> {
    let fault = |key: &str, problem| FileError::new(&path, problem, "calibrate again").at(key);
    let raw: RawCovariance =
        serde_json::from_slice(bytes).map_err(|error| fault("", Problem::Syntax(error.to_string())))?;
    if raw.format != COVARIANCE_FORMAT {
        let problem = Problem::Format { found: raw.format, expected: COVARIANCE_FORMAT.into() };
        return Err(fault("format", problem));
    }
    if let Some(unknown) = raw.devices.iter().find(|device| !views.contains(&device.as_str())) {
        let known = list(views.iter().copied());
        return Err(fault("devices", Problem::UnknownName { kind: "device", name: unknown.clone(), known }));
    }
    if let Some(twice) = (1..raw.devices.len()).find(|i| raw.devices[..*i].contains(&raw.devices[*i])) {
        let name = raw.devices[twice].clone();
        return Err(fault("devices", Problem::Value { value: name, limit: "each device once".into() }));
    }
    if let Some(unknown) = raw.sensors.keys().find(|camera| !views.contains(&camera.as_str())) {
        let known = list(views.iter().copied());
        return Err(fault("sensors", Problem::UnknownName { kind: "camera", name: unknown.clone(), known }));
    }
    let size = raw.matrix.len();
    let needed = raw.devices.len().saturating_mul(raw.parameters.len());
    if size < needed || raw.matrix.iter().any(|row| row.len() != size) {
        let problem = Problem::Disagreement {
            what: "sizes",
            here: format!("{} devices with {} parameters each", raw.devices.len(), raw.parameters.len()),
            there: format!("the matrix has {size} rows, or rows of another length"),
        };
        return Err(fault("matrix", problem));
    }
    let u = raw.sensors.values().flat_map(|u| u.u_footprint_px.into_iter().chain(u.u_noise_dn).flatten());
    if let Some(wrong) = u.into_iter().find(|value| !(*value >= 0.0 && value.is_finite())) {
        let limit = "standard uncertainties: finite, 0 or larger".into();
        return Err(fault("sensors", Problem::Value { value: wrong.to_string(), limit }));
    }
    if raw.matrix.iter().flatten().any(|value| !value.is_finite()) {
        return Err(fault(
            "matrix",
            Problem::Value { value: "infinity".into(), limit: "finite numbers".into() },
        ));
    }
    if let Some((row, column, why)) = no_covariance(&raw.matrix) {
        let value = format!("{} in row {row}, column {column} (counted from 0)", raw.matrix[row][column]);
        return Err(fault("matrix", Problem::Value { value, limit: why.into() }));
    }
    let RawCovariance { devices, parameters, matrix, sensors, .. } = raw;
    Ok(Covariance { path, devices, parameters, sensors, matrix })
}

/// Parts of a standard uncertainty that are rounding.
const ROUNDING: f64 = 1e-6;
/// Larger matrices are not taken apart: it would take minutes.
const MOST_ROWS: usize = 2000;

/// Where a square matrix is no covariance, and what it should be.
fn no_covariance(matrix: &[Vec<f64>]) -> Option<(usize, usize, &'static str)> {
    let size = matrix.len();
    if let Some(i) = (0..size).find(|i| matrix[*i][*i] < 0.0) {
        return Some((i, i, "variances are 0 or larger"));
    }
    let scale = |i: usize, j: usize| (matrix[i][i] * matrix[j][j]).sqrt();
    for (i, row) in matrix.iter().enumerate() {
        for (j, value) in row.iter().enumerate().take(i) {
            if (value - matrix[j][i]).abs() > ROUNDING * scale(i, j) {
                return Some((i, j, "a covariance is symmetric"));
            }
            if value.abs() > (1.0 + ROUNDING) * scale(i, j) {
                return Some((i, j, "a correlation lies within -1 … 1"));
            }
        }
    }
    if size > MOST_ROWS {
        return None;
    }
    let (_, left) = pivoted_root(&Dense::from_fn(size, size, |i, j| matrix[i][j]), ROUNDING);
    let lost = left.iter().position(|part| *part < -ROUNDING.sqrt())?;
    Some((lost, lost, "the correlations contradict each other: no sum of parameters has a negative variance"))
}
