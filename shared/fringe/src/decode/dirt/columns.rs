//! Columns that the grey values of all pixels share, one value for each frame, and the weights that solve for them.

use crate::decode::limits::MAX_STEPS;
use crate::decode::roles::SinePlan;
use crate::math::sincos;
use nalgebra::Matrix3;

/// One column of all frames.
pub(super) type Column = [f64; MAX_STEPS];

/// The columns of the nominal steps.
pub(super) fn nominal_columns(plan: &SinePlan) -> [Column; 3] {
    let mut columns = [[0.0; MAX_STEPS]; 3];
    for (i, shift) in plan.shifts_rad.iter().enumerate() {
        let (s, c) = sincos(*shift);
        (columns[0][i], columns[1][i], columns[2][i]) = (1.0, c, s);
    }
    columns
}

/// Weights of the frames in A, C and S.
pub(super) fn solver(columns: &[Column; 3], steps: usize) -> Option<[Column; 3]> {
    let normal = Matrix3::from_fn(|i, j| dot(&columns[i], &columns[j], steps));
    let inverse = normal.try_inverse()?;
    let mut weights = [[0.0; MAX_STEPS]; 3];
    for (k, weights) in weights.iter_mut().enumerate() {
        for (i, weight) in weights[..steps].iter_mut().enumerate() {
            *weight = (0..3).map(|j| inverse[(k, j)] * columns[j][i]).sum();
        }
    }
    Some(weights)
}

/// The values of a column times those of another.
pub(super) fn times(a: &Column, b: &Column) -> Column {
    std::array::from_fn(|i| a[i] * b[i])
}

pub(super) fn dot(a: &[f64], b: &[f64], steps: usize) -> f64 {
    a[..steps].iter().zip(&b[..steps]).map(|(a, b)| a * b).sum()
}
