//! The rig file `rig.toml`: cameras, projectors, pairs, and where their numbers come from.
//!
//! The parameter covariance lies beside it in a file that `rig.toml` names with its SHA-256. Reading the rig does not touch
//! that file, so a rig that was copied alone still measures; who needs the covariance calls [`RigFile::read_covariance`],
//! and gets a file whose bytes are those that the calibration wrote, or an error.

mod covariance;
mod pairs;
mod sensors;
mod write;

use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::hash::sha256_hex;
use crate::name::{check_name, duplicate};
use fringe::geometry::camera::{Camera, Lens, LensKind, pose};
use fringe::geometry::rig::{Named, Pair, Rig};
use serde::Deserialize;
use std::path::{Path, PathBuf};

pub use covariance::{Covariance, CovarianceRef, SensorUncertainty, covariance_beside};
pub use pairs::resolve_pairs;
pub(crate) use pairs::unknown;
pub use sensors::is_in_focus;
pub(crate) use write::quoted;
pub use write::{rig_text, write_rig};

use pairs::check_pairs;
use sensors::{no_sensors, sensors};

/// Value of `format` in a rig file.
pub const RIG_FORMAT: &str = "fringecell-rig/1";

/// A rig file, read and checked.
#[derive(Debug, Clone)]
pub struct RigFile {
    /// Where it was read from.
    pub path: PathBuf,
    /// SHA-256 of its bytes, hexadecimal: what clouds and results name as their rig.
    pub sha256: String,
    /// Geometry. A pair that names no projector has an empty `projector`; see [`resolve_pairs`].
    pub rig: Rig,
    /// When, from what, residuals, software version: kept as written.
    pub provenance: toml::Table,
    /// The file with the parameter covariance, if there is one.
    pub covariance: Option<CovarianceRef>,
}

/// The rig file as written, before it is checked.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawRig {
    #[serde(rename = "format")]
    _format: String,
    #[serde(default)]
    camera: Vec<RawCamera>,
    #[serde(default)]
    projector: Vec<RawCamera>,
    #[serde(default)]
    pair: Vec<RawPair>,
    #[serde(default)]
    provenance: toml::Table,
    covariance: Option<CovarianceRef>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawCamera {
    name: String,
    width_px: u32,
    height_px: u32,
    focal_px: [f64; 2],
    principal_point_px: [f64; 2],
    #[serde(default)]
    skew: f64,
    distortion: Option<RawLens>,
    from_world: RawPose,
    footprint_px: Option<[f64; 2]>,
    footprint_field_px2: Option<f64>,
    noise: Option<RawNoise>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawNoise {
    read_dn: f64,
    gain_dn: f64,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawLens {
    model: String,
    #[serde(default)]
    k: Vec<f64>,
    #[serde(default)]
    p: Vec<f64>,
    #[serde(default)]
    s: Vec<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPose {
    rotation: [[f64; 3]; 3],
    translation_mm: [f64; 3],
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPair {
    name: String,
    left: String,
    right: String,
    #[serde(default)]
    projector: String,
}

/// Reads and checks a rig file.
///
/// # Errors
/// Everything that DESIGN section 4 does not allow: unknown keys, impossible cameras, mirrored or non-orthonormal
/// rotations, names that occur twice, pairs of unknown cameras. The message names the line and the key.
pub fn read_rig(path: &Path) -> Result<RigFile, FileError> {
    parse(&Document::read(path)?)
}

/// Checks the text of a rig file before it is written to `path`, as [`read_rig`] would after.
///
/// # Errors
/// As [`read_rig`].
pub fn parse_rig(path: &Path, text: String) -> Result<RigFile, FileError> {
    parse(&Document { path: path.to_owned(), text })
}

fn parse(document: &Document) -> Result<RigFile, FileError> {
    let raw: RawRig = document.parse(RIG_FORMAT)?;
    let rig = meaning(document, &raw)?;
    Ok(RigFile {
        path: document.path.clone(),
        sha256: sha256_hex(document.text.as_bytes()),
        rig,
        provenance: raw.provenance,
        covariance: raw.covariance,
    })
}

fn meaning(document: &Document, raw: &RawRig) -> Result<Rig, FileError> {
    let read = |table: &str, cameras: &[RawCamera]| {
        cameras
            .iter()
            .enumerate()
            .map(|(index, camera)| named(document, &format!("{table}[{index}]"), camera))
            .collect::<Result<Vec<_>, _>>()
    };
    let rig = Rig {
        cameras: read("camera", &raw.camera)?,
        projectors: read("projector", &raw.projector)?,
        pairs: raw.pair.iter().map(RawPair::meaning).collect(),
        sensors: sensors(document, &raw.camera)?,
    };
    no_sensors(document, &raw.projector)?;
    if rig.cameras.is_empty() {
        let problem = Problem::Missing("[[camera]]".into());
        return Err(document.fault("camera", problem, "a rig has at least one camera"));
    }
    unique_views(document, &rig)?;
    check_pairs(document, &rig)?;
    Ok(rig)
}

impl RawPair {
    fn meaning(&self) -> Pair {
        Pair {
            name: self.name.clone(),
            left: self.left.clone(),
            right: self.right.clone(),
            projector: self.projector.clone(),
        }
    }
}

fn named(document: &Document, key: &str, raw: &RawCamera) -> Result<Named, FileError> {
    check_name(&raw.name).map_err(|problem| document.fault(&format!("{key}.name"), problem, ""))?;
    let who = format!("this is \"{}\"", raw.name);
    let distortion = lens(document, key, raw)?;
    let camera_from_world =
        pose(raw.from_world.rotation, raw.from_world.translation_mm).map_err(|error| {
            document.fault(
                &format!("{key}.from_world"),
                Problem::Camera(error),
                format!("{who}: rotation is the matrix R, row by row, of X_camera = R X_world + t"),
            )
        })?;
    let camera = Camera {
        width_px: raw.width_px,
        height_px: raw.height_px,
        focal_px: raw.focal_px,
        principal_point_px: raw.principal_point_px,
        skew: raw.skew,
        distortion,
        camera_from_world,
    };
    camera.check().map_err(|error| document.fault(key, Problem::Camera(error), who))?;
    Ok(Named { name: raw.name.clone(), camera })
}

fn lens(document: &Document, key: &str, raw: &RawCamera) -> Result<Lens, FileError> {
    let Some(lens) = &raw.distortion else { return Ok(Lens::default()) };
    let key = format!("{key}.distortion");
    let Some((_, kind)) = LensKind::NAMES.iter().find(|(name, _)| *name == lens.model) else {
        let names = LensKind::NAMES.map(|(name, _)| name);
        let problem = Problem::Value {
            value: format!("model = \"{}\"", lens.model),
            limit: format!("lens models: {}", list(names)),
        };
        let remedy = did_you_mean(&lens.model, names, "convert the calibration to one of them");
        return Err(document.fault(&key, problem, remedy));
    };
    let (most_k, most_p, most_s) = match kind {
        LensKind::BrownConrady => (3, 2, 0),
        LensKind::Rational => (6, 2, 0),
        LensKind::ThinPrism => (6, 2, 4),
        LensKind::Fisheye => (4, 0, 0),
    };
    let [k1, k2, k3, k4, k5, k6] = coefficients(document, &key, ("k", most_k, lens), &lens.k)?;
    Ok(Lens {
        kind: *kind,
        k: [k1, k2, k3],
        p: coefficients(document, &key, ("p", most_p, lens), &lens.p)?,
        more_k: [k4, k5, k6],
        prism: coefficients(document, &key, ("s", most_s, lens), &lens.s)?,
    })
}

/// Up to `most` coefficients; those that are not written are zero.
fn coefficients<const N: usize>(
    document: &Document,
    key: &str,
    (name, most, lens): (&str, usize, &RawLens),
    values: &[f64],
) -> Result<[f64; N], FileError> {
    if values.len() > most {
        let problem = Problem::Value {
            value: format!("{name} with {} numbers", values.len()),
            limit: format!("\"{}\" has at most {most}", lens.model),
        };
        let remedy = "k is [k1, k2, k3] and on to k6 (rational, thin-prism) or k4 (fisheye), p is [p1, p2], s is [s1, s2, s3, s4]";
        return Err(document.fault(key, problem, remedy));
    }
    let mut out = [0.0; N];
    out.iter_mut().zip(values).for_each(|(to, from)| *to = *from);
    Ok(out)
}

fn unique_views(document: &Document, rig: &Rig) -> Result<(), FileError> {
    let views = rig.cameras.iter().chain(&rig.projectors).map(|view| view.name.as_str());
    if let Some((index, name)) = duplicate(views) {
        let key = match index.checked_sub(rig.cameras.len()) {
            None => format!("camera[{index}].name"),
            Some(index) => format!("projector[{index}].name"),
        };
        let problem = Problem::Duplicate { kind: "view", name: name.to_owned() };
        return Err(document.fault(&key, problem, "cameras and projectors share one set of names"));
    }
    if let Some((index, name)) = duplicate(rig.pairs.iter().map(|pair| pair.name.as_str())) {
        let problem = Problem::Duplicate { kind: "pair", name: name.to_owned() };
        return Err(document.fault(&format!("pair[{index}].name"), problem, "rename one of them"));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
