//! Two focal lengths and a relative pose from a fundamental matrix, adjusted to all correspondences.

use super::fundamental::Sights;
use super::{BASELINE_MM, cross};
use crate::calibration::{rotation, rotation_vector};
use crate::least_squares::minimise;
use fringe::geometry::camera::{Camera, Lens};
use fringe::math;
use fringe::math::linear::eigen_fixed;
use fringe::math::statistics::sigma_by_median;
use metrology::fit::tangents;
use nalgebra::{Isometry3, Matrix3, Rotation3, SMatrix, SVector, Translation3, UnitQuaternion, Vector3};

/// ln f of camera and projector, rotation vector, direction of the translation in its tangent plane.
const PARAMETERS: usize = 7;
/// Focal lengths that are tried where the matrix gives none, in image sizes.
const FOCALS: [f64; 7] = [0.6, 0.9, 1.3, 1.9, 2.8, 4.2, 6.3];
/// Focal lengths that are believed, in image sizes.
const BELIEVED: std::ops::Range<f64> = 0.2..30.0;
/// Number of rounds of reweighting; the weights settle after five.
const ROUNDS: usize = 8;
/// Beyond so many robust standard deviations a correspondence contradicts.
const OUTLIER: f64 = 5.0;

/// The pair of views as adjusted.
#[derive(Debug, Clone)]
pub(super) struct Adjusted {
    /// Focal lengths of camera and projector, px.
    pub focal_px: [f64; 2],
    /// Standard uncertainties of their logarithms by noise.
    pub u_log_focal: [f64; 2],
    /// X_projector = R X_camera + t.
    pub rotation: Matrix3<f64>,
    /// Direction of t, unit vector.
    pub direction: Vector3<f64>,
    /// Number of correspondences that contradict.
    pub outliers: usize,
    /// Weighted sum of squares.
    cost: f64,
}

/// A pair about which parameters are steps.
#[derive(Debug, Clone, Copy)]
struct Pair {
    focal_px: [f64; 2],
    rotation: Matrix3<f64>,
    direction: Vector3<f64>,
}

impl Pair {
    fn stepped(&self, step: &SVector<f64, PARAMETERS>) -> Self {
        let [first, second] = tangents(&self.direction);
        let turn = rotation(Vector3::new(step[2], step[3], step[4])).to_rotation_matrix().into_inner();
        Self {
            focal_px: [self.focal_px[0] * math::exp(step[0]), self.focal_px[1] * math::exp(step[1])],
            rotation: turn * self.rotation,
            direction: (self.direction + first * step[5] + second * step[6]).normalize(),
        }
    }

    fn fundamental(&self) -> Matrix3<f64> {
        let inverse = |f: f64| Matrix3::from_diagonal(&Vector3::new(1.0 / f, 1.0 / f, 1.0));
        inverse(self.focal_px[1]) * cross(&self.direction) * self.rotation * inverse(self.focal_px[0])
    }

    /// Distances from the epipolar lines over their standard uncertainty: the reprojection error to first order.
    fn residuals(&self, sights: &Sights) -> Vec<f64> {
        let matrix = self.fundamental();
        let one = |i: usize| {
            let line = matrix * sights.camera[i];
            let [u, v] = sights.sigma_px[i];
            sights.projector[i].dot(&line) / ((line.x * u).powi(2) + (line.y * v).powi(2)).sqrt().max(1e-300)
        };
        (0..sights.len()).map(one).collect()
    }
}

/// Adjusts from the best start that the fundamental matrix allows.
pub(super) fn adjusted(matrix: &Matrix3<f64>, sights: &Sights, sizes: [f64; 2]) -> Option<Adjusted> {
    let closed = [bougnoux(matrix), bougnoux(&matrix.transpose())];
    let closed = closed[0].zip(closed[1]).map(|(a, b)| [a, b]);
    let believed = |f: &[f64; 2]| f.iter().zip(sizes).all(|(f, size)| BELIEVED.contains(&(f / size)));
    let mut starts: Vec<[f64; 2]> = closed.filter(believed).into_iter().collect();
    // Those at which the essential matrix is nearest to one.
    let grid = FOCALS.iter().flat_map(|a| FOCALS.iter().map(move |b| [a * sizes[0], b * sizes[1]]));
    let mut ranked: Vec<(f64, [f64; 2])> = grid.map(|f| (unequal(matrix, f), f)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    starts.extend(ranked.into_iter().take(4).map(|(_, focal)| focal));
    let adjust = |focal_px: [f64; 2]| {
        let pair = posed(matrix, focal_px, sights)?;
        adjust_from(pair, sights).filter(|found| believed(&found.focal_px))
    };
    starts.into_iter().filter_map(adjust).min_by(|a, b| a.cost.total_cmp(&b.cost))
}

/// Adjusts again from a solution, as for other principal points.
pub(super) fn readjusted(sights: &Sights, from: &Adjusted, sizes: [f64; 2]) -> Option<Adjusted> {
    let pair = Pair { focal_px: from.focal_px, rotation: from.rotation, direction: from.direction };
    let believed = |f: &[f64; 2]| f.iter().zip(sizes).all(|(f, size)| BELIEVED.contains(&(f / size)));
    adjust_from(pair, sights).filter(|found| believed(&found.focal_px))
}

/// The focal length of the view on the right of x'ᵀ F x, whose principal point is the origin (Bougnoux 1998, equation 6).
fn bougnoux(matrix: &Matrix3<f64>) -> Option<f64> {
    let (_, vectors) = eigen_fixed(&(matrix * matrix.transpose()));
    // The epipole in the view on the left: its column in the null space of Fᵀ.
    let epipole: Vector3<f64> = vectors.column(0).into_owned();
    let flat = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
    // The principal points are (0, 0, 1): products with them are last entries.
    let last = (2, 2);
    let left = cross(&epipole) * flat * matrix;
    let above = left[last] * matrix[last];
    let below = (left * flat * matrix.transpose())[last];
    let square = -above / below;
    (square.is_finite() && square > 0.0).then(|| square.sqrt())
}

/// How unlike the two singular values of the essential matrix are.
fn unequal(matrix: &Matrix3<f64>, focal_px: [f64; 2]) -> f64 {
    let essential = essential(matrix, focal_px);
    let (values, _) = eigen_fixed(&(essential.transpose() * essential));
    1.0 - (values[1].max(0.0) / values[2].max(1e-300)).sqrt()
}

fn essential(matrix: &Matrix3<f64>, [camera, projector]: [f64; 2]) -> Matrix3<f64> {
    let k = |f: f64| Matrix3::from_diagonal(&Vector3::new(f, f, 1.0));
    k(projector) * matrix * k(camera)
}

/// The pose that sees most points in front of both views.
fn posed(matrix: &Matrix3<f64>, focal_px: [f64; 2], sights: &Sights) -> Option<Pair> {
    let essential = essential(matrix, focal_px);
    let (_, right) = eigen_fixed(&(essential.transpose() * essential));
    let (_, left) = eigen_fixed(&(essential * essential.transpose()));
    let direction: Vector3<f64> = left.column(0).into_owned();
    let (first, second): (Vector3<f64>, Vector3<f64>) =
        (right.column(2).into_owned(), right.column(1).into_owned());
    // E v = σ u: the left vectors take the signs that the right ones give them.
    let (u1, u2) = ((essential * first).try_normalize(1e-300)?, (essential * second).try_normalize(1e-300)?);
    let (u, v) = (
        Matrix3::from_columns(&[u1, u2, u1.cross(&u2)]),
        Matrix3::from_columns(&[first, second, first.cross(&second)]),
    );
    let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let mut best: Option<(usize, Pair)> = None;
    for turn in [quarter, quarter.transpose()] {
        let rotation = nearest(&(u * turn * v.transpose()));
        for direction in [direction, -direction] {
            let pair = Pair { focal_px, rotation, direction };
            let front = (0..sights.len()).step_by(7).filter(|i| in_front(&pair, sights, *i)).count();
            if best.as_ref().is_none_or(|(most, _)| front > *most) {
                best = Some((front, pair));
            }
        }
    }
    best.map(|(_, pair)| pair)
}

/// The rotation of a matrix that is one but for rounding and its sign.
fn nearest(matrix: &Matrix3<f64>) -> Matrix3<f64> {
    let proper = if matrix.determinant() < 0.0 { -matrix } else { *matrix };
    let turned = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(proper));
    // Through its vector, so that it is a rotation to the last digit.
    rotation(rotation_vector(&turned)).to_rotation_matrix().into_inner()
}

/// Whether the rays of a correspondence meet in front of both views.
fn in_front(pair: &Pair, sights: &Sights, i: usize) -> bool {
    let ray = |p: &Vector3<f64>, f: f64| Vector3::new(p.x / f, p.y / f, 1.0);
    // a · R x − b · y = −t in the projector's frame.
    let x = pair.rotation * ray(&sights.camera[i], pair.focal_px[0]);
    let y = ray(&sights.projector[i], pair.focal_px[1]);
    let (xx, yy, xy) = (x.norm_squared(), y.norm_squared(), x.dot(&y));
    let (xt, yt) = (-x.dot(&pair.direction), -y.dot(&pair.direction));
    let below = xx * yy - xy * xy;
    below > 1e-12 && (xt * yy - yt * xy) / below > 0.0 && (xt * xy - yt * xx) / below > 0.0
}

/// Levenberg–Marquardt with Cauchy weights, and the covariance at the end.
fn adjust_from(start: Pair, sights: &Sights) -> Option<Adjusted> {
    let mut pair = start;
    let mut inverse = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    let mut scale = 0.0;
    for _ in 0..ROUNDS {
        let residuals = pair.residuals(sights);
        scale = sigma_by_median(&mut residuals.clone())?.max(1e-9);
        let weights: Vec<f64> =
            residuals.iter().map(|r| (1.0 / (1.0 + (r / (3.0 * scale)).powi(2))).powi(2)).collect();
        let sum = |step: &SVector<f64, PARAMETERS>| {
            let residuals = pair.stepped(step).residuals(sights);
            Some(residuals.iter().zip(&weights).map(|(r, w)| w * r * r).sum::<f64>())
                .filter(|s| s.is_finite())
        };
        let linearise = |step: &SVector<f64, PARAMETERS>| linearised(&pair, step, sights, &weights);
        let settled = |step: &SVector<f64, PARAMETERS>| step.amax() < 1e-9;
        let found = minimise(SVector::zeros(), 40, sum, linearise, settled)?;
        inverse = found.inverse;
        pair = pair.stepped(&found.parameters);
    }
    let residuals = pair.residuals(sights);
    let outliers = residuals.iter().filter(|r| r.abs() > OUTLIER * scale).count();
    let cost =
        residuals.iter().map(|r| (r / scale).powi(2).min(OUTLIER * OUTLIER)).sum::<f64>() * scale * scale;
    let u = |i: usize| scale * inverse[(i, i)].max(0.0).sqrt();
    Some(Adjusted {
        focal_px: pair.focal_px,
        u_log_focal: [u(0), u(1)],
        rotation: pair.rotation,
        direction: pair.direction,
        outliers,
        cost,
    })
}

/// JᵀWJ and −JᵀWr by central differences.
fn linearised(
    pair: &Pair,
    at: &SVector<f64, PARAMETERS>,
    sights: &Sights,
    weights: &[f64],
) -> (SMatrix<f64, PARAMETERS, PARAMETERS>, SVector<f64, PARAMETERS>) {
    const STEP: f64 = 1e-6;
    let residuals = pair.stepped(at).residuals(sights);
    let slopes: Vec<Vec<f64>> = (0..PARAMETERS)
        .map(|i| {
            let by = SVector::<f64, PARAMETERS>::ith(i, STEP);
            let (high, low) =
                (pair.stepped(&(at + by)).residuals(sights), pair.stepped(&(at - by)).residuals(sights));
            high.iter().zip(&low).map(|(h, l)| (h - l) / (2.0 * STEP)).collect()
        })
        .collect();
    let (mut matrix, mut right) = (SMatrix::zeros(), SVector::zeros());
    for (k, weight) in weights.iter().enumerate() {
        let row = SVector::<f64, PARAMETERS>::from_fn(|i, _| slopes[i][k]);
        matrix += row * row.transpose() * *weight;
        right -= row * (residuals[k] * weight);
    }
    (matrix, right)
}

impl Adjusted {
    /// Both views, with the assumed principal points and baseline.
    pub fn cameras(&self, centres: [[f64; 2]; 2], sizes_px: [[u32; 2]; 2]) -> (Camera, Camera) {
        let view = |i: usize, camera_from_world: Isometry3<f64>| Camera {
            width_px: sizes_px[i][0],
            height_px: sizes_px[i][1],
            focal_px: [self.focal_px[i]; 2],
            principal_point_px: centres[i],
            skew: 0.0,
            distortion: Lens::default(),
            camera_from_world,
        };
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(self.rotation));
        let shift = Translation3::from(self.direction * BASELINE_MM);
        (view(0, Isometry3::identity()), view(1, Isometry3::from_parts(shift, turn)))
    }
}
