//! Where the part stands in a cycle, and how it shakes from frame to frame.

use crate::settings::TwinSettings;
use fringe::math::random::{Key, Normal};
use fringe::math::{cos, sin};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};

/// Separates the streams of draws of one seed.
const POSE: u64 = 1;
const VIBRATION: u64 = 2;

/// The rotation Rz·Ry·Rx of three angles (rad) about x, y, z.
pub fn rotation(about_rad: [f64; 3]) -> UnitQuaternion<f64> {
    let half = |axis: usize| {
        let mut q = [cos(0.5 * about_rad[axis]), 0.0, 0.0, 0.0];
        q[axis + 1] = sin(0.5 * about_rad[axis]);
        UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]))
    };
    half(2) * half(1) * half(0)
}

/// Pose of the part in a cycle: seeded, even within the scatter of the settings.
pub fn of_cycle(settings: &TwinSettings, cycle: u64) -> Isometry3<f64> {
    let key = Key::new(settings.seed).with(POSE).with(cycle);
    let draw = |i: u64| key.symmetric(i);
    let shift_mm = Vector3::new(draw(0), draw(1), draw(2)) * settings.position_scatter_mm;
    let limit_rad = settings.angle_scatter_deg.to_radians();
    let turn = rotation([draw(3) * limit_rad, draw(4) * limit_rad, draw(5) * limit_rad]);
    Isometry3::from_parts(Translation3::from(shift_mm), turn)
}

/// Displacement of the part during one frame, mm in the world frame: all cameras see the same.
pub fn vibration_mm(
    settings: &TwinSettings,
    normal: &Normal,
    cycle: u64,
    projector: usize,
    frame: usize,
) -> Vector3<f64> {
    let seed = settings.seed_of_noise();
    let key = Key::new(seed).with(VIBRATION).with(cycle).with(projector as u64).with(frame as u64);
    let draw = |i: u64| f64::from(normal.draw(key.bits(i)));
    let drift_mm = Vector3::z() * (settings.drift_um * 1e-3 * frame as f64);
    Vector3::new(draw(0), draw(1), draw(2)) * (settings.vibration_um * 1e-3) + drift_mm
}
