//! Which points belong to an element.

use nalgebra::{Point3, Vector3};

use super::bounds::Bounds;
use super::fitted_element::FittedElement;
use super::geometry::{Exclusion, ExclusionShape, Geometry};
use super::plan::Element;
use crate::fit::{Outline, PlaneFit, SphereFit, tangents};
use fringe::math;

/// Cosine of the angle from which on a face is another one, where the plan states none: 30°.
const USUAL_COS_NORMAL: f64 = 0.866;

/// The neighbourhood of an element's surface, in the part frame.
#[derive(Debug, Clone)]
pub(super) struct Region {
    /// Where the element is thought to be: nominal, or as fitted.
    pub geometry: Geometry,
    /// Largest distance from the surface, mm.
    pub margin_mm: f64,
    /// Smallest cosine between the normals; `None`: not looked at.
    cos_normal: Option<f64>,
}

impl Region {
    /// About the nominal geometry; the margin and the tolerance of normals may be widened for a search.
    pub fn new(element: &Element, margin_mm: f64, widen_rad: f64) -> Self {
        let cos_normal =
            element.normal_tolerance_rad.map(|t| math::cos((t + widen_rad).min(std::f64::consts::PI)));
        Self { geometry: element.geometry.clone(), margin_mm, cos_normal }
    }

    /// The same with so many times the margin, looking at normals in any case.
    pub fn widened(&self, times: f64) -> Self {
        let cos_normal = self.cos_normal.or(Some(USUAL_COS_NORMAL));
        Self { margin_mm: times * self.margin_mm, cos_normal, ..self.clone() }
    }

    /// About any geometry, whatever the normals.
    #[cfg(test)]
    pub fn of(geometry: Geometry, margin_mm: f64) -> Self {
        Self { geometry, margin_mm, cos_normal: None }
    }

    /// The same where normals count, whose cosine is at least this.
    #[cfg(test)]
    pub fn looking_at_normals(mut self, cos_normal: f64) -> Self {
        self.cos_normal = Some(cos_normal);
        self
    }

    /// Smallest cosine between normals; `None` where they are not looked at.
    pub fn cos_normal(&self) -> Option<f64> {
        self.cos_normal
    }

    /// About a fitted sphere.
    #[must_use]
    pub fn about_sphere(mut self, fit: &SphereFit) -> Self {
        if let Geometry::Sphere { center_mm, radius_mm, .. } = &mut self.geometry {
            *center_mm = fit.center();
            *radius_mm = 0.5 * fit.diameter_mm;
        }
        self
    }

    /// About a fitted plane: the rectangle keeps its place across.
    #[must_use]
    pub fn about_plane(mut self, fit: &PlaneFit) -> Self {
        if let Geometry::Plane { point_mm, normal, edges, .. } = &mut self.geometry {
            *point_mm -= fit.normal_vector() * fit.distance_mm(point_mm);
            *normal = fit.normal_vector();
            let across = edges[0] - *normal * edges[0].dot(normal);
            let length = across.norm();
            // The plan keeps edges well off the normal and a fit stays near it; should both fail, any edges will do.
            *edges = if length > 1e-3 {
                let first = across / length;
                [first, normal.cross(&first)]
            } else {
                tangents(normal)
            };
        }
        self
    }

    /// About a fitted element; those whose place their neighbours fix (outlines, lines, points) stay where they are.
    #[must_use]
    pub fn about(self, fit: &FittedElement) -> Self {
        match fit {
            FittedElement::Sphere(sphere) => self.about_sphere(sphere),
            FittedElement::Plane(plane) => self.about_plane(plane),
            FittedElement::Cylinder(c) => {
                self.about_axis(&c.axis_point_mm, &c.axis_direction, c.diameter_mm, None)
            }
            FittedElement::Cone(c) => {
                self.about_axis(&c.axis_point_mm, &c.axis_direction, c.diameter_mm, Some(c.half_angle_deg))
            }
            FittedElement::Torus(t) => {
                let mut region = self;
                if let Geometry::Torus { center_mm, axis, ring_radius_mm, tube_radius_mm } =
                    &mut region.geometry
                {
                    *center_mm = t.center_mm.into();
                    *axis = same_side(Vector3::from(t.axis_direction), axis);
                    (*ring_radius_mm, *tube_radius_mm) = (0.5 * t.ring_diameter_mm, 0.5 * t.tube_diameter_mm);
                }
                region
            }
            FittedElement::Circle(_)
            | FittedElement::Slot(_)
            | FittedElement::Rectangle(_)
            | FittedElement::Edge(_)
            | FittedElement::Line(_)
            | FittedElement::Surface(_)
            | FittedElement::Point(_) => self,
        }
    }

    /// About a fitted cylinder or cone: its length keeps its place along the axis.
    fn about_axis(
        mut self,
        at: &[f64; 3],
        along: &[f64; 3],
        diameter: f64,
        half_angle_deg: Option<f64>,
    ) -> Self {
        let at = Vector3::from(*at);
        match &mut self.geometry {
            Geometry::Cylinder { point_mm, axis, radius_mm, .. } => {
                let direction = same_side(Vector3::from(*along), axis);
                let foot = at + direction * direction.dot(&(point_mm.coords - at));
                (point_mm.coords, *axis, *radius_mm) = (foot, direction, 0.5 * diameter);
            }
            Geometry::Cone { point_mm, axis, radius_mm, half_angle_rad, .. } => {
                let direction = Vector3::from(*along);
                let height = direction.dot(&(point_mm.coords - at));
                let angle = half_angle_deg.unwrap_or_default().to_radians();
                *radius_mm = 0.5 * diameter + height * math::tan(angle);
                (point_mm.coords, *axis, *half_angle_rad) = (at + direction * height, direction, angle);
            }
            _ => {}
        }
        self
    }

    /// A box that holds the region; `None` where only the surface itself tells.
    pub fn bounds(&self) -> Option<Bounds> {
        let margin = Vector3::repeat(self.margin_mm);
        let flat = |at: &Point3<f64>, arms: [Vector3<f64>; 3]| {
            Bounds::about(&at.coords, &arms.iter().map(Vector3::abs).sum())
        };
        match &self.geometry {
            Geometry::Sphere { center_mm, radius_mm, .. } => {
                Some(Bounds::about(&center_mm.coords, &margin.add_scalar(radius_mm.abs())))
            }
            Geometry::Plane { point_mm, normal, edges, half_size_mm, .. } => {
                let [first, second] = [edges[0] * half_size_mm[0], edges[1] * half_size_mm[1]];
                Some(flat(point_mm, [first, second, normal * self.margin_mm]))
            }
            Geometry::Cylinder { point_mm, axis, radius_mm, half_length_mm, .. } => {
                let along = axis.abs() * *half_length_mm;
                Some(Bounds::about(&point_mm.coords, &(margin + along).add_scalar(radius_mm.abs())))
            }
            Geometry::Torus { center_mm, ring_radius_mm, tube_radius_mm, .. } => {
                let reach = ring_radius_mm.abs() + tube_radius_mm.abs();
                Some(Bounds::about(&center_mm.coords, &margin.add_scalar(reach)))
            }
            Geometry::Line { point_mm, direction, normal, half_size_mm } => {
                let across = direction.cross(normal) * half_size_mm[1];
                Some(flat(point_mm, [direction * half_size_mm[0], across, normal * self.margin_mm]))
            }
            Geometry::Point { point_mm, radius_mm, .. } => {
                Some(Bounds::about(&point_mm.coords, &margin.add_scalar(*radius_mm)))
            }
            Geometry::Surface(surface) => Some(surface.bounds(self.margin_mm)),
            Geometry::Cone { .. } | Geometry::Outline { .. } => None,
        }
    }

    /// Whether a position lies in the region.
    #[inline]
    pub fn holds_position(&self, position: &Vector3<f64>) -> bool {
        match &self.geometry {
            Geometry::Sphere { center_mm, radius_mm, axis, cos_polar } => {
                let arm = position - center_mm.coords;
                let square = arm.norm_squared();
                let (inner, outer) = ((radius_mm - self.margin_mm).max(0.0), radius_mm + self.margin_mm);
                if square > outer * outer || square < inner * inner {
                    return false;
                }
                let (along, length) = (arm.dot(axis), square.sqrt());
                along >= cos_polar[0] * length && along <= cos_polar[1] * length
            }
            Geometry::Plane { point_mm, normal, edges, half_size_mm, exclusions } => {
                let arm = position - point_mm.coords;
                if arm.dot(normal).abs() > self.margin_mm {
                    return false;
                }
                let across = [arm.dot(&edges[0]), arm.dot(&edges[1])];
                across[0].abs() <= half_size_mm[0]
                    && across[1].abs() <= half_size_mm[1]
                    && !exclusions.iter().any(|e| e.covers(across))
            }
            Geometry::Cylinder { point_mm, axis, half_length_mm, sector, .. } => {
                let arm = position - point_mm.coords;
                let height = arm.dot(axis);
                let out = arm - axis * height;
                height.abs() <= *half_length_mm
                    && self.geometry.distance_mm(position).abs() <= self.margin_mm
                    && sector.is_none_or(|s| out.dot(&s.direction) >= s.cos_half * out.norm())
            }
            Geometry::Cone { point_mm, axis, half_length_mm, .. } => {
                (position - point_mm.coords).dot(axis).abs() <= *half_length_mm
                    && self.geometry.distance_mm(position).abs() <= self.margin_mm
            }
            Geometry::Torus { .. } => self.geometry.distance_mm(position).abs() <= self.margin_mm,
            Geometry::Surface(surface) => surface.holds(position, self.margin_mm),
            Geometry::Outline { center_mm, normal, band_mm, outline, .. } => {
                let arm = position - center_mm.coords;
                let depth = -self.geometry.distance_mm(position);
                // Twice the margin outwards: the outline itself may lie off by one.
                let along = match outline {
                    Outline::Edge(half) => self.edge_along(&arm).abs() <= *half,
                    _ => true,
                };
                arm.dot(normal).abs() <= self.margin_mm
                    && depth <= *band_mm + 2.0 * self.margin_mm
                    && depth >= -2.0 * self.margin_mm
                    && along
            }
            Geometry::Line { point_mm, direction, normal, half_size_mm } => {
                let arm = position - point_mm.coords;
                let across = direction.cross(normal);
                arm.dot(normal).abs() <= self.margin_mm
                    && arm.dot(direction).abs() <= half_size_mm[0]
                    && arm.dot(&across).abs() <= half_size_mm[1]
            }
            Geometry::Point { point_mm, normal, radius_mm } => {
                let arm = position - point_mm.coords;
                let height = arm.dot(normal);
                height.abs() <= self.margin_mm && (arm - normal * height).norm() <= *radius_mm
            }
        }
    }

    /// How far along an edge a position lies from its middle, mm.
    fn edge_along(&self, arm: &Vector3<f64>) -> f64 {
        if let Geometry::Outline { edges: [along, _], .. } = &self.geometry { arm.dot(along) } else { 0.0 }
    }

    /// Whether a normal (of length one, or zero where unknown) fits the surface at a position.
    pub fn holds_normal(&self, position: &Vector3<f64>, point_normal: &Vector3<f64>) -> bool {
        let Some(limit) = self.cos_normal else { return true };
        match &self.geometry {
            Geometry::Sphere { center_mm, .. } => {
                let arm = position - center_mm.coords;
                point_normal.dot(&arm) >= limit * arm.norm() && *point_normal != Vector3::zeros()
            }
            Geometry::Plane { normal, .. } => {
                point_normal.dot(normal) >= limit && *point_normal != Vector3::zeros()
            }
            other => {
                point_normal.dot(&other.normal_at(position)) >= limit && *point_normal != Vector3::zeros()
            }
        }
    }
}

/// A direction on the side of another.
fn same_side(direction: Vector3<f64>, other: &Vector3<f64>) -> Vector3<f64> {
    if direction.dot(other) < 0.0 { -direction } else { direction }
}

impl Exclusion {
    /// Whether a place in the plane, mm along its edges from its nominal point, is cut out.
    pub fn covers(&self, across: [f64; 2]) -> bool {
        let [x, y] = [across[0] - self.center_mm[0], across[1] - self.center_mm[1]];
        match self.shape {
            ExclusionShape::Disc(radius) => x * x + y * y <= radius * radius,
            ExclusionShape::Rectangle([half_x, half_y]) => x.abs() <= half_x && y.abs() <= half_y,
        }
    }
}
