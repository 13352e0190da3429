//! Patches of connected samples: stretches of rows, joined with those of the row above.
//!
//! What is joined is marked for all pixels first, side by side. A walk over the marks then sees eight pixels at once wherever a stretch goes on
//! below one of the row above; a union-find forest holds stretches, not pixels.

use super::joints::{ABOVE, BEFORE, THERE};
use std::ops::Range;

/// Pixels that are walked over at once.
pub(super) const STRIDE: usize = 8;

/// A number that no stretch has.
const NONE: usize = usize::MAX;

/// Neighbouring samples of a row on the same surface.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    /// First pixel, and one after the last.
    start: u32,
    end: u32,
    /// Another stretch of the patch, or itself; never a later one.
    parent: u32,
    /// Of a root: pixels of the patch.
    size: u32,
}

/// The stretches of an image and the patches that they form.
#[derive(Debug, Clone)]
pub(super) struct Patches {
    stretches: Vec<Stretch>,
}

impl Patches {
    /// Room for the stretches of an image; it is touched as far as there are any.
    pub fn new(pixels: usize) -> Self {
        Self { stretches: Vec::with_capacity(pixels) }
    }

    /// Finds the patches of an image from the marks of its pixels.
    pub fn connect(&mut self, width: usize, marks: &[u8]) {
        self.stretches.clear();
        let mut above = 0;
        for (row, marks) in marks.chunks(width).enumerate() {
            let own = self.stretches.len();
            self.row(row * width, marks, above..own);
            above = own;
        }
    }

    /// Adds the stretches of a row, whose first pixel is `first`, and unites them with those of the row above.
    fn row(&mut self, first: usize, marks: &[u8], above: Range<usize>) {
        let width = marks.len();
        let mut upper = above.start;
        let mut x = 0;
        while x < width {
            if eight(marks, x).is_some_and(|marks| marks == 0) {
                x += STRIDE;
                continue;
            }
            if marks[x] & THERE == 0 {
                x += 1;
                continue;
            }
            let own = self.stretches.len();
            let start = (first + x) as u32;
            self.stretches.push(Stretch { start, end: start, parent: own as u32, size: 0 });
            let (begin, mut united) = (x, NONE);
            loop {
                if marks[x] & ABOVE != 0 {
                    // There is a stretch above this pixel, since there is a sample.
                    while upper + 1 < above.end && self.stretches[upper].end as usize + width <= first + x {
                        upper += 1;
                    }
                    if united != upper {
                        self.unite(own, upper);
                        united = upper;
                    }
                }
                x += 1;
                // As long as the same two stretches lie one above the other there is nothing to see.
                let alike = if united == NONE { 0 } else { self.stretches[united].end as usize + width };
                while first + x + STRIDE <= alike
                    && eight(marks, x).is_some_and(|marks| marks & repeated(BEFORE) == repeated(BEFORE))
                {
                    x += STRIDE;
                }
                if x >= width || marks[x] & BEFORE == 0 {
                    break;
                }
            }
            self.stretches[own].end = (first + x) as u32;
            let root = self.root(own);
            self.stretches[root].size += (x - begin) as u32;
        }
    }

    /// Counts what is left of the patches in the place of their samples: things that stand at one pixel of a stretch each, in rising order.
    pub fn recount<T>(&mut self, left: &[T], pixel: impl Fn(&T) -> u32) {
        self.stretches.iter_mut().for_each(|stretch| stretch.size = 0);
        let mut rest = left;
        for own in 0..self.stretches.len() {
            let Stretch { start, end, .. } = self.stretches[own];
            let inside = |one: &T| pixel(one) < end;
            let most = &rest[..rest.len().min((end - start) as usize)];
            // Mostly all are left: then the last one is the only one that is read.
            let count =
                if most.last().is_some_and(inside) { most.len() } else { most.partition_point(inside) };
            rest = &rest[count..];
            let root = self.root(own);
            self.stretches[root].size += count as u32;
        }
    }

    /// The pixels of patches with fewer samples, stretch by stretch.
    pub fn smaller_than(&mut self, wanted: u32) -> impl Iterator<Item = Range<usize>> {
        (0..self.stretches.len()).filter_map(move |own| {
            let root = self.root(own);
            let Stretch { start, end, .. } = self.stretches[own];
            (self.stretches[root].size < wanted).then_some(start as usize..end as usize)
        })
    }

    fn unite(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            let (root, child) = (a.min(b), a.max(b));
            self.stretches[child].parent = root as u32;
            self.stretches[root].size += self.stretches[child].size;
        }
    }

    /// Root of a tree, halving the path on the way.
    fn root(&mut self, mut node: usize) -> usize {
        while self.stretches[node].parent as usize != node {
            let parent = self.stretches[node].parent as usize;
            let next = self.stretches[parent].parent;
            self.stretches[node].parent = next;
            node = next as usize;
        }
        node
    }
}

/// The marks of eight pixels, if there are so many.
#[inline(always)]
pub(super) fn eight(marks: &[u8], x: usize) -> Option<u64> {
    let marks = marks.get(x..x + STRIDE)?;
    let mut bytes = [0; STRIDE];
    bytes.copy_from_slice(marks);
    Some(u64::from_le_bytes(bytes))
}

/// A mark on each of eight pixels.
pub(super) const fn repeated(mark: u8) -> u64 {
    u64::from_le_bytes([mark; STRIDE])
}

#[cfg(test)]
mod tests {
    use super::super::Sample;
    use super::super::joints::Joints;
    use super::super::normals::Link;
    use super::super::raster::Raster;
    use super::*;
    use proptest::prelude::*;

    /// Patches pixel by pixel: flooding from each pixel that has no patch yet.
    fn flooded(width: usize, marks: &[u8]) -> Vec<usize> {
        let mut patch = vec![NONE; marks.len()];
        for seed in 0..marks.len() {
            if marks[seed] & THERE == 0 || patch[seed] != NONE {
                continue;
            }
            let mut open = vec![seed];
            patch[seed] = seed;
            while let Some(at) = open.pop() {
                let mut neighbours = Vec::new();
                if marks[at] & BEFORE != 0 {
                    neighbours.push(at - 1);
                }
                if marks[at] & ABOVE != 0 {
                    neighbours.push(at - width);
                }
                if at % width + 1 < width && marks[at + 1] & BEFORE != 0 {
                    neighbours.push(at + 1);
                }
                if at + width < marks.len() && marks[at + width] & ABOVE != 0 {
                    neighbours.push(at + width);
                }
                for next in neighbours.into_iter().filter(|next| patch[*next] == NONE).collect::<Vec<_>>() {
                    patch[next] = seed;
                    open.push(next);
                }
            }
        }
        patch
    }

    proptest! {
        /// The walk over stretches finds the patches of flooding, on pictures with holes and torn surfaces.
        #[test]
        fn stretches_form_the_patches_of_flooding(
            width in 1_usize..60,
            values in prop::collection::vec(0_u8..40, 60..1500),
            holes in 1_u8..20,
            wanted in 2_u32..40,
            gone in 0_u8..4,
        ) {
            // Mostly one surface, somewhere another one, somewhere nothing.
            let value = |v: &u8| if *v < holes { f64::NAN } else if *v > 37 { 2.0 } else { 1.0 };
            let rows = values.len() / width;
            let depths: Vec<f64> = values[..rows * width].iter().map(value).collect();
            let sample = |inverse_depth: &f64| Sample { inverse_depth: *inverse_depth, sigma: 0.0, ..Sample::NONE };
            let samples = Raster::from(&depths.iter().map(sample).collect::<Vec<_>>()[..]);
            let mut marks = vec![0; depths.len()];
            Joints { samples: &samples, width, link: Link { max_step: 0.1 }, wanted: 0 }.mark(0, &mut marks);
            let patch = flooded(width, &marks);
            let size = |p: usize| patch.iter().filter(|other| **other == p).count() as u32;
            let brute: Vec<usize> =
                (0..marks.len()).filter(|i| patch[*i] != NONE && size(patch[*i]) < wanted).collect();
            let mut patches = Patches::new(marks.len());
            patches.connect(width, &marks);
            let found: Vec<usize> = patches.smaller_than(wanted).flatten().collect();
            prop_assert_eq!(found, brute);
            // Of every patch, some pixels are left.
            let left: Vec<u32> = (0..marks.len()).filter(|i| patch[*i] != NONE && values[*i] % 3 != gone).map(|i| i as u32).collect();
            let size = |p: usize| left.iter().filter(|i| patch[**i as usize] == p).count() as u32;
            let brute: Vec<usize> =
                (0..marks.len()).filter(|i| patch[*i] != NONE && size(patch[*i]) < wanted).collect();
            patches.recount(&left, |pixel| *pixel);
            let found: Vec<usize> = patches.smaller_than(wanted).flatten().collect();
            prop_assert_eq!(found, brute);
        }
    }
}
