//! What the calibration of the rig adds to the uncertainty of each feature.

use anyhow::{Context, Result, bail};
use characterise::calibration::{PARAMETERS, modes};
use files::rig_file::{RigFile, read_rig};
use fringe::cloud::Point;
use metrology::inspection::{InspectionResult, Plan, evaluate};
use rayon::prelude::*;
use std::path::Path;

/// Parts of a mode that are tried, the whole one first.
const PARTS: [f64; 4] = [1.0, 0.1, 0.01, 0.001];

/// The result with the calibration's share in each uncertainty and verdict, and these shares in the order of the features, each in the
/// unit of its feature; none where it was not measured.
pub fn with_calibration(
    plan: &Plan,
    points: &[Point],
    rig: &Path,
) -> Result<(InspectionResult, Vec<Option<f64>>, RigFile)> {
    let rig_file = read_rig(rig)?;
    let shares = shares(plan, points, &rig_file)?;
    // The verdict of the plan with the share beside its own u_system.
    let mut judged = plan.clone();
    for (feature, share) in judged.features.iter_mut().zip(&shares) {
        let share = share.unwrap_or(0.0);
        feature.u_system = (feature.u_system * feature.u_system + share * share).sqrt();
    }
    let mut result = evaluate(&judged, points);
    for (found, stated) in result.features.iter_mut().zip(&plan.features) {
        found.u_system = stated.u_system;
    }
    Ok((result, shares, rig_file))
}

/// Root of the sum of squares over the modes of the covariance, for each feature.
pub fn shares(plan: &Plan, points: &[Point], rig_file: &RigFile) -> Result<Vec<Option<f64>>> {
    let path = rig_file.path.display();
    let Some(covariance) = rig_file.read_covariance()? else {
        bail!("{path}: names no covariance; `fringetool calibrate` writes one beside the rig file");
    };
    let count = covariance.parameters.len();
    if covariance.parameters[..] != PARAMETERS[..count.min(PARAMETERS.len())] {
        bail!(
            "{}: parameters: other ones than {}; calibrate again",
            covariance.path.display(),
            PARAMETERS.join(", ")
        );
    }
    let (pairs, most) = (rig_file.rig.pairs.len(), points.iter().map(|point| point.pair).max().unwrap_or(0));
    if most as usize >= pairs {
        bail!(
            "{path}: the cloud has points of pair {}, the rig has {pairs}: it is another rig's cloud",
            most + 1
        );
    }
    let names: Vec<&str> = covariance.devices.iter().map(String::as_str).collect();
    let matrix = covariance.part(&names).unwrap_or_default();
    let values = |points: &[Point]| -> Vec<Option<f64>> {
        evaluate(plan, points).features.iter().map(|feature| feature.value).collect()
    };
    let here = values(points);
    let mut shares = vec![None; here.len()];
    // A mode so large that a feature is lost says nothing of it; a part of the mode does.
    for part in PARTS {
        let open = |index: &usize| here[*index].is_some() && shares[*index].is_none();
        let open: Vec<usize> = (0..here.len()).filter(open).collect();
        if open.is_empty() {
            break;
        }
        let smaller: Vec<f64> = matrix.iter().map(|value| value * part * part).collect();
        let modes = modes(&rig_file.rig, &covariance.devices, count, &smaller).with_context(|| {
            format!("{path}: a pair has a view that {} does not hold", covariance.path.display())
        })?;
        let moved: Vec<Vec<Option<f64>>> = modes.par_iter().map(|mode| values(&mode.moved(points))).collect();
        for index in open {
            let by = |moved: &Vec<Option<f64>>| Some(((moved[index]? - here[index]?) / part).powi(2));
            shares[index] = moved.iter().map(by).sum::<Option<f64>>().map(f64::sqrt);
        }
    }
    if let Some(lost) = (0..here.len()).find(|index| here[*index].is_some() && shares[*index].is_none()) {
        bail!(
            "{}: moves the points of feature \"{}\" so far that it cannot be measured any more, so that its uncertainty is not known; \
             calibrate again",
            covariance.path.display(),
            plan.features[lost].name
        );
    }
    Ok(shares)
}
