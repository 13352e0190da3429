//! The quadratics of the fine stage for some pixels side by side, with the same bits as [`super::patch::Patch::quadratic`] gives one by one.

use super::patch::{MAX_NOISE, MAX_ROUGHNESS};
use super::subpixel_lanes::{Bits, LANES};
use fearless_simd::{Simd, SimdBase, SimdFrom, SimdMask, f32x8, mask32x8};

/// Four lines of samples, four of each pixel after the other.
pub(super) type Lines = [[f32; 4 * LANES]; 4];

/// Single values of the pixels side by side.
pub(super) type Singles = [f32; LANES];

/// Quadratics about the centres of cells: value, slopes along x and y, and the second-order terms.
pub(super) struct Patches<S: Simd> {
    pub a: f32x8<S>,
    pub b: [f32x8<S>; 2],
    pub c: [f32x8<S>; 3],
    /// Whether the quadratic holds.
    pub accepted: Bits,
}

impl<S: Simd> Patches<S> {
    /// The same steps in the same order as for one pixel.
    #[inline(always)]
    pub fn fit(simd: S, samples: &Lines, sigma: &Singles) -> Self {
        let zero = f32x8::simd_from(simd, 0.0);
        let (mut zeroth, mut first, mut second, mut squares) = ([zero; 4], [zero; 4], [zero; 4], [zero; 4]);
        for part in 0..4 {
            let of = |line: usize| f32x8::from_slice(simd, &samples[line][part * LANES..][..LANES]);
            let (l0, l1, l2, l3) = (of(0), of(1), of(2), of(3));
            let (inner, outer) = (l1 + l2, l0 + l3);
            zeroth[part] = inner + outer;
            first[part] = (l3 - l0) * 1.5 + (l2 - l1) * 0.5;
            second[part] = outer - inner;
            squares[part] = l0 * l0 + l1 * l1 + l2 * l2 + l3 * l3;
        }
        let [v0, v1, v2, v3] = columns(simd, zeroth);
        let (a, bx, cxx) = ((v0 + v3) + (v1 + v2), slope(v0, v1, v2, v3), (v0 + v3) - (v1 + v2));
        let [v0, v1, v2, v3] = columns(simd, first);
        let (by, cxy) = ((v0 + v3) + (v1 + v2), slope(v0, v1, v2, v3));
        let [v0, v1, v2, v3] = columns(simd, second);
        let cyy = (v0 + v3) + (v1 + v2);
        let [v0, v1, v2, v3] = columns(simd, squares);
        let squares = (v0 + v3) + (v1 + v2);
        let explained =
            a * a / 16.0 + (bx * bx + by * by) / 20.0 + (cxx * cxx + cyy * cyy) / 16.0 + cxy * cxy / 25.0;
        let (bx, by) = (bx / 20.0, by / 20.0);
        let noise = f32x8::simd_from(simd, *sigma) * MAX_NOISE;
        let residual = (squares - explained) / 10.0;
        let limit = noise * noise + (bx * bx + by * by) * (MAX_ROUGHNESS * MAX_ROUGHNESS) + squares * 1e-6;
        // NaN (a masked sample) fails the comparison.
        let accepted = set32(residual.simd_le(limit));
        Self { a: a / 16.0, b: [bx, by], c: [cxx / 16.0, cxy / 25.0, cyy / 16.0], accepted }
    }
}

/// Those of a comparison that are true, as bits.
#[inline(always)]
pub(super) fn set32<S: Simd>(mask: mask32x8<S>) -> Bits {
    mask.to_bitmask() as Bits
}

/// Slope of four values, without its divisor.
#[inline(always)]
fn slope<S: Simd>(v0: f32x8<S>, v1: f32x8<S>, v2: f32x8<S>, v3: f32x8<S>) -> f32x8<S> {
    (v3 - v0) * 1.5 + (v2 - v1) * 0.5
}

/// The first values of all pixels, then the second ones, and so on, from four of each pixel after the other.
#[inline(always)]
fn columns<S: Simd>(simd: S, [a, b, c, d]: [f32x8<S>; 4]) -> [f32x8<S>; 4] {
    let (even, odd) = (simd.unzip_low_f32x8(a, b), simd.unzip_high_f32x8(a, b));
    let (later_even, later_odd) = (simd.unzip_low_f32x8(c, d), simd.unzip_high_f32x8(c, d));
    [
        simd.unzip_low_f32x8(even, later_even),
        simd.unzip_low_f32x8(odd, later_odd),
        simd.unzip_high_f32x8(even, later_even),
        simd.unzip_high_f32x8(odd, later_odd),
    ]
}
