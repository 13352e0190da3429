//! Light that reaches an element by way of other faces.

use super::elements::{Element, SKIN_MM};
use super::planner::Planner;
use super::view::View;
use fringe::math::sincos;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Turns from one direction to the next, of the golden section: directions that are spread evenly whatever their number.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

impl Planner {
    /// Light of the first bounce as a share of the direct light: ρ mean(E) / E, the mean over directions spread with the cosine. NaN
    /// where no directions are followed.
    pub(super) fn bounce(&self, projector: &View, element: &Element) -> f64 {
        let count = self.conditions.bounce_rays;
        let own = projector.unhidden_light(&element.at, &element.normal);
        if count == 0 || own <= 0.0 {
            return f64::NAN;
        }
        let least = if element.normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let side = element.normal.cross(&least).normalize();
        let other = element.normal.cross(&side);
        let start = element.at + element.normal * SKIN_MM;
        let mut sum = 0.0;
        for ray in 0..count {
            let share = (f64::from(ray) + 0.5) / f64::from(count);
            let (sin, cos) = sincos(TAU * (GOLDEN * f64::from(ray)).fract());
            let (flat, up) = (share.sqrt(), (1.0 - share).sqrt());
            let towards = side * (flat * cos) + other * (flat * sin) + element.normal * up;
            let Some((t_mm, triangle)) = self.mesh.first_met(&start, &towards, SKIN_MM) else { continue };
            let normal = self.mesh.triangles()[triangle as usize].normal;
            // The back of a face, in an open mesh, sends no light.
            if normal.dot(&towards) < 0.0 {
                sum += projector.light(&self.mesh, &(start + towards * t_mm), &normal);
            }
        }
        self.conditions.albedo * sum / f64::from(count) / own
    }
}
