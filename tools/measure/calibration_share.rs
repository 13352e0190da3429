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

#[cfg(test)]
mod tests {
    use super::*;
    use files::hash::sha256_hex;
    use files::plan_file::read_plan;
    use files::rig_file::{CovarianceRef, covariance_beside};

    /// Proves: a covariance ten thousand times as large gives a share a hundred times as large, although its modes move the sphere out of its
    /// region; one that moves it whatever part is taken is refused with the feature.
    #[test]
    fn a_share_is_found_however_large_the_covariance_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        let demo = read_rig(&Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/demo-rig.toml")).unwrap();
        let share = |factor: f64| {
            // Of the focal lengths along x of all cameras.
            let size = 2 * demo.rig.cameras.len();
            let variance =
                |i: usize, j: usize| if i == j && i.is_multiple_of(2) { factor * 1e-3 } else { 0.0 };
            let names: Vec<&str> = demo.rig.cameras.iter().map(|camera| camera.name.as_str()).collect();
            let matrix: Vec<Vec<f64>> =
                (0..size).map(|i| (0..size).map(|j| variance(i, j)).collect()).collect();
            let text = serde_json::json!({
                "format": "fringecell-covariance/1", "devices": names, "parameters": PARAMETERS[..2], "matrix": matrix,
            })
            .to_string();
            std::fs::write(covariance_beside(&path), &text).unwrap();
            let reference =
                CovarianceRef { file: "rig.covariance.json".into(), sha256: sha256_hex(text.as_bytes()) };
            let rig_file = RigFile { path: path.clone(), covariance: Some(reference), ..demo.clone() };
            let plan = folder.path().join("ball.plan.toml");
            std::fs::write(
                &plan,
                "format = \"fringecell-plan/1\"\nname = \"ball\"\n[[element]]\nkind = \"sphere\"\nname = \"s\"\n\
                 center_mm = [0.0, 0.0, 0.0]\ndiameter_mm = 20.0\nmargin_mm = 1.0\nmin_points = 10\n[[feature]]\n\
                 kind = \"sphere-diameter\"\nname = \"d\"\nelement = \"s\"\nnominal_mm = 20.0\ntolerance_mm = [-0.1, 0.1]\n",
            )
            .unwrap();
            // Half a sphere that both cameras see, turned about its axis.
            let point = |i: usize| {
                let (z, turn) = (-0.1 - 0.8 * i as f64 / 400.0, 2.4 * i as f64);
                let (sin, cos) = fringe::math::sincos(turn);
                let ring = (1.0 - z * z).sqrt();
                let out = [ring * cos, ring * sin, z];
                Point {
                    position_mm: out.map(|v| 10.0 * v),
                    normal: out.map(|v| v as f32),
                    sigma_mm: 0.01,
                    modulation: 80.0,
                    pair: 0,
                    pixel: 0,
                    shared_mm: 0.0,
                }
            };
            let points: Vec<Point> = (0..400).map(point).collect();
            shares(&read_plan(&plan).unwrap().0, &points, &rig_file)
        };
        let [small, large] = [1e6, 1e10].map(|factor| share(factor).unwrap()[0].unwrap());
        assert!(small > 1e-4 && (0.5..2.0).contains(&(large / small / 100.0)), "{small} mm, {large} mm");
        let refused = share(1e20).unwrap_err().to_string();
        assert!(refused.contains("feature \"d\" so far that it cannot be measured"), "{refused}");
    }
}
