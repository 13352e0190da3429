//! Whether the points of the target are where they were declared to be.

use super::datum::Datum;
use super::model::{LOCAL, State};
use super::problem::Problem;
use nalgebra::{Matrix3, Vector3};

impl Problem<'_> {
    /// Root mean square of the estimated shifts of single points, each over its standard uncertainty.
    ///
    /// With all else fixed, the estimated shift of point i is M⁻¹g, M = Σ JᵀJ and g = Σ Jᵀr over its image points, and the sum of squares falls by
    /// gᵀM⁻¹g. Their mean over three degrees of freedom a point (seven less, which the poses have taken) is compared with
    /// the mean square of what remains, an F ratio: the noise as estimated holds the shifts already, and where eight views
    /// show a point it would hide all but the largest. Points seen from one side only are left out. 0 when the points
    /// were adjusted or when no redundancy remains.
    pub fn misfit(&self, state: &State, weights: &[f64], cost: f64, degrees_of_freedom: usize) -> f64 {
        if self.datum.is_some() {
            return 0.0;
        }
        let mut sums = vec![(Matrix3::zeros(), Vector3::zeros()); self.board.points.len()];
        for run in self.views.iter().flat_map(|view| self.runs(view)) {
            let Some(eyes) = Self::eyes(state, &run) else { continue };
            for number in (run.start..run.end).filter(|n| weights[*n] > 0.0) {
                let Some((residual, rows)) = self.equations(state, &eyes, number) else { continue };
                let (matrix, right) = &mut sums[self.image_points[number].index];
                for (row, r) in rows.iter().zip(residual) {
                    let slope = Vector3::from_column_slice(&row[LOCAL - 3..LOCAL]);
                    *matrix += slope * slope.transpose() * weights[number];
                    *right += slope * (r * weights[number]);
                }
            }
        }
        let asked =
            sums.iter().filter_map(|(matrix, right)| Some(right.dot(&(matrix.try_inverse()? * right))));
        let squares: Vec<f64> = asked.filter(|s| s.is_finite()).collect();
        let asked: f64 = squares.iter().sum();
        let shifts = (3 * squares.len()).saturating_sub(Datum::HELD);
        let remaining = degrees_of_freedom.saturating_sub(shifts);
        if shifts == 0 || remaining == 0 || asked >= cost {
            return 0.0;
        }
        (asked / shifts as f64 / ((cost - asked) / remaining as f64)).sqrt()
    }
}
