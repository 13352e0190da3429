//! Whence a pair of views saw its points.

use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Whence a camera saw points, and how far from a limb it shifts them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Viewpoint {
    /// Optical centre of the camera, in the frame of the points, mm.
    pub place_mm: [f64; 3],
    /// Points of a curved surface whose line of sight passes nearer than this to where it turns away are shifted by what lies beyond, rad.
    pub limb_rad: f64,
}

impl Viewpoint {
    /// The place as a point.
    pub fn place(&self) -> Point3<f64> {
        Point3::from(self.place_mm)
    }

    /// Whether the numbers are those of a camera.
    pub fn is_finite(&self) -> bool {
        self.place_mm.iter().all(|value| value.is_finite()) && (0.0..1.0).contains(&self.limb_rad)
    }
}

/// Whence a pair saw its points.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Viewpoints {
    /// The left camera, on whose lines of sight the points lie.
    pub own: Viewpoint,
    /// The right one; absent where a projector takes its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub other: Option<Viewpoint>,
}

impl Viewpoints {
    /// All cameras of the pair.
    pub fn all(&self) -> impl Iterator<Item = &Viewpoint> {
        [Some(&self.own), self.other.as_ref()].into_iter().flatten()
    }
}
