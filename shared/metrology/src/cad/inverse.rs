//! Parameters of points: the nearest place of a surface of two parameters.

use nalgebra::{Point3, Vector3};

use super::freeform::Freeform;

/// Most places of a surface that are looked at first.
const MOST_PLACES: usize = 1_000_000;

/// Steps of a search.
const MOST_STEPS: usize = 30;

/// Searches from further places begin where the first one ends farther off than this, mm.
const ON_SURFACE_MM: f64 = 0.02;

/// Most searches for a point.
const MOST_SEARCHES: usize = 12;

/// A part of a surface: the range of both parameters, and in which directions it closes.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub surface: Freeform,
    /// First and last parameter of each direction.
    pub domain: [[f64; 2]; 2],
    /// Whether the end of a direction is its start again.
    pub closed: [bool; 2],
}

/// Places of a part, from which searches begin.
pub(super) struct Places {
    breaks: [Vec<f64>; 2],
    points: Vec<Point3<f64>>,
}

impl Part {
    /// The part of a surface that its border lies on.
    pub fn new(surface: &Freeform, border: &[Point3<f64>]) -> Self {
        let mut domain = surface.domain();
        if let Some(direction) = surface.endless() {
            let along = |p: &Point3<f64>| p.coords.dot(direction);
            let us = surface.breaks(|degree| degree + 1)[0].clone();
            let own = range(us.iter().map(|u| along(&surface.with_tangents([*u, 0.0]).0)));
            let all = range(border.iter().map(along));
            let pad = 1.0 + 0.1 * (own[1] - own[0]);
            domain[1] = [all[0] - own[1] - pad, all[1] - own[0] + pad];
        }
        let mut part = Self { surface: surface.clone(), domain, closed: [false; 2] };
        part.closed = [0, 1].map(|direction| part.is_closed(direction));
        let sides = surface.sides_of_axis().map(|sides| sides.map(|side| part.cut(side)));
        // An ellipse across the axis makes its surface twice, or an inner and an outer one: that on which the border lies.
        sides
            .and_then(|sides| sides.into_iter().min_by(|a, b| a.off(border).total_cmp(&b.off(border))))
            .unwrap_or(part)
    }

    /// The part between two parameters of the second direction.
    fn cut(&self, across: [f64; 2]) -> Self {
        Self {
            surface: self.surface.clone(),
            domain: [self.domain[0], across],
            closed: [self.closed[0], false],
        }
    }

    /// How far some points lie off at most, in steps of a hundredth of what an edge may lie off, mm.
    fn off(&self, points: &[Point3<f64>]) -> f64 {
        let places = self.places();
        let worst = points.iter().map(|p| self.nearest(&places, p).1).fold(0.0, f64::max);
        (worst / (0.01 * ON_SURFACE_MM)).round()
    }

    /// The parameters in range: around where the part closes, else at its end.
    pub fn within(&self, place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| {
            let [from, to] = self.domain[i];
            if self.closed[i] {
                let length = to - from;
                place[i] - length * ((place[i] - from) / length).floor()
            } else {
                place[i].clamp(from, to)
            }
        })
    }

    /// The point of a place with its tangents.
    pub fn at(&self, place: [f64; 2]) -> (Point3<f64>, [Vector3<f64>; 2]) {
        self.surface.with_tangents(self.within(place))
    }

    /// Shares of a direction, evenly.
    fn shares(&self, direction: usize) -> impl Iterator<Item = f64> + use<> {
        let [from, to] = self.domain[direction];
        (0..=16).map(move |k| from + (to - from) * f64::from(k) / 16.0)
    }

    /// A place by its parameter in one direction and in the other.
    fn place(direction: usize, own: f64, other: f64) -> [f64; 2] {
        if direction == 0 { [own, other] } else { [other, own] }
    }

    fn is_closed(&self, direction: usize) -> bool {
        let [from, to] = self.domain[direction];
        let ends = |other: f64| {
            [from, to].map(|own| self.surface.with_tangents(Self::place(direction, own, other)).0)
        };
        let (mut apart, mut size) = (0.0_f64, 0.0_f64);
        for other in self.shares(1 - direction) {
            let [a, b] = ends(other);
            apart = apart.max((b - a).norm());
            let middle = Self::place(direction, 0.5 * (from + to), other);
            size = size.max((self.surface.with_tangents(middle).0 - a).norm());
        }
        apart <= 1e-6 * size + 1e-7 && size > 0.0
    }

    /// Whether an end of a direction (0: its start) is one point: a pole.
    pub fn is_pole(&self, direction: usize, end: usize) -> bool {
        if self.closed[direction] {
            return false;
        }
        let points: Vec<Point3<f64>> = self
            .shares(1 - direction)
            .map(|other| self.at(Self::place(direction, self.domain[direction][end], other)).0)
            .collect();
        points.iter().all(|p| (p - points[0]).norm() <= 1e-5)
    }

    /// Mean length of the part along a direction, mm.
    pub fn length_mm(&self, direction: usize) -> f64 {
        let mut sum = 0.0;
        for other in self.shares(1 - direction) {
            let line: Vec<Point3<f64>> =
                self.shares(direction).map(|own| self.at(Self::place(direction, own, other)).0).collect();
            sum += line.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum::<f64>();
        }
        sum / 17.0
    }

    /// Places from which to search, over the whole part.
    pub fn places(&self) -> Places {
        let mut breaks = self.surface.breaks(|degree| degree.min(6) + 1);
        if breaks[0].len() * breaks[1].len() > MOST_PLACES {
            breaks = self.surface.breaks(|_| 1);
        }
        if self.domain[1] != self.surface.domain()[1] {
            let [from, to] = self.domain[1];
            breaks[1] = (0..=16).map(|k| from + (to - from) * f64::from(k) / 16.0).collect();
        }
        let mut points = Vec::with_capacity(breaks[0].len() * breaks[1].len());
        for u in &breaks[0] {
            points.extend(breaks[1].iter().map(|v| self.surface.with_tangents([*u, *v]).0));
        }
        Places { breaks, points }
    }

    /// The place nearest to a point from a place near it, and its distance.
    pub fn foot(&self, point: &Point3<f64>, from: [f64; 2]) -> ([f64; 2], f64) {
        let mut place = self.within(from);
        let (mut at, mut tangents) = self.at(place);
        let mut distance = (at - point).norm();
        let mut damping = 0.0;
        for _ in 0..MOST_STEPS {
            let off = point - at;
            let step = step(&tangents, &off, damping);
            let wanted = [place[0] + step[0], place[1] + step[1]];
            let next = if self.closed == [true; 2] { wanted } else { self.clamped(wanted) };
            let moved = tangents[0] * (next[0] - place[0]) + tangents[1] * (next[1] - place[1]);
            let (there, slopes) = self.at(next);
            let found = (there - point).norm();
            if found < distance {
                (place, at, tangents, distance) = (next, there, slopes, found);
                damping *= 0.1;
                if damping < 1e-9 {
                    damping = 0.0;
                }
                if moved.norm() <= 1e-10 {
                    break;
                }
            } else {
                if moved.norm() <= 1e-9 || damping > 1e6 {
                    break;
                }
                damping = (damping * 10.0).max(1e-3);
            }
        }
        (place, distance)
    }

    /// As [`Self::within`], but further round where the part closes.
    fn clamped(&self, place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| {
            if self.closed[i] { place[i] } else { place[i].clamp(self.domain[i][0], self.domain[i][1]) }
        })
    }

    /// The place nearest to a point, searched from the nearest places of the whole part; and its distance.
    pub fn nearest(&self, places: &Places, point: &Point3<f64>) -> ([f64; 2], f64) {
        let squares: Vec<f64> = places.points.iter().map(|p| (p - point).norm_squared()).collect();
        let first = (0..squares.len()).min_by(|a, b| squares[*a].total_cmp(&squares[*b])).unwrap_or(0);
        let mut best = self.foot(point, places.place(first));
        if best.1 > ON_SURFACE_MM {
            let mut others = places.hollows(&squares);
            others.sort_by(|a, b| squares[*a].total_cmp(&squares[*b]));
            for other in others.into_iter().take(MOST_SEARCHES) {
                let found = self.foot(point, places.place(other));
                if found.1 < best.1 {
                    best = found;
                }
            }
        }
        (self.within(best.0), best.1)
    }
}

/// A step of least squares towards a point, in both parameters.
fn step([along, across]: &[Vector3<f64>; 2], off: &Vector3<f64>, damping: f64) -> [f64; 2] {
    let (aa, ab, bb) = (along.norm_squared(), along.dot(across), across.norm_squared());
    let (a, b) = (along.dot(off), across.dot(off));
    let [aa, bb] = [aa, bb].map(|square| square * (1.0 + damping) + f64::MIN_POSITIVE);
    let determinant = aa * bb - ab * ab;
    if determinant > 1e-12 * aa * bb {
        [(a * bb - b * ab) / determinant, (b * aa - a * ab) / determinant]
    } else if aa >= bb {
        [a / aa, 0.0]
    } else {
        [0.0, b / bb]
    }
}

impl Places {
    fn place(&self, index: usize) -> [f64; 2] {
        let count = self.breaks[1].len();
        [self.breaks[0][index / count], self.breaks[1][index % count]]
    }

    /// Places that are nearer than those around them.
    fn hollows(&self, squares: &[f64]) -> Vec<usize> {
        let [rows, count] = [self.breaks[0].len(), self.breaks[1].len()];
        let nearer = |index: &usize| {
            let (row, column) = (index / count, index % count);
            let beside = [
                (row > 0).then(|| index - count),
                (row + 1 < rows).then(|| index + count),
                (column > 0).then(|| index - 1),
                (column + 1 < count).then(|| index + 1),
            ];
            beside.into_iter().flatten().all(|other| squares[*index] <= squares[other])
        };
        (0..squares.len()).filter(nearer).collect()
    }
}

/// Least and largest of some values; zeros where there are none.
pub(super) fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] =
        values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)]);
    if low <= high { [low, high] } else { [0.0, 0.0] }
}
