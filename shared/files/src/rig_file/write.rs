//! Writing a rig file.

use super::{CovarianceRef, RIG_FORMAT};
use crate::atomic;
use crate::error::FileError;
use crate::hash::sha256_hex;
use fringe::geometry::camera::{Lens, LensKind};
use fringe::geometry::rig::{Named, Rig};
use fringe::sensor::Sensor;
use std::fmt::Write as _;
use std::path::Path;

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
        out.push_str(&sensor_text(&rig.sensor(&camera.name)));
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
         skew = {:?}\ndistortion = {}\n\
         from_world = {{ rotation = [{}, {}, {}], translation_mm = {} }}\n",
        quoted(&named.name),
        camera.width_px,
        camera.height_px,
        numbers(&camera.focal_px),
        numbers(&camera.principal_point_px),
        camera.skew,
        lens_text(&camera.distortion),
        row(0),
        row(1),
        row(2),
        numbers(camera.camera_from_world.translation.vector.as_slice()),
    )
}

/// The table of a lens: the keys that its model has.
fn lens_text(lens: &Lens) -> String {
    let (k, more) = (lens.k, lens.more_k);
    let six = numbers(&[k[0], k[1], k[2], more[0], more[1], more[2]]);
    let (p, s) = (numbers(&lens.p), numbers(&lens.prism));
    let keys = match lens.kind {
        LensKind::BrownConrady => format!("k = {}, p = {p}", numbers(&k)),
        LensKind::Rational => format!("k = {six}, p = {p}"),
        LensKind::ThinPrism => format!("k = {six}, p = {p}, s = {s}"),
        LensKind::Fisheye => format!("k = {}", numbers(&[k[0], k[1], k[2], more[0]])),
    };
    format!("{{ model = \"{}\", {keys} }}", lens.kind.name())
}

/// The keys of what is known of a sensor.
fn sensor_text(sensor: &Sensor) -> String {
    let mut out = String::new();
    if let Some(footprint) = sensor.footprint {
        let _ = writeln!(out, "footprint_px = {}", numbers(&footprint.sigma_px));
        if footprint.field_px2 != 0.0 {
            let _ = writeln!(out, "footprint_field_px2 = {:?}", footprint.field_px2);
        }
    }
    if let Some(noise) = sensor.noise {
        let _ =
            writeln!(out, "noise = {{ read_dn = {:?}, gain_dn = {:?} }}", noise.read_noise_dn, noise.gain_dn);
    }
    out
}

/// Shortest digits that read back as the same number.
fn numbers(values: &[f64]) -> String {
    format!("[{}]", values.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(", "))
}

pub(crate) fn quoted(text: &str) -> String {
    toml::Value::String(text.to_owned()).to_string()
}
