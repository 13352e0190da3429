//! The fine stage: the place on the exact epipolar curve where the right phase equals the left one.
//!
//! The right phase is read on its native grid, never resampled. Where a 4 × 4 neighbourhood is valid and one smooth
//! surface, it is the least-squares quadratic over it: exact for quadratics, so free of the chord error that linear
//! interpolation has on curved surfaces, and with less noise (see [`Patch::variance_factor`]). Elsewhere it is
//! bilinear over 2 × 2 pixels. Nothing is interpolated across a mask edge or a jump.

#![allow(
    clippy::inline_always,
    reason = "patches passed through memory cost 20 ns per point in stalled loads"
)]

use super::patch::{Interpolation, Patch};
use crate::rectify::{CurvePoint, EpipolarCurve};

/// In the fallback the bracketing step may exceed that of its neighbours by this factor; a jump of one and a half
/// pixels exceeds it.
const MAX_STEP_RATIO: f32 = 2.5;

/// A place beyond its own 2 × 2 cell by more than this is looked up in the next cell, px.
pub(super) const CELL_MARGIN: f64 = 0.1;

/// The fine solution may lie this far from the coarse one, px: rounding to rows and columns moves it by less.
pub(super) const MAX_SHIFT_PX: f64 = 2.5;

/// Displacement by the neglected bend of the lens that ends the search, px: single precision of phases is coarser.
pub(super) const SETTLED_PX: f64 = 1e-5;

/// The same for the cubic model, whose own bend is neglected, px.
const CUBIC_REACH_PX: f64 = 1e-3;

/// Exact evaluations of the curve per point.
const MAX_STEPS: usize = 5;

/// The right view, masked: phase is NaN where it may not be used.
#[derive(Debug, Clone, Copy)]
pub(super) struct RightPhase<'a> {
    pub phase_rad: &'a [f32],
    pub sigma_rad: &'a [f32],
    /// Marks where the surface ends so near that the footprint reaches over its rim, or over a limb.
    pub rims: &'a [u8],
    pub width: usize,
    pub height: usize,
    /// Rectified length of a pixel.
    pub pitch: f64,
    /// Largest step by tangent and stretch, rectified; see [`crate::rectify::RectifiedCamera::reach`].
    pub reach: f64,
    pub interpolation: Interpolation,
}

/// Where the right phase equals the left one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Crossing {
    /// Rectified abscissa of the match, normalised coordinates.
    pub x: f64,
    /// Derivative of the right phase along the curve, rad per unit of x.
    pub slope: f64,
    /// Variance of the interpolated right phase, rad².
    pub variance: f64,
    /// Index of the nearest native pixel.
    pub pixel: usize,
    /// Whether the bilinear fallback was used.
    pub bilinear: bool,
}

/// Finds the crossing nearest to the coarse abscissa and within `search_px` of it; `None` where no continuous surface supports one.
///
/// The curve is evaluated exactly, followed by tangent and stretch to where the local model vanishes, and evaluated again
/// there when that was too far for them to be exact or led to another cell.
#[inline]
pub(super) fn solve(
    right: &RightPhase,
    curve: &EpipolarCurve,
    wanted: f32,
    (coarse, search_px): (f64, f64),
) -> Option<Crossing> {
    let pitch = right.pitch;
    // The cubic model holds only where it was made.
    let cubic = right.interpolation == Interpolation::Cubic;
    let reach = if cubic { CUBIC_REACH_PX * pitch } else { right.reach };
    let mut x = coarse;
    let mut model: Option<Model> = None;
    for _ in 0..MAX_STEPS {
        let at = curve.at(x);
        let kept = model.and_then(|m| Some((m, m.offset(at.pixel)?)));
        let (current, offset) = match kept {
            Some(kept) if !cubic => kept,
            _ => right.model(&at, kept.map(|(m, _)| m), wanted)?,
        };
        model = Some(current);
        let (along, slope) = current.patch.step(offset, at.tangent, pitch);
        // A vanishing slope gives an infinite step, or NaN: no crossing.
        let sane = along.abs() <= 2.0 * search_px * pitch;
        if !sane {
            return None;
        }
        // The curve runs by dx + ½ stretch dx²: inverted to second order.
        x += along * (1.0 - 0.5 * at.stretch * along);
        let offset = [offset[0] + at.tangent[0] * along, offset[1] + at.tangent[1] * along];
        if along.abs() < reach && inside(offset) {
            let near = (x - coarse).abs() <= search_px * pitch;
            let pixel = right.nearest(current.column, current.row, offset);
            let sigma = f64::from(right.sigma_rad[pixel]);
            return near.then(|| Crossing {
                x,
                slope,
                variance: current.patch.variance_factor(offset[0], offset[1]) * sigma * sigma,
                pixel,
                bilinear: current.patch.kind == Interpolation::Bilinear,
            });
        }
    }
    None
}

/// Whether an offset belongs to its 2 × 2 cell. A margin keeps the search from going to and fro between two cells.
#[inline(always)]
#[allow(clippy::needless_bitwise_bool, reason = "without branches a loop over it vectorises")]
pub(super) fn inside(offset: [f64; 2]) -> bool {
    (offset[0].abs() <= 0.5 + CELL_MARGIN) & (offset[1].abs() <= 0.5 + CELL_MARGIN)
}

/// The patch of a 2 × 2 cell, named by its top-left pixel.
#[derive(Debug, Clone, Copy)]
struct Model {
    column: usize,
    row: usize,
    patch: Patch,
}

impl Model {
    /// Offset of a place from the centre of the cell; `None` when it lies in another cell.
    #[inline]
    fn offset(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        let offset = [pixel[0] - self.column as f64 - 0.5, pixel[1] - self.row as f64 - 0.5];
        inside(offset).then_some(offset)
    }
}

impl RightPhase<'_> {
    /// The model at a place, in the cell of `kept` if there is one.
    #[inline(always)]
    fn model(&self, at: &CurvePoint, kept: Option<Model>, wanted: f32) -> Option<(Model, [f64; 2])> {
        let (column, row) = kept.map_or_else(|| self.cell(at.pixel), |m| Some((m.column, m.row)))?;
        let offset = [at.pixel[0] - column as f64 - 0.5, at.pixel[1] - row as f64 - 0.5];
        let patch = self.patch(column, row, offset, at.tangent, wanted)?;
        Some((Model { column, row, patch }, offset))
    }

    /// The top-left pixel of the 2 × 2 cell of a place. The last column and row are the ends of their last cell.
    #[inline]
    fn cell(&self, pixel: [f64; 2]) -> Option<(usize, usize)> {
        let [u, v] = pixel;
        let (right, bottom) = (self.width as f64 - 1.0, self.height as f64 - 1.0);
        // NaN fails these comparisons.
        let inside = u >= 0.0 && v >= 0.0 && u <= right && v <= bottom && self.width >= 2 && self.height >= 2;
        inside.then(|| ((u as usize).min(self.width - 2), (v as usize).min(self.height - 2)))
    }

    /// The pixel of a cell that is nearest to a place in it.
    #[inline(always)]
    pub(super) fn nearest(&self, column: usize, row: usize, offset: [f64; 2]) -> usize {
        (row + usize::from(offset[1] > 0.0)) * self.width + column + usize::from(offset[0] > 0.0)
    }

    #[inline(always)]
    fn patch(
        &self,
        column: usize,
        row: usize,
        offset: [f64; 2],
        tangent: [f64; 2],
        wanted: f32,
    ) -> Option<Patch> {
        let inner = column >= 1 && row >= 1 && column + 2 < self.width && row + 2 < self.height;
        if inner && self.interpolation != Interpolation::Bilinear {
            let samples = self.gather(column, row, wanted);
            let sigma = self.sigma_rad[self.nearest(column, row, offset)];
            if let Some(patch) = Patch::quadratic(&samples, sigma) {
                let cubic = self.interpolation == Interpolation::Cubic;
                return Some(if cubic { Patch::cubic(&samples, offset) } else { patch });
            }
        }
        self.bilinear(column, row, tangent, wanted)
    }

    /// The 4 × 4 samples around a cell, less the wanted phase.
    #[inline]
    fn gather(&self, column: usize, row: usize, wanted: f32) -> [[f32; 4]; 4] {
        let mut samples = [[0.0; 4]; 4];
        for (line, out) in samples.iter_mut().enumerate() {
            let start = (row + line - 1) * self.width + column - 1;
            let values = &self.phase_rad[start..start + 4];
            for (value, out) in values.iter().zip(out) {
                *out = value - wanted;
            }
        }
        samples
    }

    /// Bilinear model of a cell; `None` across a mask edge, a jump, or where no neighbour vouches for the step.
    fn bilinear(&self, column: usize, row: usize, tangent: [f64; 2], wanted: f32) -> Option<Patch> {
        let read = |du: isize, dv: isize| -> f32 {
            let (u, v) = (column as isize + du, row as isize + dv);
            let inside = u >= 0 && v >= 0 && (u as usize) < self.width && (v as usize) < self.height;
            if inside { self.phase_rad[v as usize * self.width + u as usize] - wanted } else { f32::NAN }
        };
        let [p00, p10, p01, p11] = [read(0, 0), read(1, 0), read(0, 1), read(1, 1)];
        let patch = Patch {
            a: (p00 + p10 + p01 + p11) / 4.0,
            b: [(p10 - p00 + p11 - p01) / 2.0, (p01 - p00 + p11 - p10) / 2.0],
            c: [0.0, p11 - p10 - p01 + p00, 0.0],
            kind: Interpolation::Bilinear,
        };
        if !patch.a.is_finite() {
            return None;
        }
        // Mean steps of both lines of a cell, by column and by row, `at` cells from this one.
        let by_column = |at: isize| (read(at + 1, 0) - read(at, 0) + read(at + 1, 1) - read(at, 1)) / 2.0;
        let by_row = |at: isize| (read(0, at + 1) - read(0, at) + read(1, at + 1) - read(1, at)) / 2.0;
        let sigma = self.sigma_rad[row * self.width + column];
        let noise = 4.0 * sigma;
        let [right, down] = patch.b.map(f32::abs);
        let columns = tangent[0].abs() >= tangent[1].abs();
        let (along, across) = if columns { (right, down) } else { (down, right) };
        // The wanted step needs a neighbour that vouches for it. Across it the phase may stand still, so that a step is
        // also plausible when it is small beside the wanted one.
        let beside = |step: &dyn Fn(isize) -> f32, here: f32| {
            [-1, 1].iter().any(|at| here <= MAX_STEP_RATIO * step(*at).abs() + noise)
        };
        let (vouched, level) = if columns {
            (beside(&by_column, along), beside(&by_row, across))
        } else {
            (beside(&by_row, along), beside(&by_column, across))
        };
        let level = level || across <= 0.5 * along + noise;
        let untwisted = patch.c[1].abs() <= 0.5 * along + 2.0 * noise;
        (vouched && level && untwisted).then_some(patch)
    }
}
