//! Tests of the decoder on frames rendered from the pattern definitions.

mod bounce;
mod code_alone;
mod code_dirt;
mod code_shift;
mod codecs;
mod diagnose;
mod dirt;
mod footprint;
mod hands;
mod identity;
mod lent;
mod levels;
mod methods;
mod motion;
mod noise;
mod order;
mod refusals;
mod round_trip;
mod single;
mod speed;

use super::*;
use crate::frame::{Frame, PixelBuffer};
use crate::pattern::{Code, Direction, Threshold};
use crate::phase::PhaseMap;

/// What the camera sees: one projector coordinate per pixel, ambient and projected light.
#[derive(Clone)]
struct Scene {
    width: usize,
    coordinates_px: Vec<f64>,
    extent_px: u32,
    full_scale_dn: u16,
    ambient_dn: f64,
    projected_dn: f64,
    /// Read noise, DN, and shot gain, DN.
    noise: (f64, f64),
    seed: u64,
}

impl Scene {
    fn new(width: usize, coordinates_px: Vec<f64>, extent_px: u32) -> Self {
        Self {
            width,
            coordinates_px,
            extent_px,
            full_scale_dn: 65535,
            ambient_dn: 6000.0,
            projected_dn: 50_000.0,
            noise: (0.0, 0.0),
            seed: 1,
        }
    }

    /// Rows of one ramp each; row r is shifted by r · `shift_px`.
    fn ramp(width: usize, height: usize, per_pixel_px: f64, shift_px: f64, extent_px: u32) -> Self {
        let coordinates = (0..width * height)
            .map(|i| (i % width) as f64 * per_pixel_px + (i / width) as f64 * shift_px)
            .collect();
        Self::new(width, coordinates, extent_px)
    }

    fn eight_bits(mut self) -> Self {
        self.full_scale_dn = 255;
        self.ambient_dn = 20.0;
        self.projected_dn = 180.0;
        self
    }

    fn height(&self) -> usize {
        self.coordinates_px.len() / self.width
    }

    fn frames(&self, sequence: &[PatternSet]) -> Vec<Frame> {
        let mut random = Random(self.seed);
        let mut frames = Vec::new();
        for set in sequence {
            for step in 0..set.frames() {
                let values = self.coordinates_px.iter().map(|x| {
                    let light = set.intensity(step, *x, self.extent_px).unwrap_or(0.5);
                    let level = self.ambient_dn + self.projected_dn * light;
                    let sigma = (self.noise.0 * self.noise.0 + self.noise.1 * level).sqrt();
                    let noisy = if sigma > 0.0 { level + sigma * random.normal() } else { level };
                    noisy.round().clamp(0.0, f64::from(self.full_scale_dn)) as u16
                });
                frames.push(self.frame(values.collect()));
            }
        }
        frames
    }

    fn frame(&self, values: Vec<u16>) -> Frame {
        Frame {
            width_px: self.width as u32,
            height_px: self.height() as u32,
            full_scale_dn: self.full_scale_dn,
            pixels: if self.full_scale_dn <= 255 {
                PixelBuffer::Mono8(values.into_iter().map(|v| v as u8).collect())
            } else {
                PixelBuffer::Mono16(values)
            },
        }
    }

    fn decoder(&self, sequence: &[PatternSet], settings: &DecodeSettings) -> Result<Decoder, DecodeError> {
        let extent_px = [self.extent_px; 2];
        let (width, height) = (self.width as u32, self.height() as u32);
        Decoder::new(sequence, width, height, self.full_scale_dn, extent_px, settings)
    }

    fn decode(&self, sequence: &[PatternSet], axis: Axis) -> (PhaseMap, DecodeReport) {
        self.decode_frames(sequence, &self.frames(sequence), axis, &DecodeSettings::default())
    }

    fn decode_frames(
        &self,
        sequence: &[PatternSet],
        frames: &[Frame],
        axis: Axis,
        settings: &DecodeSettings,
    ) -> (PhaseMap, DecodeReport) {
        let mut decoder = self.decoder(sequence, settings).unwrap();
        for (index, frame) in frames.iter().enumerate() {
            decoder.push(index, &frame.view()).unwrap();
        }
        let mut map = PhaseMap::new(decoder.info(axis).unwrap());
        let report = decoder.finish(axis, &mut map.view_mut()).unwrap();
        (map, report)
    }

    /// Largest distance of a valid pixel from the truth, projector pixels, and the number of valid ones.
    fn worst_px(&self, map: &PhaseMap) -> (f64, usize) {
        let scale = map.info.period_px / std::f64::consts::TAU;
        let mut worst = 0.0_f64;
        let mut count = 0;
        for (i, x) in self.coordinates_px.iter().enumerate() {
            if map.valid[i] == 1 {
                worst = worst.max((f64::from(map.phase_rad[i]) * scale - x).abs());
                count += 1;
            } else {
                assert!(map.phase_rad[i].is_nan() && map.sigma_rad[i].is_nan());
            }
        }
        (worst, count)
    }
}

/// SplitMix64 and Box–Muller: the same noise in every run.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn uniform(&mut self) -> f64 {
        ((self.bits() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * crate::math::ln(self.uniform())).sqrt();
        radius * crate::math::cos(std::f64::consts::TAU * self.uniform())
    }
}

fn sine(axis: Axis, period_px: f64, steps: u32) -> PatternSet {
    PatternSet::sine(axis, period_px, steps)
}

fn gray(axis: Axis, bits: u32, stripe_px: f64) -> PatternSet {
    PatternSet::gray(axis, bits, stripe_px)
}

fn demo(stripe_px: f64, bits: u32) -> Vec<PatternSet> {
    vec![sine(Axis::X, 16.0, 10), gray(Axis::X, bits, stripe_px), PatternSet::White {}, PatternSet::Black {}]
}
