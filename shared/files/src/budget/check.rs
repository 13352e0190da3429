//! From the budget as written to the budget as meant.

use metrology::uncertainty::{
    Budget, Correlation, Expression, ExpressionError, Model, MonteCarloSettings, Quantity,
    observed_correlation, same_unit,
};

use super::quantity::Place;
use super::raw::{RawBudget, RawCorrelation, RawReference};
use super::{BUDGET_FORMAT, BudgetFile, Reference};
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean};
use crate::hash::sha256_hex;
use std::fmt::Display;

/// More sources than any budget lists; correlation work grows with the third power.
const MAX_QUANTITIES: usize = 500;

pub fn check(document: &Document) -> Result<BudgetFile, FileError> {
    let raw: RawBudget = document.parse(BUDGET_FORMAT)?;
    let count = raw.quantity.len();
    if count == 0 || count > MAX_QUANTITIES {
        let problem =
            Problem::Value { value: format!("{count} quantities"), limit: format!("1 … {MAX_QUANTITIES}") };
        return Err(document.fault("quantity", problem, "give one [[quantity]] per source of uncertainty"));
    }
    let unit = &raw.measurand.unit;
    let quantities = raw
        .quantity
        .iter()
        .enumerate()
        .map(|(index, raw)| Place { document, index, raw }.quantity(unit))
        .collect::<Result<Vec<_>, _>>()?;
    names_differ(document, &quantities)?;
    let model = model(document, &raw, &quantities)?;
    let correlations = raw
        .correlation
        .iter()
        .enumerate()
        .map(|(index, raw)| correlation(document, index, raw, &quantities))
        .collect::<Result<Vec<_>, _>>()?;
    let budget = Budget {
        quantities,
        model,
        correlations,
        coverage_probability: coverage_probability(document, raw.coverage_probability)?,
        coverage_factor: raw.coverage_factor.map(|k| coverage_factor(document, k)).transpose()?,
        truncate_dof: raw.truncate_dof,
    };
    Ok(BudgetFile {
        sha256: sha256_hex(document.text.as_bytes()),
        monte_carlo: monte_carlo(document, &raw)?,
        reference: raw.reference.map(|r| reference(document, r)).transpose()?,
        name: raw.name,
        remark: raw.remark,
        symbol: raw.measurand.symbol,
        unit: raw.measurand.unit,
        model: raw.measurand.model,
        budget,
    })
}

fn value<T>(document: &Document, key: &str, value: &dyn Display, limit: &str) -> Result<T, FileError> {
    Err(document.fault(key, Problem::Value { value: value.to_string(), limit: limit.into() }, ""))
}

fn coverage_probability(document: &Document, p: f64) -> Result<f64, FileError> {
    if (0.5..=0.9999).contains(&p) {
        Ok(p)
    } else {
        value(document, "coverage_probability", &p, "0.5 … 0.9999, a fraction")
    }
}

fn coverage_factor(document: &Document, k: f64) -> Result<f64, FileError> {
    if k > 0.0 && k <= 100.0 { Ok(k) } else { value(document, "coverage_factor", &k, "above 0, up to 100") }
}

fn names_differ(document: &Document, quantities: &[Quantity]) -> Result<(), FileError> {
    for (index, quantity) in quantities.iter().enumerate() {
        let key = format!("quantity[{index}].name");
        if quantity.name.trim().is_empty() {
            return value(document, &key, &"\"\"", "a symbol");
        }
        if quantities[..index].iter().any(|q| q.name == quantity.name) {
            let problem = Problem::Duplicate { kind: "quantity", name: quantity.name.clone() };
            return Err(document.fault(&key, problem, "rename one of the two"));
        }
    }
    Ok(())
}

/// A sum with sensitivities, or a formula without.
fn model(document: &Document, raw: &RawBudget, quantities: &[Quantity]) -> Result<Model, FileError> {
    for (index, c) in raw.quantity.iter().enumerate().filter_map(|(i, q)| Some((i, q.sensitivity?))) {
        let key = format!("quantity[{index}].sensitivity");
        if raw.measurand.model.is_some() {
            let problem = Problem::Unsupported("the sensitivity follows from measurand.model".into());
            return Err(document.fault(&key, problem, "remove one of the two"));
        }
        if !c.is_finite() {
            return value(document, &key, &c, "a finite number");
        }
    }
    let Some(text) = &raw.measurand.model else {
        sum_units(document, raw, quantities)?;
        return Ok(Model::Linear(raw.quantity.iter().map(|q| q.sensitivity.unwrap_or(1.0)).collect()));
    };
    let names: Vec<&str> = quantities.iter().map(|q| q.name.as_str()).collect();
    let expression = Expression::parse(text, &names).map_err(|error| {
        let remedy = match &error {
            ExpressionError::UnknownName { name, .. } => {
                did_you_mean(name, names.iter().copied(), "add a [[quantity]] of that name")
            }
            _ => String::new(),
        };
        document.fault("measurand.model", Problem::Syntax(error.to_string()), remedy)
    })?;
    if let Some(unused) = (0..names.len()).find(|i| !expression.mentions(*i)) {
        let problem =
            Problem::Unsupported(format!("the model does not mention quantity \"{}\"", names[unused]));
        return Err(document.fault(
            "measurand.model",
            problem,
            "add it to the model, or remove the quantity",
        ));
    }
    let units: Vec<&str> = quantities.iter().map(|q| q.unit.as_str()).collect();
    expression.check_units(&units, &raw.measurand.unit).map_err(|[one, other]| {
        let problem = Problem::Disagreement { what: "units in a sum", here: one, there: other };
        document.fault(
            "measurand.model",
            problem,
            "give both quantities in one unit, or multiply one of them by its factor in the model",
        )
    })?;
    Ok(Model::Expression(expression))
}

/// In a sum a quantity of another unit needs the sensitivity that converts it.
fn sum_units(document: &Document, raw: &RawBudget, quantities: &[Quantity]) -> Result<(), FileError> {
    let measurand = &raw.measurand.unit;
    for (index, (quantity, written)) in quantities.iter().zip(&raw.quantity).enumerate() {
        let converted = written.sensitivity.is_some_and(|c| c != 1.0);
        if !converted && !same_unit(&quantity.unit, measurand) {
            let (here, there) = (
                format!("quantity \"{}\" is in {}", quantity.name, quantity.unit),
                format!("the measurand in {measurand}"),
            );
            let problem = Problem::Disagreement { what: "units of the sum", here, there };
            let remedy = format!(
                "add sensitivity = …, {measurand} per {}, or give the quantity in {measurand}",
                quantity.unit
            );
            return Err(document.fault(&format!("quantity[{index}].unit"), problem, &remedy));
        }
    }
    Ok(())
}

fn correlation(
    document: &Document,
    index: usize,
    raw: &RawCorrelation,
    quantities: &[Quantity],
) -> Result<Correlation, FileError> {
    let key = |name: &str| format!("correlation[{index}].{name}");
    let find = |name: &String| {
        quantities.iter().position(|q| q.name == *name).ok_or_else(|| {
            let known = || quantities.iter().map(|q| q.name.as_str());
            let remedy = did_you_mean(name, known(), "");
            let problem = Problem::UnknownName {
                kind: "quantity",
                name: name.clone(),
                known: known().collect::<Vec<_>>().join(", "),
            };
            document.fault(&key("between"), problem, remedy)
        })
    };
    let (first, second) = (find(&raw.between[0])?, find(&raw.between[1])?);
    let coefficient = match (raw.coefficient, raw.from_readings) {
        (Some(r), false) if (-1.0..=1.0).contains(&r) => r,
        (Some(r), false) => return value(document, &key("coefficient"), &r, "−1 … 1"),
        (None, true) => observed_correlation(&quantities[first].readings, &quantities[second].readings)
            .map_err(|error| {
                let remedy =
                    "both quantities need the readings that were taken at the same time, in the same order";
                document.fault(&key("from_readings"), Problem::Unsupported(error.to_string()), remedy)
            })?,
        _ => {
            let problem = Problem::Missing("exactly one of coefficient and from_readings = true".into());
            return Err(document.fault(&key("between"), problem, ""));
        }
    };
    Ok(Correlation { first, second, coefficient })
}

fn monte_carlo(document: &Document, raw: &RawBudget) -> Result<MonteCarloSettings, FileError> {
    let (raw, default) = (&raw.monte_carlo, MonteCarloSettings::default());
    let settings = MonteCarloSettings {
        seed: raw.seed.unwrap_or(default.seed),
        digits: raw.digits.unwrap_or(default.digits),
        trials: raw.trials,
        max_trials: raw.max_trials.unwrap_or(default.max_trials),
        interval: raw.interval.unwrap_or_default(),
    };
    if !(1..=2).contains(&settings.digits) {
        return value(document, "monte_carlo.digits", &settings.digits, "1 or 2");
    }
    let counts =
        [("monte_carlo.trials", settings.trials), ("monte_carlo.max_trials", Some(settings.max_trials))];
    for (key, count) in counts.into_iter().filter_map(|(key, count)| Some((key, count?))) {
        let range = MonteCarloSettings::TRIALS;
        if !range.contains(&count) {
            return value(document, key, &count, &format!("{} … {}", range.start(), range.end()));
        }
    }
    Ok(settings)
}

fn reference(document: &Document, raw: RawReference) -> Result<Reference, FileError> {
    if !raw.value.is_finite() {
        return value(document, "reference.value", &raw.value, "a finite number");
    }
    let expanded_uncertainty = raw.expanded_uncertainty;
    if !(expanded_uncertainty.is_finite() && expanded_uncertainty >= 0.0) {
        return value(
            document,
            "reference.expanded_uncertainty",
            &expanded_uncertainty,
            "zero or a positive number",
        );
    }
    Ok(Reference { name: raw.name, value: raw.value, expanded_uncertainty })
}
