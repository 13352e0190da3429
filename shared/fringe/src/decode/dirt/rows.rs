//! What the columns that all pixels share tell of the frames, and the weights that follow.

// The sums of a set live on the stack: a warm decoder allocates nothing.
#![allow(clippy::large_stack_arrays)]

use super::columns::{Column, dot, solver, times};
use super::finding::Fault;
use crate::decode::between_steps::{lower, solved};
use crate::decode::limits::MAX_STEPS;
use crate::wrapped::LeastSquares;
use nalgebra::{Matrix3, Vector3};

/// A frame with less than this level and contrast is black.
pub(super) const BLACK: f64 = 0.1;
/// A frame with less contrast than this is blurred.
pub(super) const BLURRED: f64 = 0.75;
/// A frame whose step is off by more has moved, rad.
pub(super) const MOVED_RAD: f64 = 0.3;
/// A frame that leaves so many times what the others leave …
const STRANGE: f64 = 4.0;
/// … and this share of the level shows something else.
const STRANGE_LEVEL: f64 = 0.03;
/// Rounds in which the factors of the frames are found.
const ROUNDS: usize = 4;
/// They differ by so much before anything is seen of it, standard deviation.
const LIKELY: f64 = 0.1;

/// What one row tells of its frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct FrameRow {
    /// Level over that of most frames.
    pub level: f64,
    /// Contrast over that of most frames.
    pub contrast: f64,
    /// Step less the nominal one, rad.
    pub off_rad: f64,
    /// Residual over the level that three quarters of the pixels stay below.
    pub left: f64,
    /// The same of most frames.
    pub usual: f64,
}

impl FrameRow {
    /// The fault that the row shows, if any.
    pub fn fault(&self) -> Option<Fault> {
        if self.level < BLACK && self.contrast < BLACK {
            Some(Fault::Black)
        } else if self.contrast < BLURRED * self.level.max(BLACK) {
            Some(Fault::Blurred(self.contrast))
        } else if self.off_rad.abs() > MOVED_RAD {
            Some(Fault::Moved(self.off_rad))
        } else if self.left > STRANGE * self.usual && self.left > STRANGE_LEVEL {
            Some(Fault::Strange)
        } else {
            None
        }
    }
}

/// Frames as rows of three columns.
pub(super) struct Rows {
    pub(super) steps: usize,
    pub(super) nominal: [Column; 3],
    /// Orthonormal columns that span what all pixels share.
    pub(super) basis: [Column; 3],
    pub(super) columns: [Column; 3],
    pub(super) frames: [FrameRow; MAX_STEPS],
    /// Σ over the pixels of the products of two frames.
    pub(super) power: [Column; MAX_STEPS],
}

impl Rows {
    pub(super) fn frames(&self) -> &[FrameRow] {
        &self.frames[..self.steps]
    }

    /// Power of what three columns leave.
    pub(super) fn unexplained(&self, columns: &[Column; 3]) -> f64 {
        let Some(weights) = solver(columns, self.steps) else { return f64::INFINITY };
        let mut left = 0.0;
        for i in 0..self.steps {
            left += self.power[i][i];
            for (column, weights) in columns.iter().zip(&weights) {
                left -= column[i] * dot(weights, &self.power[i], self.steps);
            }
        }
        left
    }

    /// The light of each frame, if it scales the nominal one; `None` where the frames do not determine that.
    ///
    /// With frames (1 + gᵢ) fᵢ, f of the three columns and Q what the columns leave, Σ over the pixels of |Q f g|² is gᵀ (Q ∘ Σ f fᵀ) g: gᵢ solves
    /// normal equations. A few rounds, with the columns times the factors found, leave nothing of second order.
    pub(super) fn factors(&self) -> Option<Factors> {
        let (steps, mut scaled) = (self.steps, [1.0; MAX_STEPS]);
        let mut of_wave = 0.0;
        for _ in 0..ROUNDS {
            let columns = self.nominal.map(|column| times(&column, &scaled));
            let weights = solver(&columns, steps)?;
            // Pᵢⱼ = Σₖ column · weight predicts frame i by all frames.
            let predict = |i: usize| -> Column {
                std::array::from_fn(|j| (0..3).map(|k| columns[k][i] * weights[k][j]).sum())
            };
            let (mut normal, mut right) = ([[0.0; MAX_STEPS]; MAX_STEPS], [0.0; MAX_STEPS]);
            for i in 0..steps {
                let own = predict(i);
                // Σ fᵢ Iⱼ.
                let seen: Column = std::array::from_fn(|j| dot(&own, &self.power[j], steps));
                for j in 0..steps {
                    let left = f64::from(u8::from(i == j)) - own[j];
                    right[i] += left * seen[j];
                    normal[i][j] = left * dot(&predict(j), &seen, steps);
                }
            }
            // What the frames do not determine, the mean above all, is held near zero. Values are parts of the level, so that a frame's power is about
            // the number of pixels.
            let pixels = (0..steps).map(|i| self.power[i][i]).sum::<f64>() / steps as f64;
            let noise = self.unexplained(&columns) / (pixels * (steps as f64 - 3.0));
            (0..steps).for_each(|i| normal[i][i] += noise / (LIKELY * LIKELY));
            let lower = lower(&mut normal, steps)?;
            let change = solved(lower, steps, &right);
            scaled.iter_mut().zip(&change).take(steps).for_each(|(factor, change)| *factor *= 1.0 + change);
            let mean = scaled[..steps].iter().sum::<f64>() / steps as f64;
            scaled = scaled.map(|factor| factor / mean);
            let wave = self.nominal[1].map(|cosine| 2.0 / steps as f64 * cosine);
            of_wave = dot(&wave, &solved(lower, steps, &wave), steps);
        }
        Some(Factors { scaled, of_wave })
    }
}

/// The light of frames that are scaled by it.
pub(super) struct Factors {
    /// Factors of the frames, their mean 1.
    pub scaled: Column,
    /// Variance of the wave that looks like a fringe, over that of the noise of a pixel.
    pub of_wave: f64,
}

/// Weights of the good frames for three columns; `None` where these frames do not determine them.
pub(super) fn fit(columns: &[Column; 3], steps: usize, bad: impl Fn(usize) -> bool) -> Option<LeastSquares> {
    let row = |step: usize| Vector3::new(columns[0][step], columns[1][step], columns[2][step]);
    let used = |step: &usize| !bad(*step);
    let normal: Matrix3<f64> = (0..steps).filter(used).map(|step| row(step) * row(step).transpose()).sum();
    let inverse = normal.try_inverse()?;
    let weights =
        (0..steps).map(|step| if bad(step) { [0.0; 3] } else { (inverse * row(step)).into() }).collect();
    Some(LeastSquares { weights, covariance: [inverse[(1, 1)], inverse[(2, 2)], inverse[(1, 2)]] })
}
