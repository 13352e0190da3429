use crate::common::{body, scene, small_rig};
use fringe::math::random::Normal;
use fringe::math::{atan, exp};
use fringe::pattern::{Axis, PatternSet};
use nalgebra::{Point2, Point3, Vector3};
use std::f64::consts::PI;
use twin::cell::TruthPoint;
use twin::{PixelsMut, Scene, Twin, TwinSettings, View, pose};

const WHITE: [PatternSet; 1] = [PatternSet::White {}];
const COLUMNS: usize = 280;

fn plate(z_mm: f64, size_mm: f64) -> String {
    body(
        "plate",
        [0.0, 0.0, z_mm],
        &format!("{{ shape = \"plane\", size_mm = [{size_mm:?}, {size_mm:?}], thickness_mm = 5.0 }}"),
    )
}

fn twin(scene: &Scene, settings: TwinSettings) -> Twin {
    Twin::new(scene, settings, &small_rig()).unwrap()
}

fn irradiance(twin: &Twin, view: &View, sequence: &[PatternSet], frame: usize) -> Vec<f32> {
    twin.renderer("proj1", sequence).unwrap().irradiance(view, frame).unwrap().to_vec()
}

fn view(twin: &Twin) -> View {
    twin.view_lit_by("cam1", &["proj1"], 0).unwrap()
}

fn seen(twin: &Twin, index: usize) -> Option<TruthPoint> {
    let pixel = Point2::new((index % COLUMNS) as f64, (index / COLUMNS) as f64);
    twin.truth_point("cam1", 0, pixel).unwrap()
}

/// Amplitude of four steps of a sine.
fn modulation(twin: &Twin, view: &View, period_px: f64) -> Vec<f64> {
    let sequence = [PatternSet::sine(Axis::X, period_px, 4)];
    let frames: Vec<Vec<f32>> = (0..4).map(|step| irradiance(twin, view, &sequence, step)).collect();
    let amplitude = |i: usize| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|step: usize| f64::from(frames[step][i]));
        0.5 * ((a - c).powi(2) + (b - d).powi(2)).sqrt()
    };
    (0..frames[0].len()).map(amplitude).collect()
}

/// Blur of `defocus_px_per_mm` times the distance from the sphere of focus through the middle of the part leaves
/// exp(−2π²b²/p²) of the modulation.
#[test]
fn defocus_takes_the_modulation_that_its_blur_takes() {
    // The plate lies across the beam, so that it leaves the focus to both sides.
    let (period_px, rate) = (32.0, 0.12);
    let plate = scene(&plate(15.0, 150.0));
    let sharp = twin(&plate, TwinSettings::ideal());
    let blurred = twin(&plate, TwinSettings { defocus_px_per_mm: rate, ..TwinSettings::ideal() });
    let lens = small_rig().projector("proj1").unwrap().centre_mm();
    let view_of_sharp = view(&sharp);
    let (before, after) =
        (modulation(&sharp, &view_of_sharp, period_px), modulation(&blurred, &view(&blurred), period_px));
    let middle = plate.centre_mm();
    let (mut evaluated, mut most_lost) = (0, 0.0_f64);
    for i in 0..before.len() {
        let Some(at) = view_of_sharp.truth_coordinate("proj1", i).unwrap() else { continue };
        // At the border of the chip the blur mixes in darkness.
        if at.x < 40.0 || at.x > 568.0 {
            continue;
        }
        let Some(point) = seen(&sharp, i) else { continue };
        let blur_px = rate * ((point.world_mm - lens).norm() - (middle - lens).norm()).abs();
        if blur_px > 5.5 {
            continue;
        }
        let expected = exp(-2.0 * PI * PI * (blur_px / period_px).powi(2));
        let found = after[i] / before[i];
        assert!((found - expected).abs() < 0.01, "{blur_px} px: {found} instead of {expected}");
        evaluated += 1;
        most_lost = most_lost.max(1.0 - expected);
    }
    assert!(evaluated > 3000 && most_lost > 0.3, "{evaluated} pixels, at most {most_lost} lost");
}

/// Frame n stands n times the drift higher, and nothing else moves.
#[test]
fn drift_lifts_every_frame_by_its_amount() {
    let settings = TwinSettings { drift_um: -15.0, ..TwinSettings::ideal() };
    for frame in [0, 1, 7] {
        let shift = pose::vibration_mm(&settings, &Normal::default(), 3, 1, frame);
        let expected = Vector3::new(0.0, 0.0, -0.015 * frame as f64);
        assert!((shift - expected).norm() < 1e-15, "frame {frame}: {shift}");
    }
    let sequence = [PatternSet::sine(Axis::X, 16.0, 10)];
    let still = twin(&scene(&plate(15.0, 110.0)), TwinSettings::ideal());
    let drifting = twin(&scene(&plate(15.0, 110.0)), settings);
    let lifted = twin(&scene(&plate(15.0 - 0.015 * 7.0, 110.0)), TwinSettings::ideal());
    let (still_view, drifting_view, lifted_view) = (view(&still), view(&drifting), view(&lifted));
    let image = |twin: &Twin, view: &View| irradiance(twin, view, &sequence, 7);
    let (still_image, drifted, lifted_image) =
        (image(&still, &still_view), image(&drifting, &drifting_view), image(&lifted, &lifted_view));
    let inner = |i: &usize| {
        seen(&still, *i)
            .is_some_and(|p| p.face == 2 && p.world_mm.x.abs() < 50.0 && p.world_mm.y.abs() < 50.0)
    };
    let inner: Vec<usize> = (0..still_image.len()).filter(inner).collect();
    let power =
        |a: &[f32], b: &[f32]| inner.iter().map(|i| f64::from(a[*i] - b[*i]).powi(2)).sum::<f64>().sqrt();
    let (effect, error) = (power(&still_image, &lifted_image), power(&drifted, &lifted_image));
    assert!(inner.len() > 3000 && effect > 0.05, "{} pixels, effect {effect}", inner.len());
    // What stays is the light's falloff and the second order, as for vibration.
    assert!(error < 0.05 * effect, "{error} of {effect}");
    assert!(
        irradiance(&drifting, &drifting_view, &sequence, 0) == irradiance(&still, &still_view, &sequence, 0)
    );
}

/// A floor and a wall that faces the projector.
const WALL_HALF_MM: f64 = 15.0;
const WALL_HEIGHT_MM: f64 = 12.0;
const WALL_X_MM: f64 = -20.0;

fn corner() -> Scene {
    let wall =
        format!("{{ shape = \"box\", size_mm = [4.0, {:?}, {WALL_HEIGHT_MM:?}] }}", 2.0 * WALL_HALF_MM);
    scene(&(plate(0.0, 120.0) + &body("wall", [WALL_X_MM - 2.0, 0.0, 0.5 * WALL_HEIGHT_MM], &wall)))
}

/// Light from a wall that stands on the floor: the receiving place gets its form factor, (1/π)(atan(c/a) − a/r · atan(c/r)) with
/// r² = a² + h² for a place at a distance a before the middle of a wall of height h and half width c, times the albedo and the wall's
/// light (a point of the floor towards a rectangle at right angles; J. R. Howell, catalogue of configuration factors, B-4).
#[test]
fn the_first_bounce_is_the_form_factor_times_the_light_of_the_wall() {
    let scene = corner();
    let plain = twin(&scene, TwinSettings::ideal());
    let bouncing = twin(&scene, TwinSettings { bounce_rays: 256, ..TwinSettings::ideal() });
    let (direct, both) =
        (irradiance(&plain, &view(&plain), &WHITE, 0), irradiance(&bouncing, &view(&bouncing), &WHITE, 0));
    let lens = small_rig().projector("proj1").unwrap().centre_mm();
    let cosine_over_square = |at: &Point3<f64>, normal: &Vector3<f64>| {
        let way = lens - at;
        way.dot(normal) / way.norm().powi(3)
    };
    let albedo = 0.7;
    let wall = Point3::new(WALL_X_MM, 0.0, 0.4 * WALL_HEIGHT_MM);
    let wall_light = cosine_over_square(&wall, &Vector3::x());
    let (mut found, mut expected, mut pixels) = (0.0, 0.0, 0);
    for i in 0..direct.len() {
        let Some(point) = seen(&plain, i) else { continue };
        let a = point.world_mm.x - WALL_X_MM;
        let before_wall =
            point.body == 0 && point.face == 2 && (2.0..10.0).contains(&a) && point.world_mm.y.abs() < 2.0;
        if !before_wall || direct[i] == 0.0 {
            continue;
        }
        let r = (a * a + WALL_HEIGHT_MM * WALL_HEIGHT_MM).sqrt();
        let factor = (atan(WALL_HALF_MM / a) - a / r * atan(WALL_HALF_MM / r)) / PI;
        let ratio = albedo * factor * wall_light / cosine_over_square(&point.world_mm, &Vector3::z());
        found += f64::from(both[i] - direct[i]);
        expected += f64::from(direct[i]) * ratio;
        pixels += 1;
    }
    assert!(pixels > 20, "{pixels} pixels");
    // 256 rays a pixel leave some per cent of grain in the sum; the wall's light varies by less.
    assert!((found / expected - 1.0).abs() < 0.05, "{found} instead of {expected} over {pixels} pixels");
}

#[test]
fn few_rays_of_the_bounce_are_grainy_and_unbiased_and_a_flat_plate_has_none() {
    let of = |scene: &Scene, bounce_rays: u32, seed: u64| {
        let twin = twin(scene, TwinSettings { bounce_rays, seed, ..TwinSettings::ideal() });
        irradiance(&twin, &view(&twin), &WHITE, 0)
    };
    let flat = scene(&plate(0.0, 120.0));
    assert!(of(&flat, 16, 1) == of(&flat, 0, 1));
    let corner = corner();
    let sum = |values: &[f32]| values.iter().map(|v| f64::from(*v)).sum::<f64>();
    let (none, many) = (sum(&of(&corner, 0, 1)), sum(&of(&corner, 128, 1)));
    let few = (1..=8).map(|seed| sum(&of(&corner, 4, seed))).sum::<f64>() / 8.0;
    assert!(many - none > 1.0, "{none} and {many}");
    // Four rays leave 5 % of grain in the sum over the picture, eight pictures of them 2 %.
    assert!(((few - none) / (many - none) - 1.0).abs() < 0.06, "{none}, {few}, {many}");
}

/// Light goes with the factor; the black level and the noise's seed do not.
#[test]
fn an_exposure_multiplies_the_light_and_has_noise_of_its_own() {
    let settings = TwinSettings { black_level: 0.02, ..TwinSettings::ideal() };
    let twin_of = |settings: &TwinSettings| twin(&scene(&plate(0.0, 120.0)), settings.clone());
    let quiet = twin_of(&settings);
    let view_of_quiet = view(&quiet);
    let mut renderer = quiet.renderer("proj1", &WHITE).unwrap();
    let nominal = renderer.irradiance(&view_of_quiet, 0).unwrap().to_vec();
    renderer.expose(1, 0.25);
    let short = renderer.irradiance(&view_of_quiet, 0).unwrap().to_vec();
    for (one, other) in nominal.iter().zip(&short) {
        assert!((other - 0.02 - 0.25 * (one - 0.02)).abs() < 1e-6, "{one} and {other}");
    }
    let noisy = twin_of(&TwinSettings { read_noise_e: 50.0, ..settings });
    let view_of_noisy = view(&noisy);
    let mut renderer = noisy.renderer("proj1", &WHITE).unwrap();
    let mut frame = |number| {
        let mut out = vec![0_u16; nominal.len()];
        renderer.expose(number, 1.0);
        renderer.render(&view_of_noisy, 0, PixelsMut::Mono16(&mut out)).unwrap();
        out
    };
    let (first, second, again) = (frame(0), frame(1), frame(0));
    assert!(first == again && first != second);
}

#[test]
fn every_setting_is_written_and_read_and_checked_against_its_range() {
    let turned = TwinSettings {
        defocus_px_per_mm: 0.037,
        bounce_rays: 11,
        drift_um: -4.5,
        gloss: 0.3,
        vibration_um: 0.9,
        ..TwinSettings::default()
    };
    let text = toml::to_string(&turned).unwrap();
    assert_eq!(toml::from_str::<TwinSettings>(&text).unwrap(), turned);
    assert_eq!(toml::from_str::<TwinSettings>("").unwrap(), TwinSettings::default());
    assert!(toml::from_str::<TwinSettings>("defocus = 1.0").is_err(), "an unknown setting");
    let ideal = TwinSettings::ideal;
    for (bad, key) in [
        (TwinSettings { defocus_px_per_mm: 1.5, ..ideal() }, "defocus_px_per_mm"),
        (TwinSettings { defocus_px_per_mm: -0.1, ..ideal() }, "defocus_px_per_mm"),
        (TwinSettings { defocus_px_per_mm: f64::NAN, ..ideal() }, "defocus_px_per_mm"),
        (TwinSettings { bounce_rays: 257, ..ideal() }, "bounce_rays"),
        (TwinSettings { drift_um: 1001.0, ..ideal() }, "drift_um"),
        (TwinSettings { drift_um: f64::NEG_INFINITY, ..ideal() }, "drift_um"),
        (TwinSettings { gloss: -1.0, ..ideal() }, "gloss"),
        (TwinSettings { vibration_um: 2000.0, ..ideal() }, "vibration_um"),
    ] {
        let error = bad.check().unwrap_err();
        assert_eq!(error.key, key);
        assert!(error.to_string().contains("must be"), "{error}");
    }
}
