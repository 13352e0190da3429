//! Rule sets as data: what a standard asks of a test, each value with its source.

use serde::{Deserialize, Serialize};

use super::AcceptanceError;
use super::result::RuleSetId;

/// The format this build reads.
pub const RULES_FORMAT: &str = "fringecell-rules/1";

/// A rule set as written. Unknown keys are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RuleSet {
    /// Always the text [`RULES_FORMAT`].
    pub format: String,
    /// Identifier, for example "vdi2634-3".
    pub id: String,
    /// For example "VDI/VDE 2634 part 3".
    pub standard: String,
    /// Edition, for example "2008-12".
    pub edition: String,
    /// Fraction of the points that a fit may leave out.
    pub reject_fraction: RejectFraction,
    /// How often a position may be measured again whose value broke its limit; absent: never.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub retest: Option<RetestRule>,
    /// Conditions that a plan has to fulfil.
    #[serde(default, rename = "rule")]
    pub rules: Vec<Rule>,
    /// Characteristics that are evaluated.
    #[serde(rename = "characteristic")]
    pub characteristics: Vec<CharacteristicRule>,
}

/// How well a value is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// Read in the standard itself.
    Verified,
    /// Read in a text that states it: a thesis, an excerpt, a certificate.
    Secondary,
    /// Common practice, or our choice where the standard was not at hand: printed in every report.
    Assumed,
    /// No part of the standard: shown beside it.
    Information,
}

/// Largest fraction of points that a fit may leave out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RejectFraction {
    /// The fraction, 0 … 0.5.
    pub most: f64,
    /// How well it is known.
    pub status: Status,
    /// The text that states the value.
    pub source: String,
}

/// Measuring again after a broken limit: the new values decide in place of the old, which stay in the report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RetestRule {
    /// Positions of the whole test that may be measured again.
    pub most_positions: usize,
    /// New measurements of each such position; all of them must keep the limit.
    pub measurements: usize,
    /// How well it is known.
    pub status: Status,
    /// The text that states the values.
    pub source: String,
}

/// Kinds of calibrated artefacts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// A sphere of calibrated diameter.
    Sphere,
    /// Two or more spheres at calibrated distances from the first.
    BallBar,
    /// A flat plate of calibrated form.
    Plane,
}

impl Kind {
    /// The name in plans and results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sphere => "sphere",
            Self::BallBar => "ball-bar",
            Self::Plane => "plane",
        }
    }
}

/// What a rule limits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// Positions in which an artefact of the kind is measured.
    Positions,
    /// Views of each position.
    Views,
    /// Share of a sphere's surface with points, of each sphere in each cloud that decides.
    Coverage,
    /// Distance of two positions of the artefact, the least over all, over the body diagonal.
    ApartOverDiagonal,
    /// Directions of the artefact's axis, at least 15° apart.
    Directions,
    /// Extent of all centres along an axis over the edge of the total volume, the least of three.
    ExtentOverVolume,
    /// Share of the points on an element's surface that the plan excludes, in each view.
    ExcludedShare,
    /// `zone_mm` over the diameter of a sphere.
    ZoneOverDiameter,
    /// Certified form deviation over the limit of a form.
    FormOverLimit,
    /// Expanded uncertainty (k = 2) of a test value over its limit.
    UncertaintyOverLimit,
    /// Calibrated diameters over the body diagonal of the total volume.
    DiameterOverDiagonal,
    /// Longest calibrated length over the body diagonal.
    LongestOverDiagonal,
    /// Longest calibrated length over the shortest side of the volume.
    LongestOverShortestSide,
    /// Calibrated lengths of the artefact.
    Lengths,
    /// Longer side of the plane over the body diagonal.
    LengthOverDiagonal,
    /// Shorter side of the plane, mm.
    WidthMm,
}

impl Quantity {
    /// Factor and unit in which a violation is reported: ratios become mm.
    pub(super) fn reported(self, l0_mm: f64, shortest_mm: f64) -> (f64, &'static str) {
        match self {
            Self::Positions => (1.0, "positions"),
            Self::Views => (1.0, "views"),
            Self::Lengths => (1.0, "lengths"),
            Self::Directions => (1.0, "directions"),
            Self::Coverage
            | Self::ExtentOverVolume
            | Self::ExcludedShare
            | Self::ZoneOverDiameter
            | Self::FormOverLimit
            | Self::UncertaintyOverLimit => (100.0, "%"),
            Self::DiameterOverDiagonal
            | Self::LongestOverDiagonal
            | Self::LengthOverDiagonal
            | Self::ApartOverDiagonal => (l0_mm, "mm"),
            Self::LongestOverShortestSide => (shortest_mm, "mm"),
            Self::WidthMm => (1.0, "mm"),
        }
    }
}

/// A condition that a plan has to fulfil.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Name of the rule in words.
    pub name: String,
    /// Artefacts that it is about.
    pub artefact: Kind,
    /// The quantity that the rule limits.
    pub quantity: Quantity,
    /// Smallest value allowed; absent: no lower limit.
    pub least: Option<f64>,
    /// Largest value allowed; absent: no upper limit.
    pub most: Option<f64>,
    /// How well it is known.
    pub status: Status,
    /// The text that states the rule.
    pub source: String,
}

/// How a value comes about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Statistic {
    /// Range of the residuals.
    FormRange,
    /// Sample standard deviation of the residuals.
    FormSigma,
    /// Narrowest interval with 95 % of the residuals.
    #[serde(rename = "form-d95")]
    FormD95,
    /// Range of the residuals of 25 representative points.
    #[serde(rename = "form-25")]
    Form25,
    /// Measured less calibrated diameter.
    Size,
    /// The same of 25 representative points.
    #[serde(rename = "size-25")]
    Size25,
    /// Measured less calibrated distance of centres.
    Spacing,
    /// Spacing error plus the size error that makes it worst.
    SpacingAndSize,
    /// Measured less calibrated length from the far side of one sphere to that of the other: bidirectional.
    LengthBidirectional,
}

impl Statistic {
    /// Whether it is the error of a length, whose limit may grow with the length.
    pub(super) fn of_length(self) -> bool {
        matches!(self, Self::Spacing | Self::SpacingAndSize | Self::LengthBidirectional)
    }

    /// Whether it is a deviation from the form.
    pub(super) fn of_form(self) -> bool {
        matches!(self, Self::FormRange | Self::FormSigma | Self::FormD95 | Self::Form25)
    }

    fn suits(self, kind: Kind) -> bool {
        match self {
            Self::FormRange | Self::FormSigma | Self::FormD95 => kind != Kind::BallBar,
            Self::Form25 | Self::Size | Self::Size25 => kind == Kind::Sphere,
            Self::Spacing | Self::SpacingAndSize | Self::LengthBidirectional => kind == Kind::BallBar,
        }
    }
}

/// Which points a value is taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CloudOf {
    /// Each pair of a view alone: one sensor.
    Pair,
    /// Each view alone: all pairs of one recording, as the rig file joins them.
    View,
    /// All views of a position, registered into one frame.
    Registered,
}

/// A characteristic to evaluate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CharacteristicRule {
    /// Symbol, unique in the rule set.
    pub symbol: String,
    /// Name of the characteristic in words.
    pub name: String,
    /// How it comes about.
    pub definition: String,
    /// What it is measured on.
    pub artefact: Kind,
    /// How the value is computed from the fits.
    pub statistic: Statistic,
    /// Which points the value is taken from.
    pub cloud: CloudOf,
    /// Whether the standard decides by it.
    pub decides: bool,
    /// How well it is known.
    pub status: Status,
    /// The text that defines the characteristic.
    pub source: Option<String>,
}

impl RuleSet {
    /// Checks a rule set.
    ///
    /// # Errors
    /// Another format, limits that cannot be met, a statistic that does not suit its artefact.
    pub fn check(&self) -> Result<(), AcceptanceError> {
        if self.format != RULES_FORMAT {
            return Err(AcceptanceError::Format { found: self.format.clone(), reads: RULES_FORMAT });
        }
        let bad = |place: &str, key: &'static str, value: f64, limits: &'static str| AcceptanceError::Value {
            place: place.to_owned(),
            key,
            value,
            limits,
        };
        if [&self.id, &self.standard, &self.edition].iter().any(|text| text.trim().is_empty()) {
            return Err(AcceptanceError::Nameless);
        }
        if !(0.0..=0.5).contains(&self.reject_fraction.most) {
            return Err(bad("reject_fraction", "most", self.reject_fraction.most, "0 … 0.5"));
        }
        if self.retest.as_ref().is_some_and(|r| r.measurements == 0 || r.most_positions == 0) {
            return Err(bad("retest", "measurements and most_positions", 0.0, "at least 1"));
        }
        for rule in &self.rules {
            for (key, value) in [("least", rule.least), ("most", rule.most)] {
                if let Some(value) = value.filter(|v| !(v.is_finite() && *v >= 0.0)) {
                    return Err(bad(
                        &format!("rule \"{}\"", rule.name),
                        key,
                        value,
                        "finite and not negative",
                    ));
                }
            }
        }
        for (index, one) in self.characteristics.iter().enumerate() {
            if !one.statistic.suits(one.artefact) {
                return Err(AcceptanceError::Statistic {
                    symbol: one.symbol.clone(),
                    kind: one.artefact.name(),
                });
            }
            if self.characteristics[..index].iter().any(|other| other.symbol == one.symbol) {
                return Err(AcceptanceError::Twice { what: "characteristic", name: one.symbol.clone() });
            }
        }
        Ok(())
    }

    /// Name, edition and wording for reports.
    pub fn id(&self) -> RuleSetId {
        let Self { id, standard, edition, .. } = self;
        let assumed = |status: Status| status == Status::Assumed;
        let mut list = Vec::new();
        if assumed(self.reject_fraction.status) {
            let RejectFraction { most, source, .. } = &self.reject_fraction;
            list.push(format!("rejected fraction at most {:.2} % ({source})", 100.0 * most));
        }
        if let Some(retest) = self.retest.as_ref().filter(|r| assumed(r.status)) {
            let RetestRule { most_positions, measurements, source, .. } = retest;
            list.push(format!(
                "retest: at most {most_positions} positions, {measurements} measurements of each ({source})"
            ));
        }
        for rule in self.rules.iter().filter(|rule| assumed(rule.status)) {
            let limits = [("at least", rule.least), ("at most", rule.most)];
            let limits: Vec<String> =
                limits.iter().filter_map(|(word, limit)| Some(format!("{word} {}", (*limit)?))).collect();
            list.push(format!("{}: {} ({})", rule.name, limits.join(", "), rule.source));
        }
        for one in self.characteristics.iter().filter(|one| assumed(one.status)) {
            list.push(format!(
                "{}: {} ({})",
                one.symbol,
                one.name,
                one.source.as_deref().unwrap_or("no source")
            ));
        }
        RuleSetId {
            id: id.clone(),
            standard: standard.clone(),
            edition: edition.clone(),
            wording: format!("evaluated following {standard}, edition {edition}"),
            assumed: list,
        }
    }
}
