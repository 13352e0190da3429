//! A rig as it is meant, before anything is calibrated: cameras and projector side by side, looking at the middle of the volume.

use fringe::geometry::camera::{Camera, Lens};
use fringe::geometry::rig::{Named, Pair, Rig};
use fringe::math::{cos, sin};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Angle between two neighbouring cameras, seen from the part, degrees.
const STEP_DEG: f64 = 24.0;

/// What is meant to stand where.
#[derive(Debug, Clone, PartialEq)]
pub struct Intended {
    /// Columns and rows of each camera, px.
    pub cameras_px: Vec<[u32; 2]>,
    /// Columns and rows of the projector, px.
    pub projector_px: [u32; 2],
    /// From each device to the part, mm.
    pub distance_mm: f64,
    /// What a device sees or lights along its rows at that distance, mm.
    pub field_mm: f64,
}

impl Intended {
    /// The rig: cameras "cam1" and on, "proj1" in their middle, a pair of each two neighbours; of a single camera its pair with the
    /// projector. No lens distorts.
    pub fn rig(&self) -> Rig {
        let count = self.cameras_px.len();
        let half = 0.5 * (count.max(2) - 1) as f64;
        let named = |name: String, size_px: [u32; 2], azimuth_deg: f64| {
            let camera = self.device(size_px, azimuth_deg);
            Named { name, camera }
        };
        let cameras = self.cameras_px.iter().enumerate().map(|(number, size_px)| {
            named(format!("cam{}", number + 1), *size_px, (number as f64 - half) * STEP_DEG)
        });
        let pair = |number: usize, left: usize, right: String| Pair {
            name: format!("pair{number}"),
            left: format!("cam{left}"),
            right,
            projector: "proj1".to_owned(),
        };
        let pairs = match count {
            0 => Vec::new(),
            1 => vec![pair(1, 1, "proj1".to_owned())],
            _ => (1..count).map(|left| pair(left, left, format!("cam{}", left + 1))).collect(),
        };
        Rig {
            cameras: cameras.collect(),
            // Of an even number of cameras it stands between two, of an odd number above the middle one.
            projectors: vec![named("proj1".to_owned(), self.projector_px, 0.0)],
            pairs,
            sensors: BTreeMap::new(),
        }
    }

    /// A device at an azimuth, elevated by 45°, that looks at the origin.
    fn device(&self, [width_px, height_px]: [u32; 2], azimuth_deg: f64) -> Camera {
        let azimuth = azimuth_deg.to_radians();
        let flat = std::f64::consts::FRAC_1_SQRT_2;
        let centre = Point3::new(flat * sin(azimuth), -flat * cos(azimuth), flat) * self.distance_mm;
        let focal_px = f64::from(width_px) * self.distance_mm / self.field_mm;
        Camera {
            width_px,
            height_px,
            focal_px: [focal_px; 2],
            principal_point_px: [0.5 * (f64::from(width_px) - 1.0), 0.5 * (f64::from(height_px) - 1.0)],
            skew: 0.0,
            distortion: Lens::brown_conrady([0.0; 3], [0.0; 2]),
            camera_from_world: looking_at_origin(centre),
        }
    }
}

fn looking_at_origin(centre: Point3<f64>) -> Isometry3<f64> {
    let forward = -centre.coords.normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rows = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    Isometry3::from_parts((-(rotation * centre.coords)).into(), rotation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_device_sees_the_middle_of_the_volume_in_its_middle() {
        for count in 1..=5 {
            let intended = Intended {
                cameras_px: vec![[1124, 750]; count],
                projector_px: [1920, 1080],
                distance_mm: 500.0,
                field_mm: 240.0,
            };
            let rig = intended.rig();
            assert_eq!((rig.cameras.len(), rig.pairs.len()), (count, count.saturating_sub(1).max(1)));
            for device in rig.cameras.iter().chain(&rig.projectors) {
                let camera = &device.camera;
                let seen = camera.project(&Point3::origin()).unwrap();
                let middle = camera.principal_point_px;
                assert!(
                    (seen.x - middle[0]).abs() < 1e-6 && (seen.y - middle[1]).abs() < 1e-6,
                    "{}",
                    device.name
                );
                // The field is that across the line of sight: nearer points appear farther out.
                let border = camera.camera_from_world.inverse() * Point3::new(119.0, 0.0, 500.0);
                let edge = camera.project(&border).unwrap();
                assert!(camera.contains(edge), "{}: {edge}", device.name);
            }
        }
    }
}
