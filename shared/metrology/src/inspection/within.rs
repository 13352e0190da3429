//! Checks of the numbers, directions and names of a plan.

use nalgebra::{Point3, Vector3};

use super::plan::{Feature, PlanError, Quantity};
use crate::fit::COORDINATE_LIMIT_MM;

/// Checks of numbers under one place of the plan.
pub(super) struct Within(pub String);

impl Within {
    pub fn check(
        &self,
        key: &'static str,
        value: f64,
        range: std::ops::RangeInclusive<f64>,
        limits: &'static str,
    ) -> Result<f64, PlanError> {
        if range.contains(&value) {
            return Ok(value);
        }
        Err(PlanError::Value { place: self.0.clone(), key, value, limits })
    }

    pub fn coordinate(&self, key: &'static str, value: f64) -> Result<f64, PlanError> {
        self.check(key, value, -COORDINATE_LIMIT_MM..=COORDINATE_LIMIT_MM, "a length within ±1e7 mm")
    }

    pub fn positive(&self, key: &'static str, value: f64) -> Result<f64, PlanError> {
        self.check(key, value, f64::MIN_POSITIVE..=COORDINATE_LIMIT_MM, "a positive length up to 1e7 mm")
    }

    pub fn not_negative(&self, key: &'static str, value: f64) -> Result<f64, PlanError> {
        self.check(key, value, 0.0..=COORDINATE_LIMIT_MM, "zero or a positive number up to 1e7")
    }

    pub fn point(&self, key: &'static str, values: [f64; 3]) -> Result<Point3<f64>, PlanError> {
        for value in values {
            self.coordinate(key, value)?;
        }
        Ok(Point3::from(values))
    }

    pub fn unit(&self, key: &'static str, values: [f64; 3]) -> Result<Vector3<f64>, PlanError> {
        let vector = self.point(key, values)?.coords;
        let length = vector.norm();
        self.check(
            key,
            length,
            1e-3..=1e4,
            "a direction (its length is given here) of length 0.001 … 10 000",
        )?;
        Ok(vector / length)
    }

    pub fn angle_rad(&self, key: &'static str, degrees: f64) -> Result<f64, PlanError> {
        Ok(self.check(key, degrees, 0.0..=180.0, "an angle of 0 … 180°")?.to_radians())
    }
}

/// Names reach terminals and reports as they are.
pub(super) fn printable(what: &'static str, name: &str) -> Result<(), PlanError> {
    if fringe::text::is_printable(name) {
        return Ok(());
    }
    let message = format!("the {what} name {name:?} has characters that do not print; remove them");
    Err(PlanError::Part { place: "name".into(), message })
}

/// Names must be unique.
pub(super) fn unique<'a>(what: &'static str, names: impl Iterator<Item = &'a str>) -> Result<(), PlanError> {
    let mut seen = std::collections::BTreeSet::new();
    for name in names {
        printable(what, name)?;
        if name.is_empty() || !seen.insert(name) {
            return Err(PlanError::Name { what, name: name.into() });
        }
    }
    Ok(())
}

impl Within {
    /// An error at this place.
    pub fn refuse(&self, message: String) -> PlanError {
        PlanError::Part { place: self.0.clone(), message }
    }
}

/// Turns deviations from nominal into limits.
pub(super) fn tolerated(
    place: &Within,
    name: String,
    quantity: Quantity,
    nominal: f64,
    deviations: [f64; 2],
    u_system: f64,
) -> Result<Feature, PlanError> {
    place.coordinate("nominal", nominal)?;
    let [low, high] = deviations;
    place.coordinate("tolerance (lower deviation)", low)?;
    place.coordinate("tolerance (upper deviation)", high)?;
    place.check(
        "tolerance (upper deviation)",
        high,
        low..=COORDINATE_LIMIT_MM,
        "not below the lower deviation",
    )?;
    place.not_negative("u_system", u_system)?;
    Ok(Feature {
        name,
        quantity,
        nominal,
        lower: nominal + low,
        upper: nominal + high,
        u_system,
        u_calibration: None,
    })
}
