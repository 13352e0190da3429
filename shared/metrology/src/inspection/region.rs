//! Which points belong to an element.

use nalgebra::Vector3;

use super::plan::{Element, Exclusion, ExclusionShape, Geometry};
use crate::fit::{PlaneFit, SphereFit, tangents};
use fringe::math;

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
        }
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
        }
    }
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
