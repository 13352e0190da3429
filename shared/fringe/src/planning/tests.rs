//! Proposals keep what they promise.

use super::*;
use crate::camera::{BrownConrady, Camera};
use crate::decode::{DecodeSettings, Decoder};
use nalgebra::{Isometry3, Point3, Vector3};

fn wanted() -> Wanted {
    Wanted {
        axis: Axis::X,
        extent_px: 608,
        modulation_dn: 60.0,
        background_dn: 80.0,
        read_noise_dn: 0.4,
        gain_dn: 0.024,
        blur_px: 0.6,
        um_per_px: 700.0,
        want_u_um: Some(10.0),
        most_wrong: 1e-6,
    }
}

#[test]
fn the_first_proposal_meets_what_is_wanted_with_the_fewest_frames() {
    let all = propose(&wanted()).unwrap();
    let first = &all[0];
    assert!(first.meets && first.u_point_um <= 10.0 && first.wrong_order <= 1e-6, "{first:?}");
    assert!(all.iter().filter(|p| p.meets).all(|p| p.frames >= first.frames));
    // √(2/N) σ_I/B with the contrast that blur leaves, in the open.
    let blur: f64 = 0.6 / first.period_px;
    let b = 60.0 * crate::math::exp(-2.0 * PI * PI * blur * blur);
    let sigma = (2.0 / f64::from(first.steps) * (0.16 + 0.024 * 80.0)).sqrt() / b;
    assert!((first.sigma_phase_rad / sigma - 1.0).abs() < 1e-12);
    assert!((first.u_point_um - 700.0 * sigma * first.period_px / TAU).abs() < 1e-9);
    // Less than can be had.
    let hopeless = propose(&Wanted { want_u_um: Some(1e-3), ..wanted() }).unwrap();
    assert!(!hopeless.is_empty() && hopeless.iter().all(|p| !p.meets));
    assert!(hopeless.windows(2).all(|w| w[0].u_point_um <= w[1].u_point_um));
}

#[test]
fn the_decoder_takes_every_proposal() {
    for extent_px in [40, 608, 1280, 1920] {
        for proposal in propose(&Wanted { extent_px, want_u_um: None, ..wanted() }).unwrap() {
            let order = sets::ORDERS.into_iter().find(|o| o.name() == proposal.order).unwrap();
            let settings = DecodeSettings { order, ..DecodeSettings::default() };
            let made = Decoder::new(&proposal.sequence, 8, 8, 255, [extent_px; 2], &settings);
            assert!(made.is_ok(), "{extent_px} {proposal:?}: {made:?}");
        }
    }
}

#[test]
fn numbers_that_make_no_sense_are_named() {
    for (bad, key) in [
        (Wanted { extent_px: 3, ..wanted() }, "extent_px"),
        (Wanted { modulation_dn: 0.0, ..wanted() }, "modulation_dn"),
        (Wanted { read_noise_dn: f64::NAN, ..wanted() }, "read_noise_dn"),
        (Wanted { want_u_um: Some(-1.0), ..wanted() }, "want_u_um"),
    ] {
        assert_eq!(propose(&bad).unwrap_err().key, key);
    }
}

fn camera(x_mm: f64, focal_px: f64) -> Camera {
    let centre = Point3::new(x_mm, 0.0, -500.0);
    let rotation = nalgebra::UnitQuaternion::face_towards(&-centre.coords, &Vector3::y()).inverse();
    Camera {
        width_px: 1000,
        height_px: 800,
        focal_px: [focal_px; 2],
        principal_point_px: [499.5, 399.5],
        skew: 0.0,
        distortion: BrownConrady::default(),
        camera_from_world: Isometry3::from_parts((-(rotation * centre.coords)).into(), rotation),
    }
}

#[test]
fn the_depth_per_pixel_is_that_of_the_triangle() {
    let (left, right, projector) = (camera(-100.0, 2000.0), camera(100.0, 2000.0), camera(0.0, 1000.0));
    let at = geometry::middle_mm(&left, &right).unwrap();
    assert!(at.coords.norm() < 1e-9, "{at}");
    // Projector: the point moves by sin 11.31° across its ray, at 500 mm and 1000 px.
    let expected = 500.0 / 1000.0 / crate::math::sin(crate::math::atan(0.2));
    let found = geometry::by_projector(&left, &projector, Axis::X).unwrap();
    assert!((found / expected - 1.0).abs() < 1e-3, "{found} {expected}");
    assert!(geometry::by_projector(&left, &projector, Axis::Y).is_none_or(|mm| mm > 1e3));
    // Cameras: pixel 0.25 mm on the surface; the match of one projector pixel (0.5 mm) is 2 px; base 200 at 500.
    let found = geometry::by_phase(&left, &right, &projector, Axis::X).unwrap();
    assert!((found / (0.5 * MATCHED_ROOT * 500.0 / 200.0) - 1.0).abs() < 0.01, "{found}");
    assert!(geometry::middle_mm(&left, &left).is_none());
}

const MATCHED_ROOT: f64 = 1.201_850_425_154_663;
