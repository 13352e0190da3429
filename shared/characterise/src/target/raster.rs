//! Grey values: those of a frame, where it lies, and what is computed of them, smoothed or reduced, for the search of candidates.

use super::error::{MAX_PIXELS, TargetError};
use fearless_simd::{Level, dispatch};
use fringe::frame::{FrameView, Pixels};
use nalgebra::Point2;

/// Grey values in rows.
pub(crate) trait Grey {
    /// Number of columns and of rows.
    fn size(&self) -> (usize, usize);

    /// One value; it must be there.
    fn get(&self, x: usize, y: usize) -> f32;

    /// Copies values of a row, from a column on.
    fn copy(&self, y: usize, from: usize, out: &mut [f32]);

    /// Bilinear value; `None` outside.
    fn sample(&self, at: Point2<f64>) -> Option<f32> {
        if !(at.x >= 0.0 && at.y >= 0.0) {
            return None;
        }
        let ((width, height), x, y) = (self.size(), at.x as usize, at.y as usize);
        if x + 1 >= width || y + 1 >= height {
            return None;
        }
        let (u, v) = ((at.x - x as f64) as f32, (at.y - y as f64) as f32);
        let top = self.get(x, y) * (1.0 - u) + self.get(x + 1, y) * u;
        let bottom = self.get(x, y + 1) * (1.0 - u) + self.get(x + 1, y + 1) * u;
        Some(top * (1.0 - v) + bottom * v)
    }

    /// Means of blocks of factor × factor pixels; a remainder at the right and bottom is cut.
    fn reduced(&self, factor: usize) -> Raster {
        let (width, height) = (self.size().0 / factor, self.size().1 / factor);
        let mut values = vec![0.0_f32; width * height];
        let scale = 1.0 / (factor * factor) as f32;
        let mut line = vec![0.0_f32; width * factor];
        for (y, row) in values.chunks_exact_mut(width.max(1)).enumerate() {
            for part in 0..factor {
                self.copy(y * factor + part, 0, &mut line);
                dispatch!(Level::new(), _level => match factor {
                    2 => add_blocks::<2>(&line, scale, row),
                    4 => add_blocks::<4>(&line, scale, row),
                    _ => line.chunks_exact(factor).zip(&mut *row).for_each(|(block, sum)| {
                        *sum += block.iter().sum::<f32>() * scale;
                    }),
                });
            }
        }
        Raster { width, height, values }
    }

    /// Convolved with a Gaussian, given by one half of its kernel (centre first); the border is repeated.
    fn smoothed(&self, half_kernel: &[f32]) -> Raster
    where
        Self: Sized,
    {
        let (width, height) = self.size();
        let mut values = vec![0.0_f32; width * height];
        dispatch!(Level::new(), _level => smooth(self, half_kernel, &mut values));
        Raster { width, height, values }
    }
}

/// The picture that a target is looked for in, where the frame lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Image<'a> {
    pub width: usize,
    pub height: usize,
    pixels: Pixels<'a>,
}

impl<'a> Image<'a> {
    /// Takes a frame, if it has a size in which targets are looked for.
    pub fn of_frame(frame: &FrameView<'a>) -> Result<Self, TargetError> {
        let (width, height) = (frame.width_px as usize, frame.height_px as usize);
        let sides = 16..=65_535;
        let values = frame.pixels.len();
        if !sides.contains(&width)
            || !sides.contains(&height)
            || width * height > MAX_PIXELS
            || values != width * height
        {
            return Err(TargetError::Size { width_px: frame.width_px, height_px: frame.height_px, values });
        }
        Ok(Self { width, height, pixels: frame.pixels })
    }
}

impl Grey for Image<'_> {
    fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn get(&self, x: usize, y: usize) -> f32 {
        self.pixels.get(y * self.width + x)
    }

    #[inline(always)]
    fn copy(&self, y: usize, from: usize, out: &mut [f32]) {
        let place = y * self.width + from..y * self.width + from + out.len();
        match self.pixels {
            Pixels::Mono8(values) => widen(&values[place], out),
            Pixels::Mono16(values) => widen(&values[place], out),
        }
    }
}

#[inline(always)]
fn widen<T: Copy + Into<f32>>(values: &[T], out: &mut [f32]) {
    for (out, value) in out.iter_mut().zip(values) {
        *out = (*value).into();
    }
}

/// Grey values that were computed, row by row.
#[derive(Debug, Clone)]
pub(crate) struct Raster {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Grey for Raster {
    fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn get(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    #[inline(always)]
    fn copy(&self, y: usize, from: usize, out: &mut [f32]) {
        out.copy_from_slice(&self.values[y * self.width + from..][..out.len()]);
    }
}

/// Adds the sums of blocks of N values, times a scale.
#[inline(always)]
fn add_blocks<const N: usize>(line: &[f32], scale: f32, sums: &mut [f32]) {
    for (sum, block) in sums.iter_mut().zip(line.as_chunks::<N>().0) {
        *sum += block.iter().sum::<f32>() * scale;
    }
}

/// Rows are smoothed along themselves as they are needed; those in reach stay in the cache.
#[inline(always)]
fn smooth(grey: &impl Grey, half_kernel: &[f32], out: &mut [f32]) {
    let ((width, height), reach) = (grey.size(), half_kernel.len() - 1);
    let ring = 2 * reach + 1;
    let mut along = vec![0.0_f32; ring * width];
    let mut padded = vec![0.0_f32; width + 2 * reach];
    let weight = |tap: usize| if tap == 0 { 0.5 * half_kernel[0] } else { half_kernel[tap] };
    let mut done = 0;
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        while done < (y + reach + 1).min(height) {
            grey.copy(done, 0, &mut padded[reach..reach + width]);
            let (first, last) = (padded[reach], padded[reach + width - 1]);
            padded[..reach].fill(first);
            padded[reach + width..].fill(last);
            let taps: Vec<Tap> = (0..=reach)
                .map(|tap| (weight(tap), &padded[reach - tap..], &padded[reach + tap..]))
                .collect();
            weigh(&taps, &mut along[done % ring * width..][..width]);
            done += 1;
        }
        let row = |line: usize| &along[line % ring * width..][..width];
        let taps: Vec<Tap> = (0..=reach)
            .map(|tap| (weight(tap), row(y.saturating_sub(tap)), row((y + tap).min(height - 1))))
            .collect();
        weigh(&taps, out);
    }
}

/// A weight, and two rows that it counts for.
type Tap<'a> = (f32, &'a [f32], &'a [f32]);

/// Pixels that are summed side by side.
const TOGETHER: usize = 32;

/// Weighted sums of the rows.
#[inline(always)]
fn weigh(taps: &[Tap], out: &mut [f32]) {
    let (blocks, rest) = out.as_chunks_mut::<TOGETHER>();
    let beyond = blocks.len() * TOGETHER;
    for (block, out) in blocks.iter_mut().enumerate() {
        let mut sums = [0.0; TOGETHER];
        for (weight, low, high) in taps {
            let (low, high) = (&low[block * TOGETHER..][..TOGETHER], &high[block * TOGETHER..][..TOGETHER]);
            for k in 0..TOGETHER {
                sums[k] += weight * (low[k] + high[k]);
            }
        }
        *out = sums;
    }
    for (k, out) in rest.iter_mut().enumerate() {
        *out = taps
            .iter()
            .fold(0.0, |sum, (weight, low, high)| sum + weight * (low[beyond + k] + high[beyond + k]));
    }
}

/// One half of a Gaussian kernel of the given sigma, centre first, summing to 1 over both halves.
pub(crate) fn half_gaussian(sigma_px: f64) -> Vec<f32> {
    let reach = (3.0 * sigma_px).ceil() as usize;
    let weights: Vec<f64> = (0..=reach)
        .map(|i| {
            let t = i as f64 / sigma_px;
            fringe::math::exp(-0.5 * t * t)
        })
        .collect();
    let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    weights.iter().map(|w| (w / sum) as f32).collect()
}
