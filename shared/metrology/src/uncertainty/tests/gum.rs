//! Examples H.1 and H.2 of the GUM (JCGM 100:2008, annex H).

use super::{NORMAL, formula, pair, printed, quantity};
use crate::uncertainty::{
    Budget, Distribution, Quantity, TypeA, coverage_factor, dof_of_judgement, observed_correlation,
};
use fringe::math::hypot;

const NM: f64 = 1e-6;

/// H.1, calibration of a 50 mm end gauge; lengths in mm. The model is eq. H.3.
pub fn end_gauge(probability: f64) -> Budget {
    let known = f64::INFINITY;
    let quantities = vec![
        quantity("l_s", 50.000_623, NORMAL, 25.0 * NM, 18.0),
        quantity("d", 215.0 * NM, NORMAL, 5.8 * NM, 24.0),
        quantity("d_random", 0.0, NORMAL, 3.9 * NM, 5.0),
        quantity("d_systematic", 0.0, NORMAL, 6.7 * NM, 8.0),
        quantity("alpha_s", 11.5e-6, Distribution::Rectangular, 2e-6, known),
        quantity("theta_mean", -0.1, NORMAL, 0.2, known),
        quantity("theta_swing", 0.0, Distribution::UShaped, 0.5, known),
        quantity("delta_alpha", 0.0, Distribution::Rectangular, 1e-6, dof_of_judgement(0.1)),
        quantity("delta_theta", 0.0, Distribution::Rectangular, 0.05, dof_of_judgement(0.5)),
    ];
    let model = "l_s + d + d_random + d_systematic - l_s*(delta_alpha*(theta_mean + theta_swing) + alpha_s*delta_theta)";
    formula(model, quantities, probability)
}

#[test]
fn h1_end_gauge() {
    let result = end_gauge(0.99).evaluate().unwrap();
    printed(result.estimate, 50.000_838, 1e-6);
    // Table H.1 and H.1.4: contributions in nm.
    let contribution = |i: usize| result.rows[i].contribution / NM;
    printed(contribution(0), 25.0, 1.0);
    printed(hypot(hypot(contribution(1), contribution(2)), contribution(3)), 9.7, 0.1);
    printed(contribution(7), 2.9, 0.1);
    printed(contribution(8), 16.6, 0.1);
    // The thermal quantities whose sensitivity is 0 by the choice of θ and δθ.
    for (i, sensitivity) in [(4, 0.0), (5, 0.0), (6, 0.0), (7, 5.0)] {
        assert!(
            (result.rows[i].sensitivity - sensitivity).abs() < 1e-4,
            "{i}: {}",
            result.rows[i].sensitivity
        );
    }
    printed(hypot(result.rows[5].standard_uncertainty, result.rows[6].standard_uncertainty), 0.41, 0.01);
    assert_eq!((result.rows[7].dof.round(), result.rows[8].dof.round()), (50.0, 2.0));
    assert_eq!(result.notes.len(), 3, "{:?}", result.notes);
    printed(result.combined_standard_uncertainty / NM, 32.0, 1.0);
    // H.1.6: ν_eff = 16.7, cut to 16; t_99(16) = 2.92; U = 93 nm from the rounded 32 nm, 92 nm from the full u_c.
    printed(result.effective_dof, 16.7, 0.2);
    let mut truncated = end_gauge(0.99);
    truncated.truncate_dof = true;
    let truncated = truncated.evaluate().unwrap();
    printed(truncated.coverage_factor, 2.92, 0.01);
    printed(truncated.coverage_factor * 32.0, 93.0, 1.0);
    assert!(result.coverage_factor < truncated.coverage_factor);
    assert_eq!(result.coverage_factor, coverage_factor(0.99, result.effective_dof));
}

/// H.2, five simultaneous readings of voltage (V), current (mA) and phase (rad).
const READINGS: [[f64; 5]; 3] = [
    [5.007, 4.994, 5.005, 4.990, 4.999],
    [19.663, 19.639, 19.640, 19.685, 19.678],
    [1.0456, 1.0438, 1.0468, 1.0428, 1.0433],
];

fn circuit(model: &str) -> Budget {
    let names = ["V", "I", "phi"];
    let read = |(name, readings): (&str, &[f64; 5])| -> Quantity {
        let a = TypeA::of(readings).unwrap();
        Quantity {
            readings: readings.to_vec(),
            ..quantity(name, a.mean, NORMAL, a.standard_uncertainty, a.dof)
        }
    };
    let mut budget = formula(model, names.into_iter().zip(&READINGS).map(read).collect(), 0.9545);
    let r = |i: usize, j: usize| observed_correlation(&READINGS[i], &READINGS[j]).unwrap();
    budget.correlations = vec![pair(0, 1, r(0, 1)), pair(0, 2, r(0, 2)), pair(1, 2, r(1, 2))];
    budget
}

#[test]
fn h2_simultaneous_resistance_and_reactance() {
    let resistance = circuit("V / (I / 1000) * cos(phi)");
    // Table H.2: means, experimental standard deviations of the means, coefficients.
    for (i, mean, u) in [(0, 4.999_0, 0.003_2), (1, 19.661_0, 0.009_5)] {
        printed(resistance.quantities[i].estimate, mean, 1e-4);
        printed(resistance.quantities[i].value, u, 1e-4);
    }
    printed(resistance.quantities[2].estimate, 1.044_46, 1e-5);
    printed(resistance.quantities[2].value, 0.000_75, 1e-5);
    for (at, r) in [(0, -0.36), (1, 0.86), (2, -0.65)] {
        printed(resistance.correlations[at].coefficient, r, 0.01);
    }
    // Table H.3; the second u is 0.2956 from the readings, the GUM prints 0.295 after rounding on the way.
    for (model, y, u, digit) in [
        ("V / (I / 1000) * cos(phi)", 127.732, 0.071, 0.001),
        ("V / (I / 1000) * sin(phi)", 219.847, 0.295_6, 0.000_1),
        ("V / (I / 1000)", 254.260, 0.236, 0.001),
    ] {
        let result = circuit(model).evaluate().unwrap();
        printed(result.estimate, y, 0.001);
        printed(result.combined_standard_uncertainty, u, digit);
        // Five simultaneous readings have ν = 4, however many quantities were read.
        assert!((result.effective_dof - 4.0).abs() < 1e-9, "{}", result.effective_dof);
    }
}

#[test]
fn h2_approach_2_gives_the_same() {
    // H.2.4: each set of readings by itself, then a type A evaluation of the five (table H.4).
    for (model, y, u) in [
        ("V / (I / 1000) * cos(phi)", 127.732, 0.071),
        ("V / (I / 1000) * sin(phi)", 219.847, 0.295),
        ("V / (I / 1000)", 254.260, 0.236),
    ] {
        let budget = circuit(model);
        let at = |k: usize| budget.model.value(&READINGS.map(|r| r[k]), &mut Vec::new());
        let direct = TypeA::of(&[0, 1, 2, 3, 4].map(at)).unwrap();
        printed(direct.mean, y, 0.001);
        printed(direct.standard_uncertainty, u, 0.001);
        // The models are curved: the readings scatter by some 1e-3 of their values, and so do the slopes.
        let by_propagation = budget.evaluate().unwrap().combined_standard_uncertainty;
        assert!((direct.standard_uncertainty / by_propagation - 1.0).abs() < 5e-3, "{by_propagation}");
    }
}
