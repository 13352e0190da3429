//! Proposals keep what they promise.

use super::*;
use crate::decode::{DecodeSettings, Decoder};
use crate::geometry::camera::{Camera, Lens};
use crate::surface::SurfaceSettings;
use nalgebra::{Isometry3, Point3, Vector3};
use std::f64::consts::PI;

fn wanted() -> Requirements {
    Requirements {
        axis: Axis::X,
        extent_px: 608,
        full_scale_dn: 255.0,
        modulation_dn: 60.0,
        background_dn: 80.0,
        read_noise_dn: 0.4,
        gain_dn: 0.024,
        blur_px: 0.6,
        projector_gamma: 1.0,
        depth: Depth { um_per_px: 700.0, noise_share: 1.0, pattern_cancels: true },
        most_period_px: None,
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
    let pixel = crate::math::sin(PI / first.period_px) / (PI / first.period_px);
    let b = 60.0 * crate::math::exp(-2.0 * PI * PI * blur * blur) * pixel;
    let sigma = (2.0 / f64::from(first.steps) * (0.16 + 0.024 * 80.0)).sqrt() / b;
    assert!((first.sigma_phase_rad / sigma - 1.0).abs() < 1e-12);
    assert!((first.u_point_um - 700.0 * sigma * first.period_px / TAU).abs() < 1e-9);
    // Less than can be had.
    let hopeless = propose(&Requirements { want_u_um: Some(1e-3), ..wanted() }).unwrap();
    assert!(!hopeless.is_empty() && hopeless.iter().all(|p| !p.meets));
    assert!(hopeless.windows(2).all(|w| w[0].u_point_um <= w[1].u_point_um));
}

#[test]
fn the_decoder_takes_every_proposal() {
    for extent_px in [40, 608, 1280, 1920] {
        for proposal in propose(&Requirements { extent_px, want_u_um: None, ..wanted() }).unwrap() {
            let order = sets::ORDERS.into_iter().find(|o| o.name() == proposal.order).unwrap();
            let settings = DecodeSettings { order, ..DecodeSettings::default() };
            let made = Decoder::new(&proposal.sequence, 8, 8, 255, [extent_px; 2], &settings);
            assert!(made.is_ok(), "{extent_px} {proposal:?}: {made:?}");
        }
    }
}

/// What the decoder would mask is no plan: fringes too faint, too bright.
#[test]
fn fringes_that_the_decoder_masks_do_not_meet_anything() {
    let want = Requirements { want_u_um: None, ..wanted() };
    let any = |wanted: &Requirements| propose(wanted).unwrap().iter().any(|p| p.meets);
    assert!(any(&want));
    assert!(!any(&Requirements { modulation_dn: 5.0, background_dn: 6.0, ..want.clone() }));
    assert!(!any(&Requirements { background_dn: 200.0, ..want.clone() }));
    assert!(!any(&Requirements { full_scale_dn: 4095.0, ..want.clone() }));
    let short = propose(&Requirements { most_period_px: Some(8.0), ..want }).unwrap();
    assert!(!short.is_empty() && short.iter().all(|proposal| proposal.period_px <= 8.0));
}

#[test]
fn numbers_that_make_no_sense_are_named() {
    for (bad, key) in [
        (Requirements { extent_px: 3, ..wanted() }, "extent_px"),
        (Requirements { modulation_dn: 0.0, ..wanted() }, "modulation_dn"),
        (Requirements { background_dn: 30.0, ..wanted() }, "modulation_dn"),
        (Requirements { read_noise_dn: f64::NAN, ..wanted() }, "read_noise_dn"),
        (Requirements { want_u_um: Some(-1.0), ..wanted() }, "want_u_um"),
        (Requirements { most_period_px: Some(5.0), ..wanted() }, "most_period_px"),
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
        distortion: Lens::default(),
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
    let surface = SurfaceSettings { smoothing_px: 1, ..SurfaceSettings::default() };
    let found = geometry::by_projector(&left, &projector, Axis::X, &surface).unwrap();
    assert!(!found.pattern_cancels && found.noise_share == 1.0);
    assert!((found.um_per_px / 1e3 / expected - 1.0).abs() < 1e-3, "{found:?} {expected}");
    let other = geometry::by_projector(&left, &projector, Axis::Y, &surface);
    assert!(other.is_none_or(|depth| depth.um_per_px > 1e6));
    // Cameras: pixel 0.25 mm on the surface; the match of one projector pixel (0.5 mm) is 2 px; base 200 at 500.
    let found = geometry::by_phase(&left, &right, &projector, Axis::X, &surface).unwrap();
    assert!(
        (found.um_per_px / 1e3 / (0.5 * 1.242_f64.sqrt() * 500.0 / 200.0) - 1.0).abs() < 0.01,
        "{found:?}"
    );
    let smoothed =
        geometry::by_phase(&left, &right, &projector, Axis::X, &SurfaceSettings::default()).unwrap();
    // What the settings of the surface say of the scatter of single points.
    assert!((smoothed.noise_share.sqrt() - 0.47).abs() < 0.005, "{smoothed:?}");
    let scale = geometry::projector_px_per_camera_px(&left, &projector).unwrap();
    assert!((scale / (1000.0 / 500.0 / (2000.0 / 260_000.0_f64.sqrt())) - 1.0).abs() < 1e-3, "{scale}");
    assert!(geometry::middle_mm(&left, &left).is_none());
}

/// The closed form of the ripple beside frames that are drawn through the response.
#[test]
fn the_error_of_the_response_is_that_of_drawn_steps() {
    for (gamma, steps) in [(1.05, 3_u32), (1.05, 4), (2.2, 3), (2.2, 4), (2.2, 5), (0.6, 3)] {
        let drawn = |phase: f64| {
            let (mut c, mut s) = (0.0, 0.0);
            for i in 0..steps {
                let delta = TAU * f64::from(i) / f64::from(steps);
                let light = crate::math::pow(0.5 + 0.5 * crate::math::cos(phase - delta), gamma);
                c += light * crate::math::cos(delta);
                s += light * crate::math::sin(delta);
            }
            crate::math::wrap_rad(crate::math::atan2(s, c) - phase)
        };
        let squares: f64 = (0..1000).map(|k| drawn(TAU * f64::from(k) / 1000.0).powi(2)).sum();
        let rms = (squares / 1000.0).sqrt();
        // The period is long beside the projector's pixels; the closed form is of first order.
        let found = pattern::harmonic_error_rad(gamma, 0.0, 1e6, steps);
        assert!((found / rms - 1.0).abs() < 0.05, "γ {gamma}, {steps} steps: {found} and {rms} rad");
    }
    assert_eq!(pattern::harmonic_error_rad(1.0, 0.6, 16.0, 3), 0.0);
}

#[test]
fn three_steps_through_a_response_are_not_proposed_where_their_ripple_matters() {
    let depth = Depth { um_per_px: 700.0, noise_share: 1.0, pattern_cancels: false };
    let coarse = || Requirements { want_u_um: Some(20.0), ..wanted() };
    let of =
        |projector_gamma| propose(&Requirements { projector_gamma, depth, ..coarse() }).unwrap()[0].clone();
    let (corrected, crooked) = (of(1.0), of(1.3));
    assert!(
        corrected.meets && crooked.meets && corrected.steps == 3 && crooked.steps > 3,
        "{corrected:?} {crooked:?}"
    );
    assert!(crooked.pattern_error_rad < 0.02);
    // Two cameras do not mind.
    let pair = Requirements { projector_gamma: 1.3, ..coarse() };
    assert_eq!(propose(&pair).unwrap()[0].frames, propose(&coarse()).unwrap()[0].frames);
}
