//! Predicted against observed: phase noise of each method, rate of wrong orders of each code, on random phases; wrong bits on drawn frames.

use super::bit_errors::{self, Row};
use super::out_of_range;
use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use anyhow::Result;
use fringe::decode::OrderRisk;
use fringe::decode::chain::{Chain, Sine, widest, widest_of};
use fringe::decode::number::Residues;
use fringe::frame::{FrameView, Pixels};
use fringe::math::random::{Key, Normal};
use fringe::math::{cos, wrap_positive_rad, wrap_rad};
use fringe::wrapped::{Limits, Method, Stack};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::path::PathBuf;

/// Pixels of one parallel job: fixed, so that the draws are the same on every machine.
const CHUNK: u64 = 1 << 16;

#[derive(clap::Args)]
pub struct Args {
    /// Number of pixels for each row of the tables.
    #[arg(long, value_name = "N", default_value_t = 10_000_000)]
    pixels: u64,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the benchmark. Exit code 1 when a ratio lies outside 0.95 … 1.05 by more than its counting noise.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    if !(1000..=1_000_000_000).contains(&args.pixels) {
        return out_of_range("--pixels", args.pixels, "1000 to 1000000000");
    }
    let (phases, orders, codes) = (phase_cases(), order_cases(), bit_errors::cases());
    let mut progress = Progress::new(phases.len() + orders.len() + codes.len(), "measuring");
    let mut noise = Vec::new();
    for (name, method, shifts) in &phases {
        noise.push(phase_noise(args, name, *method, shifts)?);
        progress.step();
    }
    let mut wrong = Vec::new();
    for case in &orders {
        wrong.push(case.measure(args));
        progress.step();
    }
    let mut bits = Vec::new();
    for case in &codes {
        bits.extend(case.measure(args.pixels, args.seed)?);
        progress.step();
    }
    drop(progress);
    print("phase noise, mrad rms", 1e3, &noise);
    print("wrong orders, fraction of pixels", 1.0, &wrong);
    print("wrong bits, a pixel, and what they make wrong, fraction of pixels", 1.0, &bits);
    let result = serde_json::json!({ "phase_noise_rad": noise, "wrong_orders": wrong, "codes": bits });
    emit(args.json.as_deref(), &result)?;
    let off = |row: &Row, spread: f64| (row.ratio - 1.0).abs() > 0.05 + 4.0 * spread;
    let counted = |row: &Row| off(row, (row.predicted * row.pixels as f64).powf(-0.5));
    let failed = noise.iter().any(|row| off(row, (2.0 * row.pixels as f64).powf(-0.5)))
        || wrong.iter().chain(&bits).any(counted);
    Ok(if failed { Outcome::LimitFailed } else { Outcome::Done })
}

fn print(title: &str, scale: f64, rows: &[Row]) {
    println!("{title}\n{:46} {:>12} {:>12} {:>8}", "", "predicted", "observed", "ratio");
    for row in rows {
        println!(
            "{:46} {:>12.6} {:>12.6} {:>8.4}",
            row.name,
            row.predicted * scale,
            row.observed * scale,
            row.ratio
        );
    }
    println!();
}

fn phase_cases() -> Vec<(&'static str, Method, Vec<f64>)> {
    let even = |n: u32| (0..n).map(|i| TAU * f64::from(i) / f64::from(n)).collect::<Vec<_>>();
    let quarter = |n: u32| (0..n).map(|i| FRAC_PI_2 * f64::from(i)).collect::<Vec<_>>();
    vec![
        ("three-step, closed form", Method::ThreeStep, even(3)),
        ("least squares, 3 even steps", Method::LeastSquares, even(3)),
        ("least squares, 4 even steps", Method::LeastSquares, even(4)),
        ("least squares, 10 even steps", Method::LeastSquares, even(10)),
        ("least squares, 5 uneven steps", Method::LeastSquares, vec![0.1, 1.3, 2.2, 3.9, 4.4]),
        ("Carré, 4 steps of 90°", Method::Carre, quarter(4)),
        ("Hariharan, 5 steps of 90°", Method::Hariharan, quarter(5)),
    ]
}

/// Modulation and background of the drawn fringes, DN of 65535, and the noise.
const DRAWN: (f64, f64, f64) = (18_000.0, 25_000.0, 360.0);

/// Root mean square of the error and of the predicted uncertainty over random phases.
fn phase_noise(args: &Args, name: &str, method: Method, shifts: &[f64]) -> Result<Row> {
    let limits = Limits {
        least_modulation_dn: 1000.0,
        clipped_dn: u16::MAX,
        read_variance_dn2: DRAWN.2 * DRAWN.2 + 1.0 / 12.0,
        gain_dn: 0.0,
    };
    let normal = Normal::default();
    let one = |chunk: u64| -> Result<(f64, f64, u64)> {
        let first = chunk * CHUNK;
        let count = CHUNK.min(args.pixels - first);
        let phase = |i: u64| TAU * Key::new(args.seed).with(1).open(first + i);
        let value = |step: usize, i: u64| {
            let noise = f64::from(normal.draw(Key::new(args.seed).with(2 + step as u64).bits(first + i)));
            (DRAWN.1 + DRAWN.0 * cos(phase(i) - shifts[step]) + DRAWN.2 * noise).round() as u16
        };
        let frames: Vec<Vec<u16>> =
            (0..shifts.len()).map(|step| (0..count).map(|i| value(step, i)).collect()).collect();
        let view =
            |pixels| FrameView { width_px: count as u32, height_px: 1, full_scale_dn: u16::MAX, pixels };
        let views: Vec<FrameView> = frames.iter().map(|frame| view(Pixels::Mono16(frame))).collect();
        let map = Stack::new(&views, shifts)?.wrap(method, &limits)?;
        let mut sums = (0.0, 0.0, 0);
        for i in (0..count).filter(|i| map.valid[*i as usize] == 1) {
            let error = wrap_rad(f64::from(map.phase_rad[i as usize]) - phase(i));
            sums =
                (sums.0 + error * error, sums.1 + f64::from(map.sigma_rad[i as usize]).powi(2), sums.2 + 1);
        }
        Ok(sums)
    };
    let chunks: Vec<(f64, f64, u64)> =
        (0..args.pixels.div_ceil(CHUNK)).into_par_iter().map(one).collect::<Result<_>>()?;
    let (error, sigma, pixels) = chunks.iter().fold((0.0, 0.0, 0), |s, c| (s.0 + c.0, s.1 + c.1, s.2 + c.2));
    let (observed, predicted) = ((error / pixels as f64).sqrt(), (sigma / pixels as f64).sqrt());
    Ok(Row { name: name.to_owned(), predicted, observed, ratio: observed / predicted, pixels })
}

/// A code, at a noise that makes some errors.
struct OrderCase {
    name: &'static str,
    periods_px: Vec<f64>,
    extent_px: u32,
    sigma_rad: f64,
    /// Stripe of a code at the start.
    stripe_px: Option<f64>,
    residues: Option<Residues>,
    chain: Chain,
}

fn order_cases() -> Vec<OrderCase> {
    let case = |name, periods: &[f64], extent_px: u32, sigma_rad, stripe_px: Option<f64>, kind: &str| {
        let sines: Vec<Sine> = periods.iter().map(|p| Sine { period_px: *p, steps: 6 }).collect();
        let list: Vec<(f64, u32)> = periods.iter().map(|p| (*p, 6)).collect();
        let extent = f64::from(extent_px);
        let (residues, chain) = match kind {
            "table" => (Some(Residues::new(&list, extent_px).ok()?), Some(Chain::of_residues(periods[0]))),
            "code" => (None, widest(&sines, stripe_px, f64::INFINITY)),
            "hierarchy" => (None, widest_of(&sines, None, extent, 1)),
            _ => (None, widest(&sines, None, extent)),
        };
        let periods_px = periods.to_vec();
        Some(OrderCase { name, periods_px, extent_px, sigma_rad, stripe_px, residues, chain: chain? })
    };
    let all = [
        case("code, stripe of half a period 8/16 px", &[16.0], 608, 0.6, Some(8.0), "code"),
        case("code, stripe of a period 16/16 px", &[16.0], 608, 0.1, Some(16.0), "code"),
        case("hierarchy 16, 608 px", &[16.0, 608.0], 608, 0.03, None, "hierarchy"),
        case("hierarchy 16, 96, 608 px", &[16.0, 96.0, 608.0], 608, 0.18, None, "hierarchy"),
        case("heterodyne 24, 26, 28 px", &[24.0, 26.0, 28.0], 1280, 0.08, None, "beats"),
        case("coprime 16, 39 px", &[16.0, 39.0], 624, 0.03, None, "table"),
        case("coprime 9, 10, 13 px", &[9.0, 10.0, 13.0], 608, 0.08, None, "table"),
        case("coprime 24, 26, 29 px", &[24.0, 26.0, 29.0], 608, 0.14, None, "table"),
    ];
    all.into_iter().flatten().collect()
}

impl OrderCase {
    fn measure(&self, args: &Args) -> Row {
        let normal = Normal::default();
        let one = |chunk: u64| {
            let first = chunk * CHUNK;
            (first..(first + CHUNK).min(args.pixels)).filter(|i| self.wrong(args.seed, *i, &normal)).count()
                as u64
        };
        let wrong: u64 = (0..args.pixels.div_ceil(CHUNK)).into_par_iter().map(one).sum();
        let observed = wrong as f64 / args.pixels as f64;
        let (chain, residues) = (&self.chain, self.residues.as_ref());
        let risk = OrderRisk { chain, stripe_px: self.stripe_px.unwrap_or(0.0), residues, micro: None };
        let predicted = risk.probability(self.sigma_rad);
        let name = format!("{}, {:.0} mrad", self.name, self.sigma_rad * 1e3);
        Row { name, predicted, observed, ratio: observed / predicted, pixels: args.pixels }
    }

    fn wrong(&self, seed: u64, i: u64, normal: &Normal) -> bool {
        // A period that covers the projector is ambiguous with itself at the ends.
        let margin = if self.residues.is_some() { 1.0 } else { 0.1 * f64::from(self.extent_px) };
        let x = margin + (f64::from(self.extent_px) - 0.5 - 2.0 * margin) * Key::new(seed).with(7).open(i);
        let mut phases = [0.0; 6];
        for (j, (phase, p)) in phases.iter_mut().zip(&self.periods_px).enumerate() {
            let noise = f64::from(normal.draw(Key::new(seed).with(8 + j as u64).bits(i)));
            *phase = wrap_positive_rad(TAU * x / p + self.sigma_rad * noise);
        }
        let found = match (&self.residues, self.stripe_px) {
            (Some(residues), _) => residues.resolve(|j| phases[j]).0,
            (None, Some(s)) => self.chain.coordinate_px(&phases, (x / s).floor() * s + 0.5 * s),
            (None, None) => self.chain.coordinate_px(&phases, 0.5 * f64::from(self.extent_px)),
        };
        (found - x).abs() > 0.5 * self.periods_px[0]
    }
}
