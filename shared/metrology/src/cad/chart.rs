//! Plane charts of elementary surfaces: one to one on a face, without seams.
//!
//! A cylinder, a cone and the ring of a torus become an annulus about the origin (angle stays angle, the other coordinate the logarithm of the
//! radius), a sphere a plane by stereographic projection from a pole beside the face. A line all around closes in the chart by itself, and a
//! seam is a slit that is walked forth and back.

use std::f64::consts::{PI, TAU};

use fringe::math;
use nalgebra::{Point3, Vector3};

use super::inverse::range;
use super::shape::{CadShape, Surface, across};
use super::sheet::Sheet;
use crate::fit::tangents;

/// Largest logarithm of a radius in a chart; beyond, the chart is compressed.
const LARGEST_LOG: f64 = 40.0;

/// A chart with the sides that it has.
#[derive(Debug, Clone)]
pub(super) struct Chart {
    kind: Kind,
    /// Whether the surface's own normal is seen when triangles turn counter-clockwise.
    pub positive: bool,
}

#[derive(Debug, Clone)]
enum Kind {
    Flat { at: Point3<f64>, x: Vector3<f64>, y: Vector3<f64> },
    Cylinder { at: Point3<f64>, axes: [Vector3<f64>; 3], radius: f64, scale: f64 },
    Cone { tip: Point3<f64>, axes: [Vector3<f64>; 3], half_angle: f64, unit_mm: f64, power: f64 },
    Sphere { at: Point3<f64>, axes: [Vector3<f64>; 3], radius: f64 },
    Torus(Torus),
    Sheet(Box<Sheet>),
}

/// A torus that is cut open across or along its tube.
#[derive(Debug, Clone)]
struct Torus {
    at: Point3<f64>,
    axes: [Vector3<f64>; 3],
    ring: f64,
    tube: f64,
    cut: f64,
    scale: f64,
    about_tube: bool,
}

impl Chart {
    /// Charts to try, in this order: the right one has the face on the left of its borders.
    pub fn candidates(surface: &Surface, border: &[Point3<f64>]) -> Vec<Self> {
        let shape = match surface {
            Surface::Element(shape) => shape,
            Surface::Free(free) => {
                let own =
                    |sheet: Sheet| Self { positive: sheet.positive(), kind: Kind::Sheet(Box::new(sheet)) };
                return Sheet::candidates(free, border).into_iter().map(own).collect();
            }
        };
        let frame = |axis: &Vector3<f64>| {
            let [x, y] = tangents(axis);
            [x, y, *axis]
        };
        let of = |kind, positive| vec![Self { kind, positive }];
        match shape {
            CadShape::Plane { point_mm, normal } => {
                let [x, y] = tangents(normal);
                of(Kind::Flat { at: *point_mm, x, y }, true)
            }
            CadShape::Cylinder { point_mm, axis, radius_mm } => {
                let heights = border.iter().map(|p| (p - point_mm).dot(axis));
                let [low, high] = range(heights);
                let scale = (1.0 / radius_mm).min(LARGEST_LOG / (high - low).max(1e-9));
                let at = point_mm + axis * (0.5 * (low + high));
                of(Kind::Cylinder { at, axes: frame(axis), radius: *radius_mm, scale }, true)
            }
            CadShape::Cone { point_mm, axis, radius_mm, half_angle_rad } => {
                let tip = point_mm - axis * (radius_mm / math::tan(*half_angle_rad));
                let slants = border.iter().map(|p| (p - tip).norm()).filter(|s| *s > 1e-9);
                let [low, high] = range(slants);
                let logs = if low > 0.0 { math::ln(high / low) } else { 0.0 };
                let power = (1.0 / math::sin(*half_angle_rad)).min(LARGEST_LOG / logs.max(1e-9));
                let unit_mm = if high > 0.0 { high } else { 1.0 };
                let half_angle = *half_angle_rad;
                of(Kind::Cone { tip, axes: frame(axis), half_angle, unit_mm, power }, false)
            }
            CadShape::Sphere { center_mm, radius_mm } => poles(center_mm, border)
                .into_iter()
                .map(|pole| Self {
                    kind: Kind::Sphere { at: *center_mm, axes: frame(&pole), radius: *radius_mm },
                    positive: false,
                })
                .collect(),
            CadShape::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => {
                torus(center_mm, frame(axis), *ring_radius_mm, *tube_radius_mm, border)
            }
        }
    }

    /// The chart of a surface of two parameters.
    pub fn sheet(&self) -> Option<&Sheet> {
        if let Kind::Sheet(sheet) = &self.kind { Some(sheet) } else { None }
    }

    /// Where the points of the border lie in the chart, for which it was made.
    pub fn border(&self, points: &[Point3<f64>]) -> Vec<[f64; 2]> {
        match &self.kind {
            Kind::Sheet(sheet) => sheet.border(),
            _ => points.iter().map(|p| self.place(p)).collect(),
        }
    }

    /// Where a point of the surface lies in the chart.
    pub fn place(&self, p: &Point3<f64>) -> [f64; 2] {
        match &self.kind {
            Kind::Flat { at, x, y } => {
                let arm = p - at;
                [arm.dot(x), arm.dot(y)]
            }
            Kind::Cylinder { at, axes, scale, .. } => {
                let arm = p - at;
                let radius = math::exp(-arm.dot(&axes[2]) * scale);
                polar(&arm, axes, radius)
            }
            Kind::Cone { tip, axes, unit_mm, power, .. } => {
                let arm = p - tip;
                let slant = arm.norm() / unit_mm;
                if slant <= 1e-9 { [0.0, 0.0] } else { polar(&arm, axes, math::exp(power * math::ln(slant))) }
            }
            Kind::Sphere { at, axes, .. } => {
                let arm = (p - at).normalize();
                let below = (1.0 - arm.dot(&axes[2])).max(1e-12);
                [arm.dot(&axes[0]) / below, arm.dot(&axes[1]) / below]
            }
            Kind::Torus(torus) => torus.place(p),
            Kind::Sheet(sheet) => sheet.place(p),
        }
    }

    /// The point of the surface at a place of the chart.
    pub fn lift(&self, [x, y]: [f64; 2]) -> Point3<f64> {
        let length = (x * x + y * y).sqrt();
        // The origin is the tip of a cone, and no point of the others.
        let [cos, sin] = if length > 0.0 { [x / length, y / length] } else { [1.0, 0.0] };
        match &self.kind {
            Kind::Flat { at, x: first, y: second } => at + first * x + second * y,
            Kind::Cylinder { at, axes, radius, scale } => {
                at + (axes[0] * cos + axes[1] * sin) * *radius - axes[2] * (math::ln(length) / scale)
            }
            Kind::Cone { tip, axes, half_angle, unit_mm, power } => {
                let slant = if length > 0.0 { unit_mm * math::exp(math::ln(length) / power) } else { 0.0 };
                let (out, up) = math::sincos(*half_angle);
                tip + ((axes[0] * cos + axes[1] * sin) * out + axes[2] * up) * slant
            }
            Kind::Sphere { at, axes, radius } => {
                let square = x * x + y * y;
                let arm = axes[0] * (2.0 * x) + axes[1] * (2.0 * y) + axes[2] * (square - 1.0);
                at + arm * (radius / (square + 1.0))
            }
            Kind::Torus(torus) => torus.lift([cos, sin], length),
            Kind::Sheet(sheet) => sheet.lift([x, y]),
        }
    }
}

impl Torus {
    fn place(&self, p: &Point3<f64>) -> [f64; 2] {
        let [u, v] = torus_angles(&(p - self.at), &self.axes, self.ring);
        let (turned, along) = if self.about_tube { (v, u) } else { (u, v) };
        let radius = math::exp(self.sign() * self.scale * (positive_angle(along - self.cut) - PI));
        let (sin, cos) = math::sincos(turned);
        [radius * cos, radius * sin]
    }

    /// On the left of a line around the tube lies what is on the right of one around the axis.
    fn sign(&self) -> f64 {
        if self.about_tube { 1.0 } else { -1.0 }
    }

    fn lift(&self, [cos, sin]: [f64; 2], length: f64) -> Point3<f64> {
        let along = math::ln(length) / (self.sign() * self.scale) + PI + self.cut;
        let (s, c) = math::sincos(along);
        let ((sin_u, cos_u), (sin_v, cos_v)) =
            if self.about_tube { ((s, c), (sin, cos)) } else { ((sin, cos), (s, c)) };
        let out = self.axes[0] * cos_u + self.axes[1] * sin_u;
        self.at + out * (self.ring + self.tube * cos_v) + self.axes[2] * (self.tube * sin_v)
    }
}

fn polar(arm: &Vector3<f64>, axes: &[Vector3<f64>; 3], radius: f64) -> [f64; 2] {
    let flat = [arm.dot(&axes[0]), arm.dot(&axes[1])];
    let length = (flat[0] * flat[0] + flat[1] * flat[1]).sqrt();
    if length > 0.0 { flat.map(|c| c / length * radius) } else { [0.0, 0.0] }
}

/// Poles that lie far from a border on a sphere, the farthest first.
fn poles(center: &Point3<f64>, border: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let mut poles = Vec::new();
    for (x, y, z) in (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| (x, y, z)))) {
        if (x, y, z) != (0, 0, 0) {
            poles.push(Vector3::new(f64::from(x), f64::from(y), f64::from(z)).normalize());
        }
    }
    let middle: Vector3<f64> = border.iter().map(|p| p - center).sum();
    poles.extend(middle.try_normalize(1e-9).into_iter().flat_map(|m| [m, -m]));
    let nearest =
        |pole: &Vector3<f64>| border.iter().map(|p| (p - center).normalize().dot(pole)).fold(-1.0, f64::max);
    poles.sort_by(|a, b| nearest(a).total_cmp(&nearest(b)));
    poles
}

fn positive_angle(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).floor()
}

/// Angles about the axis and about the tube.
fn torus_angles(arm: &Vector3<f64>, axes: &[Vector3<f64>; 3], ring: f64) -> [f64; 2] {
    let out = across(arm, &axes[2]).norm() - ring;
    [math::atan2(arm.dot(&axes[1]), arm.dot(&axes[0])), math::atan2(arm.dot(&axes[2]), out)]
}

/// Charts that cut a torus across or along its tube where no border lies, the widest gaps first.
fn torus(
    center: &Point3<f64>,
    axes: [Vector3<f64>; 3],
    ring: f64,
    tube: f64,
    border: &[Point3<f64>],
) -> Vec<Chart> {
    let angles: Vec<[f64; 2]> = border.iter().map(|p| torus_angles(&(p - center), &axes, ring)).collect();
    let mut charts = Vec::new();
    for about_tube in [false, true] {
        let mut along: Vec<f64> =
            angles.iter().map(|[u, v]| positive_angle(if about_tube { *u } else { *v })).collect();
        along.sort_unstable_by(f64::total_cmp);
        let mut gaps: Vec<(f64, f64)> = (0..along.len())
            .map(|i| {
                let next = if i + 1 < along.len() { along[i + 1] } else { along[0] + TAU };
                (next - along[i], 0.5 * (next + along[i]))
            })
            .collect();
        gaps.sort_by(|a, b| b.0.total_cmp(&a.0));
        let ratio = if about_tube { ring / tube } else { tube / ring };
        let scale = ratio.clamp(0.05, LARGEST_LOG / TAU);
        charts.extend(gaps.iter().take(3).filter(|gap| gap.0 > 0.05).map(|(_, cut)| Chart {
            kind: Kind::Torus(Torus { at: *center, axes, ring, tube, cut: *cut, scale, about_tube }),
            positive: true,
        }));
    }
    charts
}
