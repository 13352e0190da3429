//! The observation model with its derivatives: target point → world → device → lens → pixel.
//!
//! Parameters are steps about the present state, each in the frame where it is least correlated with the others:
//!
//! | local columns | step |
//! |---|---|
//! | 0 … 9 | fx, fy, cx, cy, skew, k1, k2, k3, p1, p2 (added) |
//! | 10 … 15 | device: X_d ↦ exp(ω) X_d + τ, in the device's frame, rad and mm |
//! | 16 … 22 | k4, k5, k6, s1, s2, s3, s4 (added) |
//! | 23, 24 | warp of the target, mm |
//! | 25 … 30 | pose: X_b ↦ exp(ω) X_b + τ before world_from_board, in the target's frame about its centre |
//!
//! A point of the target that is adjusted itself has the derivatives of the pose's τ.

use super::observations::{ImagePoint, Observations};
use fringe::geometry::camera::Camera;
use fringe::math;
use nalgebra::{
    Isometry3, Matrix2, Matrix2x3, Matrix3, Point2, Point3, Quaternion, UnitQuaternion, Vector2, Vector3,
};

/// Intrinsic parameters of a device before its pose.
pub(super) const INTRINSIC: usize = 10;
/// First of the lens coefficients that only some kinds have, behind the pose.
pub(super) const FURTHER: usize = 16;
/// All parameters of a device.
pub(super) const DEVICE: usize = 23;
/// Parameters of the warp.
pub(super) const WARP: usize = 2;
/// Parameters of a pose.
pub(super) const POSE: usize = 6;
/// All parameters that an image point depends on.
pub(super) const LOCAL: usize = DEVICE + WARP + POSE;
/// Parameters of a face: X_f ↦ exp(ω) X_f + τ before target_from_face, about the middle of the face.
pub(super) const FACE: usize = 6;

/// The target about its centre.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Board {
    /// Points about the centre, mm; of a target with faces each about the middle of its own face, in its frame.
    pub points: Vec<Vector3<f64>>,
    /// How far each point rises per unit of either warp parameter: 1 − x², 1 − y² with x, y in ±1 over the target.
    pub rise: Vec<[f64; 2]>,
    /// Middle of the bounding box, mm; 0 of a target with faces, whose own frame serves.
    pub centre: Vector3<f64>,
    /// Face of each point; empty without faces.
    faces: Vec<usize>,
    /// Where the middle of each face is declared to be, target_from_face; empty without faces.
    pub declared: Vec<Isometry3<f64>>,
}

impl Board {
    /// From a checked target.
    pub fn new(observations: &Observations) -> Self {
        if observations.faces.is_empty() {
            return Self::flat(&observations.target_mm);
        }
        let starts = observations.faces.iter().map(|face| face.first);
        let ends = starts.clone().skip(1).chain([observations.target_mm.len()]);
        let (mut points, mut rise, mut faces, mut declared) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (number, (start, end)) in starts.zip(ends).enumerate() {
            let own = Self::flat(&observations.target_mm[start..end]);
            faces.extend(vec![number; own.points.len()]);
            points.extend(own.points);
            rise.extend(own.rise);
            let middle = Isometry3::translation(own.centre.x, own.centre.y, own.centre.z);
            declared.push(compose(&observations.faces[number].target_from_face, &middle));
        }
        Self { points, rise, centre: Vector3::zeros(), faces, declared }
    }

    /// A single flat target.
    fn flat(points: &[Point3<f64>]) -> Self {
        let bound = |start: f64, pick: fn(f64, f64) -> f64| {
            points.iter().fold(Vector3::repeat(start), |b, p| b.zip_map(&p.coords, pick))
        };
        let (low, high) = (bound(f64::INFINITY, f64::min), bound(f64::NEG_INFINITY, f64::max));
        let (centre, half) = ((low + high) * 0.5, (high - low) * 0.5);
        let points: Vec<Vector3<f64>> = points.iter().map(|p| p.coords - centre).collect();
        let rise =
            points.iter().map(|p| [1.0 - (p.x / half.x).powi(2), 1.0 - (p.y / half.y).powi(2)]).collect();
        Self { points, rise, centre, faces: Vec::new(), declared: Vec::new() }
    }

    /// A point of the target as it is, mm about the centre.
    #[inline]
    pub fn point(&self, index: usize, shape: &Shape) -> Vector3<f64> {
        let ([a, b], [along_x, along_y]) = (self.rise[index], shape.warp_mm);
        let bent = self.points[index] + Vector3::new(0.0, 0.0, a * along_x + b * along_y);
        let bent = self.placed(index, shape).map_or(bent, |face| (face * Point3::from(bent)).coords);
        shape.offsets_mm.get(index).map_or(bent, |offset| bent + offset)
    }

    /// Face of a point; 0 without faces.
    #[inline]
    pub fn face(&self, index: usize) -> usize {
        self.faces.get(index).copied().unwrap_or(0)
    }

    /// Where the face of a point is on the target; `None` without faces, and where a face stands for itself.
    #[inline]
    fn placed<'s>(&self, index: usize, shape: &'s Shape) -> Option<&'s Isometry3<f64>> {
        shape.faces.get(self.face(index))
    }

    /// The points of the undeformed target, mm about its centre.
    pub fn rigid_points(&self, shape: &Shape) -> Vec<Vector3<f64>> {
        let place = |(index, point): (usize, &Vector3<f64>)| {
            self.placed(index, shape).map_or(*point, |face| (face * Point3::from(*point)).coords)
        };
        self.points.iter().enumerate().map(place).collect()
    }

    /// The face that most of the image points lie on.
    pub fn main_face(&self, image_points: &[ImagePoint]) -> usize {
        let count = |face: usize| image_points.iter().filter(|p| self.face(p.index) == face).count();
        (0..self.declared.len()).rev().max_by_key(|face| count(*face)).unwrap_or(0)
    }

    /// Those of a view's image points that lie on a face.
    pub fn on_face(&self, face: usize, image_points: &[ImagePoint]) -> Vec<ImagePoint> {
        image_points.iter().filter(|p| self.face(p.index) == face).copied().collect()
    }

    /// The point that has the place of each point after a turn by 180° about the centre; `None` for a target that does
    /// not meet itself.
    pub fn turned(&self) -> Option<Vec<usize>> {
        if !self.declared.is_empty() {
            return None;
        }
        let reach = self.points.iter().map(Vector3::norm).fold(0.0, f64::max);
        self.points
            .iter()
            .map(|p| {
                let other = Vector3::new(-p.x, -p.y, p.z);
                self.points.iter().position(|q| (q - other).norm() < 1e-3 * reach)
            })
            .collect()
    }
}

/// How the target differs from the declared one.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Shape {
    /// Warp of the board along x and y, mm.
    pub warp_mm: [f64; 2],
    /// Displacement of each point on top of the warp, mm; empty unless the points are adjusted.
    pub offsets_mm: Vec<Vector3<f64>>,
    /// Where each face is, target_from_face about its middle; empty without faces, and where a face stands for itself.
    pub faces: Vec<Isometry3<f64>>,
}

/// All that is adjusted. The world is the first device's frame; boards are about their centre.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct State {
    /// Intrinsics and poses of the devices.
    pub cameras: Vec<Camera>,
    /// world_from_board of each pose that is used.
    pub boards: Vec<Option<Isometry3<f64>>>,
    /// Warp and point offsets of the target.
    pub shape: Shape,
}

/// The rotation by a vector, rad; bits do not depend on the machine.
pub(crate) fn rotation(vector: Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = vector.norm();
    // sin(φ/2)/φ by its series near zero, where the quotient has none.
    let (real, part) = if angle < 1e-6 {
        (1.0 - angle * angle / 8.0, 0.5 - angle * angle / 48.0)
    } else {
        (math::cos(0.5 * angle), math::sin(0.5 * angle) / angle)
    };
    UnitQuaternion::from_quaternion(Quaternion::from_parts(real, vector * part))
}

/// The rotation vector of a rotation, rad, of length at most π.
pub(crate) fn rotation_vector(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let q = if rotation.w < 0.0 { -rotation.into_inner() } else { rotation.into_inner() };
    let sine = q.imag().norm();
    let angle = 2.0 * math::atan2(sine, q.w);
    if sine < 1e-12 { q.imag() * 2.0 } else { q.imag() * (angle / sine) }
}

/// The motion of a step (ω, τ).
pub(super) fn motion(step: &[f64]) -> Isometry3<f64> {
    let part = |i: usize| Vector3::new(step[i], step[i + 1], step[i + 2]);
    Isometry3::from_parts(part(3).into(), rotation(part(0)))
}

/// The product of two motions with a quaternion of unit length.
pub(super) fn compose(a: &Isometry3<f64>, b: &Isometry3<f64>) -> Isometry3<f64> {
    let product = a * b;
    let rotation = UnitQuaternion::from_quaternion(product.rotation.into_inner());
    Isometry3::from_parts(product.translation, rotation)
}

/// Column of a coefficient of the lens, in the order of [`fringe::geometry::lens::COEFFICIENTS`].
pub(super) fn column_of(coefficient: usize) -> usize {
    const BEFORE: usize = INTRINSIC - 5;
    if coefficient < BEFORE { 5 + coefficient } else { FURTHER + coefficient - BEFORE }
}

/// Intrinsic parameters of a camera in the columns of its steps; those of the pose are 0.
pub(super) fn intrinsics(camera: &Camera) -> [f64; DEVICE] {
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.principal_point_px);
    let mut values = [0.0; DEVICE];
    values[..5].copy_from_slice(&[fx, fy, cx, cy, camera.skew]);
    for (coefficient, value) in camera.distortion.coefficients().into_iter().enumerate() {
        values[column_of(coefficient)] = value;
    }
    values
}

/// A camera after a step of its parameters.
pub(crate) fn moved(camera: &Camera, step: &[f64]) -> Camera {
    let mut next = camera.clone();
    next.focal_px[0] += step[0];
    next.focal_px[1] += step[1];
    next.principal_point_px[0] += step[2];
    next.principal_point_px[1] += step[3];
    next.skew += step[4];
    for (k, s) in next.distortion.k.iter_mut().zip(&step[5..8]) {
        *k += s;
    }
    for (p, s) in next.distortion.p.iter_mut().zip(&step[8..10]) {
        *p += s;
    }
    next.camera_from_world = compose(&motion(&step[INTRINSIC..FURTHER]), &camera.camera_from_world);
    for (k, s) in next.distortion.more_k.iter_mut().zip(&step[FURTHER..FURTHER + 3]) {
        *k += s;
    }
    for (p, s) in next.distortion.prism.iter_mut().zip(&step[FURTHER + 3..DEVICE]) {
        *p += s;
    }
    next
}

/// A view ready for projection: device_from_board as matrix and vector.
pub(super) struct Projector<'a> {
    camera: &'a Camera,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
}

/// Two rows of the Jacobian.
pub(super) type Rows = [[f64; LOCAL]; 2];

impl<'a> Projector<'a> {
    /// For a device and a pose.
    pub fn new(camera: &'a Camera, board: &Isometry3<f64>) -> Self {
        let both = camera.camera_from_world * board;
        let rotation = both.rotation.to_rotation_matrix().into_inner();
        Self { camera, rotation, translation: both.translation.vector }
    }

    /// The pixel of a target point (about the centre, warp included); `None` behind the device.
    #[inline]
    pub fn pixel(&self, point: &Vector3<f64>) -> Option<Point2<f64>> {
        let seen = self.rotation * point + self.translation;
        // Written so that a NaN is refused too.
        (seen.z > 1e-9)
            .then(|| self.camera.pixel_from_normalised(Vector2::new(seen.x / seen.z, seen.y / seen.z)))
    }

    /// The pixel with its derivatives by all local parameters.
    pub fn rows(&self, point: &Vector3<f64>, rise: [f64; 2]) -> Option<(Point2<f64>, Rows)> {
        let seen = self.rotation * point + self.translation;
        let mut rows = [[0.0; LOCAL]; 2];
        let (pixel, by_point) = intrinsic_rows(self.camera, &seen, &mut rows)?;
        let by_board = by_point * self.rotation;
        for (i, row) in rows.iter_mut().enumerate() {
            let device = by_point.row(i).transpose();
            let board = by_board.row(i).transpose();
            // d·(ω × X) = ω·(X × d).
            row[10..13].copy_from_slice(seen.cross(&device).as_slice());
            row[13..16].copy_from_slice(device.as_slice());
            row[DEVICE] = board.z * rise[0];
            row[DEVICE + 1] = board.z * rise[1];
            row[DEVICE + WARP..DEVICE + WARP + 3].copy_from_slice(point.cross(&board).as_slice());
            row[DEVICE + WARP + 3..].copy_from_slice(board.as_slice());
        }
        Some((pixel, rows))
    }
}

/// The pixel of a point in the device's frame, its derivative by the point, and those by the intrinsics into `rows`.
fn intrinsic_rows(
    camera: &Camera,
    seen: &Vector3<f64>,
    rows: &mut Rows,
) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
    if seen.z.is_nan() || seen.z <= 1e-9 {
        return None;
    }
    let ideal = Vector2::new(seen.x / seen.z, seen.y / seen.z);
    let (x, y) = (ideal.x, ideal.y);
    let distorted = camera.distortion.distort(ideal);
    let [fx, fy] = camera.focal_px;
    rows[0][0] = distorted.x;
    rows[1][1] = distorted.y;
    rows[0][2] = 1.0;
    rows[1][3] = 1.0;
    rows[0][4] = distorted.y;
    for (coefficient, slope) in camera.distortion.by_coefficients(ideal).into_iter().enumerate() {
        let column = column_of(coefficient);
        rows[0][column] = fx * slope.x + camera.skew * slope.y;
        rows[1][column] = fy * slope.y;
    }
    let by_ideal = nalgebra::Matrix2::new(fx, camera.skew, 0.0, fy) * camera.distortion.jacobian(ideal);
    let perspective = Matrix2x3::new(1.0, 0.0, -x, 0.0, 1.0, -y) / seen.z;
    Some((camera.pixel_from_distorted(distorted), by_ideal * perspective))
}

/// The ideal point of a pixel, with its derivatives.
pub(crate) struct Ideal {
    /// Coordinates without the lens, at distance 1.
    pub at: Vector2<f64>,
    /// By the pixel, 1/px.
    pub by_pixel: Matrix2<f64>,
    /// By the intrinsic parameters of the device, the pixel fixed; 0 by its pose.
    pub by: [Vector2<f64>; DEVICE],
}

impl Ideal {
    /// Of a pixel as seen; `None` where the lens model folds over.
    pub fn new(camera: &Camera, pixel: Point2<f64>) -> Option<Self> {
        let at = camera.normalised_from_pixel(pixel)?;
        let mut rows = [[0.0; LOCAL]; 2];
        let (_, by_point) = intrinsic_rows(camera, &Vector3::new(at.x, at.y, 1.0), &mut rows)?;
        let by_pixel = by_point.fixed_columns::<2>(0).into_owned().try_inverse()?;
        // What a parameter adds to the pixel of a point, the point must take back.
        let by = std::array::from_fn(|k| -(by_pixel * Vector2::new(rows[0][k], rows[1][k])));
        Some(Self { at, by_pixel, by })
    }
}

/// Derivatives of a world point's pixel by the parameters of its device, and by the point (px/mm); `None` behind it.
pub(super) fn world_rows(
    camera: &Camera,
    world: &Vector3<f64>,
) -> Option<([[f64; DEVICE]; 2], Matrix2x3<f64>)> {
    let rotation = camera.camera_from_world.rotation.to_rotation_matrix().into_inner();
    let seen = rotation * world + camera.camera_from_world.translation.vector;
    let mut rows = [[0.0; LOCAL]; 2];
    let (_, by_point) = intrinsic_rows(camera, &seen, &mut rows)?;
    let mut own = [[0.0; DEVICE]; 2];
    for (i, (own, row)) in own.iter_mut().zip(&rows).enumerate() {
        let device = by_point.row(i).transpose();
        own[..DEVICE].copy_from_slice(&row[..DEVICE]);
        own[10..13].copy_from_slice(seen.cross(&device).as_slice());
        own[13..16].copy_from_slice(device.as_slice());
    }
    Some((own, by_point * rotation))
}
