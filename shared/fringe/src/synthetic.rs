//! Analytic scenes with exact phase maps, without a renderer: synthetic data for tests of this crate and of those above it.

use crate::geometry::camera::{Camera, Lens, Ray};
use crate::pattern::Axis;
use crate::phase::{PhaseInfo, PhaseMap};
use nalgebra::{Isometry3, Point2, Point3, Unit, UnitQuaternion, Vector3};
use std::f64::consts::{PI, TAU};

/// A surface that a ray meets.
#[derive(Debug, Clone, Copy)]
pub enum Surface {
    /// The plane n·X = distance.
    Plane {
        /// Normal n, unit vector.
        normal: Vector3<f64>,
        /// Distance of the origin along the normal, mm.
        distance_mm: f64,
    },
    /// Outside of a ball.
    Sphere {
        /// Centre of the sphere, mm.
        centre: Point3<f64>,
        /// Radius of the sphere, mm.
        radius_mm: f64,
    },
}

impl Surface {
    /// A plane from a normal of any length.
    pub fn plane(normal: [f64; 3], distance_mm: f64) -> Self {
        Self::Plane { normal: Vector3::from(normal).normalize(), distance_mm }
    }

    /// Distance along the ray to the first meeting.
    fn meet(&self, ray: &Ray) -> Option<f64> {
        match self {
            Self::Plane { normal, distance_mm } => {
                let along = normal.dot(&ray.direction);
                let t = (distance_mm - normal.dot(&ray.origin_mm.coords)) / along;
                (t > 0.0 && t.is_finite()).then_some(t)
            }
            Self::Sphere { centre, radius_mm } => {
                let from = ray.origin_mm - centre;
                let half = from.dot(&ray.direction);
                let root = half * half - from.norm_squared() + radius_mm * radius_mm;
                (root >= 0.0).then(|| -half - root.sqrt()).filter(|t| *t > 0.0)
            }
        }
    }

    /// Signed distance of a point, positive outside (towards the normal).
    pub fn distance(&self, at: &Point3<f64>) -> f64 {
        match self {
            Self::Plane { normal, distance_mm } => normal.dot(&at.coords) - distance_mm,
            Self::Sphere { centre, radius_mm } => (at - centre).norm() - radius_mm,
        }
    }

    /// Unit normal at a point of the surface.
    pub fn normal(&self, at: &Point3<f64>) -> Vector3<f64> {
        match self {
            Self::Plane { normal, .. } => *normal,
            Self::Sphere { centre, .. } => (at - centre).normalize(),
        }
    }
}

/// A scene lit by one projector.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Opaque surfaces; the first that a ray meets counts.
    pub surfaces: Vec<Surface>,
    /// The projector as an inverse camera.
    pub projector: Camera,
    /// Period of the fringes, projector pixels.
    pub period_px: f64,
}

impl Scene {
    /// First meeting of a ray, with the surface that it is on.
    pub fn trace(&self, ray: &Ray) -> Option<(Point3<f64>, Surface)> {
        let hits = self.surfaces.iter().filter_map(|s| Some((s.meet(ray)?, *s)));
        let (t, surface) = hits.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((ray.origin_mm + ray.direction * t, surface))
    }

    /// The lit projector pixel of a point, unless it lies in shadow or outside the projector's image.
    fn lit(&self, at: &Point3<f64>) -> Option<Point2<f64>> {
        let origin_mm = self.projector.centre_mm();
        let ray = Ray { origin_mm, direction: (at - origin_mm).normalize() };
        let (first, _) = self.trace(&ray)?;
        let pixel = self.projector.project(at)?;
        ((first - at).norm() < 1e-6 && self.projector.contains(pixel)).then_some(pixel)
    }

    /// The phase map that a camera sees: the phase of each pixel's centre ray, with Gaussian noise of `sigma_rad`.
    pub fn phase_map(&self, camera: &Camera, axis: Axis, sigma_rad: f64, seed: u64) -> PhaseMap {
        let (width_px, height_px) = (camera.width_px, camera.height_px);
        let mut map = PhaseMap::new(PhaseInfo { width_px, height_px, axis, period_px: self.period_px });
        let mut noise = Noise(seed);
        for index in 0..map.info.len() {
            let deviation = noise.gauss() * sigma_rad;
            let pixel = pixel_of(index, width_px);
            let seen = camera.ray(pixel).and_then(|ray| self.trace(&ray)).and_then(|(at, _)| self.lit(&at));
            if let Some(lit) = seen {
                let coordinate = if axis == Axis::X { lit.x } else { lit.y };
                map.phase_rad[index] = (coordinate * TAU / self.period_px + deviation) as f32;
                map.sigma_rad[index] = sigma_rad as f32;
                map.modulation[index] = 100.0;
                map.valid[index] = 1;
            }
        }
        map
    }
}

/// Centre of the pixel with this index in a raster of this width.
pub fn pixel_of(index: usize, width_px: u32) -> Point2<f64> {
    let width = width_px as usize;
    Point2::new((index % width) as f64, (index / width) as f64)
}

/// A camera `from` looking at `target` with its image x axis close to `right`, demo optics scaled to its width.
pub fn looking(from: [f64; 3], target: [f64; 3], right: [f64; 3], width_px: u32, height_px: u32) -> Camera {
    let (from, target) = (Point3::from(from), Point3::from(target));
    let z = Unit::new_normalize(target - from);
    let y = z.cross(&Vector3::from(right)).normalize();
    let x = y.cross(&z);
    let rotation = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(
        nalgebra::Matrix3::from_columns(&[x, y, z.into_inner()]),
    ));
    let world_from_camera = Isometry3::from_parts(from.coords.into(), rotation);
    let focal = 2330.0 * f64::from(width_px) / 1124.0;
    Camera {
        width_px,
        height_px,
        focal_px: [focal, focal * 0.999],
        principal_point_px: [f64::from(width_px) * 0.497, f64::from(height_px) * 0.505],
        skew: 0.1,
        distortion: Lens::brown_conrady([-0.08, 0.05, 0.0], [2e-4, -2e-4]),
        camera_from_world: world_from_camera.inverse(),
    }
}

/// The demo geometry: cameras 500 mm from the origin at ±12°, a projector between them; x right, z up to the cell.
pub fn rig(width_px: u32, height_px: u32) -> [Camera; 3] {
    let at = |degrees: f64| {
        let angle = degrees * PI / 180.0;
        [500.0 * crate::math::sin(angle), -20.0, 500.0 * crate::math::cos(angle)]
    };
    let right = [1.0, 0.02, 0.0];
    let mut projector = looking(at(1.0), [0.0; 3], right, 608, 684);
    projector.focal_px = [1500.0, 1500.0];
    projector.distortion = Lens::brown_conrady([-0.03, 0.0, 0.0], [1e-4, -1e-4]);
    [
        looking(at(-12.0), [1.0, 2.0, 0.0], right, width_px, height_px),
        looking(at(12.0), [-2.0, 0.0, 1.0], right, width_px, height_px),
        projector,
    ]
}

/// Noise from a seed (SplitMix64).
#[derive(Debug, Clone)]
pub struct Noise(pub u64);

impl Noise {
    /// The next 64 bits.
    pub fn next_bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A uniform value in (0, 1).
    pub fn unit(&mut self) -> f64 {
        ((self.next_bits() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    /// Standard normal deviate (Box–Muller).
    pub fn gauss(&mut self) -> f64 {
        let radius = (-2.0 * crate::math::ln(self.unit())).sqrt();
        radius * crate::math::cos(TAU * self.unit())
    }
}
