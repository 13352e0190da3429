//! Capability of a gauge: repeated readings of one reference (type 1), and parts × operators × trials (type 2, crossed).

use super::distributions::f_tail;
use super::{mean, sample_sd};
use crate::uncertainty::student::coverage_probability;
use serde::Serialize;
use std::collections::BTreeMap;

/// The interaction is pooled with the equipment above this probability (AIAG MSA 4th edition).
const POOLED_ABOVE: f64 = 0.25;

/// One reading of a study.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Which part was measured.
    pub part: String,
    /// Who measured, or under which condition.
    pub operator: String,
    /// Measured value in the unit of the characteristic.
    pub value: f64,
}

/// Why readings are no study.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GaugeError {
    /// Too few of something.
    #[error("{what}: {count}, at least {least} are needed")]
    TooFew {
        /// What there is too few of.
        what: &'static str,
        /// How many there are.
        count: usize,
        /// How many are needed.
        least: usize,
    },
    /// The study is not balanced.
    #[error(
        "part \"{part}\" by operator \"{operator}\" has {count} readings, others have {other}: each operator measures each part equally often"
    )]
    Unbalanced {
        /// Name of the part.
        part: String,
        /// Name of the operator.
        operator: String,
        /// Readings of this pair.
        count: usize,
        /// Readings that most pairs have.
        other: usize,
    },
    /// A reading is NaN or infinite.
    #[error("a reading of part \"{0}\" is not a number")]
    NotFinite(String),
}

/// Study of type 1: bias and repeatability on one reference.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TypeOne {
    /// Number of readings of the reference.
    pub count: usize,
    /// Value of the reference.
    pub reference: f64,
    /// Mean of all readings.
    pub mean: f64,
    /// Sample standard deviation of the readings.
    pub sd: f64,
    /// Mean less the reference's value.
    pub bias: f64,
    /// Probability of a greater bias by chance (t test, two-sided); absent when nothing scatters.
    pub bias_p: Option<f64>,
    /// 0.2 T / (6 s); absent when nothing scatters.
    pub cg: Option<f64>,
    /// (0.1 T − |bias|) / (3 s); absent when nothing scatters.
    pub cgk: Option<f64>,
}

/// Evaluates readings of one reference against a tolerance T > 0.
///
/// # Errors
/// Fewer than ten readings, or one that is not finite.
pub fn type_one(values: &[f64], reference: f64, tolerance: f64) -> Result<TypeOne, GaugeError> {
    if values.len() < 10 {
        return Err(GaugeError::TooFew { what: "readings of the reference", count: values.len(), least: 10 });
    }
    if values.iter().any(|v| !v.is_finite()) {
        return Err(GaugeError::NotFinite("the reference".into()));
    }
    let (mean, sd) = (mean(values).unwrap_or_default(), sample_sd(values).unwrap_or_default());
    let bias = mean - reference;
    let scatters = sd > 0.0;
    let n = values.len() as f64;
    let t = bias.abs() * n.sqrt() / sd;
    Ok(TypeOne {
        count: values.len(),
        reference,
        mean,
        sd,
        bias,
        bias_p: scatters.then(|| 1.0 - coverage_probability(t, n - 1.0)),
        cg: scatters.then(|| 0.2 * tolerance / (6.0 * sd)),
        cgk: scatters.then(|| (0.1 * tolerance - bias.abs()) / (3.0 * sd)),
    })
}

/// One source of an analysis of variance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnovaLine {
    /// What the line is of.
    pub source: &'static str,
    /// Degrees of freedom of the line.
    pub dof: f64,
    /// Sum of squares, unit².
    pub sum_of_squares: f64,
    /// Mean square of the source, unit².
    pub mean_square: f64,
    /// Probability of a greater F by chance; absent for the last line and where nothing scatters.
    pub p: Option<f64>,
}

/// Study of type 2, crossed, by analysis of variance. Standard deviations in the unit of the characteristic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TypeTwo {
    /// Number of parts measured.
    pub parts: usize,
    /// Number of operators or conditions.
    pub operators: usize,
    /// Readings of each part by each operator.
    pub trials: usize,
    /// The analysis of variance before pooling.
    pub anova: Vec<AnovaLine>,
    /// Whether the interaction was pooled with the equipment.
    pub pooled: bool,
    /// EV: repeatability of the equipment.
    pub ev: f64,
    /// AV: reproducibility between operators.
    pub av: f64,
    /// INT: interaction of part and operator; 0 when pooled.
    pub interaction: f64,
    /// GRR: repeatability and reproducibility together.
    pub grr: f64,
    /// PV: variation of the parts.
    pub pv: f64,
    /// TV: total variation of all readings.
    pub tv: f64,
    /// GRR over TV, %; absent when nothing varies.
    pub grr_of_variation_percent: Option<f64>,
    /// 6 GRR over the tolerance, %; absent without a tolerance.
    pub grr_of_tolerance_percent: Option<f64>,
    /// Number of distinct categories, 1.41 PV/GRR cut to a whole number; absent without GRR.
    pub ndc: Option<u64>,
}

/// Evaluates a balanced crossed study; `tolerance` is the width T > 0 where there is one.
///
/// # Errors
/// Fewer than two parts, operators or trials, a study that is not balanced, a reading that is not finite.
pub fn type_two(readings: &[Reading], tolerance: Option<f64>) -> Result<TypeTwo, GaugeError> {
    let table = Table::new(readings)?;
    let (p, o, r) = (table.parts.len() as f64, table.operators.len() as f64, table.trials as f64);
    let [part, operator, cross, equipment] = table.sums_of_squares();
    let dofs = [p - 1.0, o - 1.0, (p - 1.0) * (o - 1.0), p * o * (r - 1.0)];
    let squares: Vec<f64> = [part, operator, cross, equipment].iter().zip(dofs).map(|(s, d)| s / d).collect();
    // Scatter over none at all is no chance; nothing over nothing says nothing.
    let ratio = |over: usize, under: usize| match (squares[over] > 0.0, squares[under] > 0.0) {
        (_, true) => Some(f_tail(squares[over] / squares[under], dofs[over], dofs[under])),
        (true, false) => Some(0.0),
        (false, false) => None,
    };
    let ps = [ratio(0, 2), ratio(1, 2), ratio(2, 3), None];
    let pooled = ps[2].is_none_or(|p| p > POOLED_ABOVE);
    let error = if pooled { (cross + equipment) / (dofs[2] + dofs[3]) } else { squares[3] };
    let under = if pooled { error } else { squares[2] };
    // Variances that chance makes negative are none.
    let variance = |square: f64, of: f64| ((square - under) / of).max(0.0);
    let interaction = if pooled { 0.0 } else { ((squares[2] - squares[3]) / r).max(0.0) };
    let (av, pv) = (variance(squares[1], p * r), variance(squares[0], o * r));
    let grr = (error + av + interaction).sqrt();
    let tv = (grr * grr + pv).sqrt();
    let sources = ["part", "operator", "part × operator", "equipment"];
    let sums = [part, operator, cross, equipment];
    let anova = (0..4).map(|i| AnovaLine {
        source: sources[i],
        dof: dofs[i],
        sum_of_squares: sums[i],
        mean_square: squares[i],
        p: ps[i],
    });
    Ok(TypeTwo {
        parts: table.parts.len(),
        operators: table.operators.len(),
        trials: table.trials,
        anova: anova.collect(),
        pooled,
        ev: error.sqrt(),
        av: av.sqrt(),
        interaction: interaction.sqrt(),
        grr,
        pv: pv.sqrt(),
        tv,
        grr_of_variation_percent: (tv > 0.0).then(|| 100.0 * grr / tv),
        grr_of_tolerance_percent: tolerance.map(|tolerance| 600.0 * grr / tolerance),
        ndc: (grr > 0.0).then(|| (1.41 * pv.sqrt() / grr) as u64),
    })
}

/// Readings by part and operator, in the order of their names.
struct Table<'a> {
    parts: Vec<&'a str>,
    operators: Vec<&'a str>,
    trials: usize,
    cells: BTreeMap<(&'a str, &'a str), Vec<f64>>,
}

impl<'a> Table<'a> {
    fn new(readings: &'a [Reading]) -> Result<Self, GaugeError> {
        let mut cells: BTreeMap<(&str, &str), Vec<f64>> = BTreeMap::new();
        for reading in readings {
            if !reading.value.is_finite() {
                return Err(GaugeError::NotFinite(reading.part.clone()));
            }
            cells.entry((&reading.part, &reading.operator)).or_default().push(reading.value);
        }
        let names = |of: fn(&(&'a str, &'a str)) -> &'a str| {
            let mut names: Vec<&str> = cells.keys().map(of).collect();
            names.sort_unstable();
            names.dedup();
            names
        };
        let (parts, operators) = (names(|key| key.0), names(|key| key.1));
        // What most pairs have; of two equally frequent numbers the greater.
        let often = |count: usize| cells.values().filter(|v| v.len() == count).count();
        let trials = cells.values().map(Vec::len).max_by_key(|&count| (often(count), count)).unwrap_or(0);
        for (what, count) in [
            ("parts", parts.len()),
            ("operators", operators.len()),
            ("readings of a part by an operator", trials),
        ] {
            if count < 2 {
                return Err(GaugeError::TooFew { what, count, least: 2 });
            }
        }
        for part in &parts {
            for operator in &operators {
                let count = cells.get(&(*part, *operator)).map_or(0, Vec::len);
                if count != trials {
                    let (part, operator) = ((*part).to_owned(), (*operator).to_owned());
                    return Err(GaugeError::Unbalanced { part, operator, count, other: trials });
                }
            }
        }
        Ok(Self { parts, operators, trials, cells })
    }

    /// Sums of squares of part, operator, interaction and equipment.
    fn sums_of_squares(&self) -> [f64; 4] {
        let all = |keep: &dyn Fn(&(&str, &str)) -> bool| -> f64 {
            let values: Vec<f64> =
                self.cells.iter().filter(|(key, _)| keep(key)).flat_map(|(_, v)| v).copied().collect();
            mean(&values).unwrap_or_default()
        };
        let grand = all(&|_| true);
        let part_means: Vec<f64> = self.parts.iter().map(|part| all(&|key| key.0 == *part)).collect();
        let operator_means: Vec<f64> = self.operators.iter().map(|one| all(&|key| key.1 == *one)).collect();
        let (p, o, r) = (self.parts.len() as f64, self.operators.len() as f64, self.trials as f64);
        let square = |v: f64| v * v;
        let part: f64 = part_means.iter().map(|m| square(m - grand)).sum::<f64>() * o * r;
        let operator: f64 = operator_means.iter().map(|m| square(m - grand)).sum::<f64>() * p * r;
        let (mut cross, mut equipment) = (0.0, 0.0);
        for (part_name, part_mean) in self.parts.iter().zip(&part_means) {
            for (operator_name, operator_mean) in self.operators.iter().zip(&operator_means) {
                let values = &self.cells[&(*part_name, *operator_name)];
                let cell = mean(values).unwrap_or_default();
                cross += r * square(cell - part_mean - operator_mean + grand);
                equipment += values.iter().map(|v| square(v - cell)).sum::<f64>();
            }
        }
        [part, operator, cross, equipment]
    }
}
