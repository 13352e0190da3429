//! The way from samples to points.

use super::buffers::{PartCount, SurfaceBuilder};
use super::crease::{self, is_crease};
use super::normals::{Link, normal, quiet_half};
use super::point::{Sample, View};
use super::quick::{Shared, group};
use super::raster::Raster;
use super::smooth::{alone, smoothed, smoothed_partly};
use super::windows::{Block, Broken, HALF, LANES};
use super::{Cause, SurfaceReport, SurfaceSettings};
use crate::cloud::Point;
use crate::math::parallel::for_parts;
use crate::math::simd::vectorised;
use bytemuck::Zeroable;
use nalgebra::Vector3;
use rayon::prelude::*;
use std::ops::Range;
use std::slice::IterMut;

/// Points of parts that are worked on together.
const POINTS_AT_ONCE: usize = 131_072;

/// Parts whose samples one thread counts.
const COUNTED_AT_ONCE: usize = 8;

impl SurfaceBuilder {
    /// Drops spikes, crumbs and steep points from the samples that were put or loaded, then writes the points in pixel order; `out` has at least one
    /// element per pixel.
    pub fn build(&mut self, view: &View, pair: u32, out: &mut [Point]) -> SurfaceReport {
        let link = Link { max_step: self.max_tangent * view.pitch };
        let spikes = self.drop_spikes(view.width, link);
        let crumbs = self.drop_crumbs(view.width);
        self.mark_gaps((view.width, view.height), link, view.pitch);
        let rims = self.drop_rims(view, link);
        let written = self.write(view, link, pair, out);
        let [remnants, without_normal] = self.drop_remnants(&mut out[..written.points as usize]);
        SurfaceReport {
            spikes,
            crumbs: crumbs + remnants,
            rims,
            points: written.points - remnants,
            without_normal: written.without_normal - without_normal,
            ..written
        }
    }

    fn write(&mut self, view: &View, link: Link, pair: u32, out: &mut [Point]) -> SurfaceReport {
        let total = self.count_samples();
        let excess = self.excess(view, link, total);
        let selector = Selector {
            view,
            samples: &self.raster,
            link,
            excess,
            settings: &self.settings,
            min_cosine: self.min_cosine,
            gaps: &self.keep,
        };
        let mut report = SurfaceReport::default();
        let (starts, causes) = (&self.point_parts, &mut self.causes);
        let parts = self.counts.len();
        let (mut before, mut first) = (0, 0);
        // Some parts at a time: their points are moved together, as long as a cache holds them, while the next ones are written.
        while before < parts {
            let some = |start: &usize| *start < starts[first] + POINTS_AT_ONCE;
            let last = starts.partition_point(some).max(first + 1).min(parts);
            let (written, points) = out.split_at_mut(starts[first]);
            let (counted, counts) = self.counts.split_at_mut(first);
            let done = (&starts[before..=first], &counted[before..]);
            let next = (
                &starts[first..=last],
                &mut points[..starts[last] - starts[first]],
                &mut counts[..last - first],
            );
            let write = |part: usize, points: &mut [Point], count: &mut PartCount| {
                *count = PartCount::default();
                let pixels = self.row_parts[first + part]..self.row_parts[first + part + 1];
                vectorised!(self.level, selector.rows(pixels, pair, points, count));
            };
            rayon::join(
                || {
                    note_causes(done, written, causes);
                    close_gaps(done, written, &mut report);
                },
                || for_parts(next.0, next.1, next.2, &write),
            );
            (before, first) = (first, last);
        }
        report
    }

    /// Finds where the points of each part begin if each sample becomes one, and counts the samples.
    fn count_samples(&mut self) -> usize {
        let depths = &self.raster.depths;
        let parts = self.point_parts.par_iter_mut().zip(self.row_parts.par_windows(2));
        parts.with_min_len(COUNTED_AT_ONCE).for_each(|(count, ends)| {
            let finite = depths[ends[0]..ends[1]].iter().map(|depth| usize::from(depth.is_finite()));
            *count = finite.sum();
        });
        let mut total = 0;
        let Some((end, parts)) = self.point_parts.split_last_mut() else { return 0 };
        for start in parts {
            total += std::mem::replace(start, total);
        }
        *end = total;
        total
    }
}

/// Keeps why pixels were dropped: they stand behind the points of each part.
fn note_causes((starts, counts): (&[usize], &[PartCount]), written: &[Point], causes: &mut [Cause]) {
    for (ends, count) in starts.windows(2).zip(counts) {
        for dropped in &written[ends[0] + count.points as usize..ends[1]] {
            let cause = Cause::ALL.get(dropped.pair as usize).copied().unwrap_or_default();
            causes[dropped.pixel as usize] = cause;
        }
    }
}

/// Moves the points of parts behind those of the parts before, and adds up their counts.
fn close_gaps((starts, counts): (&[usize], &[PartCount]), written: &mut [Point], report: &mut SurfaceReport) {
    for (start, count) in starts.iter().zip(counts) {
        let (end, points) = (report.points as usize, count.points as usize);
        if *start != end {
            written.copy_within(*start..start + points, end);
        }
        report.points += count.points;
        report.steep += count.steep;
        report.uncertain += count.uncertain;
        report.without_normal += count.without_normal;
    }
}

/// Writes why a pixel gives no point.
fn drop_pixel(pixel: usize, cause: Cause, slots: &mut IterMut<Point>, count: &mut PartCount) {
    count.add(cause);
    if let Some(dropped) = slots.next_back() {
        *dropped = Point { pixel: pixel as u32, pair: cause as u32, ..Zeroable::zeroed() };
    }
}

/// Adds a further uncertainty of the inverse depth to that of a sample.
fn add(sample: &mut Sample, off: f64) {
    sample.sigma = (f64::from(sample.sigma) * f64::from(sample.sigma) + off * off).sqrt() as f32;
}

/// Decides whether a pixel becomes a point, or why it is dropped.
pub(super) struct Selector<'a> {
    pub(super) view: &'a View<'a>,
    pub(super) samples: &'a Raster,
    pub(super) link: Link,
    /// Excess of the scatter, see [`super::scatter`].
    pub(super) excess: f64,
    pub(super) settings: &'a SurfaceSettings,
    pub(super) min_cosine: f64,
    pub(super) gaps: &'a [u8],
}

impl Selector<'_> {
    /// Points from the front, dropped pixels with their cause from the back: together they fill the part exactly.
    #[inline(always)]
    fn rows(&self, pixels: Range<usize>, pair: u32, points: &mut [Point], count: &mut PartCount) {
        let View { width, height, .. } = *self.view;
        let common =
            Shared { max_step: self.link.max_step, excess: self.excess, min_cosine: self.min_cosine };
        let whole =
            self.settings.smoothing_half() == HALF && self.settings.normal_window_px as usize / 2 == HALF;
        let (mut slots, mut block) = (points.iter_mut(), Block::NONE);
        let mut at = pixels.start;
        while at < pixels.end {
            let (column, row) = (at % width, at / width);
            let inner =
                row >= HALF && row + HALF < height && column >= HALF && column + LANES + HALF <= width;
            if !(whole && inner) {
                if self.samples.depths[at].is_finite() {
                    self.place((at, Broken::UNKNOWN), pair, &mut slots, count);
                }
                at += 1;
                continue;
            }
            if self.samples.depths[at..at + LANES].iter().any(|depth| depth.is_finite()) {
                let found = group(self.view, self.samples, at, common, &mut block);
                let ([x, y, z], [nx, ny, nz]) = (&found.position_mm, &found.normal);
                let limbs = &self.samples.limbs[at..at + LANES];
                for l in 0..LANES {
                    if !found.settled[l] {
                        if self.samples.depths[at + l].is_finite() {
                            self.place((at + l, found.broken(l)), pair, &mut slots, count);
                        }
                        continue;
                    }
                    if limbs[l] != 0 && found.turned_away[l] {
                        let (sample, normal) = found.smoothed(self.samples.at(at + l), l);
                        if self.at_limb(at + l, &sample, &normal) {
                            drop_pixel(at + l, Cause::Steep, &mut slots, count);
                            continue;
                        }
                    }
                    let Some(point) = slots.next() else { return };
                    count.add(Cause::Point);
                    *point = Point {
                        position_mm: [x[l], y[l], z[l]],
                        normal: [nx[l] as f32, ny[l] as f32, nz[l] as f32],
                        sigma_mm: found.sigma_mm[l],
                        modulation: self.samples.modulations[at + l],
                        pair,
                        pixel: (at + l) as u32,
                        shared_mm: 0.0,
                    };
                }
            }
            at += LANES;
        }
    }

    /// The point of one pixel, or its cause.
    #[inline(never)]
    fn place(
        &self,
        (pixel, broken): (usize, Broken),
        pair: u32,
        slots: &mut IterMut<Point>,
        count: &mut PartCount,
    ) {
        let (sample, normal, cause) = self.pixel(pixel, broken);
        if cause != Cause::Point {
            return drop_pixel(pixel, cause, slots, count);
        }
        let Some(point) = slots.next() else { return };
        count.add(cause);
        *point = self.view.point(&sample, pixel, pair, normal);
        count.without_normal += u32::from(normal.is_none());
    }

    /// The smoothed sample, its normal, and whether it is a point.
    #[inline]
    pub(super) fn pixel(&self, pixel: usize, broken: Broken) -> (Sample, Option<Vector3<f64>>, Cause) {
        let Self { view, samples, link, gaps, settings, .. } = *self;
        let (half, smoothing) = (settings.normal_window_px as usize / 2, settings.smoothing_half());
        let largest = if broken.quadratic { HALF - 1 } else { smoothing };
        let (mut sample, window) = smoothed(view, samples, pixel, link.max_step, largest);
        let normal = normal(view, samples, pixel, link, (half, broken.plane));
        let size = (view.width, view.height);
        let noise = f64::from(samples.sigmas[pixel]) * self.excess;
        let mut rough = window >= HALF && is_crease(size, samples, pixel, noise, link);
        let mut blunt = rough;
        if window < smoothing {
            let partly = smoothed_partly(view, samples, gaps, pixel, link, (window, smoothing));
            blunt = partly.is_none();
            // All samples are there and are not one smooth surface: smaller windows would only hide it.
            rough = blunt && samples.is_whole(size, pixel, smoothing);
            sample = partly.unwrap_or(sample);
        }
        // Noise of the pixel alone hides what reaches over many.
        let excess = if window > 0 || view.independence.share < 1.0 { self.excess } else { 1.0 };
        sample.sigma = (f64::from(sample.sigma) * excess) as f32;
        // How steep a place is does not depend on what is stated of a crease: no limb hides behind it.
        let seen = sample;
        if rough {
            sample = alone(view, samples, pixel);
            sample.sigma = (f64::from(sample.sigma) * excess) as f32;
        }
        if blunt {
            add(&mut sample, crease::error(size, samples, pixel, link));
        }
        let mut steep = false;
        if let Some(normal) = normal {
            let beyond = view.beyond_incidence(&seen, pixel, &normal, self.min_cosine);
            let wide = quiet_half(view, &samples.at(pixel));
            steep = beyond > 0.0 && wide <= half;
            if beyond > 0.0 && !steep {
                add(&mut sample, view.slope_error(&seen, pixel, &normal, wide, beyond));
            }
        }
        let limb = || normal.is_some_and(|normal| self.at_limb(pixel, &seen, &normal));
        let cause = if steep || limb() {
            Cause::Steep
        } else if f64::from(sample.sigma) > view.max_sigma {
            Cause::Uncertain
        } else {
            Cause::Point
        };
        (sample, normal, cause)
    }
}
