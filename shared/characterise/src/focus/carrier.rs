//! The strongest component of an image's spectrum.

use super::FocusError;
use crate::response::Roi;
use fringe::frame::FrameView;
use fringe::math::fourier::{Complex, transform_2d};
use fringe::math::statistics::median;
use fringe::math::{cos, ln, sincos};
use serde::Serialize;
use std::f64::consts::TAU;

/// Smallest side of a region, px.
const LEAST_SIDE_PX: u32 = 16;

/// Most pixels of a region: its transform then takes half a gigabyte at most.
const MOST_PIXELS: u64 = 1 << 22;

/// Largest side of the region that is taken when none is named, px.
const USUAL_SIDE_PX: u32 = 512;

/// Cycles within the region below which shading and the window's own lobe of the mean are taken for a pattern.
const LEAST_CYCLES: f64 = 3.0;

/// A known carrier is sought within this fraction of its frequency: the pitch changes with the distance.
const NEAR: f64 = 0.3;

/// A component of an image.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Carrier {
    /// Cycles per pixel along x and y.
    pub frequency_per_px: [f64; 2],
    /// Amplitude of the checkerboard's component, DN.
    pub amplitude_dn: f64,
    /// Mean grey value of the region, DN.
    pub mean_dn: f64,
    /// Amplitude over the mean of the region.
    pub contrast: f64,
    /// Amplitude over the median of the spectrum.
    pub peak_to_median: f64,
    /// Pixels of the region at full scale.
    pub saturated: usize,
}

impl Carrier {
    /// Side of the checkerboard's squares: half a cycle along each axis makes a diagonal wave of this frequency.
    pub fn square_px(&self) -> f64 {
        let [x, y] = self.frequency_per_px;
        1.0 / (2.0_f64.sqrt() * (x * x + y * y).sqrt())
    }
}

/// The middle of a frame: the largest power of two within its sides, 512 at most.
pub fn usual_region(width_px: u32, height_px: u32) -> Roi {
    let shorter = width_px.min(height_px).clamp(1, USUAL_SIDE_PX);
    let side = 1 << shorter.ilog2();
    Roi { x: (width_px - side) / 2, y: (height_px - side) / 2, width_px: side, height_px: side }
}

/// Finds the strongest component of a region, or the strongest near a known one.
///
/// # Errors
/// A region outside of the frame, too small or too large, or saturated by more than half.
pub fn find(frame: &FrameView<'_>, roi: &Roi, near: Option<&Carrier>) -> Result<Carrier, FocusError> {
    roi.check(frame.width_px, frame.height_px)?;
    if roi.width_px.min(roi.height_px) < LEAST_SIDE_PX || roi.pixels() > MOST_PIXELS {
        let roi = roi.to_string();
        return Err(FocusError::RegionSize { roi, least: LEAST_SIDE_PX, most: MOST_PIXELS });
    }
    let crop = roi.crop(frame);
    let saturated = crop.iter().filter(|dn| **dn >= frame.full_scale_dn).count();
    if 2 * saturated > crop.len() {
        return Err(FocusError::Saturated { saturated, pixels: crop.len() });
    }
    let picture = Windowed::new(&crop, roi.width_px as usize, roi.height_px as usize);
    let spectrum = picture.spectrum();
    let Some((bin, median)) = spectrum.strongest(roi, near) else {
        return Err(FocusError::RegionSize { roi: roi.to_string(), least: LEAST_SIDE_PX, most: MOST_PIXELS });
    };
    let frequency = picture.refine(bin);
    let amplitude_dn = picture.amplitude(frequency);
    let mean_dn = picture.mean_dn;
    let over = |a: f64, b: f64| if b > 0.0 { a / b } else { 0.0 };
    Ok(Carrier {
        frequency_per_px: frequency,
        amplitude_dn,
        mean_dn,
        contrast: over(amplitude_dn, mean_dn),
        peak_to_median: over(amplitude_dn, median * picture.scale),
        saturated,
    })
}

/// A region less its mean, in a Hann window.
struct Windowed {
    width: usize,
    height: usize,
    values: Vec<f64>,
    mean_dn: f64,
    /// From the magnitude of the transform to the amplitude of a wave.
    scale: f64,
}

impl Windowed {
    fn new(crop: &[u16], width: usize, height: usize) -> Self {
        let window = |n: usize| -> Vec<f64> {
            (0..n).map(|i| 0.5 - 0.5 * cos(TAU * (i as f64 + 0.5) / n as f64)).collect()
        };
        let (across, down) = (window(width), window(height));
        let sum = across.iter().sum::<f64>() * down.iter().sum::<f64>();
        let weight = |i: usize| across[i % width] * down[i / width];
        let mean = crop.iter().enumerate().map(|(i, dn)| weight(i) * f64::from(*dn)).sum::<f64>() / sum;
        let values = crop.iter().enumerate().map(|(i, dn)| weight(i) * (f64::from(*dn) - mean)).collect();
        Self { width, height, values, mean_dn: mean, scale: 2.0 / sum }
    }

    /// The transform, filled up with zeros to powers of two.
    fn spectrum(&self) -> Spectrum {
        let (width, height) = (self.width.next_power_of_two(), self.height.next_power_of_two());
        let mut values: Vec<Complex> = vec![(0.0, 0.0); width * height];
        for (row, from) in values.chunks_exact_mut(width).zip(self.values.chunks_exact(self.width)) {
            row.iter_mut().zip(from).for_each(|(to, value)| to.0 = *value);
        }
        transform_2d(&mut values, width, height);
        Spectrum {
            width,
            height,
            magnitude: values.iter().map(|(re, im)| (re * re + im * im).sqrt()).collect(),
        }
    }

    /// Amplitude of the wave of a frequency, cycles per pixel.
    fn amplitude(&self, [fx, fy]: [f64; 2]) -> f64 {
        let turns: Vec<(f64, f64)> = (0..self.width).map(|x| sincos(TAU * fx * x as f64)).collect();
        let (mut re, mut im) = (0.0, 0.0);
        for (y, row) in self.values.chunks_exact(self.width).enumerate() {
            let (mut c, mut s) = (0.0, 0.0);
            for (value, (sin, cos)) in row.iter().zip(&turns) {
                c += value * cos;
                s += value * sin;
            }
            let (sin, cos) = sincos(TAU * fy * y as f64);
            re += c * cos - s * sin;
            im += c * sin + s * cos;
        }
        (re * re + im * im).sqrt() * self.scale
    }

    /// Climbs from a bin to the maximum between the bins: parabolas of the logarithm along x and y, ever narrower.
    fn refine(&self, bin: [f64; 2]) -> [f64; 2] {
        let mut at = bin;
        for width in [0.5, 0.2, 0.05] {
            for axis in 0..2 {
                let step = width / [self.width, self.height][axis] as f64;
                let shifted = |by: f64| {
                    let mut moved = at;
                    moved[axis] += by;
                    self.amplitude(moved)
                };
                let (a, b, c) = (shifted(-step), shifted(0.0), shifted(step));
                if a <= 0.0 || b <= 0.0 || c <= 0.0 {
                    continue;
                }
                let (a, b, c) = (ln(a), ln(b), ln(c));
                let bend = a - 2.0 * b + c;
                if bend < 0.0 {
                    at[axis] += (0.5 * (a - c) / bend).clamp(-1.0, 1.0) * step;
                }
            }
        }
        at
    }
}

struct Spectrum {
    width: usize,
    height: usize,
    magnitude: Vec<f64>,
}

impl Spectrum {
    /// Frequency of the largest magnitude, cycles per pixel, and the median magnitude. Half of the plane suffices by symmetry.
    fn strongest(&self, roi: &Roi, near: Option<&Carrier>) -> Option<([f64; 2], f64)> {
        let signed = |k: usize, n: usize| {
            if 2 * k > n { k as f64 / n as f64 - 1.0 } else { k as f64 / n as f64 }
        };
        let mut best: Option<(f64, [f64; 2])> = None;
        let mut all = Vec::with_capacity(self.magnitude.len() / 2);
        for (index, magnitude) in self.magnitude.iter().enumerate() {
            let f = [signed(index % self.width, self.width), signed(index / self.width, self.height)];
            if f[0] < 0.0 || (f[0] == 0.0 && f[1] < 0.0) {
                continue;
            }
            all.push(*magnitude);
            let cycles = [f[0] * f64::from(roi.width_px), f[1] * f64::from(roi.height_px)];
            let shading = (cycles[0] * cycles[0] + cycles[1] * cycles[1]).sqrt() < LEAST_CYCLES;
            let far = near.is_some_and(|n| beyond(f, n.frequency_per_px));
            if !shading && !far && best.is_none_or(|(top, _)| *magnitude > top) {
                best = Some((*magnitude, f));
            }
        }
        let median = median(&mut all)?;
        best.map(|(_, f)| (f, median))
    }
}

/// Whether a frequency (or its mirror image) is not near another.
fn beyond(f: [f64; 2], known: [f64; 2]) -> bool {
    let reach = NEAR * (known[0] * known[0] + known[1] * known[1]).sqrt();
    let distance = |sign: f64| {
        let (x, y) = (f[0] - sign * known[0], f[1] - sign * known[1]);
        (x * x + y * y).sqrt()
    };
    distance(1.0) > reach && distance(-1.0) > reach
}
