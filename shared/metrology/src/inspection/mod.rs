//! From the fused cloud to features, uncertainties and a verdict.
//!
//! [`Plan`] states in the part frame which elements lie where and what is measured between them. [`evaluate`] finds the
//! part in the cloud (3-2-1 on datum elements, from a coarse search that shrinks), fits each element on its region,
//! computes the features with standard uncertainties from the elements' covariances, and decides by ISO 14253-1.
//! What cannot be measured has a reason and is never passed.

mod align;
mod check;
mod error;
mod evaluate;
mod filter;
mod fit_element;
mod flatness;
mod place;
mod plan;
mod raw;
mod region;
mod result;
#[cfg(test)]
mod tests;

pub use error::MeasureError;
pub use evaluate::{deviations, evaluate, locate};
pub use filter::{Filtered, filtered as filtered_flatness};
pub use place::{PlaceError, Placement, place};
pub use plan::{
    Datums, Element, Exclusion, ExclusionShape, Feature, Geometry, PLAN_FORMAT, Plan, PlanError, Quantity,
    Settings, Unit,
};
pub use raw::RawPlan;
pub use result::{
    AlignmentResult, DeviationPoint, ElementResult, FeatureResult, FittedElement, FlatnessFilter,
    InspectionResult,
};
