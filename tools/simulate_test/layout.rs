//! Where artefacts stand in the measuring volume.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// Edges of the measuring volume of the thesis, section 6.4, along the axes of the world, mm.
pub const VOLUME_MM: [f64; 3] = [140.0, 140.0, 90.0];

/// Middle of the measuring volume in the world, mm.
pub const MIDDLE_MM: [f64; 3] = [0.0, 0.0, 15.0];

/// Places of the test sphere: three heights, as in the thesis.
const SPHERE_MM: [[f64; 3]; 3] = [[-18.0, -15.0, -2.0], [20.0, -8.0, 16.0], [0.0, 18.0, 34.0]];

/// Views of a sphere position: the turntable goes on by 72°.
const VIEWS: usize = 5;

/// Places of the bar: azimuth and elevation of its axis in degrees, middle in mm. Two level diagonals, four inclined
/// ones, one nearly along the first sensor's line of sight.
const BARS: [(f64, f64, [f64; 3]); 7] = [
    (45.0, 0.0, [0.0, 0.0, 5.0]),
    (135.0, 0.0, [0.0, 0.0, 25.0]),
    (45.0, 22.0, [0.0, 0.0, 15.0]),
    (135.0, 22.0, [0.0, 0.0, 15.0]),
    (225.0, 22.0, [0.0, 0.0, 15.0]),
    (315.0, 22.0, [0.0, 0.0, 15.0]),
    (25.0, 8.0, [0.0, 0.0, 15.0]),
];

/// One recording of the test.
pub struct TestRecording {
    /// Name of the recording's folder.
    pub name: String,
    /// Position that it belongs to.
    pub position: String,
    /// View of the position.
    pub view: String,
    /// Ball bar, or test sphere.
    pub bar: bool,
    azimuth_deg: f64,
    elevation_deg: f64,
    middle_mm: [f64; 3],
}

impl TestRecording {
    /// Nominal motion of the artefact: first the inclination, then the turn about the vertical.
    pub fn place(&self) -> Isometry3<f64> {
        let (elevation, azimuth) = (-self.elevation_deg.to_radians(), self.azimuth_deg.to_radians());
        let turn = UnitQuaternion::from_euler_angles(0.0, elevation, azimuth);
        Isometry3::from_parts(Vector3::from(self.middle_mm).into(), turn)
    }
}

/// All recordings of a test.
pub fn recordings(reduced: bool) -> Vec<TestRecording> {
    let (positions, views, bars) = if reduced { (1, 2, 2) } else { (SPHERE_MM.len(), VIEWS, BARS.len()) };
    let mut recordings = Vec::new();
    for (p, middle_mm) in SPHERE_MM.iter().take(positions).enumerate() {
        for v in 0..views {
            recordings.push(TestRecording {
                name: format!("sphere{}-view{}", p + 1, v + 1),
                position: format!("sphere {}", p + 1),
                view: format!("view {}", v + 1),
                bar: false,
                azimuth_deg: 360.0 / VIEWS as f64 * v as f64,
                elevation_deg: 0.0,
                middle_mm: *middle_mm,
            });
        }
    }
    for (b, (azimuth_deg, elevation_deg, middle_mm)) in BARS.iter().take(bars).enumerate() {
        recordings.push(TestRecording {
            name: format!("bar{}", b + 1),
            position: format!("bar {}", b + 1),
            view: "view 1".to_owned(),
            bar: true,
            azimuth_deg: *azimuth_deg,
            elevation_deg: *elevation_deg,
            middle_mm: *middle_mm,
        });
    }
    recordings
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    /// The spheres of the bar are 150.04 mm apart; the twin places artefacts up to a millimetre beside their nominal place.
    #[test]
    fn every_centre_lies_in_the_volume() {
        for recording in recordings(false) {
            let ends: &[f64] = if recording.bar { &[-75.02, 75.02] } else { &[0.0] };
            for x in ends {
                let centre = recording.place() * Point3::new(*x, 0.0, 0.0);
                for axis in 0..3 {
                    let off = (centre[axis] - MIDDLE_MM[axis]).abs();
                    assert!(off < 0.5 * VOLUME_MM[axis] - 2.0, "{}: {off} mm along {axis}", recording.name);
                }
            }
        }
    }
}
