//! Certified lengths in the recordings, as the view in the state of the estimate measures them.

use super::shown::Shown;
use super::{Args, Judge};
use crate::reconstruct::{Clouds, DecodedRecording, Method, surface_settings};
use anyhow::{Result, bail};
use characterise::health::{LengthReading, ViewEstimate};
use files::rig_file::RigFile;
use fringe::cloud::Point;
use fringe::geometry::camera::Camera;
use metrology::inspection::{Feature, Plan, Quantity, evaluate};
use std::collections::BTreeSet;

/// A measured length this many standard uncertainties from the certified one is wrong; the calibration adds to them what a good one leaves.
const WRONG: f64 = 3.5;

/// The certified lengths that the rig in this state does not measure within their uncertainty, in words: with each pair by itself, since pairs that
/// disagree widen the uncertainty of their fused cloud, and with all of them, which may see what no pair sees alone. `open`: what the rig leaves open of
/// lengths, relative standard uncertainty.
///
/// # Errors
/// As [`readings`].
pub fn wrong(args: &Args, shown: &[Shown], (rig_file, open): (&RigFile, f64)) -> Result<Vec<String>> {
    let (mut wrong, mut measured) = (Vec::new(), 0);
    for shown in shown {
        let Some(plan) = &shown.plan else { continue };
        let Clouds { fused, pairs } = decoded(shown, rig_file)?.clouds(rig_file)?;
        let alone = pairs.len() == 1;
        let pairs = pairs.iter().map(|(name, cloud)| (format!("pair \"{name}\""), cloud));
        let all = (!alone).then(|| ("all pairs together".to_owned(), &fused));
        for (seen_by, cloud) in pairs.chain(all) {
            let found = lengths(plan, cloud);
            measured += found.iter().flatten().count();
            let folder = shown.recording.folder.display();
            let off =
                plan.features.iter().zip(found).filter_map(|(feature, found)| off(feature, open, found?));
            wrong.extend(off.map(|off| format!("{folder}: {off}, measured by {seen_by}")));
        }
    }
    if measured == 0 {
        refuse_unmeasured(args, shown)?;
    }
    Ok(wrong)
}

/// What is wrong with a measured length, in words; `None` where it agrees with the certificate.
fn off(certified: &Feature, open: f64, (value, u): (f64, f64)) -> Option<String> {
    let error_mm = value - certified.nominal;
    let u_mm = u.hypot(certified.u_system).hypot(open * certified.nominal);
    (error_mm.abs() > WRONG * u_mm || error_mm.is_nan()).then(|| {
        format!(
            "\"{}\" measures {value:.4} mm, certified are {:.4} mm: {:+.1} µm, where {:.1} µm would be allowed",
            certified.name,
            certified.nominal,
            1e3 * error_mm,
            1e3 * WRONG * u_mm
        )
    })
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
    estimate.readings(&certified, |view| Ok(lengths(plan, &decoded.cloud(&seen(view))?)))
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
fn lengths(plan: &Plan, cloud: &[Point]) -> Vec<Option<(f64, f64)>> {
    let result = evaluate(plan, cloud);
    let one = |index: usize| {
        let found = &result.features[index];
        is_length(&plan.features[index].quantity).then_some((found.value?, found.u_noise?))
    };
    (0..plan.features.len()).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Certified 100 mm, known to 1 µm; the rig leaves 2 µm in 100 mm open.
    #[test]
    fn a_length_is_wrong_beyond_all_its_uncertainties_together() {
        let certified = Feature {
            name: "bar".into(),
            quantity: Quantity::CentreDistance([0, 1]),
            nominal: 100.0,
            lower: 99.9,
            upper: 100.1,
            u_system: 0.001,
            u_calibration: None,
        };
        let off = |open: f64, value: f64, u: f64| off(&certified, open, (value, u));
        // √(1 + 4 + 4) µm · 3.5 = 10.5 µm.
        assert_eq!(off(2e-5, 100.0104, 0.002), None);
        let told = off(2e-5, 99.9894, 0.002).unwrap();
        assert!(told.contains("\"bar\" measures 99.9894 mm") && told.contains("10.5 µm"), "{told}");
        assert_eq!(off(1e-4, 99.9894, 0.002), None, "a rig that leaves more open allows more");
        assert!(off(2e-5, f64::NAN, 0.002).is_some());
    }
}
