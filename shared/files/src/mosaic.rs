//! Raw pictures of a camera whose pixels stand behind a mosaic of colour filters (Bayer).
//!
//! A decoder looks at one pixel at a time: what its filter does is the same in all frames, so the raw picture decodes as it is, with no value
//! from a neighbour. Only where one colour is wanted, because the projector shows the steps in colours, the pixels of the others are
//! filled in: by the mean of the pixels of that colour among the eight neighbours.

use crate::image_channel::Channel;
use fringe::frame::{Frame, PixelBuffer};

/// Order of the filters: the first row's two, the second row's two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mosaic {
    /// Red and green over green and blue.
    Rggb,
    /// Blue and green over green and red.
    Bggr,
    /// Green and red over blue and green.
    Grbg,
    /// Green and blue over red and green.
    Gbrg,
}

impl Mosaic {
    /// Colour of a pixel's filter: red 0, green 1, blue 2.
    fn colour(self, column: usize, row: usize) -> usize {
        let filters = match self {
            Self::Rggb => [0, 1, 1, 2],
            Self::Bggr => [2, 1, 1, 0],
            Self::Grbg => [1, 0, 2, 1],
            Self::Gbrg => [1, 2, 0, 1],
        };
        filters[row % 2 * 2 + column % 2]
    }

    /// The frame of a channel: the raw picture for grey, else the colour with its gaps filled in.
    pub(crate) fn frame(self, raw: Frame, channel: Channel) -> Frame {
        let size = (raw.width_px as usize, raw.height_px as usize);
        let pixels = match raw.pixels {
            PixelBuffer::Mono8(values) => PixelBuffer::Mono8(self.plane(values, size, channel)),
            PixelBuffer::Mono16(values) => PixelBuffer::Mono16(self.plane(values, size, channel)),
        };
        Frame { pixels, ..raw }
    }

    fn plane<T: Copy + Default + Into<u32> + TryFrom<u32>>(
        self,
        values: Vec<T>,
        size: (usize, usize),
        channel: Channel,
    ) -> Vec<T> {
        let of = |weights: [u32; 3]| {
            let total: u32 = weights.iter().sum();
            let pixel = |at: usize| {
                let parts = [0, 1, 2].map(|colour| match weights[colour] {
                    0 => 0.0,
                    weight => f64::from(weight) * self.mean(&values, size, at, colour),
                });
                let value = (parts.iter().sum::<f64>() / f64::from(total)).round();
                // A mean of values of T is within their range.
                T::try_from(value as u32).unwrap_or_default()
            };
            (0..values.len()).map(pixel).collect()
        };
        match channel {
            Channel::Red => of([1, 0, 0]),
            Channel::Green => of([0, 1, 0]),
            Channel::Blue => of([0, 0, 1]),
            Channel::Luminance => of([299, 587, 114]),
            Channel::Grey => values,
        }
    }

    /// The pixel itself where it has the colour, else the mean of those neighbours that have it.
    fn mean<T: Copy + Into<u32>>(
        self,
        values: &[T],
        (width, height): (usize, usize),
        at: usize,
        colour: usize,
    ) -> f64 {
        let (column, row) = (at % width, at / width);
        if self.colour(column, row) == colour {
            return f64::from(values[at].into());
        }
        let (mut sum, mut count) = (0.0, 0.0);
        for y in row.saturating_sub(1)..(row + 2).min(height) {
            for x in column.saturating_sub(1)..(column + 2).min(width) {
                if self.colour(x, y) == colour {
                    sum += f64::from(values[y * width + x].into());
                    count += 1.0;
                }
            }
        }
        // A picture of one row or column has not all colours.
        if count > 0.0 { sum / count } else { f64::from(values[at].into()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raw(mosaic: Mosaic, levels: [u8; 3]) -> Frame {
        let value = |at: usize| levels[mosaic.colour(at % 6, at / 6)];
        let pixels = PixelBuffer::Mono8((0..24).map(value).collect());
        Frame { width_px: 6, height_px: 4, full_scale_dn: 255, pixels }
    }

    #[test]
    fn each_colour_of_an_even_picture_comes_back_and_grey_is_the_raw_picture() {
        for mosaic in [Mosaic::Rggb, Mosaic::Bggr, Mosaic::Grbg, Mosaic::Gbrg] {
            let picture = raw(mosaic, [10, 60, 200]);
            for (channel, level) in
                [(Channel::Red, 10), (Channel::Green, 60), (Channel::Blue, 200), (Channel::Luminance, 61)]
            {
                let frame = mosaic.frame(picture.clone(), channel);
                assert_eq!(frame.pixels, PixelBuffer::Mono8(vec![level; 24]), "{mosaic:?} {channel:?}");
            }
            assert_eq!(mosaic.frame(picture.clone(), Channel::Grey), picture);
        }
    }

    #[test]
    fn the_corner_of_each_order_has_the_colour_of_its_name() {
        for (mosaic, first) in [(Mosaic::Rggb, 0), (Mosaic::Bggr, 2), (Mosaic::Grbg, 1), (Mosaic::Gbrg, 1)] {
            assert_eq!(mosaic.colour(0, 0), first);
        }
        assert_eq!((Mosaic::Grbg.colour(1, 0), Mosaic::Gbrg.colour(1, 0)), (0, 2));
    }
}
