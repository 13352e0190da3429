//! Start values of one device: intrinsics from homographies (Zhang 2000), poses from their decomposition.

use super::homography::homography;
use super::model::compose;
use super::observations::{Device, DeviceKind, ImagePoint};
use fringe::geometry::camera::{Camera, Lens, LensKind};
use fringe::math::linear::{Dense, Factor, eigen};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

/// Second smallest over largest eigenvalue of Zhang's system below which the principal point is open.
const OPEN: f64 = 1e-10;

/// Focal lengths outside these multiples of the image size are refused.
const FOCAL_RANGE: [f64; 2] = [0.1, 100.0];

/// Possible intrinsics, the full solution first, then assumed principal points.
pub(super) fn candidates(device: &Device, homographies: &[Matrix3<f64>]) -> Vec<Camera> {
    let (w, h) = (f64::from(device.width_px), f64::from(device.height_px));
    let size = 0.5 * (w + h);
    let middle = [0.5 * (w - 1.0), 0.5 * (h - 1.0)];
    let mut found = Vec::new();
    let scaled = |centre: [f64; 2]| -> Vec<Matrix3<f64>> {
        let to = Matrix3::new(1.0, 0.0, -centre[0], 0.0, 1.0, -centre[1], 0.0, 0.0, size) / size;
        homographies.iter().map(|m| unit_columns(to * m)).collect()
    };
    if let Some([fx, fy, cx, cy]) = full(&scaled(middle)) {
        let principal = [cx * size + middle[0], cy * size + middle[1]];
        // A principal point two images away is noise, not optics.
        if principal[0].abs() < 3.0 * w && principal[1].abs() < 3.0 * h {
            found.extend(camera(device, [fx * size, fy * size], principal));
        }
    }
    // A projector's lens is often shifted: its principal point may lie at or beyond the upper or lower edge.
    let heights: &[f64] = match device.kind {
        DeviceKind::Camera => &[0.5],
        DeviceKind::Projector => &[0.5, 1.0, 0.0, 1.5, -0.5],
    };
    for height in heights {
        let centre = [middle[0], height * (h - 1.0)];
        if let Some([fx, fy]) = fixed_centre(&scaled(centre)) {
            found.extend(camera(device, [fx * size, fy * size], centre));
        }
    }
    if found.is_empty() {
        // A normal lens; the adjustment converges from there, or the covariance shows that the data are insufficient.
        found.push(normal_lens(device));
    }
    found
}

/// Focal lengths of a fisheye that are tried, in image sizes: fields of 180° down to 50° over the shorter side.
const FISHEYE_FOCALS: [f64; 7] = [0.25, 0.32, 0.42, 0.55, 0.7, 0.9, 1.2];

/// Possible intrinsics of a fisheye, equidistant and centred, each with the homographies of the straightened views.
pub(super) fn fisheyes(
    device: &Device,
    board: &[Vector3<f64>],
    views: &[&[ImagePoint]],
) -> Vec<(Camera, Vec<Matrix3<f64>>)> {
    let (w, h) = (f64::from(device.width_px), f64::from(device.height_px));
    let candidate = |focal: &f64| {
        let mut camera = undistorted(device, [0.5 * (w + h) * focal; 2], [0.5 * (w - 1.0), 0.5 * (h - 1.0)]);
        camera.distortion.kind = LensKind::Fisheye;
        let own: Option<Vec<_>> =
            views.iter().map(|view| homography(board, &straightened(&camera, view))).collect();
        Some((camera, own?))
    };
    FISHEYE_FOCALS.iter().filter_map(candidate).collect()
}

/// The image points as the same camera without distortion would see them; those that have no ray are left out.
pub(super) fn straightened(camera: &Camera, image_points: &[ImagePoint]) -> Vec<ImagePoint> {
    let straight = Camera { distortion: Lens::default(), ..camera.clone() };
    let one = |seen: &ImagePoint| {
        let ideal = camera.normalised_from_pixel(seen.pixel)?;
        // A direction across the axis would count more than all others.
        (ideal.norm_squared() < 100.0)
            .then(|| ImagePoint { pixel: straight.pixel_from_normalised(ideal), ..*seen })
    };
    image_points.iter().filter_map(one).collect()
}

/// What is assumed where nothing is known: a focal length of one and a half image sizes, centred.
pub(super) fn normal_lens(device: &Device) -> Camera {
    let (w, h) = (f64::from(device.width_px), f64::from(device.height_px));
    undistorted(device, [0.75 * (w + h); 2], [0.5 * (w - 1.0), 0.5 * (h - 1.0)])
}

fn camera(device: &Device, focal_px: [f64; 2], principal_point_px: [f64; 2]) -> Option<Camera> {
    let size = 0.5 * f64::from(device.width_px + device.height_px);
    let believed = |f: &f64| (FOCAL_RANGE[0] * size..FOCAL_RANGE[1] * size).contains(f);
    focal_px.iter().all(believed).then(|| undistorted(device, focal_px, principal_point_px))
}

fn undistorted(device: &Device, focal_px: [f64; 2], principal_point_px: [f64; 2]) -> Camera {
    Camera {
        width_px: device.width_px,
        height_px: device.height_px,
        focal_px,
        principal_point_px,
        skew: 0.0,
        distortion: Lens::default(),
        camera_from_world: Isometry3::identity(),
    }
}

/// Scales a homography so that its first two columns have a mean length of 1: all views weigh alike.
fn unit_columns(h: Matrix3<f64>) -> Matrix3<f64> {
    h * (2.0 / (h.column(0).norm() + h.column(1).norm()))
}

/// B = K⁻ᵀK⁻¹ without skew from h1ᵀB h2 = 0 and h1ᵀB h1 = h2ᵀB h2; fx, fy, cx, cy.
fn full(homographies: &[Matrix3<f64>]) -> Option<[f64; 4]> {
    // Unknowns B11, B22, B13, B23, B33.
    let product = |a: Vector3<f64>, b: Vector3<f64>| {
        [a.x * b.x, a.y * b.y, a.x * b.z + a.z * b.x, a.y * b.z + a.z * b.y, a.z * b.z]
    };
    let mut normal = Dense::zeros(5, 5);
    for h in homographies {
        let (a, b) = (h.column(0).into_owned(), h.column(1).into_owned());
        let (aa, bb) = (product(a, a), product(b, b));
        let difference: [f64; 5] = std::array::from_fn(|i| aa[i] - bb[i]);
        for row in [product(a, b), difference] {
            for i in 0..5 {
                for j in 0..5 {
                    normal.add(i, j, row[i] * row[j]);
                }
            }
        }
    }
    let (values, vectors) = eigen(&normal);
    if values[1].is_nan() || values[1] <= OPEN * values[4] {
        return None;
    }
    let b = vectors.row(0);
    let (cx, cy) = (-b[2] / b[0], -b[3] / b[1]);
    let scale = b[4] - b[2] * b[2] / b[0] - b[3] * b[3] / b[1];
    let (fx2, fy2) = (scale / b[0], scale / b[1]);
    (fx2 > 0.0 && fy2 > 0.0 && cx.is_finite() && cy.is_finite()).then(|| [fx2.sqrt(), fy2.sqrt(), cx, cy])
}

/// fx, fy for a known principal point (the origin); equal ones where the poses determine only one.
fn fixed_centre(homographies: &[Matrix3<f64>]) -> Option<[f64; 2]> {
    let mut normal = Dense::zeros(2, 2);
    let mut right = [0.0; 2];
    for h in homographies {
        let (a, b) = (h.column(0), h.column(1));
        let rows = [
            ([a.x * b.x, a.y * b.y], -a.z * b.z),
            ([a.x * a.x - b.x * b.x, a.y * a.y - b.y * b.y], b.z * b.z - a.z * a.z),
        ];
        for (row, value) in rows {
            for i in 0..2 {
                for j in 0..2 {
                    normal.add(i, j, row[i] * row[j]);
                }
                right[i] += row[i] * value;
            }
        }
    }
    let solution = Factor::new(&normal).ok()?.solve(&right);
    if solution.iter().all(|v| *v > 0.0) {
        return Some([1.0 / solution[0].sqrt(), 1.0 / solution[1].sqrt()]);
    }
    let sum = normal.at(0, 0) + 2.0 * normal.at(0, 1) + normal.at(1, 1);
    let common = (right[0] + right[1]) / sum;
    (common > 0.0).then(|| [1.0 / common.sqrt(); 2])
}

/// device_from_board of a homography (pixel ← target about its centre).
pub(super) fn pose(camera: &Camera, homography: &Matrix3<f64>) -> Option<Isometry3<f64>> {
    let columns = camera.matrix().try_inverse()? * homography;
    let mut scale = 2.0 / (columns.column(0).norm() + columns.column(1).norm());
    if columns.m33 < 0.0 {
        scale = -scale;
    }
    let (a, b) = (columns.column(0) * scale, columns.column(1) * scale);
    // Symmetric: the error of the right angle is shared by both.
    let along = (a + b).try_normalize(1e-9)?;
    let across = (a - b - along * (a - b).dot(&along)).try_normalize(1e-9)?;
    let half = 0.5_f64.sqrt();
    let (x, y) = ((along + across) * half, (along - across) * half);
    let matrix = Matrix3::from_columns(&[x, y, x.cross(&y)]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
    let translation = columns.column(2) * scale;
    let pose = Isometry3::from_parts(translation.into_owned().into(), rotation);
    translation.iter().all(|v| v.is_finite()).then(|| compose(&pose, &Isometry3::identity()))
}
