//! The complex artefact as analytic bodies, seen by two parallel views: independent of the digital twin.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::fit::tangents;
use crate::fit::tests::Noise;
use fringe::cloud::Point;
use fringe::math;

/// A body in the part frame.
#[derive(Clone)]
pub enum Solid {
    Sphere {
        center: Vector3<f64>,
        radius: f64,
    },
    /// The upper half of a sphere about the origin.
    Dome {
        radius: f64,
    },
    /// An upright cylinder from z = 0.
    Post {
        center: Vector3<f64>,
        radius: f64,
        height: f64,
    },
    /// The points with n · x ≤ d for all (n, d).
    Convex(Vec<(Vector3<f64>, f64)>),
}

/// What is measured and how.
pub struct Setup {
    pub bodies: Vec<(&'static str, Solid)>,
    pub world_from_part: Isometry3<f64>,
    /// Grid of the rays, mm.
    pub pitch_mm: f64,
    /// Noise along the ray, mm.
    pub sigma_mm: f64,
    pub seed: u64,
}

const SPHERE_XY: f64 = 39.756_018_112;

fn bounded(low: [f64; 3], high: [f64; 3]) -> Vec<(Vector3<f64>, f64)> {
    let axis = |i: usize| Vector3::from_fn(|r, _| if r == i { 1.0 } else { 0.0 });
    (0..3).flat_map(|i| [(axis(i), high[i]), (-axis(i), -low[i])]).collect()
}

fn wedge(low: [f64; 3], high: [f64; 3], towards: Vector3<f64>, inclination_deg: f64) -> Solid {
    let (sin, cos) = math::sincos(inclination_deg.to_radians());
    let normal = towards * sin + Vector3::z() * cos;
    let foot = towards.component_mul(&Vector3::from(high));
    let mut faces = bounded(low, high);
    faces.push((normal, normal.dot(&foot)));
    Solid::Convex(faces)
}

/// The bodies of configs/complex-artefact.scene.toml.
pub fn bodies() -> Vec<(&'static str, Solid)> {
    let place = |s: f64| Vector3::new(s * SPHERE_XY, s * SPHERE_XY, 28.0);
    let post = |s: f64| Solid::Post { center: place(s), radius: 4.0, height: 28.0 };
    vec![
        ("base", Solid::Convex(bounded([-55.0, -55.0, -10.769], [55.0, 55.0, 0.0]))),
        ("hemisphere", Solid::Dome { radius: 0.5 * 60.194 }),
        ("sphere1", Solid::Sphere { center: place(-1.0), radius: 0.5 * 22.462 }),
        ("post1", post(-1.0)),
        ("sphere2", Solid::Sphere { center: place(1.0), radius: 0.5 * 22.367 }),
        ("post2", post(1.0)),
        ("wedge1", wedge([26.0, -50.0, 0.0], [50.0, -26.0, 12.0], Vector3::x(), 44.964)),
        ("wedge2", wedge([-50.0, 26.0, 0.0], [-26.0, 50.0, 12.0], Vector3::y(), 44.809)),
        ("step", Solid::Convex(bounded([-12.0, -52.0, 0.0], [12.0, -36.0, 8.0]))),
    ]
}

/// The features' true values.
pub const TRUTH: [(&str, f64); 8] = [
    ("sphere1_diameter", 22.462),
    ("sphere2_diameter", 22.367),
    ("sphere_spacing", 112.447),
    ("hemisphere_diameter", 60.194),
    ("hemisphere_height", 30.097),
    ("wedge1_inclination", 44.964),
    ("wedge2_inclination", 44.809),
    ("step_height", 8.0),
];

/// A pose within ± the limits.
pub fn pose(noise: &mut Noise, shift_mm: f64, turn_deg: f64) -> Isometry3<f64> {
    let mut draw = |limit: f64| (2.0 * noise.uniform() - 1.0) * limit;
    let shift = Vector3::new(draw(shift_mm), draw(shift_mm), draw(shift_mm));
    let limit = turn_deg.to_radians();
    let turn = Vector3::new(draw(limit), draw(limit), draw(limit));
    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(turn))
}

impl Setup {
    pub fn new(seed: u64) -> Self {
        let world_from_part = pose(&mut Noise(seed ^ 0xABCD), 2.0, 2.0);
        Self { bodies: bodies(), world_from_part, pitch_mm: 0.5, sigma_mm: 0.012, seed }
    }

    pub fn without(mut self, names: &[&str]) -> Self {
        self.bodies.retain(|(name, _)| !names.contains(name));
        self
    }

    /// Two views from azimuth 0° and 90°, elevation 48°. The noise of neighbours along a row is correlated (0.45), as
    /// that of points matched by interpolation between shared pixels is.
    pub fn cloud(&self) -> Vec<Point> {
        let mut noise = Noise(self.seed.wrapping_mul(0x1234_5678_9ABC_DEF1));
        let part_from_world = self.world_from_part.inverse();
        let (sin, cos) = math::sincos(48f64.to_radians());
        let mut points = Vec::new();
        for (pair, azimuth) in [Vector3::x(), Vector3::y()].into_iter().enumerate() {
            let view = -(azimuth * cos + Vector3::z() * sin);
            let [e1, e2] = tangents(&view);
            let half = (85.0 / self.pitch_mm) as i32;
            for row in -half..=half {
                let mut previous = noise.normal();
                for column in -half..=half {
                    let fresh = noise.normal();
                    let error = (fresh + 0.63 * previous) / (1.0f64 + 0.63 * 0.63).sqrt() * self.sigma_mm;
                    previous = fresh;
                    let across =
                        e1 * (f64::from(column) * self.pitch_mm) + e2 * (f64::from(row) * self.pitch_mm);
                    let start = Vector3::new(0.0, 0.0, 15.0) + across - view * 300.0;
                    let origin = part_from_world * nalgebra::Point3::from(start);
                    let Some((way, normal)) = self.hit(&origin.coords, &(part_from_world * view)) else {
                        continue;
                    };
                    let normal = self.world_from_part * normal + noise.direction() * 0.02;
                    points.push(Point {
                        position_mm: (start + view * (way + error)).into(),
                        normal: (normal / normal.norm()).map(|v| v as f32).into(),
                        sigma_mm: self.sigma_mm as f32,
                        modulation: 80.0,
                        pair: pair as u32,
                        pixel: 0,
                        shared_mm: 0.0,
                    });
                }
            }
        }
        points
    }

    fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
        let hits = self.bodies.iter().filter_map(|(_, body)| body.hit(origin, direction));
        hits.min_by(|a, b| a.0.total_cmp(&b.0))
    }
}

impl Solid {
    fn hit(&self, o: &Vector3<f64>, d: &Vector3<f64>) -> Option<(f64, Vector3<f64>)> {
        match self {
            Self::Sphere { center, radius } => sphere(o, d, center, *radius),
            Self::Dome { radius } => {
                sphere(o, d, &Vector3::zeros(), *radius).filter(|(t, _)| (o + d * *t).z >= 0.0)
            }
            Self::Post { center, radius, height } => {
                let (flat, way) = (Vector3::new(1.0, 1.0, 0.0), d.xy().norm());
                let hit = sphere(
                    &((o - center).component_mul(&flat)),
                    &(d.component_mul(&flat) / way),
                    &Vector3::zeros(),
                    *radius,
                );
                hit.map(|(t, n)| (t / way, n)).filter(|(t, _)| (0.0..=*height).contains(&(o + d * *t).z))
            }
            Self::Convex(faces) => convex(o, d, faces),
        }
    }
}

fn sphere(
    o: &Vector3<f64>,
    d: &Vector3<f64>,
    center: &Vector3<f64>,
    radius: f64,
) -> Option<(f64, Vector3<f64>)> {
    let arm = o - center;
    let b = arm.dot(d);
    let root = b * b - arm.norm_squared() + radius * radius;
    (root > 0.0).then(|| -b - root.sqrt()).map(|t| (t, (arm + d * t) / radius))
}

fn convex(o: &Vector3<f64>, d: &Vector3<f64>, faces: &[(Vector3<f64>, f64)]) -> Option<(f64, Vector3<f64>)> {
    let (mut enter, mut leave, mut normal) = (f64::NEG_INFINITY, f64::INFINITY, Vector3::zeros());
    for (n, limit) in faces {
        let (speed, gap) = (n.dot(d), limit - n.dot(o));
        if speed < 0.0 && gap / speed > enter {
            (enter, normal) = (gap / speed, *n);
        } else if speed > 0.0 {
            leave = leave.min(gap / speed);
        }
    }
    (enter < leave).then_some((enter, normal))
}
