//! What the columns that all pixels share tell of the frames, and the weights that follow.

use super::columns::{Column, dot, solver, times};
use super::finding::Fault;
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
/// Rounds in which the factors of the frames settle.
const ROUNDS: usize = 30;

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

    /// Factors of the frames, their mean 1, if each is the nominal one times a factor: what the others predict of a frame, and what it shows.
    pub(super) fn factors(&self) -> Column {
        let mut factors = [1.0; MAX_STEPS];
        for _ in 0..ROUNDS {
            let Some(weights) = solver(&self.nominal.map(|column| times(&column, &factors)), self.steps)
            else {
                return factors;
            };
            let mut next = factors;
            for (i, factor) in next[..self.steps].iter_mut().enumerate() {
                // J = Σ nominal · weights · I predicts the frame without its factor.
                let predict: Column =
                    std::array::from_fn(|j| (0..3).map(|k| self.nominal[k][i] * weights[k][j]).sum());
                let mut squares = 0.0;
                for (share, row) in predict[..self.steps].iter().zip(&self.power) {
                    squares += share * dot(&predict, row, self.steps);
                }
                *factor = dot(&predict, &self.power[i], self.steps) / squares.max(f64::MIN_POSITIVE);
            }
            let mean = next[..self.steps].iter().sum::<f64>() / self.steps as f64;
            factors = next.map(|factor| factor / mean);
        }
        factors
    }
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
