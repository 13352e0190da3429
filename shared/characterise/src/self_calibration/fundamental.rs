//! The fundamental matrix and the homography of correspondences, robust against wrong ones.

use super::Correspondence;
use fringe::math::linear::{Dense, eigen, eigen_fixed};
use fringe::math::random::Key;
use fringe::math::statistics::median;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Samples of eight: with a third of wrong correspondences some thirty of them are clean.
const SAMPLES: u64 = 800;
/// Correspondences on which samples are compared.
const COMPARED: usize = 500;
/// Number of rounds of reweighting.
const ROUNDS: usize = 12;

/// Correspondences about the principal points.
pub(super) struct Sights {
    /// Camera pixel less its principal point, 1 behind.
    pub camera: Vec<Vector3<f64>>,
    /// Projector pixel less its principal point, 1 behind.
    pub projector: Vec<Vector3<f64>>,
    /// Standard uncertainties of the projector's pixel.
    pub sigma_px: Vec<[f64; 2]>,
}

impl Sights {
    /// Shifts the pixels by the principal points of camera and projector.
    pub fn new(all: &[Correspondence], [camera, projector]: [[f64; 2]; 2]) -> Self {
        let about = |p: &nalgebra::Point2<f64>, c: [f64; 2]| Vector3::new(p.x - c[0], p.y - c[1], 1.0);
        Self {
            camera: all.iter().map(|c| about(&c.camera, camera)).collect(),
            projector: all.iter().map(|c| about(&c.projector, projector)).collect(),
            sigma_px: all.iter().map(|c| c.sigma_px).collect(),
        }
    }

    /// Number of correspondences held here.
    pub fn len(&self) -> usize {
        self.camera.len()
    }
}

/// Distance of a projector pixel from its epipolar line, px.
pub(super) fn distance_px(matrix: &Matrix3<f64>, sights: &Sights, i: usize) -> f64 {
    let line = matrix * sights.camera[i];
    sights.projector[i].dot(&line) / line.xy().norm().max(1e-300)
}

/// Distance of a projector pixel from where a homography puts it, along the axis of the larger error, px.
pub(super) fn off_plane_px(plane: &Matrix3<f64>, sights: &Sights, i: usize) -> f64 {
    let at = plane * sights.camera[i];
    let off = at.xy() / at.z - sights.projector[i].xy();
    if off.x.abs() > off.y.abs() { off.x } else { off.y }
}

/// Scale that brings coordinates to about one.
fn scale(of: &[Vector3<f64>]) -> f64 {
    let square = of.iter().map(|p| p.xy().norm_squared()).sum::<f64>() / of.len().max(1) as f64;
    (2.0 / square.max(1e-300)).sqrt()
}

fn scaled(of: &[Vector3<f64>], by: f64) -> Vec<Vector3<f64>> {
    of.iter().map(|p| Vector3::new(p.x * by, p.y * by, 1.0)).collect()
}

/// The fundamental matrix; `None` where no sample determines one.
pub(super) fn robust(sights: &Sights) -> Option<Matrix3<f64>> {
    let (a, b) = (scale(&sights.camera), scale(&sights.projector));
    let (from, to) = (scaled(&sights.camera, a), scaled(&sights.projector, b));
    let count = sights.len();
    let key = Key::new(8);
    let every = count.div_ceil(COMPARED).max(1);
    let mut best: Option<(f64, Matrix3<f64>)> = None;
    for sample in 0..SAMPLES {
        let own = key.with(sample);
        let chosen: Vec<(usize, f64)> =
            (0..8).map(|i| ((own.bits(i) % count as u64) as usize, 1.0)).collect();
        let Some(matrix) = eight_points(&from, &to, chosen.into_iter()) else { continue };
        let mut off: Vec<f64> =
            (0..count).step_by(every).map(|i| error(&matrix, &from[i], &to[i]).powi(2)).collect();
        let Some(middle) = median(&mut off) else { continue };
        if best.as_ref().is_none_or(|(least, _)| middle < *least) {
            best = Some((middle, matrix));
        }
    }
    let (mut variance, mut matrix) = best?;
    for _ in 0..ROUNDS {
        let weights = (0..count).map(|i| {
            let line = matrix * from[i];
            let off = error(&matrix, &from[i], &to[i]);
            // Cauchy's weight, and the length of the line, which turns the algebraic error into the distance.
            (
                i,
                1.0 / (1.0 + off * off / (4.0 * variance).max(1e-24)).powi(2)
                    / line.xy().norm_squared().max(1e-12),
            )
        });
        let weights: Vec<(usize, f64)> = weights.collect();
        matrix = eight_points(&from, &to, weights.into_iter())?;
        variance =
            median(&mut (0..count).map(|i| error(&matrix, &from[i], &to[i]).powi(2)).collect::<Vec<f64>>())?;
    }
    let (a, b) = (Vector3::new(a, a, 1.0), Vector3::new(b, b, 1.0));
    Some(Matrix3::from_diagonal(&b) * matrix * Matrix3::from_diagonal(&a))
}

/// Distance from the epipolar line in scaled coordinates.
fn error(matrix: &Matrix3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let line = matrix * from;
    to.dot(&line) / line.xy().norm().max(1e-300)
}

/// The matrix of rank two that weighted correspondences determine.
fn eight_points(
    from: &[Vector3<f64>],
    to: &[Vector3<f64>],
    chosen: impl Iterator<Item = (usize, f64)>,
) -> Option<Matrix3<f64>> {
    let mut normal = Dense::zeros(9, 9);
    for (index, weight) in chosen {
        let (p, q) = (&to[index], &from[index]);
        let row = [p.x * q.x, p.x * q.y, p.x, p.y * q.x, p.y * q.y, p.y, q.x, q.y, 1.0];
        for (i, a) in row.iter().enumerate() {
            for (j, b) in row.iter().enumerate() {
                normal.add(i, j, weight * a * b);
            }
        }
    }
    let (_, vectors) = eigen(&normal);
    let matrix = Matrix3::from_row_slice(vectors.row(0));
    // Rank two: the direction that the matrix nearly maps to nothing is taken out.
    let (_, right) = eigen_fixed(&(matrix.transpose() * matrix));
    let open = right.column(0);
    let flat = matrix - matrix * open * open.transpose();
    flat.iter().all(|v| v.is_finite()).then_some(flat)
}

/// The homography from camera to projector that fits most correspondences.
pub(super) fn homography(sights: &Sights) -> Option<Matrix3<f64>> {
    let (a, b) = (scale(&sights.camera), scale(&sights.projector));
    let (from, to) = (scaled(&sights.camera, a), scaled(&sights.projector, b));
    let mut weights = vec![1.0; sights.len()];
    let mut found = Matrix3::identity();
    for _ in 0..ROUNDS {
        let mut normal = Dense::zeros(9, 9);
        for ((p, q), weight) in from.iter().zip(&to).zip(&weights) {
            let rows = [
                [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
                [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
            ];
            for row in rows {
                for (i, a) in row.iter().enumerate() {
                    for (j, b) in row.iter().enumerate() {
                        normal.add(i, j, weight * a * b);
                    }
                }
            }
        }
        let (_, vectors) = eigen(&normal);
        found = Matrix3::from_row_slice(vectors.row(0));
        let off = |p: &Vector3<f64>, q: &Vector3<f64>| -> (f64, f64) {
            let at = found * p;
            let error: Vector2<f64> = at.xy() / at.z - q.xy();
            (error.norm_squared(), at.z)
        };
        let all: Vec<(f64, f64)> = from.iter().zip(&to).map(|(p, q)| off(p, q)).collect();
        let middle = median(&mut all.iter().map(|(square, _)| *square).collect::<Vec<f64>>())?.max(1e-24);
        for (weight, (square, z)) in weights.iter_mut().zip(&all) {
            *weight = 1.0 / (1.0 + square / (4.0 * middle)).powi(2) / (z * z).max(1e-6);
        }
    }
    let (a, b) = (Vector3::new(a, a, 1.0), Vector3::new(1.0 / b, 1.0 / b, 1.0));
    let matrix = Matrix3::from_diagonal(&b) * found * Matrix3::from_diagonal(&a);
    matrix.iter().all(|v| v.is_finite()).then_some(matrix)
}
