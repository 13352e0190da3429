//! Closed forms, brute force and degenerate cases.

use super::{NORMAL, formula, pair, quantity, sum};
use crate::uncertainty::{
    Distribution, Dual, Model, MonteCarloSettings, Number, TypeA, Uncertain, UncertaintyError, compare,
    effective_dof, models, normalised_error, observed_correlation,
};
use proptest::prelude::*;

const KNOWN: f64 = f64::INFINITY;
const SHAPES: [Distribution; 7] = [
    NORMAL,
    Distribution::Rectangular,
    Distribution::Triangular,
    Distribution::UShaped,
    Distribution::Trapezoidal { top_ratio: 0.0 },
    Distribution::Trapezoidal { top_ratio: 0.4 },
    Distribution::CurvilinearTrapezoidal { limit_ratio: 0.5 },
];

fn settings(trials: u64) -> MonteCarloSettings {
    MonteCarloSettings { trials: Some(trials), ..MonteCarloSettings::default() }
}

#[test]
fn drawn_values_have_the_standard_uncertainty_that_the_divisor_says() {
    for shape in SHAPES {
        let budget = sum(vec![quantity("x", 5.0, shape, 0.3, KNOWN)], 0.95);
        let (budgeted, drawn) =
            (budget.evaluate().unwrap(), budget.monte_carlo(&settings(200_000), &mut |_, _| {}));
        let drawn = drawn.unwrap();
        // Five standard errors of a standard deviation of a normal distribution, the longest-tailed one here.
        let limit = 5.0 * budgeted.combined_standard_uncertainty / (2.0 * 200_000.0_f64).sqrt();
        let difference = drawn.standard_uncertainty - budgeted.combined_standard_uncertainty;
        assert!(difference.abs() < limit, "{shape:?}: {difference}");
        assert!((drawn.estimate - 5.0).abs() < 2.0 * limit, "{shape:?}");
    }
}

#[test]
fn a_type_a_quantity_is_drawn_from_t() {
    // ν = 7: standard deviation √(7/5), 95 % within ± 2.365.
    let budget = sum(vec![quantity("x", 0.0, NORMAL, 1.0, 7.0)], 0.95);
    let drawn = budget.monte_carlo(&settings(400_000), &mut |_, _| {}).unwrap();
    assert!((drawn.standard_uncertainty - 1.4_f64.sqrt()).abs() < 0.015, "{}", drawn.standard_uncertainty);
    assert!((drawn.probabilistically_symmetric.high - 2.3646).abs() < 0.025);
    let budgeted = budget.evaluate().unwrap();
    assert!((budgeted.expanded_uncertainty - 2.364_624).abs() < 1e-6);
    let few = sum(vec![quantity("x", 0.0, NORMAL, 1.0, 2.0)], 0.95);
    assert!(
        few.monte_carlo(&settings(10_000), &mut |_, _| {}).unwrap_err().to_string().contains("4 readings")
    );
}

#[test]
fn a_whole_and_an_odd_dof_of_a_group_widen_alike() {
    // A sum of fully correlated quantities is one of them, doubled.
    for dof in [4.0, 7.0, 40.0] {
        let mut budget =
            sum(vec![quantity("a", 0.0, NORMAL, 1.0, dof), quantity("b", 0.0, NORMAL, 1.0, dof)], 0.95);
        budget.correlations = vec![pair(0, 1, 1.0)];
        let drawn = budget.monte_carlo(&settings(400_000), &mut |_, _| {}).unwrap();
        let expanded = budget.evaluate().unwrap().expanded_uncertainty;
        let high = drawn.probabilistically_symmetric.high;
        assert!((high / expanded - 1.0).abs() < 0.015, "{dof}: {high} {expanded}");
    }
}

#[test]
fn correlation_enters_both_methods_alike() {
    for r in [-1.0, -0.7, 0.3, 1.0] {
        let parts = vec![quantity("a", 1.0, NORMAL, 0.03, KNOWN), quantity("b", 2.0, NORMAL, 0.05, KNOWN)];
        let mut budget = sum(parts, 0.95);
        budget.correlations = vec![pair(1, 0, r)];
        let closed = (0.03_f64.powi(2) + 0.05_f64.powi(2) + 2.0 * r * 0.03 * 0.05).sqrt();
        let budgeted = budget.evaluate().unwrap();
        assert!((budgeted.combined_standard_uncertainty - closed).abs() < 1e-12);
        let shares: f64 = budgeted.rows.iter().map(|row| row.share).sum();
        assert!((shares + budgeted.correlation_share - 1.0).abs() < 1e-12);
        let drawn = budget.monte_carlo(&settings(100_000), &mut |_, _| {}).unwrap();
        assert!((drawn.standard_uncertainty / closed - 1.0).abs() < 0.015, "{r}");
    }
}

#[test]
fn opposite_quantities_cancel() {
    let mut budget =
        sum(vec![quantity("a", 1.0, NORMAL, 0.1, 9.0), quantity("b", 1.0, NORMAL, 0.1, 9.0)], 0.95);
    budget.correlations = vec![pair(0, 1, -1.0)];
    let result = budget.evaluate().unwrap();
    assert_eq!((result.combined_standard_uncertainty, result.effective_dof), (0.0, KNOWN));
    let constant = sum(vec![quantity("a", 1.0, NORMAL, 0.0, 9.0)], 0.95);
    let result = constant.evaluate().unwrap();
    assert_eq!((result.expanded_uncertainty, result.rows[0].share), (0.0, 0.0));
    let drawn = constant.monte_carlo(&MonteCarloSettings::default(), &mut |_, _| {}).unwrap();
    assert_eq!((drawn.converged, drawn.standard_uncertainty), (Some(true), 0.0));
}

#[test]
fn contradicting_coefficients_are_refused() {
    let one = |name| quantity(name, 0.0, NORMAL, 1.0, KNOWN);
    let mut budget = sum(vec![one("a"), one("b"), one("c")], 0.95);
    budget.correlations = vec![pair(0, 1, 0.9), pair(1, 2, 0.9), pair(0, 2, -0.9)];
    let error = budget.evaluate().unwrap_err();
    assert!(matches!(error, UncertaintyError::NotPositiveSemidefinite { .. }), "{error}");
    // The limit of what three can be: r_ac = 2·0.9² − 1.
    budget.correlations[2].coefficient = 0.62;
    assert!(budget.evaluate().is_ok());
    budget.correlations[2].coefficient = 0.61;
    assert!(budget.evaluate().is_err());
    budget.correlations = vec![pair(0, 1, 1.0), pair(1, 2, 1.0), pair(0, 2, 0.99)];
    assert!(budget.evaluate().is_err());
    for wrong in [pair(0, 0, 0.5), pair(0, 3, 0.5), pair(0, 1, 1.5), pair(0, 1, f64::NAN)] {
        budget.correlations = vec![wrong];
        assert!(matches!(budget.evaluate(), Err(UncertaintyError::Correlation { .. })), "{wrong:?}");
    }
    budget.correlations = vec![pair(0, 1, 0.5), pair(1, 0, 0.5)];
    assert!(budget.evaluate().unwrap_err().to_string().contains("twice"));
}

#[test]
fn numbers_that_cannot_be_meant_are_refused() {
    let good = || quantity("x", 1.0, NORMAL, 0.1, 4.0);
    let mut bad = vec![good(); 7];
    bad[0].value = -0.1;
    bad[1].value = f64::NAN;
    bad[2].estimate = f64::INFINITY;
    bad[3].dof = 0.0;
    bad[4].dof = f64::NAN;
    bad[5].distribution = Distribution::Normal { coverage_factor: 0.0 };
    bad[6].distribution = Distribution::Trapezoidal { top_ratio: 1.1 };
    for quantity in bad {
        assert!(matches!(sum(vec![quantity], 0.95).evaluate(), Err(UncertaintyError::Value { .. })));
    }
    assert_eq!(sum(Vec::new(), 0.95).evaluate(), Err(UncertaintyError::Empty));
    assert!(sum(vec![good()], 1.0).evaluate().is_err());
    let mut arity = sum(vec![good()], 0.95);
    arity.model = Model::Linear(vec![1.0, 2.0]);
    assert_eq!(arity.evaluate(), Err(UncertaintyError::Arity { expected: 2, found: 1 }));
    for (text, x) in [("1/x", 0.0), ("sqrt(x)", 0.0), ("acos(x)", 1.0), ("ln(x)", -1.0), ("abs(x)", 0.0)] {
        let budget = formula(text, vec![quantity("x", x, NORMAL, 0.1, KNOWN)], 0.95);
        assert!(budget.evaluate().is_err(), "{text}");
    }
    for settings in [settings(1 << 60), settings(5), MonteCarloSettings { digits: 3, ..settings(20_000) }] {
        assert!(sum(vec![good()], 0.95).monte_carlo(&settings, &mut |_, _| {}).is_err());
    }
}

#[test]
fn type_a_is_what_its_definition_says() {
    let a = TypeA::of(&[1e9 + 4.0, 1e9 + 7.0, 1e9 + 13.0, 1e9 + 16.0]).unwrap();
    assert_eq!((a.mean, a.dof), (1e9 + 10.0, 3.0));
    assert!((a.standard_deviation - 30.0_f64.sqrt()).abs() < 1e-9);
    assert!((a.standard_uncertainty - 7.5_f64.sqrt()).abs() < 1e-9);
    assert!(TypeA::of(&[1.0]).is_err() && TypeA::of(&[]).is_err() && TypeA::of(&[1.0, f64::NAN]).is_err());
    assert!(TypeA::of(&[1e308, 1e308, -1e308]).is_err(), "squares overflow");
    assert_eq!(observed_correlation(&[1.0, 2.0, 3.0], &[30.0, 20.0, 10.0]), Ok(-1.0));
    assert!(observed_correlation(&[1.0, 2.0], &[1.0, 2.0, 3.0]).is_err());
    assert!(observed_correlation(&[1.0, 1.0], &[1.0, 2.0]).is_err());
}

#[test]
fn normalised_error_is_eq_4_12() {
    let of = |value, expanded_uncertainty| Uncertain { value, expanded_uncertainty };
    let sphere = compare(of(22.530, 0.050), of(22.462, 0.022)).unwrap();
    assert!((sphere.normalised_error - 1.2448).abs() < 1e-4 && !sphere.agrees);
    // Numbers that binary holds exactly: E_n is 1, and 1 agrees.
    assert!(compare(of(1.0, 0.5), of(1.5, 0.0)).unwrap().agrees);
    assert!(normalised_error(of(1.0, 0.0), of(1.0, 0.0)).is_err());
    assert!(normalised_error(of(1.0, -0.1), of(1.0, 0.1)).is_err());
    assert!(normalised_error(of(f64::NAN, 0.1), of(1.0, 0.1)).is_err());
}

#[test]
fn sensitivities_of_the_direction_cosine_are_the_closed_form_of_eq_4_6() {
    let to = [3.0, -1.0, 2.0];
    let squared: f64 = to.iter().map(|x| x * x).sum();
    for by in 0..3 {
        let mut duals = to.map(Dual::constant);
        duals[by].derivative = 1.0;
        let found = models::direction_cosine([0.0; 3].map(Dual::constant), duals).derivative;
        let along = if by == 0 { squared } else { 0.0 };
        let closed = (along - to[0] * to[by]) / (squared * squared.sqrt());
        assert!((found - closed).abs() < 1e-15, "{by}: {found} {closed}");
    }
}

#[test]
fn planes_and_lengths_have_the_values_of_the_closed_forms() {
    let angle = models::plane_angle([0.0, 0.0, 2.0], [0.0, 3.0, 3.0]);
    assert!((angle - std::f64::consts::FRAC_PI_4).abs() < 1e-15);
    // 112 mm of Nylon-12 at 19.5 °C is 5.6 µm longer at 20 °C.
    let length = models::length_at_20(112.0, 100e-6, 19.5);
    assert!((length - 112.0056).abs() < 1e-6);
    let by_eq_4_7 = 112.0 + models::thermal_expansion(112.0, 100e-6, 0.5);
    assert!((length - by_eq_4_7).abs() < 1e-6, "second order in α ΔT");
    assert_eq!(models::distance([1.0, 2.0, 3.0], [3.0, 5.0, 9.0]), 7.0);
}

proptest! {
    #[test]
    fn effective_dof_lies_between_the_smallest_and_the_sum(
        parts in prop::collection::vec((1e-6_f64..1.0, 1.0_f64..100.0), 1..6)
    ) {
        let combined = parts.iter().map(|(u, _)| u * u).sum::<f64>().sqrt();
        let found = effective_dof(combined, &parts);
        let least = parts.iter().map(|(_, dof)| *dof).fold(KNOWN, f64::min);
        let sum: f64 = parts.iter().map(|(_, dof)| dof).sum();
        prop_assert!(found >= least * (1.0 - 1e-9) && found <= sum * (1.0 + 1e-9), "{} {} {}", least, found, sum);
    }

    #[test]
    fn a_change_of_unit_changes_nothing_but_the_unit(exponent in -280_i32..280) {
        let unit = 10.0_f64.powi(exponent);
        let at = |unit: f64| sum(vec![
            quantity("a", 3.0 * unit, NORMAL, 0.1 * unit, 4.0),
            quantity("b", 0.0, Distribution::Rectangular, 0.2 * unit, KNOWN),
        ], 0.95).evaluate().unwrap();
        let (one, other) = (at(1.0), at(unit));
        prop_assert!((one.effective_dof - other.effective_dof).abs() < 1e-6);
        prop_assert!((one.expanded_uncertainty * unit / other.expanded_uncertainty - 1.0).abs() < 1e-12);
    }
}
