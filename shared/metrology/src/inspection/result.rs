//! What an inspection found.

use nalgebra::{Isometry3, Matrix3, Vector3};
use serde::Serialize;

use super::verdict::Verdict;
use crate::fit::{PlaneFit, SphereFit};
use fringe::geometry::pose::Pose;

/// The whole result.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InspectionResult {
    /// Name of the plan.
    pub plan: String,
    /// Verdict over all features: `fail` if one fails, `pass` if all pass, else `indeterminate`.
    pub verdict: Verdict,
    /// Where the part was found; `None` when it was not, and then `alignment_failure` says why.
    pub alignment: Option<AlignmentResult>,
    /// Why the part was not found.
    pub alignment_failure: Option<String>,
    /// Elements in the order of the plan.
    pub elements: Vec<ElementResult>,
    /// Features in the order of the plan.
    pub features: Vec<FeatureResult>,
}

/// Where the part was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlignmentResult {
    /// X_world = R X_part + t: rows of R.
    pub rotation: [[f64; 3]; 3],
    /// t, mm.
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
        let rotation = Matrix3::from_row_slice(self.rotation.as_flattened());
        Pose { rotation, translation: Vector3::from(self.translation_mm) }.isometry()
    }
}

/// A fitted element, in the part frame as found.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FittedElement {
    /// A sphere.
    Sphere(SphereFit),
    /// A plane; its normal points out of the material.
    Plane(PlaneFit),
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
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ElementResult {
    /// Name.
    pub name: String,
    /// The fit.
    pub fit: Option<FittedElement>,
    /// Why there is none.
    pub reason: Option<String>,
    /// Points of the region, for pictures of deviations.
    #[serde(skip)]
    pub points: Vec<DeviationPoint>,
}

/// What the filter of a flatness did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FlatnessFilter {
    /// What the value is, in words.
    pub definition: &'static str,
    /// Nesting index: edge of the cells, mm.
    pub filter_mm: f64,
    /// Cells behind the value.
    pub cells: usize,
    /// Cells with some points, but too few in one of their quarters.
    pub cells_left_out: usize,
    /// Points in them.
    pub points_left_out: usize,
    /// Fewest points of each quarter of a cell: a sixteenth of the median over the cells that hold any, and at least 2.
    pub fewest_points: usize,
    /// Standard uncertainty of a cell's mean, root mean square over the cells, mm.
    pub u_cell_mm: f64,
    /// Range that noise alone would show on a perfect plane, mm: the value is too large by zero up to this much.
    pub noise_range_mm: f64,
}

/// A feature: value, uncertainty, verdict, or the reason why there is none.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FeatureResult {
    /// Name.
    pub name: String,
    /// Value in `unit`.
    pub value: Option<f64>,
    /// "mm" or "deg".
    pub unit: &'static str,
    /// Standard uncertainty: `u_noise` and the plan's `u_system` in squares.
    pub u: Option<f64>,
    /// Lower limit of the value.
    pub lower: f64,
    /// Upper limit of the value.
    pub upper: f64,
    /// Decision by ISO 14253-1.
    pub verdict: Verdict,
    /// Nominal value.
    pub nominal: f64,
    /// Value less nominal.
    pub deviation: Option<f64>,
    /// Standard uncertainty from the scatter of the points alone (correlation within cells included).
    pub u_noise: Option<f64>,
    /// Standard uncertainty that the plan states for everything that scatter does not show.
    pub u_system: f64,
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
    pub reason: Option<String>,
}

impl FeatureResult {
    /// Of a flatness: its definition, what the filter did, and what the single points show. Lengths in mm.
    pub fn detail(&self) -> Option<String> {
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
