//! Datum systems of a plan, and the names that they and the characteristics refer to.

use super::characteristic::Kind;
use super::datum::{carried, fix};
use super::joint::nominal_parts;
use super::location::largest_offset_mm;
use super::plan::{Plan, PlanError, Quantity};
use super::raw_features::{RawDatum, RawDatumSystem};
use super::references::DatumSystem;
use super::substitute::{Shape, Substitute};
use super::within::{Within, unique};

/// Names of all elements, in the order of their indices.
pub(super) struct Names(Vec<String>);

impl Names {
    /// Names of the measured elements.
    pub fn new<'a>(names: impl Iterator<Item = &'a str>) -> Self {
        Self(names.map(str::to_owned).collect())
    }

    /// Of all elements of a plan.
    pub fn of(plan: &Plan) -> Self {
        let made = plan.constructed.iter().map(|c| c.name.as_str());
        Self::new(plan.elements.iter().map(|e| e.name.as_str()).chain(made))
    }

    /// Takes in a further name.
    pub fn push(&mut self, name: &str) {
        self.0.push(name.to_owned());
    }

    /// All names in their order.
    pub fn all(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(String::as_str)
    }

    pub fn one(&self, place: &Within, key: &'static str, name: &str) -> Result<usize, PlanError> {
        self.0.iter().position(|n| n == name).ok_or_else(|| PlanError::Reference {
            place: place.0.clone(),
            key,
            name: name.into(),
            kind: "measured or earlier",
            known: if self.0.is_empty() { "none".into() } else { self.0.join(", ") },
        })
    }

    /// Different names as indices.
    pub fn several(
        &self,
        place: &Within,
        key: &'static str,
        names: &[String],
    ) -> Result<Vec<usize>, PlanError> {
        let mut found = Vec::with_capacity(names.len());
        for name in names {
            let index = self.one(place, key, name)?;
            if found.contains(&index) {
                return Err(
                    place.refuse(format!("{key} names \"{name}\" twice: an element and itself fix nothing"))
                );
            }
            found.push(index);
        }
        if found.is_empty() {
            return Err(place.refuse(format!("{key} is empty; name at least one element")));
        }
        Ok(found)
    }
}

/// Checks the datum systems.
pub(super) fn datum_systems(raw: Vec<RawDatumSystem>, plan: &Plan) -> Result<Vec<DatumSystem>, PlanError> {
    let names = Names::of(plan);
    let mut systems = Vec::with_capacity(raw.len());
    for system in raw {
        let place = Within(format!("datum_system \"{}\"", system.name));
        let mut steps = Vec::new();
        for datum in &system.datums {
            steps.push(match datum {
                RawDatum::One(name) => vec![names.one(&place, "datums", name)?],
                RawDatum::Common(list) => names.several(&place, "datums", list)?,
            });
        }
        let mut all: Vec<usize> = steps.iter().flatten().copied().collect();
        all.sort_unstable();
        if let Some(twice) = all.windows(2).find(|w| w[0] == w[1]) {
            let name = plan.element_name(twice[0]);
            return Err(
                place.refuse(format!("datums names \"{name}\" twice: it fixes nothing the second time"))
            );
        }
        if steps.is_empty() {
            return Err(place.refuse("datums is empty; name at least one element".into()));
        }
        systems.push(DatumSystem { name: system.name, steps });
    }
    unique("datum system", systems.iter().map(|s| s.name.as_str()))?;
    Ok(systems)
}

/// Refuses characteristics that depend on a motion which their datums leave open.
pub(super) fn check_open_motions(plan: &Plan) -> Result<(), PlanError> {
    let nominal = nominal_parts(plan);
    for feature in &plan.features {
        let Quantity::Characteristic { index, .. } = feature.quantity else { continue };
        let one = &plan.characteristics[index];
        let (Some(system), Kind::Position(_) | Kind::Profile) = (one.datums, &one.kind) else {
            continue;
        };
        let place = Within(format!("feature \"{}\"", feature.name));
        let system = &plan.datum_systems[system];
        let steps: Result<Vec<Vec<Substitute>>, String> =
            system.steps.iter().map(|step| super::joint::pick(&nominal, step)).collect();
        let steps = steps.map_err(|why| place.refuse(why))?;
        let frame = fix(&steps, &steps).map_err(|why| place.refuse(why))?;
        let element = nominal[one.elements[0]].clone().map_err(|why| place.refuse(why))?;
        for motion in &frame.open {
            let there = carried(&element, &frame.motion(&motion.map(|m| 1e-3 * m)));
            let turned = (there.direction - element.direction).norm() * frame.extent_mm;
            let flat = if element.shape == Shape::Plane { turned } else { 0.0 };
            let moved = largest_offset_mm(one, &element, &there).max(flat);
            if moved > 1e-5 {
                return Err(place.refuse(format!(
                    "datums {} leave open: {}; the {} of \"{}\" depends on it; add a datum that fixes it",
                    system.letters(&|i| plan.element_name(i)),
                    frame.open_words(),
                    one.name,
                    plan.element_name(one.elements[0])
                )));
            }
        }
    }
    Ok(())
}
