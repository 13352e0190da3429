//! Surfaces of two parameters: B-splines, surfaces of revolution and of extrusion, offsets of them.

use std::f64::consts::TAU;

use fringe::math;
use nalgebra::{Point3, Vector3};

use super::curve::Frame;
use super::spline::{Spline, SplineSurface};

/// Pieces of a whole turn that are looked at.
const TURN_PIECES: usize = 24;

/// Share of a direction over which the tangents of an offset surface are taken.
const STEP: f64 = 1e-6;

/// A line in space that a surface is made of.
#[derive(Debug, Clone, PartialEq)]
pub enum Profile {
    /// An ellipse about a frame's z, by its angle.
    Ellipse(Frame, [f64; 2]),
    /// A B-spline, by its parameter.
    Spline(Spline),
}

/// A surface of two parameters; its own normal is the first tangent crossed with the second.
#[derive(Debug, Clone, PartialEq)]
pub enum Freeform {
    /// A B-spline, which may be rational.
    Spline(SplineSurface),
    /// A line that is turned about an axis: angle in rad, parameter of the line.
    Revolved {
        /// A point of the axis, mm.
        point_mm: Point3<f64>,
        /// Unit direction of the axis.
        axis: Vector3<f64>,
        /// The line that is turned.
        profile: Profile,
    },
    /// A line that is moved along a direction: parameter of the line, way in mm.
    Extruded {
        /// Unit direction of the way.
        direction: Vector3<f64>,
        /// The line that is moved.
        profile: Profile,
    },
    /// Another one moved along its normals.
    Offset {
        /// The surface that is moved.
        basis: Box<Freeform>,
        /// How far along its own normal, mm.
        distance_mm: f64,
    },
}

impl Profile {
    /// The point of a parameter, and how it moves with the parameter.
    pub fn with_tangent(&self, t: f64) -> (Point3<f64>, Vector3<f64>) {
        match self {
            Self::Ellipse(frame, [a, b]) => {
                let (sin, cos) = math::sincos(t);
                let arm = |x: f64, y: f64| frame.axes * Vector3::new(x, y, 0.0);
                (frame.origin + arm(a * cos, b * sin), arm(-a * sin, b * cos))
            }
            Self::Spline(spline) => spline.with_tangent(t),
        }
    }

    /// Parameters between its ends, rising: those of its pieces, each divided.
    fn breaks(&self, parts: impl Fn(usize) -> usize) -> Vec<f64> {
        match self {
            Self::Ellipse(..) => divided(&[0.0, TAU], TURN_PIECES),
            Self::Spline(spline) => divided(&spline.knots.breaks(), parts(spline.knots.degree)),
        }
    }
}

/// Ends of pieces, with each piece divided into so many parts.
fn divided(breaks: &[f64], parts: usize) -> Vec<f64> {
    let inner = |pair: &[f64]| {
        let [from, to] = [pair[0], pair[1]];
        (0..parts).map(move |k| from + (to - from) * k as f64 / parts as f64)
    };
    breaks.windows(2).flat_map(inner).chain(breaks.last().copied()).collect()
}

impl Freeform {
    /// Kind of the surface in a few words.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Spline(_) => "B-spline surface",
            Self::Revolved { .. } => "surface of revolution",
            Self::Extruded { .. } => "surface of extrusion",
            Self::Offset { .. } => "offset surface",
        }
    }

    /// The point of two parameters, and how it moves with each.
    pub fn with_tangents(&self, [u, v]: [f64; 2]) -> (Point3<f64>, [Vector3<f64>; 2]) {
        match self {
            Self::Spline(surface) => surface.with_tangents([u, v]),
            Self::Revolved { point_mm, axis, profile } => {
                let (point, along) = profile.with_tangent(v);
                let (sin, cos) = math::sincos(u);
                let turned = |arm: Vector3<f64>| {
                    arm * cos + axis.cross(&arm) * sin + axis * (axis.dot(&arm) * (1.0 - cos))
                };
                let arm = turned(point - point_mm);
                (point_mm + arm, [axis.cross(&arm), turned(along)])
            }
            Self::Extruded { direction, profile } => {
                let (point, along) = profile.with_tangent(u);
                (point + direction * v, [along, *direction])
            }
            Self::Offset { basis, distance_mm } => {
                let at = |place: [f64; 2]| {
                    let (point, tangents) = basis.with_tangents(place);
                    point + normal_of(&tangents) * *distance_mm
                };
                let [du, dv] = basis.domain().map(|[from, to]| STEP * (to - from));
                let tangents = [
                    (at([u + du, v]) - at([u - du, v])) / (2.0 * du),
                    (at([u, v + dv]) - at([u, v - dv])) / (2.0 * dv),
                ];
                (at([u, v]), tangents)
            }
        }
    }

    /// Parameters of both directions, rising: ends of pieces, each divided by its degree.
    pub(super) fn breaks(&self, parts: impl Fn(usize) -> usize + Copy) -> [Vec<f64>; 2] {
        match self {
            Self::Spline(SplineSurface { knots, .. }) => {
                [0, 1].map(|i| divided(&knots[i].breaks(), parts(knots[i].degree)))
            }
            Self::Revolved { profile, .. } => [divided(&[0.0, TAU], TURN_PIECES), profile.breaks(parts)],
            Self::Extruded { profile, .. } => [profile.breaks(parts), vec![0.0, 1.0]],
            Self::Offset { basis, .. } => basis.breaks(parts),
        }
    }

    /// First and last parameter of each direction; an extrusion has no end, and 0 … 1 mm instead.
    pub(super) fn domain(&self) -> [[f64; 2]; 2] {
        self.breaks(|_| 1).map(|breaks| [breaks[0], breaks[breaks.len() - 1]])
    }

    /// Points all over it; of an extrusion those where it begins.
    pub fn points(&self) -> Vec<Point3<f64>> {
        let [us, vs] = self.breaks(|degree| degree + 1);
        let at = |u: &f64, v: &f64| self.with_tangents([*u, *v]).0;
        us.iter().flat_map(|u| vs.iter().map(move |v| at(u, v))).collect()
    }

    /// The two ranges of an ellipse's angle on both sides of the axis about which it is turned; `None` where it stays on one.
    pub(super) fn sides_of_axis(&self) -> Option<[[f64; 2]; 2]> {
        let Self::Revolved { point_mm, axis, profile: Profile::Ellipse(frame, [a, b]) } = self else {
            return None;
        };
        // How far a point of the ellipse lies out, within its plane: a sum of cosine and sine.
        let out = frame.axes.column(2).cross(axis).try_normalize(1e-9)?;
        let (x, y) = (a * frame.axes.column(0).dot(&out), b * frame.axes.column(1).dot(&out));
        let (middle, reach) = ((frame.origin - point_mm).dot(&out), (x * x + y * y).sqrt());
        if middle.abs() >= reach * (1.0 - 1e-12) || frame.axes.column(2).dot(axis).abs() > 1e-9 {
            return None;
        }
        let (toward, half) = (math::atan2(y, x), math::acos((-middle / reach).clamp(-1.0, 1.0)));
        let [from, to] = [toward - half, toward + half];
        let sides = [[from, to], [to, from + TAU]];
        // First that on which the ellipse begins: its normal is the one that is meant.
        Some(if middle + x >= 0.0 { sides } else { [sides[1], sides[0]] })
    }

    /// The direction of an extrusion, along which it has no end.
    pub(super) fn endless(&self) -> Option<&Vector3<f64>> {
        match self {
            Self::Extruded { direction, .. } => Some(direction),
            Self::Offset { basis, .. } => basis.endless(),
            _ => None,
        }
    }
}

/// The unit normal between two tangents; zero where they are parallel.
pub(super) fn normal_of([along, across]: &[Vector3<f64>; 2]) -> Vector3<f64> {
    let normal = along.cross(across);
    let length = normal.norm();
    if length > 1e-12 * along.norm() * across.norm() && length > 0.0 {
        normal / length
    } else {
        Vector3::zeros()
    }
}
