//! The light of one projected frame as a function of the projector coordinate.

use crate::settings::TwinSettings;
use fringe::math::pow;
use fringe::pattern::{Axis, Direction, LevelTable, PatternError, PatternSet, level_u8};
use libm::erf;

/// Projector coordinates are stored as (pixel + 1)·2²⁰: 5e-7 px of rounding (0.2 nm on the part), and the table index
/// is a shift away.
pub(crate) const FIXED_BITS: u32 = 20;

/// Largest projector side that fits the fixed-point coordinate.
pub(crate) const LARGEST_SIDE_PX: u32 = 4094;

/// Table cells per projector pixel: linear interpolation of a sine of 16 px period then errs by 2e-5 of its amplitude.
const CELLS_BITS: u32 = 5;
const CELLS: usize = 1 << CELLS_BITS;
const CELL_SHIFT: u32 = FIXED_BITS - CELLS_BITS;

/// Pixel coordinate to fixed point.
pub(crate) fn fixed(pixel: f64) -> u32 {
    ((pixel + 1.0) * f64::from(1_u32 << FIXED_BITS)).round() as u32
}

/// Fixed point to pixel coordinate.
pub(crate) fn pixel(fixed: u32) -> f64 {
    f64::from(fixed) / f64::from(1_u32 << FIXED_BITS) - 1.0
}

/// Blur from one layer of a defocused table to the next, standard deviation in projector pixels.
pub(crate) const LAYER_PX: f64 = 0.5;

/// Layers of a defocused table: up to 6 px, where fringes of 16 px have lost 94 % of their contrast.
const LAYERS: usize = 13;

/// Light, 0 … 1.
#[derive(Debug, Clone)]
pub(crate) enum Light {
    /// The same level everywhere.
    Even(f32),
    /// Blurred or stepped: tabulated at the centres of cells of 1/32 px, from coordinate −1 px on. Layer i is out of focus by
    /// i·[`LAYER_PX`].
    Table { axis: Axis, layers: Vec<Vec<f32>> },
    /// The pattern's formula, evaluated at each place.
    Formula { axis: Axis, set: PatternSet, step: usize, size_px: u32, response: Response },
    /// Two factors, one along each axis, over what the black level leaks. Each is rounded to 8 bits by itself, not their product.
    Product { factors: Box<[Light; 2]>, leak: f32 },
}

/// From a level 0 … 1 to light.
#[derive(Debug, Clone)]
pub(crate) struct Response {
    correction: Option<LevelTable>,
    gamma: f64,
    leak: f64,
    rounded: bool,
}

impl Response {
    fn light(&self, level: f64) -> f64 {
        let level = self.correction.as_ref().map_or(level, |table| table.at(level));
        let level = if self.rounded { f64::from(level_u8(level)) / 255.0 } else { level };
        let answer = if self.gamma == 1.0 { level } else { pow(level.max(0.0), self.gamma) };
        self.leak + (1.0 - self.leak) * answer
    }
}

impl Light {
    /// The light of one frame of a set on a projector of `size_px` [width, height]; the pattern is corrected by the table
    /// before the projector answers.
    pub fn new(
        set: &PatternSet,
        step: usize,
        size_px: [u32; 2],
        settings: &TwinSettings,
        correction: Option<&LevelTable>,
    ) -> Result<Self, PatternError> {
        set.check()?;
        let response = Response {
            correction: correction.cloned(),
            gamma: settings.projector_gamma,
            leak: settings.projector_leak,
            rounded: settings.projector_8bit,
        };
        if let Some((carrier, frame)) = set.carrier(step) {
            let sealed = TwinSettings { projector_leak: 0.0, ..settings.clone() };
            let sine = PatternSet::Sine {
                axis: set.axis().unwrap_or(Axis::X),
                period_px: set.period_px().unwrap_or(f64::INFINITY),
                steps: 1,
                first_step_rad: set.step_rad(step),
                direction: Direction::Forward,
                shifts_rad: Vec::new(),
            };
            let factors = [
                Self::new(&sine, 0, size_px, &sealed, correction)?,
                Self::new(&carrier, frame, size_px, &sealed, correction)?,
            ];
            return Ok(Self::Product { factors: Box::new(factors), leak: settings.projector_leak as f32 });
        }
        let Some(axis) = set.axis() else {
            return Ok(Self::Even(response.light(set.intensity(step, 0.0, 1)?) as f32));
        };
        let size_px = size_px[usize::from(axis == Axis::Y)];
        let defocused = settings.defocus_px_per_mm > 0.0;
        if !settings.projector_pixels && settings.projector_blur_px == 0.0 && !defocused {
            return Ok(Self::Formula { axis, set: set.clone(), step, size_px, response });
        }
        let sharp = sharp_cells(set, step, size_px, settings.projector_pixels, &response)?;
        let layer = |number: usize| {
            let (blur_px, out_px) = (settings.projector_blur_px, LAYER_PX * number as f64);
            let taps = gaussian_taps((blur_px * blur_px + out_px * out_px).sqrt() * CELLS as f64);
            convolve(&sharp, &taps)
        };
        let layers = (0..if defocused { LAYERS } else { 1 }).map(layer).collect();
        Ok(Self::Table { axis, layers })
    }

    /// Light at a projector coordinate (fixed point u, v), out of focus by so many layers.
    pub fn at(&self, u: u32, v: u32, layer: f32) -> f32 {
        match self {
            Self::Even(light) => *light,
            Self::Product { factors, leak } => {
                let light = factors[0].at(u, v, layer) * factors[1].at(u, v, layer);
                leak + (1.0 - leak) * light
            }
            Self::Table { axis, layers } => tabulated(layers, if *axis == Axis::X { u } else { v }, layer),
            Self::Formula { axis, set, step, size_px, response } => {
                let at = pixel(if *axis == Axis::X { u } else { v });
                // The set was checked when this light was made, so it can be generated.
                response.light(set.intensity(*step, at, *size_px).unwrap_or(0.0)) as f32
            }
        }
    }
}

/// Light of a table at a coordinate (fixed point), out of focus by so many layers.
#[inline]
pub(crate) fn tabulated(layers: &[Vec<f32>], at: u32, layer: f32) -> f32 {
    let below = (layer as usize).min(layers.len() - 1);
    let value = interpolate(&layers[below], at);
    match layers.get(below + 1) {
        Some(next) if layer > 0.0 => value + (layer - below as f32) * (interpolate(next, at) - value),
        _ => value,
    }
}

/// Value between two cell centres; constant beyond the ends.
#[inline]
pub(crate) fn interpolate(cells: &[f32], fixed: u32) -> f32 {
    let from_centre = fixed.saturating_sub(1 << (CELL_SHIFT - 1));
    let index = ((from_centre >> CELL_SHIFT) as usize).min(cells.len() - 2);
    let fraction = (from_centre & ((1 << CELL_SHIFT) - 1)) as f32 / (1_u32 << CELL_SHIFT) as f32;
    cells[index] + (cells[index + 1] - cells[index]) * fraction
}

/// Light per cell before blur, from −1 px to size + 1 px; dark beyond the chip.
fn sharp_cells(
    set: &PatternSet,
    step: usize,
    size_px: u32,
    pixels: bool,
    response: &Response,
) -> Result<Vec<f64>, PatternError> {
    (0..(size_px as usize + 2) * CELLS)
        .map(|cell| {
            let at = (cell as f64 + 0.5) / CELLS as f64 - 1.0;
            let column = (at + 0.5).floor();
            if column < 0.0 || column >= f64::from(size_px) {
                return Ok(0.0);
            }
            Ok(response.light(set.intensity(step, if pixels { column } else { at }, size_px)?))
        })
        .collect()
}

/// Half of a normalised kernel (centre first): a Gaussian integrated over cells, cut at six sigma.
fn gaussian_taps(sigma: f64) -> Vec<f64> {
    if sigma == 0.0 {
        return vec![1.0];
    }
    let below = |x: f64| 0.5 * erf(x / (sigma * std::f64::consts::SQRT_2));
    let reach = (6.0 * sigma).ceil() as usize;
    let taps: Vec<f64> = (0..=reach).map(|i| below(i as f64 + 0.5) - below(i as f64 - 0.5)).collect();
    let sum = 2.0 * taps.iter().sum::<f64>() - taps[0];
    taps.iter().map(|t| t / sum).collect()
}

/// Convolves; the ends continue.
fn convolve(values: &[f64], taps: &[f64]) -> Vec<f32> {
    let reach = taps.len() - 1;
    let mut padded = vec![values[0]; reach];
    padded.extend_from_slice(values);
    padded.extend(std::iter::repeat_n(values[values.len() - 1], reach));
    (0..values.len())
        .map(|i| {
            let window = &padded[i..=i + 2 * reach];
            let pairs = (1..=reach).map(|k| taps[k] * (window[reach - k] + window[reach + k]));
            (taps[0] * window[reach] + pairs.sum::<f64>()) as f32
        })
        .collect()
}
