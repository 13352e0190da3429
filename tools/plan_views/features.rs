//! The expected uncertainty of features: the plan on predicted clouds.

use super::task::Task;
use crate::measure::calibration_shares;
use crate::progress::Progress;
use anyhow::Result;
use cell::executor::{PairMatcher, Views};
use files::footprints_off::FootprintsOff;
use fringe::cloud::Point;
use fringe::fusion::Fuser;
use fringe::geometry::rig::pictures;
use fringe::phase::PhaseMap;
use metrology::inspection::{FeatureResult, Plan, Unit, evaluate};
use serde::Serialize;

/// k of expanded uncertainties.
pub(super) const COVERAGE_FACTOR: f64 = 2.0;

/// A feature as it is expected.
#[derive(Debug, Clone, Serialize)]
pub(super) struct ExpectedFeature {
    pub(super) name: String,
    pub(super) unit: Unit,
    /// Standard uncertainty of noise, calibration and the plan's `u_system`.
    pub(super) u: Option<f64>,
    /// Expanded uncertainty, k · u.
    pub(super) expanded_u: Option<f64>,
    pub(super) u_noise: Option<f64>,
    /// None where the rig names no covariance.
    pub(super) u_calibration: Option<f64>,
    pub(super) u_system: f64,
    /// Expected points behind it.
    pub(super) points: usize,
    /// Why it cannot be measured.
    pub(super) reason: Option<String>,
}

/// The expected features of the plan; `None` without one.
pub(super) fn features(task: &Task, trials: u32) -> Result<Option<Vec<ExpectedFeature>>> {
    let Some((plan, _)) = &task.plan else { return Ok(None) };
    let lit = (0..task.planner.pairs().len()).any(|pair| task.planner.is_lit(pair));
    if !lit {
        let reason = "the rig states no projector, so that the light is not known";
        return Ok(Some(plan.features.iter().map(|f| unknown(f, reason.to_owned())).collect()));
    }
    let (found, first) = trials_of(task, plan, trials)?;
    let shares = if task.rig_file.covariance.is_some() {
        Some(calibration_shares(plan, &first, &task.rig_file, &FootprintsOff::new())?)
    } else {
        None
    };
    let feature = |index: usize| {
        let results = found.iter().map(|features| &features[index]);
        expected(&plan.features[index], results, shares.as_ref().and_then(|shares| shares[index]))
    };
    Ok(Some((0..plan.features.len()).map(feature).collect()))
}

fn unknown(feature: &metrology::inspection::Feature, reason: String) -> ExpectedFeature {
    ExpectedFeature {
        name: feature.name.clone(),
        unit: feature.quantity.unit(),
        u: None,
        expanded_u: None,
        u_noise: None,
        u_calibration: None,
        u_system: feature.u_system,
        points: 0,
        reason: Some(reason),
    }
}

/// Root mean square over the trials; a feature that one of them could not measure has no uncertainty.
fn expected<'a>(
    feature: &metrology::inspection::Feature,
    results: impl Iterator<Item = &'a FeatureResult>,
    u_calibration: Option<f64>,
) -> ExpectedFeature {
    let (mut squares, mut points, mut count) = (0.0, 0, 0);
    for result in results {
        let Some(u) = result.u_noise else {
            let reason = result.reason.clone().unwrap_or_else(|| "not measured".to_owned());
            return unknown(feature, reason);
        };
        squares += u * u;
        points += result.points;
        count += 1;
    }
    let trials = f64::from(count.max(1));
    let u_noise = (squares / trials).sqrt();
    let calibration = u_calibration.unwrap_or(0.0);
    let u = (u_noise * u_noise + calibration * calibration + feature.u_system * feature.u_system).sqrt();
    ExpectedFeature {
        u: Some(u),
        expanded_u: Some(COVERAGE_FACTOR * u),
        u_noise: Some(u_noise),
        u_calibration,
        points: points / count.max(1) as usize,
        reason: None,
        ..unknown(feature, String::new())
    }
}

/// The features of each trial, and the cloud of the first.
fn trials_of(task: &Task, plan: &Plan, trials: u32) -> Result<(Vec<Vec<FeatureResult>>, Vec<Point>)> {
    let rig = &task.rig_file.rig;
    let lit: Vec<usize> = (0..rig.pairs.len()).filter(|pair| task.planner.is_lit(*pair)).collect();
    let mut progress = Progress::new(lit.len() * trials as usize, "predicting clouds");
    let mut matchers = lit
        .iter()
        .map(|pair| PairMatcher::new(rig, &rig.pairs[*pair], *pair, &task.settings.matching))
        .collect::<Result<Vec<_>, _>>()?;
    let mut fuser = Fuser::of_pictures(pictures(lit.iter().map(|pair| &rig.pairs[*pair])));
    let (mut first, mut results) = (Vec::new(), Vec::new());
    let plan = plan.clone().with_viewpoints(rig.viewpoints(&rig.pairs));
    for trial in 0..trials {
        let mut clouds = Vec::new();
        for (pair, matcher) in lit.iter().zip(&mut matchers) {
            let Some([left, right]) = task.planner.phases(*pair, u64::from(trial)) else {
                clouds.push(Vec::new());
                continue;
            };
            let (points, _) = matcher.cloud(
                &Views::of(left.iter().map(PhaseMap::view)),
                &Views::of(right.iter().map(PhaseMap::view)),
            )?;
            clouds.push(points);
            progress.step();
        }
        let clouds: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
        let mut fused = Vec::new();
        fuser.fuse(&clouds, &task.settings.fusion, &mut fused);
        results.push(evaluate(&plan, &fused).features);
        if trial == 0 {
            first = fused;
        }
    }
    Ok((results, first))
}
