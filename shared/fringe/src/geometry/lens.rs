//! Lens distortion by Brown and Conrady, in OpenCV's meaning.

use nalgebra::{Matrix2, Vector2};

/// Newton steps to invert the distortion: each doubles the digits, five reach 1e-12 from any valid start.
const UNDISTORT_STEPS: usize = 20;

/// Lens distortion in normalised image coordinates (eq. 2.71–2.73).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BrownConrady {
    /// Radial coefficients k1, k2, k3.
    pub k: [f64; 3],
    /// Tangential coefficients p1, p2.
    pub p: [f64; 2],
}

impl BrownConrady {
    /// Distorts a normalised point.
    #[inline(always)]
    pub fn distort(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k[0] + r2 * (self.k[1] + r2 * self.k[2]));
        let [p1, p2] = self.p;
        Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )
    }

    /// Derivative of [`Self::distort`] by the ideal point.
    #[inline(always)]
    pub fn jacobian(&self, ideal: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let radial = 1.0 + r2 * (self.k[0] + r2 * (self.k[1] + r2 * self.k[2]));
        let slope = 2.0 * (self.k[0] + r2 * (2.0 * self.k[1] + r2 * 3.0 * self.k[2]));
        let [p1, p2] = self.p;
        let cross = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
        Matrix2::new(
            radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            cross,
            cross,
            radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        )
    }

    /// Inverts [`Self::distort`] by Newton's method to 1e-13; `None` where the lens model folds over.
    pub fn undistort(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        let mut ideal = distorted;
        for _ in 0..UNDISTORT_STEPS {
            let residual = self.distort(ideal) - distorted;
            if residual.amax() < 1e-14 {
                break;
            }
            let jacobian = self.jacobian(ideal);
            // Beyond the fold the determinant changes sign: no ideal point belongs to this pixel.
            if jacobian.determinant() <= 0.0 {
                return None;
            }
            ideal -= jacobian.try_inverse()? * residual;
        }
        let error = (self.distort(ideal) - distorted).amax();
        (error < 1e-12).then_some(ideal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> BrownConrady {
        BrownConrady { k: [-0.12, 0.08, -0.01], p: [4e-4, -3e-4] }
    }

    #[test]
    fn undistort_inverts_distort() {
        for i in -10..=10 {
            for j in -10..=10 {
                let ideal = Vector2::new(f64::from(i) * 0.03, f64::from(j) * 0.03);
                let back = lens().undistort(lens().distort(ideal)).unwrap();
                assert!((back - ideal).amax() < 1e-12, "{ideal} came back as {back}");
            }
        }
    }

    #[test]
    fn jacobian_agrees_with_differences() {
        let at = Vector2::new(0.21, -0.17);
        let h = 1e-6;
        let numeric = |d: Vector2<f64>| (lens().distort(at + d) - lens().distort(at - d)) / (2.0 * h);
        let jacobian = lens().jacobian(at);
        assert!((jacobian.column(0) - numeric(Vector2::new(h, 0.0))).amax() < 1e-9);
        assert!((jacobian.column(1) - numeric(Vector2::new(0.0, h))).amax() < 1e-9);
    }

    #[test]
    fn a_folded_lens_gives_no_point_instead_of_a_wrong_one() {
        let folded = BrownConrady { k: [-1.0, 0.0, 0.0], p: [0.0; 2] };
        assert_eq!(folded.undistort(Vector2::new(0.9, 0.9)), None);
    }
}
