//! Fringes that moved between the frames by a good part of a period: the steps that explain what the pixels share.
//!
//! Frames that stand pᵢ beside their steps have the rows (1, cos θᵢ, sin θᵢ), θᵢ = δᵢ − pᵢ. As long as no steps but the nominal ones are thought of, they look like
//! a light that changes, or like a wrong frame. So the rows of this kind are sought that lie nearest to the columns which the pixels share: rows of the kind and
//! what the columns hold of them, by turns. Where they leave far less unexplained than light or a wrong frame do, the fringes moved.

use super::columns::{Column, dot, solver};
use super::rows::Rows;
use super::samples::Samples;
use super::subspace::nearest;
use crate::decode::limits::MAX_STEPS;
use crate::decode::motion::{LEAST_STEPS, Shifts, StepMotion};
use crate::math::{atan2, wrap_rad};

/// Turns of the search.
const ROUNDS: usize = 60;
/// Motion is believed where it leaves less than this share of what the light leaves unexplained.
const EXPLAINED: f64 = 0.25;
/// What else was found explains enough where it leaves no more than this share of the noise of one frame: a motion within half of a pixel's uncertainty.
const LEAST_EXCESS: f64 = 0.25;

/// A projector that is not linear has harmonics that frames beside their steps take for a part of the motion: a tenth of it with a gamma of 1.5.
const RESPONSE: f64 = 0.1;

/// How the frames of a set moved.
pub(super) struct MovedSteps {
    /// The columns with the steps as they were.
    pub columns: [Column; 3],
    /// Standard deviation of the frames' places about their mean, rad.
    pub deviation_rad: f64,
    /// What that says of the motion during the set.
    pub motion: StepMotion,
}

impl Samples<'_> {
    /// The motion that explains a set much better than what was found, which leaves so much more than it need unexplained.
    pub(super) fn moved_instead(&self, rows: &Rows, excess: f64) -> Option<MovedSteps> {
        let steps = rows.steps;
        let noise = rows.unexplained(&rows.basis) / (steps as f64 - 3.0);
        if steps < LEAST_STEPS || excess < LEAST_EXCESS * noise {
            return None;
        }
        let (columns, shifts_rad) = rows.moved()?;
        if rows.excess(&columns) >= EXPLAINED * excess {
            return None;
        }
        let power = solver(&columns, steps)?.map(|weights| {
            let product = |(w, row): (&f64, &Column)| w * dot(&weights, row, steps);
            weights[..steps].iter().zip(&rows.power).map(product).sum::<f64>()
        });
        let counted = self.count() as f64;
        let unexplained = rows.unexplained(&columns);
        let noise = unexplained / (steps as f64 - 3.0) / counted;
        let explained = (rows.unexplained(&rows.nominal) - unexplained) / noise;
        // A pixel at the phase φ shows a shift by B sin(φ − δ), whose square is half of B² in the mean.
        let noise_rad2 = 2.0 * noise / (power[1] + power[2]).max(f64::MIN_POSITIVE);
        let deviation_rad = (dot(&shifts_rad, &shifts_rad, steps) / steps as f64).sqrt();
        let shifts = Shifts {
            rad: &shifts_rad[..steps],
            noise_rad: noise_rad2.sqrt(),
            explained,
            without_light: false,
            response: RESPONSE,
        };
        let motion = StepMotion::of_shifts(self.plan(), &shifts, 0.0);
        Some(MovedSteps { columns, deviation_rad, motion })
    }
}

impl Rows {
    /// Power that three columns leave beyond the least, which those that all pixels share leave.
    pub(super) fn excess(&self, columns: &[Column; 3]) -> f64 {
        self.unexplained(columns) - self.unexplained(&self.basis)
    }

    /// The same of the nominal steps without some frames.
    pub(super) fn excess_without(&self, is_left_out: impl Fn(usize) -> bool) -> f64 {
        let used = |step: usize| if is_left_out(step) { 0.0 } else { 1.0 };
        let columns = self.nominal.map(|column| std::array::from_fn(|step| column[step] * used(step)));
        let left_out: f64 = (0..self.steps).map(|step| (1.0 - used(step)) * self.power[step][step]).sum();
        let count = (0..self.steps).map(used).sum::<f64>();
        // Fewer frames leave less noise.
        let least = self.unexplained(&self.basis) * (count - 3.0) / (self.steps as f64 - 3.0);
        self.unexplained(&columns) - left_out - least
    }

    /// Columns of frames beside their steps, nearest to those that all pixels share, and how far the fringes of each stand off, their mean 0, rad.
    fn moved(&self) -> Option<([Column; 3], Column)> {
        let mut columns = self.nominal;
        for _ in 0..ROUNDS {
            let shared = nearest(&self.basis, &columns, self.steps, None)?;
            for i in 0..self.steps {
                let (c, s) = (shared[1][i], shared[2][i]);
                let contrast = (c * c + s * s).sqrt();
                if contrast.is_nan() || contrast <= 0.0 {
                    return None;
                }
                (columns[1][i], columns[2][i]) = (c / contrast, s / contrast);
            }
        }
        let mut shifts_rad = [0.0; MAX_STEPS];
        for (i, shift) in shifts_rad[..self.steps].iter_mut().enumerate() {
            let nominal_rad = atan2(self.nominal[2][i], self.nominal[1][i]);
            *shift = wrap_rad(nominal_rad - atan2(columns[2][i], columns[1][i]));
        }
        let mean = shifts_rad[..self.steps].iter().sum::<f64>() / self.steps as f64;
        shifts_rad[..self.steps].iter_mut().for_each(|shift| *shift -= mean);
        Some((columns, shifts_rad))
    }
}
