//! Distortion of a lens in normalised image coordinates: Brown and Conrady's model, its rational and thin-prism extensions in OpenCV's
//! meaning, and the fisheye of Kannala and Brandt.
//!
//! All map ideal coordinates (X/Z, Y/Z) to distorted ones, so all have a field below 180°. With r² = x² + y²:
//!
//! | kind | model |
//! |---|---|
//! | Brown–Conrady | x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²), y likewise |
//! | rational | the radial factor over 1 + k4 r² + k5 r⁴ + k6 r⁶ |
//! | thin prism | the rational one, and s1 r² + s2 r⁴ along x, s3 r² + s4 r⁴ along y |
//! | fisheye | x θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) / r with tan θ = r |
//!
//! Source: Brown 1971; Claus, Fitzgibbon 2005 and Weng 1992 as in OpenCV's `calib3d`; Kannala, Brandt 2006.

use crate::math;
use nalgebra::{Matrix2, Vector2};

/// Newton steps to invert the distortion: each doubles the digits, five reach 1e-12 from any valid start.
const UNDISTORT_STEPS: usize = 20;

/// Number of coefficients of a lens: k1, k2, k3, p1, p2, k4, k5, k6, s1, s2, s3, s4.
pub const COEFFICIENTS: usize = 12;

/// Below this distance from the axis the quotients of a fisheye are taken by their series.
const NEAR_AXIS: f64 = 1e-4;

/// Which formula a lens follows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum LensKind {
    /// Radial polynomial and decentring.
    #[default]
    BrownConrady,
    /// Radial quotient of polynomials and decentring.
    Rational,
    /// The rational model with a tilted thin prism.
    ThinPrism,
    /// Equidistant projection with a polynomial of the angle.
    Fisheye,
}

impl LensKind {
    /// All kinds, with their names in a rig file.
    pub const NAMES: [(&'static str, Self); 4] = [
        ("brown-conrady", Self::BrownConrady),
        ("rational", Self::Rational),
        ("thin-prism", Self::ThinPrism),
        ("fisheye", Self::Fisheye),
    ];

    /// Its name in a rig file.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(_, kind)| *kind == self).map_or("", |(name, _)| name)
    }
}

/// Distortion of a lens in normalised image coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lens {
    /// The formula that it follows.
    pub kind: LensKind,
    /// Radial coefficients k1, k2, k3.
    pub k: [f64; 3],
    /// Tangential coefficients p1, p2; 0 of a fisheye.
    pub p: [f64; 2],
    /// Radial coefficients k4, k5, k6: of the rational model's denominator; a fisheye has k4 alone.
    pub more_k: [f64; 3],
    /// Coefficients s1, s2, s3, s4 of the thin prism.
    pub prism: [f64; 4],
}

impl Lens {
    /// The lens of Brown and Conrady (thesis eq. 2.71–2.73).
    pub const fn brown_conrady(k: [f64; 3], p: [f64; 2]) -> Self {
        Self { kind: LensKind::BrownConrady, k, p, more_k: [0.0; 3], prism: [0.0; 4] }
    }

    /// A lens from all coefficients, in the order of [`COEFFICIENTS`].
    pub const fn from_coefficients(kind: LensKind, c: [f64; COEFFICIENTS]) -> Self {
        Self {
            kind,
            k: [c[0], c[1], c[2]],
            p: [c[3], c[4]],
            more_k: [c[5], c[6], c[7]],
            prism: [c[8], c[9], c[10], c[11]],
        }
    }

    /// All coefficients, in the order of [`COEFFICIENTS`].
    pub const fn coefficients(&self) -> [f64; COEFFICIENTS] {
        let ([k1, k2, k3], [p1, p2]) = (self.k, self.p);
        let ([k4, k5, k6], [s1, s2, s3, s4]) = (self.more_k, self.prism);
        [k1, k2, k3, p1, p2, k4, k5, k6, s1, s2, s3, s4]
    }

    /// Distorts a normalised point.
    #[inline(always)]
    pub fn distort(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        if self.kind != LensKind::BrownConrady {
            return self.distort_otherwise(ideal);
        }
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
        if self.kind != LensKind::BrownConrady {
            return self.jacobian_otherwise(ideal);
        }
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

    /// Derivatives of [`Self::distort`] by the coefficients, in the order of [`COEFFICIENTS`]; zero for those that the kind lacks.
    pub fn by_coefficients(&self, ideal: Vector2<f64>) -> [Vector2<f64>; COEFFICIENTS] {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let mut slopes = [Vector2::zeros(); COEFFICIENTS];
        if self.kind == LensKind::Fisheye {
            let (theta, per_r) = angle(r2);
            let t2 = theta * theta;
            for (place, power) in [(0, t2), (1, t2 * t2), (2, t2 * t2 * t2), (5, t2 * t2 * t2 * t2)] {
                slopes[place] = ideal * (per_r * power);
            }
            return slopes;
        }
        let (above, below) = self.quotient(r2);
        let mut term = ideal * r2;
        for (up, down) in [(0, 5), (1, 6), (2, 7)] {
            slopes[up] = term / below;
            if self.kind != LensKind::BrownConrady {
                slopes[down] = -term * (above / (below * below));
            }
            term *= r2;
        }
        slopes[3] = Vector2::new(2.0 * x * y, r2 + 2.0 * y * y);
        slopes[4] = Vector2::new(r2 + 2.0 * x * x, 2.0 * x * y);
        if self.kind != LensKind::BrownConrady {
            slopes[8].x = r2;
            slopes[9].x = r2 * r2;
            slopes[10].y = r2;
            slopes[11].y = r2 * r2;
        }
        slopes
    }

    /// Numerator and denominator of the radial factor.
    fn quotient(&self, r2: f64) -> (f64, f64) {
        let polynomial = |k: &[f64; 3]| 1.0 + r2 * (k[0] + r2 * (k[1] + r2 * k[2]));
        (polynomial(&self.k), polynomial(&self.more_k))
    }

    /// θ (1 + k1 θ² + …) of a fisheye, and its derivative by θ.
    fn bent(&self, theta: f64) -> (f64, f64) {
        let ([k1, k2, k3], k4) = (self.k, self.more_k[0]);
        let t2 = theta * theta;
        let value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        (value, slope)
    }

    /// [`Self::distort`] of all but Brown and Conrady's.
    #[inline(never)]
    fn distort_otherwise(&self, ideal: Vector2<f64>) -> Vector2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        if self.kind == LensKind::Fisheye {
            let (theta, per_r) = angle(r2);
            return if theta == 0.0 { ideal } else { ideal * (self.bent(theta).0 / theta * per_r) };
        }
        let (above, below) = self.quotient(r2);
        let radial = above / below;
        let ([p1, p2], [s1, s2, s3, s4]) = (self.p, self.prism);
        Vector2::new(
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (s1 + r2 * s2),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (s3 + r2 * s4),
        )
    }

    /// [`Self::jacobian`] of all but Brown and Conrady's.
    #[inline(never)]
    fn jacobian_otherwise(&self, ideal: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (ideal.x, ideal.y);
        let r2 = x * x + y * y;
        let outer = ideal * ideal.transpose();
        if self.kind == LensKind::Fisheye {
            let r = r2.sqrt();
            if r < NEAR_AXIS {
                return Matrix2::identity() * (1.0 + (self.k[0] - 1.0 / 3.0) * r2)
                    + outer * (2.0 * (self.k[0] - 1.0 / 3.0));
            }
            let (theta, _) = angle(r2);
            let (value, slope) = self.bent(theta);
            let scale = value / r;
            return Matrix2::identity() * scale + outer * ((slope / (1.0 + r2) - scale) / r2);
        }
        let (above, below) = self.quotient(r2);
        let derivative = |k: &[f64; 3]| 2.0 * (k[0] + r2 * (2.0 * k[1] + r2 * 3.0 * k[2]));
        let radial = above / below;
        let slope = (derivative(&self.k) - radial * derivative(&self.more_k)) / below;
        let ([p1, p2], [s1, s2, s3, s4]) = (self.p, self.prism);
        let cross = 2.0 * p1 * x + 2.0 * p2 * y;
        let tilt = Vector2::new(2.0 * s1 + 4.0 * s2 * r2, 2.0 * s3 + 4.0 * s4 * r2);
        Matrix2::new(2.0 * p1 * y + 6.0 * p2 * x, cross, cross, 6.0 * p1 * y + 2.0 * p2 * x)
            + Matrix2::identity() * radial
            + outer * slope
            + tilt * ideal.transpose()
    }

    /// Inverts [`Self::distort`] by Newton's method to 1e-13; `None` where the lens model folds over.
    pub fn undistort(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        if self.kind == LensKind::Fisheye {
            return self.straightened(distorted);
        }
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

    /// The ideal point of a fisheye: Newton's method for the angle, which its distance from the axis determines.
    fn straightened(&self, distorted: Vector2<f64>) -> Option<Vector2<f64>> {
        let length = distorted.norm();
        if length < 1e-12 {
            return Some(distorted);
        }
        let mut theta = length.min(1.5);
        for _ in 0..UNDISTORT_STEPS {
            let (value, slope) = self.bent(theta);
            if slope.is_nan() || slope <= 0.0 {
                return None;
            }
            let step = (value - length) / slope;
            theta -= step;
            if step.abs() < 1e-15 {
                break;
            }
        }
        let settled = (self.bent(theta).0 - length).abs() < 1e-12 && (0.0..1.57).contains(&theta);
        let (sin, cos) = math::sincos(theta);
        settled.then(|| distorted * (sin / cos / length))
    }
}

/// θ with tan θ = r, and θ/r.
fn angle(r2: f64) -> (f64, f64) {
    let r = r2.sqrt();
    let theta = math::atan2(r, 1.0);
    (theta, if r < NEAR_AXIS { 1.0 - r2 / 3.0 } else { theta / r })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens() -> Lens {
        Lens::brown_conrady([-0.12, 0.08, -0.01], [4e-4, -3e-4])
    }

    /// One lens of each kind.
    fn lenses() -> [Lens; 4] {
        let of = Lens::from_coefficients;
        [
            lens(),
            of(LensKind::Rational, [0.3, -0.1, 0.01, 4e-4, -3e-4, 0.5, 0.05, 0.002, 0.0, 0.0, 0.0, 0.0]),
            of(
                LensKind::ThinPrism,
                [0.3, -0.1, 0.01, 4e-4, -3e-4, 0.5, 0.05, 0.002, 1e-3, -2e-3, -1e-3, 5e-4],
            ),
            of(LensKind::Fisheye, [0.03, -0.01, 0.004, 0.0, 0.0, -0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ]
    }

    #[test]
    fn undistort_inverts_distort() {
        for lens in lenses() {
            for i in -10..=10 {
                for j in -10..=10 {
                    let ideal = Vector2::new(f64::from(i) * 0.03, f64::from(j) * 0.03);
                    let back = lens.undistort(lens.distort(ideal)).unwrap();
                    assert!((back - ideal).amax() < 1e-12, "{ideal} came back as {back} from {lens:?}");
                }
            }
        }
        // A fisheye sees directions far from the axis: 83° here.
        let [.., fisheye] = lenses();
        let ideal = Vector2::new(7.0, -4.0);
        assert!((fisheye.undistort(fisheye.distort(ideal)).unwrap() - ideal).norm() < 1e-9);
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let h = 1e-6;
        for lens in lenses() {
            for at in [Vector2::new(0.21, -0.17), Vector2::new(2e-5, 3e-5), Vector2::new(-0.6, 0.4)] {
                let numeric = |d: Vector2<f64>| (lens.distort(at + d) - lens.distort(at - d)) / (2.0 * h);
                let jacobian = lens.jacobian(at);
                assert!((jacobian.column(0) - numeric(Vector2::new(h, 0.0))).amax() < 1e-9, "{lens:?}");
                assert!((jacobian.column(1) - numeric(Vector2::new(0.0, h))).amax() < 1e-9, "{lens:?}");
                for (place, slope) in lens.by_coefficients(at).into_iter().enumerate() {
                    let moved = |by: f64| {
                        let mut c = lens.coefficients();
                        c[place] += by;
                        Lens::from_coefficients(lens.kind, c).distort(at)
                    };
                    assert!((slope - (moved(h) - moved(-h)) / (2.0 * h)).amax() < 1e-9, "{lens:?} {place}");
                }
            }
        }
    }

    /// The wider kinds contain the narrower ones.
    #[test]
    fn a_rational_lens_without_denominator_is_that_of_brown_and_conrady() {
        let at = Vector2::new(0.3, -0.2);
        for kind in [LensKind::Rational, LensKind::ThinPrism] {
            let same = Lens { kind, ..lens() };
            assert!((same.distort(at) - lens().distort(at)).amax() < 1e-16);
            assert!((same.jacobian(at) - lens().jacobian(at)).amax() < 1e-15);
        }
    }

    #[test]
    fn a_folded_lens_gives_no_point_instead_of_a_wrong_one() {
        let folded = Lens::brown_conrady([-1.0, 0.0, 0.0], [0.0; 2]);
        assert_eq!(folded.undistort(Vector2::new(0.9, 0.9)), None);
        let folded = Lens { kind: LensKind::Fisheye, ..folded };
        assert_eq!(folded.undistort(Vector2::new(0.9, 0.9)), None);
    }
}
