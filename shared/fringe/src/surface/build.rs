//! The way from samples to points.

use super::SurfaceReport;
use super::buffers::{PartCount, SurfaceBuilder};
use super::normals::{Link, normal};
use super::rim::at_rim;
use super::sample::{Sample, View};
use super::smooth::smoothed;
use crate::cloud::Point;
use crate::math::parallel::for_parts;

impl SurfaceBuilder {
    /// Drops spikes, crumbs and steep points from `samples`, then writes the points in pixel order; `out` has room for all pixels.
    pub fn build(
        &mut self,
        view: &View,
        samples: &mut [Sample],
        pair: u32,
        out: &mut [Point],
    ) -> SurfaceReport {
        let link = Link { max_step: self.max_tangent * view.pitch };
        let spikes = self.drop_spikes(view, samples, link);
        let crumbs = self.drop_crumbs(view.width, samples, link);
        let written = self.write(view, samples, link, pair, out);
        SurfaceReport { spikes, crumbs, ..written }
    }

    fn write(
        &mut self,
        view: &View,
        samples: &[Sample],
        link: Link,
        pair: u32,
        out: &mut [Point],
    ) -> SurfaceReport {
        let filled = |pixel: &usize| samples[*pixel].inverse_depth.is_finite();
        let mut total = 0;
        for (part, start) in self.point_parts.iter_mut().enumerate() {
            *start = total;
            if let Some(end) = self.row_parts.get(part + 1) {
                total += (self.row_parts[part]..*end).filter(filled).count();
            }
        }
        let half = self.settings.normal_window_px as usize / 2;
        let (edge, smoothing) = (self.settings.edge_px as usize, self.settings.smoothing_half());
        let size = (view.width, view.height);
        for_parts(&self.point_parts, &mut out[..total], &mut self.counts, &|part, points, count| {
            *count = PartCount::default();
            let mut room = points.iter_mut();
            for pixel in (self.row_parts[part]..self.row_parts[part + 1]).filter(filled) {
                let normal = normal(view, samples, pixel, link, half);
                let (sample, window) = smoothed(size, samples, pixel, link.max_step, smoothing);
                if normal.is_some_and(|n| view.is_steep(&samples[pixel], pixel, &n, self.min_cosine)) {
                    count.steep += 1;
                } else if window < edge && at_rim(size, samples, pixel, link, edge) {
                    count.rims += 1;
                } else if let Some(point) = room.next() {
                    *point = view.point(&sample, pixel, pair, normal);
                    count.points += 1;
                    count.without_normal += u32::from(normal.is_none());
                }
            }
        });
        self.close_gaps(out)
    }

    /// Moves the points of all parts together and adds up their counts.
    fn close_gaps(&self, out: &mut [Point]) -> SurfaceReport {
        let mut report = SurfaceReport::default();
        for (start, count) in self.point_parts.iter().zip(&self.counts) {
            let end = report.points as usize;
            if *start != end {
                out.copy_within(*start..*start + count.points as usize, end);
            }
            report.points += count.points;
            report.steep += count.steep;
            report.rims += count.rims;
            report.without_normal += count.without_normal;
        }
        report
    }
}
