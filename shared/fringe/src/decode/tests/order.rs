//! The fringe order: codes, several periods, neighbours.

use super::*;

#[test]
fn half_period_stripes_reconcile_with_the_phase_at_every_hundredth_of_a_pixel() {
    for settle in [true, false] {
        let scene = Scene::ramp(608, 100, 1.0, 0.01, 608);
        let scene = if settle { scene } else { scene.eight_bits() };
        let (map, report) = scene.decode(&demo(8.0, 7), Axis::X);
        let (worst, count) = scene.worst_px(&map);
        assert_eq!((count, report.ambiguous, report.spikes_repaired), (608 * 100, 0, 0), "{report:?}");
        assert!(worst < if settle { 1e-4 } else { 0.02 }, "{worst}");
    }
}

#[test]
fn whole_period_stripes_are_settled_by_neighbours() {
    let scene = Scene::ramp(607, 100, 1.0, 0.01, 608);
    let (map, report) = scene.decode(&demo(16.0, 6), Axis::X);
    let (worst, count) = scene.worst_px(&map);
    assert!(report.ambiguous > 0);
    assert_eq!(report.resolved, report.ambiguous);
    assert_eq!(count, 607 * 100, "{report:?}");
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn whole_period_stripes_make_no_jump_in_noise() {
    // Half a projector pixel per camera pixel, grey values blurred by noise: bits near the edges are undecided.
    let mut scene = Scene::ramp(1200, 60, 0.5, 0.037, 608).eight_bits();
    scene.noise = (2.0, 0.02);
    let (map, report) = scene.decode(&demo(16.0, 6), Axis::X);
    let (worst, count) = scene.worst_px(&map);
    assert!(worst < 1.0, "{worst}");
    assert!(count as f64 > 0.999 * 72_000.0, "{report:?}");
}

#[test]
fn every_threshold_and_code_gives_the_same_coordinates() {
    let set = |invert, code, threshold| PatternSet::Gray {
        axis: Axis::Y,
        bits: 7,
        stripe_px: 8.0,
        shift_px: 0.0,
        invert,
        code,
        threshold,
    };
    let fringes = sine(Axis::Y, 16.0, 5);
    let (white, black) = (PatternSet::White {}, PatternSet::Black {});
    let sequences = [
        vec![white.clone(), black.clone(), set(false, Code::Gray, None), fringes.clone()],
        vec![fringes.clone(), set(false, Code::Binary, None), white.clone(), black.clone()],
        vec![set(true, Code::Gray, Some(Threshold::SineMean)), fringes.clone()],
        vec![fringes.clone(), set(false, Code::Binary, None)],
        vec![set(false, Code::Gray, None), fringes.clone(), set(true, Code::Gray, None)],
        vec![
            set(true, Code::Gray, None),
            white,
            black,
            set(false, Code::Gray, Some(Threshold::WhiteBlack)),
            fringes,
        ],
    ];
    for (i, sequence) in sequences.iter().enumerate() {
        let scene = Scene::ramp(600, 7, 1.0, 0.31, 608).eight_bits();
        let (map, report) = scene.decode(sequence, Axis::Y);
        let (worst, count) = scene.worst_px(&map);
        assert_eq!(count, 600 * 7, "sequence {i}: {report:?}");
        assert!(worst < 0.03, "sequence {i}: {worst}");
    }
}

#[test]
fn heterodyne_periods_number_the_whole_projector() {
    let sequence = [sine(Axis::X, 28.0, 12), sine(Axis::X, 24.0, 12), sine(Axis::X, 26.0, 12)];
    let mut scene = Scene::ramp(1280, 40, 1.0, 0.025, 1280).eight_bits();
    scene.coordinates_px.iter_mut().for_each(|x| *x -= 0.5);
    scene.noise = (1.0, 0.01);
    let (map, report) = scene.decode(&sequence, Axis::X);
    let (worst, count) = scene.worst_px(&map);
    assert_eq!(map.info.period_px, 24.0);
    assert!(worst < 0.5, "{worst}");
    assert!(count >= 1280 * 40 - 5, "{report:?}");
}

#[test]
fn a_unit_period_leads_down_the_hierarchy_even_at_the_edges_of_the_projector() {
    // As SLStudio projects: 3 steps each, one period over 1824 columns, then 16.
    let sequence = [sine(Axis::X, 114.0, 3), sine(Axis::X, 1824.0, 3)];
    let mut scene = Scene::ramp(1824, 8, 1.0, 0.1, 1824).eight_bits();
    scene.noise = (1.0, 0.0);
    let (map, report) = scene.decode(&sequence, Axis::X);
    let (worst, count) = scene.worst_px(&map);
    assert!(worst < 3.0, "{worst}");
    assert!(count > 1820 * 8 - 100, "{report:?}");
    // Three steps leave no residual: neighbouring pixels give the noise, rounding included.
    let sigma_dn = (report.noise.read_variance_dn2 + report.noise.gain_dn * 110.0).sqrt();
    assert!(matches!(report.noise.source, NoiseSource::Estimated { .. }), "{report:?}");
    assert!((sigma_dn / (1.0_f64 + 1.0 / 12.0).sqrt() - 1.0).abs() < 0.05, "{report:?}");
}

#[test]
fn one_period_over_the_projector_is_absolute() {
    let scene = Scene::ramp(608, 3, 1.0, 0.2, 608);
    let camera_noise = Some(CameraNoise { read_noise_dn: 0.3, gain_dn: 0.0 });
    let settings = DecodeSettings { camera_noise, ..DecodeSettings::default() };
    let sequence = [sine(Axis::X, 608.0, 4)];
    let (map, _) = scene.decode_frames(&sequence, &scene.frames(&sequence), Axis::X, &settings);
    for (valid, x) in map.valid.iter().zip(&scene.coordinates_px) {
        // Half a column from the projector's edge the other edge may be meant as well: proof takes two neighbours.
        assert!(*valid == 1 || *x >= 607.0, "{x}");
    }
    assert!(scene.worst_px(&map).0 < 0.01);
}

#[test]
fn a_code_alone_is_read_between_the_edges_of_its_stripes() {
    // Pixels that are points find an edge within half a pixel; the centre of a stripe is off by half a stripe.
    for (bits, stripe_px, per_pixel_px, most_px) in [(10, 2.0, 1.0, 0.5), (8, 8.0, 0.7, 0.4)] {
        let sequence = [PatternSet::White {}, PatternSet::Black {}, gray(Axis::X, bits, stripe_px)];
        let scene = Scene::ramp(1824, 12, per_pixel_px, 0.13, 1824).eight_bits();
        let (map, report) = scene.decode(&sequence, Axis::X);
        assert_eq!((map.info.period_px, report.valid), (stripe_px, 1824 * 12));
        let scale = stripe_px / std::f64::consts::TAU;
        // Before the first edge and behind the last one there is one line of edges only: the centre of the stripe stands.
        let last = scene.coordinates_px.iter().copied().fold(0.0, f64::max);
        for (x, phase) in scene.coordinates_px.iter().zip(&map.phase_rad) {
            let inside = *x > 2.0 * stripe_px && *x < last - 2.0 * stripe_px;
            let error_px = (f64::from(*phase) * scale - x).abs();
            assert!(error_px <= if inside { most_px } else { 0.5 * stripe_px + most_px }, "{x}: {error_px}");
        }
        let uniform = (std::f64::consts::TAU / 12.0_f64.sqrt()) as f32;
        let quieter = map.sigma_rad.iter().filter(|s| **s < 0.5 * uniform).count();
        assert!(quieter > 1790 * 12, "{quieter}");
    }
}

#[test]
fn both_axes_are_decoded_apart() {
    let (x, y) = (Axis::X, Axis::Y);
    let mut sequence = demo(8.0, 7);
    sequence.extend([sine(y, 32.0, 4), gray(y, 6, 16.0), PatternSet::Random { frames: 2 }]);
    let scene = Scene::ramp(600, 4, 1.0, 0.2, 608);
    let decoder = scene.decoder(&sequence, &DecodeSettings::default()).unwrap();
    assert_eq!(decoder.axes(), [x, y]);
    let (map_x, report_x) = scene.decode(&sequence, x);
    let (map_y, report_y) = scene.decode(&sequence, y);
    assert_eq!((map_x.info.period_px, map_y.info.period_px), (16.0, 32.0));
    assert!(scene.worst_px(&map_x).0 < 1e-3 && scene.worst_px(&map_y).0 < 1e-3);
    assert_eq!(report_x.ignored.iter().collect::<Vec<_>>(), ["set 7 (\"random\")"]);
    assert!(report_y.ignored.is_empty());
}

#[test]
fn a_wrong_bit_is_repaired_only_where_the_neighbours_prove_it() {
    let scene = Scene::ramp(400, 40, 0.5, 0.1, 608);
    let sequence = demo(8.0, 7);
    let mut frames = scene.frames(&sequence);
    let alone = 20 * 400 + 200;
    // The second bit of one pixel is turned: its order is off by many periods.
    for pixel in [alone, 5 * 400] {
        if let PixelBuffer::Mono16(values) = &mut frames[11].pixels {
            values[pixel] = if values[pixel] > 30_000 { 6000 } else { 56_000 };
        }
    }
    let (map, report) = scene.decode_frames(&sequence, &frames, Axis::X, &DecodeSettings::default());
    assert_eq!(report.spikes_repaired, 1, "{report:?}");
    let x = |i: usize| f64::from(map.phase_rad[i]) * 16.0 / std::f64::consts::TAU;
    assert!((x(alone) - scene.coordinates_px[alone]).abs() < 1e-3);
    // At the border of the image there are too few neighbours for a proof: nothing is touched.
    assert!((x(5 * 400) - scene.coordinates_px[5 * 400]).abs() > 8.0);
}

#[test]
fn real_steps_in_depth_are_left_alone() {
    // A plateau that is exactly two periods higher, a thin bar of one pixel, and a step of 1.3 periods.
    let mut scene = Scene::ramp(300, 60, 0.5, 0.0, 608);
    for (i, x) in scene.coordinates_px.iter_mut().enumerate() {
        let (row, column) = (i / 300, i % 300);
        *x += 100.0;
        if (10..30).contains(&row) && (50..120).contains(&column) {
            *x += 32.0;
        } else if column == 200 {
            *x += 16.0;
        } else if row > 45 {
            *x -= 20.8;
        }
    }
    for sequence in [demo(8.0, 7), demo(16.0, 6)] {
        let (map, report) = scene.decode(&sequence, Axis::X);
        assert!(scene.worst_px(&map).0 < 1e-3, "{report:?}");
        assert_eq!((report.spikes_repaired, report.spikes_masked), (0, 0));
    }
    let (_, report) = scene.decode(&demo(8.0, 7), Axis::X);
    assert_eq!(report.valid, 300 * 60);
}

#[test]
fn an_order_beyond_eight_bits_is_kept() {
    let sequence =
        [sine(Axis::X, 4.0, 4), gray(Axis::X, 12, 2.0), PatternSet::White {}, PatternSet::Black {}];
    let scene = Scene::ramp(4096, 2, 1.0, 0.3, 4096);
    let (map, report) = scene.decode(&sequence, Axis::X);
    assert_eq!(report.valid, 4096 * 2);
    assert!(scene.worst_px(&map).0 < 1e-3);
}
