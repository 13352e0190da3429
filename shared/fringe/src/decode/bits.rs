//! From bit frames to stripe numbers.

use super::block::BLOCK;
use super::noise_model::NoiseModel;
use super::rasters::{Part, Rasters};
use super::roles::{CodePlan, Reference};
use crate::pattern::Code;
use std::ops::{Neg, Range, Sub};

/// Stripe numbers of a block of pixels.
pub struct Stripes {
    /// Stripe number of each pixel of the block, from 0.
    pub number: [u16; BLOCK],
    /// The bits as seen, most significant first, before the Gray code is resolved.
    pub seen: [u16; BLOCK],
    /// Bits that the noise could have turned.
    pub unsure: [u16; BLOCK],
    /// Half the difference between light and dark, DN; zero where a sine is the threshold.
    pub contrast: [f32; BLOCK],
}

impl Stripes {
    /// A block in which all numbers are zero.
    pub fn new() -> Self {
        Self { number: [0; BLOCK], seen: [0; BLOCK], unsure: [0; BLOCK], contrast: [0.0; BLOCK] }
    }

    /// Reads the bits of the pixels in `range`. `mean_sum` is (Σ I, N) of the sine whose mean is the threshold.
    #[inline(always)]
    pub fn read(
        &mut self,
        rasters: &Rasters,
        plan: &CodePlan,
        range: &Range<usize>,
        mean_sum: Option<(&[f32], u32)>,
        certain: &Certainty,
    ) {
        match rasters {
            Rasters::Bytes(kept) => {
                self.read_values(&Part::new(kept, range), plan, mean_sum, certain);
            }
            Rasters::Words(kept) => {
                self.read_values(&Part::new(kept, range), plan, mean_sum, certain);
            }
        }
        let mask = if plan.invert { (((1_u32 << plan.bits) - 1) & 0xffff) as u16 } else { 0 };
        let count = range.len();
        for (number, seen) in self.number[..count].iter_mut().zip(&mut self.seen[..count]) {
            *seen ^= mask;
            *number = resolve(*seen, plan.code);
        }
    }

    #[inline(always)]
    fn read_values<T: Grey>(
        &mut self,
        view: &Part<T>,
        plan: &CodePlan,
        mean_sum: Option<(&[f32], u32)>,
        certain: &Certainty,
    ) {
        let count = view.end - view.start;
        self.seen[..count].fill(0);
        self.unsure[..count].fill(0);
        self.contrast[..count].fill(0.0);
        let mut twice = [T::Wide::default(); BLOCK];
        let mut limit = [T::Wide::default(); BLOCK];
        match plan.reference {
            Reference::WhiteBlack(white, black) => {
                let pair = view.raster(white).iter().zip(view.raster(black));
                for ((twice, contrast), (w, b)) in twice.iter_mut().zip(&mut self.contrast).zip(pair) {
                    *twice = T::sum(*w, *b);
                    *contrast = 0.5 * (w.value() - b.value());
                }
            }
            Reference::SineMean(_) => {
                let (sum, steps) = mean_sum.unwrap_or((&[], 1));
                let scale = 2.0 / steps as f32;
                for (twice, sum) in twice.iter_mut().zip(sum) {
                    *twice = T::wide(sum * scale);
                }
            }
            Reference::Complement(first) => {
                complement_sum(&mut twice, view, plan.first, first);
            }
        }
        for (limit, twice) in limit.iter_mut().zip(&twice[..count]) {
            *limit = T::wide(certain.limit(0.5 * T::narrow(*twice)));
        }
        for bit in 0..plan.bits {
            let values = view.raster(plan.first + bit);
            if let Reference::Complement(first) = plan.reference {
                complement_sum(&mut twice, view, plan.first + bit, first + bit);
                let scale = 0.5 / plan.bits as f32;
                for ((contrast, value), twice) in self.contrast.iter_mut().zip(values).zip(&twice) {
                    *contrast += scale * (2.0 * value.value() - T::narrow(*twice)).abs();
                }
            }
            let lanes = self.seen.iter_mut().zip(&mut self.unsure).zip(values).zip(twice.iter().zip(&limit));
            for (((seen, unsure), value), (twice, limit)) in lanes {
                let difference = T::sum(*value, *value) - *twice;
                let size = if difference > T::Wide::default() { difference } else { -difference };
                *seen = (*seen << 1) | u16::from(difference > T::Wide::default());
                *unsure = (*unsure << 1) | u16::from(size < *limit);
            }
        }
    }
}

/// Stripe number of the bits as seen.
#[inline(always)]
pub fn resolve(seen: u16, code: Code) -> u16 {
    match code {
        Code::Binary => seen,
        Code::Gray => {
            let mut number = seen;
            number ^= number >> 1;
            number ^= number >> 2;
            number ^= number >> 4;
            number ^ (number >> 8)
        }
    }
}

/// When a bit is certain: |2 I − 2 T| beyond so many standard deviations of that difference.
pub struct Certainty {
    sigmas: f32,
    read_variance_dn2: f32,
    gain_dn: f32,
    /// Variance of 2 I − 2 T in units of the variance of a grey value.
    factor: f32,
}

impl Certainty {
    /// T is the mean of two frames (factor 6), of N sine frames (4 + 4/N), or of frame and complement (2, since then
    /// 2 I − 2 T = I − Ī).
    pub fn new(plan: &CodePlan, mean_steps: u32, noise: &NoiseModel, sigmas: f64) -> Self {
        let factor = match plan.reference {
            Reference::WhiteBlack(..) => 6.0,
            Reference::SineMean(_) => 4.0 + 4.0 / mean_steps.max(1) as f32,
            Reference::Complement(_) => 2.0,
        };
        Self {
            sigmas: sigmas as f32,
            read_variance_dn2: noise.read_variance_dn2 as f32,
            gain_dn: noise.gain_dn as f32,
            factor,
        }
    }

    #[inline(always)]
    fn limit(&self, level_dn: f32) -> f32 {
        self.sigmas * (self.factor * (self.read_variance_dn2 + self.gain_dn * level_dn)).sqrt() + 1.0
    }
}

#[inline(always)]
fn complement_sum<T: Grey>(twice: &mut [T::Wide; BLOCK], view: &Part<T>, one: usize, other: usize) {
    for ((twice, a), b) in twice.iter_mut().zip(view.raster(one)).zip(view.raster(other)) {
        *twice = T::sum(*a, *b);
    }
}

/// Nearest integer of 0 … 2²²: adding 2²³ leaves it in the low bits. A plain cast checks its range and does not vectorise.
#[inline(always)]
fn whole(value: f32) -> u32 {
    (value + 8_388_608.0).to_bits() & 0x007f_ffff
}

/// A stored grey value and the signed integer that holds sums of two of them.
trait Grey: Copy {
    type Wide: Copy + Default + PartialOrd + Sub<Output = Self::Wide> + Neg<Output = Self::Wide>;
    fn sum(a: Self, b: Self) -> Self::Wide;
    fn value(self) -> f32;
    fn wide(value: f32) -> Self::Wide;
    fn narrow(value: Self::Wide) -> f32;
}

impl Grey for u8 {
    type Wide = i16;
    #[inline(always)]
    fn sum(a: Self, b: Self) -> i16 {
        i16::from(a) + i16::from(b)
    }
    #[inline(always)]
    fn value(self) -> f32 {
        f32::from(self)
    }
    #[inline(always)]
    fn wide(value: f32) -> i16 {
        whole(value.min(1024.0)) as i16
    }
    #[inline(always)]
    fn narrow(value: i16) -> f32 {
        f32::from(value)
    }
}

impl Grey for u16 {
    type Wide = i32;
    #[inline(always)]
    fn sum(a: Self, b: Self) -> i32 {
        i32::from(a) + i32::from(b)
    }
    #[inline(always)]
    fn value(self) -> f32 {
        f32::from(self)
    }
    #[inline(always)]
    fn wide(value: f32) -> i32 {
        whole(value.min(262_144.0)) as i32
    }
    #[inline(always)]
    fn narrow(value: i32) -> f32 {
        value as f32
    }
}
