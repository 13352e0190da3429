//! The drawing surface of a cloud: a depth buffer, sums over the points in front, and shaded steps.
//!
//! Steps in depth are darkened after T. Boucheny's eye-dome lighting (2009), which makes shape visible also where
//! points carry colours that shading must not change.

use fringe::math::exp;
use std::ops::Range;

use super::colour::{ColourMap, Colouring, Rgb, WHITE};
use super::raster::{PictureError, Raster};

/// What the points in front at one pixel add up to.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    colour: [f32; 3],
    points: f32,
    deviation_mm: f32,
    deviations: f32,
}

impl Sum {
    fn add(&mut self, colour: Rgb, deviation: Option<f32>) {
        self.colour.iter_mut().zip(colour).for_each(|(s, c)| *s += f32::from(c));
        self.points += 1.0;
        if let Some(deviation) = deviation {
            self.deviation_mm += deviation;
            self.deviations += 1.0;
        }
    }
}

/// A row of a disc.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// Rows below the centre of the disc.
    pub row: i64,
    /// Columns to each side of the centre.
    pub reach: i64,
}

/// A picture in the making.
///
/// First the depth of the foremost surface, mm towards the eye; then the mean over all points of that surface. The
/// foremost point alone would be the one whose noise points towards the eye, and a deviation map would show that
/// choice instead of the part.
pub struct Canvas {
    /// The image that is drawn.
    pub raster: Raster,
    depth_mm: Vec<f64>,
    sums: Vec<Sum>,
    /// Points so much behind the foremost one still belong to its surface.
    thickness_mm: f64,
}

impl Canvas {
    /// A white one.
    ///
    /// # Errors
    /// A size that no picture has.
    pub fn new(width: usize, height: usize, thickness_mm: f64) -> Result<Self, PictureError> {
        let raster = Raster::new(width, height, WHITE)?;
        let depth_mm = vec![f64::NEG_INFINITY; raster.pixels.len()];
        let sums = vec![Sum::default(); raster.pixels.len()];
        Ok(Self { raster, depth_mm, sums, thickness_mm })
    }

    /// Whether a pixel lies inside; a NaN does not.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        x >= 0.0 && y >= 0.0 && x < self.raster.width as f64 && y < self.raster.height as f64
    }

    /// The pixels of one row of a disc about a pixel inside.
    fn pixels(&self, (x, y): (f64, f64), span: Span) -> Range<usize> {
        let (width, height) = (self.raster.width as i64, self.raster.height as i64);
        let (column, row) = (x as i64, y as i64 + span.row);
        if !(0..height).contains(&row) {
            return 0..0;
        }
        let (first, last) = ((column - span.reach).max(0), (column + span.reach).min(width - 1));
        (row * width + first) as usize..(row * width + last + 1) as usize
    }

    /// First pass: the foremost surface.
    pub fn put_depth(&mut self, place: (f64, f64), depth_mm: f64, disc: &[Span]) {
        for span in disc {
            let pixels = self.pixels(place, *span);
            for foremost_mm in &mut self.depth_mm[pixels] {
                *foremost_mm = foremost_mm.max(depth_mm);
            }
        }
    }

    /// Second pass: what lies on it.
    pub fn put_colour(
        &mut self,
        place: (f64, f64),
        depth_mm: f64,
        disc: &[Span],
        colour: Rgb,
        deviation: Option<f32>,
    ) {
        for span in disc {
            let pixels = self.pixels(place, *span);
            for (foremost_mm, sum) in self.depth_mm[pixels.clone()].iter().zip(&mut self.sums[pixels]) {
                if depth_mm >= foremost_mm - self.thickness_mm {
                    sum.add(colour, deviation);
                }
            }
        }
    }

    /// The colours from the sums.
    pub fn resolve(&mut self, colouring: &Colouring<'_>) {
        for (pixel, sum) in self.raster.pixels.iter_mut().zip(&self.sums).filter(|(_, s)| s.points > 0.0) {
            *pixel = match colouring {
                Colouring::Deviation { half_range_mm, .. }
                    if sum.deviations > 0.0 && *half_range_mm > 0.0 =>
                {
                    let mean_mm = f64::from(sum.deviation_mm / sum.deviations);
                    ColourMap::Diverging.colour(0.5 + mean_mm / (2.0 * half_range_mm))
                }
                _ => sum.colour.map(|c| (c / sum.points + 0.5) as u8),
            };
        }
    }

    /// Darkens pixels that lie behind a steep step.
    pub fn darken_steps(&mut self, mm_per_px: f64, colouring: &Colouring<'_>) {
        const REACH: usize = 3;
        let width = self.raster.width;
        let run_mm = mm_per_px * REACH as f64;
        // A slope of 2 is still a surface; where colours are values only real steps may be darkened.
        let surface = if matches!(colouring, Colouring::Deviation { .. }) { 8.0 } else { 2.0 };
        let rows: Vec<&[f64]> = self.depth_mm.chunks_exact(width).collect();
        for (row, pixels) in self.raster.pixels.chunks_exact_mut(width).enumerate() {
            // Beyond the first row and column lies what has no number; a pixel beside itself is no step.
            let around = [row.wrapping_sub(REACH), row, row + REACH].map(|near| rows.get(near));
            for (column, (pixel, own)) in pixels.iter_mut().zip(rows[row]).enumerate() {
                if *own == f64::NEG_INFINITY {
                    continue;
                }
                let columns = [column.wrapping_sub(REACH), column, column + REACH];
                let mut occlusion = 0.0;
                for line in around.iter().flatten() {
                    for other in columns.iter().filter_map(|near| line.get(*near)) {
                        occlusion += ((other - own) / run_mm - surface).clamp(0.0, 4.0);
                    }
                }
                if occlusion > 0.0 {
                    let level = exp(-0.06 * occlusion);
                    *pixel = pixel.map(|c| (f64::from(c) * level + 0.5) as u8);
                }
            }
        }
    }
}
