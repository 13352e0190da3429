//! What a calibration writes and prints.

use super::report::Parts;
use super::sensors::{self, Characterised};
use super::{lengths, validation};
use anyhow::{Context, Result, bail};
use characterise::calibration::{COMMON_PARAMETERS, Calibration, DeviceKind, Gauge, Outlier, PARAMETERS};
use files::rig_file::{CovarianceRef, SensorUncertainty, covariance_beside};
use fringe::geometry::camera::LensKind;
use fringe::geometry::rig::{Named, Pair, Rig};
use fringe::sensor::Sensor;
use std::collections::BTreeMap;
use std::path::Path;

/// The pairs given by `--pair`, or one for each projector seen by exactly two cameras; each with its two devices.
pub fn pairs(
    asked: &[String],
    calibration: &Calibration,
    lit: &[(String, Vec<String>)],
) -> Result<Vec<(Pair, [usize; 2])>> {
    let named: Vec<Pair> = if asked.is_empty() {
        lit.iter()
            .filter_map(|(projector, cameras)| match cameras.as_slice() {
                [left, right] => Some((projector, left, right)),
                _ => None,
            })
            .filter(|(_, left, right)| {
                calibration.device(left).is_some() && calibration.device(right).is_some()
            })
            .enumerate()
            .map(|(index, (projector, left, right))| Pair {
                name: format!("pair{}", index + 1),
                left: left.clone(),
                right: right.clone(),
                projector: projector.clone(),
            })
            .collect()
    } else {
        asked.iter().map(|argument| pair(argument, calibration)).collect::<Result<_>>()?
    };
    let place = |name: &str| calibration.devices.iter().position(|d| d.name == name);
    Ok(named
        .into_iter()
        .filter_map(|p| {
            let devices = [place(&p.left)?, place(&p.right)?];
            Some((p, devices))
        })
        .collect())
}

fn pair(argument: &str, calibration: &Calibration) -> Result<Pair> {
    let form = || format!("--pair {argument}: write name=left,right or name=left,right,projector");
    let (name, members) = argument.split_once('=').with_context(form)?;
    let members: Vec<&str> = members.split(',').collect();
    let (left, right, projector) = match members.as_slice() {
        [left, right] => (*left, *right, ""),
        [left, right, projector] => (*left, *right, *projector),
        _ => bail!(form()),
    };
    for device in [left, right] {
        if calibration.device(device).is_none() {
            let known: Vec<&str> = calibration.devices.iter().map(|d| d.name.as_str()).collect();
            bail!("--pair {argument}: \"{device}\" was not calibrated; known: {}", known.join(", "));
        }
    }
    Ok(Pair {
        name: name.to_owned(),
        left: left.to_owned(),
        right: right.to_owned(),
        projector: projector.to_owned(),
    })
}

/// Writes the covariance, then the rig file that names it.
pub fn write_rig(
    out: &Path,
    calibration: &Calibration,
    pairs: &[(Pair, [usize; 2])],
    sensors: &BTreeMap<String, Characterised>,
    target: &Path,
) -> Result<()> {
    let of = |kind: DeviceKind| -> Vec<Named> {
        let devices = calibration.devices.iter().filter(|d| d.kind == kind);
        devices.map(|d| Named { name: d.name.clone(), camera: d.camera.clone() }).collect()
    };
    let rig = Rig {
        cameras: of(DeviceKind::Camera),
        projectors: of(DeviceKind::Projector),
        pairs: pairs.iter().map(|(p, _)| p.clone()).collect(),
        sensors: sensors.iter().map(|(name, found)| (name.clone(), found.sensor)).collect(),
    };
    let path = covariance_beside(out);
    let file = path.file_name().unwrap_or_default().to_owned();
    files::result::write_json(&path, &covariance(calibration, &rig.sensors))?;
    let sha256 = files::hash::sha256_hex(&files::document::read_bytes(&path, 1 << 30)?);
    let reference = CovarianceRef { file: file.to_string_lossy().into_owned(), sha256 };
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION")).into());
    provenance.insert("target".into(), target.display().to_string().into());
    provenance.insert("sigma0".into(), calibration.sigma0.into());
    for device in &calibration.devices {
        provenance.insert(format!("rms_reprojection_px_{}", device.name), device.rms_reprojection_px.into());
    }
    files::rig_file::write_rig(out, &rig, &provenance, Some(&reference))?;
    Ok(())
}

/// The names of the parameters that the lenses of a calibration have: those beyond the common ones only where one of them is needed.
fn parameters(calibration: &Calibration) -> &'static [&'static str] {
    if calibration.devices.iter().all(|d| d.camera.distortion.kind == LensKind::BrownConrady) {
        &PARAMETERS[..COMMON_PARAMETERS]
    } else {
        &PARAMETERS
    }
}

/// The full matrix, extrinsics relative to the first device.
fn covariance(calibration: &Calibration, sensors: &BTreeMap<String, Sensor>) -> serde_json::Value {
    let parameters = parameters(calibration);
    let behind = PARAMETERS.len() * calibration.devices.len();
    let rows: Vec<usize> = (0..calibration.covariance.size())
        .filter(|row| *row >= behind || row % PARAMETERS.len() < parameters.len())
        .collect();
    let row = |r: &usize| {
        rows.iter().map(|c| calibration.covariance.at(Gauge::FirstDevice, *r, *c)).collect::<Vec<f64>>()
    };
    let devices: Vec<&str> = calibration.devices.iter().map(|d| d.name.as_str()).collect();
    let sensors: BTreeMap<&String, SensorUncertainty> =
        sensors.iter().map(|(name, sensor)| (name, SensorUncertainty::of(sensor))).collect();
    serde_json::json!({
        "format": "fringecell-covariance/1",
        "sensors": sensors,
        "gauge": "the frame of the first device is held",
        "devices": devices,
        "parameters": parameters,
        "matrix": rows.iter().map(row).collect::<Vec<_>>(),
    })
}

/// A line per device, the worst view, and what the rig is worth.
pub fn print(parts: &Parts) {
    let (calibration, observations) = (parts.calibration, parts.observations);
    for d in &calibration.devices {
        let [fx, fy] = d.camera.focal_px;
        let [cx, cy] = d.camera.principal_point_px;
        let u = &d.standard_uncertainty;
        println!(
            "{}: rms {:.4} px, {} views, {} corners, {} rejected; f ({fx:.3}, {fy:.3}) u ({:.3}, {:.3}), c ({cx:.3}, {cy:.3}) \
             u ({:.3}, {:.3}) px",
            d.name, d.rms_reprojection_px, d.views, d.points, d.outliers, u[0], u[1], u[2], u[3]
        );
    }
    if parts.lenses.is_some() {
        println!("lens model of the cameras: {}", super::model::lenses_line(calibration, parts.lenses));
    }
    for face in &calibration.faces {
        let [x, y, z] = face.middle_mm;
        let found = if face.adjusted {
            format!(
                "found {:.4} mm and {:.4}° from where it is declared",
                face.shift_mm,
                face.turn_rad.to_degrees()
            )
        } else {
            "held where it is declared".to_owned()
        };
        println!("face {}: middle at ({x:.4}, {y:.4}, {z:.4}) mm, {found}", face.name);
    }
    if let Some(worst) = calibration.worst_view().map(|i| &calibration.views[i]) {
        let device = &calibration.devices[worst.device].name;
        println!(
            "worst view: {device} in the pose of {}, rms {:.4} px",
            observations.poses[worst.pose], worst.rms_px
        );
    }
    sensors::print(parts.sensors);
    print_outliers(parts);
    validation::print(parts.validation);
    parts.lengths.iter().for_each(lengths::print);
    if let Some(spacing) = parts.spacing {
        println!(
            "predicted standard uncertainty of a sphere spacing over the volume: {:.2} µm rms, {:.2} µm worst",
            spacing.rms_mm * 1e3,
            spacing.worst_mm * 1e3
        );
    }
}

/// Keys that other programs rely on.
pub fn json(parts: &Parts) -> serde_json::Value {
    let (calibration, observations, spacing) = (parts.calibration, parts.observations, parts.spacing);
    let of = |kind: DeviceKind| -> Vec<serde_json::Value> {
        let devices = calibration.devices.iter().filter(|d| d.kind == kind);
        devices
            .map(|d| {
                let mut device = serde_json::json!({
                    "name": d.name,
                    "rms_reprojection_px": d.rms_reprojection_px,
                    "views": d.views,
                    "corners": d.points,
                    "rejected": d.outliers,
                    "focal_px": d.camera.focal_px,
                    "principal_point_px": d.camera.principal_point_px,
                    "lens": d.camera.distortion.kind.name(),
                    "standard_uncertainty": &d.standard_uncertainty[..parameters(calibration).len()],
                });
                if kind == DeviceKind::Camera {
                    device["sensor"] = sensors::json(parts.sensors.get(&d.name));
                }
                device
            })
            .collect()
    };
    let worst = calibration.worst_view().map(|i| &calibration.views[i]);
    serde_json::json!({
        "cameras": of(DeviceKind::Camera),
        "projectors": of(DeviceKind::Projector),
        "worst_view": worst.map(|v| serde_json::json!({
            "device": calibration.devices[v.device].name,
            "pose": observations.poses[v.pose],
            "rms_reprojection_px": v.rms_px,
        })),
        "sphere_spacing_u_mm": spacing.map(|s| s.rms_mm),
        "sphere_spacing_u_worst_mm": spacing.map(|s| s.worst_mm),
        "sigma0": calibration.sigma0,
        "warp": calibration.warp.map(|w| serde_json::json!({ "x_mm": w.x_mm, "y_mm": w.y_mm, "u_mm": w.u_mm })),
        "faces": calibration.faces.iter().map(|face| serde_json::json!({
            "name": face.name,
            "adjusted": face.adjusted,
            "middle_mm": face.middle_mm,
            "shift_mm": face.shift_mm,
            "turn_deg": face.turn_rad.to_degrees(),
        })).collect::<Vec<_>>(),
        "images": calibration.views.iter().map(|v| serde_json::json!({
            "device": calibration.devices[v.device].name,
            "pose": observations.poses[v.pose],
            "rms_reprojection_px": v.rms_px,
            "corners": v.residuals.iter().filter(|r| r.used).count(),
            "rejected": v.residuals.iter().filter(|r| !r.used).count(),
        })).collect::<Vec<_>>(),
        "lens_models": parts.lenses.map(super::model::lenses_json),
        "outliers": outliers(parts),
        "left_out": parts.notes,
        "not_characterised": parts.not_characterised.iter().map(|(name, why)| serde_json::json!({
            "name": name, "why": why,
        })).collect::<Vec<_>>(),
        "held_out": validation::held_json(parts.validation, observations),
        "cross_validation": validation::cross_json(parts.validation),
        "lengths": parts.lengths.iter().map(lengths::json).collect::<Vec<_>>(),
    })
}

/// Each rejected point, largest residual first.
fn outliers(parts: &Parts) -> Vec<serde_json::Value> {
    let columns = parts.shown.columns.max(1) as usize;
    let mut all: Vec<&Outlier> = parts.calibration.outliers.iter().collect();
    all.sort_by(|a, b| length_px(b).total_cmp(&length_px(a)));
    let row = |o: &&Outlier| {
        let view = &parts.observations.views[o.view];
        serde_json::json!({
            "pose": parts.observations.poses[view.pose],
            "device": parts.observations.devices[view.device].name,
            "point": [o.index % columns, o.index / columns],
            "residual_px": o.error_px,
        })
    };
    all.iter().map(row).collect()
}

/// Length of a rejected residual; infinite behind the device.
fn length_px(outlier: &Outlier) -> f64 {
    outlier.error_px.map_or(f64::INFINITY, |[x, y]| (x * x + y * y).sqrt())
}

fn print_outliers(parts: &Parts) {
    let all = &parts.calibration.outliers;
    // Of equal ones the first.
    let Some(worst) = all.iter().rev().max_by(|a, b| length_px(a).total_cmp(&length_px(b))) else {
        return println!("no point rejected");
    };
    let view = &parts.observations.views[worst.view];
    let columns = parts.shown.columns.max(1) as usize;
    println!(
        "{} points rejected; the worst: {} in the pose of {}, point {},{}, off by {:.3} px (all: --json)",
        all.len(),
        parts.observations.devices[view.device].name,
        parts.observations.poses[view.pose],
        worst.index % columns,
        worst.index / columns,
        length_px(worst)
    );
}
