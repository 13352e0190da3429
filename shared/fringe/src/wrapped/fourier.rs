//! Fourier transform profilometry: the phase of one frame from the side lobe of its spectrum (eq. 2.3 – 2.9).
//!
//! The carrier is the strongest frequency, with the power weighted by the frequency because a part's own brightness falls
//! off towards fine detail. The lobe is cut out by a flat window with cosine flanks: all of it within 0.35 of the carrier, none
//! beyond 0.75. The phase keeps the carrier: it is the projector's phase, not its deviation from a plane.
//!
//! One frame does not tell in which direction the phase rises; a second one of the set does, where there is one. Else it rises
//! along +x (along +y for a carrier that runs down).
//!
//! σ counts the noise that passes the window, not what the part's edges leave in it: near edges the phase is worse than it says,
//! which is the method's weakness (section 2.1.4).

use super::{Found, Limits, Method, Stack, WrapError, Wrapped};
use crate::fourier::{Complex, Plan, inverse, inverse_2d, transform_2d};
use crate::math::{cos, wrap_rad};
use rayon::prelude::*;

/// Fewest periods over the picture.
const LEAST_PERIODS: f64 = 4.0;
/// Shortest period, px.
const SHORTEST_PX: f64 = 3.0;
/// Least share of the strongest frequency and its neighbours in the weighted power.
const LEAST_SHARE: f64 = 0.01;
/// Window: flat up to this distance from the carrier, in units of the carrier …
const FLAT: f64 = 0.35;
/// … and zero from this on.
const REACH: f64 = 0.75;

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

    /// Lines less their mean, padded with zeros to a power of two.
    fn lines(&self) -> Vec<Vec<Complex>> {
        let padded = self.columns.next_power_of_two();
        let line = |row: &[f64]| {
            let mean = row.iter().sum::<f64>() / row.len() as f64;
            let mut line: Vec<Complex> = row.iter().map(|v| (v - mean, 0.0)).collect();
            line.resize(padded, (0.0, 0.0));
            line
        };
        self.values.chunks_exact(self.columns).map(line).collect()
    }
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

/// Row by row.
pub(super) fn rows(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let method = Method::FourierRows.name();
    let across = |transposed| {
        let picture = Picture::new(stack, 0, transposed);
        let found = carrier(&spectra(&picture), picture.columns);
        (picture, found)
    };
    let (one, other) = (across(false), across(true));
    let share = |found: &(Picture, Option<(usize, f64)>)| found.1.map_or(0.0, |f| f.1);
    let (picture, found) = if share(&one) >= share(&other) { one } else { other };
    let (k, _) = found
        .filter(|(_, share)| *share >= LEAST_SHARE)
        .ok_or(WrapError::NoCarrier { method, share: found.map_or(0.0, |f| 100.0 * f.1) })?;
    let weights = |n: usize| -> Vec<f64> {
        (0..n)
            .map(|i| if i <= n / 2 { window((i as f64 - k as f64).abs() / k as f64) } else { 0.0 })
            .collect()
    };
    let lobe = |frame| {
        let picture = Picture::new(stack, frame, picture.transposed);
        let mut lines = spectra(&picture);
        let plan = Plan::new(picture.columns.next_power_of_two());
        lines.par_iter_mut().for_each(|line| {
            let weights = weights(line.len());
            line.iter_mut().zip(weights).for_each(|(v, w)| *v = (v.0 * w, v.1 * w));
            inverse(line, &plan);
            line.truncate(picture.columns);
        });
        lines.concat()
    };
    let padded = picture.columns.next_power_of_two();
    let passed = weights(padded).iter().map(|w| w * w).sum::<f64>() / padded as f64;
    let period_px = padded as f64 / k as f64;
    Ok(finish(stack, limits, &picture, &lobe, (passed, period_px)))
}

fn spectra(picture: &Picture) -> Vec<Vec<Complex>> {
    let plan = Plan::new(picture.columns.next_power_of_two());
    let mut lines = picture.lines();
    lines.par_iter_mut().for_each(|line| plan.run(line));
    lines
}

/// In the plane: one lobe of the two-dimensional spectrum.
pub(super) fn plane(stack: &Stack, limits: &Limits) -> Result<Wrapped, WrapError> {
    let picture = Picture::new(stack, 0, false);
    let (width, height) = (picture.columns.next_power_of_two(), picture.rows.next_power_of_two());
    let spectrum = |frame| {
        let lines = Picture::new(stack, frame, false).lines();
        let mut values = lines.concat();
        values.resize(width * height, (0.0, 0.0));
        transform_2d(&mut values, width, height);
        values
    };
    // Frequencies in periods per pixel; the half plane with the greater part of +x, or of +y.
    let at = |i: usize| {
        let signed = |k: usize, n: usize| if 2 * k > n { k as f64 - n as f64 } else { k as f64 } / n as f64;
        (signed(i % width, width), signed(i / width, height))
    };
    let first = spectrum(0);
    let (fx, fy) = carrier_2d(&first, &at, [picture.columns, picture.rows])?;
    let f0 = (fx * fx + fy * fy).sqrt();
    let weight = |i: usize| {
        let (x, y) = at(i);
        window(((x - fx) * (x - fx) + (y - fy) * (y - fy)).sqrt() / f0)
    };
    let passed = (0..width * height).map(|i| weight(i) * weight(i)).sum::<f64>() / (width * height) as f64;
    let lobe = |frame| {
        let mut values = if frame == 0 { first.clone() } else { spectrum(frame) };
        values.iter_mut().enumerate().for_each(|(i, v)| {
            let w = weight(i);
            *v = (v.0 * w, v.1 * w);
        });
        inverse_2d(&mut values, width, height);
        let rows = values.chunks_exact(width).take(picture.rows);
        rows.flat_map(|row| row[..picture.columns].to_vec()).collect()
    };
    Ok(finish(stack, limits, &picture, &lobe, (passed, 1.0 / f0)))
}

fn carrier_2d(
    spectrum: &[Complex],
    at: &impl Fn(usize) -> (f64, f64),
    sides: [usize; 2],
) -> Result<(f64, f64), WrapError> {
    let longest = sides[0].max(sides[1]) as f64;
    let mut total = 0.0;
    let mut best = (0.0, (0.0, 0.0));
    for (i, value) in spectrum.iter().enumerate() {
        let (x, y) = at(i);
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
    // One bin of a plane holds less of the lobe than one of a line: a tilt spreads it over both directions.
    let share = if total > 0.0 { best.0 / total } else { 0.0 };
    if share < 0.1 * LEAST_SHARE {
        return Err(WrapError::NoCarrier { method: Method::Fourier.name(), share: 100.0 * share });
    }
    Ok(best.1)
}

/// From the lobe c = ½ B e^{±i(φ − δ)} to the phase (eq. 2.9).
fn finish(
    stack: &Stack,
    limits: &Limits,
    picture: &Picture,
    lobe: &dyn Fn(usize) -> Vec<Complex>,
    (passed, period_px): (f64, f64),
) -> Wrapped {
    let first = lobe(0);
    let sign = if stack.frames.len() > 1 { sense(&first, &lobe(1), stack) } else { 1.0 };
    let mut out = Wrapped::new(stack.width_px, stack.height_px);
    let margin = (0.5 * period_px).ceil() as usize;
    for (i, (c, value)) in first.iter().zip(&picture.values).enumerate() {
        let (x, y) = (i % picture.columns, i / picture.columns);
        let index = if picture.transposed { x * stack.width_px as usize + y } else { i };
        let (angle, length) = super::polar(c.1, c.0);
        let modulation_dn = 2.0 * length;
        let background_dn = value - modulation_dn * cos(angle);
        let sigma_rad = (2.0 * passed).sqrt() * limits.noise_dn(background_dn) / modulation_dn;
        let phase_rad = sign * angle + stack.shifts_rad[0];
        let found = Found { phase_rad, modulation_dn, background_dn, sigma_rad };
        out.set(index, &found, limits.least_modulation_dn);
        // The ends of a line do not hold the whole window.
        if x < margin || x + margin >= picture.columns {
            out.mask(index);
        }
    }
    mask_clipped(stack, limits, margin, &mut out);
    out
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
