//! A frame as a person who sets a camera up wants to see it: what is clipped in red, what sees no light in blue, the modulation of the rest in
//! colours, and its histogram.

use crate::colour::{ColourMap, Rgb};
use crate::picture::PictureError;
use crate::raster::Raster;
use characterise::exposure::PixelLight;
use fringe::frame::FrameView;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use std::fmt::Write as _;

const CLIPPED: Rgb = [255, 40, 40];
const UNLIT: Rgb = [40, 70, 200];
/// The part of the sequential map that modulation is drawn in: teal, green, yellow, none of which is the blue of pixels without light.
const WEAK_PLACE: f64 = 0.45;
/// The most that a modulation can be, over the full scale.
const MOST_MODULATION: f32 = 0.5;
/// Quality of the pictures of a stream, of 100.
const QUALITY: u8 = 80;
/// Bars of the histogram.
pub const BARS: usize = 64;

/// A frame in grey, with marks in colour.
#[derive(Debug, Clone)]
pub struct LivePicture {
    raster: Raster,
}

impl LivePicture {
    /// The picture of a frame. `seen`: what each pixel sees over the whole sequence, row by row; empty: the frame alone is drawn, grey. Pixels from
    /// `clipped_dn` on are red.
    ///
    /// # Errors
    /// A frame without pixels, or too large for a picture.
    pub fn new(frame: &FrameView<'_>, clipped_dn: f32, seen: &[PixelLight]) -> Result<Self, PictureError> {
        let (width, height) = (frame.width_px as usize, frame.height_px as usize);
        let mut raster = Raster::new(width, height, [0; 3])?;
        let scale = 255.0 / f32::from(frame.full_scale_dn.max(1));
        for (place, pixel) in raster.pixels.iter_mut().enumerate() {
            let value = frame.pixels.get(place);
            let grey = (value * scale).round().min(255.0) as u8;
            *pixel = match seen.get(place) {
                _ if value >= clipped_dn => CLIPPED,
                Some(PixelLight::Clipped) => CLIPPED,
                Some(PixelLight::Unlit) => UNLIT,
                Some(PixelLight::Lit(modulation)) => of_modulation(*modulation),
                None => [grey; 3],
            };
        }
        Ok(Self { raster })
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// The encoder's.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        self.raster.to_png()
    }

    /// The picture as JPEG, no wider than so many columns.
    ///
    /// # Errors
    /// The encoder's.
    pub fn to_jpeg(&self, columns: usize) -> Result<Vec<u8>, PictureError> {
        let reduced = self.raster.reduced(self.raster.width.div_ceil(columns.max(1)).max(1))?;
        let mut jpeg = Vec::new();
        let (width, height) = (reduced.width as u32, reduced.height as u32);
        JpegEncoder::new_with_quality(&mut jpeg, QUALITY)
            .write_image(reduced.pixels.as_flattened(), width, height, ExtendedColorType::Rgb8)
            .map_err(PictureError::from)?;
        Ok(jpeg)
    }

    /// The picture in a terminal of so many columns and rows: two pixels a character, one above the other, in 24-bit colours.
    ///
    /// # Errors
    /// A terminal without room.
    pub fn half_blocks(&self, columns: usize, rows: usize) -> Result<String, PictureError> {
        let Raster { width, height, .. } = self.raster;
        let factor = width.div_ceil(columns.max(1)).max(height.div_ceil(2 * rows.max(1))).max(1);
        let small = self.raster.reduced(factor.min(width).min(height))?;
        let mut text = String::new();
        for pair in small.pixels.chunks(2 * small.width) {
            let (above, below) = pair.split_at(small.width.min(pair.len()));
            for (column, [r, g, b]) in above.iter().enumerate() {
                let [lr, lg, lb] = below.get(column).copied().unwrap_or([0; 3]);
                let _ = write!(text, "\x1b[38;2;{r};{g};{b}m\x1b[48;2;{lr};{lg};{lb}m\u{2580}");
            }
            text.push_str("\x1b[0m\n");
        }
        Ok(text)
    }
}

/// Teal for a modulation of nothing, yellow for the most that there can be.
fn of_modulation(modulation: f32) -> Rgb {
    let share = f64::from(modulation / MOST_MODULATION).clamp(0.0, 1.0);
    ColourMap::Sequential.colour(WEAK_PLACE + (1.0 - WEAK_PLACE) * share)
}

/// Pixels of a frame by grey value, dark to full scale.
pub fn histogram(frame: &FrameView<'_>) -> [u32; BARS] {
    let mut bars = [0; BARS];
    let scale = BARS as f32 / (f32::from(frame.full_scale_dn) + 1.0);
    for place in 0..frame.pixels.len() {
        bars[((frame.pixels.get(place) * scale) as usize).min(BARS - 1)] += 1;
    }
    bars
}

/// A histogram in one line of text; the height of a bar is the logarithm of its count.
pub fn histogram_line(bars: &[u32]) -> String {
    const BLOCKS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let height = |count: u32| f64::from(count + 1).log2();
    let most = bars.iter().copied().map(height).fold(1.0, f64::max);
    bars.iter().map(|count| BLOCKS[(height(*count) / most * 8.0).round() as usize]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(values: &[u8]) -> FrameView<'_> {
        FrameView::from_bytes(4, 2, 255, values).unwrap()
    }

    #[test]
    fn clipped_pixels_are_red_unlit_ones_blue_and_the_others_show_their_modulation() {
        let values = [0, 50, 100, 255, 252, 253, 10, 20];
        let plain = LivePicture::new(&frame(&values), 252.45, &[]).unwrap();
        assert_eq!(plain.raster.pixels[..4], [[0; 3], [50; 3], [100; 3], CLIPPED]);
        assert_eq!(plain.raster.pixels[4..6], [[252; 3], CLIPPED]);
        let (weak, strong) = (PixelLight::Lit(0.05), PixelLight::Lit(0.5));
        let seen = [PixelLight::Unlit, weak, strong, weak, strong, strong, PixelLight::Clipped, weak];
        let picture = LivePicture::new(&frame(&values), 252.45, &seen).unwrap();
        let yellow = ColourMap::Sequential.colour(1.0);
        assert_eq!(picture.raster.pixels[..4], [UNLIT, of_modulation(0.05), yellow, CLIPPED]);
        assert_eq!(picture.raster.pixels[4..], [yellow, CLIPPED, CLIPPED, of_modulation(0.05)]);
        // Brighter from weak to strong, and far from the blue of darkness.
        let light = |[r, g, b]: Rgb| u32::from(r) + u32::from(g) + u32::from(b);
        assert!(light(of_modulation(0.05)) + 60 < light(yellow));
        let apart: u32 = of_modulation(0.0).iter().zip(UNLIT).map(|(a, b)| u32::from(a.abs_diff(b))).sum();
        assert!(apart > 80, "{apart}");
        let back = image::load_from_memory(&picture.to_png().unwrap()).unwrap().to_rgb8();
        assert_eq!(back.as_raw(), picture.raster.pixels.as_flattened());
        let jpeg = image::load_from_memory(&picture.to_jpeg(2).unwrap()).unwrap();
        assert_eq!((jpeg.width(), jpeg.height()), (2, 1));
    }

    #[test]
    fn half_blocks_fit_the_terminal() {
        let picture = LivePicture::new(&frame(&[128; 8]), 255.0, &[]).unwrap();
        for (columns, rows, lines) in [(4, 1, 1), (80, 24, 1), (2, 1, 1), (1, 1, 1), (0, 0, 1)] {
            let text = picture.half_blocks(columns, rows).unwrap();
            assert_eq!(text.lines().count(), lines, "{columns} × {rows}");
            assert!(text.matches('▀').count() <= columns.max(1) * rows.max(1) * 2);
        }
    }

    #[test]
    fn a_histogram_counts_every_pixel_once() {
        let bars = histogram(&frame(&[0, 3, 4, 255, 255, 128, 7, 8]));
        assert_eq!(bars.iter().sum::<u32>(), 8);
        assert_eq!((bars[0], bars[1], bars[2], bars[32], bars[63]), (2, 2, 1, 1, 2));
        let line = histogram_line(&bars);
        assert!(line.starts_with('█') && line.chars().count() == BARS);
        assert_eq!(histogram_line(&[0; 3]).chars().count(), 3);
    }
}
