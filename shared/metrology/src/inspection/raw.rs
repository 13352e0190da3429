//! The plan as it is written: serde structures that refuse unknown keys.

use serde::Deserialize;

use super::criterion::Criterion;
use super::plan::Settings;
use super::raw_elements::{
    RawCadFace, RawCircle, RawCone, RawCylinder, RawEdge, RawLine, RawMade, RawOblong, RawPoint, RawSurface,
    RawTorus,
};
use super::raw_features::{
    RawAngle, RawCircularRunout, RawDatumSystem, RawDistance, RawForm, RawHalfAngle, RawLocation,
    RawOrientation, RawPosition, RawProfile, RawSize, RawTotalRunout,
};

/// An inspection plan as it is written; [`Plan::new`](super::Plan::new) checks it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawPlan {
    pub(super) format: String,
    pub(super) name: String,
    #[serde(default)]
    pub(super) settings: Settings,
    pub(super) placement: Option<RawPlacement>,
    pub(super) alignment: Option<RawAlignment>,
    #[serde(default)]
    pub(super) datum_system: Vec<RawDatumSystem>,
    #[serde(default)]
    pub(super) element: Vec<RawElement>,
    #[serde(default)]
    pub(super) feature: Vec<RawFeature>,
}

/// A file of nominal geometry that a plan names.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SurfaceFile {
    /// The element that it belongs to.
    pub element: String,
    /// Path as the plan writes it.
    pub file: String,
    /// SHA-256 that the file must have, where the plan states one.
    pub sha256: Option<String>,
    /// Whether faces of it are meant, one by one, instead of its whole surface.
    pub by_face: bool,
}

impl RawPlan {
    /// The files of nominal geometry, in the order of their elements.
    pub fn surface_files(&self) -> Vec<SurfaceFile> {
        let of = |element: &RawElement| match element {
            RawElement::Surface(raw) => {
                let (element, file, sha256) = (raw.name.clone(), raw.file.clone(), raw.sha256.clone());
                Some(SurfaceFile { element, file, sha256, by_face: false })
            }
            RawElement::CadFace(raw) => {
                let (element, file, sha256) = (raw.name.clone(), raw.file.clone(), raw.sha256.clone());
                Some(SurfaceFile { element, file, sha256, by_face: true })
            }
            _ => None,
        };
        self.element.iter().filter_map(of).collect()
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawPlacement {
    pub rotation: [[f64; 3]; 3],
    pub translation_mm: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawAlignment {
    pub plane: String,
    pub line: [String; 2],
    pub origin: String,
    pub search_mm: f64,
    pub search_deg: f64,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub(super) enum RawElement {
    Sphere {
        name: String,
        center_mm: [f64; 3],
        diameter_mm: f64,
        #[serde(default = "up")]
        axis: [f64; 3],
        #[serde(default)]
        min_polar_deg: f64,
        #[serde(default = "half_turn")]
        max_polar_deg: f64,
        margin_mm: f64,
        normal_tolerance_deg: Option<f64>,
        min_points: usize,
        #[serde(default)]
        max_reject_fraction: f64,
        #[serde(default)]
        criterion: Criterion,
    },
    Plane {
        name: String,
        point_mm: [f64; 3],
        normal: [f64; 3],
        direction: Option<[f64; 3]>,
        size_mm: [f64; 2],
        #[serde(default)]
        inset_mm: f64,
        #[serde(default)]
        exclude: Vec<RawExclusion>,
        margin_mm: f64,
        normal_tolerance_deg: Option<f64>,
        min_points: usize,
        #[serde(default)]
        max_reject_fraction: f64,
        #[serde(default)]
        criterion: Criterion,
    },
    Cylinder(RawCylinder),
    Cone(RawCone),
    Torus(RawTorus),
    Circle(RawCircle),
    Slot(RawOblong),
    Rectangle(RawOblong),
    Edge(RawEdge),
    Line(RawLine),
    Point(RawPoint),
    Surface(RawSurface),
    CadFace(RawCadFace),
    Intersection(RawMade),
    Projection(RawMade),
    SymmetryPlane(RawMade),
    MiddlePoint(RawMade),
    FitLine(RawMade),
    FitPlane(RawMade),
    FitCircle(RawMade),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(clippy::struct_field_names, reason = "the names are the plan's keys, and units stand in keys")]
pub(super) struct RawExclusion {
    pub center_mm: [f64; 3],
    pub radius_mm: Option<f64>,
    pub size_mm: Option<[f64; 2]>,
}

#[derive(Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub(super) enum RawFeature {
    SphereDiameter {
        name: String,
        element: String,
        nominal_mm: f64,
        tolerance_mm: [f64; 2],
        #[serde(default)]
        u_system_mm: f64,
    },
    CentreDistance {
        name: String,
        elements: [String; 2],
        nominal_mm: f64,
        tolerance_mm: [f64; 2],
        #[serde(default)]
        u_system_mm: f64,
    },
    PlaneFlatness {
        name: String,
        element: String,
        limit_mm: f64,
        filter_mm: Option<f64>,
        #[serde(default)]
        u_system_mm: f64,
    },
    PlaneDistance {
        name: String,
        elements: [String; 2],
        nominal_mm: f64,
        tolerance_mm: [f64; 2],
        #[serde(default)]
        u_system_mm: f64,
    },
    PlaneAngle {
        name: String,
        elements: [String; 2],
        #[serde(default)]
        supplement: bool,
        nominal_deg: f64,
        tolerance_deg: [f64; 2],
        #[serde(default)]
        u_system_deg: f64,
    },
    HemisphereHeight {
        name: String,
        sphere: String,
        plane: String,
        nominal_mm: f64,
        tolerance_mm: [f64; 2],
        #[serde(default)]
        u_system_mm: f64,
    },
    Size(RawSize),
    HalfAngle(RawHalfAngle),
    Distance(RawDistance),
    Angle(RawAngle),
    Straightness(RawForm),
    Flatness(RawForm),
    Roundness(RawForm),
    Cylindricity(RawForm),
    Parallelism(RawOrientation),
    Perpendicularity(RawOrientation),
    Angularity(RawOrientation),
    Position(RawPosition),
    Coaxiality(RawLocation),
    Concentricity(RawLocation),
    Symmetry(RawLocation),
    LineProfile(RawProfile),
    SurfaceProfile(RawProfile),
    CircularRunout(RawCircularRunout),
    TotalRunout(RawTotalRunout),
}

fn up() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}

fn half_turn() -> f64 {
    180.0
}
