//! The state of a view that explains the epipolar residuals of all its pairs.
//!
//! The residuals answer to rotations, shifts and the focal length of the view (see `rows`); the state that explains them best is found by
//! Gauss–Newton, with what drifts are like as a prior: a direction that the matches do not determine stays where the rig file has
//! it. With one partner the shift along the baseline is such a direction: it only scales lengths, and needs one to be known.

use super::HealthError;
use super::drift::check_pair;
use super::matches::Match;
use super::robust;
use super::rows::{CAUSES, Row, rows};
use super::settings::HealthSettings;
use crate::calibration::{PARAMETERS, moved};
use fringe::geometry::camera::Camera;
use fringe::math::linear::{Dense, Factor};

/// Unknowns: rotations, shifts, focal length, as in [`CAUSES`].
const UNKNOWNS: usize = CAUSES.len();
/// Rounds of Gauss–Newton; drifts are small, so that the second one only confirms.
const ROUNDS: usize = 4;
/// Standard deviation of a drift before anything is seen of it: rad, mm, relative change of the focal length.
const PRIOR: [f64; UNKNOWNS] = [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3, 1e-3];
/// What is held at the rig file's value, against the prior.
const HELD: f64 = 1e-9;

/// A view that did not drift, and the places that it shares with the one that did.
#[derive(Debug, Clone, Copy)]
pub struct Partner<'a> {
    /// The view that counts.
    pub fixed: &'a Camera,
    /// Matches with the partner on the left and the corrected view on the right.
    pub matches: &'a [Match],
}

/// A view as the matches show it.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewCorrection {
    /// The view after the correction.
    pub camera: Camera,
    /// New state less old one: rotations about x, y, z (rad), shifts along them (mm), relative change of the focal length.
    pub drift: [f64; UNKNOWNS],
    /// Covariance of the drift, row by row.
    pub covariance: [[f64; UNKNOWNS]; UNKNOWNS],
}

impl ViewCorrection {
    /// Standard uncertainties of the drift.
    pub fn u(&self) -> [f64; UNKNOWNS] {
        std::array::from_fn(|i| self.covariance[i][i].max(0.0).sqrt())
    }

    /// Covariance of the view's parameters that the correction adds, of the first `count` of [`PARAMETERS`], row by row.
    pub fn parameter_covariance(&self, count: usize) -> Vec<f64> {
        let by = |parameter: usize| -> [f64; UNKNOWNS] {
            let focal = self.camera.focal_px.get(parameter).copied().unwrap_or(0.0);
            let pose = |i: usize| PARAMETERS[parameter] == POSE[i];
            std::array::from_fn(|i| if i < 6 { f64::from(u8::from(pose(i))) } else { focal })
        };
        let product = |k: usize| {
            let (a, b) = (by(k / count), by(k % count));
            let row = |i: usize| a[i] * (0..UNKNOWNS).map(|j| self.covariance[i][j] * b[j]).sum::<f64>();
            (0..UNKNOWNS).map(row).sum()
        };
        (0..count * count).map(product).collect()
    }
}

/// Names of the parameters of the pose, in the order of the unknowns.
const POSE: [&str; 6] = ["rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm"];

/// The state of a view that explains the residuals of all its pairs; without `shifts` only rotations and the focal length change.
///
/// # Errors
/// As [`check_pair`].
pub fn correct_view(
    view: &Camera,
    partners: &[Partner],
    shifts: bool,
    settings: &HealthSettings,
) -> Result<ViewCorrection, HealthError> {
    let mut drift = [0.0; UNKNOWNS];
    let mut information = Dense::zeros(UNKNOWNS, UNKNOWNS);
    let prior: [f64; UNKNOWNS] =
        std::array::from_fn(|i| if shifts || !(3..6).contains(&i) { PRIOR[i] } else { HELD * PRIOR[i] });
    // The covariance of sums over neighbours is larger than that of independent residuals.
    let factors: Vec<f64> = partners
        .iter()
        .map(|p| Ok(check_pair(p.fixed, view, p.matches, None, settings)?.correlation_factor.max(1.0)))
        .collect::<Result<_, HealthError>>()?;
    for _ in 0..ROUNDS {
        let now = stepped(view, &drift);
        information = Dense::from_fn(UNKNOWNS, UNKNOWNS, |i, j| if i == j { prior[i].powi(-2) } else { 0.0 });
        let mut right: Vec<f64> = (0..UNKNOWNS).map(|i| -drift[i] * prior[i].powi(-2)).collect();
        for (partner, factor) in partners.iter().zip(&factors) {
            let rows = rows(partner.fixed, &now, partner.matches);
            let fit = robust::fit(&rows).ok_or(HealthError::Degenerate)?;
            let kept = rows.iter().zip(&fit.kept).filter(|(_, kept)| **kept).map(|(row, _)| row);
            add(&mut information, &mut right, kept, 1.0 / factor);
        }
        let step = Factor::new(&information).map_err(|_| HealthError::Degenerate)?.solve(&right);
        drift.iter_mut().zip(&step).for_each(|(d, s)| *d += s);
    }
    let solved = Factor::new(&information).map_err(|_| HealthError::Degenerate)?;
    let column =
        |j: usize| solved.solve(&(0..UNKNOWNS).map(|i| f64::from(u8::from(i == j))).collect::<Vec<_>>());
    let columns: Vec<Vec<f64>> = (0..UNKNOWNS).map(column).collect();
    let covariance = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
    Ok(ViewCorrection { camera: stepped(view, &drift), drift, covariance })
}

/// Adds the equations of rows.
fn add<'a>(information: &mut Dense, right: &mut [f64], rows: impl Iterator<Item = &'a Row>, weight: f64) {
    for row in rows {
        for (i, a) in row.cause.iter().enumerate() {
            right[i] += weight * a * row.error;
            for (j, b) in row.cause.iter().enumerate() {
                information.add(i, j, weight * a * b);
            }
        }
    }
}

/// A view after a drift.
fn stepped(view: &Camera, drift: &[f64; UNKNOWNS]) -> Camera {
    let mut step = [0.0; PARAMETERS.len()];
    for (parameter, step) in step.iter_mut().enumerate() {
        *step = match POSE.iter().position(|name| *name == PARAMETERS[parameter]) {
            Some(i) => drift[i],
            None if parameter < 2 => drift[6] * view.focal_px[parameter],
            None => 0.0,
        };
    }
    moved(view, &step)
}
