//! Which points belong to a surface: spikes have too few neighbours, crumbs are patches that are too small.

use super::buffers::{PartCount, SurfaceBuilder};
use super::cause::Cause;
use super::joints::{ABOVE, ALONE, BEFORE, Joints};
use super::normals::Link;
use super::patches::{STRIDE, eight, repeated};
use super::raster::Raster;
use crate::cloud::Point;
use crate::math::parallel::for_parts;
use crate::math::simd::vectorised;
use std::ops::Range;

impl SurfaceBuilder {
    /// Clears samples with fewer than `min_neighbours` of eight neighbours on the same surface; returns how many. Leaves in `keep` which of the others
    /// are joined.
    ///
    /// Every sample is compared with the samples before this step, so that the order of the pixels does not matter.
    pub(super) fn drop_spikes(&mut self, width: usize, link: Link) -> u32 {
        let Self { keep, counts, row_parts, raster, causes, level, settings, .. } = self;
        let joints = Joints { samples: raster, width, link, wanted: settings.min_neighbours };
        for_parts(row_parts, keep, counts, &|part, marks, count| {
            let spikes = vectorised!(*level, joints.mark(row_parts[part], marks));
            *count = PartCount { spikes, ..PartCount::default() };
        });
        for (part, _) in counts.iter().enumerate().filter(|(_, count)| count.spikes > 0) {
            let mut pixel = row_parts[part];
            while pixel < row_parts[part + 1] {
                if eight(keep, pixel).is_some_and(|marks| marks & repeated(ALONE) == 0) {
                    pixel += STRIDE;
                    continue;
                }
                if keep[pixel] & ALONE != 0 {
                    (raster.depths[pixel], causes[pixel], keep[pixel]) = (f64::NAN, Cause::Spike, 0);
                    // Nothing is joined with it any more.
                    for (other, mark) in [(pixel + 1, BEFORE), (pixel + width, ABOVE)] {
                        if let Some(marks) = keep.get_mut(other) {
                            *marks &= !mark;
                        }
                    }
                }
                pixel += 1;
            }
        }
        self.counts.iter().map(|c| c.spikes).sum()
    }

    /// Clears patches of fewer than `min_patch_points` connected samples; returns how many samples. Spikes must have been dropped.
    ///
    /// Connected means: beside or above each other on the same surface (see [`super::patches`]).
    pub(super) fn drop_crumbs(&mut self, width: usize) -> u32 {
        let wanted = self.settings.min_patch_points;
        if wanted <= 1 {
            return 0;
        }
        let Self { keep, raster: Raster { depths, .. }, causes, patches, .. } = self;
        patches.connect(width, keep);
        let mut dropped = 0;
        for pixels in patches.smaller_than(wanted) {
            dropped += pixels.len() as u32;
            causes[pixels.clone()].fill(Cause::Crumb);
            depths[pixels].fill(f64::NAN);
        }
        dropped
    }

    /// Takes out the points of patches of which fewer than `min_patch_points` are left, and moves the others together: what is left of a wrong
    /// match without its rims. Returns how many points, and how many of them had no normal.
    pub(super) fn drop_remnants(&mut self, points: &mut [Point]) -> [u32; 2] {
        let wanted = self.settings.min_patch_points;
        if wanted <= 1 {
            return [0; 2];
        }
        let Self { causes, patches, .. } = self;
        patches.recount(points, |point| point.pixel);
        let (mut end, mut next, mut without_normal) = (0, 0, 0);
        for pixels in patches.smaller_than(wanted) {
            let before = next + points[next..].partition_point(|point| (point.pixel as usize) < pixels.start);
            let after =
                before + points[before..].partition_point(|point| (point.pixel as usize) < pixels.end);
            if before == after {
                continue;
            }
            move_down(points, next..before, &mut end);
            for point in &points[before..after] {
                causes[point.pixel as usize] = Cause::Crumb;
                without_normal += u32::from(point.normal == [0.0; 3]);
            }
            next = after;
        }
        move_down(points, next..points.len(), &mut end);
        [(points.len() - end) as u32, without_normal]
    }
}

/// Moves points down to the end of those before, which moves on.
fn move_down(points: &mut [Point], from: Range<usize>, end: &mut usize) {
    let count = from.len();
    if from.start != *end {
        points.copy_within(from, *end);
    }
    *end += count;
}

#[cfg(test)]
mod tests {
    use super::super::{Sample, SurfaceSettings};
    use super::*;
    use bytemuck::Zeroable;

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
        builder.load(&samples);
        let spikes = builder.drop_spikes(width, LINK);
        let crumbs = builder.drop_crumbs(width);
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

    /// Proves: of two patches with as many samples the one goes that has few points left, with every point of it, and no other point moves.
    #[test]
    fn a_patch_with_few_points_left_goes() {
        let settings =
            SurfaceSettings { min_neighbours: 0, min_patch_points: 4, ..SurfaceSettings::default() };
        let picture = ["1111.33.", "1111.33.", ".....33.", ".....33."];
        let (width, samples) = drawn(&picture);
        let mut builder = SurfaceBuilder::new(width, picture.len(), settings);
        builder.load(&samples);
        builder.drop_spikes(width, LINK);
        assert_eq!(builder.drop_crumbs(width), 0);
        let point = |pixel: u32| Point {
            pixel,
            normal: [0.0, 0.0, f32::from(u8::from(pixel != 13))],
            ..Zeroable::zeroed()
        };
        let mut points = [1, 2, 5, 9, 10, 13, 22].map(point);
        assert_eq!(builder.drop_remnants(&mut points), [3, 1]);
        assert_eq!(points[..4].iter().map(|p| p.pixel).collect::<Vec<_>>(), [1, 2, 9, 10]);
        assert!([5, 13, 22].iter().all(|pixel| builder.causes()[*pixel] == Cause::Crumb));
        let mut enough = [1, 2, 5, 6, 9, 10, 13, 22].map(point);
        assert_eq!(builder.drop_remnants(&mut enough), [0, 0]);
        assert_eq!(enough[7].pixel, 22);
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
