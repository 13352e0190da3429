//! Published examples, values of SciPy 1.16 and statsmodels 0.14, and coverage of the intervals.

use super::chart::c4;
use super::distributions::{chi_square_quantile, f_tail, share_interval};
use super::*;
use fringe::math::random::{Key, normal_quantile};

fn near(value: f64, expected: f64, within: f64) {
    assert!((value - expected).abs() <= within, "{value} is not {expected}");
}

/// Flow rates of the example of charts for individuals, NIST/SEMATECH e-Handbook of Statistical Methods 6.3.2.2.
const FLOW: [f64; 10] = [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1];

/// Ten parts, three operators, three trials: the example of AIAG MSA, 4th edition, part by part.
const AIAG: [[[f64; 10]; 3]; 3] = [
    [
        [0.29, -0.56, 1.34, 0.47, -0.80, 0.02, 0.59, -0.31, 2.26, -1.36],
        [0.41, -0.68, 1.17, 0.50, -0.92, -0.11, 0.75, -0.20, 1.99, -1.25],
        [0.64, -0.58, 1.27, 0.64, -0.84, -0.21, 0.66, -0.17, 2.01, -1.31],
    ],
    [
        [0.08, -0.47, 1.19, 0.01, -0.56, -0.20, 0.47, -0.63, 1.80, -1.68],
        [0.25, -1.22, 0.94, 1.03, -1.20, 0.22, 0.55, 0.08, 2.12, -1.62],
        [0.07, -0.68, 1.34, 0.20, -1.28, 0.06, 0.83, -0.34, 2.19, -1.50],
    ],
    [
        [0.04, -1.38, 0.88, 0.14, -1.46, -0.29, 0.02, -0.46, 1.77, -1.49],
        [-0.11, -1.13, 1.09, 0.20, -1.07, -0.67, 0.01, -0.56, 1.45, -1.77],
        [-0.15, -0.96, 0.67, 0.11, -1.45, -0.49, 0.21, -0.49, 1.87, -2.16],
    ],
];

fn readings(table: &[[[f64; 10]; 3]; 3]) -> Vec<Reading> {
    let mut all = Vec::new();
    for (operator, trials) in table.iter().enumerate() {
        for trial in trials {
            for (part, &value) in trial.iter().enumerate() {
                let operator = ["A", "B", "C"][operator].to_owned();
                all.push(Reading { part: format!("{:02}", part + 1), operator, value });
            }
        }
    }
    all
}

fn normal(seed: u64, count: usize) -> Vec<f64> {
    let key = Key::new(seed);
    (0..count).map(|i| normal_quantile(key.open(i as u64))).collect()
}

#[test]
fn distributions_are_those_of_scipy() {
    near(chi_square_quantile(0.025, 9.0), 2.700_389_499_980_358_4, 1e-11);
    near(chi_square_quantile(0.975, 29.0), 45.722_285_804_174_52, 1e-10);
    near(chi_square_quantile(0.05, 0.7), 2.759_625_506_983_099e-4, 1e-14);
    near(f_tail(3.2, 2.0, 18.0), 0.064_705_933_769_871_26, 1e-13);
    near(f_tail(0.43, 18.0, 60.0), 0.975_229_805_914_066_7, 1e-13);
    let [low, high] = share_interval(3, 100, 0.05);
    near(low, 0.006_229_971_538_306_395, 1e-13);
    near(high, 0.085_176_052_974_280_02, 1e-12);
    let [low, high] = share_interval(0, 50, 0.05);
    assert_eq!(low, 0.0);
    near(high, 0.071_121_736_464, 1e-11);
    assert_eq!(share_interval(5, 5, 0.05)[1], 1.0);
    for (n, value) in
        [(2, 0.797_884_560_802_865_1), (5, 0.939_985_602_986_625_7), (25, 0.989_640_375_585_705_1)]
    {
        near(c4(n), value, 1e-13);
    }
}

#[test]
fn normality_is_that_of_statsmodels() {
    let found = normality(&FLOW).unwrap();
    near(found.a_squared, 0.304_858_049_270_947, 1e-12);
    near(found.p, 0.507_861_843_609_488_9, 1e-12);
    let skew = [0.02, 0.11, 0.25, 0.31, 0.42, 0.6, 0.77, 0.95, 1.2, 1.6, 2.1, 2.9, 3.8, 5.5];
    let found = normality(&skew).unwrap();
    near(found.a_squared, 0.920_536_198_614_531_3, 1e-12);
    near(found.p, 0.013_764_977, 1e-9);
    assert_eq!(normality(&[1.0; 30]), None, "nothing scatters");
    assert_eq!(normality(&FLOW[..7]), None, "too few");
    let rejected = (0..400).filter(|&seed| normality(&normal(seed, 40)).unwrap().p < 0.05).count();
    assert!((8..=34).contains(&rejected), "{rejected} of 400 normal series rejected at 5 %");
}

#[test]
fn individuals_are_those_of_the_nist_handbook() {
    let chart = chart(&FLOW, 1).unwrap();
    assert_eq!(chart.kind, ChartKind::Individuals);
    near(chart.spread.centre, 1.8778, 5e-5);
    near(chart.location.centre, 50.81, 1e-9);
    // The handbook divides by 1.128.
    near(chart.location.upper, 55.8041, 2e-3);
    near(chart.location.lower, 45.8159, 2e-3);
    // D4 of two values, ISO 7870-2.
    near(chart.spread.upper / chart.spread.centre, 3.267, 5e-4);
    assert!(chart.signals.is_empty(), "{:?}", chart.signals);
}

#[test]
fn factors_of_subgroups_are_those_of_the_standard() {
    // A3, B3, B4 of ISO 7870-2 for five and for ten values.
    for (size, [a3, b3, b4]) in [(5, [1.427, 0.0, 2.089]), (10, [0.975, 0.284, 1.716])] {
        let chart = chart(&normal(3, size * 20), size).unwrap();
        let s = chart.spread.centre;
        near((chart.location.upper - chart.location.centre) / s, a3, 6e-4);
        near(chart.spread.lower / s, b3, 6e-4);
        near(chart.spread.upper / s, b4, 6e-4);
        assert_eq!((chart.points.len(), chart.points[1].first), (20, size));
    }
    assert_eq!(chart(&normal(3, 9), 5), None, "one full subgroup");
}

#[test]
fn the_standard_deviation_within_subgroups_has_its_degrees_of_freedom() {
    for (size, groups) in [(1, 30), (5, 12)] {
        let estimates: Vec<f64> = (0..2000)
            .map(|seed| chart(&normal(seed, size.max(1) * groups), size).unwrap().sigma_within)
            .collect();
        let dof = chart(&normal(0, size * groups), size).unwrap().dof_within;
        near(mean(&estimates).unwrap(), 1.0, 0.012);
        // Relative scatter of a standard deviation: 1/√(2 ν) nearly.
        near(sample_sd(&estimates).unwrap() * (2.0 * dof).sqrt(), 1.0, 0.08);
    }
}

#[test]
fn signals_name_what_does_not_look_like_chance() {
    let reasons = |values: &[f64]| -> Vec<(usize, String)> {
        chart(values, 1).unwrap().signals.into_iter().map(|signal| (signal.point, signal.reason)).collect()
    };
    let calm: Vec<f64> = (0..40).map(|i| [0.0, 1.0, -0.4, 0.3, 0.9, -0.8, -1.0][(i * i) % 7]).collect();
    let mut one_out = calm.clone();
    one_out[20] = 9.0;
    assert!(reasons(&one_out).contains(&(20, "outside of the control limits".into())));
    let mut shifted = calm.clone();
    shifted[25..].iter_mut().for_each(|v| *v += 2.5);
    assert!(reasons(&shifted).iter().any(|(i, why)| *i >= 25 && why.starts_with("nine points")));
    let mut trend = calm.clone();
    (0..6).for_each(|i| trend[10 + i] = -1.2 + 0.4 * i as f64);
    assert!(reasons(&trend).iter().any(|(_, why)| why.starts_with("six points")));
    let alternating: Vec<f64> = (0..14).map(|i| f64::from(i % 2)).collect();
    assert!(reasons(&alternating).iter().any(|(i, why)| *i == 13 && why.starts_with("fourteen points")));
    let chance: usize = (0..200).map(|seed| chart(&normal(seed, 100), 1).unwrap().signals.len()).sum();
    assert!(chance < 600, "{chance} signals in 20 000 values of chance");
}

#[test]
fn indices_are_those_of_the_nist_handbook() {
    // Limits 8 and 20, mean 16, σ 2 (6.1.6): Cp = 1.0, Cpk = 0.6667.
    let unit = normal(11, 50);
    let (m, s) = (mean(&unit).unwrap(), sample_sd(&unit).unwrap());
    let values: Vec<f64> = unit.iter().map(|v| 16.0 + 2.0 * (v - m) / s).collect();
    let limits = Limits { lower: Some(8.0), upper: Some(20.0) };
    let found = capability(&values, None, limits, 0.95).unwrap();
    near(found.pp.unwrap().value, 1.0, 1e-12);
    near(found.ppk.unwrap().value, 2.0 / 3.0, 1e-12);
    assert_eq!((found.cp, found.cpk), (None, None));
    let one = capability(&values, None, Limits { lower: None, upper: Some(20.0) }, 0.95).unwrap();
    assert_eq!(one.pp, None, "one limit has no width");
    near(one.ppk.unwrap().value, 2.0 / 3.0, 1e-12);
    assert_eq!(capability(&values, None, Limits::default(), 0.95), None);
    assert_eq!(capability(&values[..1], None, limits, 0.95), None);
    let same = capability(&[16.0; 20], chart(&[16.0; 20], 1).as_ref(), limits, 0.95).unwrap();
    assert_eq!((same.pp, same.cpk), (None, None), "without scatter there is no index");
}

#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let limits = Limits { lower: Some(-4.0), upper: Some(5.0) };
    let mut held = [0_usize; 4];
    let trials = 1500;
    for seed in 0..trials {
        let values = normal(1000 + seed, 60);
        let chart = chart(&values, 5);
        let found = capability(&values, chart.as_ref(), limits, 0.95).unwrap();
        let truths = [1.5, 4.0 / 3.0, 1.5, 4.0 / 3.0];
        for (i, interval) in [found.pp, found.ppk, found.cp, found.cpk].into_iter().enumerate() {
            let interval = interval.unwrap();
            held[i] += usize::from((interval.low..=interval.high).contains(&truths[i]));
        }
    }
    for count in held {
        near(count as f64 / trials as f64, 0.95, 0.02);
    }
}

#[test]
fn the_example_of_the_msa_manual_comes_out() {
    let found = type_two(&readings(&AIAG), None).unwrap();
    assert_eq!((found.parts, found.operators, found.trials, found.pooled), (10, 3, 3, true));
    let sums: Vec<f64> = found.anova.iter().map(|line| line.sum_of_squares).collect();
    for (sum, published) in sums.iter().zip([88.3619, 3.1673, 0.3590, 2.7589]) {
        near(*sum, published, 6e-5);
    }
    near(found.ev, 0.199_933, 1e-5);
    near(found.av, 0.226_838, 1e-5);
    near(found.grr, 0.302_373, 1e-5);
    near(found.pv, 1.042_327, 1e-5);
    near(found.tv, 1.085_301, 2e-5);
    near(found.grr_of_variation_percent.unwrap(), 27.86, 0.01);
    assert_eq!(found.ndc, Some(4));
}

/// Proves: a gauge whose readings repeat exactly has no less of an interaction than one that hardly scatters.
#[test]
fn readings_that_repeat_exactly_hide_no_interaction() {
    let coarse = |off: f64| {
        let value = |part: usize, operator: usize| {
            (10.0 * part as f64 + ((7 * part + 5 * operator) % 3) as f64) / 100.0
        };
        let all = (0..10).flat_map(|part| {
            (0..3).flat_map(move |operator| (0..2).map(move |trial| (part, operator, trial)))
        });
        let readings: Vec<Reading> = all
            .map(|(part, operator, trial)| Reading {
                part: format!("{part}"),
                operator: format!("{operator}"),
                value: value(part, operator) + if (part, operator, trial) == (0, 0, 0) { off } else { 0.0 },
            })
            .collect();
        type_two(&readings, None).unwrap()
    };
    let (exact, nearly) = (coarse(0.0), coarse(1e-6));
    assert!(!nearly.pooled && !exact.pooled);
    assert!(nearly.interaction > 0.0 && exact.ev == 0.0);
    near(exact.interaction, nearly.interaction, 1e-5);
    near(exact.grr, nearly.grr, 1e-5);
}

#[test]
fn studies_that_prove_nothing_are_refused() {
    let all = readings(&AIAG);
    let refused = |readings: &[Reading]| type_two(readings, None).unwrap_err().to_string();
    assert!(
        refused(&all[1..]).contains("part \"01\" by operator \"A\" has 2 readings"),
        "{}",
        refused(&all[1..])
    );
    let of = |name: &str| all.iter().filter(|r| r.operator == name).cloned().collect::<Vec<_>>();
    assert!(refused(&of("A")).starts_with("operators: 1"));
    assert!(refused(&[]).starts_with("parts: 0"));
    let mut broken = all.clone();
    broken[5].value = f64::NAN;
    assert!(refused(&broken).contains("is not a number"));
    let still: Vec<Reading> = all.iter().map(|r| Reading { value: 1.0, ..r.clone() }).collect();
    let found = type_two(&still, Some(1.0)).unwrap();
    assert_eq!(
        (found.ndc, found.grr_of_variation_percent, found.grr_of_tolerance_percent),
        (None, None, Some(0.0))
    );
}

#[test]
fn a_gauge_that_is_off_shows_its_bias() {
    let noise: Vec<f64> = normal(5, 50);
    let (m, s) = (mean(&noise).unwrap(), sample_sd(&noise).unwrap());
    let values: Vec<f64> = noise.iter().map(|v| 10.003 + 0.002 * (v - m) / s).collect();
    let found = type_one(&values, 10.0, 0.2).unwrap();
    near(found.cg.unwrap(), 0.2 * 0.2 / (6.0 * 0.002), 1e-9);
    near(found.cgk.unwrap(), (0.02 - 0.003) / (3.0 * 0.002), 1e-9);
    assert!(found.bias_p.unwrap() < 1e-9);
    assert!(type_one(&values, 10.003, 0.2).unwrap().bias_p.unwrap() > 0.99);
    assert!(type_one(&values[..9], 10.0, 0.2).is_err());
    assert_eq!(type_one(&[10.0; 12], 10.0, 0.2).unwrap().cg, None);
}
