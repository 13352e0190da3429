//! The inspection plan: what is measured where on the part, and what it may be.
//!
//! As written it is a [`RawPlan`](super::RawPlan) that refuses unknown keys; [`Plan::new`]
//! checks it and turns names into indices, degrees into radians, deviations into limits.

use fringe::geometry::viewpoint::Viewpoints;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::fmt;
use thiserror::Error;

use super::characteristic::Characteristic;
use super::criterion::Criterion;
use super::geometry::Geometry;
use super::references::{Constructed, DatumSystem};

/// The format this build reads.
pub const PLAN_FORMAT: &str = "fringecell-plan/1";

/// What is wrong with a plan.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum PlanError {
    /// A table whose values do not go together.
    #[error("{place}: {message}")]
    Part {
        /// Element or feature with its name, or table.
        place: String,
        /// The fault and its remedy.
        message: String,
    },
    /// Another format or version.
    #[error("format = \"{0}\", this program reads \"{PLAN_FORMAT}\"")]
    Format(String),
    /// A number out of range.
    #[error("{place}: {key} = {value}, must be {limits}")]
    Value {
        /// Element or feature with its name, or table.
        place: String,
        /// Key of the number in the plan.
        key: &'static str,
        /// The value as written.
        value: f64,
        /// What it must be.
        limits: &'static str,
    },
    /// A name that is used twice, or empty.
    #[error("{what} name \"{name}\" is empty or used twice; each {what} needs a name of its own")]
    Name {
        /// What is named: "element" or "feature".
        what: &'static str,
        /// The name as written.
        name: String,
    },
    /// A reference to an element that is not there or is of another kind.
    #[error("{place}: {key} names \"{name}\", but the plan's {kind} elements are: {known}")]
    Reference {
        /// The feature or table that refers to the element.
        place: String,
        /// Key of the reference in the plan.
        key: &'static str,
        /// The name as written.
        name: String,
        /// Kind of element that is wanted.
        kind: &'static str,
        /// Names that would do.
        known: String,
    },
    /// Datums that do not fix the part.
    #[error("alignment: {0}")]
    Datum(&'static str),
    /// No element or no feature.
    #[error("the plan has no [[{0}]]: nothing would be inspected")]
    Empty(&'static str),
}

impl PlanError {
    /// The table, such as `element "top"`, and the key of it where the fault lies; both may be empty.
    pub fn place(&self) -> (&str, &str) {
        match self {
            Self::Value { place, key, .. } | Self::Reference { place, key, .. } => (place, key),
            Self::Part { place, .. } => (place, ""),
            Self::Name { what, .. } | Self::Empty(what) => (what, ""),
            Self::Datum(_) => ("alignment", ""),
            Self::Format(_) => ("format", ""),
        }
    }
}

/// Settings of the whole inspection.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Guard band in standard uncertainties (ISO 14253-1). 1.65 leaves 5 % risk at one limit.
    pub guard_factor: f64,
    /// Cells within which noise may be correlated, mm; left out, the correlation is estimated from the residuals (see
    /// [`crate::fit::Correlation`]).
    pub cluster_mm: Option<f64>,
}

impl Default for Settings {
    fn default() -> Self {
        Self { guard_factor: 1.65, cluster_mm: None }
    }
}

/// How the part is found in the cloud: 3-2-1.
///
/// The plane's normal becomes the direction of its nominal normal and fixes the height; the line between two sphere
/// centres, seen along the normal, fixes the turn about it; the origin sphere's centre fixes the place across.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Datums {
    /// Index of the plane element.
    pub plane: usize,
    /// Indices of two sphere elements.
    pub line: [usize; 2],
    /// Index of a sphere element.
    pub origin: usize,
    /// How far a datum surface may lie from its nominal place at the start, mm.
    pub search_mm: f64,
    /// How far the part may be turned at the start, rad.
    pub search_rad: f64,
}

/// An element that is fitted on a region of the cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Element {
    /// Name, unique among the elements.
    pub name: String,
    /// Nominal geometry in the part frame.
    pub geometry: Geometry,
    /// How far a point of the element may lie from the surface, mm.
    pub margin_mm: f64,
    /// Largest angle between the normal of a point and that of the surface, rad. `None`: normals are not looked at.
    pub normal_tolerance_rad: Option<f64>,
    /// Fewest points that a fit needs.
    pub min_points: usize,
    /// Fraction of the points left out of the fit.
    pub max_reject_fraction: f64,
    /// How the element is associated with its points.
    pub criterion: Criterion,
}

/// What a feature measures; the numbers are indices of elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// Diameter of the least-squares sphere.
    SphereDiameter(usize),
    /// Distance between the centres of two least-squares spheres.
    CentreDistance([usize; 2]),
    /// Peak-to-valley flatness about the least-squares plane (FLTt, LSPL of ISO 12781-1).
    PlaneFlatness {
        /// Index of the plane element.
        plane: usize,
        /// Nesting index, mm: the range is that of the means over squares of this edge, about the least-squares plane
        /// of the means. The squares lie along the element's directions from its nominal point; those with fewer than
        /// [`FlatnessFilter::fewest_points`](super::FlatnessFilter::fewest_points) points in one of their quarters are
        /// left out. A wave of 1.66 edges passes by half.
        /// `None`: the range is that of the single points, after the element's stated rejection; it then measures
        /// their noise and their number more than the form.
        filter_mm: Option<f64>,
    },
    /// From the first plane to the centroid of the points of the second, along the first plane's normal.
    PlaneDistance([usize; 2]),
    /// Angle between the normals of two planes; the supplement to 180° when `supplement` is set.
    PlaneAngle {
        /// Indices of the two plane elements.
        planes: [usize; 2],
        /// Whether the supplement is meant.
        supplement: bool,
    },
    /// Top of a sphere over a plane: distance of its centre from the plane plus its radius.
    HemisphereHeight {
        /// Index of the sphere element.
        sphere: usize,
        /// Index of the plane element.
        plane: usize,
    },
    /// A geometrical characteristic: index among [`Plan::characteristics`].
    Characteristic {
        /// Index among the plan's characteristics.
        index: usize,
        /// Unit of its values.
        unit: Unit,
        /// Whether no value lies below zero, so that there is no lower limit to prove.
        one_sided: bool,
    },
}

impl Quantity {
    /// Unit of the values of this quantity.
    pub fn unit(&self) -> Unit {
        match self {
            Self::PlaneAngle { .. } => Unit::Deg,
            Self::Characteristic { unit, .. } => *unit,
            _ => Unit::Mm,
        }
    }

    /// Whether no value lies below zero, so that there is no lower limit to prove.
    pub fn one_sided(&self) -> bool {
        matches!(self, Self::PlaneFlatness { .. } | Self::Characteristic { one_sided: true, .. })
    }
}

/// Unit of a feature's values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Millimetre, for lengths and forms.
    #[default]
    Mm,
    /// Degree, the unit of angles.
    Deg,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Mm => "mm",
            Self::Deg => "deg",
        })
    }
}

/// A feature with its tolerance, in the unit of its quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Feature {
    /// Name, unique among the features.
    pub name: String,
    /// The quantity and its elements.
    pub quantity: Quantity,
    /// Nominal value; 0 for a flatness.
    pub nominal: f64,
    /// Lower limit of the value; 0 for a flatness, where no value can fall below it.
    pub lower: f64,
    /// Upper limit of the value.
    pub upper: f64,
    /// Standard uncertainty that the scatter of the points does not show: temperature, artefact, and the calibration where nothing else
    /// states it.
    pub u_system: f64,
    /// Standard uncertainty by the calibration of the rig, which no plan states; `None`: not known.
    pub u_calibration: Option<f64>,
}

/// A checked inspection plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Name of the plan.
    pub name: String,
    /// Settings of the evaluation.
    pub settings: Settings,
    /// Where the part nominally lies.
    pub world_from_part: Isometry3<f64>,
    /// How it is found; `None`: it lies where it nominally lies.
    pub datums: Option<Datums>,
    /// Elements in the order of the plan.
    pub elements: Vec<Element>,
    /// Elements made of others, in the order of the plan; references count on after the measured ones.
    pub constructed: Vec<Constructed>,
    /// Datum systems, in the order of the plan.
    pub datum_systems: Vec<DatumSystem>,
    /// Geometrical characteristics behind features of their kind.
    pub characteristics: Vec<Characteristic>,
    /// Features in the order of the plan.
    pub features: Vec<Feature>,
    /// Of clouds of cameras: pixels that were left out at the rims of faces; `None` where nothing is known of them.
    pub rims_left_out_px: Option<u32>,
    /// Of clouds of cameras: whence each pair saw its points, in the frame of the cloud; empty where it is not known.
    pub viewpoints: Vec<Option<Viewpoints>>,
}

impl Plan {
    /// The same plan with the standard uncertainty by the calibration of the rig for each feature, in the order and unit of the features.
    #[must_use]
    pub fn with_calibration(mut self, shares: &[Option<f64>]) -> Self {
        for (feature, share) in self.features.iter_mut().zip(shares) {
            feature.u_calibration = *share;
        }
        self
    }

    /// The same plan for clouds of cameras of which so many pixels were left out at the rims of faces (`edge_px` of the reconstruction): their outlines lie
    /// as much further out.
    #[must_use]
    pub fn with_rims_left_out(mut self, pixels: u32) -> Self {
        self.rims_left_out_px = Some(pixels);
        self
    }

    /// The same plan for clouds that were seen from there, a place for each pair by its number: elements are freed of what noise along the lines of sight
    /// does to them ([`crate::fit::PointNoise`]), and curved ones measured without the points near their limbs.
    #[must_use]
    pub fn with_viewpoints(mut self, viewpoints: Vec<Option<Viewpoints>>) -> Self {
        self.viewpoints = viewpoints;
        self
    }

    /// Name of an element, measured or constructed; empty for none.
    pub fn element_name(&self, index: usize) -> &str {
        let made = index.checked_sub(self.elements.len()).and_then(|i| self.constructed.get(i));
        self.elements.get(index).map(|e| &e.name).or(made.map(|c| &c.name)).map_or("", String::as_str)
    }
}
