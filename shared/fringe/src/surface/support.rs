//! Which points belong to a surface: spikes have too few neighbours, crumbs are patches that are too small.

// Without branches a loop vectorises.
#![allow(clippy::needless_bitwise_bool)]

use super::buffers::{PartCount, SurfaceBuilder};
use super::cause::Cause;
use super::normals::Link;
use super::patches::mark_joints;
use super::point::View;
use super::quick::{LANES, neighbours as neighbours_beside};
use super::raster::Raster;
use crate::math::parallel::for_parts;
use crate::math::simd::vectorised;

impl SurfaceBuilder {
    /// Clears samples with fewer than `min_neighbours` of eight neighbours on the same surface; returns how many.
    ///
    /// Every sample is compared with the samples before this step, so that the order of the pixels does not matter.
    pub(super) fn drop_spikes(&mut self, view: &View, link: Link) -> u32 {
        let Self { keep, counts, row_parts, raster, causes, level, settings, .. } = self;
        let support = Support { view, samples: raster, link, wanted: settings.min_neighbours };
        for_parts(row_parts, keep, counts, &|part, keep, count| {
            *count = PartCount::default();
            vectorised!(*level, support.rows(row_parts[part], keep, count));
        });
        for (part, _) in counts.iter().enumerate().filter(|(_, count)| count.spikes > 0) {
            for pixel in row_parts[part]..row_parts[part + 1] {
                if keep[pixel] == 0 && raster.depths[pixel].is_finite() {
                    (raster.depths[pixel], causes[pixel]) = (f64::NAN, Cause::Spike);
                }
            }
        }
        self.counts.iter().map(|c| c.spikes).sum()
    }

    /// Clears patches of fewer than `min_patch_points` connected samples; returns how many samples.
    ///
    /// Connected means: beside or above each other on the same surface (see [`super::patches`]).
    pub(super) fn drop_crumbs(&mut self, width: usize, link: Link) -> u32 {
        let wanted = self.settings.min_patch_points;
        if wanted <= 1 {
            return 0;
        }
        let Self { row_parts, keep, counts, raster, causes, level, patches, .. } = self;
        let Raster { depths, sigmas, .. } = raster;
        for_parts(row_parts, keep, counts, &|part, marks, _| {
            vectorised!(*level, mark_joints(depths, sigmas, (width, link.max_step), row_parts[part], marks));
        });
        patches.connect(width, keep);
        let mut dropped = 0;
        for pixels in patches.smaller_than(wanted) {
            dropped += pixels.len() as u32;
            causes[pixels.clone()].fill(Cause::Crumb);
            depths[pixels].fill(f64::NAN);
        }
        dropped
    }
}

/// What decides whether samples have enough neighbours.
#[derive(Clone, Copy)]
struct Support<'a> {
    view: &'a View<'a>,
    samples: &'a Raster,
    link: Link,
    wanted: u32,
}

impl Support<'_> {
    /// Marks the supported samples of whole rows from pixel `first` on, and counts the others.
    #[inline(always)]
    fn rows(&self, first: usize, keep: &mut [u8], count: &mut PartCount) {
        let (width, height) = (self.view.width, self.view.height);
        let Raster { depths, sigmas, .. } = self.samples;
        for (line, keep) in keep.chunks_mut(width).enumerate() {
            let (start, row) = (first + line * width, first / width + line);
            let inner = row > 0 && row + 1 < height;
            let mut column = 0;
            while column < width {
                let at = start + column;
                if inner && column > 0 && column + LANES < width {
                    let any = depths[at..at + LANES].iter().fold(false, |any, depth| any | depth.is_finite());
                    if !any {
                        keep[column..column + LANES].fill(0);
                        column += LANES;
                        continue;
                    }
                    let found = neighbours_beside(depths, sigmas, width, at, self.link.max_step);
                    for (l, found) in found.into_iter().enumerate() {
                        let valid = depths[at + l].is_finite();
                        let supported = valid && found >= u64::from(self.wanted);
                        count.spikes += u32::from(valid && !supported);
                        keep[column + l] = u8::from(supported);
                    }
                    column += LANES;
                } else {
                    let valid = depths[at].is_finite();
                    let supported =
                        valid && neighbours(self.view, self.samples, at, self.link) >= self.wanted;
                    count.spikes += u32::from(valid && !supported);
                    keep[column] = u8::from(supported);
                    column += 1;
                }
            }
        }
    }
}

/// Number of neighbours on the same surface.
#[inline(never)]
fn neighbours(view: &View, samples: &Raster, pixel: usize, link: Link) -> u32 {
    let (column, row) = (pixel % view.width, pixel / view.width);
    let columns = column.saturating_sub(1)..(column + 2).min(view.width);
    let mut count = 0;
    for line in row.saturating_sub(1)..(row + 2).min(view.height) {
        let start = line * view.width;
        for other in columns.clone() {
            count += u32::from(link.joins(&samples.at(pixel), &samples.at(start + other), 1));
        }
    }
    // The pixel itself was counted.
    count - 1
}

#[cfg(test)]
mod tests {
    use super::super::{Sample, SurfaceSettings};
    use super::*;
    use crate::rectify::Directions;

    const LINK: Link = Link { max_step: 0.01 };

    fn drawn(picture: &[&str]) -> (usize, Vec<Sample>) {
        let value = |c: u8| match c {
            b'.' => f64::NAN,
            digit => 0.002 + 0.001 * f64::from(digit - b'0'),
        };
        let samples = picture.iter().flat_map(|line| line.bytes()).map(|c| Sample {
            inverse_depth: value(c),
            sigma: 0.0,
            modulation: 1.0,
            ..Sample::NONE
        });
        (picture[0].len(), samples.collect())
    }

    fn kept(picture: &[&str], settings: SurfaceSettings) -> (Vec<String>, u32, u32) {
        let (width, samples) = drawn(picture);
        let mut builder = SurfaceBuilder::new(width, picture.len(), settings);
        let directions = Directions::kept(width, vec![[0.0; 2]; samples.len()]);
        let view = View::along_the_axes([width, picture.len()], &directions, 0.001);
        builder.load(&samples);
        let spikes = builder.drop_spikes(&view, LINK);
        let crumbs = builder.drop_crumbs(width, LINK);
        let mark = |depth: &f64| if depth.is_finite() { '#' } else { '.' };
        (
            builder.raster.depths.chunks(width).map(|line| line.iter().map(mark).collect()).collect(),
            spikes,
            crumbs,
        )
    }

    #[test]
    fn a_spike_goes_and_a_corner_stays() {
        let settings = SurfaceSettings { min_patch_points: 1, ..SurfaceSettings::default() };
        let (picture, spikes, _) = kept(&["11111...", "11311..1", "11111...", "11111.11"], settings);
        assert_eq!(picture, ["#####...", "##.##...", "#####...", "#####..."]);
        assert_eq!(spikes, 4);
    }

    #[test]
    fn small_patches_go_even_when_they_touch_another_surface() {
        let settings =
            SurfaceSettings { min_neighbours: 0, min_patch_points: 5, ..SurfaceSettings::default() };
        let (picture, _, crumbs) = kept(&["11122.1", "1.122.1", "1.1...1", "111..11"], settings);
        assert_eq!(picture, ["###...#", "#.#...#", "#.#...#", "###..##"], "rings and hooks are connected");
        assert_eq!(crumbs, 4);
    }
}
