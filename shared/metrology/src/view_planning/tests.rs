//! Closed forms and brute force beside what is planned.

use super::*;
use crate::spatial::TriangleMesh;
use fringe::geometry::camera::{Camera, Lens};
use fringe::geometry::rig::{Named, Pair, Rig};
use fringe::pattern::Axis;
use fringe::sensor::CameraNoise;
use nalgebra::{Isometry3, Point3, Unit, UnitQuaternion, Vector3};
use std::collections::BTreeMap;

fn camera(x_mm: f64, focal_px: f64) -> Camera {
    let centre = Point3::new(x_mm, 0.0, 500.0);
    let rotation = UnitQuaternion::face_towards(&-centre.coords, &Vector3::y()).inverse();
    Camera {
        width_px: 800,
        height_px: 600,
        focal_px: [focal_px; 2],
        principal_point_px: [399.5, 299.5],
        skew: 0.0,
        distortion: Lens::default(),
        camera_from_world: Isometry3::from_parts((-(rotation * centre.coords)).into(), rotation),
    }
}

fn rig(projector: bool) -> Rig {
    let named = |name: &str, x_mm, focal_px| Named { name: name.into(), camera: camera(x_mm, focal_px) };
    let pair = |name: &str, right: &str| Pair {
        name: name.into(),
        left: "cam1".into(),
        right: right.into(),
        projector: "proj1".into(),
    };
    Rig {
        cameras: vec![named("cam1", -100.0, 2000.0), named("cam2", 100.0, 2000.0)],
        projectors: if projector { vec![named("proj1", 0.0, 1500.0)] } else { Vec::new() },
        pairs: vec![pair("pair1", "cam2")],
        ..Rig::default()
    }
}

fn fringes() -> BTreeMap<String, Vec<Fringes>> {
    BTreeMap::from([(String::new(), vec![Fringes { axis: Axis::X, period_px: 16.0, steps: 10 }])])
}

fn conditions() -> Conditions {
    Conditions {
        element_mm: 2.0,
        white_dn: 150.0,
        black_dn: 6.0,
        full_scale_dn: 255.0,
        noise: CameraNoise { read_noise_dn: 0.4, gain_dn: 0.024 },
        projector_blur_px: 0.6,
        camera_blur_px: 0.58,
        albedo: 0.7,
        bounce_rays: 256,
        surface: fringe::surface::SurfaceSettings::default(),
        decode: fringe::decode::DecodeSettings::default(),
    }
}

type Corners = Vec<[Point3<f64>; 3]>;

/// A box from one corner to the opposite one.
fn cuboid(low: [f64; 3], high: [f64; 3]) -> Corners {
    let corner = |i: usize| {
        let side = |bit: usize| if i >> bit & 1 == 1 { high[bit] } else { low[bit] };
        Point3::new(side(0), side(1), side(2))
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(corner)).collect()
}

fn planner_of(corners: &Corners, rig: &Rig, conditions: Conditions) -> Result<Planner, ViewPlanError> {
    Planner::new(TriangleMesh::new(corners)?, rig, &fringes(), conditions)
}

fn plate() -> Corners {
    cuboid([-40.0, -30.0, -5.0], [40.0, 30.0, 0.0])
}

#[test]
fn elements_have_the_area_of_the_part_and_no_longer_sides() {
    let planner = planner_of(&plate(), &rig(true), conditions()).unwrap();
    let area: f64 = planner.elements().iter().map(|e| e.area_mm2).sum();
    let expected = 2.0 * (80.0 * 60.0 + 80.0 * 5.0 + 60.0 * 5.0);
    assert!((area / expected - 1.0).abs() < 1e-12, "{area}");
    assert!(planner.elements().iter().all(|e| !e.buried && e.area_mm2 < 8.0));
    // Ten thousand facets of a face become as many elements as the size of an element asks for.
    let fine = Conditions { element_mm: 0.5, ..conditions() };
    let fine = planner_of(&plate(), &rig(true), fine).unwrap();
    let corners = fine.elements().len();
    assert!(corners > 8 * planner.elements().len(), "{corners}");
}

/// The top of a plate that faces all: seen everywhere but at its rim; the noise is that of the planner for patterns in its middle.
#[test]
fn a_plate_that_faces_all_is_seen_with_the_noise_of_the_planner() {
    let (rig, conditions) = (rig(true), conditions());
    let planner = planner_of(&plate(), &rig, conditions.clone()).unwrap();
    let seeing = planner.seeing(0..planner.elements().len());
    let (mut top, mut nearest) = (0, (f64::INFINITY, 0));
    for (index, (element, seen)) in planner.elements().iter().zip(&seeing).enumerate() {
        if element.normal.z > 0.5 {
            top += 1;
            // Two pixels of 0.25 mm, and a hair for perspective.
            let inside = element.at.x.abs() < 39.3 && element.at.y.abs() < 29.3;
            assert!(!inside || seen.is_seen(), "{element:?} {seen:?}");
            nearest = if element.at.coords.norm() < nearest.0 {
                (element.at.coords.norm(), index)
            } else {
                nearest
            };
        } else {
            assert_eq!(seen.cause, Cause::FacesAway);
        }
    }
    assert!(top > 1000);
    let middle = &seeing[nearest.1];
    let (left, right, projector) = (camera(-100.0, 2000.0), camera(100.0, 2000.0), camera(0.0, 1500.0));
    let depth = fringe::planning::geometry::by_phase(&left, &right, &projector, Axis::X, &conditions.surface)
        .unwrap();
    let across = 0.58 * fringe::planning::geometry::projector_px_per_camera_px(&left, &projector).unwrap();
    let modulation = 72.0 * fringe::planning::pattern::contrast((0.36 + across * across).sqrt(), 16.0, 1);
    assert!((f64::from(middle.modulation_dn) / modulation - 1.0).abs() < 0.01, "{middle:?} {modulation}");
    let noise = (0.2_f64 * (0.16 + 0.024 * 78.0)).sqrt() / modulation;
    let sigma_mm = 1e-3 * depth.u_point_um(noise, 0.0, 16.0);
    assert!((f64::from(middle.sigma_mm) / sigma_mm - 1.0).abs() < 0.02, "{middle:?} {sigma_mm}");
    assert!(middle.bounce == 0.0, "nothing lies above the plate: {middle:?}");
}

/// A wall of 60 mm in the middle: each side is hidden from one camera, so that no strip beside it is seen, and it shades nothing.
#[test]
fn a_wall_hides_what_geometry_says() {
    let wall = cuboid([-2.0, -30.0, 0.0], [2.0, 30.0, 60.0]);
    let planner = planner_of(&[plate(), wall].concat(), &rig(true), conditions()).unwrap();
    let seeing = planner.seeing(0..planner.elements().len());
    let mut hidden = 0;
    for (element, seen) in
        planner.elements().iter().zip(&seeing).filter(|(e, _)| e.normal.z > 0.5 && e.at.z == 0.0)
    {
        if element.buried {
            assert!(element.at.x.abs() < 2.0);
            continue;
        }
        // From 2 mm at a height of 60 mm the shadow of a camera 98 mm aside at 500 mm reaches to 2 + 98 · 60/440.
        let reach = 2.0 + 98.0 * 60.0 / 440.0 + 4.0 / 440.0 * 60.0;
        let beyond = element.at.x.abs() - reach;
        if beyond < -1.0 {
            assert_eq!(seen.cause, Cause::Hidden, "{element:?}");
            hidden += 1;
        } else if beyond > 2.5 && element.at.x.abs() < 38.0 && element.at.y.abs() < 28.0 {
            assert!(seen.is_seen(), "{element:?} {seen:?}");
        }
    }
    assert!(hidden > 100, "{hidden}");
    let buried: f64 = planner.elements().iter().filter(|e| e.buried).map(|e| e.area_mm2).sum();
    // Foot of the wall, and what it covers of the plate.
    assert!((buried / (2.0 * 4.0 * 60.0) - 1.0).abs() < 0.15, "{buried}");
}

/// Two plates at a right angle: the light that bounces is that of the closed form for a strip beside a wall.
#[test]
fn the_light_of_a_wall_is_its_form_factor() {
    // Very long, so that the view factor of a strip is ½ (1 − sin of the wall's height), here 45° at as far as it is high.
    let floor = cuboid([0.0, -400.0, -5.0], [40.0, 400.0, 0.0]);
    let wall = cuboid([-5.0, -400.0, 0.0], [0.0, 400.0, 20.0]);
    let mut views = rig(true);
    // The light comes in at 45°, from far off: floor and wall get the same.
    let centre = Point3::new(3e5, 0.0, 3e5);
    let rotation = UnitQuaternion::face_towards(&-centre.coords, &Vector3::y()).inverse();
    views.projectors[0].camera.camera_from_world =
        Isometry3::from_parts((-(rotation * centre.coords)).into(), rotation);
    views.projectors[0].camera.focal_px = [1e5; 2];
    let planner = planner_of(&[floor, wall].concat(), &views, conditions()).unwrap();
    let lamp = planner.pairs[0].projector.as_ref().unwrap();
    let mut checked = 0;
    for element in planner.elements().iter().filter(|e| e.normal.z > 0.5 && e.at.z == 0.0 && !e.buried) {
        if (element.at.x - 20.0).abs() < 1.0 && element.at.y.abs() < 20.0 {
            let expected = 0.7 * 0.5 * (1.0 - element.at.x / (element.at.x.powi(2) + 400.0).sqrt());
            let found = planner.bounce(lamp, element);
            assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
            checked += 1;
        }
    }
    assert!(checked > 3, "{checked}");
}

#[test]
fn a_rig_without_a_projector_sees_but_knows_no_light() {
    let planner = planner_of(&plate(), &rig(false), conditions()).unwrap();
    let seeing = planner.seeing(0..planner.elements().len());
    assert!(!planner.is_lit(0) && planner.phases(0, 0).is_none());
    let seen: Vec<_> = seeing.iter().filter(|s| s.is_seen()).collect();
    assert!(seen.len() > 1000 && seen.iter().all(|s| s.sigma_mm.is_nan() && s.incidence_rad.is_finite()));
}

#[test]
fn parts_that_no_pair_can_see_are_refused() {
    let moved = |by: Vector3<f64>, scale: f64| -> Corners {
        plate().iter().map(|t| t.map(|c| Point3::from(c.coords * scale + by))).collect()
    };
    let plan = |corners: &Corners| planner_of(corners, &rig(true), conditions()).map(|_| ()).unwrap_err();
    assert!(matches!(plan(&moved(Vector3::new(2000.0, 0.0, 0.0), 1.0)), ViewPlanError::Outside { .. }));
    assert!(matches!(plan(&moved(Vector3::zeros(), 1e-3)), ViewPlanError::Tiny { .. }));
    assert!(matches!(plan(&Vec::new()), ViewPlanError::Mesh(_)));
    let none = Rig { pairs: Vec::new(), ..rig(true) };
    assert_eq!(planner_of(&plate(), &none, conditions()).unwrap_err(), ViewPlanError::NoPair);
    for (bad, key) in [
        (Conditions { element_mm: 0.0, ..conditions() }, "element-mm"),
        (Conditions { black_dn: 150.0, ..conditions() }, "black-dn"),
        (Conditions { albedo: f64::NAN, ..conditions() }, "albedo"),
    ] {
        let error = planner_of(&plate(), &rig(true), bad).unwrap_err();
        assert!(matches!(error, ViewPlanError::Condition { key: found, .. } if found == key), "{error}");
    }
    let tiny = Conditions { element_mm: 2e-3, ..conditions() };
    assert!(matches!(planner_of(&plate(), &rig(true), tiny), Err(ViewPlanError::TooMany { .. })));
}

/// A pair that looks from one side: greedy choice takes first what sees most, and what is chosen sees what it promises.
#[test]
fn proposals_see_what_they_promise() {
    let tower = cuboid([-15.0, -15.0, 0.0], [15.0, 15.0, 30.0]);
    let part = [plate(), tower].concat();
    let conditions = Conditions { bounce_rays: 0, ..conditions() };
    let planner = planner_of(&part, &rig(true), conditions.clone()).unwrap();
    let seeing = planner.seeing(0..planner.elements().len());
    let middle = planner.mesh().bounds().centre();
    let candidates = turned_pairs(&rig(true), &middle, &Unit::new_normalize(Vector3::z()));
    assert_eq!(candidates.pairs.len(), 5 * 12 + 6);
    // Turning keeps the distance, and the base of the cameras.
    let stand = |name: &str| candidates.camera(name).unwrap().centre_mm() - middle;
    let base = (stand("cam1-60-45") - stand("cam2-60-45")).norm();
    assert!((base - 200.0).abs() < 1e-9, "{base}");
    let head = (stand("cam1-60-45") + stand("cam2-60-45")).normalize();
    assert!((head.z - 0.5_f64.sqrt()).abs() < 1e-9, "{head}");
    let found = propose(&planner, &seeing, (&candidates, &fringes()), (3, 1.0), &mut || ()).unwrap();
    assert!(found.len() == 3 && found.windows(2).all(|w| w[0].gain_mm2 >= w[1].gain_mm2), "{found:?}");
    // Planned again with the first of them, so much less is not seen.
    let mut rig = rig(true);
    let chosen = &candidates.pairs[found[0].candidate];
    rig.cameras.extend(
        candidates.cameras.iter().filter(|c| [&chosen.left, &chosen.right].contains(&&c.name)).cloned(),
    );
    rig.projectors.extend(candidates.projectors.iter().filter(|p| p.name == chosen.projector).cloned());
    rig.pairs.push(chosen.clone());
    let again = planner_of(&part, &rig, conditions).unwrap();
    let seeing = again.seeing(0..again.elements().len());
    let left = coverage(again.elements(), &seeing, 2).by_pairs_mm2[0];
    assert!((left - found[0].left_mm2).abs() < 1e-6 * left, "{left} {found:?}");
    let listed: f64 = patches(again.elements(), &seeing, 2, 2.0).iter().map(|p| p.area_mm2).sum();
    assert!((listed - left).abs() < 1e-6 * left, "{listed} {left}");
}

/// Noise of predicted phases scatters as it is stated, and no thread changes it.
#[test]
fn predicted_phases_scatter_as_stated() {
    let planner = planner_of(&plate(), &rig(true), conditions()).unwrap();
    let map = |trial| planner.phases(0, trial).unwrap()[0][0].clone();
    let (one, two) = (map(0), map(1));
    assert_eq!(one.valid, two.valid);
    let valid = || (0..one.valid.len()).filter(|i| one.valid[*i] != 0);
    let square = |i: usize| {
        let difference = f64::from(one.phase_rad[i] - two.phase_rad[i]);
        0.5 * (difference / f64::from(one.sigma_rad[i])).powi(2)
    };
    let mean = valid().map(square).sum::<f64>() / valid().count() as f64;
    assert!(valid().count() > 50_000 && (mean - 1.0).abs() < 0.02, "{mean}");
}
