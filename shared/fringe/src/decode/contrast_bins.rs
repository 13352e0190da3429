//! Sums of modulation and reflectance by the slope of the phase: the contrast that a footprint takes from steep fringes.

use super::rasters::Rasters;
use super::roles::Levels;
use fearless_simd::{Simd, SimdBase, f32x8};

/// Bins along |∇φ|², four to the octave from 2⁻¹⁰ rad²/px² on; the last one has no end.
pub(super) const BINS: usize = 40;
pub(super) const FIRST_BITS: usize = (127 - 10) << 2;
/// Rows are dealt to so many groups; the scatter of the groups gives the uncertainty of a bin.
pub(super) const GROUPS: usize = 8;
/// Rows of one parallel job; a multiple of `GROUPS`.
pub(super) const ROWS: usize = 16;
/// Pixels that enter the bins together where their slopes are alike.
pub(super) const ALIKE: usize = 8;

/// The frames that give R, and the grey value from which they do not.
#[derive(Debug, Clone, Copy)]
pub struct Reflectance<'a> {
    /// The stored frames of the sequence.
    pub rasters: &'a Rasters,
    /// Where white and black lie among the stored frames.
    pub levels: Levels,
    /// A white frame from here on is clipped.
    pub clipped_dn: u16,
}

/// Sums over the pixels of a group in a bin. Ratios of sums have no bias from noise, as means of logarithms would.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// Sum of the modulations, DN.
    pub modulation: f64,
    /// Sum of the reflectances, DN.
    pub reflectance: f64,
    /// Sum of reflectance times |∇φ|², DN rad²/px².
    pub slope2: f64,
    /// Number of pixels in the sums.
    pub count: u32,
}

/// Sums of all bins, group by group.
pub(super) type Bins = [[Sums; GROUPS]; BINS];

impl Sums {
    /// Adds some pixels: their modulation, their reflectance and |∇φ|².
    #[inline(always)]
    pub fn add(&mut self, modulation: &[f32], reflectance: &[f32], slope2: &[f32]) {
        let (mut sum, mut light, mut slope) = (0.0, 0.0, 0.0);
        for ((b, r), s) in modulation.iter().zip(reflectance).zip(slope2) {
            sum += f64::from(*b);
            light += f64::from(*r);
            slope += f64::from(r * s);
        }
        self.modulation += sum;
        self.reflectance += light;
        self.slope2 += slope;
        self.count += modulation.len() as u32;
    }

    /// Adds the pixels from one on together: halves are added to halves, so that no sum waits for the one before it.
    #[inline(always)]
    pub fn add_together<S: Simd>(
        &mut self,
        simd: S,
        [modulation, reflectance, slope2]: [&[f32]; 3],
        first: usize,
    ) {
        let part = first..first + ALIKE;
        let of = |values: &[f32]| f32x8::from_slice(simd, &values[part.clone()]);
        let light = of(reflectance);
        self.modulation += total(simd, of(modulation));
        self.reflectance += total(simd, light);
        self.slope2 += total(simd, light * of(slope2));
        self.count += ALIKE as u32;
    }

    /// Adds the pixels of another part.
    pub fn join(&mut self, other: &Self) {
        self.modulation += other.modulation;
        self.reflectance += other.reflectance;
        self.slope2 += other.slope2;
        self.count += other.count;
    }
}

/// Sum of eight values in double precision.
#[inline(always)]
fn total<S: Simd>(simd: S, values: f32x8<S>) -> f64 {
    let (low, high) = simd.widen_f32x8(values);
    let (low, high) = simd.split_f64x4(low + high);
    let two = low + high;
    two[0] + two[1]
}
