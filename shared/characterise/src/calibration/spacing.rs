//! The predicted standard uncertainty of a sphere spacing over the working volume.

use super::result::Calibration;
use metrology::fit::tangents;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// Bars of one direction along each axis of the volume.
const STEPS: i32 = 4;

/// A box about the origin of its own frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// Pose of the volume in the world frame.
    pub world_from_volume: Isometry3<f64>,
    /// Half of the edges along its own axes, mm.
    pub half_mm: Vector3<f64>,
}

/// Predicted uncertainty of the sphere spacing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpacingSettings {
    /// Distance of the spheres' centres, mm.
    pub spacing_mm: f64,
    /// Standard uncertainty of each centre by noise and form, mm.
    pub u_centre_mm: f64,
    /// Relative standard uncertainty of the target's pitch: the scale that no adjustment can see.
    pub u_pitch_relative: f64,
}

impl Default for SpacingSettings {
    fn default() -> Self {
        Self { spacing_mm: 120.0, u_centre_mm: 0.0, u_pitch_relative: 0.0 }
    }
}

/// The prediction over a volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereSpacing {
    /// Root mean square of the standard uncertainty over all bars, mm.
    pub rms_mm: f64,
    /// Largest standard uncertainty, mm.
    pub worst_mm: f64,
    /// Ends of the bar that has it.
    pub worst_ends_mm: [Point3<f64>; 2],
    /// Index of its pair.
    pub worst_pair: usize,
    /// Bars that at least one pair sees.
    pub bars: usize,
}

impl Calibration {
    /// The box about all points of the target in all poses; `None` without poses.
    ///
    /// Its z axis is the mean normal of the boards and its x axis lies in the x–z plane of the world, so that it does not
    /// grow with the tilt of the board that happens to be the world. Its corners may lie where no board was.
    pub fn volume(&self) -> Option<Volume> {
        let normals = self.boards.iter().flatten().map(|b| b.rotation * Vector3::<f64>::z());
        let z = normals.fold(Vector3::zeros(), |sum, n| sum + n).try_normalize(1e-9)?;
        let x = (Vector3::x() - z * z.x).try_normalize(1e-3).unwrap_or_else(|| tangents(&z)[0]);
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, z.cross(&x), z]));
        let rotation = UnitQuaternion::from_rotation_matrix(&axes);
        let own = rotation.inverse();
        let points =
            || self.boards.iter().flatten().flat_map(|b| self.target_mm.iter().map(move |p| own * (b * p)));
        let bound = |start: f64, pick: fn(f64, f64) -> f64| {
            points().fold(Vector3::repeat(start), |bound, p| bound.zip_map(&p.coords, pick))
        };
        let (low, high) = (bound(f64::INFINITY, f64::min), bound(f64::NEG_INFINITY, f64::max));
        let centre = rotation * ((low + high) * 0.5);
        Some(Volume {
            world_from_volume: Isometry3::from_parts(centre.into(), rotation),
            half_mm: (high - low) * 0.5,
        })
    }

    /// Standard uncertainty of a sphere spacing (k = 1) for bars in thirteen directions all over a volume.
    ///
    /// Each bar is measured by each pair that sees both its ends. Systematic part: the covariance of the calibration,
    /// with all correlations between both ends. `None` when no pair sees any bar.
    pub fn sphere_spacing_u_mm(
        &self,
        pairs: &[[usize; 2]],
        volume: &Volume,
        settings: &SpacingSettings,
    ) -> Option<SphereSpacing> {
        let mut found: Option<SphereSpacing> = None;
        let mut squares = 0.0;
        for ends in bars(volume, settings.spacing_mm) {
            for (number, pair) in pairs.iter().enumerate() {
                let Some(square) = self.spacing_variance_mm2(pair, &ends, settings) else { continue };
                squares += square;
                let bars = found.map_or(0, |f| f.bars) + 1;
                let rms_mm = (squares / bars as f64).sqrt();
                let (worst_mm, worst_ends_mm, worst_pair) = match found {
                    Some(f) if f.worst_mm >= square.sqrt() => (f.worst_mm, f.worst_ends_mm, f.worst_pair),
                    _ => (square.sqrt(), ends, number),
                };
                found = Some(SphereSpacing { rms_mm, worst_mm, worst_ends_mm, worst_pair, bars });
            }
        }
        found
    }

    /// Variance of one bar, mm²; `None` where the pair does not see both ends.
    pub(super) fn spacing_variance_mm2(
        &self,
        pair: &[usize; 2],
        ends: &[Point3<f64>; 2],
        settings: &SpacingSettings,
    ) -> Option<f64> {
        let constant =
            2.0 * settings.u_centre_mm.powi(2) + (settings.spacing_mm * settings.u_pitch_relative).powi(2);
        ends.iter().all(|end| self.sees(pair, end)).then_some(())?;
        let u = self.distance_u_mm([(pair, &ends[0]), (pair, &ends[1])])?;
        Some(u * u + constant)
    }

    pub(super) fn sees(&self, pair: &[usize; 2], point: &Point3<f64>) -> bool {
        pair.iter().all(|device| {
            let camera = self.devices.get(*device).map(|d| &d.camera);
            camera.is_some_and(|c| c.project(point).is_some_and(|pixel| c.contains(pixel)))
        })
    }
}

/// Unit vectors along the edges of a cube, the diagonals of its faces and those of space: thirteen.
pub(super) fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let all =
        (0..27).map(|i| Vector3::new(f64::from(i / 9 - 1), f64::from(i / 3 % 3 - 1), f64::from(i % 3 - 1)));
    // Of each direction and its opposite only the later one; 13 is the zero vector.
    all.skip(14).map(|d| d / d.norm())
}

/// Bars of a length inside a box: along the edges, the diagonals of the faces and those of space, on a grid each.
fn bars(volume: &Volume, length_mm: f64) -> Vec<[Point3<f64>; 2]> {
    let mut bars = Vec::new();
    for direction in directions() {
        let half = direction * (0.5 * length_mm);
        let room = volume.half_mm - half.abs();
        if room.min() < 0.0 || !room.iter().all(|r| r.is_finite()) {
            continue;
        }
        for i in 0..(STEPS + 1).pow(3) {
            let step = |k: i32| 2.0 * f64::from(k % (STEPS + 1)) / f64::from(STEPS) - 1.0;
            let place = Vector3::new(step(i), step(i / (STEPS + 1)), step(i / (STEPS + 1).pow(2)));
            let middle = Point3::from(place.component_mul(&room));
            bars.push([middle - half, middle + half].map(|end| volume.world_from_volume * end));
        }
    }
    bars
}
