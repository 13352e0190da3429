//! From the frames of a sine set to three sums per pixel, block by block.

use super::block::BLOCK;
use super::dirt::Steadied;
use super::noise_model::{NoiseModel, NoiseSource};
use super::rasters::{Part, Rasters};
use super::roles::{SineKind, SinePlan};
use crate::math::sincos;
use crate::wrapped::LeastSquares;
use std::ops::Range;

/// Frames that are added in one pass over a block: the sums stay in registers meanwhile.
const FRAMES_AT_ONCE: usize = 5;

/// The sums of a block: Σ I, Σ I cos δ, Σ I sin δ with δᵢ = ±(2πi/N + first step).
///
/// With I = A + B cos(φ − δ): Σ I = N A, Σ I cos δ = N/2 · B cos φ, Σ I sin δ = N/2 · B sin φ (thesis eq. 2.16). For uneven
/// steps the weights of the frames are those of the least-squares fit, so that the sums mean the same.
/// Single precision: N ≤ 64 values of at most 16 bits have an exact sum, and the others err by about 1e-7 of it.
#[derive(Debug, Clone)]
pub struct BlockSums {
    /// Σ I of each pixel, DN.
    pub sum: [f32; BLOCK],
    /// Σ I cos δ, DN.
    pub cos: [f32; BLOCK],
    /// Σ I sin δ, DN.
    pub sin: [f32; BLOCK],
}

impl BlockSums {
    /// A block of zeros.
    pub const ZERO: Self = Self { sum: [0.0; BLOCK], cos: [0.0; BLOCK], sin: [0.0; BLOCK] };
}

/// How the frames of one sine set make its sums.
#[derive(Debug)]
pub struct Sums {
    /// Stored raster of the first step.
    first: usize,
    /// Weights of a frame in the three sums: 1, cos δ, sin δ for even steps.
    pub(super) weights: Vec<[f32; 3]>,
    /// The fit of uneven steps; none for even ones.
    pub uneven: Option<LeastSquares>,
    /// What takes a slight change of the light out of the frames.
    pub(super) steadied: Option<Steadied>,
    /// What another method found; none where the sums are those of the frames.
    pub replaced: Option<Replaced>,
    /// Steps from a frame to the one half a turn on, whose weights are the opposite ones; none where not every frame has one.
    half_turn: Option<usize>,
    /// What the frames show.
    kind: SineKind,
    /// Phase steps of the frames, rad; empty where other columns than their cosines were found.
    pub(super) shifts_rad: Vec<f64>,
    /// Cosine and sine of the carrier's steps; empty without a carrier.
    pub(super) carrier: Vec<[f32; 2]>,
}

/// A phase that another method found, as sums.
#[derive(Debug)]
pub struct Replaced {
    /// N/2 · B cos φ of each pixel, DN.
    pub cos: Vec<f32>,
    /// N/2 · B sin φ, DN.
    pub sin: Vec<f32>,
    /// Noise of the phase, rad.
    pub sigma_rad: Vec<f32>,
}

impl Sums {
    /// The weights of one set.
    pub fn new(plan: &SinePlan) -> Self {
        let even = |shift: &f64| {
            let (s, c) = sincos(*shift);
            [1.0, c as f32, s as f32]
        };
        let n = f64::from(plan.steps);
        let scaled = |w: &[f64; 3]| [(w[0] * n) as f32, (w[1] * 0.5 * n) as f32, (w[2] * 0.5 * n) as f32];
        // The pattern was checked: its shifts determine three unknowns.
        let uneven = if plan.even { None } else { LeastSquares::new(&plan.shifts_rad) };
        let mut weights: Vec<[f32; 3]> = match &uneven {
            Some(fit) => fit.weights.iter().map(scaled).collect(),
            None => plan.shifts_rad.iter().map(even).collect(),
        };
        let (mut carrier, mut shifts_rad) = (Vec::new(), Vec::new());
        if plan.kind == SineKind::Plain {
            shifts_rad.clone_from(&plan.shifts_rad);
        }
        if let SineKind::Carried(steps) = plan.kind {
            carrier = super::carrier::carrier_steps(steps);
            let each = |w: &[f32; 3]| vec![[1.0 / steps as f32, w[1], w[2]]; steps as usize];
            weights = weights.iter().flat_map(each).collect();
        }
        let paired = plan.even && carrier.is_empty() && weights.len().is_multiple_of(2);
        let half_turn = paired.then_some(weights.len() / 2);
        let (first, kind) = (plan.first, plan.kind);
        Self { first, weights, uneven, steadied: None, replaced: None, half_turn, kind, shifts_rad, carrier }
    }

    /// Replaces the weights of the frames by those of a fit, under a light that changes slightly or in some other way.
    pub fn refit(&mut self, fit: &LeastSquares, steadied: Option<Steadied>) {
        let n = fit.weights.len() as f64;
        let scaled = |w: &[f64; 3]| [(w[0] * n) as f32, (w[1] * 0.5 * n) as f32, (w[2] * 0.5 * n) as f32];
        self.weights = fit.weights.iter().map(scaled).collect();
        self.uneven = Some(fit.clone());
        self.half_turn = None;
        // Under a light that changes slightly, the steps are those of the plan.
        if steadied.is_none() {
            self.shifts_rad.clear();
        }
        self.steadied = steadied;
    }

    /// Stored rasters of the steps.
    pub fn rasters(&self) -> Range<usize> {
        self.first..self.first + self.weights.len()
    }

    /// Whether the frames show lines.
    pub fn are_lines(&self) -> bool {
        self.kind == SineKind::Lines
    }

    /// Whether the sums are those of plain sines.
    pub fn are_plain(&self) -> bool {
        self.kind == SineKind::Plain && self.replaced.is_none()
    }

    /// The same at even steps.
    pub fn are_even_steps(&self) -> bool {
        self.are_plain() && self.uneven.is_none()
    }

    /// The same, or under a light that changes slightly.
    pub fn are_nearly_even_steps(&self) -> bool {
        self.are_even_steps() || self.steadied.is_some()
    }

    /// Phase noise for unit noise of a grey value and unit modulation in the direction (cos φ, sin φ), of N steps.
    pub fn unit_noise(&self, steps: f64, (c, s): (f64, f64)) -> f64 {
        match (&self.uneven, self.kind) {
            (Some(fit), _) => fit.noise(c, s),
            (None, SineKind::Carried(carrier_steps)) => 2.0 / (steps * f64::from(carrier_steps)).sqrt(),
            (None, _) => (2.0 / steps).sqrt(),
        }
    }

    /// Replaces √(2/N) σ_I / B by what uneven steps, lines, a carrier or another method make of it.
    pub fn other_noise(
        &self,
        (rasters, noise): (&Rasters, &NoiseModel),
        range: &Range<usize>,
        steps: f32,
        sums: &BlockSums,
        sigma_rad: &mut [f32],
    ) {
        match (&self.replaced, self.kind) {
            // Noise that was found from the phase of lines is already what that phase feels.
            (None, SineKind::Lines) if noise.source == NoiseSource::Settings => {
                self.line_noise((rasters, noise), range, sums, sigma_rad);
            }
            (None, SineKind::Carried(carrier_steps)) => {
                let factor = (2.0 / carrier_steps as f32).sqrt();
                for sigma in sigma_rad.iter_mut() {
                    *sigma *= factor;
                }
            }
            _ => {}
        }
        if let Some(given) = &self.replaced {
            sigma_rad.copy_from_slice(&given.sigma_rad[range.clone()]);
        } else if let Some(fit) = &self.uneven {
            let even = 1.0 / (2.0 / steps).sqrt();
            for ((sigma, c), s) in sigma_rad.iter_mut().zip(&sums.cos).zip(&sums.sin) {
                let (c, s) = (f64::from(*c), f64::from(*s));
                let length = (c * c + s * s).sqrt().max(f64::MIN_POSITIVE);
                *sigma *= even * fit.noise(c / length, s / length) as f32;
            }
        }
    }

    /// Fills the sums of the pixels in `range`, at most [`BLOCK`].
    #[inline(always)]
    pub fn block(&self, rasters: &Rasters, range: &Range<usize>, out: &mut BlockSums) {
        match rasters {
            _ if !self.carrier.is_empty() => {
                let places: [usize; BLOCK] = std::array::from_fn(|i| range.start + i);
                self.demodulate(rasters, &places[..range.len()], out);
            }
            Rasters::Bytes(kept) => self.add_frames(&Part::new(kept, range), out),
            Rasters::Words(kept) => self.add_frames(&Part::new(kept, range), out),
        }
        if let Some(given) = &self.replaced {
            out.cos[..range.len()].copy_from_slice(&given.cos[range.clone()]);
            out.sin[..range.len()].copy_from_slice(&given.sin[range.clone()]);
        }
    }

    #[inline(always)]
    fn add_frames<T: Copy + Into<i32>>(&self, part: &Part<T>, out: &mut BlockSums) {
        match self.half_turn {
            Some(half_turn) => self.add_steps::<true, T>(half_turn, part, out),
            None => self.add_steps::<false, T>(self.weights.len(), part, out),
        }
    }

    #[inline(always)]
    fn add_steps<const PAIRED: bool, T: Copy + Into<i32>>(
        &self,
        steps: usize,
        part: &Part<T>,
        out: &mut BlockSums,
    ) {
        let mut step = if steps >= FRAMES_AT_ONCE {
            self.add::<FRAMES_AT_ONCE, true, PAIRED, T>(0, steps, part, out);
            FRAMES_AT_ONCE
        } else {
            self.add::<1, true, PAIRED, T>(0, steps, part, out);
            1
        };
        while step + FRAMES_AT_ONCE <= steps {
            self.add::<FRAMES_AT_ONCE, false, PAIRED, T>(step, steps, part, out);
            step += FRAMES_AT_ONCE;
        }
        while step < steps {
            self.add::<1, false, PAIRED, T>(step, steps, part, out);
            step += 1;
        }
    }

    /// Adds K frames in their order, the first ones overwrite what was there; those of pairs with the frames half a turn on, since the sine of both
    /// takes one product, and their difference is exact.
    #[inline(always)]
    fn add<const K: usize, const FIRST: bool, const PAIRED: bool, T: Copy + Into<i32>>(
        &self,
        step: usize,
        half_turn: usize,
        part: &Part<T>,
        out: &mut BlockSums,
    ) {
        let count = (part.end - part.start).min(BLOCK);
        let apart = if PAIRED { half_turn } else { 0 };
        let (mut frames, mut opposite, mut weights) = ([&[][..]; K], [&[][..]; K], [[0.0_f32; 3]; K]);
        for k in 0..K {
            frames[k] = &part.raster(self.first + step + k)[..count];
            opposite[k] = &part.raster(self.first + step + k + apart)[..count];
            weights[k] = self.weights[step + k];
        }
        let (sum, cos, sin) = (&mut out.sum[..count], &mut out.cos[..count], &mut out.sin[..count]);
        for i in 0..count {
            let (mut a, mut c, mut s) = if FIRST { (0.0, 0.0, 0.0) } else { (sum[i], cos[i], sin[i]) };
            let mut total = 0_i32;
            for k in 0..K {
                let value: i32 = frames[k][i].into();
                let value = if PAIRED {
                    let opposite: i32 = opposite[k][i].into();
                    total += value + opposite;
                    (value - opposite) as f32
                } else {
                    let value = value as f32;
                    a += value * weights[k][0];
                    value
                };
                c += value * weights[k][1];
                s += value * weights[k][2];
            }
            if PAIRED {
                a += total as f32;
            }
            (sum[i], cos[i], sin[i]) = (a, c, s);
        }
    }

    /// Σ I of one pixel, DN.
    pub fn sum_at(&self, rasters: &Rasters, place: usize) -> f32 {
        let values = self.rasters().map(|raster| f32::from(rasters.value(raster, place)));
        values.zip(&self.weights).map(|(value, weights)| value * weights[0]).sum()
    }

    /// Grey values of one frame at single pixels.
    #[inline(always)]
    pub(super) fn values_at(
        &self,
        rasters: &Rasters,
        frame: usize,
        places: &[usize],
        values: &mut [f32; BLOCK],
    ) {
        let raster = self.first + frame;
        match rasters {
            Rasters::Bytes(kept) => take(kept.raster(raster), places, values),
            Rasters::Words(kept) => take(kept.raster(raster), places, values),
        }
    }

    /// The sums of single pixels, in the order of `places`, at most [`BLOCK`] of them.
    #[inline(always)]
    pub fn gather(&self, rasters: &Rasters, places: &[usize], out: &mut BlockSums) {
        let count = places.len().min(BLOCK);
        if !self.carrier.is_empty() {
            return self.demodulate(rasters, places, out);
        }
        let mut values = [0.0_f32; BLOCK];
        for (step, weights) in self.weights.iter().enumerate() {
            self.values_at(rasters, step, places, &mut values);
            let values = &values[..count];
            let lanes = out.sum.iter_mut().zip(&mut out.cos).zip(&mut out.sin).zip(values);
            if step == 0 {
                for (((sum, cos), sin), value) in lanes {
                    (*sum, *cos, *sin) = (value * weights[0], value * weights[1], value * weights[2]);
                }
            } else {
                for (((sum, cos), sin), value) in lanes {
                    *sum += value * weights[0];
                    *cos += value * weights[1];
                    *sin += value * weights[2];
                }
            }
        }
        if let Some(given) = &self.replaced {
            for (i, place) in places[..count].iter().enumerate() {
                (out.cos[i], out.sin[i]) = (given.cos[*place], given.sin[*place]);
            }
        }
    }
}

#[inline(always)]
fn take<T: Copy + Into<f32>>(frame: &[T], places: &[usize], out: &mut [f32; BLOCK]) {
    for (out, place) in out.iter_mut().zip(places) {
        *out = frame[*place].into();
    }
}

#[inline(always)]
fn mark<T: Copy + PartialOrd>(frame: &[T], places: &[usize], clipped: T, out: &mut [u8; BLOCK]) {
    for (out, place) in out.iter_mut().zip(places) {
        *out |= u8::from(frame[*place] >= clipped);
    }
}

/// The sine frames of an axis whose clipping masks a pixel.
#[derive(Debug, Clone)]
pub struct Clipping {
    /// Numbers of their rasters among those that are kept.
    pub rasters: Vec<usize>,
    /// Grey value from which a pixel counts as clipped, DN.
    pub clipped_dn: u16,
}

impl Clipping {
    /// Marks the pixels of `range` that are clipped in one of the frames.
    #[inline(always)]
    pub fn block(&self, rasters: &Rasters, range: &Range<usize>, out: &mut [u8; BLOCK]) {
        match rasters {
            // A limit beyond 255 cannot be reached by bytes unless it stands for 255 itself.
            Rasters::Bytes(kept) => {
                self.most(&Part::new(kept, range), self.clipped_dn.min(255) as u8, out);
            }
            Rasters::Words(kept) => self.most(&Part::new(kept, range), self.clipped_dn, out),
        }
    }

    #[inline(always)]
    fn most<T: Copy + Default + Ord>(&self, part: &Part<T>, clipped: T, out: &mut [u8; BLOCK]) {
        let count = (part.end - part.start).min(BLOCK);
        let mut most = [T::default(); BLOCK];
        for raster in &self.rasters {
            for (most, value) in most[..count].iter_mut().zip(part.raster(*raster)) {
                *most = if *value > *most { *value } else { *most };
            }
        }
        for (out, most) in out[..count].iter_mut().zip(&most) {
            *out = u8::from(*most >= clipped);
        }
    }

    /// Marks those of single pixels that are clipped, at most [`BLOCK`] of them.
    #[inline(always)]
    pub fn gather(&self, rasters: &Rasters, places: &[usize], out: &mut [u8; BLOCK]) {
        out.fill(0);
        for raster in &self.rasters {
            match rasters {
                Rasters::Bytes(kept) => {
                    mark(kept.raster(*raster), places, self.clipped_dn.min(255) as u8, out);
                }
                Rasters::Words(kept) => mark(kept.raster(*raster), places, self.clipped_dn, out),
            }
        }
    }

    /// Whether a pixel is clipped in one of the frames.
    pub fn at(&self, rasters: &Rasters, place: usize) -> bool {
        let clipped = match rasters {
            Rasters::Bytes(_) => self.clipped_dn.min(255),
            Rasters::Words(_) => self.clipped_dn,
        };
        self.rasters.iter().any(|raster| rasters.value(*raster, place) >= clipped)
    }
}
