//! The window around a corner: the pixels near its two edges, as stretches of rows.

use super::normal::{Pixels, Sample};
use super::raster::{Grey, Image};
use nalgebra::{Point2, Vector2};
use std::ops::Range;

/// Margin between a corner and the border of the image, px: as far as the blur reaches.
pub(crate) const LEAST_ROOM_PX: f64 = 4.0;

/// Reach of the window.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window {
    pub fraction: f64,
    pub limit_px: f64,
    pub band: Band,
}

/// Distance from the edges within which pixels count, as a fraction of the pitch and at least: the inside of the squares
/// has no information on the edges, and may carry markers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Band {
    fraction: f64,
    least_px: f64,
}

impl Band {
    /// The window for most corners.
    pub const WIDE: Self = Self { fraction: 0.22, least_px: 4.5 };
    /// Between the edges and markers that come close to them.
    pub const NARROW: Self = Self { fraction: 0.12, least_px: 2.5 };
}

/// The pixels of the cross along both edges of a corner, cut at the border of the image.
pub(super) struct Cross {
    /// Rows, and columns of each.
    stretches: Vec<(usize, Range<usize>)>,
    /// The longer way from the corner to the end of an edge, px.
    pub reach_px: f64,
}

impl Cross {
    /// The window about a corner, with the steps from it to the next ones; `None` outside of the image, and where the edges do not cross.
    pub fn about(
        corner: Point2<f64>,
        [e, f]: [Vector2<f64>; 2],
        window: Window,
        image: &Image,
    ) -> Option<Self> {
        let lengths = [e.norm(), f.norm()];
        let area = e.x * f.y - e.y * f.x;
        if lengths[0].min(lengths[1]) < 3.0 || area.abs() < 0.1 * lengths[0] * lengths[1] {
            return None;
        }
        // Of a corner at w·e + v·f: w and v; w·|e| is the way along the first edge.
        let reach = lengths.map(|l| (window.fraction * l).min(window.limit_px));
        let band = lengths
            .map(|l| (window.band.fraction * l).clamp(window.band.least_px, 0.5 * window.limit_px.max(9.0)));
        let last = Vector2::new(image.width as f64 - 1.0, image.height as f64 - 1.0);
        let room = corner.coords.inf(&(last - corner.coords)).min();
        if room.is_nan() || room < LEAST_ROOM_PX {
            return None;
        }
        // Both ways of a pixel, px, are sums of its steps from the corner times these.
        let per_x = [f.y / area * lengths[0], -e.y / area * lengths[1]];
        let per_y = [-f.x / area * lengths[0], e.x / area * lengths[1]];
        let near = (area / lengths[0] / lengths[1]).abs();
        let height = reach[0] * e.y.abs() / lengths[0] + reach[1] * f.y.abs() / lengths[1];
        let (top, bottom) = ((corner.y - height).floor().max(0.0), (corner.y + height).ceil().min(last.y));
        let mut stretches = Vec::new();
        for row in top as usize..=bottom as usize {
            let dy = row as f64 - corner.y;
            let within = |i: usize, limit: f64| stretch(per_x[i], per_y[i] * dy, limit);
            let inside = both(within(0, reach[0]), within(1, reach[1]));
            let arms = [both(inside, within(1, band[1] / near)), both(inside, within(0, band[0] / near))];
            let [a, b] = arms.map(|arm| columns(arm, corner.x, last.x));
            stretches
                .extend(joined(a, b).into_iter().filter(|columns| !columns.is_empty()).map(|c| (row, c)));
        }
        Some(Self { stretches, reach_px: reach[0].max(reach[1]) })
    }

    /// Number of its pixels.
    pub fn count(&self) -> usize {
        self.stretches.iter().map(|(_, columns)| columns.len()).sum()
    }

    /// The pixels relative to an origin on one of them; of a thinned window every second one, as the black squares of a chessboard.
    pub fn pixels(&self, image: &Image, origin: Point2<f64>, thinned: bool) -> Pixels {
        let (mut pixels, mut values) = (Pixels::default(), Vec::new());
        for (row, columns) in &self.stretches {
            let [x, y] = [columns.start as f64 - origin.x, *row as f64 - origin.y];
            let (skipped, step) = if thinned { (((x + y) as i64).rem_euclid(2) as usize, 2) } else { (0, 1) };
            values.resize(columns.len(), 0.0);
            image.copy(*row, columns.start, &mut values);
            let mut sample = Sample { x: x as f32 + skipped as f32, y: y as f32, value: 0.0 };
            for value in values.iter().skip(skipped).step_by(step) {
                pixels.push(Sample { value: *value, ..sample });
                sample.x += step as f32;
            }
        }
        pixels
    }
}

/// The columns of a stretch about a corner, as far as they lie in the image; what is no number gives none.
fn columns([from, to]: [f64; 2], corner_x: f64, last: f64) -> Range<usize> {
    let (from, to) = ((corner_x + from).ceil().max(0.0), (corner_x + to).floor().min(last));
    if from <= to { from as usize..to as usize + 1 } else { 0..0 }
}

/// Where along a row a sum `per_x`·x + `from` stays within a limit.
fn stretch(per_x: f64, from: f64, limit: f64) -> [f64; 2] {
    // A row along an edge lies in reach as a whole or not at all.
    if per_x.abs() < 1e-9 {
        return if from.abs() <= limit { [f64::NEG_INFINITY, f64::INFINITY] } else { [1.0, -1.0] };
    }
    let (one, other) = ((-limit - from) / per_x, (limit - from) / per_x);
    [one.min(other), one.max(other)]
}

/// What lies in both stretches; empty where the first end is beyond the second.
fn both(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].min(b[1])]
}

/// Two stretches of columns in their order, as one where they touch.
fn joined(a: Range<usize>, b: Range<usize>) -> [Range<usize>; 2] {
    if a.is_empty() || b.is_empty() || (a.start <= b.end && b.start <= a.end) {
        let filled = |r: &Range<usize>| !r.is_empty();
        let all = [a, b].into_iter().filter(filled).reduce(|a, b| a.start.min(b.start)..a.end.max(b.end));
        return [all.unwrap_or(0..0), 0..0];
    }
    if a.start < b.start { [a, b] } else { [b, a] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::frame::{FrameView, Pixels};
    use proptest::prelude::*;

    const SIZE_PX: (u32, u32) = (60, 50);

    proptest! {
        /// Proves: the stretches hold the pixels within the reach of both edges and the band of one, as asking pixel by pixel
        /// tells; what lies on a border within rounding may go either way.
        #[test]
        fn the_stretches_are_what_asking_each_pixel_tells(
            (x, y) in (0.0_f64..60.0, 0.0_f64..50.0),
            angles in [0.0_f64..6.3, 0.4_f64..2.7],
            lengths in [4.0_f64..50.0, 4.0_f64..50.0],
            upright in any::<bool>(),
        ) {
            let frame = vec![0; (SIZE_PX.0 * SIZE_PX.1) as usize];
            let (pixels, (width_px, height_px)) = (Pixels::Mono8(&frame), SIZE_PX);
            let image = Image::of_frame(&FrameView { width_px, height_px, full_scale_dn: 255, pixels }).unwrap();
            // Edges along rows and columns divide by nothing.
            let first = if upright { 0.0 } else { angles[0] };
            let second = if upright { std::f64::consts::FRAC_PI_2 } else { first + angles[1] };
            let along = [(first, lengths[0]), (second, lengths[1])].map(|(angle, length)| {
                let (sin, cos) = fringe::math::sincos(angle);
                Vector2::new(cos, sin) * length
            });
            let window = Window { fraction: 0.45, limit_px: 14.0, band: Band::WIDE };
            let Some(cross) = Cross::about(Point2::new(x, y), along, window, &image) else { return Ok(()) };
            let (area, [e, f]) = (along[0].perp(&along[1]), along);
            let ways = |d: Vector2<f64>| [d.perp(&f) / area * lengths[0], e.perp(&d) / area * lengths[1]];
            let within = |d: Vector2<f64>, slack: f64| {
                let way = ways(d).map(f64::abs);
                let near = (area / lengths[0] / lengths[1]).abs();
                let reach = lengths.map(|l| (0.45 * l).min(14.0) + slack);
                let band = lengths.map(|l| (0.22 * l).clamp(4.5, 7.0) + slack);
                let inside = way[0] <= reach[0] && way[1] <= reach[1];
                inside && (way[1] * near <= band[1] || way[0] * near <= band[0])
            };
            for row in 0..SIZE_PX.1 as usize {
                let held: Vec<usize> =
                    cross.stretches.iter().filter(|(r, _)| *r == row).flat_map(|(_, c)| c.clone()).collect();
                prop_assert!(held.is_sorted_by(|a, b| a < b), "{held:?}");
                for column in 0..SIZE_PX.0 as usize {
                    let d = Vector2::new(column as f64 - x, row as f64 - y);
                    let is_held = held.contains(&column);
                    prop_assert!(!is_held || within(d, 1e-6), "({column}, {row}) is too much");
                    prop_assert!(is_held || !within(d, -1e-6), "({column}, {row}) is missing");
                }
            }
            prop_assert!(cross.count() > 0);
        }
    }
}
