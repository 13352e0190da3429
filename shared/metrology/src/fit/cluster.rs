//! Covariance when the noise of neighbouring points is correlated.
//!
//! Neighbouring points of a matched pair share pixels of the right camera, and slow phase errors run over several
//! millimetres: n points carry less than n points' worth of information. Sums of the scores Jᵀr over cells keep what
//! is correlated inside a cell: C = A⁻¹ (Σ_cells s sᵀ) A⁻¹ with A = JᵀJ (Liang & Zeger 1986, the sandwich), times
//! G/(G − 1) · (n − 1)/(n − p) for few cells.
//!
//! The scatter of few points is itself uncertain. A standard uncertainty u is stated so that ± 2 u holds 95.45 % all the same: the scatter times t(n − p)
//! over that of a normal distribution (GUM G.3), which is 1.26 for six degrees of freedom and 1.003 for four hundred.

use nalgebra::{SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::{Adjusted, Model, singular};
use super::cells::Cubes;
use super::correlation::estimate;
use super::cut::left_of_normal_matrix;
use super::{Correlation, FitError, FitSettings, shared};
use crate::uncertainty::student::coverage_factor;

/// Fewest cells for the sandwich estimator: with G cells its own relative error is about 1/√(2 G).
pub(crate) const FEWEST_CELLS: usize = 20;

/// Probability that a normal distribution gives to ± 2 u.
const TWO_U: f64 = 0.954_499_736_103_641_6;

/// What stated uncertainties rest on.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Support {
    /// Cells behind the uncertainties; 0 when points counted as independent.
    pub cells: usize,
    /// How far the noise is correlated by the residuals' own account, mm; absent where it was not estimated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub correlation_reach_mm: Option<f64>,
}

/// Covariance of the chart's parameters and what it rests on.
///
/// A is JᵀJ less what a cut takes of it, see [`super::cut`]; `rejected` is the share of the points that the fit left out.
///
/// # Errors
/// Singular normal equations; a margin that cuts into the noise.
pub(super) fn covariance<M: Model<P>, const P: usize>(
    element: &'static str,
    adjusted: &Adjusted<M, P>,
    points: &[Vector3<f64>],
    settings: &FitSettings,
    rejected: f64,
) -> Result<(SMatrix<f64, P, P>, Support), FitError> {
    let inverse = adjusted.normal.inverse().ok_or_else(|| singular(element))?;
    let rows_a_point = adjusted.normal.rows as f64 / points.len().max(1) as f64;
    let cut = (rejected, settings.within_mm);
    let shrink = left_of_normal_matrix(&adjusted.model, points, rows_a_point, cut)?;
    let shared = shared::covariance(&adjusted.model, points, settings.shared_mm, &inverse);
    let (noise, support) = of_noise(adjusted, points, settings.correlation, &inverse, shrink);
    Ok((noise + shared / (shrink * shrink), support))
}

/// Covariance that the residuals show, and what it rests on.
fn of_noise<M: Model<P>, const P: usize>(
    adjusted: &Adjusted<M, P>,
    points: &[Vector3<f64>],
    correlation: Correlation,
    inverse: &SMatrix<f64, P, P>,
    shrink: f64,
) -> (SMatrix<f64, P, P>, Support) {
    let rows = adjusted.normal.rows as f64;
    let freedom = rows - P as f64;
    let fewest = FEWEST_CELLS.max(2 * P);
    match correlation {
        Correlation::Estimated if points.len() >= fewest => {
            let found = estimate(&adjusted.model, points, inverse);
            let support = Support { cells: found.cells, correlation_reach_mm: Some(found.reach_mm) };
            return (found.covariance * (of_few(freedom) / (shrink * shrink)), support);
        }
        Correlation::Cells(edge_mm) => {
            let (meat, cells) = cell_scores(&adjusted.model, points, edge_mm);
            let support = Support { cells, correlation_reach_mm: None };
            if cells >= fewest {
                let few = cells as f64 / (cells - 1) as f64 * (rows - 1.0) / freedom;
                let sandwich = inverse * meat * inverse * (few / (shrink * shrink));
                return ((sandwich + sandwich.transpose()) * 0.5, support);
            }
            // Too few cells give no covariance. At worst the points of a cell all err alike: a cell then counts as one
            // point, and as independent ones they would promise far too much.
            let points_a_cell = points.len() as f64 / cells.max(1) as f64;
            let independent = inverse * (adjusted.normal.sum / freedom * of_few(freedom) / (shrink * shrink));
            return (independent * points_a_cell, support);
        }
        Correlation::Known(sigma_mm) => {
            return (inverse * (sigma_mm * sigma_mm / (shrink * shrink)), Support::default());
        }
        Correlation::Estimated | Correlation::Independent => {}
    }
    (inverse * (adjusted.normal.sum / freedom * of_few(freedom) / (shrink * shrink)), Support::default())
}

/// What few degrees of freedom add to a variance, as a factor: the square of t over the normal distribution's for ± 2 u.
fn of_few(freedom: f64) -> f64 {
    let factor = coverage_factor(TWO_U, freedom.max(1.0)) / 2.0;
    factor * factor
}

/// Σ over cells of the outer products of the cells' scores, and the number of cells.
fn cell_scores<M: Model<P>, const P: usize>(
    model: &M,
    points: &[Vector3<f64>],
    edge_mm: f64,
) -> (SMatrix<f64, P, P>, usize) {
    let keyed = Cubes::new(points).members(edge_mm);
    let mut meat = SMatrix::zeros();
    let mut cells = 0;
    for cell in keyed.chunk_by(|a, b| a.0 == b.0) {
        let mut score = SVector::<f64, P>::zeros();
        for (_, index) in cell {
            model
                .rows(&points[*index as usize], &mut |residual, derivatives| score += derivatives * residual);
        }
        for column in 0..P {
            for row in 0..P {
                meat[(row, column)] += score[row] * score[column];
            }
        }
        cells += 1;
    }
    (meat, cells)
}
