//! The drawing surface of a cloud: a depth buffer, sums over the points in front, and shaded steps.
//!
//! Steps in depth are darkened after T. Boucheny's eye-dome lighting (2009), which makes shape visible also where
//! points carry colours that shading must not change.

use fringe::math::exp;

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

    /// Index of a pixel; `None` outside.
    fn index(&self, column: i64, row: i64) -> Option<usize> {
        let (width, height) = (self.raster.width as i64, self.raster.height as i64);
        let inside = (0..width).contains(&column) && (0..height).contains(&row);
        inside.then_some((row * width + column) as usize)
    }

    /// First pass: the foremost surface.
    pub fn put_depth(&mut self, x: f64, y: f64, depth_mm: f64, disc: &[(i64, i64)]) {
        for (dx, dy) in disc {
            if let Some(place) = self.index(x as i64 + dx, y as i64 + dy) {
                self.depth_mm[place] = self.depth_mm[place].max(depth_mm);
            }
        }
    }

    /// Second pass: what lies on it.
    pub fn put_colour(
        &mut self,
        x: f64,
        y: f64,
        depth_mm: f64,
        disc: &[(i64, i64)],
        colour: Rgb,
        deviation: Option<f32>,
    ) {
        for (dx, dy) in disc {
            let Some(place) = self.index(x as i64 + dx, y as i64 + dy) else {
                continue;
            };
            if depth_mm >= self.depth_mm[place] - self.thickness_mm {
                self.sums[place].add(colour, deviation);
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
        const REACH: i64 = 3;
        const AROUND: [(i64, i64); 8] =
            [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
        let (width, height) = (self.raster.width as i64, self.raster.height as i64);
        let run_mm = mm_per_px * REACH as f64;
        // A slope of 2 is still a surface; where colours are values only real steps may be darkened.
        let surface = if matches!(colouring, Colouring::Deviation { .. }) { 8.0 } else { 2.0 };
        for row in 0..height {
            for column in 0..width {
                let own = self.depth_mm[(row * width + column) as usize];
                if own == f64::NEG_INFINITY {
                    continue;
                }
                let mut occlusion = 0.0;
                for (dx, dy) in AROUND {
                    let (x, y) = (column + dx * REACH, row + dy * REACH);
                    if (0..width).contains(&x) && (0..height).contains(&y) {
                        let other = self.depth_mm[(y * width + x) as usize];
                        occlusion += ((other - own) / run_mm - surface).clamp(0.0, 4.0);
                    }
                }
                let level = exp(-0.06 * occlusion);
                let pixel = &mut self.raster.pixels[(row * width + column) as usize];
                *pixel = pixel.map(|c| (f64::from(c) * level + 0.5) as u8);
            }
        }
    }
}
