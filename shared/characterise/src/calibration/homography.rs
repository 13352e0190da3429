//! Homography of a flat target, robust against single wrong points (start values only; the adjustment decides).

use super::observations::ImagePoint;
use fringe::math::linear::{Dense, eigen};
use fringe::math::statistics::median;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Fewest points of a view: four determine the homography, the others detect a wrong one.
pub(super) const MIN_IMAGE_POINTS: usize = 6;

/// Reweighted rounds: the weights of wrong points fall by an order of magnitude each.
const ROUNDS: usize = 8;

/// The second smallest eigenvalue of the normal matrix over the largest: below, the points lie on a line.
const COLLINEAR: f64 = 1e-9;

/// Pixel ← (x, y, 1) on the target, mm; `None` for points that determine none.
pub(super) fn homography(board: &[Vector3<f64>], image_points: &[ImagePoint]) -> Option<Matrix3<f64>> {
    if image_points.len() < MIN_IMAGE_POINTS {
        return None;
    }
    let (place, to_place) = normalised(image_points.iter().map(|s| board[s.index].xy()));
    let (image, to_image) = normalised(image_points.iter().map(|s| s.pixel.coords));
    let mut weights = vec![1.0; image_points.len()];
    let mut found = direct(&place, &image, &weights)?;
    for _ in 0..ROUNDS {
        let mut squares = Vec::with_capacity(image_points.len());
        for (p, q) in place.iter().zip(&image) {
            let h = found * Vector3::new(p.x, p.y, 1.0);
            squares.push(((h.xy() / h.z - q).norm_squared(), h.z));
        }
        let scale = median(&mut squares.iter().map(|s| s.0).collect::<Vec<f64>>()).unwrap_or(0.0).max(1e-24);
        for (weight, (square, z)) in weights.iter_mut().zip(&squares) {
            // Cauchy's weight, and 1/z² to turn the algebraic error into the distance in the image.
            *weight = 1.0 / (1.0 + square / (4.0 * scale)).powi(2) / (z * z).max(1e-6);
        }
        found = direct(&place, &image, &weights)?;
    }
    let pixel_from_board = to_image.try_inverse()? * found * to_place;
    pixel_from_board.iter().all(|v| v.is_finite()).then_some(pixel_from_board)
}

/// Direct linear transformation with weights.
fn direct(place: &[Vector2<f64>], image: &[Vector2<f64>], weights: &[f64]) -> Option<Matrix3<f64>> {
    let mut normal = Dense::zeros(9, 9);
    for ((p, q), weight) in place.iter().zip(image).zip(weights) {
        let rows = [
            [p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y, -q.x],
            [0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y, -q.y],
        ];
        for row in rows {
            for i in 0..9 {
                for j in 0..9 {
                    normal.add(i, j, weight * row[i] * row[j]);
                }
            }
        }
    }
    let (values, vectors) = eigen(&normal);
    if values[1].is_nan() || values[1] <= COLLINEAR * values[8] {
        return None;
    }
    let h = Matrix3::from_row_slice(vectors.row(0));
    // The target lies in front of the device: its middle has a positive scale.
    Some(if h.m33 < 0.0 { -h } else { h })
}

/// Points about their mean with mean square 2, and the matrix that does it.
fn normalised(points: impl Iterator<Item = Vector2<f64>> + Clone) -> (Vec<Vector2<f64>>, Matrix3<f64>) {
    let count = points.clone().count().max(1) as f64;
    let mean = points.clone().fold(Vector2::zeros(), |sum, p| sum + p) / count;
    let square = points.clone().map(|p| (p - mean).norm_squared()).sum::<f64>() / count;
    let scale = (2.0 / square.max(1e-300)).sqrt();
    let matrix = Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0);
    (points.map(|p| (p - mean) * scale).collect(), matrix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::synthetic::Noise;
    use nalgebra::{Matrix2, Point2};

    fn grid() -> Vec<Vector3<f64>> {
        (0..48).map(|i| Vector3::new(f64::from(i % 8) * 10.0, f64::from(i / 8) * 10.0, 0.0)).collect()
    }

    /// Three wrong points of 48 do not move the homography by more than the noise.
    #[test]
    fn wrong_points_lose_their_weight() {
        let truth = Matrix3::new(8.0, 0.6, 100.0, -0.4, 7.5, 80.0, 5e-4, -8e-4, 1.0);
        let mut noise = Noise(3);
        let board = grid();
        let pixel = |p: &Vector3<f64>| {
            let h = truth * Vector3::new(p.x, p.y, 1.0);
            h.xy() / h.z
        };
        let mut image_points: Vec<ImagePoint> = board
            .iter()
            .enumerate()
            .map(|(index, p)| ImagePoint {
                index,
                pixel: Point2::from(pixel(p) + Vector2::new(noise.gauss(), noise.gauss()) * 0.01),
                covariance_px2: Matrix2::identity(),
                link: None,
            })
            .collect();
        for wrong in [5, 20, 41] {
            image_points[wrong].pixel.x += 60.0;
        }
        let found = homography(&board, &image_points).unwrap();
        for p in &board {
            let h = found * Vector3::new(p.x, p.y, 1.0);
            assert!((h.xy() / h.z - pixel(p)).norm() < 0.05);
        }
    }

    #[test]
    fn points_on_a_line_give_none() {
        let board = grid();
        let image_points: Vec<ImagePoint> = (0..8)
            .map(|i| ImagePoint {
                index: i,
                pixel: Point2::new(10.0 * i as f64, 3.0 * i as f64),
                covariance_px2: Matrix2::identity(),
                link: None,
            })
            .collect();
        assert_eq!(homography(&board, &image_points), None);
    }
}
