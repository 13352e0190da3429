//! A rig without a calibration target: what two axes of coordinates determine of camera and projector.

use crate::pipeline::{DecodedView, decode_views};
use anyhow::Result;
use characterise::self_calibration::{BASELINE_MM, Correspondence, SelfCalibration, self_calibrate};
use files::recording::Recording;
use files::rig_file::write_rig;
use fringe::geometry::rig::{Named, Pair, Rig};
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use nalgebra::Point2;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::Path;

/// Calibrates each camera with its projector where both axes were projected, and writes the rig up to scale; a refusal is told and no
/// failure.
pub fn write(folder: &Path) -> Result<Vec<Value>> {
    let recording = Recording::open(folder)?;
    let Ok(views) =
        decode_views(&recording, &fringe::decode::DecodeSettings::default(), &BTreeMap::new(), |_, _| true)
    else {
        return Ok(Vec::new());
    };
    let mut results = Vec::new();
    for view in &views {
        let map = |axis| view.maps.iter().map(|decoded| &decoded.map).find(|map| map.info.axis == axis);
        let (Some(x), Some(y)) = (map(Axis::X), map(Axis::Y)) else { continue };
        let Some(projector) = recording.projectors.iter().find(|p| p.name == view.projector) else {
            continue;
        };
        let camera_px = [x.info.width_px, x.info.height_px];
        let found =
            self_calibrate(&correspondences(x, y), camera_px, [projector.width_px, projector.height_px]);
        let pair = format!("camera \"{}\" and projector \"{}\"", view.camera, view.projector);
        match found {
            Ok(found) => {
                print(&pair, &found);
                let path = folder.join(format!("{}-{}-rig.toml", view.projector, view.camera));
                write_rig(&path, &rig(view, &found), &provenance(&found), None)?;
                println!(
                    "  {}: the rig up to scale; next: fringetool reconstruct {} --rig {0}",
                    path.display(),
                    folder.display()
                );
                results.push(result(view, &found, &path));
            }
            Err(why) => {
                println!("\n{pair}: no self-calibration: {why}");
                results.push(
                    json!({ "camera": view.camera, "projector": view.projector, "refused": why.to_string() }),
                );
            }
        }
    }
    Ok(results)
}

/// Projector coordinates of each pixel that has both.
fn correspondences(x: &PhaseMap, y: &PhaseMap) -> Vec<Correspondence> {
    let width = x.info.width_px as usize;
    let pixels = (0..x.valid.len()).filter(|pixel| x.valid[*pixel] == 1 && y.valid[*pixel] == 1);
    let at = |map: &PhaseMap, pixel: usize| f64::from(map.phase_rad[pixel]) * map.info.period_px / TAU;
    let sigma =
        |map: &PhaseMap, pixel: usize| (f64::from(map.sigma_rad[pixel]) * map.info.period_px / TAU).max(1e-4);
    pixels
        .map(|pixel| Correspondence {
            camera: Point2::new((pixel % width) as f64, (pixel / width) as f64),
            projector: Point2::new(at(x, pixel), at(y, pixel)),
            sigma_px: [sigma(x, pixel), sigma(y, pixel)],
        })
        .collect()
}

fn print(pair: &str, found: &SelfCalibration) {
    println!(
        "\n{pair}, from the recording alone (no distortion, square pixels, principal points in the middle):"
    );
    for (name, focal) in ["camera", "projector"].iter().zip(&found.focal) {
        println!(
            "  {name}: f {:.1} px, u {:.1} px by noise, {:.1} px by the assumed principal points",
            focal.px, focal.u_noise_px, focal.u_centres_px
        );
    }
    println!(
        "  optical axes {:.2}° apart; {} correspondences, {} contradict; {:.3} px from their epipolar lines, {:.1} px from a plane",
        found.angle_rad.to_degrees(),
        found.used,
        found.outliers,
        found.residual_px,
        found.relief_px
    );
}

fn rig(view: &DecodedView, found: &SelfCalibration) -> Rig {
    let named = |name: &str, camera: &fringe::geometry::camera::Camera| Named {
        name: name.to_owned(),
        camera: camera.clone(),
    };
    Rig {
        cameras: vec![named(&view.camera, &found.camera)],
        projectors: vec![named(&view.projector, &found.projector)],
        pairs: vec![Pair {
            name: "pair1".into(),
            left: view.camera.clone(),
            right: view.projector.clone(),
            projector: view.projector.clone(),
        }],
        ..Rig::default()
    }
}

fn provenance(found: &SelfCalibration) -> toml::Table {
    let mut table = toml::Table::new();
    table.insert("source".into(), "self-calibration, up to scale".into());
    table.insert("assumed_baseline_mm".into(), BASELINE_MM.into());
    table.insert("assumed".into(), "no distortion, square pixels, principal points in the middle".into());
    for (name, focal) in ["camera", "projector"].iter().zip(&found.focal) {
        table.insert(format!("u_focal_noise_px_{name}"), focal.u_noise_px.into());
        table.insert(format!("u_focal_centres_px_{name}"), focal.u_centres_px.into());
    }
    table
}

fn result(view: &DecodedView, found: &SelfCalibration, path: &Path) -> Value {
    let focal = |i: usize| {
        let f = &found.focal[i];
        json!({ "px": f.px, "u_noise_px": f.u_noise_px, "u_centres_px": f.u_centres_px })
    };
    json!({
        "camera": view.camera, "projector": view.projector, "rig": path, "focal_camera": focal(0),
        "focal_projector": focal(1), "angle_deg": found.angle_rad.to_degrees(), "used": found.used,
        "contradicting": found.outliers, "residual_px": found.residual_px, "relief_px": found.relief_px,
    })
}
