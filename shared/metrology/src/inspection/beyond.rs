//! Material over an element that its margin leaves out: a boss on a plate, half of a face a millimetre too high.
//!
//! The margin keeps other faces out of an element's region, and with them whatever is wrong by more. Points over the element's extent that face its
//! way, lie between one margin and [`REACH_MARGINS`] from it, and belong to no other element are counted: a value that rests on such an element
//! proves nothing about its face, so it does not pass.

use super::fit_element::{Measured, REACH_MARGINS};
use super::geometry::Geometry;
use super::joint::Joint;
use super::plan::{Element, Plan, Quantity};
use super::region::Region;
use std::collections::BTreeSet;

/// Fewest points, and the least part of the element's own, that count: fewer are dust, or what stray light leaves.
const LEAST_POINTS: usize = 50;
const LEAST_SHARE: f64 = 0.01;

/// The region whose points beside an element's own are counted; none of outlines, lines and points, beside which the part goes on.
pub(super) fn reach(region: &Region) -> Option<Region> {
    let goes_on = region.geometry.is_outlined() || matches!(region.geometry, Geometry::Point { .. });
    (!goes_on).then(|| region.widened(REACH_MARGINS))
}

/// For each element what a person should know of the material beside it; `None` where there is hardly any.
pub(super) fn told(plan: &Plan, measured: &[Result<Measured, String>]) -> Vec<Option<String>> {
    let of = |index: usize| measured[index].as_ref().ok();
    let belongs = |number: &u32, but: usize| {
        let mut others = (0..measured.len()).filter(|other| *other != but).filter_map(of);
        others.any(|other| other.points.binary_search_by_key(number, |point| point.index).is_ok())
    };
    let one = |(index, element): (usize, &Element)| {
        let found = of(index)?;
        let least = LEAST_POINTS.max((LEAST_SHARE * found.points.len() as f64) as usize);
        if found.beside.len() < least {
            return None;
        }
        let count = found.beside.iter().filter(|number| !belongs(number, index)).count();
        (count >= least).then(|| {
            format!(
                "{count} points over element \"{}\" face its way, but lie {} to {} mm from it, beyond its margin_mm: the face is damaged there, or another one lies so near; \
                 look at the part, then widen margin_mm, or cut them out with `exclude`",
                element.name,
                element.margin_mm,
                REACH_MARGINS * element.margin_mm
            )
        })
    };
    plan.elements.iter().enumerate().map(one).collect()
}

/// The elements that a quantity rests on.
pub(super) fn elements_of(plan: &Plan, quantity: &Quantity, joint: Option<&Joint<'_>>) -> BTreeSet<usize> {
    match (quantity, joint) {
        (Quantity::SphereDiameter(one) | Quantity::PlaneFlatness { plane: one, .. }, _) => [*one].into(),
        (
            Quantity::CentreDistance(two)
            | Quantity::PlaneDistance(two)
            | Quantity::PlaneAngle { planes: two, .. },
            _,
        ) => (*two).into(),
        (Quantity::HemisphereHeight { sphere, plane }, _) => [*sphere, *plane].into(),
        (Quantity::Characteristic { index, .. }, Some(joint)) => {
            joint.sources(&plan.characteristics[*index], true)
        }
        (Quantity::Characteristic { .. }, None) => BTreeSet::new(),
    }
}
