//! The verdict on motion between the frames of a sine set. Small shifts of the fringes are found by what the nominal steps leave (`between_steps`), large
//! ones by the steps that leave less (`dirt`).
//!
//! A steady drift is extrapolated to the whole sequence: it moves what one projector shows against what the next one shows. A single step is as large as it is.

use super::Decoder;
use super::block::CHUNK;
use super::limits::MAX_STEPS;
use super::roles::SinePlan;
use crate::math::{cos, sincos};
use crate::phase::PhaseViewMut;
use rayon::prelude::*;

/// Fewest steps that tell: five leave two residuals, and each further one another.
pub(super) const LEAST_STEPS: usize = 5;
/// So many pixels tell the mean uncertainty of the phase.
const ASKED: usize = 8192;
/// Ripple below this part of a pixel's uncertainty is left: smoothed points are five times as certain as their pixels.
const LEAST_RIPPLE: f64 = 0.05;
/// Standard uncertainties beyond which a drift is one.
const CERTAIN: f64 = 5.0;
/// Standard deviation of a rounded value over half of the range of eight bits. The pattern of a frame has such errors in the columns of one period, which
/// move its fringes alike in all pixels.
pub(super) const ROUNDED: f64 = 0.288_675 / 127.5;

/// How the fringes moved during one sine set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepMotion {
    /// Root mean square of the frames' shifts about their mean, the noise taken out, rad.
    rms_rad: f64,
    /// Whether the shifts are more than the noise.
    certain: bool,
    /// What explains the shifts best.
    way: Way,
    /// Cosine and sine of the shifts over twice their steps, means, rad.
    twice_rad: [f64; 2],
}

/// A simple way in which fringes go: steadily, or once.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    /// How far the fringes went, rad: a frame, or once.
    rad: f64,
    /// Its standard uncertainty by noise, rounding and what the motion does not explain, rad.
    u_rad: f64,
    /// Whether it goes on from frame to frame.
    goes_on: bool,
}

/// What is known of the shifts of the frames of a set.
pub(super) struct Shifts<'a> {
    /// How far the fringes of each frame stand off, rad.
    pub rad: &'a [f64],
    /// Standard deviation of one of them by noise, rad.
    pub noise_rad: f64,
    /// The square of what they explain over the variance of the noise.
    pub explained: f64,
    /// Whether those that look like light which changes are left out.
    pub without_light: bool,
    /// So much of its size a motion may be off by what the projector makes of the levels, standard deviation.
    pub response: f64,
}

/// How far what a camera sees moved, against the uncertainty of its phase.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Motion {
    /// Root mean square of the frames' shifts about their mean, in phase, rad, less noise; where they are small the least, since some look like light that
    /// changes.
    pub rms_rad: f64,
    /// How far the fringes went during the sequence, rad: a steady drift extrapolated to all of its frames, or a step, whichever explains the shifts better.
    pub drift_rad: f64,
    /// Standard uncertainty of the former, rad.
    pub u_drift_rad: f64,
    /// Mean standard uncertainty of a pixel's phase, rad.
    pub sigma_rad: f64,
    /// Whether it moved by more than a pixel's phase is uncertain, and beyond doubt: a drift by five of its standard uncertainties.
    pub moved: bool,
}

impl StepMotion {
    /// Whether the shifts are more than the noise, and more than this, root mean square.
    pub(super) fn is_beyond(&self, rad: f64) -> bool {
        self.certain && self.rms_rad > rad
    }

    /// Of the frames of even steps. `left` of the light's changes, over the level, may be in the frames: each shifts the fringes of its frame by some as much.
    pub(super) fn of_shifts(plan: &SinePlan, shifts: &Shifts, left: f64) -> Self {
        let steps = shifts.rad.len();
        let told = Told { plan, without_light: shifts.without_light };
        let mut rad = [0.0; MAX_STEPS];
        rad[..steps].copy_from_slice(shifts.rad);
        told.leave(&mut rad[..steps]);
        let square = dot(&rad[..steps], &rad[..steps]);
        let noise = shifts.noise_rad * shifts.noise_rad;
        // N shifts share the noise of N − 3; where all count, A and φ of the pixels take half of what the lowest harmonics tell, and simple motions live there.
        let n = steps as f64;
        let freedom = n - 1.0;
        let of_one = noise * if shifts.without_light { n / (n - 3.0) } else { 2.0 };
        let twice = |of: fn(f64) -> f64| {
            rad.iter().zip(&plan.shifts_rad).map(|(shift, step)| shift * of(2.0 * step)).sum::<f64>() / n
        };
        Self {
            twice_rad: [twice(cos), twice(|angle| sincos(angle).0)],
            rms_rad: (square / n - noise - left * left).max(0.0).sqrt(),
            certain: shifts.explained > freedom + CERTAIN * (2.0 * freedom).sqrt(),
            way: told.way(&rad[..steps], [of_one, left * left], shifts.response),
        }
    }
}

/// What shifts tell, and what they do not.
struct Told<'a> {
    plan: &'a SinePlan,
    without_light: bool,
}

impl Told<'_> {
    /// Takes out what tells no motion: the mean, and beside a light a first harmonic of the steps, which frames of another light have as well.
    fn leave(&self, rad: &mut [f64]) {
        let n = rad.len() as f64;
        let mut take = |of: &dyn Fn(usize) -> f64, square: f64| {
            let share = rad.iter().enumerate().map(|(i, value)| value * of(i)).sum::<f64>() / square;
            rad.iter_mut().enumerate().for_each(|(i, value)| *value -= share * of(i));
        };
        take(&|_| 1.0, n);
        if self.without_light {
            take(&|i| cos(self.plan.shifts_rad[i]), 0.5 * n);
            take(&|i| sincos(self.plan.shifts_rad[i]).0, 0.5 * n);
        }
    }

    /// The steady drift, or the step between two frames, that explains the shifts best; each of them has this variance by noise and by light.
    fn way(&self, rad: &[f64], [noise, light]: [f64; 2], response: f64) -> Way {
        let steps = rad.len();
        let rounded = ROUNDED * (2.0 / self.plan.period_px.max(1.0)).sqrt();
        let of = |shape: &dyn Fn(usize) -> f64| {
            let mut column = [0.0; MAX_STEPS];
            column[..steps].iter_mut().enumerate().for_each(|(i, value)| *value = shape(i));
            self.leave(&mut column[..steps]);
            let (column, span) = (&column[..steps], dot(&column[..steps], &column[..steps]));
            let share = dot(column, rad) / span;
            let rest = dot(rad, rad) - share * share * span;
            (share, span, rest)
        };
        let drift = of(&|i| i as f64);
        let stepped = (1..steps).map(|from| of(&move |i| f64::from(u8::from(i >= from))));
        let step = stepped.min_by(|a, b| a.2.total_cmp(&b.2));
        // The best of many steps explains a part of any noise.
        let doubt = CERTAIN * CERTAIN * (noise + rounded * rounded);
        let step = step.filter(|step| step.2 + doubt < drift.2);
        let (share, span, rest) = step.unwrap_or(drift);
        // What the simple motion leaves makes it uncertain.
        let freedom = (steps as f64 - if self.without_light { 4.0 } else { 2.0 }).max(1.0);
        let scattered = ((noise + light).max(rest / freedom) + rounded * rounded) / span;
        let u_rad = (scattered + (response * share) * (response * share)).sqrt();
        Way { rad: share, u_rad, goes_on: step.is_none() }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Motion {
    /// The verdict on a sequence of so many frames whose pixels have this standard uncertainty, rad.
    pub(super) fn of(steps: StepMotion, frames: usize, sigma_rad: f64) -> Self {
        let times = if steps.way.goes_on { frames as f64 } else { 1.0 };
        let (drift_rad, u_drift_rad) = (steps.way.rad * times, steps.way.u_rad * times);
        let drifts = drift_rad.abs() > CERTAIN * u_drift_rad;
        let moved = (steps.certain && steps.rms_rad > sigma_rad) || (drifts && drift_rad.abs() > sigma_rad);
        Self { rms_rad: steps.rms_rad, drift_rad, u_drift_rad, sigma_rad, moved }
    }

    /// What a person should know, where it moved; `camera` is named.
    pub fn warning(&self, camera: &str) -> Option<String> {
        self.moved.then(|| {
            // Shifts that noise hides are not said to be none.
            let shook = if self.rms_rad > 0.0 {
                format!("moved by {:.1} mrad rms between the frames and ", self.rms_rad * 1e3)
            } else {
                String::new()
            };
            format!(
                "camera \"{camera}\": the fringes {shook}went by {:.1} mrad (u {:.1}) over the sequence, a pixel's phase is known to \
                 {:.1} mrad: part, camera or projector was not at rest; measure again, clamp it, or wait longer",
                self.drift_rad * 1e3,
                self.u_drift_rad * 1e3,
                self.sigma_rad * 1e3
            )
        })
    }
}

impl Decoder {
    /// Takes off what shifts that are beyond doubt do to phases and modulations of even steps. The phase at φ − δᵢ + pᵢ is found too large by the mean of
    /// pᵢ (1 − cos 2(φ − δᵢ)): the mean place of the fringes, and a ripple of twice their frequency, which smoothing does not take out as it does noise.
    pub(super) fn take_ripple_of_motion(&self, home: usize, motion: Option<Motion>, map: &mut PhaseViewMut) {
        let plan = &self.plan.axes[home];
        let Some((slot, motion)) = plan.sines.first().zip(motion) else { return };
        let even = plan.chain.is_some() && !plan.fused && self.sums[*slot].are_nearly_even_steps();
        let Some(steps) = self.motions[*slot].filter(|steps| even && steps.certain) else { return };
        let [along, across] = steps.twice_rad;
        if (along * along + across * across).sqrt() < LEAST_RIPPLE * motion.sigma_rad {
            return;
        }
        let pixels = map.phase_rad.par_iter_mut().zip(map.modulation.par_iter_mut());
        pixels.with_min_len(CHUNK).for_each(|(phase, modulation)| {
            let (sin, cos) = sincos(2.0 * f64::from(*phase));
            *phase = (f64::from(*phase) + along * cos + across * sin) as f32;
            *modulation = (f64::from(*modulation) * (1.0 - across * cos + along * sin)) as f32;
        });
    }

    /// How the fringes of an axis moved, against the phase of the pixels that are asked.
    pub(super) fn motion(&self, home: usize, out: &PhaseViewMut) -> Option<Motion> {
        let finest = self.plan.axes[home].sines.first()?;
        let steps = self.motions[*finest]?;
        let positions = &self.axes[home].probe.positions;
        let every = (positions.len() / ASKED).max(1);
        let known = positions.iter().step_by(every).filter(|place| out.valid[**place] == 1);
        let (sum, count) = known
            .fold((0.0, 0.0), |(sum, count), place| (sum + f64::from(out.sigma_rad[*place]), count + 1.0));
        (count > 0.0).then(|| Motion::of(steps, self.frames(), sum / count))
    }
}
