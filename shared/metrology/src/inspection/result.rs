//! What an inspection found.

use nalgebra::{Isometry3, Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

use super::criterion::Criterion;
use super::fitted_element::FittedElement;
use super::plan::Unit;
use crate::verdict::Verdict;
use fringe::geometry::pose::Pose;

/// The result of an inspection.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct InspectionResult {
    /// Name of the plan.
    pub plan: String,
    /// Verdict over all features: `fail` if one fails, `pass` if all pass, else `indeterminate`.
    pub verdict: Verdict,
    /// Where the part was found; `None` when it was not, and then `alignment_failure` states why.
    pub alignment: Option<AlignmentResult>,
    /// Why the part was not found.
    pub alignment_failure: Option<String>,
    /// Elements in the order of the plan.
    pub elements: Vec<ElementResult>,
    /// Elements made of others, in the order of the plan.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub constructed: Vec<ConstructedResult>,
    /// Features in the order of the plan.
    pub features: Vec<FeatureResult>,
}

/// Where the part was found.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlignmentResult {
    /// X_world = R X_part + t: rows of R.
    pub rotation: [[f64; 3]; 3],
    /// Translation vector t, mm.
    pub translation_mm: [f64; 3],
    /// Largest shift of a datum element against its nominal place, mm.
    pub offset_mm: f64,
    /// Turn against the nominal placement, deg.
    pub angle_deg: f64,
    /// Measured less nominal distance of the two datum spheres, mm (what 3-2-1 cannot make agree).
    pub line_residual_mm: f64,
    /// Rounds until the pose stood still; 0 when the plan has no alignment.
    pub rounds: usize,
}

impl AlignmentResult {
    /// The pose as a motion.
    pub fn world_from_part(&self) -> Isometry3<f64> {
        self.pose().isometry()
    }

    pub(super) fn pose(&self) -> Pose {
        let rotation = Matrix3::from_row_slice(self.rotation.as_flattened());
        Pose { rotation, translation: Vector3::from(self.translation_mm) }
    }
}

/// A point of the cloud that belongs to an element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeviationPoint {
    /// Index in the cloud.
    pub index: u32,
    /// Signed distance from the fitted element, mm; positive out of the material.
    pub from_fit_mm: f32,
    /// Signed distance from the nominal element in the part as found, mm; positive out of the material.
    pub from_nominal_mm: f32,
}

/// An element: found, or the reason why not.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ElementResult {
    /// Name of the element in the plan.
    pub name: String,
    /// The fitted element; absent when the fit failed.
    pub fit: Option<FittedElement>,
    /// Why there is none.
    pub reason: Option<String>,
    /// How it was associated, where not by least squares.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criterion: Option<Criterion>,
    /// Why values that rest on it do not pass, where material over it lies beyond its margin.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond: Option<String>,
    /// Points of the region, for pictures of deviations.
    #[serde(skip)]
    pub points: Vec<DeviationPoint>,
}

/// An element made of others: where it is, or the reason why it is not.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ConstructedResult {
    /// Name of the element in the plan.
    pub name: String,
    /// What it is: point, line, plane, circle.
    pub shape: Option<Cow<'static, str>>,
    /// A point of it, mm in the part frame.
    pub point_mm: Option<[f64; 3]>,
    /// Its unit direction or normal; absent of a point.
    pub direction: Option<[f64; 3]>,
    /// Its diameter, of a circle, mm.
    pub diameter_mm: Option<f64>,
    /// Why there is none.
    pub reason: Option<String>,
}

/// What the filter of a flatness did.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FlatnessFilter {
    /// What the value is, in words.
    pub definition: Cow<'static, str>,
    /// Nesting index: edge of the cells, mm.
    pub filter_mm: f64,
    /// Cells behind the value.
    pub cells: usize,
    /// Cells with some points, but too few in one of their quarters.
    pub cells_left_out: usize,
    /// Points in the cells that were left out.
    pub points_left_out: usize,
    /// Fewest points of each quarter of a cell: a sixteenth of the median over the cells that hold any, and at least 2.
    pub fewest_points: usize,
    /// Standard uncertainty of a cell's mean, root mean square over the cells, mm.
    pub u_cell_mm: f64,
    /// Range that noise alone would show on a perfect plane, mm: the value is too large by zero up to this much.
    pub noise_range_mm: f64,
}

/// A feature: value, uncertainty, verdict, or the reason why there is none. The same in messages, files and reports.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FeatureResult {
    /// Name of the feature in the plan.
    pub name: String,
    /// Measured value in `unit`; absent when nothing was measured.
    pub value: Option<f64>,
    /// Of all its values.
    pub unit: Unit,
    /// Standard uncertainty: `u_noise`, `u_system` and `u_calibration` in squares.
    pub u: Option<f64>,
    /// Lower limit of the value; `None` where the plan sets none.
    pub lower: Option<f64>,
    /// Upper limit of the value.
    pub upper: Option<f64>,
    /// Decision by ISO 14253-1; `None` without a value.
    pub verdict: Option<Verdict>,
    /// Nominal value in `unit`.
    pub nominal: f64,
    /// Value less nominal, in `unit`.
    pub deviation: Option<f64>,
    /// Standard uncertainty from the scatter of the points alone (correlation within cells included).
    pub u_noise: Option<f64>,
    /// Standard uncertainty that the plan states for everything that scatter does not show.
    pub u_system: f64,
    /// Standard uncertainty by the calibration of the rig; `None`: not part of `u`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_calibration: Option<f64>,
    /// Of a flatness: sample standard deviation of the residuals of the points used, unfiltered, mm.
    pub form_sigma_mm: Option<f64>,
    /// Of a flatness: range of the residuals of the points used, unfiltered, mm; the value itself without a filter.
    pub form_range_mm: Option<f64>,
    /// Of a filtered flatness: what the filter did.
    pub filter: Option<FlatnessFilter>,
    /// Points behind the value.
    pub points: usize,
    /// Points rejected by the stated fractions.
    pub rejected: usize,
    /// Why it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// How the value is defined and what else was seen, where the name does not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub detail: Option<String>,
}

impl FeatureResult {
    /// Whether the plan sets a limit.
    pub fn has_limits(&self) -> bool {
        self.lower.is_some() || self.upper.is_some()
    }

    /// The same with its detail.
    #[must_use]
    pub(super) fn described(mut self) -> Self {
        self.detail = self.detail.take().or_else(|| self.flatness_detail());
        self
    }

    /// Of a flatness: its definition, what the filter did, and what the single points show. Lengths in mm.
    fn flatness_detail(&self) -> Option<String> {
        let (range_mm, sigma_mm) = (self.form_range_mm?, self.form_sigma_mm?);
        let unfiltered = format!("single points: range {range_mm:.4} mm, sigma {sigma_mm:.4} mm");
        let Some(filter) = &self.filter else {
            return Some(format!(
                "range of the points used about their least-squares plane, unfiltered; {unfiltered}"
            ));
        };
        let FlatnessFilter {
            definition,
            filter_mm,
            fewest_points,
            cells,
            cells_left_out,
            points_left_out,
            ..
        } = filter;
        Some(format!(
            "{definition}; filter_mm {filter_mm}, fewest_points {fewest_points}: {cells} squares, left out \
             {cells_left_out} with {points_left_out} points; a mean is uncertain by {:.4} mm, a perfect plane would \
             show {:.4} mm; {unfiltered}",
            filter.u_cell_mm, filter.noise_range_mm
        ))
    }
}
