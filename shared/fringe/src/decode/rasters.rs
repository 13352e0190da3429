//! The frames of a sequence as they came: a frame that is lent stays where it is, any other is copied when it lands, and both are read again when the block
//! they belong to is decoded.

use crate::frame::{Pixels, SharedPixels};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Pixels of one parallel copy; fixed, so that the work is cut the same way on every machine.
const CHUNK: usize = 1 << 18;

/// So many pixels tell which of two frames is the darker one.
const ASKED: usize = 1 << 14;

/// Frames that are kept as they came. The full scale decides how wide a value is stored.
#[derive(Debug, Clone)]
pub enum Rasters {
    /// Full scale up to 255.
    Bytes(Kept<u8>),
    /// Full scale above 255.
    Words(Kept<u16>),
}

/// The frames of one width. Who else holds one of them never sees it change: it is written to a copy.
#[derive(Debug, Clone)]
pub struct Kept<T>(Vec<Arc<Vec<T>>>);

impl<T> Kept<T> {
    /// Grey values of a frame.
    #[inline(always)]
    pub fn raster(&self, index: usize) -> &[T] {
        &self.0[index]
    }
}

impl<T: Copy + Default + Send> Kept<T> {
    fn new(count: usize, pixels: usize) -> Self {
        Self((0..count).map(|_| Arc::new(vec![T::default(); pixels])).collect())
    }

    fn copy<U: Copy + Sync>(&mut self, index: usize, values: &[U], convert: impl Fn(U) -> T + Sync) {
        // Of a frame that was lent, nothing is needed any more.
        let kept = &mut self.0[index];
        if Arc::get_mut(kept).is_none_or(|own| own.len() != values.len()) {
            *kept = Arc::new(vec![T::default(); values.len()]);
        }
        let own = Arc::make_mut(kept);
        own.par_chunks_mut(CHUNK).zip(values.par_chunks(CHUNK)).for_each(|(kept, values)| {
            kept.iter_mut().zip(values).for_each(|(kept, value)| *kept = convert(*value));
        });
    }

    fn write(&mut self, index: usize, value: impl Fn(usize) -> T) {
        let own = Arc::make_mut(&mut self.0[index]);
        own.iter_mut().enumerate().for_each(|(i, kept)| *kept = value(i));
    }
}

impl Rasters {
    /// Allocates memory for `count` frames.
    pub fn new(count: usize, pixels: usize, full_scale_dn: u16) -> Self {
        if full_scale_dn <= 255 {
            Self::Bytes(Kept::new(count, pixels))
        } else {
            Self::Words(Kept::new(count, pixels))
        }
    }

    /// Whether one frame is darker than another at most of the valid pixels. Every 16th pixel is asked, fewer of a large image.
    pub fn mostly_below(&self, one: usize, other: usize, valid: &[u8]) -> bool {
        let (mut below, mut asked) = (0_usize, 0_usize);
        // Odd, so that the pixels do not stand in columns.
        let every = (valid.len() / ASKED).max(16) | 1;
        for index in (0..valid.len()).step_by(every).filter(|index| valid[*index] == 1) {
            let (a, b) = self.pair(one, other, index);
            below += usize::from(a < b);
            asked += 1;
        }
        2 * below > asked
    }

    /// Grey value of one pixel in a kept frame.
    #[inline]
    pub fn value(&self, one: usize, index: usize) -> u16 {
        match self {
            Self::Bytes(kept) => kept.raster(one)[index].into(),
            Self::Words(kept) => kept.raster(one)[index],
        }
    }

    /// Grey values of one pixel in two kept frames.
    #[inline]
    pub fn pair(&self, one: usize, other: usize, index: usize) -> (u16, u16) {
        (self.value(one, index), self.value(other, index))
    }

    /// Whether two kept frames show the same, and something.
    pub fn show_the_same(&self, one: usize, other: usize) -> bool {
        fn same<T: PartialEq>(one: &[T], other: &[T]) -> bool {
            one == other && one.iter().any(|value| *value != one[0])
        }
        match self {
            Self::Bytes(kept) => same(kept.raster(one), kept.raster(other)),
            Self::Words(kept) => same(kept.raster(one), kept.raster(other)),
        }
    }

    /// Grey values of a kept frame.
    pub fn taken(&self, one: usize) -> Vec<u16> {
        match self {
            Self::Bytes(kept) => kept.raster(one).iter().map(|value| u16::from(*value)).collect(),
            Self::Words(kept) => kept.raster(one).to_vec(),
        }
    }

    /// Writes a kept frame anew, up to the largest value that is stored.
    pub fn put(&mut self, one: usize, value: impl Fn(usize) -> u16) {
        match self {
            Self::Bytes(kept) => kept.write(one, |i| value(i).min(255) as u8),
            Self::Words(kept) => kept.write(one, value),
        }
    }

    /// Copies a frame whose values do not exceed full scale.
    pub fn keep(&mut self, index: usize, pixels: Pixels) {
        match (self, pixels) {
            (Self::Bytes(kept), Pixels::Mono8(values)) => kept.copy(index, values, |value| value),
            (Self::Words(kept), Pixels::Mono16(values)) => kept.copy(index, values, |value| value),
            (Self::Bytes(kept), Pixels::Mono16(values)) => kept.copy(index, values, |value| value as u8),
            (Self::Words(kept), Pixels::Mono8(values)) => kept.copy(index, values, u16::from),
        }
    }

    /// Holds a frame whose values do not exceed full scale where it is; copies one of the other width.
    pub fn hold(&mut self, index: usize, pixels: &SharedPixels) {
        match (self, pixels) {
            (Self::Bytes(kept), SharedPixels::Mono8(values)) => kept.0[index] = Arc::clone(values),
            (Self::Words(kept), SharedPixels::Mono16(values)) => kept.0[index] = Arc::clone(values),
            (kept, pixels) => kept.keep(index, pixels.view()),
        }
    }
}

/// A part of all kept frames of one width.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a, T> {
    /// The frames that are kept.
    pub kept: &'a Kept<T>,
    /// First pixel of the part.
    pub start: usize,
    /// One after its last pixel.
    pub end: usize,
}

impl<'a, T> Part<'a, T> {
    /// The pixels of a range.
    #[inline(always)]
    pub fn new(kept: &'a Kept<T>, range: &Range<usize>) -> Self {
        Self { kept, start: range.start, end: range.end }
    }

    /// The part of one frame.
    #[inline(always)]
    pub fn raster(&self, index: usize) -> &'a [T] {
        &self.kept.raster(index)[self.start..self.end]
    }
}
