//! The plan of a test: rules, conditions, artefacts, limits, and which clouds show which position.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::AcceptanceError;
use super::rules::{Kind, RuleSet};

/// The format this build reads.
pub const TEST_FORMAT: &str = "fringecell-test/1";

/// Fewest reference spheres that fix a motion.
const LEAST_REFERENCES: usize = 3;

/// A plan as written. Unknown keys are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestPlan {
    /// Always [`TEST_FORMAT`].
    pub format: String,
    /// What is tested.
    pub name: String,
    /// A rule set that comes with the program, or the path of a rule set file.
    pub rule_set: String,
    /// Whether a plan that breaks rules is evaluated all the same, marked as a reduced test.
    #[serde(default)]
    pub allow_reduced: bool,
    /// Fraction of the points that each fit leaves out; absent: what the rule set allows.
    pub reject_fraction: Option<f64>,
    /// Under which conditions.
    pub conditions: Conditions,
    /// Measuring volumes.
    pub volume: Volumes,
    /// How it is decided.
    #[serde(default)]
    pub decision: Decision,
    /// Maximum permissible errors, mm, by the symbol of the characteristic.
    #[serde(default)]
    pub limits: BTreeMap<String, f64>,
    /// How recordings become clouds.
    pub measurement: Option<Measurement>,
    /// How elements are found in clouds.
    #[serde(default)]
    pub segmentation: Segmentation,
    /// Reference spheres that stand beside the artefact and move with it, for positions registered by them.
    #[serde(default, rename = "reference")]
    pub references: Vec<Reference>,
    /// Artefacts.
    #[serde(rename = "artefact")]
    pub artefacts: Vec<Artefact>,
    /// Positions.
    #[serde(rename = "position")]
    pub positions: Vec<PositionPlan>,
}

/// Conditions of the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Who tested.
    pub operator: String,
    /// When.
    pub date: String,
    /// What was tested: maker, type, serial number.
    pub instrument: Option<String>,
    /// Of the artefact, °C.
    pub temperature_c: f64,
    /// Its standard uncertainty, K.
    pub u_temperature_k: f64,
    /// Exposures, patterns, averaging, filters.
    pub operating_mode: String,
    /// How long the system was on.
    pub warm_up: Option<String>,
}

/// Edges of the measuring volumes, mm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Volumes {
    /// What one view sees.
    pub sensor_mm: [f64; 3],
    /// What all views together measure.
    pub total_mm: [f64; 3],
}

/// Decision rules.
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
    /// The rule.
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

/// How recordings become clouds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measurement {
    /// Rig file, beside the plan.
    pub rig: String,
    /// "phase" or "projector".
    pub method: String,
}

/// How elements are found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Segmentation {
    /// Points within this distance of the sphere of calibrated diameter (or of the plane) that most points agree on
    /// belong to it. Wide enough to hold every error that shall be found.
    pub margin_mm: f64,
    /// Points farther apart than this belong to different bodies.
    pub gap_mm: f64,
}

impl Default for Segmentation {
    fn default() -> Self {
        Self { margin_mm: 0.5, gap_mm: 1.5 }
    }
}

/// A reference sphere. Its diameter tells it from the others; it need not be calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Nominal diameter.
    pub diameter_mm: f64,
}

/// An artefact.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Artefact {
    /// Unique.
    pub id: String,
    /// What it is.
    pub kind: Kind,
    /// Number of its certificate.
    pub certificate: String,
    /// Calibrated diameters of its spheres, in their order.
    #[serde(default)]
    pub diameters_mm: Vec<f64>,
    /// Standard uncertainty of a diameter.
    #[serde(default)]
    pub u_diameter_mm: f64,
    /// Of a ball bar: calibrated distances of the first sphere's centre from those of the others.
    #[serde(default)]
    pub spacings_mm: Vec<f64>,
    /// Standard uncertainty of a distance.
    #[serde(default)]
    pub u_spacing_mm: f64,
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
    /// Which artefact stands there.
    pub artefact: String,
    /// How the views come together.
    #[serde(default)]
    pub register: RegisterBy,
    /// Its views.
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
    /// Or a cloud.
    pub cloud: Option<String>,
    /// Where the elements of the artefact are: a ball x, y, z, r in mm for each sphere in their order, or one for the
    /// plane. Without it they are searched.
    #[serde(default)]
    pub near_mm: Vec<[f64; 4]>,
    /// Three rows of R | t: point in the position's frame = R · point in the cloud + t.
    pub transform: Option<[[f64; 4]; 3]>,
}

impl ViewPlan {
    /// The recording or the cloud, as written.
    pub fn source(&self) -> &str {
        self.recording.as_deref().or(self.cloud.as_deref()).unwrap_or("")
    }
}

impl TestPlan {
    /// Reads a plan and checks everything that needs no rules.
    ///
    /// # Errors
    /// Not TOML, unknown keys, numbers out of range, names that do not fit together.
    pub fn from_toml(text: &str) -> Result<Self, AcceptanceError> {
        let plan: Self = toml::from_str(text).map_err(|error| AcceptanceError::Toml {
            what: "test plan",
            message: super::one_line(&error, text),
        })?;
        plan.check()?;
        Ok(plan)
    }

    /// The artefact of a position.
    pub fn artefact_of(&self, position: &PositionPlan) -> Option<&Artefact> {
        self.artefacts.iter().find(|artefact| artefact.id == position.artefact)
    }

    /// Fraction that fits leave out.
    pub fn reject_fraction(&self, rules: &RuleSet) -> f64 {
        self.reject_fraction.unwrap_or(rules.reject_fraction.most)
    }

    fn check(&self) -> Result<(), AcceptanceError> {
        if self.format != TEST_FORMAT {
            return Err(AcceptanceError::Format { found: self.format.clone(), reads: TEST_FORMAT });
        }
        self.check_numbers()?;
        for (index, artefact) in self.artefacts.iter().enumerate() {
            if self.artefacts[..index].iter().any(|other| other.id == artefact.id) {
                return Err(AcceptanceError::Twice { what: "artefact", name: artefact.id.clone() });
            }
            artefact.check()?;
        }
        if self.positions.is_empty() {
            return Err(fault("position", "the plan has none: nothing would be tested; add [[position]]"));
        }
        let mut sources: Vec<&str> = Vec::new();
        for (index, position) in self.positions.iter().enumerate() {
            if self.positions[..index]
                .iter()
                .any(|p| (&p.name, p.repeat) == (&position.name, position.repeat))
            {
                let name = format!("{} repeat {}", position.name, position.repeat);
                return Err(AcceptanceError::Twice { what: "position", name });
            }
            if self.positions[..index]
                .iter()
                .any(|p| p.name == position.name && p.artefact != position.artefact)
            {
                let message = "its repeats name different artefacts; give each artefact positions of its own";
                return Err(fault(&format!("position \"{}\"", position.name), message));
            }
            self.check_position(position, &mut sources)?;
        }
        Ok(())
    }

    fn check_numbers(&self) -> Result<(), AcceptanceError> {
        let Self { conditions, volume, decision, segmentation, .. } = self;
        let place = |name: &str, key, value, limits| {
            Err(AcceptanceError::Value { place: name.to_owned(), key, value, limits })
        };
        for (key, edges) in [("sensor_mm", volume.sensor_mm), ("total_mm", volume.total_mm)] {
            if let Some(edge) = edges.iter().find(|e| !(**e > 0.0 && e.is_finite())) {
                return place("volume", key, *edge, "above 0");
            }
        }
        if !(-50.0..=100.0).contains(&conditions.temperature_c) {
            return place("conditions", "temperature_c", conditions.temperature_c, "-50 … 100 °C");
        }
        let positive = |value: f64| value > 0.0 && value.is_finite();
        let not_negative = |value: f64| value >= 0.0 && value.is_finite();
        if !not_negative(conditions.u_temperature_k) {
            return place("conditions", "u_temperature_k", conditions.u_temperature_k, "0 or more");
        }
        if !(not_negative(decision.guard_factor) && decision.guard_factor <= 10.0) {
            return place("decision", "guard_factor", decision.guard_factor, "0 … 10");
        }
        for (key, value) in [("margin_mm", segmentation.margin_mm), ("gap_mm", segmentation.gap_mm)] {
            if !(positive(value) && value <= 100.0) {
                return place("segmentation", key, value, "0 … 100 mm, zero excluded");
            }
        }
        if let Some(fraction) = self.reject_fraction.filter(|f| !(0.0..=0.5).contains(f)) {
            return place("plan", "reject_fraction", fraction, "0 … 0.5");
        }
        for (symbol, limit) in &self.limits {
            if !positive(*limit) {
                return place(
                    &format!("limits, {symbol}"),
                    "limit",
                    *limit,
                    "above 0 (mm; it holds for both signs)",
                );
            }
        }
        for (index, reference) in self.references.iter().enumerate() {
            if !positive(reference.diameter_mm) {
                return place(
                    &format!("reference {}", index + 1),
                    "diameter_mm",
                    reference.diameter_mm,
                    "above 0",
                );
            }
        }
        Ok(())
    }

    fn check_position<'a>(
        &'a self,
        position: &'a PositionPlan,
        sources: &mut Vec<&'a str>,
    ) -> Result<(), AcceptanceError> {
        let place = format!("position \"{}\"", position.name);
        let Some(artefact) = self.artefact_of(position) else {
            let known: Vec<&str> = self.artefacts.iter().map(|a| a.id.as_str()).collect();
            let (name, known) = (position.artefact.clone(), known.join(", "));
            return Err(AcceptanceError::Unknown { place, key: "artefact", name, known });
        };
        if position.views.is_empty() {
            return Err(fault(&place, "has no [[position.view]]; add the recordings or clouds that show it"));
        }
        if position.register == RegisterBy::References {
            self.check_references(&place)?;
        }
        let needed = artefact.elements();
        for (index, view) in position.views.iter().enumerate() {
            let place = format!("{place}, view \"{}\"", view.name);
            if position.views[..index].iter().any(|other| other.name == view.name) {
                return Err(AcceptanceError::Twice {
                    what: "view",
                    name: format!("{}/{}", position.name, view.name),
                });
            }
            if view.recording.is_some() == view.cloud.is_some() {
                return Err(fault(&place, "name a recording or a cloud, one of them"));
            }
            if view.recording.is_some() && self.measurement.is_none() {
                return Err(fault(
                    &place,
                    "names a recording, but the plan has no [measurement] with rig and method",
                ));
            }
            // Counted twice, one measurement would pass for two positions.
            if sources.contains(&view.source()) {
                return Err(fault(&place, &format!("{} is named by another view too", view.source())));
            }
            sources.push(view.source());
            view.check(&place, needed, position.register)?;
        }
        Ok(())
    }

    /// Reference spheres are told apart by their diameters alone.
    fn check_references(&self, place: &str) -> Result<(), AcceptanceError> {
        if self.references.len() < LEAST_REFERENCES {
            let found = self.references.len();
            let message = format!(
                "registered by {found} reference spheres, needs at least {LEAST_REFERENCES}: add [[reference]]"
            );
            return Err(fault(place, &message));
        }
        let apart_mm = 2.0 * self.segmentation.margin_mm;
        let own = self.artefacts.iter().flat_map(|a| &a.diameters_mm).copied();
        for (index, reference) in self.references.iter().enumerate() {
            let others = self.references[..index].iter().map(|r| r.diameter_mm).chain(own.clone());
            if let Some(near) = others.into_iter().find(|d| (d - reference.diameter_mm).abs() < apart_mm) {
                let message = format!(
                    "reference spheres are told apart by their diameters: {} and {near} mm differ by less than twice \
                     margin_mm, {apart_mm} mm",
                    reference.diameter_mm
                );
                return Err(fault(place, &message));
            }
        }
        Ok(())
    }
}

impl ViewPlan {
    fn check(&self, place: &str, needed: usize, register: RegisterBy) -> Result<(), AcceptanceError> {
        if !self.near_mm.is_empty() && self.near_mm.len() != needed {
            let found = self.near_mm.len();
            return Err(fault(
                place,
                &format!("near_mm has {found} balls, the artefact has {needed} elements"),
            ));
        }
        if let Some(ball) = self.near_mm.iter().find(|b| b.iter().any(|v| !v.is_finite()) || b[3] <= 0.0) {
            return Err(fault(
                place,
                &format!("near_mm = {ball:?}: four finite numbers x, y, z, r, r above 0"),
            ));
        }
        if self.near_mm.is_empty() && needed > 2 {
            let message = format!(
                "needs near_mm: the {needed} spheres of its artefact look alike, their order does not show"
            );
            return Err(fault(place, &message));
        }
        let Some(rows) = &self.transform else { return Ok(()) };
        if register == RegisterBy::References {
            return Err(fault(
                place,
                "has a transform, but its position is registered by references; drop one",
            ));
        }
        let rotation = nalgebra::Matrix3::from_fn(|r, c| rows[r][c]);
        let off = (rotation * rotation.transpose() - nalgebra::Matrix3::identity()).amax();
        let rigid = off <= 1e-6 && rotation.determinant() > 0.0;
        if !rigid || rows.iter().any(|row| !row[3].is_finite()) {
            return Err(fault(
                place,
                "transform: is no rigid motion; its left three columns must be a rotation within 1e-6",
            ));
        }
        Ok(())
    }
}

impl Artefact {
    /// Spheres or planes to find.
    pub fn elements(&self) -> usize {
        if self.kind == Kind::Plane { 1 } else { self.diameters_mm.len() }
    }

    fn check(&self) -> Result<(), AcceptanceError> {
        let place = format!("artefact \"{}\"", self.id);
        let (diameters, spacings) = (self.diameters_mm.len(), self.spacings_mm.len());
        let fits = match self.kind {
            Kind::Sphere => diameters == 1 && spacings == 0 && self.size_mm.is_none(),
            Kind::BallBar => diameters >= 2 && spacings == diameters - 1 && self.size_mm.is_none(),
            Kind::Plane => diameters == 0 && spacings == 0 && self.size_mm.is_some(),
        };
        if !fits {
            let message = "a sphere has one of diameters_mm; a ball-bar n ≥ 2 of diameters_mm and n − 1 of spacings_mm \
                           (from the first sphere); a plane size_mm";
            return Err(fault(&place, message));
        }
        if self.id.trim().is_empty() || self.certificate.trim().is_empty() {
            return Err(fault(&place, "id and certificate must not be empty: a report names them"));
        }
        let lengths = self.diameters_mm.iter().chain(&self.spacings_mm).chain(self.size_mm.iter().flatten());
        if let Some(bad) = lengths.copied().find(|v| !(*v > 0.0 && v.is_finite())) {
            return Err(AcceptanceError::Value { place, key: "a length", value: bad, limits: "above 0 mm" });
        }
        let amounts = [
            ("u_diameter_mm", self.u_diameter_mm),
            ("u_spacing_mm", self.u_spacing_mm),
            ("form_mm", self.form_mm),
            ("u_form_mm", self.u_form_mm),
            ("u_expansion_per_k", self.u_expansion_per_k),
        ];
        for (key, value) in amounts {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(AcceptanceError::Value { place, key, value, limits: "0 or more" });
            }
        }
        let (expansion, at) = (self.expansion_per_k, self.calibrated_at_c);
        if !(-1e-3..=1e-3).contains(&expansion) {
            return Err(AcceptanceError::Value {
                place,
                key: "expansion_per_k",
                value: expansion,
                limits: "-1e-3 … 1e-3 1/K",
            });
        }
        if !(-50.0..=100.0).contains(&at) {
            return Err(AcceptanceError::Value {
                place,
                key: "calibrated_at_c",
                value: at,
                limits: "-50 … 100 °C",
            });
        }
        Ok(())
    }
}

fn fault(place: &str, message: &str) -> AcceptanceError {
    AcceptanceError::Plan { place: place.to_owned(), message: message.to_owned() }
}
