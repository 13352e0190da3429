//! Surface normals from the neighbours on the pixel grid.
//!
//! A plane n·X = c has the inverse depth q = (n·d)/c along the line of sight d = (x, y, 1). So the least-squares plane of q
//! over a window, turned into derivatives by x and y, gives n ∝ (∂q/∂x, ∂q/∂y, q − x ∂q/∂x − y ∂q/∂y): exact on planes,
//! and on curved surfaces exact to second order where the window is symmetric.

use super::broken::{Joined, is_readable, joined};
use super::point::{Sample, View};
use super::raster::Raster;
use super::windows::HALF;
use nalgebra::{Vector2, Vector3};

/// A partial window needs so many samples for a plane: twice the three unknowns.
const MIN_SAMPLES: usize = 6;

/// When two samples lie on the same surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Link {
    /// Largest relative change of the inverse depth per pixel.
    pub max_step: f64,
}

impl Link {
    /// Whether two samples `distance` pixels apart lie on the same surface; never for absent ones.
    #[inline]
    pub fn joins(self, a: &Sample, b: &Sample, distance: usize) -> bool {
        // NaN fails the comparison.
        (a.inverse_depth - b.inverse_depth).abs() <= self.limit(a.inverse_depth, a.sigma + b.sigma, distance)
    }

    /// Largest difference of the inverse depths of two samples on one surface, from the inverse depth of the first and the sum of both uncertainties.
    #[inline(always)]
    pub fn limit(self, inverse_depth: f64, sigmas: f32, distance: usize) -> f64 {
        // Three sigmas of both, so that noise alone does not tear a surface.
        self.max_step * distance as f64 * inverse_depth.abs() + 3.0 * f64::from(sigmas)
    }
}

/// Plane of the inverse depth over a window: value at the centre and derivatives by column and row.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Plane {
    value: f64,
    by_column: f64,
    by_row: f64,
}

/// Largest standard uncertainty of a slope that a normal may have from noise, as a tangent: 9°.
pub(super) const MAX_SLOPE_NOISE: f64 = 0.15;

/// Largest half width of the window of a normal where the noise asks for it.
const MAX_HALF: usize = 12;

/// Half width of the window over which the noise of single samples leaves a slope that is certain enough.
#[inline]
pub(super) fn quiet_half(view: &View, sample: &Sample) -> usize {
    let noise = f64::from(sample.sigma) / (sample.inverse_depth.abs() * view.pitch * MAX_SLOPE_NOISE);
    // Σu² over (2h + 1)² samples must reach noise².
    let wanted = noise * noise;
    let sum = |half: usize| ((2 * half + 1) * (2 * half + 1) * half * (half + 1)) as f64 / 3.0;
    if wanted <= sum(2) { 1 } else { (3..MAX_HALF).find(|half| sum(*half) >= wanted).unwrap_or(MAX_HALF) }
}

/// Unit normal at a pixel in the view frame, towards the camera, over a window of this half width or a larger one; `None` where the neighbours do
/// not give one. `broken`: a window of 5 × 5 is known not to be one surface.
#[inline]
pub(crate) fn normal(
    view: &View,
    samples: &Raster,
    pixel: usize,
    link: Link,
    (half, broken): (usize, bool),
) -> Option<Vector3<f64>> {
    let half = half.max(quiet_half(view, &samples.at(pixel)));
    let (column, row) = (pixel % view.width, pixel / view.width);
    let inner = column >= half && row >= half && column + half < view.width && row + half < view.height;
    let full = if !inner || half > 2 || half == 2 && broken {
        None
    } else if half == 2 {
        full_window::<2>(view.width, samples, pixel, link)
    } else {
        full_window::<1>(view.width, samples, pixel, link)
    };
    let plane = match full {
        Some(plane) => plane,
        None => partial_window(view, samples, pixel, link, half)?,
    };
    let [x, y] = view.directions.at(pixel);
    let [by_column, by_row] = derivatives(view, pixel);
    // q_u = q_x x_u + q_y y_u, q_v = q_x x_v + q_y y_v.
    let inverse = 1.0 / (by_column.x * by_row.y - by_row.x * by_column.y);
    let gradient = [
        (by_row.y * plane.by_column - by_column.y * plane.by_row) * inverse,
        (by_column.x * plane.by_row - by_row.x * plane.by_column) * inverse,
    ];
    let normal = [-gradient[0], -gradient[1], -(plane.value - x * gradient[0] - y * gradient[1])];
    let unit = 1.0 / (normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]).sqrt();
    let normal = Vector3::from(normal) * unit;
    // Not finite where the directions do not spread, or the samples are none.
    normal.iter().all(|part| part.is_finite()).then_some(normal)
}

/// Columns and rows that lead along a change of the direction (x, y).
#[inline]
pub(super) fn pixels_along(view: &View, pixel: usize, change: Vector2<f64>) -> Vector2<f64> {
    let [by_column, by_row] = derivatives(view, pixel);
    let inverse = 1.0 / (by_column.x * by_row.y - by_row.x * by_column.y);
    Vector2::new(by_row.y * change.x - by_row.x * change.y, by_column.x * change.y - by_column.y * change.x)
        * inverse
}

/// Derivatives of the direction table by column and by row.
#[inline]
fn derivatives(view: &View, pixel: usize) -> [Vector2<f64>; 2] {
    let (column, row) = (pixel % view.width, pixel / view.width);
    [derivative(view, pixel, column, 1, view.width), derivative(view, pixel, row, view.width, view.height)]
}

/// Derivative of the direction table by one grid coordinate, from both neighbours or one of them.
#[inline]
fn derivative(view: &View, pixel: usize, coordinate: usize, stride: usize, count: usize) -> Vector2<f64> {
    let at = |index: usize| Vector2::from(view.directions.at(index));
    let there = |direction: &Vector2<f64>| direction.x.is_finite();
    let low = (coordinate > 0).then(|| at(pixel - stride)).filter(there);
    let high = (coordinate + 1 < count).then(|| at(pixel + stride)).filter(there);
    match (low, high) {
        (Some(low), Some(high)) => (high - low) * 0.5,
        (None, Some(high)) => high - at(pixel),
        (Some(low), None) => at(pixel) - low,
        (None, None) => Vector2::repeat(f64::NAN),
    }
}

/// The fit over a window of which every sample is on the surface; else `None`.
#[inline]
fn full_window<const HALF: usize>(width: usize, samples: &Raster, pixel: usize, link: Link) -> Option<Plane> {
    if !samples.has_corners(width, pixel, HALF) {
        return None;
    }
    let centre = &samples.at(pixel);
    let (mut sum, mut by_column, mut by_row) = (0.0, 0.0, 0.0);
    let mut worst = 0.0_f64;
    let mut row = -(HALF as f64);
    let mut start = pixel - HALF * width - HALF;
    for _ in 0..=2 * HALF {
        let mut line = 0.0;
        let mut column = -(HALF as f64);
        for depth in &samples.depths[start..=start + 2 * HALF] {
            let difference = depth - centre.inverse_depth;
            worst = worst.max(difference.abs());
            line += difference;
            by_column += column * difference;
            column += 1.0;
        }
        sum += line;
        by_row += row * line;
        row += 1.0;
        start += width;
    }
    // One bound for the window, that of its nearest ring: stricter than `joins` pixel by pixel, and the partial fit
    // takes what fails it. An absent sample makes the sum NaN.
    let limit = link.max_step * centre.inverse_depth.abs() + 6.0 * f64::from(centre.sigma);
    let side = (2 * HALF + 1) as f64;
    // Σi² over the window: side · 2 · Σ_{1..HALF} i².
    let squares = side * (HALF * (HALF + 1) * (2 * HALF + 1)) as f64 / 3.0;
    (sum.is_finite() && worst <= limit).then_some(Plane {
        value: centre.inverse_depth + sum / (side * side),
        by_column: by_column / squares,
        by_row: by_row / squares,
    })
}

/// The fit over those samples of a window that lie on the surface of its centre.
fn partial_window(view: &View, samples: &Raster, pixel: usize, link: Link, half: usize) -> Option<Plane> {
    let readable = half == HALF && is_readable((view.width, view.height), pixel);
    let Joined { n, su, sv, suu, suv, svv, sq, suq, svq } = if readable {
        joined(view.width, samples, pixel, link)
    } else {
        joined_one_by_one((view.width, view.height), samples, pixel, link, half)
    };
    if n < MIN_SAMPLES as f64 {
        return None;
    }
    let (cuu, cuv, cvv) = (suu - su * su / n, suv - su * sv / n, svv - sv * sv / n);
    let (cuq, cvq) = (suq - su * sq / n, svq - sv * sq / n);
    let determinant = cuu * cvv - cuv * cuv;
    // Samples in a line leave the slope across it open.
    if determinant < 0.05 * n * n {
        return None;
    }
    let by_column = (cvv * cuq - cuv * cvq) / determinant;
    let by_row = (cuu * cvq - cuv * cuq) / determinant;
    let value = samples.at(pixel).inverse_depth + (sq - by_column * su - by_row * sv) / n;
    Some(Plane { value, by_column, by_row })
}

/// The sums over a window of any size, which may reach beyond the image.
pub(super) fn joined_one_by_one(
    (width, height): (usize, usize),
    samples: &Raster,
    pixel: usize,
    link: Link,
    half: usize,
) -> Joined {
    let (column, row) = (pixel % width, pixel / width);
    let centre = &samples.at(pixel);
    let mut sums = Joined::default();
    for line in row.saturating_sub(half)..(row + half + 1).min(height) {
        for place in column.saturating_sub(half)..(column + half + 1).min(width) {
            let sample = &samples.at(line * width + place);
            let distance = line.abs_diff(row).max(place.abs_diff(column));
            if !link.joins(centre, sample, distance) {
                continue;
            }
            let (u, v) = (place as f64 - column as f64, line as f64 - row as f64);
            let q = sample.inverse_depth - centre.inverse_depth;
            sums.n += 1.0;
            sums.su += u;
            sums.sv += v;
            sums.suu += u * u;
            sums.suv += u * v;
            sums.svv += v * v;
            sums.sq += q;
            sums.suq += u * q;
            sums.svq += v * q;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rectify::Directions;
    use proptest::prelude::*;

    const SIDE: usize = 9;
    const PITCH: f64 = 1.0 / 2330.0;
    const LINK: Link = Link { max_step: 5.67 * PITCH };

    /// Lines of sight of a patch of a distorted image, well off the axis.
    fn directions() -> Directions {
        let lens = crate::geometry::camera::Lens::brown_conrady([-0.08, 0.05, 0.0], [2e-4, -1e-4]);
        let table = (0..SIDE * SIDE)
            .map(|i| {
                let (u, v) = ((i % SIDE) as f64, (i / SIDE) as f64);
                let ideal = lens.undistort(Vector2::new(0.2 + u * PITCH, -0.12 + v * PITCH)).unwrap();
                [ideal.x, ideal.y]
            })
            .collect();
        Directions::kept(SIDE, table)
    }

    fn view(directions: &Directions) -> View<'_> {
        View::along_the_axes([SIDE, SIDE], directions, PITCH)
    }

    fn plane(directions: &Directions, normal: Vector3<f64>, distance_mm: f64) -> Vec<Sample> {
        (0..directions.pixels())
            .map(|pixel| directions.at(pixel))
            .map(|[x, y]| Sample {
                inverse_depth: normal.dot(&Vector3::new(x, y, 1.0)) / -distance_mm,
                sigma: 0.0,
                modulation: 1.0,
                ..Sample::NONE
            })
            .collect()
    }

    proptest! {
        /// On a plane the normal is exact, with a full window, at the border, and beside a hole.
        #[test]
        fn planes_have_their_normal_everywhere(tx in -0.9_f64..0.9, ty in -0.9_f64..0.9, hole in 0..SIDE * SIDE) {
            let directions = directions();
            let normal = Vector3::new(tx, ty, -1.0).normalize();
            let mut samples = plane(&directions, normal, 400.0);
            samples[hole] = Sample::NONE;
            for half in [1, 2] {
                for pixel in (0..SIDE * SIDE).filter(|p| *p != hole) {
                    if let Some(found) = super::normal(&view(&directions), &samples[..].into(), pixel, LINK, (half, false)) {
                        // One-sided differences of the table at the border see the distortion's curvature.
                        prop_assert!((found - normal).norm() < 2e-4, "{} beside {}", found, normal);
                    } else {
                        prop_assert!(half == 1, "no normal at {}", pixel);
                    }
                }
            }
        }
    }

    #[test]
    fn a_step_does_not_bend_the_normal() {
        let directions = directions();
        let normal = Vector3::new(0.3, -0.2, -1.0).normalize();
        let mut samples = plane(&directions, normal, 400.0);
        let behind = plane(&directions, normal, 420.0);
        for pixel in (0..SIDE * SIDE).filter(|p| p % SIDE > 4) {
            samples[pixel] = behind[pixel];
        }
        for pixel in 0..SIDE * SIDE {
            let found =
                super::normal(&view(&directions), &samples[..].into(), pixel, LINK, (2, false)).unwrap();
            assert!((found - normal).norm() < 2e-4, "{found} at {pixel}");
        }
    }

    #[test]
    fn too_few_neighbours_give_none() {
        let directions = directions();
        let mut samples = plane(&directions, -Vector3::z(), 400.0);
        for (pixel, sample) in samples.iter_mut().enumerate() {
            if pixel / SIDE != 4 {
                *sample = Sample::NONE;
            }
        }
        let raster = Raster::from(&samples[..]);
        assert_eq!(
            super::normal(&view(&directions), &raster, 4 * SIDE + 4, LINK, (2, false)),
            None,
            "a single line"
        );
    }
}
