//! Outlines in a plane: circle, slot, rectangle and straight edge; see [`super::border`] for where a surface ends along them.

use fringe::math;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

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

    /// Pieces of one curvature: where each begins and ends along the outline, without what lies within `corner_mm` of a corner or
    /// end, mm; and the radius of a round one.
    pub(super) fn pieces(&self, corner_mm: f64) -> Vec<(f64, f64, Option<f64>)> {
        let length = self.length_mm();
        let pieces = match *self {
            Self::Circle(radius) => vec![(0.0, length, Some(radius))],
            Self::Slot([half, radius]) => {
                let (straight, round) = (2.0 * half, PI * radius);
                vec![
                    (0.0, straight, None),
                    (straight, straight + round, Some(radius)),
                    (straight + round, 2.0 * straight + round, None),
                    (2.0 * straight + round, length, Some(radius)),
                ]
            }
            Self::Rectangle([a, b]) => {
                let ends = [0.0, 2.0 * b, 2.0 * (a + b), 4.0 * b + 2.0 * a, length];
                ends.windows(2).map(|e| (e[0] + corner_mm, e[1] - corner_mm, None)).collect()
            }
            Self::Edge(_) => vec![(corner_mm, length - corner_mm, None)],
        };
        pieces.into_iter().filter(|(start, end, _)| end > start).collect()
    }

    /// How far a place along the outline lies from the nearest corner or end, mm; none where there is no corner.
    #[cfg(test)]
    fn corner_distance_mm(&self, along: f64) -> f64 {
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
