//! The rig file `rig.toml`: cameras, projectors, pairs, and where their numbers come from.

use crate::atomic;
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean, list};
use crate::hash::sha256_hex;
use crate::name::{check_name, duplicate};
use fringe::camera::{BrownConrady, Camera, pose};
use fringe::rig::{Named, Pair, Rig};
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Value of `format` in a rig file.
pub const RIG_FORMAT: &str = "fringecell-rig/1";

/// The only lens model so far.
const LENS_MODEL: &str = "brown-conrady";

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

/// Names the file beside `rig.toml` that carries the parameter covariance.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CovarianceRef {
    /// Relative to the rig file.
    pub file: String,
    /// Of its bytes, hexadecimal.
    pub sha256: String,
}

/// As written.
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
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawLens {
    model: String,
    #[serde(default)]
    k: Vec<f64>,
    #[serde(default)]
    p: Vec<f64>,
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
    let document = Document::read(path)?;
    let raw: RawRig = document.parse(RIG_FORMAT)?;
    let rig = meaning(&document, &raw)?;
    Ok(RigFile {
        path: path.to_owned(),
        sha256: sha256_hex(document.text.as_bytes()),
        rig,
        provenance: raw.provenance,
        covariance: raw.covariance,
    })
}

/// The property `pair` of a point cloud is a byte.
const MOST_PAIRS: usize = 256;

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
    };
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

fn lens(document: &Document, key: &str, raw: &RawCamera) -> Result<BrownConrady, FileError> {
    let Some(lens) = &raw.distortion else { return Ok(BrownConrady::default()) };
    let key = format!("{key}.distortion");
    if lens.model != LENS_MODEL {
        let problem = Problem::Value {
            value: format!("model = \"{}\"", lens.model),
            limit: format!("the lens model is \"{LENS_MODEL}\""),
        };
        let remedy = did_you_mean(&lens.model, [LENS_MODEL], "convert the calibration to that model");
        return Err(document.fault(&key, problem, remedy));
    }
    Ok(BrownConrady {
        k: coefficients(document, &key, "k", &lens.k)?,
        p: coefficients(document, &key, "p", &lens.p)?,
    })
}

/// Up to N coefficients; those that are not written are zero.
fn coefficients<const N: usize>(
    document: &Document,
    key: &str,
    name: &str,
    values: &[f64],
) -> Result<[f64; N], FileError> {
    if values.len() > N {
        let problem = Problem::Value {
            value: format!("{name} with {} numbers", values.len()),
            limit: format!("at most {N} are read"),
        };
        return Err(document.fault(key, problem, "k is [k1, k2, k3], p is [p1, p2]"));
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

fn check_pairs(document: &Document, rig: &Rig) -> Result<(), FileError> {
    if rig.pairs.len() > MOST_PAIRS {
        let problem = Problem::Value {
            value: format!("{} pairs", rig.pairs.len()),
            limit: format!("at most {MOST_PAIRS}: a point cloud numbers them in a byte"),
        };
        return Err(document.fault("pair", problem, "split the rig file"));
    }
    for (index, pair) in rig.pairs.iter().enumerate() {
        let key = |part: &str| format!("pair[{index}].{part}");
        check_name(&pair.name).map_err(|problem| document.fault(&key("name"), problem, ""))?;
        if rig.camera(&pair.left).is_none() {
            return Err(unknown(document, &key("left"), "camera", &pair.left, camera_names(rig)));
        }
        if rig.camera(&pair.right).is_none() && rig.projector(&pair.right).is_none() {
            let known = camera_names(rig).chain(rig.projectors.iter().map(|p| p.name.as_str()));
            return Err(unknown(document, &key("right"), "camera or projector", &pair.right, known));
        }
        if pair.left == pair.right {
            let problem = Problem::Value {
                value: format!("left = right = \"{}\"", pair.left),
                limit: "a pair has two views".into(),
            };
            return Err(document.fault(&key("right"), problem, "name the other camera"));
        }
        let by_projector = rig.projector(&pair.right).is_some();
        if by_projector && !pair.projector.is_empty() && pair.projector != pair.right {
            let problem = Problem::Disagreement {
                what: "right view and projector",
                here: format!("projector = \"{}\"", pair.projector),
                there: format!("right = \"{}\" is a projector", pair.right),
            };
            return Err(document.fault(&key("projector"), problem, "a projector sees only its own light"));
        }
    }
    Ok(())
}

fn camera_names(rig: &Rig) -> impl Iterator<Item = &str> + Clone {
    rig.cameras.iter().map(|camera| camera.name.as_str())
}

pub(crate) fn unknown<'a>(
    document: &Document,
    key: &str,
    kind: &'static str,
    name: &str,
    known: impl IntoIterator<Item = &'a str> + Clone,
) -> FileError {
    let remedy = did_you_mean(name, known.clone(), "name one of those, or add it");
    document.fault(key, Problem::UnknownName { kind, name: name.to_owned(), known: list(known) }, remedy)
}

/// Fills in the projector of pairs that name none: the only one that lit both of their cameras.
///
/// `lit` lists each projector with the cameras that looked while it was on, as a recording or a cell configuration
/// tells. A pair that names its projector is left as it is.
///
/// # Errors
/// No projector lit both cameras of a pair, or several did; the key names the pair by its name.
pub fn resolve_pairs(rig_path: &Path, rig: &mut Rig, lit: &[(&str, &[String])]) -> Result<(), FileError> {
    let projectors: Vec<String> = rig.projectors.iter().map(|p| p.name.clone()).collect();
    for pair in rig.pairs.iter_mut().filter(|pair| pair.projector.is_empty()) {
        if projectors.contains(&pair.right) {
            pair.projector = pair.right.clone();
            continue;
        }
        let sees = |cameras: &[String], name: &str| cameras.iter().any(|camera| camera == name);
        let both: Vec<&str> = lit
            .iter()
            .filter(|(_, cameras)| sees(cameras, &pair.left) && sees(cameras, &pair.right))
            .map(|(name, _)| *name)
            .collect();
        let [only] = both.as_slice() else {
            let problem = Problem::Disagreement {
                what: "pair and projectors",
                here: format!(
                    "pair \"{}\" of {} and {} names no projector",
                    pair.name, pair.left, pair.right
                ),
                there: format!("{} projectors light both ({})", both.len(), list(both.iter().copied())),
            };
            let remedy = "add projector = \"…\" to the pair, or light both of its cameras with one projector";
            return Err(FileError::new(rig_path, problem, remedy).at(format!("pair {}", pair.name)));
        };
        pair.projector = (*only).to_owned();
    }
    Ok(())
}

/// Writes a rig file, complete or not at all, and returns the SHA-256 of its bytes.
///
/// Every number has the digits that give the same `f64` when read. Keys of the contract only; `provenance` is free.
///
/// # Errors
/// The folder cannot be written.
pub fn write_rig(
    path: &Path,
    rig: &Rig,
    provenance: &toml::Table,
    covariance: Option<&CovarianceRef>,
) -> Result<String, FileError> {
    let text = rig_text(rig, provenance, covariance);
    atomic::write(path, text.as_bytes())?;
    Ok(sha256_hex(text.as_bytes()))
}

/// The text of a rig file.
pub fn rig_text(rig: &Rig, provenance: &toml::Table, covariance: Option<&CovarianceRef>) -> String {
    let mut out = format!("format = \"{RIG_FORMAT}\"\n");
    if let Some(reference) = covariance {
        let (file, sha256) = (quoted(&reference.file), quoted(&reference.sha256));
        let _ = writeln!(out, "covariance = {{ file = {file}, sha256 = {sha256} }}");
    }
    for camera in &rig.cameras {
        out.push_str(&camera_text("camera", camera));
    }
    for projector in &rig.projectors {
        out.push_str(&camera_text("projector", projector));
    }
    for pair in &rig.pairs {
        let _ = write!(
            out,
            "\n[[pair]]\nname = {}\nleft = {}\nright = {}\n",
            quoted(&pair.name),
            quoted(&pair.left),
            quoted(&pair.right)
        );
        if !pair.projector.is_empty() {
            let _ = writeln!(out, "projector = {}", quoted(&pair.projector));
        }
    }
    if !provenance.is_empty() {
        let mut holder = toml::Table::new();
        holder.insert("provenance".into(), toml::Value::Table(provenance.clone()));
        let _ = write!(out, "\n{holder}");
    }
    out
}

fn camera_text(table: &str, named: &Named) -> String {
    let camera = &named.camera;
    let rotation = camera.camera_from_world.rotation.to_rotation_matrix();
    let row = |r: usize| numbers(&[rotation[(r, 0)], rotation[(r, 1)], rotation[(r, 2)]]);
    format!(
        "\n[[{table}]]\nname = {}\nwidth_px = {}\nheight_px = {}\nfocal_px = {}\nprincipal_point_px = {}\n\
         skew = {:?}\ndistortion = {{ model = \"{LENS_MODEL}\", k = {}, p = {} }}\n\
         from_world = {{ rotation = [{}, {}, {}], translation_mm = {} }}\n",
        quoted(&named.name),
        camera.width_px,
        camera.height_px,
        numbers(&camera.focal_px),
        numbers(&camera.principal_point_px),
        camera.skew,
        numbers(&camera.distortion.k),
        numbers(&camera.distortion.p),
        row(0),
        row(1),
        row(2),
        numbers(camera.camera_from_world.translation.vector.as_slice()),
    )
}

/// Shortest digits that read back as the same number.
fn numbers(values: &[f64]) -> String {
    format!("[{}]", values.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(", "))
}

pub(crate) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}

#[cfg(test)]
mod tests;
