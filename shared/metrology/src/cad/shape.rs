//! Surfaces of CAD: plane, cylinder, cone, sphere, torus, and those of two parameters.

use fringe::math;
use nalgebra::{Isometry3, Point3, Vector3};

use super::freeform::Freeform;

/// The surface under a face.
#[derive(Debug, Clone, PartialEq)]
pub enum Surface {
    /// One that inspection plans have as an element.
    Element(CadShape),
    /// Any other one: something to compare with.
    Free(Box<Freeform>),
}

impl Surface {
    /// Kind of the surface in a few words.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Element(shape) => shape.kind(),
            Self::Free(free) => free.kind(),
        }
    }

    /// The surface as an element of inspection plans.
    pub fn element(&self) -> Option<&CadShape> {
        match self {
            Self::Element(shape) => Some(shape),
            Self::Free(_) => None,
        }
    }
}

impl From<CadShape> for Surface {
    fn from(shape: CadShape) -> Self {
        Self::Element(shape)
    }
}

/// An elementary surface without an end; its own normal points along the plane's, or away from the axis, centre or ring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CadShape {
    /// A plane by a point and its normal.
    Plane {
        /// A point of the plane, mm.
        point_mm: Point3<f64>,
        /// Unit normal of the plane.
        normal: Vector3<f64>,
    },
    /// A cylinder about an axis.
    Cylinder {
        /// A point of the axis, mm.
        point_mm: Point3<f64>,
        /// Unit direction of the axis.
        axis: Vector3<f64>,
        /// Radius of the cylinder, mm.
        radius_mm: f64,
    },
    /// A cone about an axis.
    Cone {
        /// Point of the axis where the radius is taken, mm.
        point_mm: Point3<f64>,
        /// Unit direction of the axis, to where the cone widens.
        axis: Vector3<f64>,
        /// Radius of the section through the point, mm.
        radius_mm: f64,
        /// Angle between axis and surface, rad.
        half_angle_rad: f64,
    },
    /// A sphere about a centre.
    Sphere {
        /// Centre of the sphere, mm.
        center_mm: Point3<f64>,
        /// Radius of the sphere, mm.
        radius_mm: f64,
    },
    /// A torus about an axis.
    Torus {
        /// Centre of the torus, mm.
        center_mm: Point3<f64>,
        /// Unit direction of the axis.
        axis: Vector3<f64>,
        /// Radius of the circle of the tube's middle, mm.
        ring_radius_mm: f64,
        /// Radius of the tube, mm.
        tube_radius_mm: f64,
    },
}

impl CadShape {
    /// Signed distance of a position along the surface's own normal, mm.
    pub fn distance_mm(&self, position: &Point3<f64>) -> f64 {
        match self {
            Self::Plane { point_mm, normal } => (position - point_mm).dot(normal),
            Self::Cylinder { point_mm, axis, radius_mm } => {
                across(&(position - point_mm), axis).norm() - radius_mm
            }
            Self::Cone { point_mm, axis, radius_mm, half_angle_rad } => {
                let arm = position - point_mm;
                let (sin, cos) = math::sincos(*half_angle_rad);
                (across(&arm, axis).norm() - radius_mm) * cos - arm.dot(axis) * sin
            }
            Self::Sphere { center_mm, radius_mm } => (position - center_mm).norm() - radius_mm,
            Self::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } => {
                let arm = position - center_mm;
                let out = across(&arm, axis).norm() - ring_radius_mm;
                let height = arm.dot(axis);
                (out * out + height * height).sqrt() - tube_radius_mm
            }
        }
    }

    /// The surface's own unit normal next to a position; zero where there is none.
    pub fn normal_at(&self, position: &Point3<f64>) -> Vector3<f64> {
        match self {
            Self::Plane { normal, .. } => *normal,
            Self::Cylinder { point_mm, axis, .. } => unit(across(&(position - point_mm), axis)),
            Self::Cone { point_mm, axis, half_angle_rad, .. } => {
                let (sin, cos) = math::sincos(*half_angle_rad);
                unit(across(&(position - point_mm), axis)) * cos - axis * sin
            }
            Self::Sphere { center_mm, .. } => unit(position - center_mm),
            Self::Torus { center_mm, axis, ring_radius_mm, .. } => {
                let arm = position - center_mm;
                unit(arm - unit(across(&arm, axis)) * *ring_radius_mm)
            }
        }
    }

    /// The foot of a position on the surface; `None` on an axis or centre.
    pub fn foot(&self, position: &Point3<f64>) -> Option<Point3<f64>> {
        let normal = self.normal_at(position);
        // Distances are along the normal, so one step is exact.
        (normal.norm_squared() > 0.5).then(|| position - normal * self.distance_mm(position))
    }

    /// Kind of the surface in a word.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Plane { .. } => "plane",
            Self::Cylinder { .. } => "cylinder",
            Self::Cone { .. } => "cone",
            Self::Sphere { .. } => "sphere",
            Self::Torus { .. } => "torus",
        }
    }

    /// The surface after a motion.
    #[must_use]
    pub fn moved(mut self, motion: &Isometry3<f64>) -> Self {
        let (place, direction) = match &mut self {
            Self::Plane { point_mm, normal } => (point_mm, Some(normal)),
            Self::Cylinder { point_mm, axis, .. } | Self::Cone { point_mm, axis, .. } => {
                (point_mm, Some(axis))
            }
            Self::Torus { center_mm, axis, .. } => (center_mm, Some(axis)),
            Self::Sphere { center_mm, .. } => (center_mm, None),
        };
        *place = motion * *place;
        if let Some(direction) = direction {
            *direction = motion * *direction;
        }
        self
    }

    /// Whether two surfaces are one, to a length and (over a length of `reach_mm`) an angle.
    pub fn is_same(&self, other: &Self, limit_mm: f64, reach_mm: f64) -> bool {
        let sizes = |a: f64, b: f64| (a - b).abs() <= limit_mm;
        let along = |a: &Vector3<f64>, b: &Vector3<f64>| a.cross(b).norm() * reach_mm <= limit_mm;
        match (self, other) {
            (Self::Plane { point_mm: p, normal: n }, Self::Plane { point_mm: q, normal: m }) => {
                along(n, m) && (q - p).dot(n).abs() <= limit_mm
            }
            (
                Self::Cylinder { point_mm: p, axis: a, radius_mm: r },
                Self::Cylinder { point_mm: q, axis: b, radius_mm: s },
            ) => sizes(*r, *s) && along(a, b) && across(&(q - p), a).norm() <= limit_mm,
            (
                Self::Cone { point_mm: p, axis: a, radius_mm: r, half_angle_rad: u },
                Self::Cone { point_mm: q, axis: b, radius_mm: s, half_angle_rad: v },
            ) => {
                let radius = r + (q - p).dot(a) * math::tan(*u);
                (u - v).abs() * reach_mm <= limit_mm
                    && a.dot(b) > 0.0
                    && along(a, b)
                    && across(&(q - p), a).norm() <= limit_mm
                    && sizes(radius, *s)
            }
            (Self::Sphere { center_mm: p, radius_mm: r }, Self::Sphere { center_mm: q, radius_mm: s }) => {
                sizes(*r, *s) && (q - p).norm() <= limit_mm
            }
            (
                Self::Torus { center_mm: p, axis: a, ring_radius_mm: r, tube_radius_mm: t },
                Self::Torus { center_mm: q, axis: b, ring_radius_mm: s, tube_radius_mm: u },
            ) => sizes(*r, *s) && sizes(*t, *u) && along(a, b) && (q - p).norm() <= limit_mm,
            _ => false,
        }
    }
}

/// The part of a vector across a direction.
pub(super) fn across(arm: &Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
    arm - axis * arm.dot(axis)
}

fn unit(v: Vector3<f64>) -> Vector3<f64> {
    let length = v.norm();
    if length > 0.0 { v / length } else { Vector3::zeros() }
}
