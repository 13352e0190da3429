//! What fusion says where pairs agree, where they do not, and of input that is no measurement.

use super::super::tests::{patch, plane, sphere};
use super::super::*;

fn fused(clouds: &[&[Point]]) -> (FusionReport, Vec<Point>) {
    let mut out = Vec::new();
    let report = fuse(clouds, &FusionSettings::default(), &mut out);
    (report, out)
}

fn bytes(points: &[Point]) -> &[u8] {
    bytemuck::cast_slice(points)
}

/// All but the uncertainty.
fn unraised(points: &[Point]) -> Vec<Point> {
    points.iter().map(|point| Point { sigma_mm: 0.0, shared_mm: 0.0, ..*point }).collect()
}

/// A plane with a raised place of 8 × 10 mm in it.
fn raised_place(height_mm: f64) -> impl Fn(f64, f64) -> (f64, [f64; 3]) {
    move |x, y| plane(if (0.0..8.0).contains(&x) && y.abs() < 5.0 { height_mm } else { 0.0 })(x, y)
}

/// Proves: where pairs disagree, the points of both state what they differ by, whichever is wrong; nowhere else, and points that went
/// out before do not shift who is meant. On the slope many cells hold points of one pair only.
#[test]
fn where_pairs_disagree_their_points_say_so() {
    let (sigma, height) = (0.01, 0.05);
    let mut a = patch(plane(0.0), 0.0, sigma, 1);
    let stray = Point { position_mm: [0.0, 0.0, 20.0], ..a[0] };
    a.splice(3000..3000, [stray; 3]);
    let b = patch(raised_place(height), 0.07, sigma, 2);
    let mut out = Vec::new();
    let report = fuse(&[&a, &b], &FusionSettings::default(), &mut out);
    assert_eq!((report.removed.as_slice(), out.len()), ([3, 0].as_slice(), 20_000));
    let raised = out.iter().filter(|p| f64::from(p.sigma_mm) > 1.001 * sigma).count();
    assert_eq!(report.disagreeing as usize, raised);
    // What was added is what they may have in common.
    assert!(out.iter().all(|p| {
        let noise = f64::from(p.sigma_mm).powi(2) - f64::from(p.shared_mm).powi(2);
        (noise.sqrt() / sigma - 1.0).abs() < 1e-4
    }));
    let warning = disagreement_warning(report.disagreeing, report.points).unwrap();
    let share = 100.0 * raised as f64 / 20_000.0;
    assert!(warning.contains(&format!("at {share:.0} % of the points")), "{warning}");
    assert_eq!(disagreement_warning(199, 20_000), None);
    let (mut stated, mut error, mut count) = (0.0, 0.0, 0.0);
    for (number, point) in out.iter().enumerate() {
        let [x, y, z] = point.position_mm;
        let inwards = x.min(8.0 - x).min(5.0 - y.abs());
        // Cells at the rim see both.
        if inwards < -1.3 {
            assert_eq!(point.sigma_mm, sigma as f32, "{number}: {x} {y}");
        }
        if inwards > 1.3 {
            let off = (z - 0.3 * x + 0.1 * y) / f64::sqrt(1.1);
            let s = f64::from(point.sigma_mm);
            (stated, error, count) = (stated + s * s, error + off * off, count + 1.0);
            assert!(s > 1.5 * sigma, "{number}: {x} {y} {s}");
        }
    }
    assert!(count > 1500.0 && (0.9..1.1).contains(&f64::sqrt(stated / error)), "{stated} {error}");
}

/// Proves: noise alone is no disagreement, on flat faces and round ones, nor is what a single pair shows, or pairs that see other places:
/// the points keep their bytes.
#[test]
fn pairs_that_agree_and_single_ones_keep_their_bytes() {
    for seed in 0..5 {
        for sigma in [0.002, 0.01, 0.03] {
            for (a, b) in [
                (patch(plane(0.0), 0.0, sigma, 10 + seed), patch(plane(0.0), 0.07, sigma, 20 + seed)),
                (patch(sphere(20.0), 0.0, sigma, 30 + seed), patch(sphere(20.0), 0.07, sigma, 40 + seed)),
            ] {
                let (report, out) = fused(&[&a, &b]);
                assert!(report.overlaps[0].count > 9000, "{report:?}");
                assert_eq!((report.disagreeing, bytes(&out)), (0, bytes(&[a, b].concat())));
            }
        }
    }
    // Ten times rougher than stated, but nobody contradicts.
    let stated = |point: &Point| Point { sigma_mm: 0.001, ..*point };
    let [rough, beside] = [0.0, 25.0].map(|shift| patch(plane(0.0), shift, 0.01, 3));
    let rough: Vec<Point> = rough.iter().map(stated).collect();
    let (report, out) = fused(&[&rough]);
    assert_eq!((report.disagreeing, bytes(&out)), (0, bytes(&rough)));
    let (report, out) = fused(&[&rough, &beside]);
    assert_eq!((report.disagreeing, bytes(&out)), (0, bytes(&[rough, beside].concat())));
}

/// Proves: a pair whose order is wrong, so that its surface lies beyond the radius, is not compared and changes nothing of the other's; one
/// within the radius is, and both state it.
#[test]
fn a_wrong_order_is_far_away_or_stated() {
    let sigma = 0.01;
    let a = patch(plane(0.0), 0.0, sigma, 1);
    for depth in [3.0, -40.0, 1e6] {
        let b = patch(plane(depth), 0.07, sigma, 2);
        let (report, out) = fused(&[&a, &b]);
        assert_eq!((report.disagreeing, bytes(&out)), (0, bytes(&[a.clone(), b].concat())), "{depth} mm");
    }
    let near = patch(plane(0.3), 0.07, sigma, 2);
    let (report, out) = fused(&[&a, &near]);
    let wanted = 0.3 / f64::sqrt(2.0);
    let told = out.iter().filter(|p| (f64::from(p.sigma_mm) / wanted - 1.0).abs() < 0.1).count();
    // At the rim of a patch nothing is beside a point.
    assert!(told > 19_000 && report.disagreeing as usize >= told, "{told}, {report:?}");
    assert_eq!(unraised(&out), unraised(&[a, near].concat()));
}

/// Proves: of several clouds, of which not all cells are looked at, the points of those that disagree are raised all the same.
#[test]
fn cells_that_are_not_looked_at_are_judged_by_those_around() {
    let sigma = 0.01;
    let clouds: Vec<Vec<Point>> = [0.0, 0.0, 0.05, 0.0]
        .iter()
        .zip(1..)
        .map(|(height, seed)| patch(raised_place(*height), 0.03 * f64::from(seed as u8), sigma, seed))
        .collect();
    let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let (report, out) = fused(&slices);
    assert_eq!((unraised(&out), report.points), (unraised(&clouds.concat()), 40_000));
    for (cloud, points) in out.chunks(10_000).enumerate() {
        let (mut inside, mut told) = (0, 0);
        for point in points {
            let [x, y, _] = point.position_mm;
            let (inwards, s) = (x.min(8.0 - x).min(5.0 - y.abs()), f64::from(point.sigma_mm));
            inside += u32::from(inwards > 1.3);
            told += u32::from(inwards > 1.3 && s > 1.5 * sigma);
            assert!(inwards > -1.9 || point.sigma_mm == sigma as f32, "{cloud}: {x} {y} {s}");
        }
        // A block in which few points were looked at says nothing.
        assert!(inside > 900 && f64::from(told) > 0.97 * f64::from(inside), "{cloud}: {told} of {inside}");
    }
}

/// Proves: points that are no numbers, state nothing or state infinity neither hide a disagreement nor make one, and cause no fault; the
/// points are the same on any number of threads.
#[test]
fn what_is_no_uncertainty_is_not_compared() {
    let sigma = 0.01;
    let (mut a, b) = (patch(plane(0.0), 0.0, sigma, 1), patch(raised_place(0.05), 0.07, sigma, 2));
    let strange = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 0.0, -0.01];
    for (point, place) in a.iter_mut().zip(0..) {
        match place % 97 {
            0 => point.sigma_mm = strange[place / 97 % strange.len()],
            1 => point.normal = [f32::NAN; 3],
            2 => point.position_mm[place % 3] = [f64::NAN, f64::INFINITY, 1e300][place / 97 % 3],
            _ => {}
        }
    }
    let mut seen: Option<(u32, Vec<Point>)> = None;
    for threads in [1, 2, 3, 7] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let settings = FusionSettings { radius_mm: Some(0.6), ..FusionSettings::default() };
        let mut out = Vec::new();
        let report = pool.install(|| fuse(&[&a, &b], &settings, &mut out));
        let first = seen.get_or_insert_with(|| (report.disagreeing, out.clone()));
        assert_eq!((first.0, bytes(&first.1)), (report.disagreeing, bytes(&out)), "{threads} threads");
    }
    let (_, out) = seen.unwrap();
    let inside = |p: &&Point| (2.0..6.0).contains(&p.position_mm[0]) && p.position_mm[1].abs() < 3.0;
    let told = out.iter().filter(inside).filter(|p| p.sigma_mm > 0.015 && p.sigma_mm < 0.1).count();
    let all = out.iter().filter(inside).count();
    assert!(all > 1000 && told as f64 > 0.98 * all as f64, "{told} of {all}");
    let nothing: Vec<Point> =
        b.iter().map(|point| Point { sigma_mm: 0.0, shared_mm: 0.0, ..*point }).collect();
    let flat = unraised(&patch(plane(0.0), 0.0, 0.0, 1));
    let (report, out) = fused(&[&flat, &nothing]);
    assert_eq!((report.disagreeing, bytes(&out)), (0, bytes(&[flat, nothing].concat())));
    for settings in [f64::MAX, f64::MIN_POSITIVE]
        .map(|radius| FusionSettings { radius_mm: Some(radius), ..FusionSettings::default() })
    {
        let (few, other) = (&a[..300], &b[..300]);
        fuse(&[few, other, few], &settings, &mut Vec::new());
    }
}

/// A patch whose neighbours share noise, as smoothing over 5 × 5 points makes them.
fn smoothed(f: impl Fn(f64, f64) -> (f64, [f64; 3]), shift: f64, sigma_mm: f64, seed: u64) -> Vec<Point> {
    let mut noise = crate::synthetic::Noise(seed);
    let grid: Vec<f64> = (0..104 * 104).map(|_| noise.gauss()).collect();
    let window =
        |i: usize| (0..25).map(|k| grid[(i / 100 + k / 5) * 104 + i % 100 + k % 5]).sum::<f64>() / 5.0;
    let mut points = patch(f, shift, 0.0, 0);
    for (i, point) in points.iter_mut().enumerate() {
        for (place, normal) in point.position_mm.iter_mut().zip(point.normal) {
            *place += sigma_mm * window(i) * f64::from(normal);
        }
        point.sigma_mm = sigma_mm as f32;
    }
    points
}

/// Proves: where noise that neighbours share exceeds what is stated of a block, its neighbourhood does not confirm it, while a light that
/// moves the points of a wider place by more than three standard deviations is found.
#[test]
fn what_reaches_further_than_shared_noise_is_told_from_it() {
    let sigma = 0.01;
    let (mut false_alarms, mut wrong, mut told) = (0, 0, 0);
    for seed in 0..6 {
        let a = smoothed(plane(0.0), 0.0, sigma, 10 + seed);
        let (report, _) = fused(&[&a, &smoothed(plane(0.0), 0.07, sigma, 20 + seed)]);
        false_alarms += report.disagreeing;
        // Rises from nothing to six standard deviations and falls again, over 8 mm.
        let height = |x: f64| 6.0 * sigma * (1.0 - x.abs() / 4.0).max(0.0);
        let lit = |x: f64, y: f64| plane(height(x))(x, y);
        let (_, out) = fused(&[&a, &smoothed(lit, 0.07, sigma, 20 + seed)]);
        for point in out[a.len()..].iter().filter(|p| height(p.position_mm[0]) > 3.0 * sigma) {
            wrong += 1;
            told += u32::from(f64::from(point.sigma_mm) > 1.1 * sigma);
        }
    }
    // Blocks alone: 4.9 %.
    assert!(false_alarms < 120_000 / 40, "{false_alarms}");
    assert!(f64::from(told) > 0.95 * f64::from(wrong), "{told} of {wrong}");
}

/// Proves: where not all cells are looked at, so that fewer distances are independent, noise is no disagreement any more often (with the limits for
/// all cells 7.9 %).
#[test]
fn noise_of_many_pairs_is_no_disagreement() {
    let (mut told, mut all) = (0, 0);
    for seed in 0..4 {
        let clouds: Vec<Vec<Point>> = (1..=4_u8)
            .map(|n| smoothed(plane(0.0), 0.03 * f64::from(n), 0.01, 10 * seed + u64::from(n)))
            .collect();
        let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
        let mut fuser = Fuser::of_pictures((0..4).map(|cloud| vec![cloud]).collect());
        told += fuser.fuse(&slices, &FusionSettings::default(), &mut Vec::new()).disagreeing;
        all += 40_000;
    }
    assert!(told < all / 40, "{told} of {all}");
}

/// Proves: pairs that share a camera, whose noise moves them in opposite directions, do not disagree by that, and a place that is raised by six
/// standard deviations is told beside such noise.
#[test]
fn opposite_noise_of_pairs_that_share_a_camera_is_no_disagreement() {
    let sigma = 0.01;
    // Half of the variance by either camera.
    let pair = |f: &dyn Fn(f64, f64) -> (f64, [f64; 3]), shift: f64, (shared, sign): (u64, f64), own: u64| {
        let by = |sigma_mm: f64, seed: u64| smoothed(f, shift, sigma_mm * f64::sqrt(2.0), seed);
        let (mut points, other) = (by(sign * sigma, shared), by(sigma, own));
        for (point, other) in points.iter_mut().zip(other) {
            point.position_mm = nalgebra::center(&point.position(), &other.position()).into();
            point.sigma_mm = sigma as f32;
        }
        points
    };
    let fused_of = |clouds: &[&[Point]], pictures: [Vec<usize>; 2]| {
        let mut fuser = Fuser::of_pictures(pictures.into());
        fuser.fuse(clouds, &FusionSettings::default(), &mut Vec::new()).disagreeing
    };
    let (mut told, mut all, mut unasked) = (0, 0, 0);
    for seed in 0..8 {
        let [shared, own, third] = [0, 100, 200].map(|first| first + seed);
        let first = pair(&plane(0.0), 0.0, (shared, 1.0), own);
        let second = pair(&plane(0.0), 0.07, (shared, -1.0), third);
        let (report, out) = fused(&[&first, &second]);
        (told, all) = (told + report.disagreeing, all + out.len());
        // Said to share a picture, they are asked as those of which nothing is known; said to share none, nothing is allowed for them.
        assert_eq!(fused_of(&[&first, &second], [vec![4, 7], vec![9, 7]]), report.disagreeing);
        unasked += fused_of(&[&first, &second], [vec![4, 7], vec![9, 5]]);
        let (_, out) = fused(&[&first, &pair(&raised_place(6.0 * sigma), 0.07, (shared, -1.0), third)]);
        let inside: Vec<&Point> = out
            .iter()
            .filter(|p| (1.5..6.5).contains(&p.position_mm[0]) && p.position_mm[1].abs() < 3.5)
            .collect();
        let raised = inside.iter().filter(|p| p.shared_mm > 0.0).count();
        assert!(raised as f64 > 0.9 * inside.len() as f64, "seed {seed}: {raised} of {}", inside.len());
    }
    // A feature takes 5 % as noise; with the thresholds of pairs that share no camera there are 11 %.
    assert!(f64::from(told) < 0.05 * all as f64, "{told} of {all} points");
    assert!(f64::from(unasked) > 0.1 * all as f64, "{unasked} of {all} points");
}
