use crate::common::{artefact, body, scene, small_rig};
use fringe::geometry::rig::Rig;
use fringe::math::random::Normal;
use fringe::math::{atan2, cos, exp, sin, wrap_rad};
use fringe::pattern::{Axis, PatternSet};
use nalgebra::Point2;
use std::f64::consts::{PI, TAU};
use twin::{PixelsMut, Scene, Twin, TwinError, TwinSettings, View, pose, thesis};

const STEPS: u32 = 10;

fn sine(axis: Axis, period_px: f64) -> Vec<PatternSet> {
    vec![PatternSet::sine(axis, period_px, STEPS)]
}

fn white() -> Vec<PatternSet> {
    vec![PatternSet::White {}]
}

fn plate() -> Scene {
    scene(&body(
        "plate",
        [0.0, 0.0, 15.0],
        r#"{ shape = "plane", size_mm = [160.0, 160.0], thickness_mm = 5.0 }"#,
    ))
}

fn twin(scene: &Scene, settings: TwinSettings) -> Twin {
    Twin::new(scene, settings, &small_rig()).unwrap()
}

/// Wrapped phase (eq. 2.16) and modulation of each pixel, from irradiance.
fn phases(twin: &Twin, view: &View, projector: &str, sequence: &[PatternSet]) -> Vec<(f64, f64)> {
    let mut renderer = twin.renderer(projector, sequence).unwrap();
    let mut sums = vec![(0.0, 0.0); (view.width_px() * view.height_px()) as usize];
    for step in 0..STEPS as usize {
        let delta = TAU * step as f64 / f64::from(STEPS);
        for (sum, value) in sums.iter_mut().zip(renderer.irradiance(view, step).unwrap()) {
            sum.0 += f64::from(*value) * sin(delta);
            sum.1 += f64::from(*value) * cos(delta);
        }
    }
    let modulation = |s: f64, c: f64| 2.0 / f64::from(STEPS) * (s * s + c * c).sqrt();
    sums.iter().map(|(s, c)| (atan2(*s, *c), modulation(*s, *c))).collect()
}

fn frame_u8(twin: &Twin, camera: &str, frame: usize) -> Vec<u8> {
    let view = twin.view(camera, 0).unwrap();
    let mut out = vec![0; (view.width_px() * view.height_px()) as usize];
    view.render("proj1", &thesis::sequence(), frame, PixelsMut::Mono8(&mut out)).unwrap();
    out
}

#[test]
fn the_phase_of_ideal_frames_is_the_projector_coordinate() {
    let twin = twin(&artefact(), TwinSettings::ideal());
    for (camera, projector, axis, period_px) in
        [("cam1", "proj1", Axis::X, 16.0), ("cam3", "proj2", Axis::X, 28.0), ("cam2", "proj1", Axis::Y, 21.5)]
    {
        let view = twin.view(camera, 0).unwrap();
        let mut lit = 0;
        for (index, (phase_rad, _)) in
            phases(&twin, &view, projector, &sine(axis, period_px)).iter().enumerate()
        {
            let Some(at) = view.truth_coordinate(projector, index).unwrap() else { continue };
            lit += 1;
            let truth_rad = TAU * (if axis == Axis::X { at.x } else { at.y }) / period_px;
            let error_rad = wrap_rad(phase_rad - truth_rad);
            assert!(error_rad.abs() < 2e-6, "{camera} pixel {index}: off by {error_rad} rad");
        }
        assert!(lit > 8000, "{lit} lit pixels");
    }
}

#[test]
fn the_phase_of_ideal_16_bit_frames_errs_by_quantisation_only() {
    let twin = twin(&artefact(), TwinSettings::ideal());
    let view = twin.view("cam1", 0).unwrap();
    let mut renderer = twin.renderer("proj1", &sine(Axis::X, 16.0)).unwrap();
    let mut sums = vec![(0.0, 0.0); (view.width_px() * view.height_px()) as usize];
    let mut out = vec![0_u16; sums.len()];
    for step in 0..STEPS as usize {
        renderer.render(&view, step, PixelsMut::Mono16(&mut out)).unwrap();
        let delta = TAU * step as f64 / f64::from(STEPS);
        for (sum, dn) in sums.iter_mut().zip(&out) {
            sum.0 += f64::from(*dn) * sin(delta);
            sum.1 += f64::from(*dn) * cos(delta);
        }
    }
    let (mut squares, mut count) = (0.0_f64, 0.0);
    for (index, (s, c)) in sums.iter().enumerate() {
        let Some(at) = view.truth_coordinate("proj1", index).unwrap() else { continue };
        let modulation = 2.0 / f64::from(STEPS) * (s * s + c * c).sqrt();
        // Eq. 2.58 with the noise of rounding: sigma = √(2/N) · √(1/12) / B.
        let sigma = (2.0 / f64::from(STEPS) / 12.0).sqrt() / modulation;
        let z = wrap_rad(atan2(*s, *c) - TAU * at.x / 16.0) / sigma;
        squares += z * z;
        count += 1.0;
    }
    let ratio: f64 = (squares / count).sqrt();
    assert!((0.9..1.1).contains(&ratio), "observed over expected: {ratio}");
}

#[test]
fn projector_pixels_and_blur_weaken_the_fringes_as_computed_and_keep_their_phase() {
    let (period_px, blur_px) = (16.0, 0.8);
    let modulation = |settings: TwinSettings| {
        let twin = twin(&plate(), settings);
        let view = twin.view("cam1", 0).unwrap();
        let found = phases(&twin, &view, "proj1", &sine(Axis::X, period_px));
        let lit = |i: usize| view.truth_coordinate("proj1", i).unwrap();
        let kept: Vec<_> = found.iter().enumerate().filter_map(|(i, f)| lit(i).map(|at| (at, *f))).collect();
        assert!(kept.len() > 5000);
        kept
    };
    let ideal = TwinSettings::ideal();
    let sharp = modulation(ideal.clone());
    let blurred = modulation(TwinSettings { projector_blur_px: blur_px, ..ideal.clone() });
    let boxed = modulation(TwinSettings { projector_blur_px: blur_px, projector_pixels: true, ..ideal });
    // Fourier transform of the Gaussian; that of the pixel is sinc(1/p), and sampling puts harmonics beside it that
    // the blur leaves at exp(−2π²σ²(1 − 1/p)²) of themselves.
    let gauss = exp(-2.0 * PI * PI * blur_px * blur_px / (period_px * period_px));
    let sinc = sin(PI / period_px) / (PI / period_px);
    let alias =
        exp(-2.0 * PI * PI * blur_px * blur_px * (1.0 - 1.0 / period_px) * (1.0 - 1.0 / period_px)) / 15.0;
    for ((at, sharp), ((_, blurred), (_, boxed))) in sharp.iter().zip(blurred.iter().zip(&boxed)) {
        // At the border of the chip the blur mixes in darkness.
        if at.x < 6.0 || at.x > 601.0 {
            continue;
        }
        assert!((blurred.1 / sharp.1 - gauss).abs() < 1e-4, "{} instead of {gauss}", blurred.1 / sharp.1);
        assert!(wrap_rad(blurred.0 - sharp.0).abs() < 1e-4);
        assert!((boxed.1 / sharp.1 / (gauss * sinc) - 1.0).abs() < 2.0 * alias / gauss + 1e-3);
        assert!(wrap_rad(boxed.0 - sharp.0).abs() < 2.0 * alias / gauss + 1e-3);
    }
}

#[test]
fn a_sharp_chip_shows_steps() {
    let settings = TwinSettings { projector_pixels: true, projector_8bit: true, ..TwinSettings::ideal() };
    let twin = twin(&plate(), settings);
    let view = twin.view("cam1", 0).unwrap();
    let sequence = sine(Axis::X, 16.0);
    let columns = sequence[0].columns_u8(3, 608, None).unwrap();
    let mut renderer = twin.renderer("proj1", &sequence).unwrap();
    let lit = renderer.irradiance(&view, 3).unwrap().to_vec();
    let full = twin.renderer("proj1", &white()).unwrap().irradiance(&view, 0).unwrap().to_vec();
    let mut inside = 0;
    for index in 0..lit.len() {
        let Some(at) = view.truth_coordinate("proj1", index).unwrap() else { continue };
        // Within a table cell of a column's border the step is interpolated.
        if (at.x + 0.5 - (at.x + 0.5).round()).abs() > 1.0 / 64.0 {
            inside += 1;
            let expected = f32::from(columns[at.x.round() as usize]) / 255.0;
            assert!((lit[index] / full[index] - expected).abs() < 1e-5, "column {}", at.x);
        }
    }
    assert!(inside > 5000);
}

#[test]
fn gamma_and_leak_act_on_the_level() {
    let settings = TwinSettings { projector_gamma: 2.2, projector_leak: 0.01, ..TwinSettings::ideal() };
    let twin = twin(&plate(), settings);
    let view = twin.view("cam1", 0).unwrap();
    let ramp = [PatternSet::Ramp { axis: Some(Axis::X), levels: None }];
    let lit = twin.renderer("proj1", &ramp).unwrap().irradiance(&view, 0).unwrap().to_vec();
    let full = twin.renderer("proj1", &white()).unwrap().irradiance(&view, 0).unwrap().to_vec();
    for index in 0..lit.len() {
        if let Some(at) = view.truth_coordinate("proj1", index).unwrap() {
            let level = (at.x / 607.0).clamp(0.0, 1.0);
            let expected = 0.01 + 0.99 * fringe::math::pow(level, 2.2);
            assert!((f64::from(lit[index] / full[index]) - expected).abs() < 1e-6);
        }
    }
}

/// Pixels of cam1 on the top face of the first body, away from its edges.
fn inner(scene: &Scene, margin_mm: f64) -> Vec<usize> {
    let twin = twin(scene, TwinSettings::ideal());
    let on_face = |i: usize| {
        let pixel = Point2::new((i % 280) as f64, (i / 280) as f64);
        twin.truth_point("cam1", 0, pixel).unwrap().is_some_and(|p| {
            p.body == 0 && p.face == 2 && !scene.surface_distance(&p.part_mm).is_near_edge(margin_mm)
        })
    };
    (0..280 * 188).filter(|i| on_face(*i)).collect()
}

/// Many frames of the same pose: the seed of a cycle differs, the place does not.
#[test]
fn noise_has_the_variance_of_its_electrons() {
    let settings = TwinSettings {
        bits: 12,
        shot_noise: true,
        full_well_e: 8000.0,
        read_noise_e: 12.0,
        black_level: 0.02,
        ..TwinSettings::ideal()
    };
    let twin = twin(&plate(), settings.clone());
    let truth = {
        let view = twin.view("cam1", 0).unwrap();
        twin.renderer("proj1", &white()).unwrap().irradiance(&view, 0).unwrap().to_vec()
    };
    let mut renderer = twin.renderer("proj1", &white()).unwrap();
    let mut view = twin.view("cam1", 0).unwrap();
    let mut out = vec![0_u16; truth.len()];
    let repeats = 40;
    let (mut bright, mut dark) = ([0.0_f64; 3], [0.0_f64; 3]);
    for cycle in 0..repeats {
        twin.retrace(&mut view, cycle).unwrap();
        renderer.render(&view, 0, PixelsMut::Mono16(&mut out)).unwrap();
        for (dn, level) in out.iter().zip(&truth) {
            let level = f64::from(*level);
            let variance_e = level * 8000.0 + 144.0;
            let sigma_dn = (variance_e / 8000.0 / 8000.0 * 4095.0 * 4095.0 + 1.0 / 12.0).sqrt();
            let z = (f64::from(*dn) - level * 4095.0) / sigma_dn;
            let sums = if level > 0.1 { &mut bright } else { &mut dark };
            [1.0, z, z * z].iter().zip(sums).for_each(|(v, s)| *s += v);
        }
    }
    for (name, [count, sum, squares]) in [("bright", bright), ("dark", dark)] {
        assert!(count > 200_000.0, "{name}: {count} samples");
        let unit = 5.0 / count.sqrt();
        assert!((sum / count).abs() < unit, "{name}: mean {}", sum / count);
        assert!((squares / count - 1.0).abs() < 1.42 * unit, "{name}: variance {}", squares / count);
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads_and_another_seed_others() {
    let scene = artefact();
    let in_pool = |threads: usize, seed: u64| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| frame_u8(&twin(&scene, TwinSettings { seed, ..TwinSettings::default() }), "cam2", 4))
    };
    let one = in_pool(1, 7);
    assert!(one == in_pool(4, 7));
    assert!(one == in_pool(3, 7));
    assert!(one != in_pool(1, 8));
}

#[test]
fn a_frame_does_not_depend_on_what_was_rendered_before() {
    let twin = twin(&artefact(), TwinSettings::default());
    let view = twin.view("cam1", 2).unwrap();
    let sequence = thesis::sequence();
    let mut renderer = twin.renderer("proj1", &sequence).unwrap();
    let len = (view.width_px() * view.height_px()) as usize;
    let mut all = vec![vec![0_u8; len]; renderer.frames()];
    for (frame, out) in all.iter_mut().enumerate() {
        renderer.render(&view, frame, PixelsMut::Mono8(out)).unwrap();
    }
    // A view that has been elsewhere, traced with one projector only, one frame alone.
    let mut other = twin.view_lit_by("cam1", &["proj1"], 0).unwrap();
    twin.retrace(&mut other, 2).unwrap();
    let mut out = vec![0_u8; len];
    for frame in [18, 0, 12] {
        other.render("proj1", &sequence, frame, PixelsMut::Mono8(&mut out)).unwrap();
        assert!(out == all[frame], "frame {frame}");
    }
    assert!(all[0] != all[1]);
}

#[test]
fn white_nylon_fills_the_range_without_saturating_and_saturates_when_over_exposed() {
    let count = |settings: TwinSettings| {
        let frame = frame_u8(&twin(&artefact(), settings), "cam1", 17);
        let mut sorted = frame;
        sorted.sort_unstable();
        let full = sorted.len() - sorted.partition_point(|v| *v < 255);
        (f64::from(sorted[sorted.len() * 999 / 1000]) / 255.0, full)
    };
    let (bright, full) = count(TwinSettings::default());
    assert!((0.7..0.85).contains(&bright) && full == 0, "brightest per mille {bright}, saturated {full}");
    let (_, full) = count(TwinSettings { exposure: 3.0, ..TwinSettings::default() });
    assert!(full > 2000, "{full} saturated");
    let (dark, _) = count(TwinSettings { exposure: 0.0, black_level: 0.0, ..TwinSettings::ideal_8bit() });
    assert_eq!(dark, 0.0);
}

trait Ideal8 {
    fn ideal_8bit() -> TwinSettings;
}

impl Ideal8 for TwinSettings {
    fn ideal_8bit() -> TwinSettings {
        TwinSettings { bits: 8, ..TwinSettings::ideal() }
    }
}

/// The first-order model of vibration against the part really moved.
#[test]
fn vibration_equals_moving_the_part() {
    let settings = TwinSettings { vibration_um: 20.0, ..TwinSettings::ideal() };
    let at = |offset: [f64; 3]| {
        let plate = r#"{ shape = "plane", size_mm = [110.0, 110.0], thickness_mm = 5.0 }"#;
        scene(&(body("plate", offset, plate) + "rotation_deg = [10.0, 25.0, 0.0]\n"))
    };
    let rest = twin(&at([0.0; 3]), TwinSettings::ideal());
    let shaking = twin(&at([0.0; 3]), settings.clone());
    let sequence = sine(Axis::X, 16.0);
    for frame in [0, 3] {
        let shift_mm = pose::vibration_mm(&settings, &Normal::default(), 0, 0, frame);
        let moved = twin(&at(shift_mm.into()), TwinSettings::ideal());
        let image = |twin: &Twin| {
            let view = twin.view("cam1", 0).unwrap();
            twin.renderer("proj1", &sequence).unwrap().irradiance(&view, frame).unwrap().to_vec()
        };
        let inner = inner(&at([0.0; 3]), 1.0);
        let (rest, shaken, moved) = (image(&rest), image(&shaking), image(&moved));
        let pairs: Vec<_> = inner.iter().map(|i| (rest[*i], shaken[*i], moved[*i])).collect();
        let rms = |f: &dyn Fn(f32, f32, f32) -> f32| {
            let sum: f64 = pairs.iter().map(|(r, s, m)| f64::from(f(*r, *s, *m)).powi(2)).sum();
            (sum / pairs.len() as f64).sqrt()
        };
        let effect = rms(&|r, _, m| m - r);
        let error = rms(&|_, s, m| m - s);
        assert!(pairs.len() > 2000 && effect > 1e-4, "{} pixels, effect {effect}", pairs.len());
        // What stays is the light's falloff and the second order.
        assert!(error < 0.05 * effect, "frame {frame}: {error} of {effect}");
    }
}

#[test]
fn many_rays_per_pixel_and_the_footprint_kernel_agree_on_smooth_faces() {
    let base = TwinSettings::ideal();
    let image = |settings: TwinSettings| {
        let twin = twin(&plate(), settings);
        let view = twin.view("cam1", 0).unwrap();
        // As many camera pixels per fringe as the full camera has of the demo's fringes.
        twin.renderer("proj1", &sine(Axis::X, 64.0)).unwrap().irradiance(&view, 0).unwrap().to_vec()
    };
    let point = image(base.clone());
    let kernel = image(TwinSettings { pixel_footprint: true, ..base.clone() });
    let rays = image(TwinSettings { subsamples: 6, pixel_footprint: true, ..base });
    let inner = inner(&plate(), 5.0);
    let power = |a: &[f32], b: &[f32]| inner.iter().map(|i| f64::from(a[*i] - b[*i]).powi(2)).sum::<f64>();
    let (effect, error) = (power(&rays, &point), power(&rays, &kernel));
    assert!(inner.len() > 4000, "{} pixels", inner.len());
    assert!(error < 0.02 * effect, "error {error}, effect {effect}");
}

/// The edges of a print do not come in the steps of the rays: four a pixel give the picture of 144.
#[test]
fn the_edges_of_a_print_do_not_depend_on_the_number_of_rays() {
    let board = r#"{ shape = "plane", size_mm = [160.0, 160.0], thickness_mm = 5.0, checkerboard = { columns = 8, rows = 6, pitch_mm = 9.0, dark = 0.1 } }"#;
    let board = scene(&body("board", [0.0, 0.0, 15.0], board));
    let image = |subsamples: u32| {
        let twin = twin(&board, TwinSettings { subsamples, ..TwinSettings::ideal() });
        let view = twin.view_lit_by("cam1", &["proj1"], 0).unwrap();
        twin.renderer("proj1", &white()).unwrap().irradiance(&view, 0).unwrap().to_vec()
    };
    let (few, many) = (image(2), image(12));
    let inner = inner(&board, 5.0);
    let white = inner.iter().map(|i| many[*i]).fold(0.0, f32::max);
    let off = inner.iter().map(|i| (few[*i] - many[*i]).abs()).fold(0.0, f32::max);
    let mixed = inner.iter().filter(|i| (0.2..0.8).contains(&(many[**i] / white))).count();
    assert!(inner.len() > 4000 && mixed > 300, "{} pixels, {mixed} on edges", inner.len());
    assert!(off < 1e-3 * white, "{off} of {white}");
}

#[test]
fn buffers_and_frames_that_do_not_fit_are_refused() {
    let rig: Rig = small_rig();
    let twin = Twin::new(&plate(), TwinSettings::default(), &rig).unwrap();
    let view = twin.view_lit_by("cam1", &["proj1"], 0).unwrap();
    let sequence = thesis::sequence();
    let mut small = vec![0_u8; 10];
    let error = view.render("proj1", &sequence, 0, PixelsMut::Mono8(&mut small)).unwrap_err();
    assert_eq!(error.to_string(), "the buffer holds 10 8-bit pixels, the frame needs 52640 8-bit pixels");
    let mut wide = vec![0_u16; 280 * 188];
    assert!(matches!(
        view.render("proj1", &sequence, 0, PixelsMut::Mono16(&mut wide)),
        Err(TwinError::Buffer { .. })
    ));
    let mut out = vec![0_u8; 280 * 188];
    let error = view.render("proj1", &sequence, 19, PixelsMut::Mono8(&mut out)).unwrap_err();
    assert_eq!(error, TwinError::Frame { projector: "proj1".into(), frame: 19, count: 19 });
    assert!(matches!(
        view.render("proj2", &sequence, 0, PixelsMut::Mono8(&mut out)),
        Err(TwinError::Unknown { kind: "traced projector", .. })
    ));
    let random = [PatternSet::Random { frames: 2 }];
    assert!(matches!(twin.renderer("proj1", &random), Err(TwinError::Pattern { frame: 0, .. })));
}
