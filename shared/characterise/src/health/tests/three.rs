//! Places that two fixed views measure together: what they add, what they state, and when they are left out.

use super::*;

/// Matches of two cameras with the projector's pixel of each place, all with the same noise.
fn lit_matches(views: [&Camera; 3], sigma_px: f64, noise: &mut Noise, count: usize) -> Vec<Match> {
    let [left, right, projector] = views;
    let mut place = |half: f64| (2.0 * noise.unit() - 1.0) * half;
    let points: Vec<Point3<f64>> =
        (0..count).map(|_| Point3::new(place(70.0), place(45.0), place(40.0))).collect();
    let seen =
        points.iter().filter_map(|p| Some([left.project(p)?, right.project(p)?, projector.project(p)?]));
    let covariance_px2 = Matrix2::identity() * sigma_px * sigma_px;
    let mut off = || Vector2::new(noise.gauss(), noise.gauss()) * sigma_px;
    seen.map(|[left, right, lit]| {
        let own = off();
        // As a window of the left view measures the projector's pixel, and finds its place in the right view by it: a pixel of one is one of the other.
        Match {
            left,
            right: right + own + off(),
            covariance_px2: covariance_px2 * 2.0,
            lit: Some(Lit { pixel: lit + own, covariance_px2, with_right_px2: covariance_px2 }),
        }
    })
    .collect()
}

/// The view under one projector with its partner, and with the projector itself.
fn partners<'a>(
    [left, projector]: [&'a Camera; 2],
    matches: &'a [Vec<Match>; 2],
    lit: bool,
) -> [Partner<'a>; 2] {
    let lit_by = lit.then_some((projector, 1));
    [
        Partner { fixed: left, device: 0, matches: &matches[0], lit_by, measures: true },
        Partner { fixed: projector, device: 1, matches: &matches[1], lit_by: None, measures: false },
    ]
}

const DRIFT: [f64; 7] = [0.0, 1.7e-4, 0.0, 0.05, 0.0, 0.0, 2e-4];

/// The estimate scatters as it states, and far less than that of the pairs alone.
#[test]
fn places_fix_what_pairs_leave_open_and_scatter_as_stated() {
    let [left, right, projector] = rig(1124, 750);
    let drifted = stepped(&right, &DRIFT);
    let (mut noise, rounds) = (Noise(41), 16);
    let (mut chi2, mut own, mut lower) = (0.0, 0.0, 0.0);
    for _ in 0..rounds {
        let seen = [
            lit_matches([&left, &drifted, &projector], 0.02, &mut noise, 500),
            matches(&projector, &drifted, 0.02, &mut noise, 500),
        ];
        let [with, without] = [true, false].map(|lit| {
            estimate_view(&right, &partners([&left, &projector], &seen, lit), None, &EXACT_PHASE).unwrap()
        });
        assert!(without.three_views.is_empty());
        let three = with.three_views[0];
        assert!(three.agrees() && three.used > 480, "{three:?}");
        own += three.chi2 / f64::from(rounds);
        let off: Vec<f64> = with.drift.iter().zip(DRIFT).map(|(found, truth)| found - truth).collect();
        chi2 += dot(&off, &with.weight.apply(&off)) / f64::from(rounds);
        let [u, u_pairs] = [&with, &without].map(|found| found.models().pop().unwrap().u_volume);
        lower += u_pairs / u / f64::from(rounds);
    }
    // Means 7, standard deviations of the means √(14/16) = 0.9.
    assert!((4.5..9.5).contains(&chi2), "{chi2}");
    assert!((4.5..9.5).contains(&own), "{own}");
    assert!(lower > 2.0, "{lower}");
}

/// Without a projector's pixels, or without the projector, the estimate is that of the pairs, byte by byte; so it is after a projector
/// moved in a way that its own pairs hardly show.
#[test]
fn without_trusted_places_the_pairs_decide_alone() {
    let [left, right, projector] = rig(1124, 750);
    let drifted = stepped(&right, &DRIFT);
    let mut noise = Noise(43);
    let mut seen = [
        lit_matches([&left, &drifted, &projector], 0.02, &mut noise, 2000),
        matches(&projector, &drifted, 0.02, &mut noise, 2000),
    ];
    let estimate = |fixed: [&Camera; 2], seen: &[Vec<Match>; 2], lit: bool| {
        estimate_view(&right, &partners(fixed, seen, lit), None, &EXACT_PHASE).unwrap()
    };
    let moved = turned(&projector, 1, 0.01);
    let pairs = estimate([&left, &moved], &seen, false);
    let knocked = estimate([&left, &moved], &seen, true);
    assert!(!knocked.three_views[0].agrees(), "{:?}", knocked.three_views);
    assert_eq!((&knocked.drift, &knocked.weight), (&pairs.drift, &pairs.weight));

    let pairs = estimate([&left, &projector], &seen, false);
    seen[0].iter_mut().for_each(|m| m.lit = None);
    let dark = estimate([&left, &projector], &seen, true);
    assert_eq!((&dark.drift, &dark.weight), (&pairs.drift, &pairs.weight));
}

/// Wrong pixels of the projector move nothing.
#[test]
fn wrong_places_are_rejected() {
    let [left, right, projector] = rig(1124, 750);
    let mut noise = Noise(47);
    let mut seen = [
        lit_matches([&left, &right, &projector], 0.02, &mut noise, 2000),
        matches(&projector, &right, 0.02, &mut noise, 2000),
    ];
    for wrong in seen[0].iter_mut().step_by(7) {
        let lit = wrong.lit.as_mut().unwrap();
        lit.pixel += Vector2::new(noise.gauss().abs(), noise.gauss()) * 5.0;
    }
    let found =
        estimate_view(&right, &partners([&left, &projector], &seen, true), None, &EXACT_PHASE).unwrap();
    let three = found.three_views[0];
    assert!(three.agrees() && three.used < 1750, "{three:?}");
    let chi2 = dot(&found.drift, &found.weight.apply(&found.drift));
    assert!(chi2 < 25.0, "{chi2}");
}

/// A projector that moved as no pair shows it gives wrong lengths: places that certified lengths contradict are left out, and the pairs
/// decide with the lengths. What a good calibration leaves of lengths contradicts nothing.
#[test]
fn lengths_leave_out_places_that_they_contradict() {
    let [left, right, projector] = rig(1124, 750);
    let drifted = stepped(&right, &DRIFT);
    let mut noise = Noise(53);
    let seen = [
        lit_matches([&left, &drifted, &projector], 0.02, &mut noise, 1000),
        matches(&projector, &drifted, 0.02, &mut noise, 1000),
    ];
    let [with, pairs] = [true, false].map(|lit| {
        estimate_view(&right, &partners([&left, &projector], &seen, lit), None, &EXACT_PHASE).unwrap()
    });
    let by = [0.0, -400.0, 0.0, -0.8, 0.0, 0.0, 0.0];
    let reading =
        |error_mm: f64| LengthReading { error_mm, u_mm: 1e-3, certified_mm: 100.0, u_certified_mm: 0.0, by };
    let near = with.clone().with_lengths(&[reading(0.002)]);
    assert!(near.three_views[0].agrees() && near.weight.at(3, 3) > with.weight.at(3, 3));
    let far = with.clone().with_lengths(&[reading(0.2)]);
    assert!(!far.three_views[0].agrees() && far.three_views[0].chi2 <= far.three_views[0].limit);
    // The same length, read with the view in the state of the estimate by the pairs.
    let apart: f64 = by.iter().zip(with.drift).zip(pairs.drift).map(|((by, a), b)| by * (a - b)).sum();
    let alone = pairs.with_lengths(&[reading(0.2 + apart)]);
    assert_eq!(far.weight, alone.weight);
    for (a, b) in far.drift.iter().zip(alone.drift) {
        assert!((a - b).abs() < 1e-9, "{:?} beside {:?}", far.drift, alone.drift);
    }
}
