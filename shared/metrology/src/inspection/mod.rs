//! From the fused cloud to features, uncertainties and a verdict.
//!
//! [`Plan`] states in the part frame which elements lie where and what is measured between them. [`evaluate`] finds the
//! part in the cloud (3-2-1 on datum elements, from a coarse search that shrinks), fits each element on its region,
//! computes the features with standard uncertainties from the elements' covariances, and decides by ISO 14253-1.
//! What cannot be measured has a reason and is never passed.

mod align;
mod associate;
mod beyond;
mod bounds;
mod cad_face;
mod characteristic;
mod check;
mod check_characteristics;
mod check_datums;
mod check_elements;
mod check_geometry;
mod constructed;
mod criterion;
mod datum;
mod draft;
mod error;
mod evaluate;
mod extracted;
mod filter;
mod fit_element;
mod fitted_element;
mod flatness;
mod gather;
mod geometry;
mod joint;
mod location;
mod nominal_surface;
mod place;
mod plan;
mod raw;
mod raw_elements;
mod raw_features;
mod reading;
mod references;
mod region;
mod result;
mod shift;
mod sight;
mod stretch;
mod substitute;
#[cfg(test)]
mod tests;
mod within;

pub use cad_face::CadParts;
pub use characteristic::{Characteristic, Extracted, Kind, MaximumMaterial};
pub use criterion::Criterion;
pub use draft::{DraftSettings, Found, draft};
pub use error::MeasureError;
pub use evaluate::{deviations, evaluate, locate};
pub use filter::{Across, Filtered, filtered as filtered_flatness};
pub use fitted_element::FittedElement;
pub use geometry::{Exclusion, ExclusionShape, Geometry, Sector};
pub use nominal_surface::{NominalSurface, SurfaceFit, Surfaces};
pub use place::{PlaceError, Placement, place};
pub use plan::{Datums, Element, Feature, PLAN_FORMAT, Plan, PlanError, Quantity, Settings, Unit};
pub use raw::{RawPlan, SurfaceFile};
pub use references::{Constructed, Construction, DatumSystem};
pub use result::{
    AlignmentResult, ConstructedResult, DeviationPoint, ElementResult, FeatureResult, FlatnessFilter,
    InspectionResult,
};
