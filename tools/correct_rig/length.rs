//! Certified lengths in the recordings, as the view in the state of the estimate measures them.

use super::shown::Shown;
use super::{Args, Judge};
use crate::reconstruct::{DecodedRecording, Method, surface_settings};
use anyhow::{Result, bail};
use characterise::health::{LengthReading, ViewEstimate};
use files::rig_file::RigFile;
use fringe::geometry::camera::Camera;
use metrology::inspection::{Plan, Quantity, evaluate};

/// Of each recording the certified distances of centres of its plan, less the measured ones, with their derivatives.
pub fn readings(
    args: &Args,
    shown: &[Shown],
    judge: &Judge,
    estimate: &ViewEstimate,
) -> Result<Vec<Vec<LengthReading>>> {
    let found = shown
        .iter()
        .map(|shown| match &shown.plan {
            Some(plan) => readings_of(plan, shown, judge, estimate),
            None => Ok(Vec::new()),
        })
        .collect::<Result<Vec<_>>>()?;
    if let Some(path) = args.length.first()
        && found.iter().all(Vec::is_empty)
    {
        let folders: Vec<String> =
            shown.iter().map(|shown| shown.recording.folder.display().to_string()).collect();
        bail!(
            "{}: no distance of centres could be measured in {}: show the length standard to both views, or state its nominal place \
             more exactly",
            path.display(),
            folders.join(", ")
        );
    }
    Ok(found)
}

fn readings_of(
    plan: &Plan,
    shown: &Shown,
    judge: &Judge,
    estimate: &ViewEstimate,
) -> Result<Vec<LengthReading>> {
    let certified: Vec<f64> = plan.features.iter().map(|feature| feature.nominal).collect();
    let decoded =
        DecodedRecording::new(&shown.recording, judge.rig_file, Method::Phase, &surface_settings(None))?;
    estimate.readings(&certified, |view| lengths(plan, &decoded, judge, view))
}

/// Of each feature its value and standard uncertainty, mm; `None` for what is no distance of centres, and what was not measured.
fn lengths(
    plan: &Plan,
    decoded: &DecodedRecording,
    judge: &Judge,
    view: &Camera,
) -> Result<Vec<Option<(f64, f64)>>> {
    let cloud = decoded.cloud(&RigFile { rig: judge.rig_with(view), ..judge.rig_file.clone() })?;
    let result = evaluate(plan, &cloud);
    let one = |index: usize| {
        let is_length = matches!(plan.features[index].quantity, Quantity::CentreDistance(_));
        is_length.then_some((result.features[index].value?, result.features[index].u?))
    };
    Ok((0..plan.features.len()).map(one).collect())
}
