//! The plan of a test: rules, conditions, artefacts, limits, and which clouds show which position.

mod check;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::rules::{Kind, RuleSet};

/// The format this build reads.
pub const TEST_FORMAT: &str = "fringecell-test/1";

/// A plan as written. Unknown keys are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestPlan {
    /// Always the text [`TEST_FORMAT`].
    pub format: String,
    /// Name of the test, for the report.
    pub name: String,
    /// A rule set that comes with the program, or the path of a rule set file.
    pub rule_set: String,
    /// Whether a plan that breaks rules is evaluated all the same, marked as a reduced test.
    #[serde(default)]
    pub allow_reduced: bool,
    /// Fraction of the points that each fit leaves out; absent: what the rule set allows.
    pub reject_fraction: Option<f64>,
    /// Conditions of the measurement, for the report.
    pub conditions: Conditions,
    /// Measuring volumes of sensor and system.
    pub volume: Volumes,
    /// How it is decided.
    #[serde(default)]
    pub decision: Decision,
    /// Maximum permissible errors by the symbol of the characteristic.
    #[serde(default)]
    pub limits: BTreeMap<String, Limit>,
    /// How recordings become clouds.
    pub measurement: Option<Measurement>,
    /// How elements are found in clouds.
    #[serde(default)]
    pub segmentation: Segmentation,
    /// Reference spheres that stand beside the artefact and move with it, for positions registered by them.
    #[serde(default, rename = "reference")]
    pub references: Vec<Reference>,
    /// All artefacts, each with its certificate.
    #[serde(rename = "artefact")]
    pub artefacts: Vec<Artefact>,
    /// Positions of the artefacts, in the order of measurement.
    #[serde(rename = "position")]
    pub positions: Vec<PositionPlan>,
}

/// A maximum permissible error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "a limit is a number in mm, or { a_mm, k_um_per_m, b_mm } for errors of lengths"
)]
pub enum Limit {
    /// The same for every value, mm.
    Constant(f64),
    /// A + K·L, and never more than B (VDI/VDE 2634 part 1): for characteristics of lengths.
    Length(LengthLimit),
}

/// A + K·L ≤ B, L the calibrated length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LengthLimit {
    /// Constant part A of the limit, mm.
    pub a_mm: f64,
    /// K, micrometres per metre of length: 20 adds 2 µm per 100 mm.
    pub k_um_per_m: f64,
    /// B, mm; absent: without bound.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub b_mm: Option<f64>,
}

impl Limit {
    /// The limit of a value of this length, mm; only a constant limit knows what to do without a length.
    pub fn at(&self, length_mm: Option<f64>) -> Option<f64> {
        match self {
            Self::Constant(limit) => Some(*limit),
            Self::Length(limit) => {
                let grown = limit.a_mm + limit.k_um_per_m * 1e-6 * length_mm?;
                let limit_mm = limit.b_mm.map_or(grown, |most| grown.min(most));
                // Down to whole 10 nm, as a report can print it; a rounding error of the sum is no step.
                Some((limit_mm * 1e5 + 1e-6).floor() / 1e5)
            }
        }
    }
}

/// Conditions of the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Who tested. Without it, as without the three below, the test is a reduced one.
    #[serde(default)]
    pub operator: String,
    /// Day of the test, YYYY-MM-DD; a time may follow.
    #[serde(default)]
    pub date: String,
    /// Identity of the instrument: maker, type, serial number.
    pub instrument: Option<String>,
    /// Exposures, patterns, averaging, filters.
    #[serde(default)]
    pub operating_mode: String,
    /// Temperature of the artefact, °C.
    pub temperature_c: f64,
    /// Its standard uncertainty, K.
    pub u_temperature_k: f64,
    /// Why `u_temperature_k` is 0, where it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero_reason: Option<String>,
    /// What was left out of the clouds before this test, or "none". Without it, a test of clouds is a reduced one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cloud_filters: Option<String>,
    /// Whether the recordings come from a simulation: no instrument was tested then, and every report states it.
    #[serde(default)]
    pub simulated: bool,
    /// How long the system was on.
    pub warm_up: Option<String>,
    /// Length over which a cloud goes from 10 to 90 % of the height of a straight edge, mm, as the operator found it. Stated beside the
    /// probing form, since smoothing buys the one with the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lateral_resolution_mm: Option<f64>,
}

/// Edges of the measuring volumes, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Volumes {
    /// What one view sees.
    pub sensor_mm: [f64; 3],
    /// What all views together measure.
    pub total_mm: [f64; 3],
    /// Middle of the total volume in the frame of the positions; its edges are parallel to the axes of that frame. Without
    /// it, it is unknown whether the positions lie in the volume, and the test is a reduced one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center_mm: Option<[f64; 3]>,
}

/// How a value is compared with its limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DecisionRule {
    /// Guard bands of the test-value uncertainty.
    #[default]
    #[serde(rename = "iso14253-1")]
    Iso14253,
    /// |value| ≤ limit passes, anything else fails, as agreed between the parties.
    Simple,
}

/// How it is decided.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Decision {
    /// Guard bands or simple acceptance.
    pub rule: DecisionRule,
    /// Guard band over the standard uncertainty: 1.65 for a conformance probability of 95 % at one limit (ISO
    /// 14253-1:2017), 2 as in the edition of 1998.
    pub guard_factor: f64,
}

impl Default for Decision {
    fn default() -> Self {
        Self { rule: DecisionRule::default(), guard_factor: 1.65 }
    }
}

impl Decision {
    /// Guard band over the standard uncertainty that the rule asks for; 0 for simple acceptance.
    pub fn factor(&self) -> f64 {
        match self.rule {
            DecisionRule::Iso14253 => self.guard_factor,
            DecisionRule::Simple => 0.0,
        }
    }
}

/// How recordings become clouds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// Rig file, beside the plan.
    pub rig: String,
    /// Method of measurement: "phase" or "projector".
    pub method: String,
    /// Side of the window over which points are smoothed, px: 1 (not at all), 3, 5 or 7; absent: as `reconstruct` does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub smoothing_px: Option<u32>,
}

/// How elements are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Segmentation {
    /// An element is where most points agree on a sphere of calibrated diameter (or a plane) within this distance. A form
    /// deviation that reaches it is an error of the evaluation, never a value.
    pub margin_mm: f64,
    /// Every point within this distance of an element's surface belongs to the artefact and counts, and every point inside a
    /// sphere. Absent: the radius of a sphere, ten times `margin_mm` of a plane.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zone_mm: Option<f64>,
    /// Points farther apart than this belong to different bodies.
    pub gap_mm: f64,
}

impl Default for Segmentation {
    fn default() -> Self {
        Self { margin_mm: 0.5, zone_mm: None, gap_mm: 1.5 }
    }
}

/// A reference sphere. Its diameter distinguishes it from the others; it need not be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Nominal diameter of the sphere, mm.
    pub diameter_mm: f64,
}

/// A calibrated artefact with its certificate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Artefact {
    /// Name, unique among the artefacts.
    pub id: String,
    /// Sphere, ball bar or plane.
    pub kind: Kind,
    /// Number of its certificate.
    pub certificate: String,
    /// Day of the calibration, YYYY-MM-DD. Without it, or outside its validity, the test is a reduced one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate_date: Option<String>,
    /// Last day on which the certificate is valid, YYYY-MM-DD.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub certificate_valid_until: Option<String>,
    /// Calibrated diameters of its spheres, in their order.
    #[serde(default)]
    pub diameters_mm: Vec<f64>,
    /// Standard uncertainty of a diameter; no artefact with spheres goes without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_diameter_mm: Option<f64>,
    /// Of a ball bar: calibrated distances of the first sphere's centre from those of the others.
    #[serde(default)]
    pub spacings_mm: Vec<f64>,
    /// Standard uncertainty of a distance; no ball bar goes without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub u_spacing_mm: Option<f64>,
    /// Of a ball bar: diameter of the rod between its spheres; points of the rod do not count.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rod_diameter_mm: Option<f64>,
    /// Of a plane: its sides.
    pub size_mm: Option<[f64; 2]>,
    /// Certified form deviation (range) of its spheres or plane.
    pub form_mm: f64,
    /// Standard uncertainty of the form deviation.
    pub u_form_mm: f64,
    /// Coefficient of thermal expansion, 1/K.
    pub expansion_per_k: f64,
    /// Its standard uncertainty, 1/K.
    pub u_expansion_per_k: f64,
    /// Why a standard uncertainty of this artefact is 0, where one is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero_reason: Option<String>,
    /// Temperature at which the certificate holds, °C.
    #[serde(default = "twenty")]
    pub calibrated_at_c: f64,
}

fn twenty() -> f64 {
    20.0
}

/// How the views of a position come into one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RegisterBy {
    /// They are in one frame: a fixed cell, or their `transform`.
    #[default]
    Frame,
    /// By the centres of the plan's reference spheres, onto the first view.
    References,
}

/// A position of an artefact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionPlan {
    /// Repeats of a position have the same name.
    pub name: String,
    /// Counts repeats from 1.
    #[serde(default = "one")]
    pub repeat: u32,
    /// Measures a position again whose value broke its limit, where the rule set has a rule for it.
    #[serde(default)]
    pub retest: bool,
    /// Which artefact stands there.
    pub artefact: String,
    /// How the views come together.
    #[serde(default)]
    pub register: RegisterBy,
    /// Views of the artefact at this position.
    #[serde(rename = "view")]
    pub views: Vec<ViewPlan>,
}

fn one() -> u32 {
    1
}

/// A view of a position.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewPlan {
    /// Unique in its position.
    pub name: String,
    /// Folder of a recording.
    pub recording: Option<String>,
    /// Path of a cloud, instead of a recording.
    pub cloud: Option<String>,
    /// Where the elements of the artefact are: a ball x, y, z, r in mm for each sphere in their order, or one for the
    /// plane. Without it they are searched.
    #[serde(default)]
    pub near_mm: Vec<[f64; 4]>,
    /// Balls x, y, z, r in mm whose points are no part of the artefact: a stem, a fixture. They are counted and reported.
    #[serde(default)]
    pub exclude_mm: Vec<[f64; 4]>,
    /// Three rows of R | t: point in the frame of the position = R · point in the cloud + t.
    pub transform: Option<[[f64; 4]; 3]>,
}

impl ViewPlan {
    /// The recording or the cloud, as written.
    pub fn source(&self) -> &str {
        self.recording.as_deref().or(self.cloud.as_deref()).unwrap_or("")
    }

    /// The same without detours, so that `./b0.ply` and `x/../b0.ply` are `b0.ply`.
    pub(super) fn plain_source(&self) -> String {
        let mut parts: Vec<&str> = Vec::new();
        for part in self.source().split('/').filter(|part| !matches!(*part, "" | ".")) {
            match (part, parts.last()) {
                ("..", Some(last)) if *last != ".." => drop(parts.pop()),
                _ => parts.push(part),
            }
        }
        let root = if self.source().starts_with('/') { "/" } else { "" };
        root.to_owned() + &parts.join("/")
    }
}

impl TestPlan {
    /// The artefact of a position.
    pub fn artefact_of(&self, position: &PositionPlan) -> Option<&Artefact> {
        self.artefacts.iter().find(|artefact| artefact.id == position.artefact)
    }

    /// Fraction that fits leave out.
    pub fn reject_fraction(&self, rules: &RuleSet) -> f64 {
        self.reject_fraction.unwrap_or(rules.reject_fraction.most)
    }
}

impl Artefact {
    /// Spheres or planes to find.
    pub fn elements(&self) -> usize {
        if self.kind == Kind::Plane { 1 } else { self.diameters_mm.len() }
    }
}
