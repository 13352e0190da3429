//! What two fixed views measure together, beside what each of them shows of the drifted view.
//!
//! A partner and the projector that lights it, or two cameras where it is their projector that drifted, fix places in space, which the drifted view
//! must see where it does: across the epipolar line of the partner, which the pair shows already, and along it. Along it a turn, a shift and the focal
//! length differ, where the epipolar lines of both are nearly parallel, as with a projector between two cameras. If one of the two fixed views moved, the places are wrong
//! and would carry the view with them. So their residuals are first asked for a drift of their own beside that of the pairs: where they show
//! one that noise, the error of the phase and the calibration do not explain, they are left out.

use super::HealthError;
use super::along::{AlongRow, along_rows};
use super::calibrated::{Root, Sums};
use super::correct::{PRIOR, phase_error_px};
use super::robust;
use super::settings::HealthSettings;
use super::state::{Partner, UNKNOWNS};
use super::tiles::Tiles;
use crate::chi_square;
use fringe::geometry::camera::Camera;
use fringe::math::linear::{Dense, Factor};

/// Two fixed views that measure places together, and whether these agree with the pairs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThreeViews {
    /// Number of the partner's device.
    pub device: usize,
    /// Number of the other device: the projector, or a second camera.
    pub second: usize,
    /// Number of places that were used.
    pub used: usize,
    /// χ² of a drift that only these places show.
    pub chi2: f64,
    /// Places of views that stayed exceed it with the probability of a false alarm.
    pub limit: f64,
    /// Whether certified lengths agree with the estimate by these places.
    pub lengths_agree: bool,
}

impl ThreeViews {
    /// Whether the places count in the estimate.
    pub fn agrees(&self) -> bool {
        self.chi2 <= self.limit && self.lengths_agree
    }

    /// Whether these are the fixed views of a partner.
    pub(super) fn is_of(&self, partner: &Partner) -> bool {
        partner.lit_by.is_some_and(|(_, device)| (partner.device, device) == (self.device, self.second))
    }
}

/// Adds the residuals along the epipolar lines of a partner with the view in a state; returns how many.
pub(super) fn add_along(
    sums: &mut Sums,
    partner: &Partner,
    view: &Camera,
    settings: &HealthSettings,
) -> usize {
    let Some((second, device)) = partner.lit_by else { return 0 };
    let rows = along_rows(partner.fixed, second, view, partner.matches);
    let Some(fit) = robust::fit(&rows).filter(|_| rows.len() >= settings.least_matches) else { return 0 };
    let kept: Vec<&AlongRow> =
        rows.iter().zip(&fit.kept).filter(|(_, kept)| **kept).map(|(row, _)| row).collect();
    let sharpness: f64 = kept.iter().map(|row| row.sigma_px.powi(-2)).sum();
    let tiles = Tiles::new(&kept, &fit);
    let phase = phase_error_px(&tiles, settings).powi(2) * sharpness / fit.directions.len() as f64;
    let correlation = tiles.correlation.max(fit.scale * fit.scale).max(1.0);
    sums.add(&[partner.device, device], &kept, 1.0 / (correlation + phase));
    kept.len()
}

/// The fixed views whose places agree with the pairs of the view in a state, and those whose places do not.
pub(super) fn three_views(
    partners: &[Partner],
    pairs: Sums,
    view: &Camera,
    root: &Root,
    settings: &HealthSettings,
) -> Result<Vec<ThreeViews>, HealthError> {
    let (mut all, mut trusted) = (Vec::<ThreeViews>::new(), pairs);
    for partner in partners {
        let Some((_, second)) = partner.lit_by else { continue };
        if all.iter().any(|three| three.is_of(partner)) {
            continue;
        }
        let mut three = ThreeViews {
            device: partner.device,
            second,
            used: 0,
            chi2: 0.0,
            limit: 0.0,
            lengths_agree: true,
        };
        let mut sums = trusted.empty();
        let same: Vec<&Partner> = partners.iter().filter(|other| three.is_of(other)).collect();
        for same in same {
            three.used += add_along(&mut sums, same, view, settings);
        }
        if three.used == 0 {
            continue;
        }
        (three.chi2, three.limit) = own_drift(&trusted, &sums, root, settings)?;
        if three.agrees() {
            trusted = trusted.plus(&sums);
        }
        all.push(three);
    }
    Ok(all)
}

/// χ² of a drift that the residuals of `other` show beside the one that they share with `sums`, and its limit.
fn own_drift(
    sums: &Sums,
    other: &Sums,
    root: &Root,
    settings: &HealthSettings,
) -> Result<(f64, f64), HealthError> {
    let (information, right) = sums.with_own_drift_of(other).without_errors(root)?;
    let n = UNKNOWNS;
    let part = |rows: usize, cols: usize| Dense::from_fn(n, n, |i, j| information.at(rows + i, cols + j));
    let (mut shared, cross, own) = (part(0, 0), part(n, 0), part(n, n));
    PRIOR.iter().enumerate().for_each(|(i, prior)| shared.add(i, i, prior.powi(-2)));
    let inverse = Factor::new(&shared).map_err(|_| HealthError::Degenerate)?.inverse();
    let taken = cross.sandwich(&inverse);
    let left = Dense::from_fn(n, n, |i, j| own.at(i, j) - taken.at(i, j));
    let explained = cross.apply(&inverse.apply(&right[..n]));
    let score: Vec<f64> = right[n..].iter().zip(explained).map(|(a, b)| a - b).collect();
    let directions = robust::directions::<UNKNOWNS>(&left);
    let along = |direction: &[f64; UNKNOWNS]| direction.iter().zip(&score).map(|(a, b)| a * b).sum::<f64>();
    let chi2 = directions.iter().map(|direction| along(direction).powi(2)).sum();
    Ok((chi2, chi_square::limit(settings.false_alarm, directions.len().max(1))))
}
