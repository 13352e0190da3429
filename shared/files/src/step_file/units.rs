//! Units of a representation, from its context.

use super::graph::{Graph, number, references};
use super::part21::Value;
use crate::error::FileError;

/// Units of units of units: deeper ones are circles.
const DEEPEST: usize = 8;

/// Millimetres and radians per unit of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Units {
    pub length_mm: f64,
    pub angle_rad: f64,
}

/// Millimetres and radians per unit of a context.
pub(super) fn units_of(graph: &Graph, context: u64) -> Result<Units, FileError> {
    let assigned = graph.record(context, "GLOBAL_UNIT_ASSIGNED_CONTEXT");
    let units = match assigned.and_then(<[Value]>::first) {
        Some(Value::List(items)) => references(items),
        _ => Vec::new(),
    };
    let of = |kind: &str| units.iter().find(|unit| graph.record(**unit, kind).is_some());
    let length = of("LENGTH_UNIT").ok_or_else(|| {
        graph.fault(context, "states no unit of length (GLOBAL_UNIT_ASSIGNED_CONTEXT with a LENGTH_UNIT)")
    })?;
    let length_mm = 1000.0 * factor(graph, *length, DEEPEST)?;
    let angle_rad = of("PLANE_ANGLE_UNIT").map_or(Ok(1.0), |unit| factor(graph, *unit, DEEPEST))?;
    Ok(Units { length_mm, angle_rad })
}

/// Metres or radians per unit.
fn factor(graph: &Graph, unit: u64, depth: usize) -> Result<f64, FileError> {
    if depth == 0 {
        return Err(graph.fault(unit, "is a unit of itself"));
    }
    if let Some(params) = graph.record(unit, "CONVERSION_BASED_UNIT") {
        let measure = graph.reference(unit, params, 1)?;
        let kinds = ["LENGTH_MEASURE_WITH_UNIT", "PLANE_ANGLE_MEASURE_WITH_UNIT", "MEASURE_WITH_UNIT"];
        let params = kinds.into_iter().find_map(|kind| graph.record(measure, kind).filter(|p| p.len() >= 2));
        let params = params.ok_or_else(|| graph.fault(measure, "is no measure with a unit"))?;
        let value = params.first().and_then(number).filter(|v| v.is_finite() && *v > 0.0);
        let value = value.ok_or_else(|| graph.fault(measure, "has no value above 0"))?;
        return Ok(value * factor(graph, graph.reference(measure, params, 1)?, depth - 1)?);
    }
    let params = graph.params(unit, "SI_UNIT")?;
    let prefix = params.iter().rev().nth(1);
    prefix_factor(prefix).ok_or_else(|| graph.fault(unit, "has a prefix that is not read"))
}

/// What a prefix of SI stands for.
fn prefix_factor(prefix: Option<&Value>) -> Option<f64> {
    let Some(Value::Word(word)) = prefix else { return Some(1.0) };
    Some(match word.as_str() {
        "KILO" => 1e3,
        "HECTO" => 1e2,
        "DECA" => 1e1,
        "DECI" => 1e-1,
        "CENTI" => 1e-2,
        "MILLI" => 1e-3,
        "MICRO" => 1e-6,
        "NANO" => 1e-9,
        _ => return None,
    })
}
