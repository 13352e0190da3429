//! A quadratic surface through the phase of 5 × 5 pixels, by orthogonal polynomials in closed form.
//!
//! On the symmetric lattice 1, x, y, x² − 2, xy, y² − 2 are orthogonal, so each coefficient is one weighted sum over its
//! norm (Savitzky & Golay 1964, two-dimensional).

use fringe::phase::PhaseView;

/// Half the side of a window, px.
pub(super) const REACH: usize = 2;

/// Sums of the squared polynomials over the lattice.
const NORMS: [f64; 6] = [25.0, 50.0, 50.0, 70.0, 100.0, 70.0];

/// Degrees of freedom of a window: pixels less parameters.
const FREEDOM: f64 = 19.0;

/// The fit of one window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadratic {
    coefficients: [f64; 6],
    /// Mean variance of the pixels' phase, rad².
    pub variance_rad2: f64,
    /// Sum of squared residuals over their expectation: 1 where the surface is smooth and the noise as stated.
    pub misfit: f64,
}

fn basis(x: f64, y: f64) -> [f64; 6] {
    [1.0, x, y, x * x - 2.0, x * y, y * y - 2.0]
}

impl Quadratic {
    /// Fits the window about a pixel; `None` at the rim of the image and where a pixel is not valid.
    pub fn new(map: &PhaseView, column: usize, row: usize) -> Option<Self> {
        let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
        if column < REACH || row < REACH || column + REACH >= width || row + REACH >= height {
            return None;
        }
        let (mut values, mut variance_rad2) = ([0.0; 25], 0.0);
        for (k, value) in values.iter_mut().enumerate() {
            let index = (row + k / 5 - REACH) * width + column + k % 5 - REACH;
            if map.valid[index] == 0 {
                return None;
            }
            *value = f64::from(map.phase_rad[index]);
            variance_rad2 += f64::from(map.sigma_rad[index]).powi(2) / 25.0;
        }
        // About the middle value, so that the sums keep their digits.
        let middle = values[12];
        let mut coefficients = [0.0; 6];
        let lattice = || values.iter().enumerate().map(|(k, v)| ((k % 5) as f64, (k / 5) as f64, v - middle));
        for (x, y, value) in lattice() {
            for (sum, term) in coefficients.iter_mut().zip(basis(x - 2.0, y - 2.0)) {
                *sum += term * value;
            }
        }
        coefficients.iter_mut().zip(NORMS).for_each(|(sum, norm)| *sum /= norm);
        let mut fit = Self { coefficients, variance_rad2, misfit: 0.0 };
        let squares: f64 = lattice().map(|(x, y, v)| (v - fit.at(x - 2.0, y - 2.0)).powi(2)).sum();
        fit.coefficients[0] += middle;
        fit.misfit = squares / (FREEDOM * variance_rad2.max(f64::MIN_POSITIVE));
        Some(fit)
    }

    /// Phase at an offset from the middle, rad.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        self.coefficients.iter().zip(basis(x, y)).map(|(c, b)| c * b).sum()
    }

    /// Derivatives at an offset, rad per px.
    pub fn slope(&self, x: f64, y: f64) -> [f64; 2] {
        let [_, bx, by, bxx, bxy, byy] = self.coefficients;
        [bx + 2.0 * bxx * x + bxy * y, by + bxy * x + 2.0 * byy * y]
    }

    /// Variance of [`Self::at`], rad².
    pub fn variance_at(&self, x: f64, y: f64) -> f64 {
        self.variance_rad2 * basis(x, y).iter().zip(NORMS).map(|(b, norm)| b * b / norm).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::pattern::Axis;
    use fringe::phase::{PhaseInfo, PhaseMap};
    use fringe::synthetic::Noise;

    fn map(value: impl FnMut(f64, f64) -> f64) -> PhaseMap {
        let mut value = value;
        let mut map = PhaseMap::new(PhaseInfo { width_px: 7, height_px: 6, axis: Axis::X, period_px: 16.0 });
        for index in 0..42 {
            map.phase_rad[index] = value((index % 7) as f64, (index / 7) as f64) as f32;
            map.sigma_rad[index] = 0.01;
            map.valid[index] = 1;
        }
        map
    }

    #[test]
    fn a_quadratic_is_met_and_its_slope_too() {
        let truth =
            |x: f64, y: f64| 3.0 + 0.25 * x - 0.5 * y + 0.0625 * x * x - 0.125 * x * y + 0.03125 * y * y;
        let fit = Quadratic::new(&map(truth).view(), 3, 3).unwrap();
        assert!((fit.at(0.25, -0.5) - truth(3.25, 2.5)).abs() < 1e-6);
        let slope = fit.slope(0.5, 0.5);
        assert!((slope[0] - (0.25 + 0.125 * 3.5 - 0.125 * 3.5)).abs() < 1e-6, "{slope:?}");
        assert!((slope[1] - (-0.5 - 0.125 * 3.5 + 0.0625 * 3.5)).abs() < 1e-6, "{slope:?}");
        assert!(fit.misfit < 1e-4);
    }

    #[test]
    fn the_variance_is_the_scatter() {
        let (mut noise, mut sum, mut misfit) = (Noise(3), 0.0, 0.0);
        let rounds = 4000;
        for _ in 0..rounds {
            let fit = Quadratic::new(&map(|_, _| 0.01 * noise.gauss()).view(), 3, 2).unwrap();
            sum += fit.at(0.4, -0.3).powi(2) / f64::from(rounds);
            misfit += fit.misfit / f64::from(rounds);
        }
        let predicted = Quadratic::new(&map(|_, _| 0.0).view(), 3, 2).unwrap().variance_at(0.4, -0.3);
        assert!((sum / predicted - 1.0).abs() < 0.1, "{sum} beside {predicted}");
        assert!((misfit - 1.0).abs() < 0.02, "{misfit}");
    }

    #[test]
    fn holes_and_rims_give_none() {
        let mut holed = map(|x, _| x);
        assert!(Quadratic::new(&holed.view(), 1, 3).is_none());
        assert!(Quadratic::new(&holed.view(), 5, 3).is_none());
        holed.valid[3 * 7 + 3] = 0;
        assert!(Quadratic::new(&holed.view(), 3, 3).is_none());
    }
}
