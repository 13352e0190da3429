//! Published examples, closed forms, properties.

use super::{Budget, Correlation, Distribution, Expression, Method, Model, Quantity};

mod gum;
mod properties;
mod student;
mod supplement;

pub const NORMAL: Distribution = Distribution::Normal { coverage_factor: 1.0 };

pub fn quantity(name: &str, estimate: f64, distribution: Distribution, value: f64, dof: f64) -> Quantity {
    Quantity {
        name: name.into(),
        source: String::new(),
        unit: String::new(),
        estimate,
        method: if dof.is_finite() { Method::A } else { Method::B },
        distribution,
        value,
        dof,
        readings: Vec::new(),
    }
}

pub fn formula(text: &str, quantities: Vec<Quantity>, coverage_probability: f64) -> Budget {
    let names: Vec<&str> = quantities.iter().map(|q| q.name.as_str()).collect();
    let model = Model::Expression(Expression::parse(text, &names).unwrap());
    budget(model, quantities, coverage_probability)
}

pub fn sum(quantities: Vec<Quantity>, coverage_probability: f64) -> Budget {
    budget(Model::Linear(vec![1.0; quantities.len()]), quantities, coverage_probability)
}

fn budget(model: Model, quantities: Vec<Quantity>, coverage_probability: f64) -> Budget {
    let (correlations, coverage_factor) = (Vec::new(), None);
    Budget { quantities, model, correlations, coverage_probability, coverage_factor, truncate_dof: false }
}

pub fn pair(first: usize, second: usize, coefficient: f64) -> Correlation {
    Correlation { first, second, coefficient }
}

/// Agreement with a printed number to half a unit of its last digit.
#[track_caller]
pub fn printed(found: f64, expected: f64, last_digit: f64) {
    assert!((found - expected).abs() <= 0.5 * last_digit, "{found}, printed {expected}");
}
