//! Which points belong to a surface: spikes have too few neighbours, crumbs are patches that are too small.

use super::buffers::{PartCount, SurfaceBuilder};
use super::cause::Cause;
use super::joints::{ABOVE, ALONE, BEFORE, Joints};
use super::normals::Link;
use super::patches::{STRIDE, eight, repeated};
use super::raster::Raster;
use crate::math::parallel::for_parts;
use crate::math::simd::vectorised;

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
}

#[cfg(test)]
mod tests {
    use super::super::{Sample, SurfaceSettings};
    use super::*;

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

    #[test]
    fn small_patches_go_even_when_they_touch_another_surface() {
        let settings =
            SurfaceSettings { min_neighbours: 0, min_patch_points: 5, ..SurfaceSettings::default() };
        let (picture, _, crumbs) = kept(&["11122.1", "1.122.1", "1.1...1", "111..11"], settings);
        assert_eq!(picture, ["###...#", "#.#...#", "#.#...#", "###..##"], "rings and hooks are connected");
        assert_eq!(crumbs, 4);
    }
}
