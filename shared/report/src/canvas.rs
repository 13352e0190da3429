//! The drawing surface of a cloud: a depth buffer, sums over the points in front, and shaded steps.
//!
//! A picture is drawn in bands of rows, each by itself: what one needs stays in the cache, and bands are shared among the threads.
//!
//! Steps in depth are darkened after T. Boucheny's eye-dome lighting (2009), which makes shape visible also where
//! points carry colours that shading must not change.

use fringe::math::exp;
use rayon::prelude::*;
use std::ops::Range;

use super::colour::{ColourMap, Colouring, Rgb, WHITE};
use super::raster::{PictureError, Raster};

/// Rows of a band: its sums fit a second cache.
const BAND: usize = 32;

/// Steps in depth are looked for between pixels so far apart.
const REACH: usize = 3;

/// A point in the picture.
#[derive(Debug, Clone, Copy)]
pub struct Dot {
    /// Column and row of its pixel.
    pub pixel: (u32, u32),
    /// Depth towards the eye, mm.
    pub depth_mm: f64,
    /// Its colour after shading.
    pub colour: Rgb,
    /// Its deviation, mm; NaN where it has none.
    pub deviation_mm: f32,
}

/// A row of a disc.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    /// Rows below the centre of the disc.
    pub row: i64,
    /// Columns to each side of the centre.
    pub reach: i64,
}

/// What is drawn, and how.
///
/// First the depth of the foremost surface, mm towards the eye; then the mean over all points of that surface. The
/// foremost point alone would be the one whose noise points towards the eye, and a deviation map would show that
/// choice instead of the part.
pub struct Canvas<'a> {
    /// Number of columns, px.
    pub width: usize,
    /// Number of rows, px.
    pub height: usize,
    /// Each point is drawn as this disc.
    pub disc: &'a [Span],
    /// Points so much behind the foremost one still belong to its surface.
    pub thickness_mm: f64,
    /// Size of a pixel, mm.
    pub mm_per_px: f64,
    /// What the colours mean.
    pub colouring: &'a Colouring<'a>,
}

/// What the points in front at one pixel add up to.
#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    colour: [f32; 3],
    points: f32,
    deviation_mm: f32,
    deviations: f32,
}

impl Sum {
    fn add(&mut self, dot: &Dot) {
        self.colour.iter_mut().zip(dot.colour).for_each(|(s, c)| *s += f32::from(c));
        self.points += 1.0;
        if !dot.deviation_mm.is_nan() {
            self.deviation_mm += dot.deviation_mm;
            self.deviations += 1.0;
        }
    }
}

/// Memory of a band, used for one after another.
#[derive(Default)]
struct Band {
    /// Of the rows of the band and [`REACH`] to each side, as far as they lie in the picture.
    depth_mm: Vec<f64>,
    sums: Vec<Sum>,
}

impl Canvas<'_> {
    /// Draws dots that lie within the picture; the same bytes on any number of threads.
    ///
    /// # Errors
    /// A size that no picture has.
    pub fn draw(&self, mut dots: Vec<Dot>) -> Result<Raster, PictureError> {
        let mut raster = Raster::new(self.width, self.height, WHITE)?;
        // Stable: dots of a row keep their order, and with it the sums their bits.
        dots.sort_by_key(|dot| dot.pixel.1);
        let bands = raster.pixels.par_chunks_mut(BAND * self.width).enumerate().with_max_len(1);
        bands.for_each_init(Band::default, |band, (number, pixels)| {
            let first = number * BAND;
            let rows = first..first + pixels.len() / self.width;
            self.band(band, &dots, rows, pixels);
        });
        Ok(raster)
    }

    /// Draws some rows; the dots are in the order of their rows.
    fn band(&self, band: &mut Band, dots: &[Dot], rows: Range<usize>, pixels: &mut [Rgb]) {
        let deep = rows.start.saturating_sub(REACH)..(rows.end + REACH).min(self.height);
        band.depth_mm.clear();
        band.depth_mm.resize(deep.len() * self.width, f64::NEG_INFINITY);
        band.sums.clear();
        band.sums.resize(rows.len() * self.width, Sum::default());
        let margin = self.disc.iter().map(|span| span.row).max().unwrap_or(0) as usize;
        let reaching = of_rows(dots, &(deep.start.saturating_sub(margin)..deep.end + margin));
        for dot in reaching {
            for span in self.disc {
                for foremost_mm in &mut band.depth_mm[self.pixels(dot, *span, &deep)] {
                    *foremost_mm = foremost_mm.max(dot.depth_mm);
                }
            }
        }
        let own = &band.depth_mm[(rows.start - deep.start) * self.width..][..band.sums.len()];
        for dot in reaching {
            for span in self.disc {
                let pixels = self.pixels(dot, *span, &rows);
                for (foremost_mm, sum) in own[pixels.clone()].iter().zip(&mut band.sums[pixels]) {
                    if dot.depth_mm >= foremost_mm - self.thickness_mm {
                        sum.add(dot);
                    }
                }
            }
        }
        self.resolve(&band.sums, pixels);
        self.darken_steps(&band.depth_mm, rows.start - deep.start, pixels);
    }

    /// Where a row of the disc about a dot lies in some rows of the picture; nowhere for a row outside.
    fn pixels(&self, dot: &Dot, span: Span, rows: &Range<usize>) -> Range<usize> {
        let (column, row) = (i64::from(dot.pixel.0), i64::from(dot.pixel.1) + span.row);
        if row < rows.start as i64 || row >= rows.end as i64 {
            return 0..0;
        }
        let first = (column - span.reach).max(0) as usize;
        let last = (column + span.reach).min(self.width as i64 - 1) as usize;
        let start = (row as usize - rows.start) * self.width;
        start + first..start + last + 1
    }

    /// The colours from the sums.
    fn resolve(&self, sums: &[Sum], pixels: &mut [Rgb]) {
        for (pixel, sum) in pixels.iter_mut().zip(sums).filter(|(_, s)| s.points > 0.0) {
            *pixel = match self.colouring {
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

    /// Darkens pixels that lie behind a steep step; `depth_mm` has so many rows more above.
    fn darken_steps(&self, depth_mm: &[f64], above: usize, pixels: &mut [Rgb]) {
        let run_mm = self.mm_per_px * REACH as f64;
        // A slope of 2 is still a surface; where colours are values only real steps may be darkened.
        let surface = if matches!(self.colouring, Colouring::Deviation { .. }) { 8.0 } else { 2.0 };
        let rows: Vec<&[f64]> = depth_mm.chunks_exact(self.width).collect();
        for (row, pixels) in (above..).zip(pixels.chunks_exact_mut(self.width)) {
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

/// The dots of some rows; all dots are in the order of their rows.
fn of_rows<'a>(dots: &'a [Dot], rows: &Range<usize>) -> &'a [Dot] {
    let before = |row: usize| dots.partition_point(|dot| (dot.pixel.1 as usize) < row);
    &dots[before(rows.start)..before(rows.end)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dots all over a picture of several bands, many of them at their borders, at depths that hide some of them.
    fn dots(width: u32, height: u32) -> Vec<Dot> {
        let dot = |i: u32| {
            let value = i.wrapping_mul(2_654_435_761) >> 8;
            Dot {
                pixel: (value % width, (value / width) % height),
                depth_mm: f64::from(i % 17),
                colour: [(i % 251) as u8, (i % 83) as u8, 200],
                deviation_mm: if i.is_multiple_of(5) { f32::NAN } else { (i % 7) as f32 * 1e-3 },
            }
        };
        (0..4000).map(dot).collect()
    }

    /// Proves: a picture in bands is the one that is drawn as a whole, discs and dark steps across the borders of bands included, on any
    /// number of threads.
    #[test]
    fn bands_leave_no_seam_on_any_number_of_threads() {
        let (width, height) = (90, 3 * BAND + 5);
        let disc: Vec<Span> =
            [(-2, 0), (-1, 2), (0, 2), (1, 2), (2, 0)].map(|(row, reach)| Span { row, reach }).to_vec();
        let dots = dots(width as u32, height as u32);
        let mut sorted = dots.clone();
        sorted.sort_by_key(|dot| dot.pixel.1);
        for colouring in [Colouring::Normal, Colouring::Deviation { values: &[], half_range_mm: 0.01 }] {
            let colouring = &colouring;
            let canvas = Canvas { width, height, disc: &disc, thickness_mm: 3.0, mm_per_px: 0.1, colouring };
            let mut whole = Raster::new(width, height, WHITE).unwrap();
            canvas.band(&mut Band::default(), &sorted, 0..height, &mut whole.pixels);
            assert!(whole.pixels.iter().any(|pixel| *pixel != WHITE));
            for threads in [1, 3] {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                assert_eq!(pool.install(|| canvas.draw(dots.clone())).unwrap(), whole, "{threads} threads");
            }
        }
    }
}
