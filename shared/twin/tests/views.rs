use crate::common::{artefact, body, parse, scene, small_rig};
use fringe::geometry::camera::Lens;
use fringe::geometry::rig::Rig;
use nalgebra::{Isometry3, Point2, Point3};
use twin::{Scene, Twin, TwinError, TwinSettings, thesis};

fn pixels(rig: &Rig, camera: &str) -> Vec<(usize, Point2<f64>)> {
    let camera = rig.camera(camera).unwrap();
    let width = camera.width_px as usize;
    (0..width * camera.height_px as usize)
        .map(|i| (i, Point2::new((i % width) as f64, (i / width) as f64)))
        .collect()
}

#[test]
fn projector_coordinates_are_those_of_the_true_point_projected() {
    let rig = small_rig();
    // With scatter, so that the pose is part of the chain.
    let settings = TwinSettings { position_scatter_mm: 2.0, angle_scatter_deg: 3.0, ..TwinSettings::ideal() };
    let twin = Twin::new(&artefact(), settings, &rig).unwrap();
    let pose = twin.pose(5);
    assert_ne!(pose, Isometry3::identity());
    for (camera, projector) in [("cam1", "proj1"), ("cam4", "proj2"), ("cam2", "proj2")] {
        let view = twin.view(camera, 5).unwrap();
        let mut lit = 0;
        for (index, pixel) in pixels(&rig, camera) {
            let Some(at) = view.truth_coordinate(projector, index).unwrap() else { continue };
            lit += 1;
            let point = twin.truth_point(camera, 5, pixel).unwrap().unwrap();
            assert!((pose * point.part_mm - point.world_mm).norm() < 1e-12);
            let back = rig.camera(camera).unwrap().project(&point.world_mm).unwrap();
            assert!((back - pixel).norm() < 1e-9, "{camera}: {pixel} came back as {back}");
            let expected = rig.projector(projector).unwrap().project(&point.world_mm).unwrap();
            assert!((at - expected).amax() < 6e-7, "{camera} {projector}: {at} and {expected}");
        }
        assert!(lit > 1000, "{camera} {projector}: {lit} lit pixels");
    }
}

/// Whether the way between two points is free, by steps of the distance to the surface.
fn free(scene: &Scene, from: &Point3<f64>, to: &Point3<f64>) -> Option<bool> {
    let way = to - from;
    let d = way.normalize();
    let (mut t, mut closest) = (0.02, f64::INFINITY);
    while t < way.norm() {
        let step = scene.surface_distance(&(from + d * t)).signed_mm;
        if step < 0.0 {
            return Some(false);
        }
        // Close to its own start the ray is near its own face.
        if t > 2.0 {
            closest = closest.min(step);
        }
        t += step.max(2e-3);
    }
    // Steps of this size cannot distinguish a near miss from a hit.
    (closest > 5e-3).then_some(true)
}

#[test]
fn shadow_and_occlusion_agree_with_marching() {
    let bodies = [
        body(
            "floor",
            [0.0, 0.0, 0.0],
            r#"{ shape = "plane", size_mm = [120.0, 120.0], thickness_mm = 5.0 }"#,
        ),
        body("ball", [10.0, 10.0, 35.0], r#"{ shape = "sphere", diameter_mm = 30.0 }"#),
        body("pin", [-25.0, 5.0, 0.0], r#"{ shape = "cylinder", diameter_mm = 12.0, height_mm = 30.0 }"#),
        body("dome", [30.0, -30.0, 0.0], r#"{ shape = "hemisphere", diameter_mm = 30.0 }"#),
        body("block", [-20.0, -30.0, 10.0], r#"{ shape = "box", size_mm = [20.0, 16.0, 20.0] }"#),
    ];
    let scene = scene(&bodies.concat());
    let rig = small_rig();
    let twin = Twin::new(&scene, TwinSettings::ideal(), &rig).unwrap();
    for (camera, projector) in [("cam1", "proj1"), ("cam3", "proj1"), ("cam4", "proj2")] {
        let view = twin.view(camera, 0).unwrap();
        let eye = rig.camera(camera).unwrap().centre_mm();
        let lamp = rig.projector(projector).unwrap().centre_mm();
        let (mut shadows, mut lights) = (0, 0);
        for (index, pixel) in pixels(&rig, camera) {
            let Some(point) = twin.truth_point(camera, 0, pixel).unwrap() else { continue };
            let p = point.world_mm;
            if scene.surface_distance(&p).is_near_edge(0.3) {
                continue;
            }
            // What the camera sees is really free to its eye.
            assert_ne!(free(&scene, &p, &eye), Some(false), "{camera} {pixel} sees through something");
            let facing = point.normal.dot(&(lamp - p).normalize());
            if facing.abs() < 0.05 {
                continue;
            }
            let Some(way_free) = free(&scene, &p, &lamp) else { continue };
            let expected = facing > 0.0 && way_free;
            let lit = view.truth_coordinate(projector, index).unwrap().is_some();
            assert_eq!(lit, expected, "{camera} {projector} {pixel} on body {}", point.body);
            if facing > 0.0 {
                *(if expected { &mut lights } else { &mut shadows }) += 1;
            }
        }
        assert!(shadows > 100 && lights > 1000, "{camera} {projector}: {shadows} in shadow, {lights} lit");
    }
}

#[test]
fn a_camera_in_the_part_is_refused() {
    let rig = small_rig();
    let eye = rig.camera("cam2").unwrap().centre_mm();
    let table = body("rock", eye.coords.into(), r#"{ shape = "sphere", diameter_mm = 40.0 }"#);
    let twin = Twin::new(&scene(&table), TwinSettings::ideal(), &rig).unwrap();
    let error = twin.view("cam2", 3).unwrap_err();
    assert_eq!(error, TwinError::Inside { name: "cam2".into(), body: "rock".into(), cycle: 3 });
    assert!(twin.view("cam1", 3).is_ok());
}

#[test]
fn a_lens_that_turns_back_lights_nothing_outside_of_its_field() {
    let mut rig = small_rig();
    // Radius 0.3 lies in the image; at 1.39 the polynomial r(1 − r²/2) is back at 0.05.
    rig.projectors[0].camera.distortion = Lens::brown_conrady([-0.5, 0.0, 0.0], [0.0; 2]);
    let projector = rig.projectors[0].camera.clone();
    rig.cameras[0].camera.focal_px = [60.0, 60.0];
    rig.cameras[0].camera.distortion = Lens::default();
    let floor = r#"{ shape = "plane", size_mm = [6000.0, 6000.0], thickness_mm = 5.0 }"#;
    let twin = Twin::new(&scene(&body("floor", [0.0; 3], floor)), TwinSettings::ideal(), &rig).unwrap();
    let view = twin.view_lit_by("cam1", &["proj1"], 0).unwrap();
    let (mut lit, mut turned_back) = (0, 0);
    for (index, pixel) in pixels(&rig, "cam1") {
        let Some(point) = twin.truth_point("cam1", 0, pixel).unwrap() else { continue };
        let seen = projector.camera_from_world * point.world_mm;
        let radius = (seen.x * seen.x + seen.y * seen.y).sqrt() / seen.z;
        if view.truth_coordinate("proj1", index).unwrap().is_some() {
            lit += 1;
            assert!(radius < 0.35, "a point at radius {radius} is lit");
        } else if projector.project(&point.world_mm).is_some_and(|p| projector.contains(p)) {
            turned_back += 1;
            assert!(radius > 0.8);
        }
    }
    assert!(lit > 500 && turned_back > 100, "{lit} lit, {turned_back} would be lit falsely");
}

#[test]
fn a_view_of_another_twin_is_refused() {
    let rig = small_rig();
    let new = || Twin::new(&artefact(), TwinSettings::ideal(), &rig).unwrap();
    let (a, b) = (new(), new());
    let mut view = a.view("cam1", 0).unwrap();
    assert_eq!(b.retrace(&mut view, 1), Err(TwinError::Foreign));
    let mut renderer = b.renderer("proj1", &thesis::sequence()).unwrap();
    assert_eq!(renderer.irradiance(&view, 0), Err(TwinError::Foreign));
}

#[test]
fn unknown_names_and_impossible_rigs_are_refused() {
    let scene = parse(&body("a", [0.0; 3], r#"{ shape = "sphere", diameter_mm = 40.0 }"#)).unwrap();
    let rig = small_rig();
    let twin = Twin::new(&scene, TwinSettings::ideal(), &rig).unwrap();
    let message = twin.view("cam9", 0).unwrap_err().to_string();
    assert_eq!(message, "no camera \"cam9\" here; known: cam1, cam2, cam3, cam4");
    assert!(matches!(twin.view_lit_by("cam1", &["proj7"], 0), Err(TwinError::Unknown { .. })));
    let view = twin.view_lit_by("cam1", &["proj2"], 0).unwrap();
    assert!(matches!(view.truth_coordinate("proj1", 0), Err(TwinError::Unknown { .. })));
    let with = |change: &dyn Fn(&mut Rig)| {
        let mut rig = rig.clone();
        change(&mut rig);
        Twin::new(&scene, TwinSettings::ideal(), &rig).unwrap_err()
    };
    assert_eq!(with(&|r| r.projectors.clear()), TwinError::Missing("projector"));
    assert_eq!(with(&|r| r.cameras.clear()), TwinError::Missing("camera"));
    assert!(matches!(with(&|r| r.cameras[1].camera.focal_px[0] = f64::NAN), TwinError::Camera { .. }));
    assert!(matches!(with(&|r| r.projectors[0].camera.width_px = 4095), TwinError::ProjectorSize { .. }));
    let huge = |r: &mut Rig| (r.cameras[0].camera.width_px, r.cameras[0].camera.height_px) = (65_535, 65_535);
    assert!(matches!(with(&huge), TwinError::Rays { .. }));
    for settings in [
        TwinSettings { bits: 9, ..TwinSettings::default() },
        TwinSettings { exposure: f64::NAN, ..TwinSettings::default() },
        TwinSettings { subsamples: 0, ..TwinSettings::default() },
        TwinSettings { full_well_e: 0.0, ..TwinSettings::default() },
    ] {
        assert!(matches!(Twin::new(&scene, settings, &rig), Err(TwinError::Setting(_))));
    }
}

#[test]
fn the_pose_stays_within_its_scatter_and_depends_on_seed_and_cycle() {
    let scene = artefact();
    let twin =
        |seed| Twin::new(&scene, TwinSettings { seed, ..TwinSettings::default() }, &small_rig()).unwrap();
    let (a, b) = (twin(1), twin(2));
    assert_eq!(a.pose(3), twin(1).pose(3));
    assert_ne!(a.pose(3), a.pose(4));
    assert_ne!(a.pose(3), b.pose(3));
    let (mut reach_mm, mut reach_rad) = (0.0_f64, 0.0_f64);
    for cycle in 0..500 {
        let pose = a.pose(cycle);
        assert!(pose.translation.vector.amax() <= 1.0);
        // Three turns of a degree compose to less than √3 degrees and a bit.
        assert!(pose.rotation.angle() < 1.74_f64.to_radians());
        reach_mm = reach_mm.max(pose.translation.vector.amax());
        reach_rad = reach_rad.max(pose.rotation.angle());
    }
    assert!(reach_mm > 0.95 && reach_rad > 1.0_f64.to_radians(), "{reach_mm} mm, {reach_rad} rad");
}
