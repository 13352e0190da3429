//! Fourier transform profilometry: the phase of one frame from the side lobe of its spectrum (eq. 2.3 – 2.9).
//!
//! The carrier is the strongest frequency, with the power weighted by the frequency because a part's own brightness falls
//! off towards fine detail. The lobe is cut out by a flat window with cosine flanks: all of it within 0.35 of the carrier, none
//! beyond 0.75. The phase keeps the carrier: it is the projector's phase, not its deviation from a plane.
//!
//! The part's own brightness is taken out first, as the mean over one period along the lines: what is left of it at the part's outline
//! and at the picture's ends would reach into the lobe. Where the window sees less than the whole (an outline, a step, an end) the
//! modulation dips; pixels with less than [`LEAST_OF_NEAR`] of the largest modulation within a period are masked.
//!
//! One frame does not show in which direction the phase rises; a second one of the set does, where there is one. Else it rises
//! along +x (along +y for a carrier that runs down).
//!
//! σ counts the noise that passes the window, and the systematic part (section 2.1.4): what edges, texture and detail leave in the
//! window. A narrower window sees other parts of them, so the difference of both phases, beyond what noise alone makes, says how
//! large it is; its mean square over a period counts in σ. Texture about as fine as the fringes is a fringe to a line alone, and
//! remains uncounted there.

use super::{Limits, Method, PixelPhase, Stack, WrapError, Wrapped};
use crate::math::fourier::{Complex, Plan, inverse, inverse_2d, transform_2d};
use crate::math::{cos, sin, wrap_rad};
use rayon::prelude::*;

/// Fewest periods over the picture.
const LEAST_PERIODS: f64 = 4.0;
/// Shortest period that is searched, px.
const SHORTEST_PX: f64 = 3.0;
/// Least share of the strongest frequency and its neighbours in the weighted power.
const LEAST_SHARE: f64 = 0.01;
/// Least modulation, as a share of the largest within a period. At an outline half of the window sees fringes: a half is left.
const LEAST_OF_NEAR: f64 = 0.7;
/// Window: flat up to this distance from the carrier, in units of the carrier …
const FLAT: f64 = 0.35;
/// … and zero from this on.
const REACH: f64 = 0.75;
/// Width of the second window over that of the first.
const NARROW: f64 = 0.7;

/// A picture of `columns` × `rows` whose lines run across the fringes.
struct Picture {
    values: Vec<f64>,
    columns: usize,
    rows: usize,
    transposed: bool,
}

impl Picture {
    fn new(stack: &Stack, frame: usize, transposed: bool) -> Self {
        let (width, height) = (stack.width_px as usize, stack.height_px as usize);
        let (columns, rows) = if transposed { (height, width) } else { (width, height) };
        let pixels = stack.frames[frame].pixels;
        let at = |i: usize| if transposed { (i % columns) * width + i / columns } else { i };
        let values = (0..columns * rows).map(|i| f64::from(pixels.get(at(i)))).collect();
        Self { values, columns, rows, transposed }
    }

    /// Lines less their mean, or less their mean over a period, padded with zeros to a power of two.
    fn lines(&self, period_px: Option<f64>) -> Vec<Vec<Complex>> {
        let padded = self.columns.next_power_of_two();
        let width = period_px.map_or(self.columns, |px| mean_width(px, self.columns));
        let line = |row: &[f64]| {
            // Twice, so that nothing of a carrier is left whose period is no whole number.
            let mean = running_mean(&running_mean(row, width), width);
            let mut line: Vec<Complex> = row.iter().zip(mean).map(|(v, mean)| (v - mean, 0.0)).collect();
            line.resize(padded, (0.0, 0.0));
            line
        };
        self.values.par_chunks_exact(self.columns).map(line).collect()
    }
}

/// Mean of the `width` values about each one; at the ends of the first and last `width` values.
fn running_mean(values: &[f64], width: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(values.len() + 1);
    sums.push(0.0);
    for value in values {
        sums.push(sums.last().copied().unwrap_or(0.0) + value);
    }
    let mean = |i: usize| {
        let first = i.saturating_sub(width / 2).min(values.len() - width);
        (sums[first + width] - sums[first]) / width as f64
    };
    (0..values.len()).map(mean).collect()
}

/// Part of a frequency, periods per pixel, that is left where the mean over a period was taken out twice: one less the squared response of
/// the mean over `width` values, sin(π f w) / (w sin(π f)).
fn left_of_noise(frequency: f64, period_px: f64, columns: usize) -> f64 {
    let width = mean_width(period_px, columns) as f64;
    let (whole, one) = (sin(std::f64::consts::PI * frequency * width), sin(std::f64::consts::PI * frequency));
    let mean = if one.abs() < 1e-12 { 1.0 } else { whole / (width * one) };
    1.0 - mean * mean
}

/// Values of the mean over a period.
fn mean_width(period_px: f64, columns: usize) -> usize {
    (period_px.round() as usize).clamp(1, columns)
}

/// Largest of the values at most `reach` away along each line.
fn running_max(values: &[f64], columns: usize, reach: usize) -> Vec<f64> {
    let mut out = values.to_vec();
    out.par_chunks_exact_mut(columns).zip(values.par_chunks_exact(columns)).for_each(|(out, line)| {
        for shift in 1..=reach.min(columns - 1) {
            out[shift..].iter_mut().zip(line).for_each(|(o, v)| *o = o.max(*v));
            out.iter_mut().zip(&line[shift..]).for_each(|(o, v)| *o = o.max(*v));
        }
    });
    out
}

/// Window of a frequency at `distance` carriers from the carrier.
fn window(distance: f64) -> f64 {
    if distance <= FLAT {
        1.0
    } else if distance >= REACH {
        0.0
    } else {
        0.5 + 0.5 * cos(std::f64::consts::PI * (distance - FLAT) / (REACH - FLAT))
    }
}

fn size(c: Complex) -> f64 {
    c.0 * c.0 + c.1 * c.1
}

/// Strongest bin of the lines' mean weighted power and its share; bins count periods per padded line.
fn carrier(spectra: &[Vec<Complex>], columns: usize) -> Option<(usize, f64)> {
    let padded = spectra.first()?.len();
    let least = (LEAST_PERIODS * padded as f64 / columns as f64).ceil() as usize;
    let most = (padded as f64 / SHORTEST_PX) as usize;
    let power = |k: usize| spectra.iter().map(|line| size(line[k])).sum::<f64>() * k as f64;
    let powers: Vec<f64> = (least..=most.min(padded / 2)).map(power).collect();
    let total: f64 = powers.iter().sum();
    let (best, _) = powers.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
    let near: f64 = powers[best.saturating_sub(1)..(best + 2).min(powers.len())].iter().sum();
    (total > 0.0).then_some((best + least, near / total))
}

/// Fourier method on each row alone (one-dimensional).
pub(super) fn rows(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let method = Method::FourierRows.name();
    let flat = Picture::new(stack, 0, false);
    let ((fx, fy), _) = strongest(&flat);
    let picture = if denser_down(fx, fy) { Picture::new(stack, 0, true) } else { flat };
    let (k, share) = carrier(&spectra(&picture, None), picture.columns).unwrap_or((0, 0.0));
    if share < LEAST_SHARE {
        return Err(WrapError::NoCarrier { method, share: 100.0 * share });
    }
    let padded = picture.columns.next_power_of_two();
    let distance = |i: usize| (i as f64 - k as f64).abs() / k as f64;
    let distances: Vec<f64> =
        (0..padded).map(|i| if i <= padded / 2 { distance(i) } else { f64::INFINITY }).collect();
    let period_px = padded as f64 / k as f64;
    let plan = Plan::new(padded);
    let lobe = |frame, width: f64| {
        let picture = Picture::new(stack, frame, picture.transposed);
        let mut lines = spectra(&picture, Some(period_px));
        let weights: Vec<f64> = distances.iter().map(|d| window(d / width)).collect();
        lines.par_iter_mut().for_each(|line| {
            line.iter_mut().zip(&weights).for_each(|(v, w)| *v = (v.0 * w, v.1 * w));
            inverse(line, &plan);
            line.truncate(picture.columns);
        });
        lines.concat()
    };
    let left = |i: usize| left_of_noise(i as f64 / padded as f64, period_px, picture.columns);
    let passed = Passed::new(&distances, &left);
    Ok(finish(stack, limits, &picture, &lobe, (passed, [period_px, 0.0])))
}

fn spectra(picture: &Picture, period_px: Option<f64>) -> Vec<Vec<Complex>> {
    let plan = Plan::new(picture.columns.next_power_of_two());
    let mut lines = picture.lines(period_px);
    lines.par_iter_mut().for_each(|line| plan.run(line));
    lines
}

/// In the plane: one lobe of the two-dimensional spectrum.
pub(super) fn plane(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let first = Picture::new(stack, 0, false);
    let ((fx, fy), share) = strongest(&first);
    // One bin of a plane holds less of the lobe than one of a line: a tilt spreads it over both directions.
    if share < 0.1 * LEAST_SHARE {
        return Err(WrapError::NoCarrier { method: Method::Fourier.name(), share: 100.0 * share });
    }
    let transposed = denser_down(fx, fy);
    let (picture, fx, fy) = if transposed { (Picture::new(stack, 0, true), fy, fx) } else { (first, fx, fy) };
    let (width, height) = (picture.columns.next_power_of_two(), picture.rows.next_power_of_two());
    let f0 = (fx * fx + fy * fy).sqrt();
    let distance = |i: usize| {
        let (x, y) = frequency(i, width, height);
        ((x - fx) * (x - fx) + (y - fy) * (y - fy)).sqrt() / f0
    };
    let distances: Vec<f64> = (0..width * height).into_par_iter().map(distance).collect();
    let left = |i: usize| left_of_noise(frequency(i, width, height).0, 1.0 / fx.abs(), picture.columns);
    let passed = Passed::new(&distances, &left);
    let lobe = |frame, times: f64| {
        let mut values = spectrum(&Picture::new(stack, frame, transposed), Some(1.0 / fx.abs()));
        values.par_iter_mut().zip(&distances).for_each(|(v, d)| {
            let w = window(d / times);
            *v = (v.0 * w, v.1 * w);
        });
        inverse_2d(&mut values, width, height);
        let rows = values.chunks_exact(width).take(picture.rows);
        rows.flat_map(|row| row[..picture.columns].to_vec()).collect()
    };
    Ok(finish(stack, limits, &picture, &lobe, (passed, [1.0 / f0; 2])))
}

fn spectrum(picture: &Picture, period_px: Option<f64>) -> Vec<Complex> {
    let (width, height) = (picture.columns.next_power_of_two(), picture.rows.next_power_of_two());
    let mut values = picture.lines(period_px).concat();
    values.resize(width * height, (0.0, 0.0));
    transform_2d(&mut values, width, height);
    values
}

/// Periods per pixel along x and y.
fn frequency(i: usize, width: usize, height: usize) -> (f64, f64) {
    let signed = |k: usize, n: usize| if 2 * k > n { k as f64 - n as f64 } else { k as f64 } / n as f64;
    (signed(i % width, width), signed(i / width, height))
}

/// Whether lines should run down the picture: along that axis on which the fringes are denser.
fn denser_down(fx: f64, fy: f64) -> bool {
    fy.abs() > fx.abs()
}

/// Strongest frequency in the half plane with the greater part of +x, or of +y, periods per pixel, and its share in the
/// weighted power.
fn strongest(picture: &Picture) -> ((f64, f64), f64) {
    let (width, height) = (picture.columns.next_power_of_two(), picture.rows.next_power_of_two());
    let longest = picture.columns.max(picture.rows) as f64;
    let mut total = 0.0;
    let mut best = (0.0, (0.0, 0.0));
    for (i, value) in spectrum(picture, None).iter().enumerate() {
        let (x, y) = frequency(i, width, height);
        let f = (x * x + y * y).sqrt();
        let half = x > y.abs() || (y > 0.0 && y >= x.abs());
        if half && f >= LEAST_PERIODS / longest && f <= 1.0 / SHORTEST_PX {
            let power = size(*value) * f;
            total += power;
            if power > best.0 {
                best = (power, (x, y));
            }
        }
    }
    (best.1, if total > 0.0 { best.0 / total } else { 0.0 })
}

/// Shares of white noise that windows pass, after the mean over a period is taken out.
#[derive(Debug, Clone, Copy)]
struct Passed {
    /// Share that the window passes.
    whole: f64,
    /// Through the window and not through the narrow one, or to another part.
    between: f64,
}

impl Passed {
    /// From the distance of each frequency from the carrier and what is left of its noise.
    fn new(distances: &[f64], left: &(dyn Fn(usize) -> f64 + Sync)) -> Self {
        let (mut whole, mut between) = (0.0, 0.0);
        for (i, distance) in distances.iter().enumerate().filter(|(_, d)| **d < REACH) {
            let (wide, narrow, left) = (window(*distance), window(distance / NARROW), left(i));
            whole += (wide * left) * (wide * left);
            between += ((wide - narrow) * left) * ((wide - narrow) * left);
        }
        let count = distances.len() as f64;
        Self { whole: whole / count, between: between / count }
    }
}

/// Mean squared difference of the phases of two windows, rad², over a period along the lines and across them.
fn mean_squared_difference(
    wide: &[Complex],
    narrow: &[Complex],
    picture: &Picture,
    reach_px: [f64; 2],
) -> Vec<f64> {
    let (columns, rows) = (picture.columns, picture.rows);
    let square = |(a, b): (&Complex, &Complex)| {
        let (angle, _) = super::polar(a.1 * b.0 - a.0 * b.1, a.0 * b.0 + a.1 * b.1);
        angle * angle
    };
    let squares: Vec<f64> = wide.iter().zip(narrow).map(square).collect();
    let width = |px: f64, most: usize| (px.round() as usize).clamp(1, most);
    let along: Vec<f64> = squares
        .par_chunks_exact(columns)
        .flat_map_iter(|row| running_mean(row, width(reach_px[0], columns)))
        .collect();
    let turned: Vec<f64> = (0..along.len()).map(|i| along[(i % rows) * columns + i / rows]).collect();
    let both: Vec<f64> = turned
        .par_chunks_exact(rows)
        .flat_map_iter(|row| running_mean(row, width(reach_px[1], rows)))
        .collect();
    (0..both.len()).map(|i| both[(i % columns) * rows + i / columns]).collect()
}

/// From the lobe c = ½ B e^{±i(φ − δ)} to the phase (eq. 2.9).
fn finish(
    stack: &Stack,
    limits: &Limits,
    picture: &Picture,
    lobe: &dyn Fn(usize, f64) -> Vec<Complex>,
    (passed, [period_px, across_px]): (Passed, [f64; 2]),
) -> Wrapped {
    let first = lobe(0, 1.0);
    let sign = if stack.frames.len() > 1 { sense(&first, &lobe(1, 1.0), stack) } else { 1.0 };
    let differences =
        mean_squared_difference(&first, &lobe(0, NARROW), picture, [period_px, across_px.max(period_px)]);
    let mut out = Wrapped::new(stack.width_px, stack.height_px);
    let margin = (0.5 * period_px).ceil() as usize;
    let whole = whole(&first, picture, [period_px, across_px]);
    for (i, (c, value)) in first.iter().zip(&picture.values).enumerate() {
        let (x, y) = (i % picture.columns, i / picture.columns);
        let index = if picture.transposed { x * stack.width_px as usize + y } else { i };
        let (angle, length) = super::polar(c.1, c.0);
        let modulation_dn = 2.0 * length;
        let background_dn = value - modulation_dn * cos(angle);
        // Of the phase of c with ½ B: noise over B times the root of twice the share that passes.
        let noise = limits.noise_dn(background_dn) / modulation_dn;
        let systematic = (differences[i] - 2.0 * passed.between * noise * noise).max(0.0);
        let sigma_rad = (2.0 * passed.whole * noise * noise + systematic).sqrt();
        let phase_rad = sign * angle + stack.shifts_rad[0];
        let found = PixelPhase { phase_rad, modulation_dn, background_dn, sigma_rad };
        out.set(index, &found, limits.least_modulation_dn);
        if x < margin || x + margin >= picture.columns || !whole[i] {
            out.mask(index);
        }
    }
    mask_clipped(stack, limits, margin, &mut out);
    out
}

/// Whether the window sees the whole of the fringes about each pixel: the reaches are along the lines and across them.
fn whole(lobe: &[Complex], picture: &Picture, reach_px: [f64; 2]) -> Vec<bool> {
    let (columns, rows) = (picture.columns, picture.rows);
    let reach = reach_px.map(|px| px.ceil() as usize);
    let power: Vec<f64> = lobe.iter().map(|c| size(*c)).collect();
    let along = running_max(&power, columns, reach[0]);
    let turned: Vec<f64> = (0..power.len()).map(|i| along[(i % rows) * columns + i / rows]).collect();
    let both = running_max(&turned, rows, reach[1]);
    let least = LEAST_OF_NEAR * LEAST_OF_NEAR;
    let near = |i: usize| both[(i % columns) * rows + i / columns];
    (0..power.len()).map(|i| power[i] >= least * near(i)).collect()
}

/// Masks what lies within half a period of a clipped pixel.
fn mask_clipped(stack: &Stack, limits: &Limits, margin: usize, out: &mut Wrapped) {
    let (width, height) = (stack.width_px as usize, stack.height_px as usize);
    for index in 0..stack.len() {
        if stack.frames[0].pixels.get(index) < f32::from(limits.clipped_dn) {
            continue;
        }
        let (x, y) = (index % width, index / width);
        for row in y.saturating_sub(margin)..(y + margin + 1).min(height) {
            for column in x.saturating_sub(margin)..(x + margin + 1).min(width) {
                out.mask(row * width + column);
            }
        }
    }
}

/// +1 where the phase rises along the carrier, −1 where it falls: between two frames it moves by −(δ₁ − δ₀) or its negative.
fn sense(first: &[Complex], second: &[Complex], stack: &Stack) -> f64 {
    let mut sum = (0.0, 0.0);
    for (a, b) in first.iter().zip(second) {
        sum.0 += b.0 * a.0 + b.1 * a.1;
        sum.1 += b.1 * a.0 - b.0 * a.1;
    }
    let moved_rad = super::polar(sum.1, sum.0).0;
    let step_rad = stack.shifts_rad[1] - stack.shifts_rad[0];
    if wrap_rad(moved_rad + step_rad).abs() <= wrap_rad(moved_rad - step_rad).abs() { 1.0 } else { -1.0 }
}
