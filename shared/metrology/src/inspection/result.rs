//! What an inspection found.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

use super::criterion::Criterion;
use super::geometry::Geometry;
use super::nominal_surface::SurfaceFit;
use super::plan::Unit;
use crate::fit::{
    ConeFit, ContourFit, CylinderFit, Form, PlaneFit, PointFit, Residuals, SphereFit, TorusFit,
};
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

/// A fitted element, in the part frame as found. All its numbers are finite.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum FittedElement {
    /// A sphere with its form and uncertainties.
    Sphere(SphereFit),
    /// A plane; its normal points out of the material.
    Plane(PlaneFit),
    /// A cylinder with its axis.
    Cylinder(CylinderFit),
    /// A cone with its axis.
    Cone(ConeFit),
    /// A torus with its axis.
    Torus(TorusFit),
    /// A circle at the border of a plane.
    Circle(ContourFit),
    /// A slot at the border of a plane.
    Slot(ContourFit),
    /// A rectangle at the border of a plane.
    Rectangle(ContourFit),
    /// A straight border of a plane.
    Edge(ContourFit),
    /// A straight line of a surface in its section.
    Line(ContourFit),
    /// A freeform surface of CAD data.
    Surface(SurfaceFit),
    /// A point of a surface.
    Point(PointFit),
}

/// One expression for each kind of fit.
macro_rules! each {
    ($fit:expr, $name:ident => $value:expr) => {
        match $fit {
            FittedElement::Sphere($name) => $value,
            FittedElement::Plane($name) => $value,
            FittedElement::Cylinder($name) => $value,
            FittedElement::Cone($name) => $value,
            FittedElement::Torus($name) => $value,
            FittedElement::Circle($name)
            | FittedElement::Slot($name)
            | FittedElement::Rectangle($name)
            | FittedElement::Edge($name)
            | FittedElement::Line($name) => $value,
            FittedElement::Surface($name) => $value,
            FittedElement::Point($name) => $value,
        }
    };
}

impl FittedElement {
    /// The kind of element as files and reports name it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Sphere(_) => "sphere",
            Self::Plane(_) => "plane",
            Self::Cylinder(_) => "cylinder",
            Self::Cone(_) => "cone",
            Self::Torus(_) => "torus",
            Self::Circle(_) => "circle",
            Self::Slot(_) => "slot",
            Self::Rectangle(_) => "rectangle",
            Self::Edge(_) => "edge",
            Self::Line(_) => "line",
            Self::Surface(_) => "surface",
            Self::Point(_) => "point",
        }
    }

    /// Signed distance of a position in the part frame, mm; positive out of the material. A freeform surface is that of the
    /// nominal geometry.
    pub(super) fn distance_mm(&self, nominal: &Geometry, position: &Vector3<f64>) -> f64 {
        match self {
            Self::Sphere(sphere) => (position - sphere.center().coords).norm() - 0.5 * sphere.diameter_mm,
            Self::Plane(plane) => plane.distance_mm(&Point3::from(*position)),
            Self::Cylinder(c) => axial(position, &c.axis_point_mm, &c.axis_direction).0 - 0.5 * c.diameter_mm,
            Self::Cone(c) => {
                let (radius, height) = axial(position, &c.axis_point_mm, &c.axis_direction);
                let (sin, cos) = fringe::math::sincos(c.half_angle_deg.to_radians());
                (radius - 0.5 * c.diameter_mm) * cos - height * sin
            }
            Self::Torus(t) => {
                let (radius, height) = axial(position, &t.center_mm, &t.axis_direction);
                let across = radius - 0.5 * t.ring_diameter_mm;
                (across * across + height * height).sqrt() - 0.5 * t.tube_diameter_mm
            }
            Self::Surface(_) => nominal.distance_mm(position),
            // Of outlines, lines and points: from the plane of their points.
            Self::Circle(c) | Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) => {
                (position - Vector3::from(c.center_mm)).dot(&Vector3::from(c.normal))
            }
            Self::Line(c) => {
                let up = Vector3::from(c.direction).cross(&Vector3::from(c.normal));
                -(position - Vector3::from(c.center_mm)).dot(&up)
            }
            Self::Point(p) => (position - Vector3::from(p.point_mm)).dot(&Vector3::from(p.normal)),
        }
    }

    /// Form statistics of the points behind the fit.
    pub fn form(&self) -> &Form {
        each!(self, fit => &fit.form)
    }

    /// Residuals of the points behind the fit; empty of a result that was read.
    pub(super) fn residuals(&self) -> &Residuals {
        each!(self, fit => &fit.residuals)
    }

    /// Forgets the residuals: they live on in the points.
    pub(super) fn forget_residuals(&mut self) {
        each!(self, fit => fit.residuals = Residuals::default());
    }

    /// Centre or point in the part frame, mm.
    pub fn place(&self) -> Vector3<f64> {
        Vector3::from(match self {
            Self::Sphere(s) => s.center_mm,
            Self::Plane(p) => p.centroid_mm,
            Self::Cylinder(c) => c.axis_point_mm,
            Self::Cone(c) => c.axis_point_mm,
            Self::Torus(t) => t.center_mm,
            Self::Circle(c) | Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) | Self::Line(c) => {
                c.center_mm
            }
            Self::Surface(s) => s.place_mm,
            Self::Point(p) => p.point_mm,
        })
    }

    /// Axis, normal or direction in the part frame; absent of a sphere.
    pub fn direction(&self) -> Option<[f64; 3]> {
        Some(match self {
            Self::Sphere(_) | Self::Surface(_) => return None,
            Self::Plane(p) => p.normal,
            Self::Cylinder(c) => c.axis_direction,
            Self::Cone(c) => c.axis_direction,
            Self::Torus(t) => t.axis_direction,
            Self::Circle(c) => c.normal,
            Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) | Self::Line(c) => c.direction,
            Self::Point(p) => p.normal,
        })
    }

    /// Sizes as people read them: diameters, half angle, length × width; empty where there is none.
    pub fn sizes(&self) -> Vec<String> {
        let round = |diameter: f64| format!("⌀ {diameter:.4}");
        match self {
            Self::Sphere(s) => vec![round(s.diameter_mm)],
            Self::Cylinder(c) => vec![round(c.diameter_mm)],
            Self::Cone(c) => vec![round(c.diameter_mm), format!("{:.4}°", c.half_angle_deg)],
            Self::Torus(t) => vec![round(t.ring_diameter_mm), round(t.tube_diameter_mm)],
            Self::Circle(c) => vec![round(c.size_mm[0])],
            Self::Slot(c) | Self::Rectangle(c) => vec![format!("{:.4} × {:.4}", c.size_mm[0], c.size_mm[1])],
            Self::Plane(_) | Self::Edge(_) | Self::Line(_) | Self::Surface(_) | Self::Point(_) => Vec::new(),
        }
    }

    /// Whether every number that is reported is one.
    pub(super) fn is_finite(&self) -> bool {
        let form = self.form();
        let (place, u) = match self {
            Self::Sphere(s) => {
                let [x, y, z] = s.center_mm;
                let [u_x, u_y, u_z] = s.u_center_mm;
                ([x, y, z, s.diameter_mm], [u_x, u_y, u_z, s.u_diameter_mm])
            }
            Self::Plane(p) => {
                let [x, y, z] = p.normal;
                ([x, y, z, p.offset_mm], [p.u_centroid_mm, p.u_offset_mm, p.u_normal_rad, 0.0])
            }
            Self::Cylinder(c) => {
                let [x, y, z] = c.axis_point_mm;
                ([x, y, z, c.diameter_mm], [c.u_axis_point_mm, c.u_axis_direction_rad, c.u_diameter_mm, 0.0])
            }
            Self::Cone(c) => {
                let ([x, y, z], [u_x, u_y, u_z]) = (c.apex_mm, c.u_apex_mm);
                ([x, y, z, c.half_angle_deg], [u_x, u_y, u_z, c.u_half_angle_deg])
            }
            Self::Torus(t) => {
                let ([x, y, z], u) = (t.center_mm, t.u_center_mm);
                (
                    [x, y, z, t.tube_diameter_mm],
                    [u[0] + u[1], u[2], t.u_ring_diameter_mm, t.u_tube_diameter_mm],
                )
            }
            Self::Circle(c) | Self::Slot(c) | Self::Rectangle(c) | Self::Edge(c) | Self::Line(c) => {
                let ([x, y, z], [u_x, u_y, u_z]) = (c.center_mm, c.u_center_mm);
                (
                    [x, y, z, c.size_mm[0] + c.size_mm[1]],
                    [u_x + u_y + u_z, c.u_direction_rad, c.u_size_mm[0], c.u_size_mm[1]],
                )
            }
            Self::Surface(s) => {
                let [x, y, z] = s.place_mm;
                ([x, y, z, 0.0], [0.0; 4])
            }
            Self::Point(p) => {
                let [x, y, z] = p.point_mm;
                ([x, y, z, 0.0], [p.u_mm, 0.0, 0.0, 0.0])
            }
        };
        let form = [form.form_range_mm, form.form_sigma_mm, form.form_d95_mm];
        place.iter().chain(&u).chain(&form).all(|v| v.is_finite())
    }
}

/// Distance of a position from an axis, and its height along it, mm.
fn axial(position: &Vector3<f64>, point: &[f64; 3], direction: &[f64; 3]) -> (f64, f64) {
    let (arm, direction) = (position - Vector3::from(*point), Vector3::from(*direction));
    let height = arm.dot(&direction);
    ((arm - direction * height).norm(), height)
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
    /// Standard uncertainty: `u_noise` and the plan's `u_system` in squares.
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
