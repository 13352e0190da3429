//! A renderer of boards: light gathered on a fine grid, blurred, collected by pixels, with noise.

use super::super::raster::{Grey, Raster, half_gaussian};
use super::super::spec::{TargetKind, TargetSpec};
use fringe::frame::{Frame, PixelBuffer};
use fringe::geometry::camera::{Camera, Lens};
use fringe::math::{exp, ln, sincos};
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

/// Fine samples per pixel and side.
const FINE: usize = 6;

/// xorshift64*, and Box–Muller on it.
pub(super) struct Noise(pub u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64
    }

    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * ln(self.uniform())).sqrt();
        radius * sincos(std::f64::consts::TAU * self.uniform()).0
    }
}

/// Variance of a blur as it is drawn, its kernel being cut off, px².
pub(super) fn drawn_px2(blur_px: f64) -> f64 {
    let kernel = half_gaussian(blur_px * FINE as f64);
    let far = |(i, weight): (usize, &f32)| 2.0 * (i as f64 / FINE as f64).powi(2) * f64::from(*weight);
    kernel.iter().enumerate().map(far).sum()
}

/// A board before a camera.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    pub spec: TargetSpec,
    pub camera: Camera,
    pub blur_px: f64,
    /// A wider blur that part of the light has instead: its standard deviation, px, its part in the middle of the image and in the corner.
    pub wide: Option<(f64, [f64; 2])>,
    /// Part of the pitch that is the diameter of circles.
    pub diameter: f64,
    /// Half the width of a fine sample, in pitches.
    ramp: f64,
    /// An opaque disc in the image: centre and radius, px.
    pub hidden: Option<(Point2<f64>, f64)>,
}

impl Scene {
    /// `tilt_rad` about x, y and z of the board; the board's centre at 400 mm on the optical axis.
    pub fn new(kind: TargetKind, columns: u32, rows: u32, tilt_rad: [f64; 3], distortion: Lens) -> Self {
        let pitch_mm = 10.0;
        let spec = TargetSpec {
            format: None,
            kind,
            columns,
            rows,
            pitch_mm,
            diameter_mm: None,
            dictionary: None,
            marker_mm: None,
            first_marker: None,
        };
        let far = spec.board_point_mm((columns - 1, rows - 1));
        let turn = UnitQuaternion::from_euler_angles(tilt_rad[0], tilt_rad[1], tilt_rad[2]);
        let centre = turn * Vector3::new(0.5 * far.x, 0.5 * far.y, 0.0);
        let at = Translation3::from(Vector3::new(0.0, 0.0, 400.0) - centre);
        let camera = Camera {
            width_px: 360,
            height_px: 280,
            focal_px: [960.0, 962.0],
            principal_point_px: [181.3, 138.6],
            skew: 0.0,
            distortion,
            camera_from_world: Isometry3::from_parts(at, turn),
        };
        Self {
            spec,
            camera,
            blur_px: 0.9,
            wide: None,
            diameter: 0.5,
            ramp: 400.0 / 960.0 / 20.0 / FINE as f64,
            hidden: None,
        }
    }

    /// True position of a point in the image.
    pub fn truth(&self, index: (u32, u32)) -> Point2<f64> {
        self.camera.project(&self.spec.board_point_mm(index)).expect("in front")
    }

    /// Reflectance at a place of the board, in pitches from point (0, 0).
    fn reflectance(&self, x: f64, y: f64) -> f64 {
        let (columns, rows) = (f64::from(self.spec.columns), f64::from(self.spec.rows));
        if self.spec.kind == TargetKind::Checkerboard {
            let inside = x > -1.0 && y > -1.0 && x < columns && y < rows;
            // A square wave with ramps as wide as a fine sample, so that no edge is ragged; the square before point
            // (0, 0), at (−1, −1), is dark.
            let wave = |t: f64| {
                let sign = if t.round().rem_euclid(2.0) == 0.0 { 1.0 } else { -1.0 };
                sign * ((t - t.round()) / self.ramp).clamp(-1.0, 1.0)
            };
            return if inside { 0.475 - 0.375 * wave(x) * wave(y) } else { 0.85 };
        }
        let row = y.round();
        let shift = if self.spec.kind == TargetKind::AsymmetricCircles { row.rem_euclid(2.0) } else { 0.0 };
        let step = if self.spec.kind == TargetKind::AsymmetricCircles { 2.0 } else { 1.0 };
        let column = ((x - shift) / step).round();
        let on = (0.0..columns).contains(&column) && (0.0..rows).contains(&row);
        let (dx, dy) = (x - shift - step * column, y - row);
        let outside = ((dx * dx + dy * dy).sqrt() - 0.5 * self.diameter) / self.ramp;
        if on { 0.475 + 0.375 * outside.clamp(-1.0, 1.0) } else { 0.85 }
    }

    /// Grey values without noise.
    pub fn clean(&self) -> Raster {
        let (width, height) = (self.camera.width_px as usize, self.camera.height_px as usize);
        let board_from_camera = self.camera.camera_from_world.inverse();
        let origin = board_from_camera * Point3::origin();
        let mut values = vec![0.0_f32; width * height * FINE * FINE];
        for (index, value) in values.iter_mut().enumerate() {
            let (u, v) = (index % (width * FINE), index / (width * FINE));
            let pixel = (Vector2::new(u as f64, v as f64) + Vector2::repeat(0.5)) / FINE as f64
                - Vector2::repeat(0.5);
            let ideal = self.camera.normalised_from_pixel(pixel.into()).expect("no fold");
            let ray = board_from_camera * Vector3::new(ideal.x, ideal.y, 1.0);
            let at = (origin - ray * (origin.z / ray.z)) / self.spec.pitch_mm;
            // Light falls off to one side and towards the rim.
            let light = 200.0 * (1.0 + 0.25 * ideal.x / 0.19 - 0.1 * ideal.y / 0.15);
            let hidden = self.hidden.is_some_and(|(c, radius)| (Point2::from(pixel) - c).norm() < radius);
            *value = (light * if hidden { 0.4 } else { self.reflectance(at.x, at.y) }) as f32;
        }
        let fine = Raster { width: width * FINE, height: height * FINE, values };
        let seen = |blur_px: f64| fine.smoothed(&half_gaussian(blur_px * FINE as f64)).reduced(FINE);
        let mut sharp = seen(self.blur_px);
        if let Some((wide_px, [middle, corner])) = self.wide {
            let wide = seen(wide_px);
            for (index, (value, wide)) in sharp.values.iter_mut().zip(&wide.values).enumerate() {
                let part = middle + (corner - middle) * self.field(index);
                *value = ((1.0 - part) * f64::from(*value) + part * f64::from(*wide)) as f32;
            }
        }
        sharp
    }

    /// Squared distance of a pixel from the middle of the image over that of the corner.
    fn field(&self, index: usize) -> f64 {
        let (width, height) = (self.camera.width_px as usize, self.camera.height_px as usize);
        let half = [width, height].map(|length| 0.5 * (length as f64 - 1.0));
        let (x, y) = ((index % width) as f64 - half[0], (index / width) as f64 - half[1]);
        (x * x + y * y) / (half[0] * half[0] + half[1] * half[1])
    }

    /// 8 bits with read noise of 1 DN and shot noise.
    pub fn frame(&self, clean: &Raster, seed: u64) -> Frame {
        let mut noise = Noise(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
        let pixels = clean.values.iter().map(|v| {
            let v = f64::from(*v);
            (v + noise.normal() * (1.0 + 0.012 * v).sqrt()).round().clamp(0.0, 255.0) as u8
        });
        let (width_px, height_px) = (self.camera.width_px, self.camera.height_px);
        Frame { width_px, height_px, full_scale_dn: 255, pixels: PixelBuffer::Mono8(pixels.collect()) }
    }
}

/// Clutter: random soft blobs and bars without any board.
pub(super) fn clutter(width: usize, height: usize, seed: u64) -> Frame {
    let mut noise = Noise(seed | 1);
    let mut values = vec![90.0_f64; width * height];
    for _ in 0..60 {
        let (cx, cy) = (noise.uniform() * width as f64, noise.uniform() * height as f64);
        let (a, b, level) =
            (3.0 + 20.0 * noise.uniform(), 2.0 + 8.0 * noise.uniform(), 120.0 * noise.normal());
        for (index, value) in values.iter_mut().enumerate() {
            let (dx, dy) = (((index % width) as f64 - cx) / a, ((index / width) as f64 - cy) / b);
            let far = (dx.abs().max(dy.abs()) - 1.0) * 6.0;
            *value += level / (1.0 + exp(far));
        }
    }
    let pixels = values.iter().map(|v| (v + noise.normal()).round().clamp(0.0, 255.0) as u8).collect();
    Frame {
        width_px: width as u32,
        height_px: height as u32,
        full_scale_dn: 255,
        pixels: PixelBuffer::Mono8(pixels),
    }
}
