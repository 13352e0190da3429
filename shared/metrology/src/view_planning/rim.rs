//! Edges in the pictures, beside which the matcher keeps no points.

use super::elements::Element;
use super::planner::{PairViews, Planner};
use super::view::View;
use fringe::math::tan;
use nalgebra::{Point2, Vector2};

/// Places around a pixel that are asked: the corners and the middles of the sides of its window.
const AROUND: [[f64; 2]; 8] =
    [[-1.0, -1.0], [0.0, -1.0], [1.0, -1.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 1.0], [0.0, 1.0], [1.0, 1.0]];

/// So many of them beside the surface are an edge; a single one is a speck, as the matcher counts them.
const MISSING: usize = 2;

impl Planner {
    /// Whether the surface ends in the picture of either camera, or the light on it does, within the matcher's margin.
    pub(super) fn is_at_rim(&self, pair: &PairViews, element: &Element) -> bool {
        let edge_px = f64::from(self.conditions.surface.edge_px);
        let cameras = [Some(&pair.left), pair.right.as_ref()];
        edge_px > 0.0
            && cameras.into_iter().flatten().any(|view| self.ends_near(pair, view, element, edge_px))
    }

    fn ends_near(&self, pair: &PairViews, view: &View, element: &Element, edge_px: f64) -> bool {
        let Some(pixel) = view.pixel(&element.at) else { return true };
        let depth_mm = |at: &nalgebra::Point3<f64>| (view.camera.camera_from_world * at).z;
        let own_mm = depth_mm(&element.at);
        let slope = tan(self.conditions.surface.max_slope_deg.to_radians());
        let most_mm = slope * edge_px * own_mm / view.camera.focal_px[0];
        let missing = |offset: &[f64; 2]| {
            let place: Point2<f64> = pixel + Vector2::from(*offset) * edge_px;
            // Beyond the picture nothing is missed.
            if !view.camera.contains(place) {
                return false;
            }
            let Some(ray) = view.camera.ray(place) else { return false };
            let Some((t_mm, triangle)) = self.mesh.first_met(&ray.origin_mm, &ray.direction, 0.0) else {
                return true;
            };
            let at = ray.origin_mm + ray.direction * t_mm;
            let normal = self.mesh.triangles()[triangle as usize].normal;
            let lit = |lamp: &View| lamp.light(&self.mesh, &at, &normal) > 0.0;
            (depth_mm(&at) - own_mm).abs() > most_mm || !pair.projector.as_ref().is_none_or(lit)
        };
        AROUND.iter().filter(|offset| missing(offset)).count() >= MISSING
    }
}
