//! The frames of a sequence as they came: a frame is copied when it lands and read again when the block it belongs to is decoded.

use crate::frame::Pixels;
use rayon::prelude::*;
use std::ops::Range;

/// Pixels of one parallel copy; fixed, so that the work is cut the same way on every machine.
const CHUNK: usize = 1 << 18;

/// So many pixels tell which of two frames is the darker one.
const ASKED: usize = 1 << 14;

/// Frames that are kept as they came. The full scale decides how wide a value is stored.
#[derive(Debug, Clone)]
pub enum Rasters {
    /// Full scale up to 255.
    Bytes(Vec<u8>),
    /// Full scale above 255.
    Words(Vec<u16>),
}

impl Rasters {
    /// Allocates memory for `count` frames.
    pub fn new(count: usize, pixels: usize, full_scale_dn: u16) -> Self {
        if full_scale_dn <= 255 {
            Self::Bytes(vec![0; count * pixels])
        } else {
            Self::Words(vec![0; count * pixels])
        }
    }

    /// Whether one frame is darker than another at most of the valid pixels. Every 16th pixel is asked, fewer of a large image.
    pub fn mostly_below(&self, one: usize, other: usize, valid: &[u8]) -> bool {
        let (mut below, mut asked) = (0_usize, 0_usize);
        // Odd, so that the pixels do not stand in columns.
        let every = (valid.len() / ASKED).max(16) | 1;
        for index in (0..valid.len()).step_by(every).filter(|index| valid[*index] == 1) {
            let (a, b) = self.pair(one, other, valid.len(), index);
            below += usize::from(a < b);
            asked += 1;
        }
        2 * below > asked
    }

    /// Grey value of one pixel in a kept frame.
    #[inline]
    pub fn value(&self, one: usize, pixels: usize, index: usize) -> u16 {
        match self {
            Self::Bytes(kept) => kept[one * pixels + index].into(),
            Self::Words(kept) => kept[one * pixels + index],
        }
    }

    /// Grey values of one pixel in two kept frames.
    #[inline]
    pub fn pair(&self, one: usize, other: usize, pixels: usize, index: usize) -> (u16, u16) {
        (self.value(one, pixels, index), self.value(other, pixels, index))
    }

    /// Whether two kept frames show the same, and something.
    pub fn show_the_same(&self, one: usize, other: usize, pixels: usize) -> bool {
        fn same<T: PartialEq>(one: &[T], other: &[T]) -> bool {
            one == other && one.iter().any(|value| *value != one[0])
        }
        let [one, other] = [one, other].map(|number| number * pixels..(number + 1) * pixels);
        match self {
            Self::Bytes(kept) => same(&kept[one], &kept[other]),
            Self::Words(kept) => same(&kept[one], &kept[other]),
        }
    }

    /// Grey values of a kept frame.
    pub fn taken(&self, one: usize, pixels: usize) -> Vec<u16> {
        (0..pixels).map(|index| self.value(one, pixels, index)).collect()
    }

    /// Writes a kept frame anew, up to the largest value that is stored.
    pub fn put(&mut self, one: usize, pixels: usize, value: impl Fn(usize) -> u16) {
        let range = one * pixels..(one + 1) * pixels;
        match self {
            Self::Bytes(kept) => {
                kept[range].iter_mut().enumerate().for_each(|(i, kept)| *kept = value(i).min(255) as u8);
            }
            Self::Words(kept) => kept[range].iter_mut().enumerate().for_each(|(i, kept)| *kept = value(i)),
        }
    }

    /// Copies a frame whose values do not exceed full scale.
    pub fn keep(&mut self, index: usize, pixels: Pixels) {
        let range = index * pixels.len()..(index + 1) * pixels.len();
        match (self, pixels) {
            (Self::Bytes(kept), Pixels::Mono8(values)) => copy(&mut kept[range], values, |value| value),
            (Self::Words(kept), Pixels::Mono16(values)) => copy(&mut kept[range], values, |value| value),
            (Self::Bytes(kept), Pixels::Mono16(values)) => {
                copy(&mut kept[range], values, |value| value as u8);
            }
            (Self::Words(kept), Pixels::Mono8(values)) => copy(&mut kept[range], values, u16::from),
        }
    }
}

fn copy<T: Copy + Sync, U: Send>(kept: &mut [U], values: &[T], convert: impl Fn(T) -> U + Sync) {
    kept.par_chunks_mut(CHUNK).zip(values.par_chunks(CHUNK)).for_each(|(kept, values)| {
        kept.iter_mut().zip(values).for_each(|(kept, value)| *kept = convert(*value));
    });
}

/// A part of all kept frames of one width.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a, T> {
    /// All kept frames, one after another.
    pub data: &'a [T],
    /// Pixels of a frame.
    pub pixels: usize,
    /// First pixel of the part.
    pub start: usize,
    /// One after its last pixel.
    pub end: usize,
}

impl<'a, T> Part<'a, T> {
    /// The pixels of a range.
    #[inline(always)]
    pub fn new(data: &'a [T], pixels: usize, range: &Range<usize>) -> Self {
        Self { data, pixels, start: range.start, end: range.end }
    }

    /// The part of one frame.
    #[inline(always)]
    pub fn raster(&self, index: usize) -> &'a [T] {
        &self.data[index * self.pixels + self.start..index * self.pixels + self.end]
    }
}
