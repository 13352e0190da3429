//! What a drift of the right view would do to the residuals, and whether they show one.

use super::matches::Match;
use super::parameters::PairCovariance;
use super::rows::{CAUSES, PairRow, UNKNOWNS, rows};
use super::settings::HealthSettings;
use super::tiles::Tiles;
use super::{HealthError, robust};
use crate::chi_square;
use fringe::geometry::camera::Camera;
use fringe::math::linear::{Dense, Factor};

/// A cause whose effect is this small against that of the most visible one of its unit cannot be seen.
const VISIBLE: f64 = 1e-3;

/// One cause by itself.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Cause {
    /// Of the right view in its own frame: x right, y down, z forward.
    pub name: &'static str,
    /// `rad`, `mm` or `1` (relative change).
    pub unit: &'static str,
    /// How much of it explains the residuals best, in that unit: the true state less the rig file's.
    pub value: f64,
    /// Standard uncertainty by phase noise, phase error and calibration, in that unit.
    pub u: f64,
    /// The same by the phase noise alone.
    pub u_noise: f64,
    /// Fraction of what the joint fit explains that this cause alone explains.
    pub explains: f64,
}

/// Joint fit of the drifts of a pair.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Drift {
    /// Root mean square of the fitted drift over the matches, px.
    pub rms_px: f64,
    /// The same at which the test would just fail, for a drift of this shape, px.
    pub limit_px: f64,
    /// Score test: χ² of [`Self::degrees_of_freedom`] in a healthy rig.
    pub statistic: f64,
    /// A healthy pair exceeds this with the false alarm probability.
    pub limit: f64,
    /// Number of independent drifts that the matches determine.
    pub degrees_of_freedom: usize,
    /// Each cause by itself, the best one first.
    pub causes: Vec<Cause>,
}

/// The state of a pair.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct PairHealth {
    /// Number of matches used.
    pub used: usize,
    /// Matches rejected: farther from the fitted drift than the others' scatter.
    pub rejected: usize,
    /// Mean of the signed residuals used, px.
    pub mean_px: f64,
    /// Root mean square of the residuals used, px.
    pub rms_px: f64,
    /// Root mean square of what the fitted drift leaves, px.
    pub rms_after_px: f64,
    /// Root mean square that the phase noise predicts, px.
    pub predicted_px: f64,
    /// Scatter after the fit over the predicted one (robust).
    pub noise_factor: f64,
    /// By how much the variance of sums over neighbours exceeds that of independent residuals.
    pub correlation_factor: f64,
    /// Root mean square of the smooth pattern that the fit leaves (means over tiles, noise taken out), px.
    pub pattern_px: f64,
    /// Largest such pattern of a healthy pair: twice the phase error, and what the calibration leaves open, px.
    pub pattern_limit_px: f64,
    /// Whether the calibration's covariance entered the limit.
    pub with_covariance: bool,
    /// The fit and its test.
    pub drift: Drift,
    /// No drift beyond its limit, and no pattern beyond its own.
    pub healthy: bool,
}

/// Checks a pair by the places that both views have in common.
///
/// # Errors
/// Impossible cameras or settings, too few matches, or matches that determine no drift.
pub fn check_pair(
    left: &Camera,
    right: &Camera,
    matches: &[Match],
    covariance: Option<&PairCovariance>,
    settings: &HealthSettings,
) -> Result<PairHealth, HealthError> {
    settings.check()?;
    for (side, camera) in [("left", left), ("right", right)] {
        camera.check().map_err(|source| HealthError::Camera { side, source })?;
    }
    let covariance = covariance.map(|c| Ok((c.places()?, c))).transpose()?;
    let rows = rows(left, right, matches);
    if rows.len() < settings.least_matches {
        return Err(HealthError::TooFew { found: rows.len(), needed: settings.least_matches });
    }
    let fit = robust::fit(&rows).ok_or(HealthError::Degenerate)?;
    let kept: Vec<&PairRow> =
        rows.iter().zip(&fit.kept).filter(|(_, kept)| **kept).map(|(row, _)| row).collect();
    let test =
        Test::new(&kept, &fit, covariance.as_ref().map(|(places, c)| (places.as_slice(), *c)), settings);
    let drift = test.drift(&kept, &fit, settings).ok_or(HealthError::Degenerate)?;
    let (pattern_px, pattern_limit_px) = (test.tiles.pattern_px(), test.pattern_limit_px(&kept, settings));
    let mean =
        |value: &dyn Fn(&PairRow) -> f64| kept.iter().map(|row| value(row)).sum::<f64>() / kept.len() as f64;
    Ok(PairHealth {
        used: kept.len(),
        rejected: rows.len() - kept.len(),
        mean_px: mean(&|row| row.error * row.sigma_px),
        rms_px: mean(&|row| (row.error * row.sigma_px).powi(2)).sqrt(),
        rms_after_px: mean(&|row| ((row.error - fit.modelled(row)) * row.sigma_px).powi(2)).sqrt(),
        predicted_px: mean(&|row| row.sigma_px.powi(2)).sqrt(),
        noise_factor: fit.scale,
        correlation_factor: test.correlation(),
        with_covariance: covariance.is_some(),
        pattern_px,
        pattern_limit_px,
        healthy: drift.statistic <= drift.limit && pattern_px <= pattern_limit_px,
        drift,
    })
}

/// What the score test needs.
struct Test {
    /// Weighted sum of derivatives times residuals, Σ a e.
    score: [f64; UNKNOWNS],
    /// What the fit leaves, part by part of the image.
    tiles: Tiles,
    /// Robust variance of a residual over the predicted one.
    scatter: f64,
    /// Phase error: its share in the variance of the scores, over that of unit noise.
    phase_error: f64,
    /// Calibration: (parameters' covariance, places of the parameters).
    covariance: Option<(Dense, Vec<usize>)>,
}

/// A pattern of twice the phase error is still one: the root mean square of few independent parts scatters.
const PATTERN: f64 = 2.0;

impl Test {
    fn new(
        kept: &[&PairRow],
        fit: &robust::Fit<UNKNOWNS>,
        covariance: Option<(&[usize], &PairCovariance)>,
        settings: &HealthSettings,
    ) -> Self {
        let mut score = [0.0; UNKNOWNS];
        for row in kept {
            score.iter_mut().zip(row.by).for_each(|(sum, by)| *sum += by * row.error);
        }
        let weights: f64 = kept.iter().map(|row| row.sigma_px.powi(-2)).sum();
        Self {
            score,
            tiles: Tiles::new(kept, fit),
            scatter: fit.scale * fit.scale,
            phase_error: settings.phase_error_px.powi(2) * weights / fit.directions.len() as f64,
            covariance: covariance.map(|(places, c)| {
                let n = places.len();
                (Dense::from_fn(n, n, |i, j| c.matrix[i * n + j]), places.to_vec())
            }),
        }
    }

    /// Variance of sums of residuals over that of independent ones with the predicted noise.
    fn correlation(&self) -> f64 {
        self.tiles.correlation.max(self.scatter)
    }

    /// Root mean square of the pattern that phase error and calibration allow, px.
    fn pattern_limit_px(&self, kept: &[&PairRow], settings: &HealthSettings) -> f64 {
        let phase = (PATTERN * settings.phase_error_px).powi(2);
        let Some((covariance, places)) = &self.covariance else { return phase.sqrt() };
        let variance = |row: &PairRow| {
            let by: Vec<f64> = places.iter().map(|place| row.file[*place] * row.sigma_px).collect();
            by.iter().zip(covariance.apply(&by)).map(|(a, b)| a * b).sum::<f64>()
        };
        let calibration = kept.iter().map(|row| variance(row)).sum::<f64>() / kept.len() as f64;
        (phase + calibration.max(0.0)).sqrt()
    }

    /// Covariance of the sums Σ b e of given derivatives b: noise, phase error, calibration.
    fn score_covariance<const N: usize>(
        &self,
        kept: &[&PairRow],
        by: impl Fn(&PairRow) -> [f64; N],
    ) -> (Dense, Dense) {
        let mut noise = Dense::zeros(N, N);
        for row in kept {
            let b = by(row);
            for i in 0..N {
                for j in 0..N {
                    noise.add(i, j, b[i] * b[j]);
                }
            }
        }
        let factor = self.correlation() + self.phase_error;
        let mut all = Dense::from_fn(N, N, |i, j| factor * noise.at(i, j));
        if let Some((covariance, places)) = &self.covariance {
            let mut cross = Dense::zeros(N, places.len());
            for row in kept {
                let b = by(row);
                for (i, b) in b.iter().enumerate() {
                    for (j, place) in places.iter().enumerate() {
                        cross.add(i, j, b * row.file[*place]);
                    }
                }
            }
            all = all.plus(&cross.sandwich(covariance));
        }
        (noise, all)
    }

    fn drift(
        &self,
        kept: &[&PairRow],
        fit: &robust::Fit<UNKNOWNS>,
        settings: &HealthSettings,
    ) -> Option<Drift> {
        let directions = Dense::from_fn(fit.directions.len(), UNKNOWNS, |i, j| fit.directions[i][j]);
        let (_, covariance) = self.score_covariance(kept, |row| row.by);
        let score = directions.apply(&self.score);
        let solved = Factor::new(&directions.sandwich(&covariance)).ok()?.solve(&score);
        let statistic: f64 = score.iter().zip(&solved).map(|(a, b)| a * b).sum();
        let degrees_of_freedom = score.len();
        let limit = chi_square::limit(settings.false_alarm, degrees_of_freedom);
        let squares: f64 = kept.iter().map(|row| (fit.modelled(row) * row.sigma_px).powi(2)).sum();
        let rms_px = (squares / kept.len() as f64).sqrt();
        Some(Drift {
            rms_px,
            limit_px: rms_px * (limit / statistic.max(1e-300)).sqrt(),
            statistic,
            limit,
            degrees_of_freedom,
            causes: self.causes(kept, fit),
        })
    }

    /// Each cause by itself; the one that explains most comes first.
    fn causes(&self, kept: &[&PairRow], fit: &robust::Fit<UNKNOWNS>) -> Vec<Cause> {
        let (noise, all) = self.score_covariance(kept, |row| row.cause);
        let explained: f64 = fit.drift.iter().zip(self.score).map(|(a, b)| a * b).sum();
        let strongest = (3..6).map(|i| noise.at(i, i)).fold(0.0, f64::max);
        let mut causes: Vec<Cause> = CAUSES
            .iter()
            .enumerate()
            .filter(|(i, _)| noise.at(*i, *i) > 0.0)
            .filter(|(i, (_, unit))| *unit != "mm" || noise.at(*i, *i) > VISIBLE * VISIBLE * strongest)
            .map(|(i, (name, unit))| {
                let score: f64 = kept.iter().map(|row| row.cause[i] * row.error).sum();
                let information = noise.at(i, i);
                Cause {
                    name,
                    unit,
                    value: score / information,
                    u: all.at(i, i).sqrt() / information,
                    u_noise: (self.correlation() / information).sqrt(),
                    explains: score * score / information / explained.max(1e-300),
                }
            })
            .collect();
        causes.sort_by(|a, b| b.explains.total_cmp(&a.explains));
        causes
    }
}
