//! Certified lengths in the recording, as the view in the state of the estimate measures them.

use super::Judge;
use crate::reconstruct::{Method, fused_cloud, surface_settings};
use anyhow::{Result, bail};
use characterise::health::{LengthReading, ViewEstimate};
use files::plan_file::read_plan;
use files::recording::Recording;
use files::rig_file::RigFile;
use fringe::geometry::camera::Camera;
use metrology::inspection::{Plan, Quantity, evaluate};
use std::path::Path;

/// The certified distances of centres of a plan, less the measured ones, with their derivatives.
pub fn readings(
    plan_path: &Path,
    recording: &Recording,
    judge: &Judge,
    estimate: &ViewEstimate,
) -> Result<Vec<LengthReading>> {
    let (plan, _) = read_plan(plan_path)?;
    let certified: Vec<f64> = plan.features.iter().map(|feature| feature.nominal).collect();
    let readings = estimate.readings(&certified, |view| lengths(&plan, recording, judge, view))?;
    if readings.is_empty() {
        bail!(
            "{}: no distance of centres could be measured in {}: show the length standard to both views, or state its nominal place \
             more exactly",
            plan_path.display(),
            recording.folder.display()
        );
    }
    Ok(readings)
}

/// Of each feature its value and standard uncertainty, mm; `None` for what is no distance of centres, and what was not measured.
fn lengths(
    plan: &Plan,
    recording: &Recording,
    judge: &Judge,
    view: &Camera,
) -> Result<Vec<Option<(f64, f64)>>> {
    let rig_file = RigFile { rig: judge.rig_with(view), ..judge.rig_file.clone() };
    let cloud = fused_cloud(recording, &rig_file, Method::Phase, &surface_settings(None))?;
    let result = evaluate(plan, &cloud);
    let one = |index: usize| {
        let is_length = matches!(plan.features[index].quantity, Quantity::CentreDistance(_));
        is_length.then_some((result.features[index].value?, result.features[index].u?))
    };
    Ok((0..plan.features.len()).map(one).collect())
}
