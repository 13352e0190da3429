//! Fringes that moved between the frames beside light that changed between them: which of both the columns of a set show.
//!
//! Frames that stand pᵢ beside their steps have rows (1, cos θᵢ, sin θᵢ) with θᵢ = δᵢ + pᵢ. Light that changes has rows (lᵢ, cos δᵢ, sin δᵢ) where it is
//! added, as room light is, and fᵢ (1, cos δᵢ, sin δᵢ) where it scales all, as an exposure does. A part that moved by a good share of a fringe looks like
//! a changing light as long as no steps but the nominal ones are thought of. So the rows of each kind are sought that lie nearest to the columns which
//! the pixels share: rows of the kind and what the columns hold of them, by turns. What leaves less of the grey values unexplained is what happened.
//!
//! Both may have happened. Of scaled rows a first harmonic of p cannot be told from one of f (the cone of these rows has the symmetry of Lorentz'
//! transformations), so it counts for nothing; the motion stated is then the least.

use super::columns::{Column, dot, nominal_columns, solver};
use super::rows::Rows;
use super::samples::Samples;
use super::subspace::nearest;
use crate::decode::limits::MAX_STEPS;
use crate::decode::motion::{LEAST_STEPS, StepMotion};
use crate::math::{atan2, wrap_rad};
use nalgebra::{Matrix3, Vector3};

/// Turns of the search.
const ROUNDS: usize = 200;
/// Motion is believed where it leaves less than this share of what the light leaves unexplained.
const EXPLAINED: f64 = 0.25;
/// What else was found explains enough where it leaves no more than this share of the noise of one frame: a motion within half of a pixel's uncertainty.
const LEAST_EXCESS: f64 = 0.25;

/// What a light that changes does to the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Light {
    /// It is the same in all.
    Steady,
    /// It adds to their levels.
    Added,
    /// It scales them.
    Scaled,
}

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
        let noise = rows.unexplained(&rows.basis) / (rows.steps as f64 - 3.0);
        let (columns, off_rad) = rows.moved(Light::Steady)?;
        if excess < LEAST_EXCESS * noise || rows.excess(&columns) >= EXPLAINED * excess {
            return None;
        }
        self.told(rows, (columns, off_rad), rows.unexplained(&nominal_columns(self.plan())), false)
    }

    /// The motion beside a light of columns that explain a set less well than both together do.
    pub(super) fn moved_beside(&self, rows: &Rows, left_by_light: f64) -> Option<MovedSteps> {
        let both = [Light::Added, Light::Scaled].into_iter().filter_map(|light| rows.moved(light));
        let left = both.map(|found| (rows.unexplained(&found.0), found));
        let (_, found) = left.min_by(|a, b| a.0.total_cmp(&b.0))?;
        self.told(rows, found, left_by_light, true)
    }

    /// What frames beside their steps say; `without`: what is unexplained if they stand where they should.
    fn told(
        &self,
        rows: &Rows,
        (columns, off_rad): ([Column; 3], Column),
        without: f64,
        beside_light: bool,
    ) -> Option<MovedSteps> {
        let steps = rows.steps;
        if steps < LEAST_STEPS {
            return None;
        }
        // Shifts that are no motion: all alike, and beside a light those that look like it.
        let like_light = if beside_light { 3 } else { 1 };
        let basis = nominal_columns(self.plan());
        let off_rad = without_part(&off_rad, &basis, (steps, like_light))?;
        let mut time = [0.0; MAX_STEPS];
        time.iter_mut().enumerate().for_each(|(i, time)| *time = i as f64);
        let time = without_part(&time, &basis, (steps, like_light))?;
        let unexplained = rows.unexplained(&columns);
        let noise = unexplained / (steps as f64 - 3.0);
        let weights = solver(&columns, steps)?;
        let power = |k: usize| {
            weights[k][..steps]
                .iter()
                .zip(&rows.power)
                .map(|(w, row)| w * dot(&weights[k], row, steps))
                .sum::<f64>()
        };
        // A pixel at the phase φ shows a shift by B sin(φ − δ), whose square is half of B² in the mean.
        let noise_rad2 = 2.0 * noise / (power(1) + power(2)).max(f64::MIN_POSITIVE);
        let counted = self.count() as f64;
        let explained = (without - unexplained) / (noise / counted).max(f64::MIN_POSITIVE);
        let deviation_rad = (dot(&off_rad, &off_rad, steps) / steps as f64).sqrt();
        let span = dot(&time, &time, steps);
        let motion = StepMotion::of_frames(
            self.plan(),
            (deviation_rad, explained, steps - like_light),
            (dot(&time, &off_rad, steps) / span, (noise_rad2 / counted / span).sqrt()),
        );
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

    /// Columns of frames beside their steps under such a light, nearest to those that all pixels share, and how far each stands off, rad.
    fn moved(&self, light: Light) -> Option<([Column; 3], Column)> {
        let mut columns = self.nominal;
        for _ in 0..ROUNDS {
            let shared = nearest(&self.basis, &columns, self.steps, None)?;
            let mut sum = 0.0;
            for i in 0..self.steps {
                let (level, c, s) = (shared[0][i], shared[1][i], shared[2][i]);
                let contrast = (c * c + s * s).sqrt();
                if contrast.is_nan() || contrast <= 0.0 {
                    return None;
                }
                let (level, scale) = match light {
                    Light::Steady => (1.0, 1.0),
                    Light::Added => (level, 1.0),
                    Light::Scaled => (0.5 * (level + contrast), 0.5 * (level + contrast)),
                };
                sum += level;
                (columns[0][i], columns[1][i], columns[2][i]) =
                    (level, scale * c / contrast, scale * s / contrast);
            }
            // Their mean is one; of light that scales all, of all columns.
            let scale = self.steps as f64 / sum;
            let scaled = if light == Light::Scaled { 3 } else { 1 };
            columns[..scaled].iter_mut().flatten().for_each(|value| *value *= scale);
        }
        let mut off_rad = [0.0; MAX_STEPS];
        for (i, off) in off_rad[..self.steps].iter_mut().enumerate() {
            let nominal_rad = atan2(self.nominal[2][i], self.nominal[1][i]);
            *off = wrap_rad(atan2(columns[2][i], columns[1][i]) - nominal_rad);
        }
        Some((columns, off_rad))
    }
}

/// A column without what lies in the first so many of three others.
fn without_part(column: &Column, others: &[Column; 3], (steps, count): (usize, usize)) -> Option<Column> {
    let product = |i: usize, j: usize| {
        if i < count && j < count { dot(&others[i], &others[j], steps) } else { f64::from(u8::from(i == j)) }
    };
    let inverse = Matrix3::from_fn(product).try_inverse()?;
    let shares =
        inverse * Vector3::from_fn(|k, _| if k < count { dot(&others[k], column, steps) } else { 0.0 });
    let mut rest = *column;
    for (i, value) in rest[..steps].iter_mut().enumerate() {
        *value -= (0..count).map(|k| shares[k] * others[k][i]).sum::<f64>();
    }
    Some(rest)
}
