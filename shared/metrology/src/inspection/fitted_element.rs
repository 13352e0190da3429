//! A fitted element of any kind: what all kinds have, and what each one says of itself.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::flatness::effect_of;
use super::geometry::Geometry;
use super::nominal_surface::SurfaceFit;
use crate::fit::{
    ConeFit, ContourFit, CylinderFit, Form, PlaneFit, PointFit, Residuals, SphereFit, TorusFit,
};

/// A fitted element, in the part frame as found. All its numbers are finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FittedElement {
    /// A sphere with its form and uncertainties.
    Sphere(SphereFit),
    /// A plane; its normal points out of the material.
    Plane(PlaneFit),
    /// A cylinder with its axis.
    Cylinder(CylinderFit),
    /// A cone with its axis.
    Cone(ConeFit),
    /// A torus with its axis.
    Torus(TorusFit),
    /// A circle at the border of a plane.
    Circle(ContourFit),
    /// A slot at the border of a plane.
    Slot(ContourFit),
    /// A rectangle at the border of a plane.
    Rectangle(ContourFit),
    /// A straight border of a plane.
    Edge(ContourFit),
    /// A straight line of a surface in its section.
    Line(ContourFit),
    /// A freeform surface of CAD data.
    Surface(SurfaceFit),
    /// A point of a surface.
    Point(PointFit),
}

/// One expression for each kind of fit.
macro_rules! each {
    ($fit:expr, $name:ident => $value:expr) => {
        match $fit {
            FittedElement::Sphere($name) => $value,
            FittedElement::Plane($name) => $value,
            FittedElement::Cylinder($name) => $value,
            FittedElement::Cone($name) => $value,
            FittedElement::Torus($name) => $value,
            FittedElement::Circle($name)
            | FittedElement::Slot($name)
            | FittedElement::Rectangle($name)
            | FittedElement::Edge($name)
            | FittedElement::Line($name) => $value,
            FittedElement::Surface($name) => $value,
            FittedElement::Point($name) => $value,
        }
    };
}

impl FittedElement {
    /// Standard uncertainty of how far out a side of an outline lies, mm, where the cloud leaves out its rims; 0 of other elements.
    pub fn u_rim_mm(&self) -> f64 {
        match self {
            Self::Circle(fit) | Self::Slot(fit) | Self::Rectangle(fit) | Self::Edge(fit) => fit.u_rim_mm,
            _ => 0.0,
        }
    }

    /// The kind of element as files and reports name it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sphere(_) => "sphere",
            Self::Plane(_) => "plane",
            Self::Cylinder(_) => "cylinder",
            Self::Cone(_) => "cone",
            Self::Torus(_) => "torus",
            Self::Circle(_) => "circle",
            Self::Slot(_) => "slot",
            Self::Rectangle(_) => "rectangle",
            Self::Edge(_) => "edge",
            Self::Line(_) => "line",
            Self::Surface(_) => "surface",
            Self::Point(_) => "point",
        }
    }

    /// Signed distance of a position in the part frame, mm; positive out of the material. A freeform surface is that of the
    /// nominal geometry.
    pub(super) fn distance_mm(&self, nominal: &Geometry, position: &Vector3<f64>) -> f64 {
        match self {
            Self::Sphere(sphere) => (position - sphere.center().coords).norm() - 0.5 * sphere.diameter_mm,
            Self::Plane(plane) => plane.distance_mm(&Point3::from(*position)),
            Self::Cylinder(c) => axial(position, &c.axis_point_mm, &c.axis_direction).0 - 0.5 * c.diameter_mm,
            Self::Cone(c) => {
                let (radius, height) = axial(position, &c.axis_point_mm, &c.axis_direction);
                let (sin, cos) = fringe::math::sincos(c.half_angle_deg.to_radians());
                (radius - 0.5 * c.diameter_mm) * cos - height * sin
            }
            Self::Torus(t) => {
                let (radius, height) = axial(position, &t.center_mm, &t.axis_direction);
                let across = radius - 0.5 * t.ring_diameter_mm;
                (across * across + height * height).sqrt() - 0.5 * t.tube_diameter_mm
            }
            Self::Surface(_) => nominal.distance_mm(position),
            // Of outlines, lines and points: from the plane of their points.
            Self::Circle(c) | Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) => {
                (position - Vector3::from(c.center_mm)).dot(&Vector3::from(c.normal))
            }
            Self::Line(c) => {
                let up = Vector3::from(c.direction).cross(&Vector3::from(c.normal));
                -(position - Vector3::from(c.center_mm)).dot(&up)
            }
            Self::Point(p) => (position - Vector3::from(p.point_mm)).dot(&Vector3::from(p.normal)),
        }
    }

    /// Form statistics of the points behind the fit.
    pub fn form(&self) -> &Form {
        each!(self, fit => &fit.form)
    }

    /// How many of its points carry the information of one, as far as it is told: of a plane.
    pub(super) fn effect(&self) -> f64 {
        if let Self::Plane(plane) = self { effect_of(plane) } else { 1.0 }
    }

    /// Residuals of the points behind the fit; empty of a result that was read.
    pub(super) fn residuals(&self) -> &Residuals {
        each!(self, fit => &fit.residuals)
    }

    /// Forgets the residuals: they live on in the points.
    pub(super) fn forget_residuals(&mut self) {
        each!(self, fit => fit.residuals = Residuals::default());
    }

    /// Centre or point in the part frame, mm.
    pub fn place(&self) -> Vector3<f64> {
        Vector3::from(match self {
            Self::Sphere(s) => s.center_mm,
            Self::Plane(p) => p.centroid_mm,
            Self::Cylinder(c) => c.axis_point_mm,
            Self::Cone(c) => c.axis_point_mm,
            Self::Torus(t) => t.center_mm,
            Self::Circle(c) | Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) | Self::Line(c) => {
                c.center_mm
            }
            Self::Surface(s) => s.place_mm,
            Self::Point(p) => p.point_mm,
        })
    }

    /// Axis, normal or direction in the part frame; absent of a sphere and of a freeform surface.
    pub fn direction(&self) -> Option<[f64; 3]> {
        Some(match self {
            Self::Sphere(_) | Self::Surface(_) => return None,
            Self::Plane(p) => p.normal,
            Self::Cylinder(c) => c.axis_direction,
            Self::Cone(c) => c.axis_direction,
            Self::Torus(t) => t.axis_direction,
            Self::Circle(c) => c.normal,
            Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) | Self::Line(c) => c.direction,
            Self::Point(p) => p.normal,
        })
    }

    /// Sizes as people read them: diameters, half angle, length × width; empty where there is none.
    pub fn sizes(&self) -> Vec<String> {
        let round = |diameter: f64| format!("⌀ {diameter:.4}");
        match self {
            Self::Sphere(s) => vec![round(s.diameter_mm)],
            Self::Cylinder(c) => vec![round(c.diameter_mm)],
            Self::Cone(c) => vec![round(c.diameter_mm), format!("{:.4}°", c.half_angle_deg)],
            Self::Torus(t) => vec![round(t.ring_diameter_mm), round(t.tube_diameter_mm)],
            Self::Circle(c) => vec![round(c.size_mm[0])],
            Self::Slot(c) | Self::Rectangle(c) => vec![format!("{:.4} × {:.4}", c.size_mm[0], c.size_mm[1])],
            Self::Plane(_) | Self::Edge(_) | Self::Line(_) | Self::Surface(_) | Self::Point(_) => Vec::new(),
        }
    }

    /// Whether every number that is reported is one.
    pub(super) fn is_finite(&self) -> bool {
        let form = self.form();
        let (place, u) = match self {
            Self::Sphere(s) => {
                let [x, y, z] = s.center_mm;
                let [u_x, u_y, u_z] = s.u_center_mm;
                ([x, y, z, s.diameter_mm], [u_x, u_y, u_z, s.u_diameter_mm])
            }
            Self::Plane(p) => {
                let [x, y, z] = p.normal;
                ([x, y, z, p.offset_mm], [p.u_centroid_mm, p.u_offset_mm, p.u_normal_rad, 0.0])
            }
            Self::Cylinder(c) => {
                let [x, y, z] = c.axis_point_mm;
                ([x, y, z, c.diameter_mm], [c.u_axis_point_mm, c.u_axis_direction_rad, c.u_diameter_mm, 0.0])
            }
            Self::Cone(c) => {
                let ([x, y, z], [u_x, u_y, u_z]) = (c.apex_mm, c.u_apex_mm);
                ([x, y, z, c.half_angle_deg], [u_x, u_y, u_z, c.u_half_angle_deg])
            }
            Self::Torus(t) => {
                let ([x, y, z], u) = (t.center_mm, t.u_center_mm);
                (
                    [x, y, z, t.tube_diameter_mm],
                    [u[0] + u[1], u[2], t.u_ring_diameter_mm, t.u_tube_diameter_mm],
                )
            }
            Self::Circle(c) | Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) | Self::Line(c) => {
                let ([x, y, z], [u_x, u_y, u_z]) = (c.center_mm, c.u_center_mm);
                (
                    [x, y, z, c.size_mm[0] + c.size_mm[1]],
                    [u_x + u_y + u_z, c.u_direction_rad, c.u_size_mm[0], c.u_size_mm[1]],
                )
            }
            Self::Surface(s) => {
                let [x, y, z] = s.place_mm;
                ([x, y, z, 0.0], [0.0; 4])
            }
            Self::Point(p) => {
                let [x, y, z] = p.point_mm;
                ([x, y, z, 0.0], [p.u_mm, 0.0, 0.0, 0.0])
            }
        };
        let form = [form.form_range_mm, form.form_sigma_mm, form.form_d95_mm];
        place.iter().chain(&u).chain(&form).all(|v| v.is_finite())
    }
}

/// Distance of a position from an axis, and its height along it, mm.
fn axial(position: &Vector3<f64>, point: &[f64; 3], direction: &[f64; 3]) -> (f64, f64) {
    let (arm, direction) = (position - Vector3::from(*point), Vector3::from(*direction));
    let height = arm.dot(&direction);
    ((arm - direction * height).norm(), height)
}
