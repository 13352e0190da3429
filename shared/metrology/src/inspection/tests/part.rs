//! A machined part as points: a block with bore, slot, boss, cone, ball and ring, each where and as large as a test says.

use nalgebra::Vector3;

use crate::fit::tangents;
use crate::fit::tests::Noise;
use fringe::cloud::Point;
use fringe::math;
use std::f64::consts::TAU;

/// What the real part has against its nominal geometry.
#[derive(Debug, Clone, Copy)]
pub struct Real {
    pub bore_off_mm: [f64; 2],
    pub bore_diameter_mm: f64,
    /// Tilts of the boss about x and y, rad.
    pub boss_tilt_rad: [f64; 2],
    pub boss_diameter_mm: f64,
    /// How much the right side is turned, rad.
    pub right_tilt_rad: f64,
    pub slot_off_mm: [f64; 2],
    pub sigma_mm: f64,
    /// Points per square millimetre.
    pub density: f64,
    /// Whether the points of the top lie on a square grid, turned and shifted anew for each seed, as those of a camera.
    pub grid: bool,
}

impl Default for Real {
    fn default() -> Self {
        Self {
            bore_off_mm: [0.0, 0.0],
            bore_diameter_mm: 12.0,
            boss_tilt_rad: [0.0, 0.0],
            boss_diameter_mm: 16.0,
            right_tilt_rad: 0.0,
            slot_off_mm: [0.0, 0.0],
            sigma_mm: 0.0,
            density: 2.0,
            grid: false,
        }
    }
}

/// The plan of the part; features follow it.
pub const ELEMENTS: &str = include_str!("part.plan.toml");

struct Surface<'n> {
    noise: &'n mut Noise,
    sigma_mm: f64,
    points: Vec<Point>,
}

impl Surface<'_> {
    fn add(&mut self, place: Vector3<f64>, normal: Vector3<f64>) {
        let place = place + normal * (self.sigma_mm * self.noise.normal());
        self.points.push(Point {
            position_mm: place.into(),
            normal: normal.map(|v| v as f32).into(),
            ..bytemuck::Zeroable::zeroed()
        });
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.noise.uniform()
    }

    fn count(area_mm2: f64, real: &Real) -> usize {
        (area_mm2 * real.density) as usize
    }
}

/// Places on the top of a square grid with a turn and shift drawn at random.
fn grid(s: &mut Surface<'_>, density: f64) -> Vec<(f64, f64)> {
    let pitch = 1.0 / density.sqrt();
    let (sin, cos) = math::sincos(s.between(0.0, 0.25 * TAU));
    let [a, b] = [s.between(0.0, pitch), s.between(0.0, pitch)];
    let most = (60.0 / pitch) as i32;
    let all = (-most..=most).flat_map(|i| (-most..=most).map(move |j| (i, j)));
    let places = all.map(|(i, j)| (f64::from(i) * pitch + a, f64::from(j) * pitch + b));
    let turned = places.map(|(u, v)| (u * cos - v * sin, u * sin + v * cos));
    turned.filter(|(x, y)| x.abs() < 50.0 && y.abs() < 30.0).collect()
}

impl Real {
    /// The cloud, in the part frame.
    pub fn cloud(&self, seed: u64) -> Vec<Point> {
        let mut noise = Noise(seed.wrapping_mul(0x9E37_79B9).wrapping_add(17));
        let mut s = Surface { noise: &mut noise, sigma_mm: self.sigma_mm, points: Vec::new() };
        self.top(&mut s);
        self.sides(&mut s);
        self.bore(&mut s);
        self.boss(&mut s);
        self.cone(&mut s);
        self.ball_and_ring(&mut s);
        s.points
    }

    fn top(&self, s: &mut Surface<'_>) {
        let strewn =
            (0..Surface::count(100.0 * 60.0, self)).map(|_| (s.between(-50.0, 50.0), s.between(-30.0, 30.0)));
        let places: Vec<(f64, f64)> = if self.grid { grid(s, self.density) } else { strewn.collect() };
        for (x, y) in places {
            let bore = [x - 20.0 - self.bore_off_mm[0], y - 10.0 - self.bore_off_mm[1]];
            let slot = [x + 20.0 - self.slot_off_mm[0], y - 10.0 - self.slot_off_mm[1]];
            let half = 0.5 * self.bore_diameter_mm;
            let beyond = (slot[0].abs() - 6.0f64).max(0.0);
            let in_slot = beyond * beyond + slot[1] * slot[1] < 16.0;
            let window = (x - 40.0).abs() < 5.0 && (y + 20.0).abs() < 3.0;
            let in_bore = bore[0] * bore[0] + bore[1] * bore[1] < half * half;
            let under =
                x * x + (y + 15.0) * (y + 15.0) < 110.0 || (x + 30.0).powi(2) + (y + 16.0).powi(2) < 120.0;
            if !in_slot && !in_bore && !window && !under {
                s.add(Vector3::new(x, y, 0.0), Vector3::z());
            }
        }
    }

    fn sides(&self, s: &mut Surface<'_>) {
        for _ in 0..Surface::count(100.0 * 20.0, self) {
            let (x, z) = (s.between(-50.0, 50.0), s.between(-20.0, 0.0));
            s.add(Vector3::new(x, -30.0, z), -Vector3::y());
        }
        for side in [-1.0, 1.0] {
            for _ in 0..Surface::count(60.0 * 20.0, self) {
                let (y, z) = (s.between(-30.0, 30.0), s.between(-20.0, 0.0));
                let tilt = if side > 0.0 { self.right_tilt_rad } else { 0.0 };
                let (sin, cos) = math::sincos(tilt);
                // The right side turns about the x axis' end, in the plane of x and y.
                let place = Vector3::new(side * 50.0 - sin * y, cos * y, z);
                s.add(place, Vector3::new(cos, sin, 0.0) * side);
            }
        }
    }

    fn bore(&self, s: &mut Surface<'_>) {
        let radius = 0.5 * self.bore_diameter_mm;
        for _ in 0..Surface::count(TAU * radius * 15.0, self) {
            let (sin, cos) = math::sincos(s.between(0.0, TAU));
            let z = s.between(-15.0, 0.0);
            let axis = Vector3::new(20.0 + self.bore_off_mm[0], 10.0 + self.bore_off_mm[1], z);
            s.add(axis + Vector3::new(cos, sin, 0.0) * radius, -Vector3::new(cos, sin, 0.0));
        }
    }

    fn boss(&self, s: &mut Surface<'_>) {
        let [a, b] = self.boss_tilt_rad;
        let axis = Vector3::new(b, -a, 1.0);
        let axis = axis / axis.norm();
        let [e1, e2] = tangents(&axis);
        let radius = 0.5 * self.boss_diameter_mm;
        for _ in 0..Surface::count(TAU * radius * 20.0, self) {
            let (sin, cos) = math::sincos(s.between(0.0, TAU));
            let height = s.between(-10.0, 10.0);
            let out = e1 * cos + e2 * sin;
            s.add(Vector3::new(0.0, -15.0, 10.0) + axis * height + out * radius, out);
        }
    }

    /// Half angle 30°, its axis down the z axis, 14 mm wide in the middle of a length of 8 mm.
    fn cone(&self, s: &mut Surface<'_>) {
        let (sin_half, cos_half) = math::sincos(30f64.to_radians());
        for _ in 0..Surface::count(TAU * 7.0 * 9.0, self) {
            let (sin, cos) = math::sincos(s.between(0.0, TAU));
            let down = s.between(-4.0, 4.0);
            let radius = 7.0 + down * sin_half / cos_half;
            let out = Vector3::new(cos, sin, 0.0);
            let place = Vector3::new(-30.0, -16.0, 6.0 - down) + out * radius;
            s.add(place, out * cos_half + Vector3::z() * sin_half);
        }
    }

    fn ball_and_ring(&self, s: &mut Surface<'_>) {
        for _ in 0..Surface::count(TAU * 25.0, self) {
            let (sin, cos) = math::sincos(s.between(0.0, TAU));
            let z = s.between(0.0, 1.0);
            let across = (1.0 - z * z).sqrt();
            let out = Vector3::new(across * cos, across * sin, z);
            s.add(Vector3::new(40.0, 0.0, 20.0) + out * 5.0, out);
        }
        for _ in 0..Surface::count(TAU * 10.0 * TAU * 3.0 * 0.5, self) {
            let (sin, cos) = math::sincos(s.between(0.0, TAU));
            let (up, across) = math::sincos(s.between(0.0, 0.5 * TAU));
            let out = Vector3::new(cos, sin, 0.0) * across + Vector3::z() * up;
            let ring = Vector3::new(-40.0 + 10.0 * cos, 15.0 + 10.0 * sin, 40.0);
            s.add(ring + out * 3.0, out);
        }
    }
}
