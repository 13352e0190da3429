//! A camera or projector, ready to look at the part.

use super::elements::{Element, SKIN_MM};
use crate::spatial::TriangleMesh;
use fringe::geometry::camera::Camera;
use nalgebra::{Point2, Point3, Vector3};

/// A view of the rig.
#[derive(Debug, Clone)]
pub(super) struct View {
    /// Name in the rig.
    pub name: String,
    pub camera: Camera,
    /// Its optical centre, mm.
    pub centre: Point3<f64>,
    /// Squared ideal radius of its chip, see [`Camera::reach2`].
    reach2: f64,
    /// Distance to the middle of the part, mm: there the light of a projector counts as 1.
    pub reference_mm: f64,
}

impl View {
    pub fn new(name: &str, camera: &Camera, middle: &Point3<f64>) -> Self {
        let centre = camera.centre_mm();
        Self {
            name: name.to_owned(),
            centre,
            reach2: camera.reach2(),
            reference_mm: (centre - middle).norm(),
            camera: camera.clone(),
        }
    }

    /// Pixel of a point, where it lies on the chip.
    pub fn pixel(&self, at: &Point3<f64>) -> Option<Point2<f64>> {
        let seen = self.camera.camera_from_world * at;
        if seen.x * seen.x + seen.y * seen.y > self.reach2 * seen.z * seen.z {
            return None;
        }
        self.camera.project(at).filter(|pixel| self.camera.contains(*pixel))
    }

    /// Cosine at which a face is seen; zero or less from behind.
    pub fn cosine(&self, element: &Element) -> f64 {
        let way = self.centre - element.at;
        element.normal.dot(&way) / way.norm()
    }

    /// Whether the part hides a face that looks at this view.
    pub fn is_hidden(&self, mesh: &TriangleMesh, at: &Point3<f64>, normal: &Vector3<f64>) -> bool {
        let start = at + normal * SKIN_MM;
        let way = self.centre - start;
        let length = way.norm();
        mesh.is_blocked(&start, &(way / length), (SKIN_MM, length))
    }

    /// Light of this projector on a face, in units of what a face receives at the middle of the part that looks at it; zero in shadow.
    pub fn light(&self, mesh: &TriangleMesh, at: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let light = self.unhidden_light(at, normal);
        if light <= 0.0 || self.pixel(at).is_none() || self.is_hidden(mesh, at, normal) { 0.0 } else { light }
    }

    /// The same without shadows and the borders of its picture; negative from behind.
    pub fn unhidden_light(&self, at: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let way = self.centre - at;
        let distance2 = way.norm_squared();
        normal.dot(&way) / distance2.sqrt() * self.reference_mm * self.reference_mm / distance2
    }
}
