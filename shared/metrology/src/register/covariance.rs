//! Uncertainty of an alignment when the noise of neighbouring points is correlated: the model of the fits
//! ([`crate::fit::Correlation`]), in the basis of the principal motions, where those left free stay out.

use nalgebra::{SMatrix, SVector, Vector3};
use rayon::prelude::*;

use super::icp::{Pair, Refined};
use super::motion::{Equations, Motion};
use crate::fit::{FEWEST_CELLS, Rows, estimate_rows};

/// Unknowns of a rigid motion.
const UNKNOWNS: usize = 6;

/// A coordinate is not determined when a free unit motion has a larger component in it.
const LARGEST_FREE: f64 = 0.01;

/// Uncertainty and what it rests on.
pub(super) struct Stated {
    /// Of a rotation vector about the centre, rad, and a translation, mm. In a coordinate that a free motion changes: infinite on
    /// the diagonal, zero beside it.
    pub covariance: SMatrix<f64, 6, 6>,
    /// Cells; 0 where the points counted as independent.
    pub cells: usize,
    pub correlation_reach_mm: Option<f64>,
}

/// The distances of pairs with their derivatives.
struct OfPairs<'a> {
    used: &'a [&'a Pair],
    derivatives: &'a [Motion],
}

impl Rows<UNKNOWNS> for OfPairs<'_> {
    #[inline(always)]
    fn rows(&self, index: usize, add: &mut impl FnMut(f64, &SVector<f64, UNKNOWNS>)) {
        add(self.used[index].distance_mm, &self.derivatives[index]);
    }
}

/// A⁻¹ M A⁻¹ within the determined motions; infinite where the others lead.
pub(super) fn covariance(last: &Refined) -> Stated {
    let (equations, principal) = (&last.equations, &last.principal);
    let used: Vec<&Pair> = last.pairs.iter().filter(|p| p.distance_mm.abs() <= last.limit_mm).collect();
    let rows = used.len() as f64;
    let mut inverse = SMatrix::<f64, 6, 6>::zeros();
    principal.determined().for_each(|i| inverse[(i, i)] = 1.0 / (rows * principal.values[i]));
    let derivatives: Vec<Motion> = used
        .par_iter()
        .map(|p| {
            let all = Equations::derivatives(&equations.centre, equations.arm_mm, &p.place, &p.normal);
            let mut kept = Motion::zeros();
            principal.determined().for_each(|i| kept[i] = principal.vectors.column(i).dot(&all));
            kept
        })
        .collect();
    let shrink = trimming_shrink(&used, last.limit_mm);
    let (inner, cells, correlation_reach_mm) = if used.len() >= FEWEST_CELLS {
        let places: Vec<Vector3<f64>> = used.iter().map(|p| p.place.coords).collect();
        let found = estimate_rows(&places, &OfPairs { used: &used, derivatives: &derivatives }, &inverse);
        (found.covariance, found.cells, Some(found.reach_mm))
    } else {
        let variance = equations.normal.sum / (rows - UNKNOWNS as f64).max(1.0);
        (inverse * variance, 0, None)
    };
    let vectors = &principal.vectors;
    let unit = |i: usize| if i < 3 { equations.arm_mm } else { 1.0 };
    let open: [bool; UNKNOWNS] =
        std::array::from_fn(|r| principal.free().any(|k| vectors[(r, k)].abs() > LARGEST_FREE));
    let entry = |r: usize, c: usize| {
        if open[r] || open[c] {
            return if r == c { f64::INFINITY } else { 0.0 };
        }
        let sum: f64 = (0..UNKNOWNS)
            .flat_map(|k| (0..UNKNOWNS).map(move |l| (k, l)))
            .map(|(k, l)| vectors[(r, k)] * inner[(k, l)] * vectors[(c, l)])
            .sum();
        sum / (unit(r) * unit(c) * shrink * shrink)
    };
    Stated { covariance: SMatrix::from_fn(entry), cells, correlation_reach_mm }
}

/// How much the points that a small motion pushes across the limit weaken the equations: 1 − c h(c)/n, with h the density
/// of the distances at the limit c, counted over the last tenth below it.
fn trimming_shrink(used: &[&Pair], limit_mm: f64) -> f64 {
    let near = used.iter().filter(|p| p.distance_mm.abs() > 0.9 * limit_mm).count();
    (1.0 - near as f64 / 0.1 / used.len().max(1) as f64).max(0.5)
}
