//! What the columns that all pixels share tell of the frames, and the weights that follow.

use super::FrameRow;
use super::columns::{Column, dot, solver, times};
use crate::decode::limits::MAX_STEPS;
use crate::wrapped::LeastSquares;
use nalgebra::{Matrix3, Vector3};

/// Rounds in which the factors of the frames settle.
const ROUNDS: usize = 30;

/// Frames as rows of three columns.
pub(super) struct Rows {
    pub(super) steps: usize,
    pub(super) nominal: [Column; 3],
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
