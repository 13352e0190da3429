//! What the calibration of the rig adds to the uncertainty of each feature, as `fringetool measure --rig --json` found it on a part.
//!
//! A share hardly changes from part to part that lies alike, and to find it takes seconds; so a cell takes the shares of one part for all.

use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::provenance::Provenance;
use crate::result::parse_json;
use fringe::geometry::rig::Pair;
use metrology::inspection::{Plan, Unit};
use serde::Deserialize;
use std::path::Path;

/// Remedy of every fault of such a file.
const REMEDY: &str = "measure a part anew with `fringetool measure PLAN CLOUD --rig RIG --json FILE`";

/// Shares that were found on one part.
#[derive(Debug, Clone)]
pub struct CalibrationShares {
    /// The file that they were read from.
    pub document: Document,
    found: Measured,
}

/// A larger share proves nothing, mm or degrees.
const MOST: f64 = 1e3;

/// What is read of the result of a measurement; it has further keys.
#[derive(Debug, Clone, Deserialize)]
struct Measured {
    features: Vec<Feature>,
    provenance: Provenance,
    /// Names of the pairs whose points were measured; only with a rig file.
    #[serde(default)]
    pairs: Option<Vec<String>>,
    /// SHA-256 of the rig file that the cloud was made with, where it is known.
    #[serde(default)]
    cloud_rig_sha256: Option<String>,
}

#[derive(Debug, Clone, Deserialize)]
struct Feature {
    name: String,
    unit: Unit,
    #[serde(default)]
    u_calibration: Option<f64>,
}

impl CalibrationShares {
    /// Reads the result of a measurement.
    ///
    /// # Errors
    /// A file that cannot be read, or another one than such a result.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let document = Document::read(path)?;
        let found = parse_json(path, &document.text).map_err(|fault| {
            let problem = Problem::Syntax(format!("is no result of a measurement ({})", fault.problem));
            FileError { problem: Box::new(problem), remedy: REMEDY.into(), ..fault }
        })?;
        Ok(Self { document, found })
    }

    /// The plan with the share of each of its features; `rig` is SHA-256 and path of the rig file, and the pairs that the cell measures.
    ///
    /// # Errors
    /// They were found with another plan, another rig file or other pairs, or the file lacks the share of a feature.
    pub fn join(
        &self,
        plan: Plan,
        plan_sha256: &str,
        (rig_sha256, rig, pairs): (&str, &Path, &[Pair]),
    ) -> Result<Plan, FileError> {
        let made = &self.found.provenance;
        let plans = ("plans", "provenance.plan_sha256", format!("the plan \"{}\"", plan.name));
        self.check(plans, made.plan_sha256.as_deref(), plan_sha256)?;
        let rigs = |key| ("rig files", key, rig.display().to_string());
        self.check(rigs("provenance.rig_sha256"), made.rig_sha256.as_deref(), rig_sha256)?;
        self.check(rigs("cloud_rig_sha256"), self.found.cloud_rig_sha256.as_deref(), rig_sha256)?;
        self.check_pairs(pairs)?;
        let shares = plan.features.iter().map(|one| self.share(&one.name, one.quantity.unit()).map(Some));
        let shares = shares.collect::<Result<Vec<_>, _>>()?;
        Ok(plan.with_calibration(&shares))
    }

    fn fault(&self, key: &str, problem: Problem) -> FileError {
        FileError::new(&self.document.path, problem, REMEDY).at(key)
    }

    fn check(
        &self,
        (what, key, there): (&'static str, &str, String),
        here: Option<&str>,
        wanted: &str,
    ) -> Result<(), FileError> {
        if here == Some(wanted) {
            return Ok(());
        }
        let here = match here {
            Some(sha256) => format!("this part was measured with SHA-256 {sha256}"),
            None => "this part was measured with an unknown one".to_owned(),
        };
        let there = format!("{there} has SHA-256 {wanted}");
        Err(self.fault(key, Problem::Disagreement { what, here, there }))
    }

    fn check_pairs(&self, pairs: &[Pair]) -> Result<(), FileError> {
        let mut wanted: Vec<&str> = pairs.iter().map(|pair| pair.name.as_str()).collect();
        let Some(found) = &self.found.pairs else {
            return Err(
                self.fault("pairs", Problem::Missing("the list of the pairs that saw the part".into()))
            );
        };
        let mut here: Vec<&str> = found.iter().map(String::as_str).collect();
        wanted.sort_unstable();
        here.sort_unstable();
        if here == wanted {
            return Ok(());
        }
        let problem = Problem::Disagreement {
            what: "pairs",
            here: format!("this part was seen by {}", here.join(", ")),
            there: format!("the cell measures with {}", wanted.join(", ")),
        };
        Err(self.fault("pairs", problem))
    }

    fn share(&self, name: &str, unit: Unit) -> Result<f64, FileError> {
        let mut named = self.found.features.iter().enumerate().filter(|(_, feature)| feature.name == name);
        let Some((place, feature)) = named.next() else {
            return Err(self.fault("features", Problem::Missing(format!("feature \"{name}\""))));
        };
        let key = |of: &str| format!("features[{place}].{of}");
        if named.next().is_some() {
            let problem = Problem::Duplicate { kind: "feature", name: name.to_owned() };
            return Err(self.fault(&key("name"), problem));
        }
        if feature.unit != unit {
            let problem =
                Problem::Value { value: feature.unit.to_string(), limit: format!("the plan has {unit}") };
            return Err(self.fault(&key("unit"), problem));
        }
        match feature.u_calibration {
            Some(share) if (0.0..=MOST).contains(&share) => Ok(share),
            Some(share) => {
                let problem = Problem::Value { value: share.to_string(), limit: format!("0 … {MOST}") };
                Err(self.fault(&key("u_calibration"), problem))
            }
            None => {
                let problem = Problem::Missing(format!("the share of feature \"{name}\""));
                Err(self.fault(&key("u_calibration"), problem))
            }
        }
    }
}
