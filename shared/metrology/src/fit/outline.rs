//! Outlines in a plane, and the border of a measured surface along them.
//!
//! A cloud has no point on an edge: in a strip of width w along it, with ρ points per square millimetre, the nearest
//! point lies 1/(ρ w) inside on the mean (a Poisson process; a square grid stays within a sixth of its pitch of it). The
//! border of the surface is therefore the outermost point of each strip, moved out by that gap; the sixth of a pitch is
//! part of the sizes' uncertainty. What light does at an edge is not seen here and belongs to `u_system_mm`.

use super::FitError;
use fringe::math;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Most strips along an outline, and their width in spacings of the points.
const MOST_STRIPS: f64 = 360.0;
const STRIP_SPACINGS: f64 = 2.0;

/// Fewest strips with a border, as a share of all: less of an outline does not show its size.
const LEAST_COVERED: f64 = 0.5;

/// Share of the expected points below which a strip lies in shadow.
const LEAST_FILLED: f64 = 0.25;

/// What a square grid's gap may differ from that of random points, in spacings.
const GAP_SPACINGS: f64 = 1.0 / 6.0;

/// Shape of an outline with its sizes, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outline {
    /// A circle of this radius.
    Circle(f64),
    /// A slot: half length of the straight sides, radius of the round ends.
    Slot([f64; 2]),
    /// A rectangle: its two half edges.
    Rectangle([f64; 2]),
    /// A straight edge of this half length; the material lies on the left of its direction.
    Edge(f64),
}

impl Outline {
    /// Signed distance of a place from the outline, positive outside of it (right of an edge), mm, and how far along the
    /// outline its foot lies, mm.
    pub fn see(&self, [u, v]: [f64; 2]) -> (f64, f64) {
        match *self {
            Self::Circle(radius) => ((u * u + v * v).sqrt() - radius, (math::atan2(v, u) + PI) * radius),
            Self::Slot([half, radius]) => {
                let beyond = u.abs() - half;
                if beyond <= 0.0 {
                    let from = if v >= 0.0 { half - u } else { u + half + 2.0 * half + PI * radius };
                    return (v.abs() - radius, from);
                }
                let angle = math::atan2(v, beyond) * if u >= 0.0 { 1.0 } else { -1.0 };
                let start = if u >= 0.0 { 4.0 * half + PI * radius } else { 2.0 * half };
                ((beyond * beyond + v * v).sqrt() - radius, start + (angle + FRAC_PI_2) * radius)
            }
            Self::Rectangle([a, b]) => {
                let (across_u, across_v) = (u.abs() - a, v.abs() - b);
                if across_u > across_v {
                    let from = if u >= 0.0 { v + b } else { 2.0 * b + 2.0 * a + (b - v) };
                    (across_u, from.clamp(0.0, 4.0 * (a + b)))
                } else {
                    let from = if v >= 0.0 { 2.0 * b + (a - u) } else { 4.0 * b + 2.0 * a + (u + a) };
                    (across_v, from.clamp(0.0, 4.0 * (a + b)))
                }
            }
            Self::Edge(half) => (-v, u + half),
        }
    }

    /// Length of the outline, mm.
    pub fn length_mm(&self) -> f64 {
        match *self {
            Self::Circle(radius) => TAU * radius,
            Self::Slot([half, radius]) => 4.0 * half + TAU * radius,
            Self::Rectangle([a, b]) => 4.0 * (a + b),
            Self::Edge(half) => 2.0 * half,
        }
    }

    /// Unit vector out of the outline at the foot of a place.
    pub(super) fn out(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let unit = |x: f64, y: f64| {
            let length = (x * x + y * y).sqrt();
            if length > 0.0 { [x / length, y / length] } else { [1.0, 0.0] }
        };
        match *self {
            Self::Circle(_) => unit(u, v),
            Self::Slot([half, _]) => unit((u.abs() - half).max(0.0) * u.signum(), v),
            Self::Rectangle([a, b]) => {
                if u.abs() - a > v.abs() - b {
                    [u.signum(), 0.0]
                } else {
                    [0.0, v.signum()]
                }
            }
            Self::Edge(_) => [0.0, -1.0],
        }
    }

    /// How far a place along the outline lies from the nearest corner or end, mm; none where there is no corner.
    pub(super) fn corner_distance_mm(&self, along: f64) -> f64 {
        match *self {
            Self::Circle(_) | Self::Slot(_) => f64::INFINITY,
            Self::Rectangle([a, b]) => {
                let corners = [0.0, 2.0 * b, 2.0 * (a + b), 4.0 * b + 2.0 * a, 4.0 * (a + b)];
                corners.iter().map(|c| (along - c).abs()).fold(f64::INFINITY, f64::min)
            }
            Self::Edge(half) => along.min(2.0 * half - along),
        }
    }

    /// Sizes as they are reported: diameter; length and width of a slot or rectangle; none of an edge.
    pub fn sizes_mm(&self) -> [f64; 2] {
        match *self {
            Self::Circle(radius) => [2.0 * radius, 0.0],
            Self::Slot([half, radius]) => [2.0 * (half + radius), 2.0 * radius],
            Self::Rectangle([a, b]) => [2.0 * a, 2.0 * b],
            Self::Edge(_) => [0.0, 0.0],
        }
    }
}

/// An outline in its plane: where its middle lies, how it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Shape with its sizes, mm.
    pub outline: Outline,
    /// Middle of the outline, mm.
    pub center: [f64; 2],
    /// Turn of the first direction, rad.
    pub turn_rad: f64,
}

impl Placed {
    /// A place of the plane in the outline's own directions.
    pub(super) fn local(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = math::sincos(self.turn_rad);
        let (dx, dy) = (x - self.center[0], y - self.center[1]);
        [dx * cos + dy * sin, dy * cos - dx * sin]
    }

    /// A direction of the outline in the plane.
    pub(super) fn global(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        let (sin, cos) = math::sincos(self.turn_rad);
        [u * cos - v * sin, u * sin + v * cos]
    }

    /// Signed distance of a place, mm, positive outside, and how far along the outline its foot lies, mm.
    pub fn see(&self, place: [f64; 2]) -> (f64, f64) {
        self.outline.see(self.local(place))
    }
}

/// The border of a surface along an outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Border {
    /// Points of the border, mm.
    pub points: Vec<[f64; 2]>,
    /// Mean spacing of the surface's points, mm.
    pub spacing_mm: f64,
    /// How far each border point was moved out of the material, mm.
    pub gap_mm: f64,
}

/// Finds where a surface ends near an outline. `hole`: the material lies outside of it. Points deeper than `band_mm` in
/// the material, and within `corner_mm` of a corner or end, are not looked at.
///
/// # Errors
/// Too few points, or an outline that the surface borders along less than half of its length.
pub fn border(
    points: &[[f64; 2]],
    near: &Placed,
    hole: bool,
    band_mm: f64,
    corner_mm: f64,
) -> Result<Border, FitError> {
    let (length, outline) = (near.outline.length_mm(), &near.outline);
    // An edge's material lies on its left, where the distance is negative.
    let sign = if hole { 1.0 } else { -1.0 };
    let depth = |place: &[f64; 2]| {
        let (distance, along) = near.see(*place);
        (sign * distance, along)
    };
    let seen: Vec<(f64, f64, usize)> = points
        .iter()
        .enumerate()
        .map(|(index, place)| (depth(place), index))
        .filter(|((depth, along), _)| {
            *depth <= band_mm
                && (0.0..=length).contains(along)
                && outline.corner_distance_mm(*along) >= corner_mm
        })
        .map(|((depth, along), index)| (depth, along, index))
        .collect();
    let deep = seen.iter().filter(|(depth, ..)| *depth > band_mm / 3.0).count();
    let closed = !matches!(outline, Outline::Edge(_));
    let middle = if closed { sign * TAU * band_mm * 2.0 / 3.0 } else { 0.0 };
    let covered = covered_mm(outline, corner_mm);
    let area = (covered + middle).max(0.1 * covered) * band_mm * 2.0 / 3.0;
    let density = deep as f64 / area;
    if deep < 10 {
        return Err(FitError::TooFewPoints { element: "outline", points: deep, needs: 10 });
    }
    let spacing_mm = 1.0 / density.sqrt();
    let strips = (length / (STRIP_SPACINGS * spacing_mm)).floor().clamp(8.0, MOST_STRIPS);
    let width = length / strips;
    let gap_mm = 1.0 / (density * width);
    let mut outermost: Vec<Option<(f64, usize)>> = vec![None; strips as usize];
    let mut counts = vec![0usize; strips as usize];
    for (depth, along, index) in &seen {
        let strip = ((along / width) as usize).min(outermost.len() - 1);
        counts[strip] += 1;
        if outermost[strip].is_none_or(|(least, _)| *depth < least) {
            outermost[strip] = Some((*depth, *index));
        }
    }
    let enough = (LEAST_FILLED * density * width * band_mm).max(2.0);
    let found: Vec<[f64; 2]> = outermost
        .iter()
        .zip(&counts)
        .filter(|(_, count)| **count as f64 >= enough)
        .filter_map(|(point, _)| *point)
        .map(|(_, index)| {
            let place = points[index];
            let [x, y] = near.global(outline.out(near.local(place)));
            [place[0] - sign * gap_mm * x, place[1] - sign * gap_mm * y]
        })
        .collect();
    if (found.len() as f64) < LEAST_COVERED * strips * covered / length {
        return Err(FitError::Degenerate {
            element: "outline",
            why: "less than half of it borders the surface",
        });
    }
    Ok(Border { points: found, spacing_mm, gap_mm })
}

/// Length of an outline without its corners, mm.
fn covered_mm(outline: &Outline, corner_mm: f64) -> f64 {
    let corners = match outline {
        Outline::Rectangle(_) => 4.0,
        Outline::Edge(_) => 1.0,
        _ => 0.0,
    };
    (outline.length_mm() - 2.0 * corner_mm * corners).max(0.0)
}

/// What a square grid adds to the uncertainty of a border, mm: a sixth of the spacing, evenly distributed.
pub fn u_gap_mm(spacing_mm: f64) -> f64 {
    GAP_SPACINGS * spacing_mm / 3f64.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The foot runs along the whole outline once, and the distance is that of the nearest of its points.
    #[test]
    fn distances_and_feet_agree_with_walking_along_the_outline() {
        let walk = |outline: &Outline, along: f64| -> [f64; 2] {
            match *outline {
                Outline::Circle(r) => {
                    let (s, c) = math::sincos(along / r - PI);
                    [r * c, r * s]
                }
                Outline::Slot([a, r]) => {
                    let turn = PI * r;
                    if along < 2.0 * a {
                        [a - along, r]
                    } else if along < 2.0 * a + turn {
                        let (s, c) = math::sincos((along - 2.0 * a) / r - FRAC_PI_2);
                        [-a - r * c, -r * s]
                    } else if along < 4.0 * a + turn {
                        [along - 3.0 * a - turn, -r]
                    } else {
                        let (s, c) = math::sincos((along - 4.0 * a - turn) / r - FRAC_PI_2);
                        [a + r * c, r * s]
                    }
                }
                Outline::Rectangle([a, b]) => {
                    if along < 2.0 * b {
                        [a, along - b]
                    } else if along < 2.0 * (a + b) {
                        [a - (along - 2.0 * b), b]
                    } else if along < 4.0 * b + 2.0 * a {
                        [-a, b - (along - 2.0 * (a + b))]
                    } else {
                        [along - 4.0 * b - 2.0 * a - a, -b]
                    }
                }
                Outline::Edge(half) => [along - half, 0.0],
            }
        };
        let shapes = [
            Outline::Circle(3.0),
            Outline::Slot([4.0, 1.5]),
            Outline::Rectangle([3.0, 2.0]),
            Outline::Edge(6.0),
        ];
        for shape in shapes {
            let length = shape.length_mm();
            for i in 0..200 {
                let along = (f64::from(i) + 0.5) / 200.0 * length;
                let foot = walk(&shape, along);
                let out = shape.out(foot);
                for distance in [-0.1, 0.0, 0.3] {
                    let place = [foot[0] + distance * out[0], foot[1] + distance * out[1]];
                    let (seen, at) = shape.see(place);
                    if shape.corner_distance_mm(along) > 0.4 {
                        assert!((seen - distance).abs() < 1e-12, "{shape:?} at {along}: {seen}");
                        assert!((at - along).abs() < 1e-9, "{shape:?}: {at} for {along}");
                    }
                }
            }
        }
    }
}
