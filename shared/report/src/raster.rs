//! A colour picture in memory: a few drawing steps and the way to PNG.

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use thiserror::Error;

use super::colour::Rgb;

/// Most pixels a picture may have: 256 MB as RGB; larger sensors do not exist, larger sizes come from damaged headers.
const MAX_PIXELS: usize = 1 << 26;

/// Why a picture cannot be made.
#[derive(Debug, Error)]
pub enum PictureError {
    /// Size zero or too large.
    #[error(
        "image of {width_px} × {height_px} px: each side must be at least 1 and the area at most {MAX_PIXELS} px"
    )]
    Size {
        /// Number of columns, px.
        width_px: usize,
        /// Number of rows, px.
        height_px: usize,
    },
    /// A plane has not width × height values.
    #[error("{what} has {found} values, but {width_px} × {height_px} px need {expected}", expected = width_px * height_px)]
    Length {
        /// Name of the plane.
        what: &'static str,
        /// Number of columns, px.
        width_px: usize,
        /// Number of rows, px.
        height_px: usize,
        /// Number of values given.
        found: usize,
    },
    /// A deviation belongs to no point.
    #[error("a deviation is given for point {index}, but the cloud has {points} points (counted from 0)")]
    NoSuchPoint {
        /// Index that is out of range.
        index: u32,
        /// Points of the cloud.
        points: usize,
    },
    /// The PNG encoder failed.
    #[error("the image cannot be encoded as PNG")]
    Encode(#[from] image::ImageError),
}

/// Checks a size; gives the number of pixels.
///
/// # Errors
/// Zero or too large.
pub(crate) fn area(width_px: usize, height_px: usize) -> Result<usize, PictureError> {
    match width_px.checked_mul(height_px) {
        Some(pixels) if pixels > 0 && pixels <= MAX_PIXELS => Ok(pixels),
        _ => Err(PictureError::Size { width_px, height_px }),
    }
}

/// Checks that a plane fits its size.
///
/// # Errors
/// A size that no picture has, or another number of values.
pub(crate) fn check_plane(
    what: &'static str,
    width_px: usize,
    height_px: usize,
    found: usize,
) -> Result<(), PictureError> {
    if area(width_px, height_px)? == found {
        Ok(())
    } else {
        Err(PictureError::Length { what, width_px, height_px, found })
    }
}

/// Encodes 8-bit grey values as PNG.
///
/// # Errors
/// A size that does not fit.
pub(crate) fn grey_to_png(width_px: usize, height_px: usize, values: &[u8]) -> Result<Vec<u8>, PictureError> {
    check_plane("grey picture", width_px, height_px, values.len())?;
    encode(width_px, height_px, values, ExtendedColorType::L8)
}

fn encode(
    width: usize,
    height: usize,
    bytes: &[u8],
    kind: ExtendedColorType,
) -> Result<Vec<u8>, PictureError> {
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Fast, FilterType::Adaptive).write_image(
        bytes,
        width as u32,
        height as u32,
        kind,
    )?;
    Ok(png)
}

/// Colours, row by row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Raster {
    /// Number of columns, px.
    pub width: usize,
    /// Number of rows, px.
    pub height: usize,
    /// width × height colours.
    pub pixels: Vec<Rgb>,
}

impl Raster {
    /// A picture of one colour.
    ///
    /// # Errors
    /// A size that no picture has.
    pub fn new(width: usize, height: usize, colour: Rgb) -> Result<Self, PictureError> {
        Ok(Self { width, height, pixels: vec![colour; area(width, height)?] })
    }

    /// Sets a pixel; nothing happens outside.
    pub fn set(&mut self, x: usize, y: usize, colour: Rgb) {
        if x < self.width && y < self.height {
            self.pixels[y * self.width + x] = colour;
        }
    }

    /// Fills a rectangle; the part outside is cut off.
    pub fn fill(&mut self, x: usize, y: usize, width: usize, height: usize, colour: Rgb) {
        for row in y..y.saturating_add(height).min(self.height) {
            for column in x..x.saturating_add(width).min(self.width) {
                self.set(column, row, colour);
            }
        }
    }

    /// Copies another picture in, its top-left corner at (x, y).
    pub fn paste(&mut self, other: &Self, x: usize, y: usize) {
        for (row, line) in other.pixels.chunks_exact(other.width).enumerate() {
            for (column, colour) in line.iter().enumerate() {
                self.set(x + column, y + row, *colour);
            }
        }
    }

    /// The mean over blocks of `factor` × `factor` pixels; an incomplete last block is left out.
    ///
    /// # Errors
    /// A factor of zero or larger than the picture.
    pub fn reduced(&self, factor: usize) -> Result<Self, PictureError> {
        let (width, height) = (self.width.checked_div(factor), self.height.checked_div(factor));
        let mut small = Self::new(width.unwrap_or(0), height.unwrap_or(0), [0; 3])?;
        let count = (factor * factor) as u32;
        for y in 0..small.height {
            for x in 0..small.width {
                let mut sum = [0_u32; 3];
                for row in 0..factor {
                    let start = (y * factor + row) * self.width + x * factor;
                    for colour in &self.pixels[start..start + factor] {
                        sum.iter_mut().zip(colour).for_each(|(s, c)| *s += u32::from(*c));
                    }
                }
                small.pixels[y * small.width + x] = sum.map(|s| ((s + count / 2) / count) as u8);
            }
        }
        Ok(small)
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// The encoder's.
    pub fn to_png(&self) -> Result<Vec<u8>, PictureError> {
        encode(self.width, self.height, self.pixels.as_flattened(), ExtendedColorType::Rgb8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reduced_picture_has_the_block_means() {
        let mut raster = Raster::new(5, 2, [10, 20, 30]).unwrap();
        raster.set(0, 0, [14, 20, 30]);
        raster.set(4, 1, [255; 3]);
        let small = raster.reduced(2).unwrap();
        assert_eq!((small.width, small.height), (2, 1));
        assert_eq!(small.pixels, vec![[11, 20, 30], [10, 20, 30]]);
    }

    #[test]
    fn drawing_outside_is_cut_off() {
        let mut raster = Raster::new(2, 2, [0; 3]).unwrap();
        raster.fill(1, 1, 9, 9, [7; 3]);
        raster.set(5, 0, [9; 3]);
        assert_eq!(raster.pixels, vec![[0; 3], [0; 3], [0; 3], [7; 3]]);
    }

    #[test]
    fn a_png_gives_its_pixels_back() {
        let mut raster = Raster::new(3, 2, [200, 100, 50]).unwrap();
        raster.set(1, 1, [1, 2, 3]);
        let back = image::load_from_memory(&raster.to_png().unwrap()).unwrap().to_rgb8();
        assert_eq!(back.dimensions(), (3, 2));
        assert_eq!(back.as_raw(), raster.pixels.as_flattened());
    }

    #[test]
    fn impossible_sizes_are_refused() {
        assert!(matches!(Raster::new(0, 5, [0; 3]), Err(PictureError::Size { .. })));
        assert!(matches!(Raster::new(usize::MAX, 2, [0; 3]), Err(PictureError::Size { .. })));
        assert!(matches!(grey_to_png(3, 2, &[0; 5]), Err(PictureError::Length { found: 5, .. })));
        assert!(Raster::new(2, 2, [0; 3]).unwrap().reduced(0).is_err());
    }
}
