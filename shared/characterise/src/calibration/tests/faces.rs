//! Rigs of which no two sides see the same face of the target, and no pose is seen by all.

use super::super::model::rotation;
use super::super::*;
use super::synthetic::{World, device};
use super::truth::{chi_square, errors};
use fringe::synthetic::Noise;
use nalgebra::{
    Isometry3, Matrix2, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// Points of a face: 9 × 8 at 8 mm.
const POINTS: usize = 72;

/// Half of the cube, mm.
const HALF_MM: f64 = 45.0;

/// Eight cameras on four sides and a cube; cameras 2 n and 2 n + 1 see face n.
struct Cube {
    world: World,
    /// Where the faces truly are.
    faces: Vec<Isometry3<f64>>,
    declared: Vec<Face>,
}

/// The side of a cube towards an azimuth: x to the right, y down, z into the cube, from its middle.
fn side(quarter: usize) -> Isometry3<f64> {
    let outward = [Vector3::x(), Vector3::y(), -Vector3::x(), -Vector3::y()][quarter];
    let right = Vector3::z().cross(&outward);
    let columns = Matrix3::from_columns(&[right, -Vector3::z(), -outward]);
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(columns));
    Isometry3::from_parts((outward * HALF_MM).into(), turn)
}

impl Cube {
    /// Faces that are off from where they are declared to be by about so much, mm and 0.01 rad; the first one is not.
    fn new(poses: usize, off_mm: f64) -> Self {
        let azimuths = (0..4).flat_map(|side| [90.0 * f64::from(side) - 12.0, 90.0 * f64::from(side) + 12.0]);
        let both = azimuths.enumerate().map(|(i, azimuth)| device(i, azimuth, DeviceKind::Camera));
        let (devices, cameras): (Vec<_>, Vec<_>) = both.unzip();
        let mut noise = Noise(31);
        let mut any = |half: f64| {
            Vector3::new(noise.unit() - 0.5, noise.unit() - 0.5, noise.unit() - 0.5) * (2.0 * half)
        };
        let corner = Translation3::new(-32.0, -28.0, 0.0);
        let faces: Vec<Isometry3<f64>> = (0..4)
            .map(|n| {
                let scale = if n == 0 { 0.0 } else { off_mm };
                let wrong = Isometry3::from_parts(any(scale).into(), rotation(any(0.01 * scale)));
                side(n) * wrong * corner
            })
            .collect();
        let declared = (0..4).map(|n| Face {
            name: ["east", "north", "west", "south"][n].to_owned(),
            first: n * POINTS,
            target_from_face: side(n) * corner,
            fixed: false,
        });
        let target_mm = (0..4 * POINTS)
            .map(|i| Point3::new((i % POINTS % 9) as f64 * 8.0, (i % POINTS / 9) as f64 * 8.0, 0.0))
            .collect();
        let boards = (0..poses)
            .map(|_| {
                Isometry3::from_parts((any(22.0) + Vector3::new(0.0, 0.0, 15.0)).into(), rotation(any(0.4)))
            })
            .collect();
        let (noise_px, print_mm) = (vec![0.006; 8], Vec::new());
        let world = World { devices, cameras, boards, target_mm, print_mm, noise_px };
        Self { world, faces, declared: declared.collect() }
    }

    /// What the cameras of some sides see of their faces in each pose; `moved` is how far the target has moved for a camera.
    fn observe(
        &self,
        seed: u64,
        sides: impl Fn(usize) -> Vec<usize>,
        moved: impl Fn(usize, usize) -> Vector3<f64>,
    ) -> Observations {
        let mut noise = Noise(seed);
        let mut views = Vec::new();
        for (pose, board) in self.world.boards.iter().enumerate() {
            for (device, camera) in self.world.cameras.iter().enumerate() {
                let face = device / 2;
                let shift = Translation3::from(moved(pose, device));
                let mut image_points = Vec::new();
                for index in face * POINTS..(face + 1) * POINTS {
                    let pixel =
                        camera.project(&(shift * board * self.faces[face] * self.world.target_mm[index]));
                    let error = Vector2::new(noise.gauss(), noise.gauss()) * 0.006;
                    let covariance_px2 = Matrix2::identity() * (0.006 * 0.006);
                    image_points.push(ImagePoint {
                        index,
                        pixel: pixel.unwrap() + error,
                        covariance_px2,
                        link: None,
                    });
                }
                if sides(pose).contains(&face) {
                    views.push(View { device, pose, image_points, may_be_turned: false });
                }
            }
        }
        Observations {
            devices: self.world.devices.clone(),
            target_mm: self.world.target_mm.clone(),
            faces: self.declared.clone(),
            poses: (0..self.world.boards.len()).map(|i| format!("pose{}", i + 1)).collect(),
            views,
        }
    }
}

fn still(_: usize, _: usize) -> Vector3<f64> {
    Vector3::zeros()
}

/// Sides n and n + 1 in turn: a chain that is not closed.
fn chain(pose: usize) -> Vec<usize> {
    vec![pose % 3, pose % 3 + 1]
}

/// χ² of all parameters, inside its 99.9 % interval.
fn scatter_is_as_predicted(cube: &Cube, sides: fn(usize) -> Vec<usize>, settings: &CalibrationSettings) {
    let found = calibrate(&cube.observe(40, sides, still), settings).unwrap();
    let (square, freedom) = chi_square(&errors(&cube.world, &found), &found.covariance);
    let (mean, half) = (freedom as f64, 3.3 * (2.0 * freedom as f64).sqrt());
    assert!((square - mean).abs() < half, "χ² {square:.0} of {freedom} degrees, interval ± {half:.0}");
    faces_are_where_they_are(cube, &found);
}

/// The places that a calibration states of the faces that it adjusts, against the true ones: all relative to the first face.
fn faces_are_where_they_are(cube: &Cube, found: &Calibration) {
    let middle = Point3::new(32.0, 28.0, 0.0);
    for (number, face) in found.faces.iter().enumerate().filter(|(_, face)| face.adjusted) {
        let [declared, truth] =
            [cube.declared[number].target_from_face, cube.faces[number]].map(|place| place * middle);
        let stated = Point3::from(face.middle_mm);
        let (off, was) = ((stated - truth).norm(), (declared - truth).norm());
        assert!(off < 0.2 * was, "{}: {off} mm from the truth, declared {was} mm from it", face.name);
        assert!(((stated - declared).norm() - face.shift_mm).abs() < 1e-9);
        let turned = cube.faces[number].rotation.angle_to(&cube.declared[number].target_from_face.rotation);
        assert!(
            (face.turn_rad - turned).abs() < 0.2 * turned,
            "{}: {} rad, truth {turned}",
            face.name,
            face.turn_rad
        );
    }
}

/// Proves: eight cameras are calibrated together from poses that only two sides see at a time, each another face, although the faces are
/// 2 mm and a degree from where they are declared; errors are as the covariance of the whole rig says.
#[test]
fn sides_that_see_no_common_face_are_calibrated_together() {
    scatter_is_as_predicted(&Cube::new(12, 2.0), chain, &CalibrationSettings::default());
}

/// Proves: with certified faces, and with every point of the target adjusted, the errors are as stated too.
#[test]
fn certified_faces_and_free_points_err_as_stated() {
    let mut cube = Cube::new(12, 0.0);
    cube.declared.iter_mut().for_each(|face| face.fixed = true);
    scatter_is_as_predicted(&cube, chain, &CalibrationSettings::default());
    let free = CalibrationSettings { target: TargetShape::Free, ..CalibrationSettings::default() };
    scatter_is_as_predicted(&Cube::new(8, 1.0), |_| vec![0, 1, 2, 3], &free);
}

/// Proves: two parts that nothing connects are named, with the poses that each sees; one common pose through faces whose places are
/// open is not enough, and is named; with certified faces it is.
#[test]
fn parts_that_nothing_connects_are_named() {
    let mut cube = Cube::new(10, 0.0);
    let halves = |pose: usize| if pose.is_multiple_of(2) { vec![0, 1] } else { vec![2, 3] };
    let refused = calibrate(&cube.observe(1, halves, still), &CalibrationSettings::default()).unwrap_err();
    let text = refused.to_string();
    assert!(text.contains("[cam1, cam2, cam3, cam4] [cam5, cam6, cam7, cam8]"), "{text}");
    assert!(text.contains("alone sees pose1 … pose9 (5 poses)"), "{text}");
    let once = |pose: usize| if pose == 4 { vec![1, 2] } else { halves(pose) };
    let refused = calibrate(&cube.observe(1, once, still), &CalibrationSettings::default()).unwrap_err();
    assert!(refused.to_string().contains("pose5 is seen by several groups"), "{refused}");
    cube.declared.iter_mut().for_each(|face| face.fixed = true);
    assert!(calibrate(&cube.observe(1, once, still), &CalibrationSettings::default()).is_ok());
}

/// Proves: a target that moved between the cameras of one pose spoils nothing, and the views that do not fit are named by their pose.
#[test]
fn a_target_that_moved_between_cameras_is_named_and_harmless() {
    let cube = Cube::new(8, 0.5);
    let moved = |pose: usize, device: usize| {
        if pose == 4 && device == 2 { Vector3::new(0.0, 0.4, 0.3) } else { Vector3::zeros() }
    };
    let found =
        calibrate(&cube.observe(2, |_| vec![0, 1, 2, 3], moved), &CalibrationSettings::default()).unwrap();
    let wrong: Vec<(usize, usize)> = found
        .views
        .iter()
        .filter(|v| v.residuals.iter().all(|r| !r.used))
        .map(|v| (v.device, v.pose))
        .collect();
    assert_eq!(wrong, [(2, 4)]);
    let (square, n) = chi_square(&errors(&cube.world, &found), &found.covariance);
    assert!((square - n as f64).abs() < 4.0 * (2.0 * n as f64).sqrt(), "χ² {square:.0} of {n}");
}

/// Proves: derivatives by the place of a face agree with differences, whitening and poses included.
#[test]
fn derivatives_by_the_place_of_a_face_agree_with_differences() {
    use super::super::adjust::stepped;
    use super::super::normal::Step;
    let cube = Cube::new(3, 1.0);
    let observations = cube.observe(3, |_| vec![0, 1], still);
    let board = model::Board::new(&observations);
    let seen = start::usable(&observations, &board);
    let turned = vec![false; seen.len()];
    let settings = CalibrationSettings::default();
    let mut problem = joint(&observations, &board, &seen, &turned, &settings);
    problem.adjust_faces(&connection::adjusted_faces(&observations, &seen));
    let shape = Shape { faces: board.declared.clone(), ..Shape::default() };
    let boards = cube.world.boards.iter().copied().map(Some).collect();
    let state = State { cameras: cube.world.cameras.clone(), boards, shape };
    let weights = vec![1.0; problem.image_points.len()];
    let normal = problem.normal(&state, &weights).unwrap();
    assert_eq!(
        problem.faces.iter().filter(|face| face.is_some()).count(),
        1,
        "of two that are seen one is held"
    );
    let first = problem.faces.iter().flatten().copied().next().unwrap();
    for parameter in first..first + 6 {
        let cost = |h: f64| {
            let mut step = Step { devices: vec![0.0; problem.unknowns], poses: vec![None; 3] };
            step.devices[parameter] = h;
            problem.cost(&stepped(&problem, &state, &step), &weights)
        };
        let slope = -(cost(1e-6) - cost(-1e-6)) / 4e-6;
        let stated = normal.right[parameter];
        assert!((slope - stated).abs() < 1e-4 * stated.abs() + 1e-2, "{parameter}: {slope} beside {stated}");
    }
}
