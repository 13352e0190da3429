//! Which model the lenses of the cameras follow, by cross-validation.
//!
//! A richer model always fits its own points better. Here every candidate predicts poses that it was not adjusted to; a
//! richer one is taken where it predicts them better than chance allows, pose by pose.

use super::CalibrationError;
use super::held_out::{HeldOut, hold_out, in_turn};
use super::observations::{DeviceKind, Observations};
use super::settings::{CalibrationSettings, LensFamily, LensModel};

/// Groups of poses that are held out in turn.
const GROUPS: usize = 5;

/// A richer model must lower the squared error of held-out poses by so many of its standard errors over the poses.
const SIGNIFICANT: f64 = 2.0;

/// And by this part: what is less changes no measurement.
const WORTH: f64 = 0.02;

/// A model that was tried.
#[derive(Debug, Clone, PartialEq)]
pub struct TriedLens {
    /// The model as a person calls it.
    pub name: &'static str,
    /// Terms of the cameras' lenses.
    pub model: LensModel,
    /// Root mean squared distance over the cameras' points of held-out poses, px; or why the model was refused.
    pub held_out_px: Result<f64, CalibrationError>,
}

/// The result of the comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct LensChoice {
    /// In the order of their number of terms.
    pub tried: Vec<TriedLens>,
    /// Index of the model that was taken.
    pub chosen: usize,
}

/// The candidates, the poorest first.
fn models() -> [(&'static str, LensModel); 5] {
    let brown = |radial_terms| LensModel { radial_terms, ..LensModel::default() };
    [
        ("brown-conrady", brown(2)),
        ("brown-conrady with k3", brown(3)),
        ("fisheye", LensModel::of(LensFamily::Fisheye)),
        ("rational", LensModel::of(LensFamily::Rational)),
        ("thin-prism", LensModel::of(LensFamily::ThinPrism)),
    ]
}

/// Calibrates with each model and compares how they predict held-out poses; all cameras get the same model.
///
/// # Errors
/// As [`super::calibrate`], of the first model, where none can be calibrated.
pub fn choose_lens(
    observations: &Observations,
    settings: &CalibrationSettings,
) -> Result<LensChoice, CalibrationError> {
    let seen = in_turn(observations, 1).concat().len();
    let groups = in_turn(observations, GROUPS.min(seen));
    let mut tried = Vec::new();
    let mut chosen: Option<(usize, Vec<(f64, usize)>)> = None;
    for (number, (name, model)) in models().into_iter().enumerate() {
        let model = LensModel { skew: settings.camera.skew, ..model };
        let settings = CalibrationSettings { camera: model, ..settings.clone() };
        let held = hold_out(observations, &settings, &groups);
        let held_out_px = held.map(|held| {
            let squares = by_pose(observations, &held);
            let (sum, count) = squares.iter().fold((0.0, 0), |(sum, count), (s, n)| (sum + s, count + n));
            if chosen.as_ref().is_none_or(|(_, other)| is_better(&squares, other)) {
                chosen = Some((number, squares));
            }
            (sum / count.max(1) as f64).sqrt()
        });
        tried.push(TriedLens { name, model, held_out_px });
    }
    match chosen {
        Some((chosen, _)) => Ok(LensChoice { tried, chosen }),
        None => Err(tried.into_iter().find_map(|t| t.held_out_px.err()).unwrap_or(CalibrationError::Empty)),
    }
}

/// Sum of squared distances over the cameras' points of each pose, px², and their number. Rejected points count with the worst
/// that was accepted: a model must not win by rejecting what it cannot predict.
fn by_pose(observations: &Observations, held: &HeldOut) -> Vec<(f64, usize)> {
    let mut squares = vec![(0.0, 0); observations.poses.len()];
    for view in held.folds.iter().flat_map(|fold| &fold.views) {
        if observations.devices[view.device].kind != DeviceKind::Camera {
            continue;
        }
        let square = |error: &[f64; 2]| error[0] * error[0] + error[1] * error[1];
        let used = || view.residuals.iter().filter(|r| r.used).filter_map(|r| r.error_px.as_ref());
        let worst = used().map(square).fold(0.0, f64::max);
        let (sum, count) = &mut squares[view.pose];
        *sum += used().map(square).sum::<f64>();
        *sum += worst * view.residuals.iter().filter(|r| !r.used).count() as f64;
        *count += view.residuals.len();
    }
    squares
}

/// Whether the first predicts the poses better than the second, beyond chance and by what is worth it.
fn is_better(squares: &[(f64, usize)], other: &[(f64, usize)]) -> bool {
    let both = || squares.iter().zip(other).filter(|((_, n), (_, m))| *n > 0 && *m > 0);
    let mean = |of: (f64, usize)| of.0 / of.1.max(1) as f64;
    let gains: Vec<f64> = both().map(|(a, b)| mean(*b) - mean(*a)).collect();
    let poses = gains.len().max(1) as f64;
    let gain = gains.iter().sum::<f64>() / poses;
    let before = both().map(|(_, b)| mean(*b)).sum::<f64>() / poses;
    let variance = gains.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / (poses - 1.0).max(1.0);
    // The error of a prediction is squared here: twice the part.
    gain > 2.0 * WORTH * before && gain > SIGNIFICANT * (variance / poses).sqrt()
}
