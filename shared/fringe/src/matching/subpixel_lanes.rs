//! The fine stage for some pixels side by side: the same steps as [`solve`](super::subpixel::solve), as vectors, where the 4 × 4
//! neighbourhood is one smooth surface and two evaluations of the curve are enough. That is so nearly everywhere; other pixels are
//! left to it. Pixels that need the second evaluation wait for others that do.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::patch::{Interpolation, MAX_NOISE, MAX_ROUGHNESS, Patch};
use super::subpixel::{RightPhase, inside};
use crate::geometry::camera::LensKind;
use crate::rectify::RectifiedCamera;
pub(super) use crate::surface::LANES;

type Lanes = [f64; LANES];

/// Pixels whose coarse place is known.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Batch {
    /// Which of them are asked.
    pub live: [bool; LANES],
    /// Phase of the pixel, rad.
    pub wanted: [f32; LANES],
    /// Rectified coordinates of the pixel.
    pub left_x: Lanes,
    pub y: Lanes,
    /// Coarse rectified abscissa on the right.
    pub coarse: Lanes,
    /// How far the fine place may be from it, px.
    pub search_px: Lanes,
    /// Smallest and largest disparity.
    pub limits: [Lanes; 2],
    /// Uncertainty of the phase, rad.
    pub sigma_rad: Lanes,
    /// Modulation of the pixel, DN.
    pub modulation: [f32; LANES],
    /// Marks where its surface ends nearby in the left picture.
    pub limbs: [u8; LANES],
    /// Rectified abscissa on the right from where the search goes on.
    pub x: Lanes,
    /// Columns and rows of the cells in which it was last.
    pub cell: [[i32; LANES]; 2],
}

impl Batch {
    /// Takes a pixel of another batch, which is to be searched on from where it was found.
    #[inline(always)]
    pub fn take(&mut self, to: usize, (other, from): (&Self, usize), found: &Found) {
        (self.wanted[to], self.modulation[to], self.limbs[to]) =
            (other.wanted[from], other.modulation[from], other.limbs[from]);
        (self.left_x[to], self.y[to], self.coarse[to]) =
            (other.left_x[from], other.y[from], other.coarse[from]);
        (self.search_px[to], self.sigma_rad[to]) = (other.search_px[from], other.sigma_rad[from]);
        self.x[to] = found.x[from];
        for axis in 0..2 {
            self.limits[axis][to] = other.limits[axis][from];
            self.cell[axis][to] = found.cell[axis][from];
        }
    }
}

/// What one evaluation found of a batch.
pub(super) struct Found {
    /// Whether the general way has to take over.
    pub lost: [bool; LANES],
    /// Whether the place is exact enough; where neither, the search goes on.
    pub settled: [bool; LANES],
    /// Rectified abscissa, as far as it is known.
    pub x: Lanes,
    /// Columns and rows of the cells.
    pub cell: [[i32; LANES]; 2],
    /// Derivative of the right phase along the curve, rad per unit of x.
    pub slope: Lanes,
    /// Variance of the interpolated right phase, rad².
    pub variance: Lanes,
    /// Index of the nearest native pixel, where it is settled.
    pub pixel: [usize; LANES],
}

/// What the places of a batch say of its depths.
pub(super) struct Depths {
    /// Inverse depth, 1/mm, and its uncertainty.
    pub inverse_depth: Lanes,
    pub sigma: [f32; LANES],
    /// Share of its variance that comes from the pixel itself.
    pub own_share: [f32; LANES],
    /// Whether it is certain enough, and its disparity within the limits.
    pub certain: [bool; LANES],
    pub within: [bool; LANES],
}

/// The depths of the settled pixels of a batch, for a baseline and a largest uncertainty of the place.
#[inline(always)]
pub(super) fn depths_beside(batch: &Batch, found: &Found, baseline_mm: f64, most: f64) -> Depths {
    let mut out = Depths {
        inverse_depth: [0.0; LANES],
        sigma: [0.0; LANES],
        own_share: [0.0; LANES],
        certain: [false; LANES],
        within: [false; LANES],
    };
    for l in 0..LANES {
        let own = batch.sigma_rad[l] * batch.sigma_rad[l];
        let both = own + found.variance[l];
        let sigma = (both / (found.slope[l] * found.slope[l])).sqrt();
        let disparity = batch.left_x[l] - found.x[l];
        out.inverse_depth[l] = disparity / baseline_mm;
        out.sigma[l] = (sigma / baseline_mm) as f32;
        out.own_share[l] = if both > 0.0 { (own / both) as f32 } else { 1.0 };
        out.certain[l] = sigma <= most;
        out.within[l] = (batch.limits[0][l] <= disparity) & (disparity <= batch.limits[1][l]);
    }
    out
}

/// Places on the curves, which become offsets from the centres of cells.
struct Places {
    offset: [Lanes; 2],
    tangent: [Lanes; 2],
    stretch: Lanes,
}

/// One evaluation and one step for each pixel of a batch; `again` where it is their second one.
#[inline(always)]
pub(super) fn step_beside(right: &RightPhase, camera: &RectifiedCamera, batch: &Batch, again: bool) -> Found {
    let usable = right.interpolation == Interpolation::Quadratic && right.width >= 4 && right.height >= 4;
    let mut found = Found {
        lost: [!usable; LANES],
        settled: [false; LANES],
        x: batch.x,
        cell: batch.cell,
        slope: [0.0; LANES],
        variance: [0.0; LANES],
        pixel: [0; LANES],
    };
    for (lost, live) in found.lost.iter_mut().zip(&batch.live) {
        *lost |= !live;
    }
    if usable {
        let mut places = evaluate(camera, batch);
        let (samples, sigma) = places.gather(right, batch, again, &mut found);
        places.advance(right, batch, (&samples, &sigma), &mut found);
    }
    found
}

/// The places on the curves, as [`crate::rectify::EpipolarCurve::at`] gives them.
#[inline(always)]
fn evaluate(camera: &RectifiedCamera, batch: &Batch) -> Places {
    let zero = [0.0; LANES];
    let mut out = Places { offset: [zero; 2], tangent: [zero; 2], stretch: zero };
    if camera.camera.distortion.kind != LensKind::BrownConrady {
        for l in 0..LANES {
            let at = camera.curve(batch.y[l]).at(batch.x[l]);
            (out.offset[0][l], out.offset[1][l]) = (at.pixel[0], at.pixel[1]);
            (out.tangent[0][l], out.tangent[1][l]) = (at.tangent[0], at.tangent[1]);
            out.stretch[l] = at.stretch;
        }
        return out;
    }
    let m = &camera.camera_from_rectified;
    let along = [m[(0, 0)], m[(1, 0)], m[(2, 0)]];
    let by_y = [m[(0, 1)], m[(1, 1)], m[(2, 1)]];
    let base = [m[(0, 2)], m[(1, 2)], m[(2, 2)]];
    let ([k1, k2, k3], [p1, p2]) = (camera.camera.distortion.k, camera.camera.distortion.p);
    let ([fx, fy], skew, [cx, cy]) =
        (camera.camera.focal_px, camera.camera.skew, camera.camera.principal_point_px);
    for l in 0..LANES {
        let (x, y) = (batch.x[l], batch.y[l]);
        let mut direction = [0.0; 3];
        for (i, direction) in direction.iter_mut().enumerate() {
            *direction = (by_y[i] * y + base[i]) + along[i] * x;
        }
        let inverse_z = if direction[2] > 0.0 { 1.0 / direction[2] } else { f64::NAN };
        let (u, v) = (direction[0] * inverse_z, direction[1] * inverse_z);
        let (du, dv) = ((along[0] - u * along[2]) * inverse_z, (along[1] - v * along[2]) * inverse_z);
        let r2 = u * u + v * v;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let bent_u = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u);
        let bent_v = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v;
        let slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3));
        let cross = slope * u * v + 2.0 * p1 * u + 2.0 * p2 * v;
        let turned_u = (radial + slope * u * u + 2.0 * p1 * v + 6.0 * p2 * u) * du + cross * dv;
        let turned_v = cross * du + (radial + slope * v * v + 6.0 * p1 * v + 2.0 * p2 * u) * dv;
        out.offset[0][l] = fx * bent_u + skew * bent_v + cx;
        out.offset[1][l] = fy * bent_v + cy;
        out.tangent[0][l] = fx * turned_u + skew * turned_v;
        out.tangent[1][l] = fy * turned_v;
        out.stretch[l] = -2.0 * along[2] * inverse_z;
    }
    out
}

impl Places {
    /// Finds the cells and their 4 × 4 samples, less the wanted phase, line by line; places become offsets from the centres of the cells.
    #[inline(always)]
    fn gather(
        &mut self,
        right: &RightPhase,
        batch: &Batch,
        again: bool,
        found: &mut Found,
    ) -> (Lines, Singles) {
        let last = [right.width as f64 - 2.0, right.height as f64 - 2.0];
        let width = right.width as i32;
        let (mut first, mut nearest) = ([0; LANES], [0; LANES]);
        for l in 0..LANES {
            let place = [self.offset[0][l], self.offset[1][l]];
            let from =
                |column: i32, row: i32| [place[0] - f64::from(column) - 0.5, place[1] - f64::from(row) - 0.5];
            let kept = again & inside(from(found.cell[0][l], found.cell[1][l]));
            // The whole neighbourhood must lie in the image; NaN fails the comparison.
            let inner = (place[0] >= 1.0) & (place[1] >= 1.0) & (place[0] < last[0]) & (place[1] < last[1]);
            found.lost[l] |= !(kept | inner);
            let there = |at: f64, before: i32| {
                if kept {
                    before
                } else if inner {
                    at as i32
                } else {
                    1
                }
            };
            let (column, row) = (there(place[0], found.cell[0][l]), there(place[1], found.cell[1][l]));
            (found.cell[0][l], found.cell[1][l]) = (column, row);
            let offset = from(column, row);
            (self.offset[0][l], self.offset[1][l]) = (offset[0], offset[1]);
            first[l] = (row - 1) * width + column - 1;
            nearest[l] = near(first[l] + width + 1, width, offset);
        }
        let (mut lines, mut sigma) = ([[0.0; 4 * LANES]; 4], [0.0; LANES]);
        for l in 0..LANES {
            let rows = &right.phase_rad[first[l] as usize..];
            for line in 0..4 {
                lines[line][4 * l..4 * l + 4].copy_from_slice(&rows[line * right.width..][..4]);
            }
            sigma[l] = right.sigma_rad[nearest[l] as usize];
        }
        let mut wanted = [0.0; 4 * LANES];
        for l in 0..LANES {
            wanted[4 * l..4 * l + 4].copy_from_slice(&[batch.wanted[l]; 4]);
        }
        for samples in &mut lines {
            for i in 0..4 * LANES {
                samples[i] -= wanted[i];
            }
        }
        (lines, sigma)
    }

    /// One step along the tangents to where the models vanish, as [`Patch::step`] makes it; places that are exact enough are settled.
    #[inline(always)]
    fn advance(
        &self,
        right: &RightPhase,
        batch: &Batch,
        (samples, sigma): (&Lines, &Singles),
        found: &mut Found,
    ) {
        let Patches { a, b: [bx, by], c: [cxx, cxy, cyy], accepted } = Patches::fit(samples, sigma);
        let pitch = right.pitch;
        let (mut steps, mut slopes) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            let (xi, eta) = (self.offset[0][l] as f32, self.offset[1][l] as f32);
            let (tx, ty) = ((self.tangent[0][l] * pitch) as f32, (self.tangent[1][l] * pitch) as f32);
            let value = a[l]
                + xi * (bx[l] + cxy[l] * eta)
                + by[l] * eta
                + cxx[l] * (xi * xi - 1.25)
                + cyy[l] * (eta * eta - 1.25);
            let gx = bx[l] + 2.0 * cxx[l] * xi + cxy[l] * eta;
            let gy = by[l] + 2.0 * cyy[l] * eta + cxy[l] * xi;
            let slope = gx * tx + gy * ty;
            let bend = 2.0 * (cxx[l] * tx * tx + cxy[l] * tx * ty + cyy[l] * ty * ty);
            let inverse = 1.0 / slope;
            let mut step = -value * inverse;
            step -= 0.5 * bend * step * step * inverse;
            step -= (value + step * (slope + 0.5 * bend * step)) / (slope + bend * step);
            (steps[l], slopes[l]) = (step, slope + bend * step);
        }
        let zero = [0.0; LANES];
        let (mut x, mut slope, mut factor, mut ends) = (zero, zero, zero, [zero; 2]);
        // Whether the step is one that the search may make, and whether it ends the search.
        let mut holds = [[false; LANES]; 2];
        for l in 0..LANES {
            let along = f64::from(steps[l]) * pitch;
            let search = batch.search_px[l] * pitch;
            x[l] = batch.x[l] + along * (1.0 - 0.5 * self.stretch[l] * along);
            let end = [
                self.offset[0][l] + self.tangent[0][l] * along,
                self.offset[1][l] + self.tangent[1][l] * along,
            ];
            slope[l] = f64::from(slopes[l]) / pitch;
            factor[l] = Patch::quadratic_variance(end[0], end[1]);
            (ends[0][l], ends[1][l]) = (end[0], end[1]);
            holds[0][l] = along.abs() <= 2.0 * search;
            holds[1][l] =
                (along.abs() < right.reach) & inside(end) & ((x[l] - batch.coarse[l]).abs() <= search);
        }
        (found.x, found.slope) = (x, slope);
        let width = right.width as i32;
        let mut pixel = [0; LANES];
        for l in 0..LANES {
            found.lost[l] |= !(holds[0][l] & accepted[l]);
            found.settled[l] = holds[1][l] & !found.lost[l];
            let near = near(found.cell[1][l] * width + found.cell[0][l], width, [ends[0][l], ends[1][l]]);
            pixel[l] = if found.settled[l] { near } else { 0 };
        }
        let mut sigma = zero;
        for l in 0..LANES {
            found.pixel[l] = pixel[l] as usize;
            sigma[l] = f64::from(right.sigma_rad[found.pixel[l]]);
        }
        for l in 0..LANES {
            found.variance[l] = factor[l] * sigma[l] * sigma[l];
        }
    }
}

/// The pixel of a cell that is nearest to a place in it, from its first pixel and the offset from its centre.
#[inline(always)]
fn near(first: i32, width: i32, offset: [f64; 2]) -> i32 {
    first + if offset[1] > 0.0 { width } else { 0 } + i32::from(offset[0] > 0.0)
}

/// Four lines of samples, four of each pixel after the other.
type Lines = [[f32; 4 * LANES]; 4];

/// Single values of the pixels side by side.
type Singles = [f32; LANES];

/// The quadratics of [`Patch::quadratic`], side by side.
struct Patches {
    a: Singles,
    b: [Singles; 2],
    c: [Singles; 3],
    /// Whether the quadratic holds.
    accepted: [bool; LANES],
}

impl Patches {
    /// The same steps in the same order as for one pixel.
    #[inline(always)]
    fn fit(samples: &Lines, sigma: &Singles) -> Self {
        let zero = [0.0; LANES];
        let lines = [0.0; 4 * LANES];
        let (mut zeroth, mut first, mut second, mut squares) = (lines, lines, lines, lines);
        let [l0, l1, l2, l3] = samples;
        for i in 0..4 * LANES {
            let (inner, outer) = (l1[i] + l2[i], l0[i] + l3[i]);
            zeroth[i] = inner + outer;
            first[i] = 1.5 * (l3[i] - l0[i]) + 0.5 * (l2[i] - l1[i]);
            second[i] = outer - inner;
            squares[i] = l0[i] * l0[i] + l1[i] * l1[i] + l2[i] * l2[i] + l3[i] * l3[i];
        }
        let (zeroth, first) = (columns(&zeroth), columns(&first));
        let (second, squares) = (columns(&second), columns(&squares));
        let (mut out, mut residual, mut limit) =
            (Self { a: zero, b: [zero; 2], c: [zero; 3], accepted: [false; LANES] }, zero, zero);
        let Self { a, b: [bx, by], c: [cxx, cxy, cyy], accepted } = &mut out;
        for l in 0..LANES {
            // As `Patch::quadratic`, number by number.
            let sum = |v: &[Singles; 4]| (v[0][l] + v[3][l]) + (v[1][l] + v[2][l]);
            let slope = |v: &[Singles; 4]| 1.5 * (v[3][l] - v[0][l]) + 0.5 * (v[2][l] - v[1][l]);
            let (a_, bx_, cxx_) = (sum(&zeroth), slope(&zeroth), {
                (zeroth[0][l] + zeroth[3][l]) - (zeroth[1][l] + zeroth[2][l])
            });
            let (by_, cxy_, cyy_, squares) = (sum(&first), slope(&first), sum(&second), sum(&squares));
            let explained = a_ * a_ / 16.0
                + (bx_ * bx_ + by_ * by_) / 20.0
                + (cxx_ * cxx_ + cyy_ * cyy_) / 16.0
                + cxy_ * cxy_ / 25.0;
            (a[l], bx[l], by[l]) = (a_ / 16.0, bx_ / 20.0, by_ / 20.0);
            (cxx[l], cxy[l], cyy[l]) = (cxx_ / 16.0, cxy_ / 25.0, cyy_ / 16.0);
            let noise = MAX_NOISE * sigma[l];
            residual[l] = (squares - explained) / 10.0;
            limit[l] = noise * noise
                + MAX_ROUGHNESS * MAX_ROUGHNESS * (bx[l] * bx[l] + by[l] * by[l])
                + 1e-6 * squares;
        }
        for l in 0..LANES {
            // NaN (a masked sample) fails the comparison.
            accepted[l] = residual[l] <= limit[l];
        }
        out
    }
}

/// The first values of all pixels, then the second ones, and so on.
#[inline(always)]
fn columns(line: &[f32; 4 * LANES]) -> [Singles; 4] {
    let mut columns = [[0.0; LANES]; 4];
    for l in 0..LANES {
        for (i, column) in columns.iter_mut().enumerate() {
            column[l] = line[4 * l + i];
        }
    }
    columns
}
