//! The projector method against exact surfaces and against bisection.

use super::*;
use crate::synthetic::{Scene, Surface, pixel_of, rig};
use nalgebra::{Point2, Vector3};
use proptest::prelude::*;

fn scene(projector: &Camera, surface: Surface) -> Scene {
    Scene { surfaces: vec![surface], projector: projector.clone(), period_px: 16.0 }
}

fn rays<'a>(camera: &Camera, projector: &'a Camera, settings: &'a ProjectorSettings) -> Rays<'a> {
    let projector_from_camera = projector.camera_from_world * camera.camera_from_world.inverse();
    Rays {
        projector,
        settings,
        rotation: projector_from_camera.rotation.to_rotation_matrix().into_inner(),
        origin: projector_from_camera.translation.vector,
    }
}

proptest! {
    /// The exact projector coordinates of a point give the point back to 1e-9 mm, with a strongly distorted projector.
    #[test]
    fn the_curved_column_is_met_exactly(
        x in -60.0_f64..60.0, y in -50.0_f64..50.0, z in -45.0_f64..45.0, k1 in -0.25_f64..0.25, axes in 0..3_usize,
    ) {
        let [camera, _, mut projector] = rig(1124, 750);
        projector.distortion.k = [k1, 0.1, 0.0];
        projector.distortion.p = [1e-3, -2e-3];
        projector.skew = 0.5;
        let settings = ProjectorSettings::default();
        let rays = rays(&camera, &projector, &settings);
        let truth = nalgebra::Point3::new(x, y, z);
        let (inside, lit) = (camera.camera_from_world * truth, projector.project(&truth).unwrap());
        let along = rays.rotation * Vector3::new(inside.x / inside.z, inside.y / inside.z, 1.0);
        let observe = |axis: usize| {
            (axes == 2 || axes == axis).then_some(Observation { pixel: lit[axis], sigma_px: 0.1 })
        };
        // Rows meet the camera's rays at a glancing angle here: the solution is as exact, scaled by that.
        let result = rays.depth(&along, &[observe(0), observe(1)]);
        if projector.contains(lit) && axes != 1 {
            let Ok((depth, _, off)) = result else { return Err(TestCaseError::fail("missed")) };
            prop_assert!((depth - inside.z).abs() < 1e-9, "{} beside {}", depth, inside.z);
            prop_assert!(off.is_none_or(|off| off < 1e-9));
        }
    }

    /// The closed form of eq. 3.7 (with h^p₃₄ in its last element, where the thesis prints h^c₃₄), without lens distortion.
    #[test]
    fn the_closed_form_is_ours(x in -60.0_f64..60.0, y in -50.0_f64..50.0, z in -45.0_f64..45.0, off in -3.0_f64..3.0) {
        let [mut camera, _, mut projector] = rig(1124, 750);
        camera.distortion = crate::geometry::camera::Lens::default();
        projector.distortion = crate::geometry::camera::Lens::default();
        projector.skew = 0.5;
        let truth = nalgebra::Point3::new(x, y, z);
        let (seen, lit) = (camera.project(&truth).unwrap(), projector.project(&truth).unwrap());
        // A column beside the true one: the two must agree on any input, not only where the answer is known.
        let column = lit.x + off;
        let closed = closed_form(&camera, &projector, seen, column);
        let settings = ProjectorSettings { margin_px: 1e4, ..ProjectorSettings::default() };
        let rays = rays(&camera, &projector, &settings);
        let ideal = camera.normalised_from_pixel(seen).unwrap();
        let along = rays.rotation * Vector3::new(ideal.x, ideal.y, 1.0);
        let observed = [Some(Observation { pixel: column, sigma_px: 0.1 }), None];
        let Ok((depth, ..)) = rays.depth(&along, &observed) else { return Err(TestCaseError::fail("missed")) };
        let ours = camera.camera_from_world.inverse() * nalgebra::Point3::new(ideal.x * depth, ideal.y * depth, depth);
        prop_assert!((ours - closed).norm() < 1e-8, "{} beside {}", ours, closed);
        prop_assert!(off.abs() > 1e-3 || (closed - truth).norm() < 0.1);
    }

    /// Newton's root is the one that bisection finds.
    #[test]
    fn newton_agrees_with_bisection(u in 50.0_f64..550.0, row in 100..650_usize, column in 200..900_usize) {
        let [camera, _, mut projector] = rig(1124, 750);
        projector.distortion.k = [-0.2, 0.1, 0.0];
        let settings = ProjectorSettings { margin_px: 1e4, ..ProjectorSettings::default() };
        let rays = rays(&camera, &projector, &settings);
        let ideal = camera.normalised_from_pixel(Point2::new(column as f64, row as f64)).unwrap();
        let along = rays.rotation * Vector3::new(ideal.x, ideal.y, 1.0);
        let residual = |depth: f64| rays.project(&along, depth).unwrap().0.x - u;
        let (mut low, mut high) = (300.0, 900.0);
        prop_assume!(residual(low) * residual(high) < 0.0);
        for _ in 0..100 {
            let middle = f64::midpoint(low, high);
            if residual(low) * residual(middle) <= 0.0 { high = middle } else { low = middle }
        }
        let observed = [Some(Observation { pixel: u, sigma_px: 0.1 }), None];
        let Ok((depth, ..)) = rays.depth(&along, &observed) else { return Err(TestCaseError::fail("missed")) };
        prop_assert!((depth - low).abs() < 1e-9, "{} beside {}", depth, low);
    }
}

/// Depth in closed form, thesis eq. 3.5 – 3.7.
fn closed_form(camera: &Camera, projector: &Camera, seen: Point2<f64>, column: f64) -> nalgebra::Point3<f64> {
    let homography = |view: &Camera| {
        let pose = view.camera_from_world.to_homogeneous();
        view.matrix() * pose.fixed_view::<3, 4>(0, 0)
    };
    let (c, p) = (homography(camera), homography(projector));
    let rows = [c.row(0) - c.row(2) * seen.x, c.row(1) - c.row(2) * seen.y, p.row(0) - p.row(2) * column];
    let matrix = Matrix3::from_fn(|row, column| rows[row][column]);
    let right = Vector3::from_fn(|row, _| -rows[row][3]);
    (matrix.try_inverse().unwrap() * right).into()
}

fn points(
    matcher: &mut ProjectorMatcher,
    x: Option<&PhaseView>,
    y: Option<&PhaseView>,
) -> (Vec<Point>, ProjectorReport) {
    let mut out = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    let report = matcher.run(x, y, 1, &mut out).unwrap();
    out.truncate(report.points as usize);
    (out, report)
}

#[test]
fn a_plane_is_measured_to_the_resolution_of_the_phase() {
    let [camera, _, projector] = rig(300, 200);
    let surface = Surface::plane([0.2, -0.3, 1.0], 4.0);
    let scene = scene(&projector, surface);
    let maps = [Axis::X, Axis::Y].map(|axis| scene.phase_map(&camera, axis, 0.0, 0));
    let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
    for y in [None, Some(maps[1].view())] {
        let (points, report) = points(&mut matcher, Some(&maps[0].view()), y.as_ref());
        assert!(report.points > 20_000 && report.epipolar_rms_px.is_none_or(|rms| rms < 1e-3), "{report:?}");
        for point in &points {
            // f32 phases near 240 rad are 2e-5 px coarse, 0.06 µm per 1e-4 px here.
            assert!(surface.distance(&point.position()).abs() < 1e-4);
            assert!((point.normal_vector() - surface.normal(&point.position())).norm() < 2e-3);
            let pixel = camera.project(&point.position()).unwrap();
            assert!((pixel - pixel_of(point.pixel as usize, 300)).norm() < 1e-8, "not on its ray");
        }
    }
}

#[test]
fn predicted_uncertainty_meets_the_scatter() {
    let [camera, _, projector] = rig(300, 200);
    for (normal, both) in [([0.0, 0.0, 1.0], false), ([0.5, -0.3, 1.0], false), ([0.2, 0.2, 1.0], true)] {
        let surface = Surface::plane(normal, 4.0);
        let scene = scene(&projector, surface);
        let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
        let (mut sum, mut n) = (0.0, 0.0);
        for seed in 0..4 {
            let x = scene.phase_map(&camera, Axis::X, 0.02, 2 * seed);
            let y = scene.phase_map(&camera, Axis::Y, 0.05, 2 * seed + 1);
            let y = y.view();
            let (points, _) = points(&mut matcher, Some(&x.view()), both.then_some(&y));
            for point in &points {
                let ratio = surface.distance(&point.position()) / f64::from(point.sigma_mm);
                sum += ratio * ratio;
                n += 1.0;
            }
        }
        let ratio = f64::sqrt(sum / n);
        assert!((0.98..1.02).contains(&ratio), "{ratio} for {normal:?}, both axes: {both}");
    }
}

#[test]
fn a_wrong_order_in_one_axis_is_noticed() {
    let [camera, _, projector] = rig(300, 200);
    let scene = scene(&projector, Surface::plane([0.0, 0.0, 1.0], 0.0));
    let x = scene.phase_map(&camera, Axis::X, 0.01, 1);
    let mut y = scene.phase_map(&camera, Axis::Y, 0.01, 2);
    let band = 100 * 300..110 * 300;
    for phase in &mut y.phase_rad[band.clone()] {
        *phase += TAU as f32;
    }
    let wrong = y.valid[band.clone()].iter().map(|v| u32::from(*v)).sum::<u32>();
    let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
    let (points, report) = points(&mut matcher, Some(&x.view()), Some(&y.view()));
    assert_eq!(report.contradicting, wrong);
    assert!(points.iter().all(|p| !band.contains(&(p.pixel as usize))));
}

#[test]
fn degenerate_input_is_refused_or_empty() {
    let [camera, _, projector] = rig(30, 20);
    let scene = scene(&projector, Surface::plane([0.0, 0.0, 1.0], 0.0));
    let map = scene.phase_map(&camera, Axis::X, 0.01, 1);
    let mut matcher = ProjectorMatcher::new(&camera, &projector, &ProjectorSettings::default()).unwrap();
    let mut out: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    assert_eq!(matcher.run(None, None, 0, &mut out), Err(MatchError::NoPhase));
    assert!(matches!(matcher.run(None, Some(&map.view()), 0, &mut out), Err(MatchError::WrongAxis { .. })));
    let small = scene.phase_map(&rig(20, 20)[0], Axis::X, 0.01, 1);
    assert!(matches!(matcher.run(Some(&small.view()), None, 0, &mut out), Err(MatchError::Size { .. })));
    let masked = crate::phase::PhaseMap::new(map.info);
    assert_eq!(matcher.run(Some(&masked.view()), None, 0, &mut out).unwrap().points, 0);
    let mut constant = map.clone();
    constant.phase_rad.fill(1e9);
    assert_eq!(
        matcher.run(Some(&constant.view()), None, 0, &mut out).unwrap().points,
        0,
        "outside its image"
    );
}
