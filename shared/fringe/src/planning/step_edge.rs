//! The edge of a step that crosses the base of two views: what its wall does to the width from 10 to 90 %.
//!
//! Of a step of height h a view at the angle θ from the normal sees the upper face moved by h tan θ. On one side it sees the wall, which is dark
//! where the light comes from the other side; on the other side the floor beside the wall is hidden. The phasor of a pixel is the mean over its
//! footprint, weighted by the light that comes from there; a dark wall moves the phase towards its brighter side:
//!
//! ```text
//! φ(u) = arg Σ m(u') g(u' − u) exp(2πi X(u') / p),   g normal with the footprint's width, m light, X coordinate in the light's picture, p period
//! ```
//!
//! Lengths are pixels of the first view on the floor; a coordinate is that of where a line of sight or a ray of light meets the plane of the floor. The
//! upper face lies at x < 0.

use super::resolution::{Seen, read_between};
use crate::geometry::camera::Camera;
use crate::math::{atan2, exp, sincos};
use nalgebra::Point3;
use std::f64::consts::TAU;

/// Places in a pixel at which both views are taken. The places from which the second one is read lie on them, see [`read_between`].
const GRID: i32 = 40;
/// Parts of their distance over which phasors are summed.
const PARTS: i32 = 4;
/// How far a footprint reaches, standard deviations.
const FOOTPRINTS: f64 = 6.0;
/// No pixel has a smaller footprint, px: its area alone has 0.29.
const LEAST_PX: f64 = 0.1;
/// How much farther than the step a view is followed, px.
const MORE_PX: f64 = 3.0;
/// A wall or a hidden floor wider than this is seen as a face of its own, px.
const MOST_PX: f64 = 40.0;
/// A view with a larger footprint is not followed, px: it would take long, and no step of such a view is sharp.
const MOST_FOOTPRINT_PX: f64 = 5.0;
/// The step may move fringes by so much of a period: about half of it, the phase of a pixel that sees both faces means nothing.
const MOST_TURNS: f64 = 0.4;
/// A period beside which every step is small, px.
const LONG_PX: f64 = 1e4;

/// The directions in which an edge across the base is seen and lit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// First view, second view and light: tangents of the angles from the normal along the base. Above 0 the upper face hides the floor.
    pub tangents: [f64; 3],
    /// Fringe period on the floor, px of the first view; none: long.
    pub period_px: Option<f64>,
}

impl Crossing {
    /// Of a surface at a place that faces both views, under fringes of this many projector pixels, as far as that is known; `None` where the
    /// directions of the views are one.
    pub fn new(
        [first, second]: [&Camera; 2],
        (light, period_px): (&Camera, Option<f64>),
        at: &Point3<f64>,
    ) -> Option<Self> {
        let towards = |view: &Camera| (view.centre_mm() - at).try_normalize(1e-9);
        let views = [towards(first)?, towards(second)?, towards(light)?];
        let normal = (views[0] + views[1]).try_normalize(1e-9)?;
        let base = views[0] - views[1];
        let along = (base - normal * base.dot(&normal)).try_normalize(1e-9)?;
        let tangents = views.map(|view| -view.dot(&along) / view.dot(&normal));
        let px_per_mm = |view: &Camera| view.focal_px[0] / (view.centre_mm() - at).norm();
        let period_px = period_px.map(|period_px| period_px * px_per_mm(first) / px_per_mm(light));
        Some(Self { tangents, period_px })
    }

    /// Width from 10 to 90 % of a step of this height, px: the greater of both edges, that which the first view sees from above and that which it sees
    /// the wall of. `None` where the response does not go from the one to the other, where wall or hidden floor are wider than 40 px (such an edge is
    /// no detail), where the footprint is wider than 5 px, and where the step moves the fringes by more than 0.4 of a period.
    pub fn width_px(&self, seen: &Seen, height_px: f64) -> Option<f64> {
        let other_edge = Self { tangents: self.tangents.map(|tangent| -tangent), ..*self };
        Some(self.edge_px(seen, height_px)?.max(other_edge.edge_px(seen, height_px)?))
    }

    fn edge_px(&self, seen: &Seen, height_px: f64) -> Option<f64> {
        let [first, second, light] = self.tangents;
        let apart = first - if seen.matched { second } else { light };
        let moved = height_px * first.abs().max(second.abs()).max(light.abs());
        let turned = height_px * (first - light).abs().max((second - light).abs());
        let period_px = self.period_px.unwrap_or(LONG_PX);
        // Not a number is not within them either.
        let usable = height_px > 0.0 && moved <= MOST_PX && turned <= MOST_TURNS * period_px;
        let footprint_px = seen.footprint_px.max(LEAST_PX);
        if apart.abs() < 1e-6 || !usable || footprint_px > MOST_FOOTPRINT_PX {
            return None;
        }
        let reach = ((FOOTPRINTS * footprint_px + MORE_PX + moved) * f64::from(GRID)) as i32;
        let view =
            |tangent| View::new(self, [tangent, height_px], [footprint_px, period_px], reach + 3 * GRID);
        let own = view(first);
        let places = || (-reach..=reach).map(|i| f64::from(i) / f64::from(GRID));
        // A projector is not read between pixels.
        let read: Vec<(f64, f64)> = if seen.matched {
            let other = view(second);
            places().map(|place| (place, read_between(|at| other.at(at), place))).collect()
        } else {
            Vec::new()
        };
        let profile = places().filter_map(|place| {
            let coordinate = own.at(place);
            let other = if seen.matched { found(&read, coordinate, place)? } else { coordinate };
            let height = (place - other) / apart;
            Some((place - height * first, height / height_px))
        });
        let profile: Vec<(f64, f64)> = profile.collect();
        Some(falls_through(&profile, 0.1)? - falls_through(&profile, 0.9)?)
    }

    /// Coordinate in the light's picture of what a view sees at a place, and the light from there, that of the floor being 1.
    fn face(&self, [tangent, height]: [f64; 2], place: f64) -> [f64; 2] {
        let light = self.tangents[2];
        if place < height * tangent {
            [place + height * (light - tangent), 1.0]
        } else if place < 0.0 {
            // The wall: light falls on it from in front only.
            [place * light / tangent, (-light).max(0.0)]
        } else {
            [place, f64::from(u8::from(place >= height * light))]
        }
    }
}

/// Coordinates in the light's picture that a view shows by its phases, at places [`GRID`] to the pixel.
struct View {
    shown: Vec<f64>,
    reach: i32,
}

impl View {
    fn new(
        step: &Crossing,
        [tangent, height]: [f64; 2],
        [footprint_px, period_px]: [f64; 2],
        reach: i32,
    ) -> Self {
        let fine = f64::from(GRID * PARTS);
        let half = (FOOTPRINTS * footprint_px * fine) as i32;
        let weights: Vec<f64> = (-half..=half)
            .map(|j| {
                let at = f64::from(j) / (fine * footprint_px);
                exp(-0.5 * at * at)
            })
            .collect();
        // Between the places, so that no end of a face lies on one.
        let first = -reach * PARTS - half;
        let count = (2 * (reach * PARTS + half) + 1) as usize;
        let phasors: Vec<[f64; 2]> = (0..count)
            .map(|j| {
                let place = (f64::from(first + j as i32) + 0.5) / fine;
                let [coordinate, light] = step.face([tangent, height], place);
                let (s, c) = sincos(TAU * coordinate / period_px);
                [light * c, light * s]
            })
            .collect();
        let shown = (-reach..=reach).map(|i| {
            let from = ((i + reach) * PARTS) as usize;
            let sums = phasors[from..]
                .iter()
                .zip(&weights)
                .fold([0.0; 2], |[c, s], (phasor, weight)| [c + weight * phasor[0], s + weight * phasor[1]]);
            // From the place itself, from which the coordinate is less than half a period away.
            let place = (f64::from(i) + 0.5 / f64::from(PARTS)) / f64::from(GRID);
            let (s0, c0) = sincos(TAU * place / period_px);
            let turned = atan2(sums[1] * c0 - sums[0] * s0, sums[0] * c0 + sums[1] * s0);
            place + turned * period_px / TAU
        });
        Self { shown: shown.collect(), reach }
    }

    /// At a place of the grid.
    fn at(&self, place: f64) -> f64 {
        let number = (place * f64::from(GRID)).round() as i32 + self.reach;
        usize::try_from(number).ok().and_then(|number| self.shown.get(number)).copied().unwrap_or(f64::NAN)
    }
}

/// Where a view shows a coordinate, nearest to a place.
fn found(view: &[(f64, f64)], coordinate: f64, place: f64) -> Option<f64> {
    let shown = view.windows(2).filter(|pair| pair[0].1 <= coordinate && coordinate < pair[1].1);
    let places = shown.map(|pair| {
        let share = (coordinate - pair[0].1) / (pair[1].1 - pair[0].1);
        pair[0].0 + share * (pair[1].0 - pair[0].0)
    });
    places.min_by(|a, b| (a - place).abs().total_cmp(&(b - place).abs()))
}

/// Where the share of the height falls through a level, nearest to the edge.
fn falls_through(profile: &[(f64, f64)], level: f64) -> Option<f64> {
    let falls = profile.windows(2).filter(|pair| pair[0].1 >= level && pair[1].1 < level);
    let places = falls.map(|pair| {
        let [(x0, s0), (x1, s1)] = [pair[0], pair[1]];
        x0 + (s0 - level) / (s0 - s1) * (x1 - x0)
    });
    places.min_by(|a, b| a.abs().total_cmp(&b.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::erf;

    const PAIR: Seen = Seen { footprint_px: 0.577, matched: true, smoothing_px: 1 };
    /// A step of 1 mm before the demo's first pair, px.
    const HEIGHT_PX: f64 = 1.0 / 0.2154;

    fn demo(period_px: Option<f64>) -> Crossing {
        Crossing { tangents: [0.140_54, -0.140_54, 0.0], period_px }
    }

    /// In a view from above, long fringes are moved by h (tan θ' − tan θ) times the normal distribution.
    #[test]
    fn where_no_wall_is_seen_the_coordinate_is_a_mean_of_both_faces() {
        let step = demo(None);
        let view = View::new(&step, [0.140_54, HEIGHT_PX], [0.577, LONG_PX], 200);
        let edge = HEIGHT_PX * 0.140_54;
        for place in [-2.0, -0.5, 0.0, 0.325, 0.65, 1.0, 3.0] {
            let upper = 0.5 * (1.0 - erf((place - edge) / (0.577 * std::f64::consts::SQRT_2)));
            let exact = place - edge * upper;
            assert!((view.at(place) - exact).abs() < 0.01, "{place}: {} {exact}", view.at(place));
        }
    }

    /// By a script of its own, of convolved phasors and matches in drawn pixels: 2.066 and 2.154 px at 9.3 px, 1.674 and 1.857 px at 4.65 px and twice the
    /// pixel, for both edges.
    #[test]
    fn a_dark_wall_widens_an_edge_less_where_fringes_are_short() {
        let width = demo(Some(9.3)).width_px(&PAIR, HEIGHT_PX).unwrap();
        assert!((width - 2.154).abs() < 0.05, "{width}");
        let coarse = demo(Some(4.65)).width_px(&PAIR, 0.5 * HEIGHT_PX).unwrap();
        assert!((coarse - 1.857).abs() < 0.05, "{coarse}");
        let long = demo(None).width_px(&PAIR, HEIGHT_PX).unwrap();
        assert!(long > width && width > 1.2 * PAIR.width_px(), "{long} {width}");
        let mirrored = Crossing { tangents: [-0.140_54, 0.140_54, 0.0], period_px: Some(9.3) };
        assert_eq!(mirrored.width_px(&PAIR, HEIGHT_PX), Some(width));
        // Against a projector there is no reading between pixels.
        let alone = Seen { matched: false, ..PAIR };
        let width = Crossing { tangents: [0.14, -0.14, -0.14], period_px: None };
        let width = width.width_px(&alone, HEIGHT_PX).unwrap();
        assert!((1.5..2.5).contains(&width), "{width}");
    }

    #[test]
    fn views_and_steps_that_show_nothing_have_no_width() {
        let same = Crossing { tangents: [0.1, 0.1, 0.0], period_px: None };
        assert_eq!(same.width_px(&PAIR, HEIGHT_PX), None);
        for height_px in [f64::NAN, 0.0, 1e9, -1.0] {
            assert_eq!(demo(None).width_px(&PAIR, height_px), None, "{height_px}");
        }
        let blurred = Seen { footprint_px: 100.0, ..PAIR };
        assert_eq!(demo(None).width_px(&blurred, HEIGHT_PX), None);
        assert_eq!(demo(Some(1.5)).width_px(&PAIR, HEIGHT_PX), None, "nearly half a period");
    }
}
