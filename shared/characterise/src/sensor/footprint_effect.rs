//! What an error of a camera's footprint does to points.
//!
//! A pixel sees the surface as its footprint of variance s² averages it: not the point X of its ray, but X + s² v with
//!
//! ```text
//! v = ½ ∇²X + (∇ ln B · ∇) X,
//! ```
//!
//! derivatives by columns and rows of the picture, B the modulation. The decoder takes this off the phase ([`fringe::decode`]); a footprint
//! that is wrong by δ leaves δ v. The other view of the pair then finds the phase of X + δ v where the surface has it in the epipolar
//! plane, which is τ = δ (a · v) / (a · e) from X along the surface: a is the gradient of the phase in space, e the tangent of the
//! surface in that plane. Where both rays now meet lies beside the surface, by
//!
//! ```text
//! τ (e × r) / (l × r) · (n · l)
//! ```
//!
//! along the normal n, with l and r the directions of the left and the right ray and × the product in the plane. An error of the right
//! camera has the other sign. The same error of both moves the front of a sphere of radius R inwards by δ p² / R, p a pixel on it; what
//! shading does nearly cancels between them then, so that an error of one camera alone moves a sphere more than that of both.

use fringe::cloud::Point;
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use fringe::math::ln;
use nalgebra::{Matrix6, Matrix6x4, Point2, Point3, Vector3, Vector6};
use rayon::prelude::*;

/// Half widths of the windows that are tried, px: thinned clouds need wider ones.
const HALVES: [i32; 3] = [2, 4, 8];
/// Fewer points of a window make no quadratic.
const LEAST_POINTS: usize = 15;
/// Points of a window further apart than so many pixels on a surface across the ray, for each pixel of the half width, lie on two surfaces.
const STEEPEST: f64 = 8.0;
/// Steps of the gradient of a projector's coordinates, mm.
const STEP_MM: f64 = 1e-3;
/// Largest variance of a second derivative's half, px⁻⁴ of one point's: 25 points of a square have 1/70, strips of one or two rows far more.
const MOST_LEVERAGE: f64 = 0.1;
/// No point stands at this pixel.
const NONE: u32 = u32::MAX;

/// How far along its normal each point moves where the variance of a camera's footprint is larger, mm per px².
#[derive(Debug, Clone, PartialEq)]
pub struct FootprintEffect {
    along_mm: Vec<f64>,
    /// Of the points that the camera takes part in, the share of which the effect could be found.
    judged: f64,
}

impl FootprintEffect {
    /// Of one camera of a rig on a cloud whose points name the pairs of that rig. Points of other cameras, without a normal, or without neighbours stay.
    pub fn of(rig: &Rig, camera: &str, points: &[Point]) -> Self {
        let mut along_mm = vec![0.0; points.len()];
        let (mut seen, mut judged) = (0_u32, 0_u32);
        for (number, pair) in rig.pairs.iter().enumerate() {
            let Some(sight) = Sight::new(rig, pair, camera) else { continue };
            let own: Vec<usize> = (0..points.len()).filter(|i| points[*i].pair as usize == number).collect();
            let picture = Picture::new(sight.own, points, &own);
            let by = |i: usize| Some(sight.displaced(&points[own[i]], &picture.blurred(i)?));
            let found: Vec<Option<f64>> = (0..own.len()).into_par_iter().map(by).collect();
            seen += own.len() as u32;
            judged += found.iter().flatten().count() as u32;
            for (index, effect) in own.iter().zip(found) {
                along_mm[*index] = effect.unwrap_or(0.0);
            }
        }
        // Where it sees nothing, nothing is unknown.
        let judged = if seen == 0 { 1.0 } else { f64::from(judged) / f64::from(seen) };
        Self { along_mm, judged }
    }

    /// Of the points that the camera takes part in, the share of which the effect could be found, 0 … 1: not at edges, nor in clouds so thin
    /// that no neighbours are near.
    pub fn judged(&self) -> f64 {
        self.judged
    }

    /// What happens where the footprints of several cameras change together, each by its part of one px².
    pub fn together(parts: &[(Self, f64)]) -> Self {
        let count = parts.iter().map(|(effect, _)| effect.along_mm.len()).max().unwrap_or(0);
        let mut along_mm = vec![0.0; count];
        for (effect, part) in parts {
            along_mm.iter_mut().zip(&effect.along_mm).for_each(|(sum, along_mm)| *sum += along_mm * part);
        }
        let judged = parts.iter().map(|(effect, _)| effect.judged).fold(1.0, f64::min);
        Self { along_mm, judged }
    }

    /// The points where the variance of the footprint is larger by so much, px², than what was taken off.
    pub fn moved(&self, points: &[Point], change_px2: f64) -> Vec<Point> {
        let one = |(point, along_mm): (&Point, &f64)| {
            let position = point.position() + point.normal_vector() * (along_mm * change_px2);
            Point { position_mm: position.into(), ..*point }
        };
        points.iter().zip(&self.along_mm).map(one).collect()
    }
}

/// A pair, as one of its cameras takes part in it.
struct Sight<'a> {
    own: &'a Camera,
    left_mm: Point3<f64>,
    right_mm: Point3<f64>,
    projector: Option<&'a Camera>,
    /// −1 for the right view.
    sign: f64,
}

impl<'a> Sight<'a> {
    /// `None` where the camera is not of this pair, or a view is unknown.
    fn new(rig: &'a Rig, pair: &Pair, camera: &str) -> Option<Self> {
        let sign = match camera {
            name if name == pair.left => 1.0,
            name if name == pair.right => -1.0,
            _ => return None,
        };
        let (left, right) = (rig.device(&pair.left)?, rig.device(&pair.right)?);
        Some(Self {
            own: rig.camera(camera)?,
            left_mm: left.centre_mm(),
            right_mm: right.centre_mm(),
            projector: rig.projector(&pair.projector),
            sign,
        })
    }

    /// How far the point moves along its normal where the camera sees the surface displaced; 0 where the geometry leaves it open.
    fn displaced(&self, point: &Point, blur: &Vector3<f64>) -> f64 {
        let (place, normal) = (point.position(), point.normal_vector());
        let [left, right] = [self.left_mm, self.right_mm].map(|centre| (place - centre).normalize());
        let plane = left.cross(&right).normalize();
        let along = normal.cross(&plane).normalize();
        let gradient = self.gradient(&place, &along, [left, right]);
        let shift = gradient.dot(blur) / gradient.dot(&along);
        let across = |a: &Vector3<f64>, b: &Vector3<f64>| a.cross(b).dot(&plane);
        let moved = shift * across(&along, &right) / across(&left, &right) * normal.dot(&left);
        if moved.is_finite() { self.sign * moved } else { 0.0 }
    }

    /// Direction in which the phase grows: that of the projector's axis that changes more along the surface, or, where the projector is not
    /// calibrated, as if it stood between the views.
    fn gradient(&self, place: &Point3<f64>, along: &Vector3<f64>, rays: [Vector3<f64>; 2]) -> Vector3<f64> {
        let [left, right] = rays;
        let between = || (left + right).cross(&left.cross(&right));
        let at = |step: Vector3<f64>| Some(self.projector?.project(&(place + step))?.coords);
        let by_axis = |axis: usize| {
            let step = Vector3::ith(axis, STEP_MM);
            Some((at(step)? - at(-step)?) / (2.0 * STEP_MM))
        };
        let (Some(x), Some(y), Some(z)) = (by_axis(0), by_axis(1), by_axis(2)) else { return between() };
        let [u, v] = [0, 1].map(|axis| Vector3::new(x[axis], y[axis], z[axis]));
        if u.dot(along).abs() >= v.dot(along).abs() { u } else { v }
    }
}

/// The points of a pair in the picture of a camera.
struct Picture<'a> {
    points: &'a [Point],
    own: &'a [usize],
    pixels: Vec<Option<Point2<f64>>>,
    /// The point at each pixel.
    grid: Vec<u32>,
    size: [i32; 2],
    centre_mm: Point3<f64>,
    focal_px: f64,
}

impl<'a> Picture<'a> {
    fn new(camera: &Camera, points: &'a [Point], own: &'a [usize]) -> Self {
        let seen = |i: &usize| camera.project(&points[*i].position()).filter(|pixel| camera.contains(*pixel));
        let pixels: Vec<_> = own.par_iter().map(seen).collect();
        let size = [camera.width_px as i32, camera.height_px as i32];
        let mut grid = vec![NONE; camera.width_px as usize * camera.height_px as usize];
        for (number, pixel) in pixels.iter().enumerate() {
            if let Some(at) = pixel.and_then(|pixel| place(size, nearest(&pixel))) {
                grid[at] = number as u32;
            }
        }
        let (centre_mm, focal_px) = (camera.centre_mm(), camera.focal_px[0]);
        Self { points, own, pixels, grid, size, centre_mm, focal_px }
    }

    /// By how much the camera sees a point displaced, mm per px² of its footprint; `None` where its neighbours do not make one surface.
    fn blurred(&self, number: usize) -> Option<Vector3<f64>> {
        let pixel = self.pixels[number]?;
        let point = &self.points[self.own[number]];
        let pitch_mm = (point.position() - self.centre_mm).norm() / self.focal_px;
        for half in HALVES {
            let found = self.neighbours(&pixel, half);
            if found.len() < LEAST_POINTS {
                continue;
            }
            let (mut normal, mut moments) = (Matrix6::zeros(), Matrix6x4::zeros());
            let far_mm = STEEPEST * f64::from(half) * pitch_mm;
            for (offset, other) in found {
                let apart = other.position() - point.position();
                if apart.norm() > far_mm {
                    return None;
                }
                let (u, v) = (offset.x, offset.y);
                let terms = Vector6::new(1.0, u, v, u * u, u * v, v * v);
                let ratio = f64::from(other.modulation) / f64::from(point.modulation);
                // Clouds of other programs may have no modulation: as if the light were even.
                let brightness = if ratio > 0.0 && ratio < f64::INFINITY { ln(ratio) } else { 0.0 };
                normal += terms * terms.transpose();
                moments += terms * nalgebra::RowVector4::new(apart.x, apart.y, apart.z, brightness);
            }
            let inverse = normal.cholesky()?.inverse();
            // NaN fails the comparison.
            let determined = inverse[(3, 3)] <= MOST_LEVERAGE && inverse[(5, 5)] <= MOST_LEVERAGE;
            if !determined {
                continue;
            }
            let fit = inverse * moments;
            let part = |row: usize| Vector3::new(fit[(row, 0)], fit[(row, 1)], fit[(row, 2)]);
            // A quadratic's second derivative is twice its coefficient, of which half counts.
            let blur = part(3) + part(5) + part(1) * fit[(1, 3)] + part(2) * fit[(2, 3)];
            return blur.iter().all(|part| part.is_finite()).then_some(blur);
        }
        None
    }

    /// Points about a pixel, with their distance from it, px.
    fn neighbours(&self, pixel: &Point2<f64>, half: i32) -> Vec<(nalgebra::Vector2<f64>, &Point)> {
        let [column, row] = nearest(pixel);
        let window = (-half..=half).flat_map(|v| (-half..=half).map(move |u| [column + u, row + v]));
        let standing = window.filter_map(|at| place(self.size, at)).map(|at| self.grid[at]);
        let numbers = standing.filter(|number| *number != NONE).map(|number| number as usize);
        numbers
            .filter_map(|number| Some((self.pixels[number]? - pixel, &self.points[self.own[number]])))
            .collect()
    }
}

/// Column and row of the pixel that a place lies in.
fn nearest(pixel: &Point2<f64>) -> [i32; 2] {
    [pixel.x.round() as i32, pixel.y.round() as i32]
}

/// Index of a pixel; `None` outside of the picture.
fn place([width, height]: [i32; 2], [column, row]: [i32; 2]) -> Option<usize> {
    let inside = (0..width).contains(&column) && (0..height).contains(&row);
    inside.then(|| row as usize * width as usize + column as usize)
}

#[cfg(test)]
mod tests;
