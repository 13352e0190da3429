//! All elements of a plan together, measured and constructed, and the propagation of their covariances.
//!
//! A value is a function of the measured elements' charts. Each chart is moved by one standard deviation along the
//! columns of its covariance's root, both ways; half the difference is the value's change by that column, and the squares
//! add up, because elements come from different points.

use nalgebra::{Point3, SMatrix, SVector};
use std::collections::BTreeSet;

use super::characteristic::Characteristic;
use super::constructed::construct;
use super::datum::{Frame, fix};
use super::fit_element::Measured;
use super::plan::Plan;
use super::substitute::{Substitute, roots};
use crate::fit::{CHART, Residuals};

/// An element or the reason why there is none.
pub type Part = Result<Substitute, String>;

/// A function of the elements of a plan with N values, or why it has none.
pub type OfParts<'a, const N: usize> = dyn Fn(&[Part]) -> Result<[f64; N], String> + 'a;

/// A measured element with what its uncertainty and its points are.
pub struct Base<'a> {
    /// The element, or why there is none.
    pub part: Part,
    /// Columns of its covariance's root.
    roots: Vec<SVector<f64, CHART>>,
    /// Points of the fit in the part frame.
    pub points: &'a [Point3<f64>],
    /// Residuals of these points.
    pub residuals: Option<&'a Residuals>,
    /// The fit with its points.
    pub measured: Option<&'a Measured>,
}

impl Base<'_> {
    /// Positions of the points used with their residuals.
    pub fn used(&self) -> impl Iterator<Item = (&Point3<f64>, f64)> {
        let empty: (&[f64], &[bool]) = (&[], &[]);
        let (deviations, used) = self.residuals.map_or(empty, |r| (&r.deviation_mm[..], &r.used[..]));
        self.points.iter().zip(deviations).zip(used).filter(|(_, used)| **used).map(|((p, d), _)| (p, *d))
    }
}

/// Elements of a plan as measured on a cloud.
pub struct Joint<'a> {
    /// The plan with its nominal geometry.
    pub plan: &'a Plan,
    /// Measured elements in the order of the plan.
    pub base: Vec<Base<'a>>,
    /// Nominal elements, measured and constructed.
    pub nominal: Vec<Part>,
}

/// Nominal elements of a plan: those of the geometry, then the constructed ones.
pub fn nominal_parts(plan: &Plan) -> Vec<Part> {
    let mut parts: Vec<Part> = plan.elements.iter().map(|e| Ok(Substitute::nominal(&e.geometry))).collect();
    add_constructed(plan, &mut parts);
    parts
}

/// Appends the constructed elements, each of what stands before it.
fn add_constructed(plan: &Plan, parts: &mut Vec<Part>) {
    for one in &plan.constructed {
        let from: Result<Vec<Substitute>, String> = one.elements.iter().map(|i| parts[*i].clone()).collect();
        let made = from.and_then(|from| {
            construct(one.construction, &from).map_err(|why| format!("element {}: {why}", one.name))
        });
        parts.push(made);
    }
}

/// The elements of an index list, or the reason why one is missing.
pub fn pick(parts: &[Part], indices: &[usize]) -> Result<Vec<Substitute>, String> {
    indices.iter().map(|i| parts[*i].clone()).collect()
}

impl<'a> Joint<'a> {
    /// From the outcome of each element's fit.
    pub fn new(plan: &'a Plan, outcomes: &'a [Result<Measured, String>]) -> Self {
        let nominal = nominal_parts(plan);
        let base = outcomes
            .iter()
            .zip(&nominal)
            .map(|(outcome, nominal)| match (outcome, nominal) {
                (Ok(measured), Ok(nominal)) => {
                    let (part, chart) = Substitute::fitted(&measured.fit, nominal);
                    Base {
                        part: Ok(part),
                        roots: roots(&chart),
                        points: &measured.positions,
                        residuals: Some(measured.fit.residuals()),
                        measured: Some(measured),
                    }
                }
                (Err(why), _) | (_, Err(why)) => {
                    let part = Err(why.clone());
                    Base { part, roots: Vec::new(), points: &[], residuals: None, measured: None }
                }
            })
            .collect();
        Self { plan, base, nominal }
    }

    /// All elements, from given measured ones.
    pub fn parts(&self, base: Vec<Part>) -> Vec<Part> {
        let mut parts = base;
        add_constructed(self.plan, &mut parts);
        parts
    }

    /// All elements as measured.
    pub fn measured(&self) -> Vec<Part> {
        self.parts(self.base.iter().map(|b| b.part.clone()).collect())
    }

    /// The frame of a datum system for given elements.
    pub fn frame(&self, system: usize, parts: &[Part]) -> Result<Frame, String> {
        let system = &self.plan.datum_systems[system];
        let of = |parts: &[Part]| -> Result<Vec<Vec<Substitute>>, String> {
            system.steps.iter().map(|step| pick(parts, step)).collect()
        };
        fix(&of(&self.nominal)?, &of(parts)?).map_err(|why| format!("datum system {}: {why}", system.name))
    }

    /// Measured elements that a characteristic hangs on.
    pub fn sources(&self, one: &Characteristic, with_elements: bool) -> BTreeSet<usize> {
        let mut wanted: Vec<usize> = if with_elements { one.elements.clone() } else { Vec::new() };
        if let Some(system) = one.datums {
            wanted.extend(self.plan.datum_systems[system].steps.iter().flatten());
        }
        let mut found = BTreeSet::new();
        while let Some(index) = wanted.pop() {
            match index.checked_sub(self.plan.elements.len()) {
                None => {
                    found.insert(index);
                }
                Some(made) => wanted.extend(&self.plan.constructed[made].elements),
            }
        }
        found
    }

    /// Values of a function of the elements, with their covariance.
    ///
    /// # Errors
    /// The function's, at the measured elements or next to them.
    pub fn propagated<const N: usize>(
        &self,
        sources: &BTreeSet<usize>,
        value: &OfParts<'_, N>,
    ) -> Result<([f64; N], SMatrix<f64, N, N>), String> {
        let here = value(&self.measured())?;
        let mut covariance = SMatrix::<f64, N, N>::zeros();
        for source in sources {
            let Ok(part) = &self.base[*source].part else { continue };
            for column in &self.base[*source].roots {
                let at = |sign: f64| {
                    let mut base: Vec<Part> = self.base.iter().map(|b| b.part.clone()).collect();
                    base[*source] = Ok(part.moved(&(column * sign)));
                    value(&self.parts(base)).map(SVector::<f64, N>::from)
                };
                let change = (at(1.0)? - at(-1.0)?) * 0.5;
                covariance += change * change.transpose();
            }
        }
        Ok((here, covariance))
    }
}
