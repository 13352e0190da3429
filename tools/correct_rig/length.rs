//! The baseline of a corrected view, from a length standard in the recording.

use super::{Judge, camera};
use crate::reconstruct::{Method, fused_cloud, surface_settings};
use anyhow::{Result, bail};
use files::plan_file::read_plan;
use files::recording::Recording;
use files::rig_file::RigFile;
use fringe::geometry::camera::Camera;
use metrology::inspection::{Quantity, evaluate};
use nalgebra::Isometry3;
use std::path::Path;

/// Rounds: lengths follow the baseline in proportion, so that the second one only confirms.
const ROUNDS: usize = 2;

/// What the length standard made of the baseline.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub struct Scale {
    /// New baseline over that of the epipolar fit.
    pub factor: f64,
    /// Standard uncertainty of the factor.
    pub u: f64,
}

/// The view with the baseline to its partner that gives the certified lengths.
pub fn scaled(
    plan_path: &Path,
    recording: &Recording,
    judge: &Judge,
    view: &Camera,
    partner: &str,
) -> Result<(Camera, Scale)> {
    let (plan, _) = read_plan(plan_path)?;
    let fixed = camera(&judge.rig_file.rig, partner)?.clone();
    let (mut view, mut whole, mut u) = (view.clone(), 1.0, 0.0);
    for _ in 0..ROUNDS {
        let rig_file = RigFile { rig: judge.rig_with(&view), ..judge.rig_file.clone() };
        let cloud = fused_cloud(recording, &rig_file, Method::Phase, &surface_settings(None))?;
        let result = evaluate(&plan, &cloud);
        let is_length = |index: &usize| matches!(plan.features[*index].quantity, Quantity::CentreDistance(_));
        let found: Vec<(f64, f64, f64)> = (0..plan.features.len())
            .filter(is_length)
            .filter_map(|i| {
                Some((result.features[i].value?, result.features[i].u?, plan.features[i].nominal))
            })
            .collect();
        if found.is_empty() {
            bail!(
                "{}: no distance of centres could be measured in {}: show the length standard to both views, or state its nominal \
                 place more exactly",
                plan_path.display(),
                recording.folder.display()
            );
        }
        let (certified, measured) =
            found.iter().fold((0.0, 0.0), |(c, m), (value, _, nominal)| (c + nominal, m + value));
        let factor = certified / measured;
        u = found.iter().map(|(_, u, _)| u * u).sum::<f64>().sqrt() / certified;
        whole *= factor;
        let view_from_fixed = view.camera_from_world * fixed.camera_from_world.inverse();
        let mut longer: Isometry3<f64> = view_from_fixed;
        longer.translation.vector *= factor;
        view.camera_from_world = longer * fixed.camera_from_world;
    }
    Ok((view, Scale { factor: whole, u }))
}
