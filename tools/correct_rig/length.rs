//! Certified lengths in the recordings, as the view in the state of the estimate measures them.

use super::shown::Shown;
use super::{Args, Judge};
use crate::reconstruct::{DecodedRecording, Method, surface_settings};
use anyhow::{Result, bail};
use characterise::health::{KNOWN_LENGTH, LengthReading, ViewEstimate};
use files::rig_file::RigFile;
use fringe::geometry::camera::Camera;
use metrology::inspection::{Plan, Quantity, evaluate};
use std::collections::BTreeSet;

/// A measured length this many standard uncertainties from the certified one is wrong; the calibration adds to them what a good one leaves.
const WRONG: f64 = 3.5;

/// The certified lengths that the rig as it is does not measure within their uncertainty, in words.
///
/// # Errors
/// As [`readings`].
pub fn wrong(args: &Args, shown: &[Shown], rig_file: &RigFile) -> Result<Vec<String>> {
    let (mut wrong, mut measured) = (Vec::new(), 0);
    for shown in shown {
        let Some(plan) = &shown.plan else { continue };
        let decoded = decoded(shown, rig_file)?;
        for (feature, found) in plan.features.iter().zip(lengths(plan, &decoded, rig_file)?) {
            let Some((value, u)) = found else { continue };
            let error_mm = value - feature.nominal;
            let u_mm = u.hypot(feature.u_system).hypot(KNOWN_LENGTH * feature.nominal);
            measured += 1;
            if error_mm.abs() > WRONG * u_mm {
                wrong.push(format!(
                    "{}: \"{}\" measures {value:.4} mm, certified are {:.4} mm: {:+.1} µm, where {:.1} µm would be allowed",
                    shown.recording.folder.display(),
                    feature.name,
                    feature.nominal,
                    1e3 * error_mm,
                    1e3 * WRONG * u_mm
                ));
            }
        }
    }
    if measured == 0 {
        refuse_unmeasured(args, shown)?;
    }
    Ok(wrong)
}

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
    if found.iter().all(Vec::is_empty) {
        refuse_unmeasured(args, shown)?;
    }
    Ok(found)
}

/// Refuses plans of which nothing was measured.
fn refuse_unmeasured(args: &Args, shown: &[Shown]) -> Result<()> {
    if let Some(path) = args.length.first() {
        let folders: Vec<String> =
            shown.iter().map(|shown| shown.recording.folder.display().to_string()).collect();
        bail!(
            "{}: no distance of centres could be measured in {}: show the length standard to both views, or state its nominal place \
             more exactly (`fringetool place` finds it in a cloud)",
            path.display(),
            folders.join(", ")
        );
    }
    Ok(())
}

fn decoded(shown: &Shown, rig_file: &RigFile) -> Result<DecodedRecording> {
    DecodedRecording::new(&shown.recording, rig_file, Method::Phase, &surface_settings(None))
}

fn readings_of(
    plan: &Plan,
    shown: &Shown,
    judge: &Judge,
    estimate: &ViewEstimate,
) -> Result<Vec<LengthReading>> {
    let certified: Vec<(f64, f64)> =
        plan.features.iter().map(|feature| (feature.nominal, feature.u_system)).collect();
    let decoded = decoded(shown, judge.rig_file)?;
    let seen = |view: &Camera| RigFile { rig: judge.rig_with(view), ..judge.rig_file.clone() };
    estimate.readings(&certified, |view| lengths(plan, &decoded, &seen(view)))
}

/// Certified lengths of the plans whose certificate's uncertainty is not stated, in words, each once.
pub fn exact(shown: &[Shown]) -> Vec<String> {
    let of = |shown: &Shown| -> Vec<String> {
        let (Some(plan), Some(text)) = (&shown.plan, &shown.plan_text) else { return Vec::new() };
        let exact =
            plan.features.iter().filter(|feature| is_length(&feature.quantity) && feature.u_system == 0.0);
        let warning = |name: &str| {
            format!(
                "{}: feature \"{name}\" has no u_system_mm, so that its certified length counts as exact; state the standard \
                 uncertainty of its certificate",
                text.path.display()
            )
        };
        exact.map(|feature| warning(&feature.name)).collect()
    };
    shown.iter().flat_map(of).collect::<BTreeSet<_>>().into_iter().collect()
}

fn is_length(quantity: &Quantity) -> bool {
    matches!(quantity, Quantity::CentreDistance(_))
}

/// Of each feature its value and standard uncertainty by the scatter of its points, mm; `None` for what is no distance of centres, and what was not measured.
fn lengths(plan: &Plan, decoded: &DecodedRecording, rig_file: &RigFile) -> Result<Vec<Option<(f64, f64)>>> {
    let cloud = decoded.cloud(rig_file)?;
    let result = evaluate(plan, &cloud);
    let one = |index: usize| {
        let found = &result.features[index];
        is_length(&plan.features[index].quantity).then_some((found.value?, found.u_noise?))
    };
    Ok((0..plan.features.len()).map(one).collect())
}
