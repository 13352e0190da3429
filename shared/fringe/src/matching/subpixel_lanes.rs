//! The fine stage for some pixels side by side: the same steps as [`solve`](super::subpixel::solve), as vectors, where the 4 × 4
//! neighbourhood is one smooth surface and two evaluations of the curve are enough. That is so nearly everywhere; other pixels are
//! left to it. Pixels that need the second evaluation wait for others that do.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::patch::Interpolation;
use super::patch_lanes::{Lines, Patches, Singles};
use super::subpixel::{CELL_MARGIN, RightPhase};
use crate::geometry::camera::LensKind;
use crate::math::simd::{narrowed, widened};
use crate::rectify::RectifiedCamera;
pub(super) use crate::surface::LANES;
use fearless_simd::{Select, Simd, SimdBase, SimdFloat, SimdFrom, SimdMask, f32x8, f64x8, mask64x8};

type Lanes = [f64; LANES];

/// A bit for each of the pixels side by side, the first one lowest.
pub(super) type Bits = u8;

/// Adding this to a whole number from 0 to 2⁵² leaves it in the low bits. A plain cast checks its range, which is no vector.
const WHOLE: f64 = 4_503_599_627_370_496.0;

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
    pub cell: [Lanes; 2],
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
    pub lost: Bits,
    /// Whether the place is exact enough; where neither, the search goes on.
    pub settled: Bits,
    /// Rectified abscissa, as far as it is known.
    pub x: Lanes,
    /// Columns and rows of the cells.
    pub cell: [Lanes; 2],
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
    pub certain: Bits,
    pub within: Bits,
}

/// The bits of those that are true.
#[inline(always)]
pub(super) fn bits(flags: &[bool; LANES]) -> Bits {
    let mut bits = 0;
    for (l, flag) in flags.iter().enumerate() {
        bits |= u8::from(*flag) << l;
    }
    bits
}

/// The depths of the settled pixels of a batch, for a baseline and a largest uncertainty of the place.
#[inline(always)]
pub(super) fn depths_beside<S: Simd>(
    simd: S,
    batch: &Batch,
    found: &Found,
    baseline_mm: f64,
    most: f64,
) -> Depths {
    let of = |lanes: Lanes| f64x8::simd_from(simd, lanes);
    let (sigma_rad, slope) = (of(batch.sigma_rad), of(found.slope));
    let own = sigma_rad * sigma_rad;
    let both = own + of(found.variance);
    let sigma = (both / (slope * slope)).sqrt();
    let disparity = of(batch.left_x) - of(found.x);
    let share = both.simd_gt(0.0).select(own / both, f64x8::simd_from(simd, 1.0));
    let within = set(of(batch.limits[0]).simd_le(disparity)) & set(disparity.simd_le(of(batch.limits[1])));
    Depths {
        inverse_depth: (disparity / baseline_mm).into(),
        sigma: narrowed(simd, sigma / baseline_mm).into(),
        own_share: narrowed(simd, share).into(),
        certain: set(sigma.simd_le(most)),
        within,
    }
}

/// Places on the curves, which become offsets from the centres of cells.
struct Places<S: Simd> {
    offset: [f64x8<S>; 2],
    tangent: [f64x8<S>; 2],
    stretch: f64x8<S>,
}

/// One evaluation and one step for each pixel of a batch; `again` where it is their second one.
#[inline(always)]
pub(super) fn step_beside<S: Simd>(
    simd: S,
    right: &RightPhase,
    camera: &RectifiedCamera,
    batch: &Batch,
    again: bool,
) -> Found {
    let usable = right.interpolation == Interpolation::Quadratic && right.width >= 4 && right.height >= 4;
    let mut found = Found {
        lost: if usable { !bits(&batch.live) } else { Bits::MAX },
        settled: 0,
        x: batch.x,
        cell: batch.cell,
        slope: [0.0; LANES],
        variance: [0.0; LANES],
        pixel: [0; LANES],
    };
    if usable {
        let mut places = evaluate(simd, camera, batch);
        let (samples, sigma) = places.gather(simd, right, batch, again, &mut found);
        places.advance(simd, right, batch, (&samples, &sigma), &mut found);
    }
    found
}

/// The places on the curves, as [`crate::rectify::EpipolarCurve::at`] gives them.
#[inline(always)]
fn evaluate<S: Simd>(simd: S, camera: &RectifiedCamera, batch: &Batch) -> Places<S> {
    let all = |value: f64| f64x8::simd_from(simd, value);
    let of = |lanes: Lanes| f64x8::simd_from(simd, lanes);
    if camera.camera.distortion.kind != LensKind::BrownConrady {
        let zero = [0.0; LANES];
        let (mut offset, mut tangent, mut stretch) = ([zero; 2], [zero; 2], zero);
        for l in 0..LANES {
            let at = camera.curve(batch.y[l]).at(batch.x[l]);
            (offset[0][l], offset[1][l]) = (at.pixel[0], at.pixel[1]);
            (tangent[0][l], tangent[1][l]) = (at.tangent[0], at.tangent[1]);
            stretch[l] = at.stretch;
        }
        let pair = |[x, y]: [Lanes; 2]| [of(x), of(y)];
        return Places { offset: pair(offset), tangent: pair(tangent), stretch: of(stretch) };
    }
    let m = &camera.camera_from_rectified;
    let along = [m[(0, 0)], m[(1, 0)], m[(2, 0)]];
    let by_y = [m[(0, 1)], m[(1, 1)], m[(2, 1)]];
    let base = [m[(0, 2)], m[(1, 2)], m[(2, 2)]];
    let ([k1, k2, k3], [p1, p2]) = (camera.camera.distortion.k, camera.camera.distortion.p);
    let ([fx, fy], skew, [cx, cy]) =
        (camera.camera.focal_px, camera.camera.skew, camera.camera.principal_point_px);
    let (x, y) = (of(batch.x), of(batch.y));
    let direction = turned([by_y, base, along], x, y);
    let z = direction[2];
    let inverse_z = z.simd_gt(0.0).select(all(1.0) / z, all(f64::NAN));
    let (u, v) = (direction[0] * inverse_z, direction[1] * inverse_z);
    let du = (all(along[0]) - u * along[2]) * inverse_z;
    let dv = (all(along[1]) - v * along[2]) * inverse_z;
    let r2 = u * u + v * v;
    let radial = r2 * (r2 * (r2 * k3 + k2) + k1) + 1.0;
    let bent_u = u * radial + u * (2.0 * p1) * v + (r2 + u * 2.0 * u) * p2;
    let bent_v = v * radial + (r2 + v * 2.0 * v) * p1 + u * (2.0 * p2) * v;
    let slope = (r2 * (r2 * 3.0 * k3 + 2.0 * k2) + k1) * 2.0;
    let cross = slope * u * v + u * (2.0 * p1) + v * (2.0 * p2);
    let turned_u = (radial + slope * u * u + v * (2.0 * p1) + u * (6.0 * p2)) * du + cross * dv;
    let turned_v = cross * du + (radial + slope * v * v + v * (6.0 * p1) + u * (2.0 * p2)) * dv;
    Places {
        offset: [bent_u * fx + bent_v * skew + cx, bent_v * fy + cy],
        tangent: [turned_u * fx + turned_v * skew, turned_v * fy],
        stretch: inverse_z * (-2.0 * along[2]),
    }
}

/// Directions of places, by their y, all alike, and by their x. A closure that computes may stay a call, which is compiled for the plainest
/// processor.
#[inline(always)]
fn turned<S: Simd>([by_y, base, by_x]: [[f64; 3]; 3], x: f64x8<S>, y: f64x8<S>) -> [f64x8<S>; 3] {
    [
        (y * by_y[0] + base[0]) + x * by_x[0],
        (y * by_y[1] + base[1]) + x * by_x[1],
        (y * by_y[2] + base[2]) + x * by_x[2],
    ]
}

/// Those of a comparison that are true, as bits: to join bits takes no vector.
#[inline(always)]
pub(super) fn set<S: Simd>(mask: mask64x8<S>) -> Bits {
    mask.to_bitmask() as Bits
}

/// Whether offsets from the centre of a cell lie in it, as [`super::subpixel::inside`] says.
#[inline(always)]
fn are_inside<S: Simd>([x, y]: [f64x8<S>; 2]) -> Bits {
    set(x.abs().simd_le(0.5 + CELL_MARGIN)) & set(y.abs().simd_le(0.5 + CELL_MARGIN))
}

/// Places from the centres of cells.
#[inline(always)]
fn off_centre<S: Simd>(place: [f64x8<S>; 2], cell: [f64x8<S>; 2]) -> [f64x8<S>; 2] {
    [place[0] - cell[0] - 0.5, place[1] - cell[1] - 0.5]
}

/// Whole numbers that are no less than zero.
#[inline(always)]
pub(super) fn whole<S: Simd>(numbers: f64x8<S>) -> [usize; LANES] {
    let numbers: Lanes = (numbers + WHOLE).into();
    numbers.map(|number| (number.to_bits() & ((1 << 52) - 1)) as usize)
}

impl<S: Simd> Places<S> {
    /// Finds the cells and their 4 × 4 samples, less the wanted phase, line by line; places become offsets from the centres of the cells.
    #[inline(always)]
    fn gather(
        &mut self,
        simd: S,
        right: &RightPhase,
        batch: &Batch,
        again: bool,
        found: &mut Found,
    ) -> (Lines, Singles) {
        let place = self.offset;
        let (width, last) = (right.width as f64, [right.width as f64 - 2.0, right.height as f64 - 2.0]);
        // The whole neighbourhood must lie in the image; NaN fails the comparison.
        let low = set(place[0].simd_ge(1.0)) & set(place[1].simd_ge(1.0));
        let mut held = low & set(place[0].simd_lt(last[0])) & set(place[1].simd_lt(last[1]));
        let inner = mask64x8::from_bitmask(simd, u64::from(held));
        let one = f64x8::simd_from(simd, 1.0);
        let mut cell = [inner.select(place[0].floor(), one), inner.select(place[1].floor(), one)];
        if again {
            let before = [0, 1].map(|axis| f64x8::simd_from(simd, found.cell[axis]));
            let kept = are_inside(off_centre(place, before));
            held |= kept;
            let kept = mask64x8::from_bitmask(simd, u64::from(kept));
            cell = [kept.select(before[0], cell[0]), kept.select(before[1], cell[1])];
        }
        found.lost |= !held;
        self.offset = off_centre(place, cell);
        found.cell = [cell[0].into(), cell[1].into()];
        let first = (cell[1] - 1.0) * width + (cell[0] - 1.0);
        let nearest = whole(near(simd, first + (width + 1.0), width, self.offset));
        let first = whole(first);
        let (mut lines, mut sigma, mut wanted) = ([[0.0; 4 * LANES]; 4], [0.0; LANES], [0.0; 4 * LANES]);
        for l in 0..LANES {
            let rows = &right.phase_rad[first[l]..];
            for line in 0..4 {
                lines[line][4 * l..4 * l + 4].copy_from_slice(&rows[line * right.width..][..4]);
            }
            sigma[l] = right.sigma_rad[nearest[l]];
            wanted[4 * l..4 * l + 4].copy_from_slice(&[batch.wanted[l]; 4]);
        }
        for samples in &mut lines {
            for i in 0..4 * LANES {
                samples[i] -= wanted[i];
            }
        }
        (lines, sigma)
    }

    /// One step along the tangents to where the models vanish, as [`super::patch::Patch::step`] makes it; places that are exact enough are settled.
    #[inline(always)]
    fn advance(
        &self,
        simd: S,
        right: &RightPhase,
        batch: &Batch,
        (samples, sigma): (&Lines, &Singles),
        found: &mut Found,
    ) {
        let Patches { a, b: [bx, by], c: [cxx, cxy, cyy], accepted } = Patches::fit(simd, samples, sigma);
        let pitch = right.pitch;
        let (xi, eta) = (narrowed(simd, self.offset[0]), narrowed(simd, self.offset[1]));
        let (tx, ty) = (narrowed(simd, self.tangent[0] * pitch), narrowed(simd, self.tangent[1] * pitch));
        let value = a + xi * (bx + cxy * eta) + by * eta + cxx * (xi * xi - 1.25) + cyy * (eta * eta - 1.25);
        let gx = bx + cxx * 2.0 * xi + cxy * eta;
        let gy = by + cyy * 2.0 * eta + cxy * xi;
        let slope = gx * tx + gy * ty;
        let bend = (cxx * tx * tx + cxy * tx * ty + cyy * ty * ty) * 2.0;
        let inverse = f32x8::simd_from(simd, 1.0) / slope;
        let mut step = -value * inverse;
        step -= bend * 0.5 * step * step * inverse;
        step -= (value + step * (slope + bend * 0.5 * step)) / (slope + bend * step);
        let slope = slope + bend * step;

        let of = |lanes: Lanes| f64x8::simd_from(simd, lanes);
        let along = widened(simd, step) * pitch;
        let search = of(batch.search_px) * pitch;
        let one = f64x8::simd_from(simd, 1.0);
        let x = of(batch.x) + along * (one - self.stretch * 0.5 * along);
        let end = [self.offset[0] + self.tangent[0] * along, self.offset[1] + self.tangent[1] * along];
        // Whether the step is one that the search may make, and whether it ends the search.
        found.lost |= !(set(along.abs().simd_le(search * 2.0)) & accepted);
        let near_enough = set((x - of(batch.coarse)).abs().simd_le(search));
        let ends = set(along.abs().simd_lt(right.reach)) & are_inside(end) & near_enough;
        found.settled = ends & !found.lost;
        let settled = mask64x8::from_bitmask(simd, u64::from(found.settled));
        let width = right.width as f64;
        let pixel = near(simd, of(found.cell[1]) * width + of(found.cell[0]), width, end);
        found.pixel = whole(settled.select(pixel, f64x8::simd_from(simd, 0.0)));
        let mut noise = [0.0; LANES];
        for (noise, pixel) in noise.iter_mut().zip(found.pixel) {
            *noise = right.sigma_rad[pixel];
        }
        let noise = widened(simd, f32x8::simd_from(simd, noise));
        found.x = x.into();
        found.slope = (widened(simd, slope) / pitch).into();
        found.variance = (quadratic_variances(end) * noise * noise).into();
    }
}

/// The sums of squared weights, as [`super::patch::Patch::quadratic_variance`] gives them.
#[inline(always)]
fn quadratic_variances<S: Simd>([xi, eta]: [f64x8<S>; 2]) -> f64x8<S> {
    let (x2, y2) = (xi * xi, eta * eta);
    let (px, py) = (x2 - 1.25, y2 - 1.25);
    (px * px + 1.0 + py * py) * 0.0625 + (x2 + y2) * 0.05 + x2 * 0.04 * y2
}

/// The pixels of cells that are nearest to places in them, from their first pixels and the offsets from their centres.
#[inline(always)]
fn near<S: Simd>(simd: S, first: f64x8<S>, width: f64, offset: [f64x8<S>; 2]) -> f64x8<S> {
    let [zero, one, row] = [0.0, 1.0, width].map(|value| f64x8::simd_from(simd, value));
    first + offset[1].simd_gt(0.0).select(row, zero) + offset[0].simd_gt(0.0).select(one, zero)
}
