//! Examples of Supplement 1 (JCGM 101:2008, section 9), and what the Monte Carlo method must keep to.

use super::gum::end_gauge;
use super::{NORMAL, formula, pair, printed, quantity, sum};
use crate::uncertainty::{
    Budget, Distribution, IntervalKind, MonteCarloResult, MonteCarloSettings, UncertaintyError,
    numerical_tolerance, probabilistically_symmetric, shortest, validate,
};

const KNOWN: f64 = f64::INFINITY;

fn run(budget: &Budget, trials: u64, interval: IntervalKind) -> MonteCarloResult {
    let settings = MonteCarloSettings { trials: Some(trials), interval, ..MonteCarloSettings::default() };
    budget.monte_carlo(&settings, &mut |_, _| {}).unwrap()
}

/// Within `sigmas` of a statistic whose standard deviation over repetitions is `sd`.
#[track_caller]
fn near(found: f64, expected: f64, sd: f64) {
    assert!((found - expected).abs() < 5.0 * sd, "{found}, expected {expected} ± {sd}");
}

fn additive(distribution: Distribution, last_uncertainty: f64) -> Budget {
    let value = |u: f64| u * distribution.divisor();
    let one = |name: &str, u: f64| quantity(name, 0.0, distribution, value(u), KNOWN);
    sum(vec![one("x1", 1.0), one("x2", 1.0), one("x3", 1.0), one("x4", last_uncertainty)], 0.95)
}

#[test]
fn s1_9_2_additive_model() {
    // 9.2.2 normal: ±3.92; 9.2.3 rectangular: ±3.88 while the budget states ±3.92; 9.2.4 one ten times wider: ±17.0 to ±19.9.
    for (distribution, last, u, interval, digit, valid) in [
        (NORMAL, 1.0, 2.0, 3.92, 0.01, true),
        (Distribution::Rectangular, 1.0, 2.0, 3.88, 0.01, true),
        (Distribution::Rectangular, 10.0, 10.1, 17.0, 0.1, false),
    ] {
        let budget = additive(distribution, last);
        let result = run(&budget, 1_000_000, IntervalKind::ProbabilisticallySymmetric);
        near(result.estimate, 0.0, u / 1e3);
        near(result.standard_uncertainty, u, 0.25 * digit);
        for end in [result.probabilistically_symmetric.high, -result.probabilistically_symmetric.low] {
            near(end, interval, 0.25 * digit);
        }
        let validation = validate(&budget.evaluate().unwrap(), &result, 2);
        assert_eq!(validation.valid, valid, "{validation:?}");
        let length = result.shortest.high - result.shortest.low;
        assert!(length <= result.probabilistically_symmetric.high - result.probabilistically_symmetric.low);
    }
    printed(additive(Distribution::Rectangular, 1.0).evaluate().unwrap().expanded_uncertainty, 3.92, 0.01);
    printed(additive(Distribution::Rectangular, 10.0).evaluate().unwrap().expanded_uncertainty, 19.9, 0.1);
}

/// 9.3: calibration of a mass standard of 100 g; mg and kg/m³.
fn mass() -> Budget {
    let quantities = vec![
        quantity("m_R", 100_000.0, NORMAL, 0.050, KNOWN),
        quantity("dm_R", 1.234, NORMAL, 0.020, KNOWN),
        quantity("rho_a", 1.20, Distribution::Rectangular, 0.10, KNOWN),
        quantity("rho_W", 8000.0, Distribution::Rectangular, 1000.0, KNOWN),
        quantity("rho_R", 8000.0, Distribution::Rectangular, 50.0, KNOWN),
    ];
    formula("(m_R + dm_R) * (1 + (rho_a - 1.2) * (1/rho_W - 1/rho_R)) - 100000", quantities, 0.95)
}

#[test]
fn s1_9_3_mass_calibration() {
    let budget = mass().evaluate().unwrap();
    printed(budget.estimate, 1.234_0, 1e-4);
    printed(budget.combined_standard_uncertainty, 0.053_9, 1e-4);
    printed(budget.estimate - budget.expanded_uncertainty, 1.128_5, 1e-4);
    printed(budget.estimate + budget.expanded_uncertainty, 1.339_5, 1e-4);
    assert_eq!(budget.notes.len(), 3, "the densities are invisible to first order: {:?}", budget.notes);
    let settings = MonteCarloSettings { interval: IntervalKind::Shortest, ..MonteCarloSettings::default() };
    let fixed = MonteCarloSettings { trials: Some(1_000_000), ..settings };
    let monte_carlo = mass().monte_carlo(&fixed, &mut |_, _| {}).unwrap();
    // Table 6, from the same number of trials: ends of a shortest interval scatter more than quantiles.
    near(monte_carlo.estimate, 1.234_1, 1e-4);
    near(monte_carlo.standard_uncertainty, 0.075_4, 1e-4);
    near(monte_carlo.shortest.low, 1.083_4, 6e-4);
    near(monte_carlo.shortest.high, 1.382_5, 6e-4);
    assert!(!validate(&budget, &monte_carlo, 1).valid);
}

#[test]
fn s1_9_5_gauge_block() {
    let mut budget = end_gauge(0.99);
    for (i, limit_ratio) in [(7, 0.1), (8, 0.5)] {
        budget.quantities[i].distribution = Distribution::CurvilinearTrapezoidal { limit_ratio };
    }
    // The Supplement uses the rounded 6, 4 and 7 nm.
    for (i, u_nm) in [(1, 6.0), (2, 4.0), (3, 7.0)] {
        budget.quantities[i].value = u_nm * 1e-6;
    }
    let result = run(&budget, 300_000, IntervalKind::Shortest);
    let nm = |mm: f64| (mm - 50.0) * 1e6;
    near(nm(result.estimate), 838.0, 0.15);
    near(result.standard_uncertainty * 1e6, 36.0, 0.15);
    near(nm(result.shortest.low), 745.0, 0.5);
    near(nm(result.shortest.high), 932.0, 0.5);
}

#[test]
fn the_adaptive_method_stops_when_it_is_stable_and_says_when_it_is_not() {
    let budget = additive(NORMAL, 1.0);
    let settings = MonteCarloSettings { digits: 1, ..MonteCarloSettings::default() };
    let mut reported = Vec::new();
    let result =
        budget.monte_carlo(&settings, &mut |done, expected| reported.push((done, expected))).unwrap();
    assert_eq!(result.converged, Some(true));
    assert_eq!(result.tolerance, 0.1, "a fifth of δ = 0.5");
    assert!(result.trials >= 20_000 && result.trials.is_multiple_of(10_000));
    assert!((result.probabilistically_symmetric.high - 3.92).abs() < result.tolerance);
    assert!(reported.iter().all(|(done, expected)| done <= expected));
    let stopped = MonteCarloSettings { max_trials: 30_000, ..MonteCarloSettings::default() };
    let result = budget.monte_carlo(&stopped, &mut |_, _| {}).unwrap();
    assert_eq!((result.converged, result.trials), (Some(false), 30_000));
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let mut budget = mass();
    budget.correlations = vec![pair(0, 1, 0.5)];
    let settings = MonteCarloSettings { digits: 1, ..MonteCarloSettings::default() };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| budget.monte_carlo(&settings, &mut |_, _| {}).unwrap())
    };
    let one = with(1);
    assert_eq!(one, with(3));
    let other_seed = MonteCarloSettings { seed: 2, ..settings };
    assert_ne!(one.estimate, budget.monte_carlo(&other_seed, &mut |_, _| {}).unwrap().estimate);
}

#[test]
fn intervals_are_those_of_the_definition() {
    let values: Vec<f64> = (1..=100).map(f64::from).collect();
    let middle = probabilistically_symmetric(&values, 0.9).unwrap();
    assert_eq!((middle.low, middle.high), (5.0, 95.0));
    let skew = [0.0, 1.0, 1.1, 1.2, 1.3, 9.0, 20.0, 30.0, 40.0, 50.0];
    let short = shortest(&skew, 0.4).unwrap();
    assert_eq!((short.low, short.high), (0.0, 1.3));
    assert!(shortest(&[], 0.9).is_none() && probabilistically_symmetric(&[], 0.9).is_none());
    assert_eq!(shortest(&[2.0], 0.99).unwrap().high, 2.0);
    assert_eq!(probabilistically_symmetric(&[2.0], 0.99).unwrap().low, 2.0);
}

#[test]
fn tolerance_is_half_a_unit_of_the_last_digit() {
    // 7.9.2 gives the first two as examples.
    for (u, digits, delta) in
        [(0.000_35, 2, 0.000_005), (2.0, 1, 0.5), (0.0996, 2, 0.005), (0.0994, 2, 0.0005), (10.1, 2, 0.5)]
    {
        let found = numerical_tolerance(u, digits);
        assert!((found / delta - 1.0).abs() < 1e-12, "{u}: {found}");
    }
    assert_eq!(numerical_tolerance(0.0, 2), 0.0);
}

#[test]
fn a_model_that_breaks_at_some_draws_is_refused() {
    let budget = formula("sqrt(x)", vec![quantity("x", 1.0, NORMAL, 0.5, KNOWN)], 0.95);
    let fixed = MonteCarloSettings { trials: Some(10_000), ..MonteCarloSettings::default() };
    let error = budget.monte_carlo(&fixed, &mut |_, _| {}).unwrap_err();
    assert!(matches!(error, UncertaintyError::Draws { count: 100..400, trials: 10_000 }), "{error}");
}
