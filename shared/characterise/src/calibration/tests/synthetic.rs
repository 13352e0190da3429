//! A rig like that of the thesis, written down here: four cameras and two projectors about a bent board.

use super::super::model::rotation;
use super::super::*;
use fringe::math::{cos, sin};
use fringe::synthetic::Noise;
use nalgebra::{Isometry3, Matrix2, Matrix3, Point2, Point3, Rotation3, UnitQuaternion, Vector2, Vector3};

/// Bend of the synthetic board, mm.
pub(super) const WARP_MM: [f64; 2] = [0.08, -0.05];

/// Everything that is true.
pub(super) struct World {
    pub devices: Vec<Device>,
    pub cameras: Vec<Camera>,
    pub boards: Vec<Isometry3<f64>>,
    pub target_mm: Vec<Point3<f64>>,
    /// Errors of the print, mm, point by point.
    pub print_mm: Vec<Vector3<f64>>,
    pub noise_px: Vec<f64>,
}

fn looking(azimuth_deg: f64, elevation_deg: f64) -> Isometry3<f64> {
    let (a, e) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    let target = Point3::new(0.0, 0.0, 15.0);
    let centre = target + Vector3::new(cos(e) * cos(a), cos(e) * sin(a), sin(e)) * 500.0;
    let z = (target - centre).normalize();
    let x = z.cross(&Vector3::z()).normalize();
    let rows = Matrix3::from_rows(&[x.transpose(), z.cross(&x).transpose(), z.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
    Isometry3::from_parts((-(rotation * centre.coords)).into(), rotation)
}

/// A device of the thesis at an azimuth, with small differences to the others.
pub(super) fn device(index: usize, azimuth_deg: f64, kind: DeviceKind) -> (Device, Camera) {
    let i = index as f64;
    let (width_px, height_px, focal, middle, k, label) = match kind {
        DeviceKind::Camera => {
            (1124, 750, 2330.0, [561.5 + 3.2 - 2.1 * i, 374.5 - 2.4 + 1.7 * i], [-0.08, 0.05, 0.0], "cam")
        }
        // A lens shifted upwards: the principal point lies near the lower edge.
        DeviceKind::Projector => {
            (608, 684, 1500.0, [305.3 - 3.0 * i, 640.0 + 9.0 * i], [-0.03, 0.01, 0.0], "proj")
        }
    };
    let camera = Camera {
        width_px,
        height_px,
        focal_px: [focal + 1.5 * i, focal - 0.8 + 1.5 * i],
        principal_point_px: middle,
        skew: 0.0,
        distortion: fringe::geometry::camera::Lens::brown_conrady(k, [2e-4, -1.5e-4 + 1e-4 * i]),
        camera_from_world: looking(azimuth_deg, 48.0),
    };
    (Device { name: format!("{label}{}", index + 1), kind, width_px, height_px }, camera)
}

impl World {
    /// Four cameras, two projectors, a board of 11 × 8 points with 8 mm pitch in `poses` poses.
    pub fn new(poses: usize) -> Self {
        let both: Vec<(Device, Camera)> = [-12.0, 12.0, 78.0, 102.0]
            .into_iter()
            .enumerate()
            .map(|(i, a)| device(i, a, DeviceKind::Camera))
            .chain([0.0, 90.0].into_iter().enumerate().map(|(i, a)| device(i, a, DeviceKind::Projector)))
            .collect();
        let target_mm =
            (0..88).map(|i| Point3::new(f64::from(i % 11) * 8.0, f64::from(i / 11) * 8.0, 0.0)).collect();
        let mut noise = Noise(77);
        let boards = (0..poses).map(|_| board(&mut noise, 0.45)).collect();
        let noise_px =
            both.iter().map(|(d, _)| if d.kind == DeviceKind::Camera { 0.006 } else { 0.012 }).collect();
        let (devices, cameras) = both.into_iter().unzip();
        let print_mm = vec![Vector3::zeros(); 88];
        Self { devices, cameras, boards, target_mm, print_mm, noise_px }
    }

    /// The same with a board that a printer made: scattered points, and lengths along y that are 0.1 % too long.
    pub fn printed(self) -> Self {
        let mut noise = Noise(5);
        let mut any = || 0.02 * noise.gauss();
        let error = |p: &Point3<f64>| Vector3::new(any(), any() + 1e-3 * p.y, any());
        Self { print_mm: self.target_mm.iter().map(error).collect(), ..self }
    }

    /// The board as bent.
    pub fn bent(&self, index: usize) -> Point3<f64> {
        let p = self.target_mm[index];
        let (x, y) = (p.x / 40.0 - 1.0, p.y / 28.0 - 1.0);
        p + self.print_mm[index]
            + Vector3::new(0.0, 0.0, WARP_MM[0] * (1.0 - x * x) + WARP_MM[1] * (1.0 - y * y))
    }

    /// What the devices see, with noise; `scale` 0 is exact.
    pub fn observe(&self, seed: u64, scale: f64) -> Observations {
        let mut noise = Noise(seed);
        let mut views = Vec::new();
        for (pose, board) in self.boards.iter().enumerate() {
            for (device, camera) in self.cameras.iter().enumerate() {
                let sd = self.noise_px[device];
                let mut image_points = Vec::new();
                for index in 0..self.target_mm.len() {
                    let pixel = camera.project(&(board * self.bent(index))).unwrap();
                    let error = Vector2::new(noise.gauss(), noise.gauss()) * (sd * scale);
                    if pixel.x > 0.0
                        && pixel.y > 0.0
                        && pixel.x < f64::from(camera.width_px - 1)
                        && pixel.y < f64::from(camera.height_px - 1)
                    {
                        let covariance_px2 = Matrix2::identity() * (sd * sd);
                        image_points.push(ImagePoint {
                            index,
                            pixel: pixel + error,
                            covariance_px2,
                            link: None,
                        });
                    }
                }
                views.push(View { device, pose, image_points, may_be_turned: false });
            }
        }
        Observations {
            devices: self.devices.clone(),
            target_mm: self.target_mm.clone(),
            faces: Vec::new(),
            poses: (0..self.boards.len()).map(|i| format!("pose{}", i + 1)).collect(),
            views,
        }
    }
}

/// A board that faces upwards, tilted by up to `tilt` rad about x and y, turned freely, placed so that the poses fill
/// the working volume 140 × 140 × 90 mm of the thesis' cell.
pub(super) fn board(noise: &mut Noise, tilt: f64) -> Isometry3<f64> {
    let mut any = |half: f64| (2.0 * noise.unit() - 1.0) * half;
    let lean = rotation(Vector3::new(any(tilt), any(tilt), 0.0));
    let turn = rotation(Vector3::new(0.0, 0.0, any(0.6)));
    let at = Vector3::new(any(45.0), any(45.0), 15.0 + any(35.0));
    let turned = lean * turn;
    let middle = turned * Vector3::new(40.0, 28.0, 0.0);
    Isometry3::from_parts((at - middle).into(), turned)
}

/// Whitened-pixel helper for tests that need one image point.
pub(super) fn image_point(index: usize, x: f64, y: f64) -> ImagePoint {
    ImagePoint { index, pixel: Point2::new(x, y), covariance_px2: Matrix2::identity(), link: None }
}
