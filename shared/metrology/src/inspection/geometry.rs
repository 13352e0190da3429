//! Nominal geometry of the elements of a plan, in the part frame.

use nalgebra::{Point3, Vector3};

use super::nominal_surface::NominalSurface;
use crate::fit::Outline;
use fringe::math;

/// A disc or rectangle that is cut out of a plane's region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exclusion {
    /// Centre along the plane's two directions from its nominal point, mm.
    pub center_mm: [f64; 2],
    /// What is cut out.
    pub shape: ExclusionShape,
}

/// Shape of an [`Exclusion`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExclusionShape {
    /// A disc of this radius, mm.
    Disc(f64),
    /// Half edges along the plane's two directions, mm.
    Rectangle([f64; 2]),
}

/// Nominal geometry of an element in the part frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Geometry {
    /// A sphere or a part of one, between two polar angles about an axis.
    Sphere {
        /// Centre in the part frame, mm.
        center_mm: Point3<f64>,
        /// Radius of the sphere, mm.
        radius_mm: f64,
        /// Unit axis of the polar angles.
        axis: Vector3<f64>,
        /// Cosines of the largest and of the smallest polar angle.
        cos_polar: [f64; 2],
    },
    /// A rectangle in a plane.
    Plane {
        /// Centre of the rectangle, mm.
        point_mm: Point3<f64>,
        /// Unit normal, out of the material.
        normal: Vector3<f64>,
        /// Unit directions of the edges.
        edges: [Vector3<f64>; 2],
        /// Half edges, the inset taken off, mm.
        half_size_mm: [f64; 2],
        /// What is cut out.
        exclusions: Vec<Exclusion>,
    },
    /// A cylinder or a sector of one.
    Cylinder {
        /// Middle of the axis' length, mm.
        point_mm: Point3<f64>,
        /// Unit direction of the axis.
        axis: Vector3<f64>,
        /// Radius of the cylinder, mm.
        radius_mm: f64,
        /// Half of the length, the inset taken off, mm.
        half_length_mm: f64,
        /// Whether it is a bore: normals point to the axis.
        internal: bool,
        /// Part of the circumference; `None`: all of it.
        sector: Option<Sector>,
    },
    /// A cone between two heights.
    Cone {
        /// Point of the axis in the middle of its length, mm.
        point_mm: Point3<f64>,
        /// Unit direction of the axis, to where it widens.
        axis: Vector3<f64>,
        /// Radius of the section through the point, mm.
        radius_mm: f64,
        /// Angle between axis and surface, rad.
        half_angle_rad: f64,
        /// Half of the length along the axis, the inset taken off, mm.
        half_length_mm: f64,
        /// Whether it is a countersink: normals point to the axis.
        internal: bool,
    },
    /// A torus, or what is seen of it.
    Torus {
        /// Centre of the torus, mm.
        center_mm: Point3<f64>,
        /// Unit direction of the axis of rotation.
        axis: Vector3<f64>,
        /// Radius of the circle of the tube's middle, mm.
        ring_radius_mm: f64,
        /// Radius of the tube, mm.
        tube_radius_mm: f64,
    },
    /// An outline at the border of a plane: circle, slot, rectangle, straight edge.
    Outline {
        /// Middle of the outline, mm.
        center_mm: Point3<f64>,
        /// Unit normal of the plane, out of the material.
        normal: Vector3<f64>,
        /// Unit directions in the plane: of the length or edge, and across.
        edges: [Vector3<f64>; 2],
        /// Shape with its sizes.
        outline: Outline,
        /// Whether the material lies around it.
        internal: bool,
        /// How deep in the material points of the plane are looked at, mm.
        band_mm: f64,
        /// Distance from corners and ends within which nothing is looked at, mm.
        inset_mm: f64,
    },
    /// A straight strip of a surface, seen in the section along it.
    Line {
        /// Middle of the strip, mm.
        point_mm: Point3<f64>,
        /// Unit direction along the strip.
        direction: Vector3<f64>,
        /// Unit normal of the surface.
        normal: Vector3<f64>,
        /// Half length and half width of the strip, mm.
        half_size_mm: [f64; 2],
    },
    /// A freeform surface of CAD data.
    Surface(NominalSurface),
    /// A point of a surface: where a line along its nominal normal meets it.
    Point {
        /// Nominal point of the surface, mm.
        point_mm: Point3<f64>,
        /// Unit normal of the surface.
        normal: Vector3<f64>,
        /// Radius of the disc whose plane is taken, mm.
        radius_mm: f64,
    },
}

/// Part of a cylinder's circumference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sector {
    /// Unit direction to its middle, across the axis.
    pub direction: Vector3<f64>,
    /// Cosine of half of its angle.
    pub cos_half: f64,
}

impl Geometry {
    /// Kind of the element as the plan names it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sphere { .. } => "sphere",
            Self::Plane { .. } => "plane",
            Self::Cylinder { .. } => "cylinder",
            Self::Cone { .. } => "cone",
            Self::Torus { .. } => "torus",
            Self::Outline { outline, .. } => match outline {
                Outline::Circle(_) => "circle",
                Outline::Slot(_) => "slot",
                Outline::Rectangle(_) => "rectangle",
                Outline::Edge(_) => "edge",
            },
            Self::Line { .. } => "line",
            Self::Surface(_) => "surface",
            Self::Point { .. } => "point",
        }
    }

    /// Signed distance of a position from the nominal surface, mm, positive out of the material; of an outline in its
    /// plane, of a line in its section.
    pub fn distance_mm(&self, position: &Vector3<f64>) -> f64 {
        let inward = |internal: bool, distance: f64| if internal { -distance } else { distance };
        let arm = position - self.place().coords;
        match self {
            Self::Sphere { radius_mm, .. } => arm.norm() - radius_mm,
            Self::Plane { normal, .. } | Self::Line { normal, .. } | Self::Point { normal, .. } => {
                arm.dot(normal)
            }
            Self::Cylinder { axis, radius_mm, internal, .. } => {
                inward(*internal, (arm - axis * arm.dot(axis)).norm() - radius_mm)
            }
            Self::Cone { axis, radius_mm, half_angle_rad, internal, .. } => {
                let height = arm.dot(axis);
                let (sin, cos) = math::sincos(*half_angle_rad);
                let radius = (arm - axis * height).norm();
                inward(*internal, (radius - radius_mm) * cos - height * sin)
            }
            Self::Torus { axis, ring_radius_mm, tube_radius_mm, .. } => {
                let height = arm.dot(axis);
                let across = (arm - axis * height).norm() - ring_radius_mm;
                (across * across + height * height).sqrt() - tube_radius_mm
            }
            Self::Surface(surface) => surface.distance_mm(position),
            Self::Outline { edges, outline, internal, .. } => {
                let (distance, _) = outline.see(edges.map(|edge| edge.dot(&arm)));
                inward(*internal, distance)
            }
        }
    }

    /// Unit normal of the nominal surface next to a position, out of the material; of an outline that of its plane.
    pub fn normal_at(&self, position: &Vector3<f64>) -> Vector3<f64> {
        let unit = |v: Vector3<f64>| if v.norm() > 0.0 { v / v.norm() } else { v };
        let arm = position - self.place().coords;
        let sign = |internal: bool| if internal { -1.0 } else { 1.0 };
        match self {
            Self::Sphere { .. } => unit(arm),
            Self::Plane { normal, .. }
            | Self::Line { normal, .. }
            | Self::Point { normal, .. }
            | Self::Outline { normal, .. } => *normal,
            Self::Cylinder { axis, internal, .. } => unit(arm - axis * arm.dot(axis)) * sign(*internal),
            Self::Cone { axis, half_angle_rad, internal, .. } => {
                let (sin, cos) = math::sincos(*half_angle_rad);
                (unit(arm - axis * arm.dot(axis)) * cos - axis * sin) * sign(*internal)
            }
            Self::Surface(surface) => surface.normal_at(position),
            Self::Torus { axis, ring_radius_mm, .. } => {
                let out = unit(arm - axis * arm.dot(axis));
                unit(arm - out * *ring_radius_mm)
            }
        }
    }

    /// Whether the surface is that of a bore: its normals point to its axis.
    pub fn is_internal(&self) -> bool {
        matches!(self, Self::Cylinder { internal: true, .. } | Self::Cone { internal: true, .. })
    }

    /// Whether it is fitted to the border or a section of its points, and not to these points themselves.
    pub fn is_outlined(&self) -> bool {
        matches!(self, Self::Outline { .. } | Self::Line { .. })
    }

    /// The place that a plan gives first: centre or point, mm.
    pub fn place(&self) -> Point3<f64> {
        match self {
            Self::Sphere { center_mm: place, .. }
            | Self::Torus { center_mm: place, .. }
            | Self::Outline { center_mm: place, .. }
            | Self::Plane { point_mm: place, .. }
            | Self::Cylinder { point_mm: place, .. }
            | Self::Cone { point_mm: place, .. }
            | Self::Line { point_mm: place, .. }
            | Self::Point { point_mm: place, .. } => *place,
            Self::Surface(surface) => surface.middle(),
        }
    }
}
