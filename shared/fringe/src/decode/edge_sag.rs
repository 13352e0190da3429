//! A plane through the edges around a pixel misses a surface that curves by its sag over the window: f'' (mean square of the edges' distance) / 2. Of a
//! sphere that is a bias of every point inwards, which no scatter shows. How the planes of pixels half a window apart differ tells f'': a bend f'' d² between
//! them, and what their windows miss more than the one between them.

use super::block::CHUNK;
use super::edges::{Plane, THREE_LINES};
use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// What is added to the coordinate of a pixel, stripes, and by how much that raises the standard uncertainty.
#[derive(Debug, Clone, Copy)]
struct Sag {
    added: f32,
    growth: f32,
}

/// Windows at the border of a face lie beside their pixels: what they miss hides the bend between them below this part of it.
const LEAST_BEND: f64 = 0.3;

/// Nothing is known of the curvature.
const NONE: Sag = Sag { added: 0.0, growth: 1.0 };

/// The planes of an image.
pub(super) struct Planes<'a> {
    pub width: usize,
    pub all: &'a [Plane],
    /// Stripe centres as phase, 2π per stripe.
    pub phase_rad: &'a [f32],
    /// Steps per pixel beyond this are another surface, stripes.
    pub most_step: f64,
}

impl Planes<'_> {
    /// The sags of all pixels: what is added to their coordinates, and the growth of their uncertainty.
    pub fn sags(&self, added: &mut [f32], growth: &mut [f32]) {
        let pixels = added.par_iter_mut().zip(growth).enumerate().with_min_len(CHUNK);
        pixels.for_each(|(pixel, (added, growth))| {
            let sag = self.sag(pixel);
            (*added, *growth) = (sag.added, sag.growth);
        });
    }

    /// The sag of a pixel's window, along rows and columns where both sides have planes.
    fn sag(&self, pixel: usize) -> Sag {
        let plane = &self.all[pixel];
        let half = usize::from(plane.half);
        if plane.offset.is_nan() || half == 0 {
            return NONE;
        }
        let (column, row, rows) = (pixel % self.width, pixel / self.width, self.all.len() / self.width);
        let inside = [column >= half && column + half < self.width, row >= half && row + half < rows];
        let own = Vector2::from(plane.mean_squares.map(f64::from));
        // f'' along an axis nobody knows counts as zero.
        let (mut matrix, mut seen) = (Matrix2::identity(), Vector2::zeros());
        for (axis, step) in
            [half, half * self.width].into_iter().enumerate().filter(|(axis, _)| inside[*axis])
        {
            let sides = [pixel - step, pixel + step];
            let [Some(low), Some(high)] = sides.map(|other| self.from(pixel, other)) else { continue };
            // Each of the three planes has the sag of its own window.
            let theirs = sides.map(|other| Vector2::from(self.all[other].mean_squares.map(f64::from)));
            let mut by_bend = 0.5 * (theirs[0] + theirs[1]) - own;
            let distance2 = (half * half) as f64;
            by_bend[axis] += distance2;
            if by_bend[axis] < LEAST_BEND * distance2 {
                continue;
            }
            matrix.set_row(axis, &by_bend.transpose());
            seen[axis] = low + high;
        }
        let Some(inverse) = matrix.try_inverse() else { return NONE };
        let shares = 0.5 * inverse.transpose() * own;
        // Three planes whose windows overlap: at most as if they did not.
        let growth2 = 1.0
            + seen.zip_fold(&shares, 0.0, |sum, seen, share| {
                sum + if seen == 0.0 { 0.0 } else { 6.0 * share * share }
            });
        Sag { added: -shares.dot(&seen) as f32, growth: growth2.sqrt() as f32 }
    }

    /// The coordinate of another pixel less that of one, stripes; `None` where it is another surface, or has too few lines of edges.
    fn from(&self, pixel: usize, other: usize) -> Option<f64> {
        let stripes = f64::from(self.phase_rad[other] - self.phase_rad[pixel]) / TAU;
        let apart = stripes + f64::from(self.all[other].offset - self.all[pixel].offset);
        let [own, there] = [pixel, other].map(|at| self.all[at].span >= THREE_LINES);
        // NaN fails the comparison.
        (own && there && apart.abs() <= self.most_step * f64::from(self.all[pixel].half) + 0.5)
            .then_some(apart)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Planes through a paraboloid miss it by its sag; of a flat map nothing is added.
    #[test]
    fn the_sag_of_a_paraboloid_is_what_is_added() {
        const SIDE: usize = 40;
        // Windows of two sizes by turns, as where three lines of edges just fit.
        let half = |i: usize| if (i % SIDE + i / SIDE).is_multiple_of(3) { 3_u8 } else { 5 };
        let mean_square = |i: usize| if half(i) == 3 { 3.5 } else { 9.0 };
        for [bend_x, bend_y] in [[0.0, 0.0], [0.004, 0.0], [-0.002, 0.003]] {
            let exact = |column: f64, row: f64| {
                0.3 * column + 0.02 * row + 0.5 * (bend_x * column * column + bend_y * row * row)
            };
            let sag = |i: usize| 0.5 * mean_square(i) * (bend_x + bend_y);
            let at = |i: usize| exact((i % SIDE) as f64 - 20.0, (i / SIDE) as f64 - 20.0) + sag(i);
            let plane = |i: usize| Plane {
                offset: (at(i) - at(i).round()) as f32,
                factor: 0.1,
                squares: 0.0,
                freedom: 10.0,
                span: 3.0,
                mean_squares: [mean_square(i) as f32; 2],
                half: half(i),
            };
            let planes: Vec<Plane> = (0..SIDE * SIDE).map(plane).collect();
            let phase_rad: Vec<f32> = (0..SIDE * SIDE).map(|i| (TAU * at(i).round()) as f32).collect();
            let all = Planes { width: SIDE, all: &planes, phase_rad: &phase_rad, most_step: 1.0 };
            for pixel in [0, 20 * SIDE + 20, 17 * SIDE + 25] {
                let found = all.sag(pixel);
                let expected = if pixel == 0 { 0.0 } else { -sag(pixel) };
                assert!((f64::from(found.added) - expected).abs() < 1e-4, "{found:?}, not {expected}");
                assert!((1.0..1.4).contains(&found.growth));
            }
        }
    }

    /// The floor beside a ball is another surface.
    #[test]
    fn beyond_a_step_nothing_is_added() {
        let plane = |offset: f32| Plane {
            offset,
            factor: 0.1,
            squares: 0.0,
            freedom: 10.0,
            span: 3.0,
            mean_squares: [4.0; 2],
            half: 3,
        };
        let planes: Vec<Plane> = (0..21).map(|i| plane(if i < 12 { 0.0 } else { f32::NAN })).collect();
        let phase_rad: Vec<f32> = (0..21).map(|i| if i < 8 { 0.0 } else { 200.0 }).collect();
        let all = Planes { width: 21, all: &planes, phase_rad: &phase_rad, most_step: 0.5 };
        for pixel in [6, 9, 15] {
            assert_eq!((all.sag(pixel).added, all.sag(pixel).growth), (0.0, 1.0), "pixel {pixel}");
        }
    }
}
