//! The 198 printed cells of the thesis' tables 4.1–4.6, 5.2, 6.1, 6.2 and chapter 6, recomputed from the printed inputs by
//! the program's own functions. Cells that the thesis misprints must come out right, not as printed.

use crate::support::shared_data;
use metrology::uncertainty::{
    Budget, Distribution, Evaluation, Method, Model, Quantity, TypeA, Uncertain, compare, models,
};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Linear expansion of maraging steel and Nylon-12, 1/K, and the temperature change, K (thesis 4.3.1.2).
const STEEL_PER_K: f64 = 10.3e-6;
const NYLON_PER_K: f64 = 100e-6;
const CHANGE_K: f64 = 1.0;

/// Table, row and column of a cell.
type Place = (String, String, String);

/// Lines of a CSV file below its header, without comments; no field but the last holds a comma.
fn csv(folder: &Path, name: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(folder.join(name)).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    lines.map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn number(text: &str) -> f64 {
    text.parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}

fn quantity(name: &str, distribution: Distribution, value: f64, dof: f64) -> Quantity {
    Quantity {
        name: name.into(),
        source: String::new(),
        unit: String::new(),
        estimate: 0.0,
        method: if dof.is_finite() { Method::A } else { Method::B },
        distribution,
        value,
        dof,
        readings: Vec::new(),
    }
}

const NORMAL: Distribution = Distribution::Normal { coverage_factor: 1.0 };

/// The thesis fixes k = 2 everywhere.
fn evaluate(quantities: Vec<Quantity>, sensitivities: Vec<f64>) -> Evaluation {
    Budget {
        quantities,
        model: Model::Linear(sensitivities),
        correlations: Vec::new(),
        coverage_probability: 0.9545,
        coverage_factor: Some(2.0),
        truncate_dof: false,
    }
    .evaluate()
    .unwrap()
}

/// Tables 4.1 to 4.4: every cell under its name, the one of u_α in its printed power of ten.
fn budgets(folder: &Path, cells: &mut BTreeMap<Place, f64>) {
    let lines = csv(folder, "budgets_4_1_to_4_4.csv");
    let mut features: Vec<(&str, &str)> = lines.iter().map(|l| (l[0].as_str(), l[1].as_str())).collect();
    features.dedup();
    for (table, feature) in features {
        let rows: Vec<_> = lines.iter().filter(|l| l[0] == table && l[1] == feature).collect();
        let mut put = |cell: &str, value| {
            cells.insert((table.into(), feature.into(), cell.into()), value);
        };
        let mut quantities = Vec::new();
        let mut sensitivities = Vec::new();
        for row in &rows {
            let (source, value) = (row[4].as_str(), number(&row[5]));
            if source == "u_sens_deg_per_mm" {
                // It belongs to the row above: mm to degrees.
                *sensitivities.last_mut().unwrap() = value;
                continue;
            }
            let distribution = match row[6].as_str() {
                "normal" => NORMAL,
                "rectangular" => Distribution::Rectangular,
                other => panic!("{other}"),
            };
            let dof = if row[9] == "inf" { f64::INFINITY } else { number(&row[9]) };
            quantities.push(quantity(source, distribution, value, dof));
            sensitivities.push(1.0);
            if source == "u_alpha" {
                let expansion = if table == "4.4" { NYLON_PER_K } else { STEEL_PER_K };
                put("value:u_alpha", models::thermal_expansion(number(&row[3]), expansion, CHANGE_K));
            }
        }
        let result = evaluate(quantities, sensitivities);
        for row in &result.rows {
            put(&format!("u:{}", row.name), row.standard_uncertainty);
        }
        put("u_comb", result.combined_standard_uncertainty);
        let printed = quantity("u_comb", NORMAL, number(&rows[0][10]), f64::INFINITY);
        put("U", evaluate(vec![printed], vec![1.0]).expanded_uncertainty);
    }
}

/// Tables 4.5, 4.6, 5.2.
fn comparisons(folder: &Path, cells: &mut BTreeMap<Place, f64>) {
    for line in csv(folder, "comparison_4_5_4_6_5_2.csv") {
        let mut put = |cell: &str, value| {
            cells.insert((line[0].clone(), line[1].clone(), cell.into()), value);
        };
        let of = |value: usize, uncertainty: usize| Uncertain {
            value: number(&line[value]),
            expanded_uncertainty: number(&line[uncertainty]),
        };
        let comparison = compare(of(5, 6), of(3, 4)).unwrap();
        put("dev", comparison.deviation);
        put("U_dev", comparison.deviation_expanded_uncertainty);
        put("en", comparison.normalised_error);
        if line[0] == "5.2" {
            let repeats = quantity("u_meas", NORMAL, number(&line[10]), f64::INFINITY);
            let probing = quantity("P_F", Distribution::Rectangular, number(&line[11]), f64::INFINITY);
            let sensitivity = if line[12].is_empty() { 1.0 } else { number(&line[12]) };
            put("U_meas", evaluate(vec![repeats, probing], vec![1.0, sensitivity]).expanded_uncertainty);
        }
    }
}

/// Tables 6.1, 6.2 and the numbers in the text of chapter 6.
fn chapter_6(folder: &Path, cells: &mut BTreeMap<Place, f64>) {
    let column = |name: &str, at: usize| -> TypeA {
        let values: Vec<f64> = csv(folder, name).iter().map(|line| number(&line[at])).collect();
        TypeA::of(&values).unwrap()
    };
    let mut sd = BTreeMap::new();
    for (table, row, file, at, label) in [
        ("6.1", "all 45", "probing_6_1.csv", 2, "diameter_mm"),
        ("6.1", "all 45", "probing_6_1.csv", 3, "fitting_deviation_mm"),
        ("6.2", "all 21", "spacing_6_2.csv", 2, "sphere1_diameter_mm"),
        ("6.2", "all 21", "spacing_6_2.csv", 3, "sphere2_diameter_mm"),
        ("6.2", "all 21", "spacing_6_2.csv", 4, "spacing_mm"),
    ] {
        let a = column(file, at);
        cells.insert((table.into(), row.into(), format!("mean {label}")), a.mean);
        cells.insert((table.into(), row.into(), format!("sd {label}")), a.standard_deviation);
        sd.insert(label, (rounded(a.mean, 3), rounded(a.standard_deviation, 3)));
    }
    let mut put = |row: &str, value| {
        cells.insert(("6 text".into(), row.into(), "value".into()), value);
    };
    let twice =
        |u: f64| evaluate(vec![quantity("u", NORMAL, u, f64::INFINITY)], vec![1.0]).expanded_uncertainty;
    put("U probing form /mm", twice(sd["fitting_deviation_mm"].0));
    put("U probing size /mm", twice(sd["diameter_mm"].1));
    put("U sphere spacing /mm", twice(sd["spacing_mm"].1));
    let diagonal = models::distance([0.0; 3], [140.0, 140.0, 90.0]);
    put("L0 /mm", diagonal);
    for (row, factor) in [("0.02 L0 /mm", 0.02), ("0.2 L0 /mm", 0.2), ("2/3 L0 /mm", 2.0 / 3.0)] {
        put(row, factor * rounded(diagonal, 1));
    }
    put("ball beam spacing /mm", 480.398_42 - 360.343_33);
}

/// Half away from zero.
fn rounded(value: f64, decimals: i32) -> f64 {
    let scale = 10.0_f64.powi(decimals);
    // Binary fractions such as 4.35 lie a rounding error beside the decimal ones.
    (value * scale * (1.0 + 4.0 * f64::EPSILON)).round() / scale
}

/// `u:u_alpha [x1e-05]` without the power of ten, and what to divide by.
fn scaled(cell: &str) -> (&str, f64) {
    match cell.split_once(" [x") {
        Some((name, power)) => (name, number(power.trim_end_matches(']'))),
        None => (cell, 1.0),
    }
}

#[test]
#[cfg_attr(
    not(shared_data),
    ignore = "../shared/data is absent; with it: cargo test --test main golden_cells::"
)]
fn cells_that_the_thesis_computed_right_are_reproduced_and_the_others_are_not() {
    let Some(folder) = shared_data("thesis_tables") else { return };
    let mut cells = BTreeMap::new();
    budgets(&folder, &mut cells);
    comparisons(&folder, &mut cells);
    chapter_6(&folder, &mut cells);
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let golden = csv(&folder, "golden_cells.csv");
    for line in &golden {
        let (name, scale) = scaled(&line[2]);
        let place = (line[0].clone(), line[1].clone(), name.to_owned());
        let value = cells.get(&place).unwrap_or_else(|| panic!("{place:?} was not computed")) / scale;
        let (printed, decimals) = (number(&line[3]), line[4].parse::<i32>().unwrap());
        let (low, high) = (number(&line[6]), number(&line[7]));
        // The table's own recomputation is given to nine decimals.
        assert!((value - number(&line[5])).abs() < 2e-9, "{line:?}: {value}");
        let half_digit = 0.5 * 10.0_f64.powi(-decimals) * (1.0 + 1e-9);
        let reachable = printed + half_digit >= low && printed - half_digit <= high;
        let status = if rounded(value, decimals) == rounded(printed, decimals) {
            "exact"
        } else if reachable {
            "within_input_rounding"
        } else {
            println!("misprint: table {}, {}, {}: {printed} printed, {value:.6}", line[0], line[1], line[2]);
            "inconsistent"
        };
        assert_eq!(status, line[8], "{line:?}: {value}");
        *counts.entry(status).or_default() += 1;
    }
    println!("{counts:?}");
    let expected = [("exact", 176), ("inconsistent", 15), ("within_input_rounding", 7)];
    assert_eq!(counts, BTreeMap::from(expected));
}
