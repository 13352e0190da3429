//! Predicted against counted: wrong bits, and the orders and stripes that they make wrong, through the decoder itself.

use anyhow::Result;
use cell::executor::{PhaseMethod, View, ViewDecoder};
use fringe::decode::{CameraNoise, DecodeSettings, Diagnosis};
use fringe::frame::{FrameView, Pixels};
use fringe::math::random::{Key, Normal};
use fringe::pattern::{Axis, Code, PatternSet, Threshold};
use rayon::prelude::*;
use serde::Serialize;

/// Side of a drawn image: fixed, so that the draws are the same on every machine.
const SIDE: u32 = 256;
/// Black and white, DN of 65535.
const LEVELS_DN: [f64; 2] = [20_000.0, 45_000.0];
/// Fringes of the cases with sines, projector pixels.
const PERIOD_PX: f64 = 16.0;

/// A predicted rate and the rate that was counted.
#[derive(Debug, Serialize)]
pub struct Row {
    /// The kind of error whose rate is counted.
    pub name: String,
    /// Predicted rate, fraction of the pixels.
    pub predicted: f64,
    /// Counted rate, fraction of the pixels.
    pub observed: f64,
    /// Counted rate over predicted rate.
    pub ratio: f64,
    /// Number of pixels that were counted.
    pub pixels: u64,
}

/// A code with a threshold, at a noise that makes some errors.
pub struct BitCase {
    name: &'static str,
    sequence: Vec<PatternSet>,
    code: Code,
    stripe_px: f64,
    read_noise_dn: f64,
    gain_dn: f64,
}

/// Stripes of all cases.
const BITS: u32 = 7;

/// Every case of the table.
pub fn cases() -> Vec<BitCase> {
    let set = |code, stripe_px: f64, invert, threshold| {
        let (axis, shift_px) = (Axis::X, 0.0);
        PatternSet::Gray { axis, bits: BITS, stripe_px, shift_px, invert, code, threshold }
    };
    let levels = || vec![PatternSet::White {}, PatternSet::Black {}];
    let sine = |steps| PatternSet::sine(Axis::X, PERIOD_PX, steps);
    let (gray, binary) = (Code::Gray, Code::Binary);
    let half = 0.5 * PERIOD_PX;
    let plain = |code| [vec![set(code, half, false, Some(Threshold::WhiteBlack))], levels()].concat();
    let both = vec![set(gray, half, false, Some(Threshold::Complement)), set(gray, half, true, None)];
    let by_mean = vec![sine(10), set(gray, half, false, Some(Threshold::SineMean))];
    let with = |stripe_px| {
        [vec![sine(10), set(gray, stripe_px, false, Some(Threshold::WhiteBlack))], levels()].concat()
    };
    let case = |name, sequence, code, stripe_px, read_noise_dn, gain_dn| BitCase {
        name,
        sequence,
        code,
        stripe_px,
        read_noise_dn,
        gain_dn,
    };
    vec![
        case("Gray, white and black", plain(gray), gray, half, 3400.0, 0.0),
        case("Gray, white and black, shot noise", plain(gray), gray, half, 1000.0, 260.0),
        case("binary, white and black", plain(binary), binary, half, 3400.0, 0.0),
        case("Gray and its complement", both, gray, half, 5000.0, 0.0),
        case("Gray 8/16 px, mean of ten steps", by_mean, gray, half, 4000.0, 0.0),
        case("Gray 8/16 px, white and black", with(half), gray, half, 3400.0, 0.0),
        case("Gray 16/16 px, white and black", with(PERIOD_PX), gray, PERIOD_PX, 3400.0, 0.0),
    ]
}

/// What is counted over some pixels.
#[derive(Default, Clone, Copy)]
struct Counts {
    pixels: u64,
    bits: [f64; 2],
    orders: [f64; 2],
}

impl BitCase {
    /// Rows for bits and for orders; without sines an order is a stripe.
    pub fn measure(&self, pixels: u64, seed: u64) -> Result<Vec<Row>> {
        let pictures = pixels.div_ceil(u64::from(SIDE * SIDE));
        let counts: Vec<Counts> = (0..pictures)
            .into_par_iter()
            .map(|picture| self.picture(seed, picture))
            .collect::<Result<_>>()?;
        let all = counts.iter().fold(Counts::default(), |sum, c| Counts {
            pixels: sum.pixels + c.pixels,
            bits: [sum.bits[0] + c.bits[0], sum.bits[1] + c.bits[1]],
            orders: [sum.orders[0] + c.orders[0], sum.orders[1] + c.orders[1]],
        });
        let row = |what: &str, [predicted, observed]: [f64; 2]| Row {
            name: format!("{}: {what}", self.name),
            predicted: predicted / all.pixels as f64,
            observed: observed / all.pixels as f64,
            ratio: observed / predicted,
            pixels: all.pixels,
        };
        if self.has_sine() {
            return Ok(vec![row("orders", all.orders)]);
        }
        Ok(vec![row("bits", all.bits), row("stripes", all.orders)])
    }

    fn has_sine(&self) -> bool {
        self.sequence.iter().any(|set| matches!(set, PatternSet::Sine { .. }))
    }

    fn extent_px(&self) -> f64 {
        self.stripe_px * f64::from(1_u32 << BITS)
    }

    fn picture(&self, seed: u64, picture: u64) -> Result<Counts> {
        let key = Key::new(seed).with(100 + picture);
        // Away from the ends, where a coordinate may belong to a place beyond the projector.
        let margin_px = 2.0 * PERIOD_PX;
        let at = |i: u64| margin_px + (self.extent_px() - 2.0 * margin_px) * key.open(i);
        let truth: Vec<f64> = (0..u64::from(SIDE * SIDE)).map(at).collect();
        let camera_noise = Some(CameraNoise { read_noise_dn: self.read_noise_dn, gain_dn: self.gain_dn });
        let settings = DecodeSettings { camera_noise, certainty_sigmas: 0.0, ..DecodeSettings::default() };
        let extent_px = [self.extent_px() as u32; 2];
        let view = View {
            sequence: &self.sequence,
            extent_px,
            size_px: [SIDE; 2],
            full_scale_dn: u16::MAX,
            exposures_ms: &[],
        };
        let mut decoder = ViewDecoder::new(&view, &settings, PhaseMethod::default())?;
        let normal = Normal::default();
        let mut number = 0;
        for set in &self.sequence {
            for step in 0..set.frames() {
                let frame =
                    self.frame(&truth, (set, step, extent_px[0]), &normal, key.with(number as u64))?;
                let pixels = Pixels::Mono16(&frame);
                let view = FrameView { width_px: SIDE, height_px: SIDE, full_scale_dn: u16::MAX, pixels };
                decoder.push(number, &view)?;
                number += 1;
            }
        }
        let counted = decoder.diagnose(Axis::X)?;
        let seen = counted.iter().zip(&truth).filter(|(d, _)| !d.wrong_order.is_nan());
        Ok(seen.fold(Counts::default(), |sum, (d, x)| self.count(sum, d, *x)))
    }

    fn frame(
        &self,
        truth: &[f64],
        (set, step, extent_px): (&PatternSet, usize, u32),
        normal: &Normal,
        key: Key,
    ) -> Result<Vec<u16>> {
        let [black, white] = LEVELS_DN;
        let value = |(i, x): (usize, &f64)| -> Result<u16> {
            let level = black + (white - black) * set.intensity(step, *x, extent_px)?;
            let sigma = (self.read_noise_dn * self.read_noise_dn + self.gain_dn * level).sqrt();
            Ok((level + sigma * f64::from(normal.draw(key.bits(i as u64)))).round() as u16)
        };
        truth.iter().enumerate().map(value).collect()
    }

    fn count(&self, sum: Counts, found: &Diagnosis, truth_px: f64) -> Counts {
        let stripe = |x: f64| ((x + 0.5) / self.stripe_px).floor() as u32;
        let code = |stripe: u32| if self.code == Code::Gray { stripe ^ (stripe >> 1) } else { stripe };
        let own_px = f64::from(found.own_px);
        let apart = code(stripe(own_px)) ^ code(stripe(truth_px));
        let wrong = if self.has_sine() { (own_px - truth_px).abs() > 0.5 * PERIOD_PX } else { apart != 0 };
        Counts {
            pixels: sum.pixels + 1,
            bits: [sum.bits[0] + f64::from(found.wrong_bits), sum.bits[1] + f64::from(apart.count_ones())],
            orders: [
                sum.orders[0] + f64::from(found.wrong_order),
                sum.orders[1] + f64::from(u8::from(wrong)),
            ],
        }
    }
}
