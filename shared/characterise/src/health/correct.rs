//! The state of a view that explains the epipolar residuals of all its pairs.
//!
//! The residuals answer to rotations, shifts and the focal length of the view (see `rows`). All seven are estimated together by
//! Gauss–Newton, with what drifts are like as a prior: a direction that the matches do not determine stays where the rig file has
//! it. The errors of the calibration are estimated with them (see `calibrated`), so that the covariance of the estimate holds the phase
//! noise, the error of the phase itself and the calibration's covariance, as the test of [`check_pair`] does; the error of the phase is no more than the pattern that the fit leaves allows. Which of the seven really changed is chosen afterwards, see `choice`.
//! Places that a partner measures with the projector that lights it enter after the pairs, where they agree with these, see `three`.

use super::HealthError;
use super::calibrated::{Root, Sums, ViewCovariance};
use super::choice::KNOWN_LENGTH;
use super::drift::check_pair;
use super::lengths::length_form;
use super::robust;
use super::rows::{PairRow, rows};
use super::settings::HealthSettings;
use super::state::{Partner, UNKNOWNS, stepped};
use super::three::{ThreeViews, add_along, three_views};
use super::tiles::Tiles;
use super::volume;
use crate::chi_square;
use fringe::geometry::camera::Camera;
use fringe::math::linear::{Dense, Factor, dot};
use nalgebra::Vector3;

/// Rounds of Gauss–Newton; drifts are small, so that the second one only confirms.
const ROUNDS: usize = 4;
/// The same from the estimate by the pairs, which is near.
const ROUNDS_FROM_PAIRS: usize = 2;
/// Standard deviation of a drift before anything is seen of it: rad, mm, relative change of the focal length.
pub(super) const PRIOR: [f64; UNKNOWNS] = [1e-3, 1e-3, 1e-3, 0.3, 0.3, 0.3, 1e-3];

/// Smooth errors of the phase within the causes are taken for up to so many times those that no cause explains …
const PATTERN: f64 = 2.0;
/// … and for this at least, px: patterns below are noise.
const LEAST_ERROR_PX: f64 = 5e-4;
/// Probability with which true lengths contradict a true estimate.
const LENGTHS_CONTRADICT: f64 = 1e-3;
/// Steps of the derivatives of measured lengths: rotations (rad), shifts (mm), relative focal length; large against what single points do.
const STEPS: [f64; UNKNOWNS] = [2e-5, 2e-5, 2e-5, 1e-2, 1e-2, 1e-2, 5e-5];

/// A certified length that the corrected view helped to measure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LengthReading {
    /// Certified less measured length with the view in the state of the estimate, mm.
    pub error_mm: f64,
    /// Standard uncertainty of the measured length, of this recording alone, mm.
    pub u_mm: f64,
    /// Certified length of the standard, mm.
    pub certified_mm: f64,
    /// Standard uncertainty of the certified length, mm; all recordings share its error.
    pub u_certified_mm: f64,
    /// Derivatives of the measured length by rotations (rad), shifts (mm) and relative focal length.
    pub by: [f64; UNKNOWNS],
}

/// What the matches say of the drift of a view, before it is known which causes changed.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewEstimate {
    pub(super) start: Camera,
    /// New state less old one: rotations about x, y, z (rad), shifts along them (mm), relative change of the focal length.
    pub drift: [f64; UNKNOWNS],
    /// Inverse covariance of the drift.
    pub(super) weight: Dense,
    /// Of each pair that measures: what a drift does to lengths of the object, squared, over the lengths.
    pub(super) object: Vec<Dense>,
    /// Derivatives of lengths over the lengths, anywhere in the volume of each of these pairs.
    pub(super) volume: Vec<[f64; UNKNOWNS]>,
    /// From the measuring partners to the view, in the view's frame, mm.
    pub(super) baselines_mm: Vec<Vector3<f64>>,
    /// Relative standard uncertainty of the scale by the certified lengths alone, where some have entered.
    pub u_scale: Option<f64>,
    /// Fixed views that measure places together, and whether these count.
    pub three_views: Vec<ThreeViews>,
    /// Drift and inverse covariance by the pairs alone, where such places count as well.
    pub(super) by_pairs: Option<([f64; UNKNOWNS], Dense)>,
}

/// The state of a view that explains the residuals of all its pairs, with all seven causes free.
///
/// # Errors
/// As [`check_pair`].
pub fn estimate_view(
    view: &Camera,
    partners: &[Partner],
    calibration: Option<&ViewCovariance>,
    settings: &HealthSettings,
) -> Result<ViewEstimate, HealthError> {
    let problem = Problem::new(view, partners, calibration, settings)?;
    let by_pairs = problem.solve([0.0; UNKNOWNS], &[], ROUNDS)?;
    let now = stepped(view, &by_pairs.0);
    let three = three_views(partners, problem.pairs(&now)?, &now, &problem.root, settings)?;
    let trusted: Vec<ThreeViews> = three.iter().copied().filter(ThreeViews::agrees).collect();
    let ((drift, weight), by_pairs) = if trusted.is_empty() {
        (by_pairs, None)
    } else {
        (problem.solve(by_pairs.0, &trusted, ROUNDS_FROM_PAIRS)?, Some(by_pairs))
    };
    let now = stepped(view, &drift);
    let measuring = || partners.iter().filter(|p| p.measures || partners.iter().all(|p| !p.measures));
    let baseline = |p: &Partner| now.camera_from_world.rotation * (now.centre_mm() - p.fixed.centre_mm());
    Ok(ViewEstimate {
        start: view.clone(),
        drift,
        weight,
        object: measuring().filter_map(|p| length_form(p, &now)).collect(),
        volume: measuring().flat_map(|p| volume::lengths(p, &now)).collect(),
        baselines_mm: measuring().map(baseline).collect(),
        u_scale: None,
        three_views: three,
        by_pairs,
    })
}

impl ViewEstimate {
    /// The view with all of the estimated drift.
    pub fn camera(&self) -> Camera {
        stepped(&self.start, &self.drift)
    }

    /// Certified lengths (with their standard uncertainties, mm) less those that `measure` finds with the view in a state, with their derivatives; lengths that were not
    /// measured are left out.
    ///
    /// # Errors
    /// Those of `measure`, which gives each length and its standard uncertainty, mm.
    pub fn readings<E>(
        &self,
        certified_mm: &[(f64, f64)],
        measure: impl Fn(&Camera) -> Result<Vec<Option<(f64, f64)>>, E>,
    ) -> Result<Vec<LengthReading>, E> {
        let here = self.camera();
        let found = measure(&here)?;
        let mut there = Vec::new();
        for (k, size) in STEPS.iter().enumerate() {
            let mut step = [0.0; UNKNOWNS];
            step[k] = *size;
            there.push(measure(&stepped(&here, &step))?);
        }
        let reading = |(index, (certified_mm, u_certified_mm)): (usize, &(f64, f64))| {
            let (value, u_mm) = found.get(index).copied().flatten()?;
            let mut by = [0.0; UNKNOWNS];
            for (k, by) in by.iter_mut().enumerate() {
                *by = (there[k].get(index).copied().flatten()?.0 - value) / STEPS[k];
            }
            let (certified_mm, u_certified_mm) = (*certified_mm, *u_certified_mm);
            Some(LengthReading { error_mm: certified_mm - value, u_mm, certified_mm, u_certified_mm, by })
        };
        Ok(certified_mm.iter().enumerate().filter_map(reading).collect())
    }

    /// The same with lengths that were measured with the view in this state. Places that two fixed views measure together are left out
    /// where the lengths contradict them: one of these views moved as no pair shows it.
    #[must_use]
    pub fn with_lengths(mut self, readings: &[LengthReading]) -> Self {
        // What the drift must do to each length.
        let change = |reading: &LengthReading| reading.error_mm + dot(&reading.by, &self.drift);
        let changes: Vec<f64> = readings.iter().map(change).collect();
        let Ok(known) = Factor::new(&covariance(readings)) else { return self };
        let scale: Vec<f64> = readings.iter().map(|reading| reading.certified_mm).collect();
        if !readings.is_empty() {
            self.u_scale = Some(dot(&scale, &known.solve(&scale)).max(f64::MIN_POSITIVE).sqrt().recip());
        }
        if self.by_pairs.is_some() && self.contradict(readings) {
            (self.drift, self.weight) = self.by_pairs.take().unwrap_or((self.drift, self.weight));
            self.three_views.iter_mut().for_each(|three| three.lengths_agree = false);
        }
        let mut right = self.weight.apply(&self.drift);
        let wanted = known.solve(&changes);
        for (i, right) in right.iter_mut().enumerate() {
            let by: Vec<f64> = readings.iter().map(|reading| reading.by[i]).collect();
            let weighed = known.solve(&by);
            *right += dot(&by, &wanted);
            for j in 0..UNKNOWNS {
                self.weight.add(
                    i,
                    j,
                    weighed.iter().zip(readings).map(|(w, reading)| w * reading.by[j]).sum(),
                );
            }
        }
        if let Ok(solved) = Factor::new(&self.weight) {
            self.drift.iter_mut().zip(solved.solve(&right)).for_each(|(d, s)| *d = s);
        }
        self
    }

    /// Whether certified lengths contradict the estimate: χ² against both uncertainties and what a good calibration leaves of lengths,
    /// which is common to all of them.
    fn contradict(&self, readings: &[LengthReading]) -> bool {
        let Ok(factor) = Factor::new(&self.weight) else { return false };
        let by: Vec<Vec<f64>> = readings.iter().map(|reading| factor.solve(&reading.by)).collect();
        let open = |i: usize| KNOWN_LENGTH * readings[i].certified_mm;
        let own = covariance(readings);
        let covariance = Dense::from_fn(readings.len(), readings.len(), |i, j| {
            own.at(i, j) + dot(&readings[i].by, &by[j]) + open(i) * open(j)
        });
        let errors: Vec<f64> = readings.iter().map(|reading| reading.error_mm).collect();
        let chi2 = Factor::new(&covariance).map_or(0.0, |solved| dot(&errors, &solved.solve(&errors)));
        chi2 > chi_square::limit(LENGTHS_CONTRADICT, readings.len().max(1))
    }
}

/// Covariance of certified less measured lengths: each recording has its own noise, the error of the standard is common to all.
fn covariance(readings: &[LengthReading]) -> Dense {
    Dense::from_fn(readings.len(), readings.len(), |i, j| {
        let own = if i == j { readings[i].u_mm.max(1e-9).powi(2) } else { 0.0 };
        own + readings[i].u_certified_mm * readings[j].u_certified_mm
    })
}

/// The residuals of all partners of a view.
struct Problem<'a> {
    view: &'a Camera,
    partners: &'a [Partner<'a>],
    settings: &'a HealthSettings,
    /// Of each partner: the covariance of sums over neighbours is larger than that of independent residuals.
    factors: Vec<f64>,
    devices: usize,
    root: Root,
}

impl<'a> Problem<'a> {
    fn new(
        view: &'a Camera,
        partners: &'a [Partner<'a>],
        calibration: Option<&ViewCovariance>,
        settings: &'a HealthSettings,
    ) -> Result<Self, HealthError> {
        let factor = |p: &Partner| {
            Ok(check_pair(p.fixed, view, p.matches, None, settings)?.correlation_factor.max(1.0))
        };
        let factors = partners.iter().map(factor).collect::<Result<_, HealthError>>()?;
        let of = |partner: &Partner| partner.lit_by.map_or(0, |(_, device)| device).max(partner.device) + 1;
        let devices = partners.iter().map(of).max().unwrap_or(0);
        let root = Root::new(calibration, devices)?;
        Ok(Self { view, partners, settings, factors, devices, root })
    }

    /// Sums over the residuals across the epipolar lines with the view in a state.
    fn pairs(&self, view: &Camera) -> Result<Sums, HealthError> {
        let mut sums = Sums::new(self.devices);
        for (partner, factor) in self.partners.iter().zip(&self.factors) {
            add_partner(&mut sums, partner, view, *factor, self.settings)?;
        }
        Ok(sums)
    }

    /// The drift with its inverse covariance, from a drift near it; along the epipolar lines with the fixed views that are trusted.
    fn solve(
        &self,
        start: [f64; UNKNOWNS],
        trusted: &[ThreeViews],
        rounds: usize,
    ) -> Result<([f64; UNKNOWNS], Dense), HealthError> {
        let (mut drift, mut weight) = (start, Dense::zeros(UNKNOWNS, UNKNOWNS));
        for _ in 0..rounds {
            let now = stepped(self.view, &drift);
            let mut sums = self.pairs(&now)?;
            for partner in self.partners.iter().filter(|p| trusted.iter().any(|three| three.is_of(p))) {
                add_along(&mut sums, partner, &now, self.settings);
            }
            let (information, mut right) = sums.without_errors(&self.root)?;
            weight = information;
            for (i, (right, prior)) in right.iter_mut().zip(PRIOR).enumerate() {
                weight.add(i, i, prior.powi(-2));
                *right -= drift[i] * prior.powi(-2);
            }
            let step = Factor::new(&weight).map_err(|_| HealthError::Degenerate)?.solve(&right);
            drift.iter_mut().zip(&step).for_each(|(d, s)| *d += s);
        }
        Ok((drift, weight))
    }
}

/// Adds the residuals of a partner with the view in a state.
fn add_partner(
    sums: &mut Sums,
    partner: &Partner,
    view: &Camera,
    correlation: f64,
    settings: &HealthSettings,
) -> Result<(), HealthError> {
    let rows = rows(partner.fixed, view, partner.matches);
    let fit = robust::fit(&rows).ok_or(HealthError::Degenerate)?;
    let kept: Vec<&PairRow> =
        rows.iter().zip(&fit.kept).filter(|(_, kept)| **kept).map(|(row, _)| row).collect();
    let sharpness: f64 = kept.iter().map(|row| row.sigma_px.powi(-2)).sum();
    let error_px = phase_error_px(&Tiles::new(&kept, &fit), settings);
    let phase = error_px.powi(2) * sharpness / fit.directions.len() as f64;
    sums.add(&[partner.device], &kept, 1.0 / (correlation + phase));
    Ok(())
}

/// Smooth errors of the phase leave a pattern too: where it is small, so are they.
pub(super) fn phase_error_px(tiles: &Tiles, settings: &HealthSettings) -> f64 {
    let seen_px = tiles.shows_pattern().then(|| PATTERN * tiles.pattern_px());
    settings.phase_error_px.min(seen_px.map_or(f64::INFINITY, |seen| seen.max(LEAST_ERROR_PX)))
}
