//! Plane charts of surfaces of two parameters: one to one on a face, without seams and poles.
//!
//! The parameters themselves where a surface closes in no direction, drawn together towards a pole; an annulus or a disc about a pole where it
//! closes in one; where it closes in both it is cut where no border lies.

use std::f64::consts::TAU;

use fringe::math;
use nalgebra::{Point3, Vector3};

use super::freeform::{Freeform, normal_of};
use super::inverse::Part;

/// Largest logarithm of a radius in a chart; beyond, the chart is compressed.
const LARGEST_LOG: f64 = 40.0;

/// Triangles stay within this share of the distance at the places that are looked at.
pub(super) const SHARE: f64 = 0.8;

/// A triangle is looked at at the places of a lattice with so many pieces on a side.
const LATTICE: usize = 4;

/// Cosine between normals at the corners of a triangle.
const BEND_COSINE: f64 = 0.877;

/// Triangles not higher than this many distances do not count as bent: creases within a surface have no normal, and sides that are edges stay.
const CREASE: f64 = 4.0;

/// Most places of a face that are given before its triangles are looked at.
const MOST_NODES: usize = 40_000;

/// A chart of a part of a surface.
#[derive(Debug, Clone)]
pub(super) struct Sheet {
    part: Part,
    /// Parameters of the points of the border, in their order.
    border: Vec<[f64; 2]>,
    layout: Layout,
    /// Whether the second parameter goes around or to the right, the first one outwards or up.
    swapped: bool,
    /// First and last parameter of the direction across, which may be cut out of a whole turn.
    across: [f64; 2],
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Layout {
    /// Both parameters, scaled; drawn together at the start, at the end, or at both.
    Flat { scale: [f64; 2], poles: [bool; 2] },
    /// Around without a pole: the logarithm of the radius falls outwards.
    Ring { logs: f64 },
    /// Around a pole at the start; whether the end is one as well.
    FromStart { other_pole: bool },
    /// Around a pole at the end; whether the start is one as well.
    FromEnd { other_pole: bool },
}

impl Sheet {
    /// Charts to try, in this order: the right one has the face on the left of its borders.
    pub fn candidates(surface: &Freeform, points: &[Point3<f64>]) -> Vec<Self> {
        let part = Part::new(surface, points);
        let places = part.places();
        let border: Vec<[f64; 2]> = points.iter().map(|p| part.nearest(&places, p).0).collect();
        match part.closed {
            [false, false] => {
                let poles = [0, 1].map(|direction| [0, 1].map(|end| part.is_pole(direction, end)));
                let swapped = poles[1] == [false; 2] && poles[0] != [false; 2];
                let own = usize::from(!swapped);
                let lengths = [part.length_mm(1 - own), part.length_mm(own)];
                let spans = [1 - own, own].map(|i| part.domain[i][1] - part.domain[i][0]);
                let scale = [0, 1].map(|i| (lengths[i] / spans[i]).max(1e-9));
                let across = part.domain[own];
                vec![Self {
                    part,
                    border,
                    layout: Layout::Flat { scale, poles: poles[own] },
                    swapped,
                    across,
                }]
            }
            [true, false] => Self::around(&part, &border, false, part.domain[1]),
            [false, true] => Self::around(&part, &border, true, part.domain[0]),
            [true, true] => {
                let cut = |swapped: bool| {
                    let gaps = gaps(&part, &border, usize::from(!swapped));
                    gaps.into_iter()
                        .flat_map(|across| Self::around(&part, &border, swapped, across))
                        .collect()
                };
                let both: [Vec<Self>; 2] = [cut(false), cut(true)];
                both.into_iter().flatten().collect()
            }
        }
    }

    /// Charts of a part that closes in one direction, between two parameters of the other.
    fn around(part: &Part, border: &[[f64; 2]], swapped: bool, across: [f64; 2]) -> Vec<Self> {
        let direction = usize::from(!swapped);
        let mut cut = part.clone();
        cut.domain[direction] = across;
        cut.closed[direction] = false;
        let layouts = match [cut.is_pole(direction, 0), cut.is_pole(direction, 1)] {
            [false, false] => {
                let ratio = cut.length_mm(direction) / cut.length_mm(1 - direction).max(1e-9);
                vec![Layout::Ring { logs: (TAU * ratio).clamp(0.05, LARGEST_LOG) }]
            }
            [true, false] => vec![Layout::FromStart { other_pole: false }],
            [false, true] => vec![Layout::FromEnd { other_pole: false }],
            [true, true] => {
                vec![Layout::FromStart { other_pole: true }, Layout::FromEnd { other_pole: true }]
            }
        };
        let sheet = |layout| Self { part: part.clone(), border: border.to_vec(), layout, swapped, across };
        layouts.into_iter().map(sheet).collect()
    }

    /// Whether the surface's own normal is seen when triangles turn counter-clockwise.
    pub fn positive(&self) -> bool {
        let upright = !matches!(self.layout, Layout::FromStart { .. });
        upright != self.swapped
    }

    /// Where the points of the border lie in the chart.
    pub fn border(&self) -> Vec<[f64; 2]> {
        self.border.iter().map(|place| self.flat(*place)).collect()
    }

    /// Where a point of the surface lies in the chart.
    pub fn place(&self, point: &Point3<f64>) -> [f64; 2] {
        self.flat(self.part.nearest(&self.part.places(), point).0)
    }

    /// Where a place of the surface lies in the chart.
    fn flat(&self, place: [f64; 2]) -> [f64; 2] {
        let [turned, along] = if self.swapped { [place[1], place[0]] } else { place };
        let along = self.beyond_cut(along);
        let share = (along - self.across[0]) / (self.across[1] - self.across[0]);
        let radius = match self.layout {
            Layout::Flat { scale, poles } => {
                let middle = 0.5 * (self.around_domain()[0] + self.around_domain()[1]);
                return [(turned - middle) * scale[0] * drawn(poles, share), along * scale[1]];
            }
            Layout::Ring { logs } => math::exp(logs * (0.5 - share)),
            Layout::FromStart { other_pole } => outwards(share, other_pole),
            Layout::FromEnd { other_pole } => outwards(1.0 - share, other_pole),
        };
        let [from, to] = self.around_domain();
        let (sin, cos) = math::sincos(TAU * (turned - from) / (to - from));
        [radius * cos, radius * sin]
    }

    /// The parameters of a place of the chart.
    fn parameters(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [from, to] = self.around_domain();
        let length = (x * x + y * y).sqrt();
        let angle = if length > 0.0 { math::atan2(y, x) } else { 0.0 };
        let turned = from + (to - from) * (angle / TAU);
        let (turned, share) = match self.layout {
            Layout::Flat { scale, poles } => {
                let share = (y / scale[1] - self.across[0]) / (self.across[1] - self.across[0]);
                let width = drawn(poles, share.clamp(0.0, 1.0));
                let arm = if width > 1e-12 { x / (scale[0] * width) } else { 0.0 };
                (0.5 * (from + to) + arm, share)
            }
            Layout::Ring { logs } => (turned, 0.5 - math::ln(length.max(1e-300)) / logs),
            Layout::FromStart { other_pole } => (turned, inwards(length, other_pole)),
            Layout::FromEnd { other_pole } => (turned, 1.0 - inwards(length, other_pole)),
        };
        let along = self.across[0] + share * (self.across[1] - self.across[0]);
        if self.swapped { [along, turned] } else { [turned, along] }
    }

    /// The range of the parameter that goes around or to the right.
    fn around_domain(&self) -> [f64; 2] {
        self.part.domain[usize::from(self.swapped)]
    }

    /// A parameter across, counted from the cut of a whole turn.
    fn beyond_cut(&self, along: f64) -> f64 {
        let direction = usize::from(!self.swapped);
        if !self.part.closed[direction] {
            return along;
        }
        let length = self.part.domain[direction][1] - self.part.domain[direction][0];
        // What lies in the gap before the start belongs there, by a hair.
        let gap = 0.5 * (length - (self.across[1] - self.across[0]));
        along - length * ((along - self.across[0] + gap) / length).floor()
    }

    /// The point of the surface at a place of the chart.
    pub fn lift(&self, place: [f64; 2]) -> Point3<f64> {
        self.part.at(self.parameters(place)).0
    }

    /// Whether a triangle lies too far off its surface, or spans too much of its curvature. Sides that are fixed (from each corner to the next) are
    /// edges of the solid: no more can be asked for than what they leave.
    pub fn is_off(
        &self,
        places: &[[f64; 2]; 3],
        corners: &[Point3<f64>; 3],
        fixed: [bool; 3],
        chord_mm: f64,
    ) -> bool {
        let mut own = (0..3).map(|i| (self.lift(places[i]) - corners[i]).norm()).fold(0.0, f64::max);
        let mut off = 0.0_f64;
        for shares in lattice() {
            let found = self.off_mm(places, corners, &shares);
            if (0..3).any(|i| fixed[i] && shares[(i + 2) % 3] == 0.0) {
                own = own.max(found);
            }
            off = off.max(found);
        }
        off > (SHARE * chord_mm).max(own + 0.2 * chord_mm) || self.is_bent(places, corners, chord_mm)
    }

    /// How far a point of a triangle lies off its surface, mm.
    fn off_mm(&self, places: &[[f64; 2]; 3], corners: &[Point3<f64>; 3], shares: &[f64; 3]) -> f64 {
        let mut point = Vector3::zeros();
        let mut place = [0.0; 2];
        for ((corner, flat), share) in corners.iter().zip(places).zip(shares) {
            point += corner.coords * *share;
            place = [place[0] + flat[0] * share, place[1] + flat[1] * share];
        }
        self.part.foot(&Point3::from(point), self.parameters(place)).1
    }

    fn is_bent(&self, places: &[[f64; 2]; 3], corners: &[Point3<f64>; 3], chord_mm: f64) -> bool {
        let [a, b, c] = corners;
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        let height = (b - a).cross(&(c - a)).norm() / longest.max(f64::MIN_POSITIVE);
        if height <= CREASE * chord_mm {
            return false;
        }
        let normals = places.map(|place| normal_of(&self.part.at(self.parameters(place)).1));
        let zero = normals.iter().any(|n| n.norm_squared() < 0.5);
        !zero && (0..3).any(|i| normals[i].dot(&normals[(i + 1) % 3]) < BEND_COSINE)
    }

    /// Places within the chart where pieces of the surface meet: triangles do not reach over several of them.
    pub fn nodes(&self) -> Vec<[f64; 2]> {
        let breaks = self.part.surface.breaks(|degree| degree.div_ceil(4));
        if self.part.domain[1] != self.part.surface.domain()[1] || breaks.iter().any(|b| b.len() <= 2) {
            return Vec::new();
        }
        let stride = |count: usize| count.div_ceil((MOST_NODES as f64).sqrt() as usize).max(1);
        let [us, vs] = &breaks;
        let mut nodes = Vec::new();
        for u in us.iter().step_by(stride(us.len())) {
            nodes.extend(vs.iter().step_by(stride(vs.len())).map(|v| self.flat([*u, *v])));
        }
        nodes.retain(|[x, y]| x.is_finite() && y.is_finite());
        nodes
    }
}

/// Shares of the corners at the places where a triangle is looked at.
pub(super) fn lattice() -> impl Iterator<Item = [f64; 3]> {
    let part = |count: usize| count as f64 / LATTICE as f64;
    (0..=LATTICE)
        .flat_map(|a| (0..=LATTICE - a).map(move |b| [a, b, LATTICE - a - b]))
        .filter(|counts| !counts.contains(&LATTICE))
        .map(move |counts| counts.map(part))
}

/// How wide a direction is left beside poles.
fn drawn(poles: [bool; 2], share: f64) -> f64 {
    match poles {
        [false, false] => 1.0,
        [true, false] => share,
        [false, true] => 1.0 - share,
        [true, true] => 4.0 * share * (1.0 - share),
    }
}

/// Radius about a pole; another pole lies infinitely far off.
fn outwards(share: f64, other_pole: bool) -> f64 {
    let share = share.max(0.0);
    if other_pole { share / (1.0 - share).max(1e-9) } else { share }
}

/// The share of a radius about a pole.
fn inwards(radius: f64, other_pole: bool) -> f64 {
    if other_pole { radius / (1.0 + radius) } else { radius }
}

/// Ranges of a closed direction between which no border lies, the widest gaps first.
fn gaps(part: &Part, border: &[[f64; 2]], direction: usize) -> Vec<[f64; 2]> {
    let [from, to] = part.domain[direction];
    let mut along: Vec<f64> = border.iter().map(|place| place[direction]).collect();
    along.sort_unstable_by(f64::total_cmp);
    let Some(first) = along.first().copied() else { return Vec::new() };
    let mut gaps: Vec<[f64; 2]> = (0..along.len())
        .map(|i| [along[i], along.get(i + 1).copied().unwrap_or(first + to - from)])
        .filter(|[before, after]| after - before > 0.01 * (to - from))
        .collect();
    gaps.sort_by(|a, b| (b[1] - b[0]).total_cmp(&(a[1] - a[0])));
    // The part goes from the end of the gap once round to its start.
    let rest = |[before, after]: [f64; 2]| [after, before + to - from];
    gaps.into_iter().take(3).map(rest).filter(|[start, end]| end - start > 1e-9 * (to - from)).collect()
}
