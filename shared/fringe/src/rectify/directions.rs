//! The rectified coordinates of all pixels of a camera, as curves over short stretches of its rows.
//!
//! A lens bends a row so little that a polynomial over some pixels is the exact coordinate to a part in a million of what a phase can be known
//! to: six numbers for each of both coordinates take the place of one for each pixel. Every pixel is compared with its exact coordinates when
//! the curves are made; a lens that bends more, or has pixels without a ray, keeps the exact table.

use super::RectifiedCamera;
use nalgebra::Point2;
use rayon::prelude::*;

/// Pixels of a stretch, as a power of two.
const SHIFT: usize = 6;
/// Pixels of a stretch.
const STRETCH: usize = 1 << SHIFT;
/// Coefficients of a curve in each coordinate.
const COEFFICIENTS: usize = 6;
/// Images of fewer columns keep their table.
const LEAST_COLUMNS: usize = 2 * COEFFICIENTS;
/// A curve may miss the exact coordinates by this much, px: a hundredth of a pixel, a common uncertainty, is five million times as much.
const MOST_ERROR_PX: f64 = 2e-9;

/// x and y of a stretch as polynomials of the pixels from its middle on, the constants first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Curve([[f64; 2]; COEFFICIENTS]);

impl Curve {
    /// The coordinates so many pixels from the middle.
    #[inline(always)]
    fn at(&self, t: f64) -> [f64; 2] {
        [self.value(0, t), self.value(1, t)]
    }

    /// One of both coordinates there.
    #[inline(always)]
    fn value(&self, axis: usize, t: f64) -> f64 {
        let mut sum = self.0[COEFFICIENTS - 1][axis];
        for power in self.0[..COEFFICIENTS - 1].iter().rev() {
            sum = sum * t + power[axis];
        }
        sum
    }

    /// The coordinates of so many pixels from one on, each in one piece.
    #[inline(always)]
    fn along<const N: usize>(&self, from: f64) -> [[f64; N]; 2] {
        let mut place = [0.0; N];
        for (l, place) in place.iter_mut().enumerate() {
            *place = from + l as f64;
        }
        // Power by power, all pixels side by side, as `value` goes on for one.
        let [x, y] = self.0[COEFFICIENTS - 1];
        let (mut x, mut y) = ([x; N], [y; N]);
        for k in (0..COEFFICIENTS - 1).rev() {
            let power = self.0[k];
            for l in 0..N {
                x[l] = x[l] * place[l] + power[0];
                y[l] = y[l] * place[l] + power[1];
            }
        }
        [x, y]
    }

    /// The polynomial through so many places: pixels from the middle, and coordinates there.
    fn through(nodes: [f64; COEFFICIENTS], places: [[f64; 2]; COEFFICIENTS]) -> Self {
        let mut coefficients = [[0.0; 2]; COEFFICIENTS];
        for axis in 0..2 {
            // Newton's divided differences, then multiplied out.
            let mut differences = places.map(|place| place[axis]);
            for level in 1..COEFFICIENTS {
                for i in (level..COEFFICIENTS).rev() {
                    differences[i] = (differences[i] - differences[i - 1]) / (nodes[i] - nodes[i - level]);
                }
            }
            let mut powers = [0.0; COEFFICIENTS];
            for (node, difference) in nodes.iter().zip(&differences).rev() {
                for k in (1..COEFFICIENTS).rev() {
                    powers[k] = powers[k - 1] - node * powers[k];
                }
                powers[0] = difference - node * powers[0];
            }
            for (coefficient, power) in coefficients.iter_mut().zip(powers) {
                coefficient[axis] = power;
            }
        }
        Self(coefficients)
    }
}

/// (x, y) of the line of sight (x, y, 1) of each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Directions {
    pixels: usize,
    width: usize,
    /// 2⁶⁴ over the width, rounded up: the row of a pixel is a product.
    inverse: u64,
    /// Stretches of a row.
    stretches: usize,
    /// Stretch after stretch, row by row; none where the table is kept.
    curves: Vec<Curve>,
    /// Exact coordinates, NaN where there are none; empty where the curves give them.
    table: Vec<[f64; 2]>,
}

impl Directions {
    /// Curves of a camera, or its table where they would not be good enough. `table` is its [`RectifiedCamera::table`], and `focal_px` the number of
    /// pixels to a unit of its coordinates.
    pub fn new(camera: &RectifiedCamera, table: Vec<[f64; 2]>, focal_px: f64) -> Self {
        let width = camera.camera.width_px as usize;
        let mut directions = Self::kept(width, table);
        if width < LEAST_COLUMNS {
            return directions;
        }
        let rows: Vec<usize> = (0..directions.pixels / width).collect();
        let curves: Option<Vec<Vec<Curve>>> = rows
            .par_iter()
            .map(|row| row_of_curves(camera, &directions.table[row * width..][..width], *row, focal_px))
            .collect();
        if let Some(curves) = curves {
            directions.curves = curves.concat();
            directions.table = Vec::new();
        }
        directions
    }

    /// A table of the pixels of an image in rows of `width` as it is.
    pub(crate) fn kept(width: usize, table: Vec<[f64; 2]>) -> Self {
        let inverse = (u64::MAX / width.max(1) as u64).saturating_add(1);
        let (pixels, stretches) = (table.len(), width.div_ceil(STRETCH));
        Self { pixels, width, inverse, stretches, curves: Vec::new(), table }
    }

    /// Number of pixels of the image.
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// Coordinates of a pixel; NaN where it has none.
    #[inline(always)]
    pub fn at(&self, pixel: usize) -> [f64; 2] {
        if self.curves.is_empty() {
            return self.table[pixel];
        }
        let (stretch, place, _) = self.place(pixel);
        self.curves[stretch].at(from_middle(place))
    }

    /// Coordinates of so many pixels from one on, x and y each in one piece.
    #[inline(always)]
    pub fn along<const N: usize>(&self, pixel: usize) -> [[f64; N]; 2] {
        if !self.curves.is_empty() {
            let (stretch, place, left) = self.place(pixel);
            if N <= left {
                let first = self.curves[stretch].along(from_middle(place));
                if place + N <= STRETCH {
                    return first;
                }
                let next: [[f64; N]; 2] = self.curves[stretch + 1].along(from_middle(place) - STRETCH as f64);
                let mut chosen = first;
                for axis in 0..2 {
                    for l in 0..N {
                        chosen[axis][l] = if place + l < STRETCH { first[axis][l] } else { next[axis][l] };
                    }
                }
                return chosen;
            }
        }
        let (mut x, mut y) = ([0.0; N], [0.0; N]);
        for l in 0..N {
            [x[l], y[l]] = self.at(pixel + l);
        }
        [x, y]
    }

    /// The stretch of a pixel, its place there, and how many pixels its row has from there on.
    #[inline(always)]
    fn place(&self, pixel: usize) -> (usize, usize, usize) {
        // Exact for pixels and widths below 2³².
        let row = ((pixel as u128 * u128::from(self.inverse)) >> 64) as usize;
        let column = pixel - row * self.width;
        (row * self.stretches + (column >> SHIFT), column & (STRETCH - 1), self.width - column)
    }
}

/// Pixels from the middle of a stretch to a place in it.
#[inline(always)]
fn from_middle(place: usize) -> f64 {
    f64::from(place as i32 - (STRETCH / 2) as i32)
}

/// The curves of a row, each compared with the exact coordinates of its pixels; `None` where one is not good enough.
fn row_of_curves(
    camera: &RectifiedCamera,
    exact: &[[f64; 2]],
    row: usize,
    focal_px: f64,
) -> Option<Vec<Curve>> {
    let curve = |first: usize| {
        let end = (first + STRETCH).min(exact.len());
        // A short stretch at the end of a row leans on pixels before it.
        let (low, high) = (first.min(end - LEAST_COLUMNS) as f64, (end - 1) as f64);
        let middle = (first + STRETCH / 2) as f64;
        let (mut nodes, mut places) = ([0.0; COEFFICIENTS], [[0.0; 2]; COEFFICIENTS]);
        for (k, (node, place)) in nodes.iter_mut().zip(&mut places).enumerate() {
            // The zeros of Chebyshev's polynomial, which spread the error.
            let turn = std::f64::consts::PI * (2 * k + 1) as f64 / (2 * COEFFICIENTS) as f64;
            let column = 0.5 * (low + high) - 0.5 * (high - low) * crate::math::cos(turn);
            *place = camera.rectified_from_pixel(Point2::new(column, row as f64))?;
            *node = column - middle;
        }
        let curve = Curve::through(nodes, places);
        let good = exact[first..end].iter().enumerate().all(|(place, exact)| {
            let [x, y] = curve.at(from_middle(place));
            // NaN is not within the limit.
            (x - exact[0]).abs().max((y - exact[1]).abs()) * focal_px <= MOST_ERROR_PX && exact[0].is_finite()
        });
        good.then_some(curve)
    };
    (0..exact.len()).step_by(STRETCH).map(curve).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::camera::{Camera, Lens};
    use crate::rectify::Rectification;
    use nalgebra::{Isometry3, Translation3, UnitQuaternion};

    fn camera(width_px: u32, x: f64, turn: f64, distortion: Lens) -> Camera {
        let pose = Isometry3::from_parts(
            Translation3::new(x, 0.0, 0.0),
            UnitQuaternion::from_euler_angles(0.02, turn, 0.01),
        );
        Camera {
            width_px,
            height_px: 40,
            focal_px: [1500.0, 1502.0],
            principal_point_px: [0.5 * f64::from(width_px), 22.0],
            skew: 0.1,
            distortion,
            camera_from_world: pose.inverse(),
        }
    }

    fn directions(width_px: u32, distortion: &Lens) -> (Directions, Vec<[f64; 2]>, f64) {
        let left = camera(width_px, -90.0, 0.18, *distortion);
        let right = camera(width_px, 90.0, -0.18, *distortion);
        let pair = Rectification::new(&left, &right).unwrap();
        let table = pair.left.table();
        (Directions::new(&pair.left, table.clone(), pair.focal_px), table, pair.focal_px)
    }

    #[test]
    fn curves_give_the_coordinates_of_the_table_alone_and_side_by_side() {
        let lens = Lens::brown_conrady([-0.12, 0.06, 0.01], [3e-4, -2e-4]);
        for width in [64, 640, 643, 1001] {
            let (found, table, focal_px) = directions(width, &lens);
            assert!(found.table.is_empty(), "{width}: the table was kept");
            assert_eq!(found.pixels(), table.len());
            let mut worst = 0.0_f64;
            for (pixel, exact) in table.iter().enumerate() {
                let [x, y] = found.at(pixel);
                worst = worst.max((x - exact[0]).abs().max((y - exact[1]).abs()));
                if pixel + 10 <= table.len() {
                    let [xs, ys] = found.along::<10>(pixel);
                    for l in 0..10 {
                        assert_eq!([xs[l], ys[l]], found.at(pixel + l));
                    }
                }
            }
            assert!(worst * focal_px <= MOST_ERROR_PX && worst > 0.0, "{worst}");
        }
    }

    #[test]
    fn a_narrow_image_and_a_lens_that_bends_too_much_keep_the_table() {
        let (narrow, table, _) = directions(9, &Lens::brown_conrady([0.0; 3], [0.0; 2]));
        assert!(narrow.curves.is_empty() && narrow.at(11) == table[11]);
        let (bent, table, _) = directions(640, &Lens::brown_conrady([-40.0, 2000.0, 0.0], [0.0; 2]));
        assert!(bent.curves.is_empty());
        for (pixel, exact) in table.iter().enumerate() {
            assert_eq!(bent.at(pixel).map(f64::to_bits), exact.map(f64::to_bits));
        }
    }
}
