//! Lines in space on which edges lie: straight lines, circles, ellipses, B-splines.

use std::f64::consts::TAU;

use fringe::math;
use nalgebra::{Matrix3, Point3, Vector3};

use super::brep_error::BrepError;
use super::spline::Spline;

/// Largest angle between neighbouring pieces of a round line, rad.
pub(super) const ANGLE_RAD: f64 = 0.25;

/// Halvings of a piece of a spline.
const DEEPEST: usize = 14;

/// A right-handed frame: origin, and axes as columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Origin of the frame.
    pub origin: Point3<f64>,
    /// Unit directions of x, y and z, as columns.
    pub axes: Matrix3<f64>,
}

/// A line in space, in mm.
#[derive(Debug, Clone, PartialEq)]
pub enum Curve {
    /// A straight line: its ends tell all.
    Line,
    /// An ellipse about a frame's z with half axes along x and y; a circle where both are equal.
    Ellipse(Frame, [f64; 2]),
    /// A B-spline, which may be rational.
    Spline(Spline),
}

impl Frame {
    /// A point in the frame's own coordinates.
    pub fn local(&self, place: &Point3<f64>) -> Vector3<f64> {
        self.axes.tr_mul(&(place - self.origin))
    }

    fn at(&self, x: f64, y: f64) -> Point3<f64> {
        self.origin + self.axes * Vector3::new(x, y, 0.0)
    }
}

impl Curve {
    /// Points between two ends, without them, in the direction of the edge; `parts` times as many as the line itself needs.
    ///
    /// # Errors
    /// Ends that do not lie on the line.
    pub(super) fn between(
        &self,
        id: u64,
        ends: [Point3<f64>; 2],
        closed: bool,
        along: bool,
        [chord_mm, parts]: [f64; 2],
    ) -> Result<Vec<Point3<f64>>, BrepError> {
        match self {
            Self::Line => {
                let [from, to] = ends;
                let inner = (1..parts as usize).map(|k| from.lerp(&to, k as f64 / parts));
                Ok(inner.collect())
            }
            Self::Ellipse(frame, halves) => {
                for end in &ends {
                    check(id, off_ellipse(frame, *halves, end), halves[0])?;
                }
                Ok(arc(frame, *halves, ends, closed, along, [chord_mm, parts]))
            }
            Self::Spline(spline) => spline.between(id, ends, closed, along, [chord_mm, parts]),
        }
    }
}

/// Refuses ends that lie off their curve by more than CAD systems leave between an edge and its ends.
fn check(edge: u64, off_mm: f64, size_mm: f64) -> Result<(), BrepError> {
    let limit_mm = 0.02 + 1e-5 * size_mm;
    if off_mm <= limit_mm { Ok(()) } else { Err(BrepError::Edge { edge, off_mm, limit_mm }) }
}

/// How far a place lies off an ellipse, about.
fn off_ellipse(frame: &Frame, [a, b]: [f64; 2], place: &Point3<f64>) -> f64 {
    let local = frame.local(place);
    let angle = math::atan2(local.y / b, local.x / a);
    let (sin, cos) = math::sincos(angle);
    (local - Vector3::new(a * cos, b * sin, 0.0)).norm()
}

fn arc(
    frame: &Frame,
    [a, b]: [f64; 2],
    ends: [Point3<f64>; 2],
    closed: bool,
    along: bool,
    [chord_mm, parts]: [f64; 2],
) -> Vec<Point3<f64>> {
    let [from, to] = ends.map(|end| {
        let local = frame.local(&end);
        math::atan2(local.y / b, local.x / a)
    });
    let mut sweep = if along { to - from } else { from - to };
    sweep = if closed { TAU } else { sweep - TAU * (sweep / TAU).floor() };
    let largest = a.max(b);
    let step = ANGLE_RAD.min(2.0 * math::acos((1.0 - 0.5 * chord_mm / largest).max(0.0)));
    let pieces = (parts * (sweep / step).ceil()) as usize;
    let pieces = pieces.clamp(if closed { 8 } else { 1 }, 100_000);
    let signed = if along { sweep } else { -sweep };
    (1..pieces)
        .map(|k| {
            let (sin, cos) = math::sincos(from + signed * k as f64 / pieces as f64);
            frame.at(a * cos, b * sin)
        })
        .collect()
}

impl Spline {
    /// Parameters that lie in each piece between knots.
    fn samples(&self) -> Vec<f64> {
        let knots = self.knots.breaks();
        let mut samples = Vec::with_capacity(8 * knots.len());
        for pair in knots.windows(2) {
            samples.extend((0..8).map(|k| pair[0] + (pair[1] - pair[0]) * f64::from(k) / 8.0));
        }
        samples.extend(knots.last());
        samples
    }

    /// The parameter nearest to a place, and its distance.
    fn nearest(&self, place: &Point3<f64>) -> (f64, f64) {
        let samples = self.samples();
        let distance = |t: f64| (self.at(t) - place).norm();
        let distances: Vec<f64> = samples.iter().map(|t| distance(*t)).collect();
        let best = (0..samples.len()).min_by(|a, b| distances[*a].total_cmp(&distances[*b])).unwrap_or(0);
        let mut low = samples[best.saturating_sub(1)];
        let mut high = samples[(best + 1).min(samples.len() - 1)];
        for _ in 0..80 {
            let [one, two] = [low + 0.382 * (high - low), low + 0.618 * (high - low)];
            if distance(one) <= distance(two) {
                high = two;
            } else {
                low = one;
            }
        }
        let [from, to] = self.knots.domain();
        let candidates = [samples[best], 0.5 * (low + high), from, to];
        let best =
            candidates.into_iter().min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(from);
        (best, distance(best))
    }

    fn between(
        &self,
        id: u64,
        ends: [Point3<f64>; 2],
        closed: bool,
        along: bool,
        [chord_mm, parts]: [f64; 2],
    ) -> Result<Vec<Point3<f64>>, BrepError> {
        let mut points = Vec::new();
        for [from, to] in self.ranges(id, ends, closed, along)? {
            let mut ts = vec![from];
            let (low, high) = (from.min(to), from.max(to));
            ts.extend(self.samples().into_iter().filter(|t| *t > low && *t < high));
            if from > to {
                ts[1..].reverse();
            }
            ts.push(to);
            for pair in ts.windows(2) {
                let at = |k: usize| pair[0] + (pair[1] - pair[0]) * k as f64 / parts;
                for k in 0..parts as usize {
                    self.halve([at(k), at(k + 1)], chord_mm, DEEPEST, &mut points);
                }
            }
        }
        points.pop();
        Ok(if parts > 1.0 { points } else { simplified(ends, &points, chord_mm) })
    }

    /// The parameters from one end to the other: two ranges where the way leads over the place at which a closed spline begins.
    fn ranges(
        &self,
        id: u64,
        ends: [Point3<f64>; 2],
        closed: bool,
        along: bool,
    ) -> Result<Vec<[f64; 2]>, BrepError> {
        let [start, end] = self.knots.domain();
        let shut = (self.at(start) - self.at(end)).norm() < 1e-6;
        let [a, b] = ends.map(|place| self.nearest(&place));
        for (_, off) in [a, b] {
            check(id, off, 0.0)?;
        }
        let near = |t: f64, other: f64| (t - other).abs() <= 1e-9 * (end - start);
        // The start of a closed spline is its end as well.
        let as_start = |t: f64| if shut && near(t, end) { start } else { t };
        let as_end = |t: f64| if shut && near(t, start) { end } else { t };
        let turned = |range: [f64; 2]| if along { range } else { [range[1], range[0]] };
        let [from, to] = turned([a.0, b.0]);
        let ranges = match (closed, shut) {
            // An edge that ends where it begins, on a line that does not, goes from end to end if at all.
            (true, false) => {
                check(id, (self.at(start) - ends[0]).norm(), 0.0)?;
                vec![[start, end]]
            }
            (false, false) => vec![[from, to]],
            (true, true) if as_start(from) == start => vec![[start, end]],
            (true, true) => vec![[from, end], [start, from]],
            (false, true) => {
                let [from, to] = [as_start(from), as_end(to)];
                if from < to { vec![[from, to]] } else { vec![[from, end], [start, to]] }
            }
        };
        let ranges = ranges.into_iter().map(turned);
        Ok(if along { ranges.collect() } else { ranges.rev().collect() })
    }

    /// Points after the start of a piece, up to its end.
    fn halve(&self, [from, to]: [f64; 2], chord_mm: f64, depth: usize, points: &mut Vec<Point3<f64>>) {
        let middle = 0.5 * (from + to);
        let [a, m, b] = [from, middle, to].map(|t| self.at(t));
        let bend = (b - m).angle(&(m - a));
        let flat = (m - nalgebra::center(&a, &b)).norm() <= 0.25 * chord_mm;
        if depth == 0 || (flat && (bend <= ANGLE_RAD || (b - a).norm() <= 0.1 * chord_mm)) {
            points.push(b);
            return;
        }
        self.halve([from, middle], chord_mm, depth - 1, points);
        self.halve([middle, to], chord_mm, depth - 1, points);
    }
}

/// Points without those that a straight piece passes anyway: the first pieces are those between knots, which may be many.
fn simplified(ends: [Point3<f64>; 2], points: &[Point3<f64>], chord_mm: f64) -> Vec<Point3<f64>> {
    let mut kept: Vec<Point3<f64>> = Vec::with_capacity(points.len());
    let (mut last, mut dropped) = (ends[0], 0);
    for (index, point) in points.iter().enumerate() {
        let next = points.get(index + 1).copied().unwrap_or(ends[1]);
        let off = super::super::spatial::nearest_on_segment(last, next, point);
        let (one, two) = (point - last, next - point);
        if (point - off).norm() > 0.05 * chord_mm || one.angle(&two) > 0.1 || dropped == 3 {
            kept.push(*point);
            (last, dropped) = (*point, 0);
        } else {
            dropped += 1;
        }
    }
    kept
}
