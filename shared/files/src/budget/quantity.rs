//! One quantity: exactly one statement of its uncertainty, and no key that belongs to another.

use metrology::uncertainty::{Distribution, Method, Quantity, TypeA, dof_of_judgement};

use super::raw::RawQuantity;
use crate::document::Document;
use crate::error::{FileError, Problem, did_you_mean};
use std::fmt::Display;

/// More readings are a signal, not repeats.
const MAX_READINGS: usize = 100_000;

/// Shapes that a half-width may have.
const SHAPES: [&str; 5] = ["rectangular", "triangular", "u-shaped", "trapezoidal", "curvilinear-trapezoidal"];

/// A quantity and where its messages point.
pub struct Place<'a> {
    pub document: &'a Document,
    pub index: usize,
    pub raw: &'a RawQuantity,
}

/// Distribution, value and degrees of freedom.
struct Statement {
    estimate: Option<f64>,
    method: Method,
    distribution: Distribution,
    value: f64,
    dof: f64,
}

impl Place<'_> {
    fn fault(&self, key: &str, problem: Problem, remedy: &str) -> FileError {
        self.document.fault(&format!("quantity[{}].{key}", self.index), problem, remedy)
    }

    fn refuse<T>(&self, key: &str, value: &dyn Display, limit: &str, remedy: &str) -> Result<T, FileError> {
        let problem = Problem::Value { value: value.to_string(), limit: limit.into() };
        Err(self.fault(key, problem, remedy))
    }

    fn number(&self, key: &str, value: f64, allowed: bool, limit: &str) -> Result<f64, FileError> {
        if allowed && value.is_finite() { Ok(value) } else { self.refuse(key, &value, limit, "") }
    }

    fn not_negative(&self, key: &str, value: f64) -> Result<f64, FileError> {
        self.number(
            key,
            value,
            value >= 0.0,
            "zero or a positive number; give magnitudes, signs belong to the sensitivity",
        )
    }

    /// The quantity as it is meant; `unit` is the measurand's.
    pub fn quantity(&self, unit: &str) -> Result<Quantity, FileError> {
        self.keys_together()?;
        let statement = self.statement()?;
        let estimate = match (statement.estimate, self.raw.estimate) {
            (Some(_), Some(value)) => {
                return self.refuse(
                    "estimate",
                    &value,
                    "the estimate is the mean of the readings",
                    "remove it",
                );
            }
            (Some(mean), None) => mean,
            (None, Some(value)) => self.number("estimate", value, true, "a finite number")?,
            (None, None) => {
                let remedy = "add it; a correction that is not applied has estimate = 0.0";
                return Err(self.fault("estimate", Problem::Missing("estimate".into()), remedy));
            }
        };
        Ok(Quantity {
            name: self.raw.name.clone(),
            source: self.raw.source.clone(),
            unit: self.raw.unit.clone().unwrap_or_else(|| unit.to_owned()),
            estimate,
            method: self.method(statement.method)?,
            distribution: statement.distribution,
            value: statement.value,
            dof: statement.dof,
            readings: self.raw.readings.clone().unwrap_or_default(),
        })
    }

    /// Keys that mean something only beside another.
    fn keys_together(&self) -> Result<(), FileError> {
        let raw = self.raw;
        let shape = raw.distribution.as_deref();
        let type_b = raw.standard_uncertainty.or(raw.expanded_uncertainty).or(raw.half_width).is_some();
        let rules = [
            (
                "observations",
                raw.observations.is_some(),
                raw.standard_deviation.is_some(),
                "standard_deviation",
            ),
            (
                "coverage_factor",
                raw.coverage_factor.is_some(),
                raw.expanded_uncertainty.is_some(),
                "expanded_uncertainty",
            ),
            (
                "top_ratio",
                raw.top_ratio.is_some(),
                shape == Some("trapezoidal"),
                "distribution = \"trapezoidal\"",
            ),
            (
                "limit_uncertainty",
                raw.limit_uncertainty.is_some(),
                shape == Some("curvilinear-trapezoidal"),
                "distribution = \"curvilinear-trapezoidal\"",
            ),
            ("dof", raw.dof.is_some(), type_b, "standard_uncertainty, expanded_uncertainty or half_width"),
            (
                "relative_uncertainty_of_u",
                raw.relative_uncertainty_of_u.is_some(),
                type_b && raw.dof.is_none(),
                "standard_uncertainty, expanded_uncertainty or half_width, and without dof",
            ),
        ];
        for (key, given, fits, partner) in rules {
            if given && !fits {
                let problem = Problem::Unsupported(format!("has no meaning here: it goes with {partner}"));
                return Err(self.fault(key, problem, "remove one of the two, or add what is missing"));
            }
        }
        Ok(())
    }

    fn statement(&self) -> Result<Statement, FileError> {
        let raw = self.raw;
        let given = [
            ("readings", raw.readings.is_some()),
            ("standard_deviation", raw.standard_deviation.is_some()),
            ("standard_uncertainty", raw.standard_uncertainty.is_some()),
            ("expanded_uncertainty", raw.expanded_uncertainty.is_some()),
            ("half_width", raw.half_width.is_some()),
        ];
        let found: Vec<&str> = given.iter().filter(|(_, is)| *is).map(|(key, _)| *key).collect();
        let &[one] = found.as_slice() else {
            let all = given.map(|(key, _)| key).join(", ");
            let problem = Problem::Unsupported(match found.len() {
                0 => format!("quantity \"{}\" states no uncertainty", raw.name),
                _ => format!(
                    "quantity \"{}\" states its uncertainty {} times ({})",
                    raw.name,
                    found.len(),
                    found.join(", ")
                ),
            });
            return Err(self.fault(
                found.get(1).unwrap_or(&"name"),
                problem,
                &format!("give exactly one of {all}"),
            ));
        };
        if let Some(shape) =
            raw.distribution.as_deref().filter(|shape| one != "half_width" && *shape != "normal")
        {
            return self.refuse(
                "distribution",
                &format!("\"{shape}\""),
                &format!("{one} is taken as normal"),
                "give the half_width of the other shapes",
            );
        }
        match (&raw.readings, raw.standard_deviation, raw.standard_uncertainty, raw.expanded_uncertainty) {
            (Some(readings), ..) => self.readings(readings),
            (_, Some(s), ..) => self.standard_deviation(s),
            (_, _, Some(u), _) => {
                let value = self.not_negative("standard_uncertainty", u)?;
                self.type_b(Distribution::Normal { coverage_factor: 1.0 }, value)
            }
            (.., Some(expanded)) => {
                let value = self.not_negative("expanded_uncertainty", expanded)?;
                let Some(k) = raw.coverage_factor else {
                    let problem = Problem::Missing("coverage_factor".into());
                    return Err(self.fault(
                        "expanded_uncertainty",
                        problem,
                        "add the k that the certificate states",
                    ));
                };
                let coverage_factor = self.number("coverage_factor", k, k > 0.0, "above 0")?;
                self.type_b(Distribution::Normal { coverage_factor }, value)
            }
            _ => self.half_width(),
        }
    }

    fn readings(&self, readings: &[f64]) -> Result<Statement, FileError> {
        if readings.len() > MAX_READINGS {
            return self.refuse("readings", &readings.len(), "at most 100000 readings", "");
        }
        let a = TypeA::of(readings).map_err(|error| {
            self.fault(
                "readings",
                Problem::Unsupported(error.to_string()),
                "a type A evaluation needs at least 2 finite readings",
            )
        })?;
        let distribution = Distribution::Normal { coverage_factor: 1.0 };
        let (estimate, method) = (Some(a.mean), Method::A);
        Ok(Statement { estimate, method, distribution, value: a.standard_uncertainty, dof: a.dof })
    }

    fn standard_deviation(&self, s: f64) -> Result<Statement, FileError> {
        let s = self.not_negative("standard_deviation", s)?;
        let n = match self.raw.observations {
            Some(n) if n >= 2 => f64::from(n),
            Some(n) => return self.refuse("observations", &n, "at least 2", ""),
            None => {
                let problem = Problem::Missing("observations".into());
                return Err(self.fault(
                    "standard_deviation",
                    problem,
                    "add the number of readings that the mean is of",
                ));
            }
        };
        let distribution = Distribution::Normal { coverage_factor: 1.0 };
        Ok(Statement { estimate: None, method: Method::A, distribution, value: s / n.sqrt(), dof: n - 1.0 })
    }

    fn half_width(&self) -> Result<Statement, FileError> {
        let value = self.not_negative("half_width", self.raw.half_width.unwrap_or(f64::NAN))?;
        let fraction = |key: &'static str, given: Option<f64>, whole: f64| match given {
            Some(part) => {
                let ratio = if whole > 0.0 { part / whole } else { 0.0 };
                let limit = if key == "top_ratio" { "0 … 1" } else { "0 … half_width" };
                self.number(key, part, part >= 0.0 && ratio <= 1.0, limit).map(|_| ratio)
            }
            None => Err(self.fault("distribution", Problem::Missing(key.into()), "add it")),
        };
        let distribution = match self.raw.distribution.as_deref() {
            Some("rectangular") => Distribution::Rectangular,
            Some("triangular") => Distribution::Triangular,
            Some("u-shaped") => Distribution::UShaped,
            Some("trapezoidal") => {
                Distribution::Trapezoidal { top_ratio: fraction("top_ratio", self.raw.top_ratio, 1.0)? }
            }
            Some("curvilinear-trapezoidal") => Distribution::CurvilinearTrapezoidal {
                limit_ratio: fraction("limit_uncertainty", self.raw.limit_uncertainty, value)?,
            },
            Some(other) => {
                let (kind, known) = ("distribution", SHAPES.join(", "));
                let remedy = did_you_mean(
                    other,
                    SHAPES,
                    "a normal distribution has no half-width: give standard_uncertainty",
                );
                return Err(self.fault(
                    "distribution",
                    Problem::UnknownName { kind, name: other.into(), known },
                    &remedy,
                ));
            }
            None => {
                let remedy = format!("add one of {}", SHAPES.join(", "));
                return Err(self.fault("half_width", Problem::Missing("distribution".into()), &remedy));
            }
        };
        self.type_b(distribution, value)
    }

    /// A type B statement, unless the file states otherwise.
    fn type_b(&self, distribution: Distribution, value: f64) -> Result<Statement, FileError> {
        let dof = match (self.raw.dof, self.raw.relative_uncertainty_of_u) {
            (Some(dof), _) if dof == f64::INFINITY => dof,
            (Some(dof), _) => {
                self.number("dof", dof, dof >= 0.1, "at least 0.1; leave it out where u is exactly known")?
            }
            (None, Some(r)) => {
                let r = self.number("relative_uncertainty_of_u", r, (0.0..=2.0).contains(&r), "0 … 2")?;
                dof_of_judgement(r)
            }
            (None, None) => f64::INFINITY,
        };
        Ok(Statement { estimate: None, method: Method::B, distribution, value, dof })
    }

    fn method(&self, natural: Method) -> Result<Method, FileError> {
        match (self.raw.method.as_deref(), natural) {
            (None, natural) => Ok(natural),
            (Some("A"), _) => Ok(Method::A),
            (Some("B"), Method::B) => Ok(Method::B),
            (Some("B"), Method::A) => {
                self.refuse("type", &"\"B\"", "statistics of readings are type A", "remove it")
            }
            (Some(other), _) => self.refuse("type", &format!("\"{other}\""), "\"A\" or \"B\"", ""),
        }
    }
}
