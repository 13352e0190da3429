//! The verdict on motion between the frames of a sine set. Small shifts of the fringes are found by what the nominal steps leave (`between_steps`), large
//! ones by the steps that leave less (`dirt`).
//!
//! A steady drift is extrapolated to the whole sequence: it moves what one projector shows against what the next one shows.

use super::Decoder;
use super::roles::SinePlan;
use crate::phase::PhaseViewMut;

/// Fewest steps that tell: five leave two residuals, and each further one another.
pub(super) const LEAST_STEPS: usize = 5;
/// So many pixels tell the mean uncertainty of the phase.
const ASKED: usize = 8192;
/// Standard uncertainties beyond which a drift is one.
const CERTAIN: f64 = 5.0;
/// Standard deviation of a rounded value over half of the range of eight bits.
const ROUNDED: f64 = 0.288_675 / 127.5;

/// How the fringes moved during one sine set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct StepMotion {
    /// Root mean square of the frames' shifts about their mean, the noise taken out, rad.
    rms_rad: f64,
    /// Whether the shifts are more than the noise.
    certain: bool,
    /// Steady part of the shifts and its standard uncertainty, rad per frame.
    per_frame_rad: f64,
    u_per_frame_rad: f64,
}

/// How far what a camera sees moved, against the uncertainty of its phase.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Motion {
    /// Root mean square of the frames' shifts about their mean, in phase, rad, less noise; the least, since some shifts look like light that changes.
    pub rms_rad: f64,
    /// A steady drift, extrapolated to all frames of the sequence, rad.
    pub drift_rad: f64,
    /// Standard uncertainty of the former, rad.
    pub u_drift_rad: f64,
    /// Mean standard uncertainty of a pixel's phase, rad.
    pub sigma_rad: f64,
    /// Whether it moved by more than a pixel's phase is uncertain, and beyond doubt: a drift by five of its standard uncertainties.
    pub moved: bool,
}

impl StepMotion {
    /// Of frames of even steps that stand off by so much (rms), which explains so many times the variance of the noise with this freedom; steady part and
    /// its standard uncertainty by noise, rad per frame.
    pub(super) fn of_frames(
        plan: &SinePlan,
        (rms_rad, explained, freedom): (f64, f64, usize),
        (per_frame_rad, by_noise_rad): (f64, f64),
    ) -> Self {
        let rounded = rounded_rad(plan.period_px, plan.steps as usize);
        let u_per_frame_rad = (by_noise_rad * by_noise_rad + rounded * rounded).sqrt();
        Self { rms_rad, certain: is_certain(explained, freedom as f64), per_frame_rad, u_per_frame_rad }
    }

    /// The same where changes of the light of this size, over the level, may be left in the frames: each shifts the fringes of its frame by as much at most.
    pub(super) fn beside_light(self, left: f64, steps: usize) -> Self {
        let span = sum_of_squares(steps);
        Self {
            rms_rad: (self.rms_rad * self.rms_rad - left * left).max(0.0).sqrt(),
            u_per_frame_rad: (self.u_per_frame_rad * self.u_per_frame_rad + left * left / span).sqrt(),
            ..self
        }
    }
}

/// Whether what explains so many times the variance of the noise is more than noise with this freedom.
fn is_certain(explained: f64, freedom: f64) -> bool {
    explained > freedom + CERTAIN * (2.0 * freedom).sqrt()
}

impl Motion {
    /// The verdict on a sequence of so many frames whose pixels have this standard uncertainty, rad.
    pub(super) fn of(steps: StepMotion, frames: usize, sigma_rad: f64) -> Self {
        let (drift_rad, u_drift_rad) =
            (steps.per_frame_rad * frames as f64, steps.u_per_frame_rad * frames as f64);
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
                "camera \"{camera}\": the fringes {shook}drifted by {:.1} mrad (u {:.1}) over the sequence, a pixel's phase is known to \
                 {:.1} mrad: the part or the camera was not at rest; measure again, clamp it, or wait longer",
                self.drift_rad * 1e3,
                self.u_drift_rad * 1e3,
                self.sigma_rad * 1e3
            )
        })
    }
}

impl Decoder {
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

/// What the rounding of the pattern to eight bits does to a steady drift, standard deviation, rad per frame: each frame has the errors of
/// the columns of one period, which move its fringes alike in all pixels.
fn rounded_rad(period_px: f64, steps: usize) -> f64 {
    let of_a_frame = ROUNDED * (2.0 / period_px.max(1.0)).sqrt();
    of_a_frame / sum_of_squares(steps).sqrt()
}

/// Of the numbers of so many frames about their mean.
fn sum_of_squares(steps: usize) -> f64 {
    let n = steps as f64;
    n * (n * n - 1.0) / 12.0
}
