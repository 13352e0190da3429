//! What an acceptance test found: the master from which every report is written. Lengths mm.

use serde::{Deserialize, Serialize};

use crate::verdict::{Verdict, decide};

/// Coverage factor of the stated uncertainties of test values.
pub(super) const COVERAGE_FACTOR: f64 = 2.0;

/// The decision rule behind a guard factor, as a report states it.
pub fn decision_words(guard_factor: f64) -> String {
    if guard_factor == 0.0 {
        return "simple acceptance, as agreed".to_owned();
    }
    format!("ISO 14253-1, guard band {guard_factor} times the standard uncertainty of each test value")
}

/// The result of an acceptance test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TestReport {
    /// Rules that the test followed.
    pub rule_set: RuleSetId,
    /// Rules that the plan breaks; not empty: a reduced test.
    pub reduced: Vec<Violation>,
    /// Guard band over the standard uncertainty of a test value by which a value must lie within its limit to pass, and beyond
    /// it to fail; 0 for simple acceptance.
    pub guard_factor: f64,
    /// Whether the recordings were simulated: no instrument was tested.
    #[serde(default)]
    pub simulated: bool,
    /// Recordings and clouds behind the values.
    #[serde(default)]
    pub inputs: Vec<Input>,
    /// Label and text: operator, date, temperature, operating mode, rig hash, software version …
    pub conditions: Vec<(String, String)>,
    /// The finest detail of the clouds, beside which a form error has to be read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lateral_resolution: Option<LateralResolution>,
    /// What one view sees.
    pub sensor_volume: Volume,
    /// What the system measures with all its views; its body diagonal is the L0 of the rules.
    pub total_volume: Volume,
    /// Artefacts, calibrated by others.
    pub artefacts: Vec<ArtefactRecord>,
    /// Characteristics in the order of the rule set.
    pub characteristics: Vec<Characteristic>,
    /// One deciding characteristic that fails fails the test; it passes when all pass.
    pub verdict: Verdict,
}

impl TestReport {
    /// The verdict that the verdicts of the characteristics give: one limit that is broken fails the test, and a deciding
    /// characteristic without a limit proves nothing.
    pub fn verdict_of_characteristics(&self) -> Verdict {
        let deciding = self.characteristics.iter().filter(|c| c.decides || c.limit.is_some());
        deciding.map(|c| c.verdict.unwrap_or(Verdict::Indeterminate)).max().unwrap_or(Verdict::Indeterminate)
    }
}

/// Over what length a cloud goes from 10 to 90 % of the height of a straight edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LateralResolution {
    /// Of a step far above the noise whose edge runs along the base of the views, mm.
    pub step_mm: f64,
    /// Of a step of 1 mm whose edge crosses the base, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step_across_mm: Option<f64>,
    /// Of a step that hides in the noise of single points and is smoothed over the whole window, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hidden_step_mm: Option<f64>,
    /// Where the lengths come from.
    pub source: String,
}

impl LateralResolution {
    /// Lengths and source as a report states them.
    pub fn words(&self) -> String {
        let Self { step_mm, step_across_mm, hidden_step_mm, source } = self;
        let across = step_across_mm.map_or_else(String::new, |mm| {
            format!(", {mm:.2} mm of a step of 1 mm whose edge crosses the base of the views")
        });
        let hidden = hidden_step_mm.map_or_else(String::new, |mm| {
            format!(", {mm:.2} mm of a step that hides in the noise of single points")
        });
        format!("{step_mm:.2} mm from 10 to 90 % of a straight step{across}{hidden}; {source}")
    }
}

/// A recording or a cloud.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// Name of the position.
    pub position: String,
    /// Number of the repeat, from 1.
    pub repeat: u32,
    /// Name of the view.
    pub view: String,
    /// As the plan names it.
    pub source: String,
    /// SHA-256 of the file; of a recording: of the list of its files with theirs.
    pub sha256: String,
}

/// Names a rule set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RuleSetId {
    /// Identifier, for example "vdi2634-3".
    pub id: String,
    /// For example "VDI/VDE 2634 part 3".
    pub standard: String,
    /// Edition, for example "2008-12".
    pub edition: String,
    /// For example "evaluated following VDI/VDE 2634 part 3, edition 2008-12".
    pub wording: String,
    /// Values of the rule set that no text of the standard confirms; a report has to show them.
    pub assumed: Vec<String>,
}

/// A rule that the plan breaks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Violation {
    /// Name of the rule, for example "ball bar length".
    pub rule: String,
    /// What the rule asks, in `unit`.
    pub required: f64,
    /// What the plan offers, in `unit`.
    pub actual: f64,
    /// Unit of both values: "mm", "positions" …
    pub unit: String,
    /// The sentence for the report.
    pub text: String,
}

/// A measuring volume, a box.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Volume {
    /// Lengths of the edges x, y, z, mm.
    pub size_mm: [f64; 3],
    /// √(x² + y² + z²).
    pub body_diagonal_mm: f64,
}

impl Volume {
    /// The volume with these edges.
    pub fn new(size_mm: [f64; 3]) -> Self {
        let [x, y, z] = size_mm;
        Self { size_mm, body_diagonal_mm: (x * x + y * y + z * z).sqrt() }
    }
}

/// An artefact with its certificate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArtefactRecord {
    /// Name in the plan.
    pub id: String,
    /// "sphere", "ball-bar" or "plane".
    pub kind: String,
    /// Number of the certificate.
    pub certificate: String,
    /// From when until when the certificate is valid, and why an uncertainty is 0; empty: not stated.
    #[serde(default)]
    pub validity: String,
    /// Calibrated values: name, value mm, standard uncertainty mm; `None` where the certificate states none.
    pub values: Vec<(String, f64, Option<f64>)>,
}

/// A characteristic over all positions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Characteristic {
    /// Symbol of the rule set, for example "PF_range".
    pub symbol: String,
    /// For example "probing form error (range)".
    pub name: String,
    /// How the value comes about.
    pub definition: String,
    /// Unit of the values: "mm".
    pub unit: String,
    /// The value farthest from zero over all positions, with its sign; where the limit grows with the length, the one that
    /// takes up most of its limit.
    pub value: f64,
    /// Whether it takes part in the verdict of the test.
    pub decides: bool,
    /// Maximum permissible error at `value`: |value| has to stay within.
    pub limit: Option<f64>,
    /// Expanded uncertainty (k = 2) of the test value `value`: of artefact and its use, never of the instrument. Each position
    /// has its own.
    pub test_value_u: Option<f64>,
    /// The worst verdict over all positions that count; `None` without a limit.
    pub verdict: Option<Verdict>,
    /// Values, in the order of the plan.
    pub positions: Vec<PositionValue>,
    /// Scatter of repeats within positions: pooled sample standard deviation; `None` without repeats, or where they do not
    /// differ by more than the arithmetic resolves.
    pub repeatability: Option<f64>,
    /// Scatter of the means of positions: sample standard deviation; `None` with one position, or as above.
    pub between_positions: Option<f64>,
}

impl Characteristic {
    /// Limit of one of its values.
    pub fn limit_of(&self, position: &PositionValue) -> Option<f64> {
        position.limit.or(self.limit)
    }

    /// The limit that holds at all positions alike; `None` without a limit, or where it differs with the length.
    pub fn common_limit(&self) -> Option<f64> {
        let alike = self.positions.iter().all(|p| self.limit_of(p) == self.limit);
        self.limit.filter(|_| alike)
    }

    /// What the value of one of its positions proves; `None` without a limit.
    pub fn verdict_at(&self, position: &PositionValue, guard_factor: f64) -> Option<Verdict> {
        let limit = self.limit_of(position)?;
        // Without an uncertainty nothing is proven.
        let u = position.test_value_u.or(self.test_value_u).unwrap_or(f64::NAN) / COVERAGE_FACTOR;
        // A negative error counts as a positive one.
        Some(decide(position.value, u, guard_factor, Some(-limit), limit).unwrap_or(Verdict::Indeterminate))
    }

    /// What all its values prove: every one that counts must pass. `None` without a limit or without a value.
    pub fn verdict_over_positions(&self, guard_factor: f64) -> Option<Verdict> {
        let counting = self.positions.iter().filter(|p| !p.replaced);
        counting.filter_map(|p| self.verdict_at(p, guard_factor)).max()
    }
}

/// A characteristic at one position.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PositionValue {
    /// Name of the position.
    pub position: String,
    /// Number of the repeat, from 1.
    pub repeat: u32,
    /// Value with its sign, in the unit of the characteristic.
    pub value: f64,
    /// Calibrated length that it is the error of, mm; absent for forms and sizes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_mm: Option<f64>,
    /// Its own limit, where limits grow with the length; absent: the characteristic's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// Expanded uncertainty (k = 2) of this test value.
    #[serde(default)]
    pub test_value_u: Option<f64>,
    /// What this value proves; absent without a limit.
    #[serde(default)]
    pub verdict: Option<Verdict>,
    /// Whether a retest took the place of this value: it stands here but does not count.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub replaced: bool,
    /// Number of points that the value is taken from.
    pub points: usize,
    /// Points left out by the stated fraction.
    pub rejected: usize,
    /// Points that the plan excludes as those of a stem, a rod or a fixture.
    #[serde(default)]
    pub excluded: usize,
    /// Views whose points are in it.
    pub views: Vec<String>,
}
