//! What the calibration of the rig adds to the uncertainty of each feature, as `fringetool measure --rig --json` found it on a part.
//!
//! A share hardly changes from part to part that lies alike, and to find it takes seconds; so a cell takes the shares of one part for all.

use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::provenance::Provenance;
use crate::rig_file::RigFile;
use metrology::inspection::Plan;
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

/// What is read of the result of a measurement; it has further keys.
#[derive(Debug, Clone, Deserialize)]
struct Measured {
    features: Vec<Feature>,
    provenance: Provenance,
}

#[derive(Debug, Clone, Deserialize)]
struct Feature {
    name: String,
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
        match serde_json::from_str(&document.text) {
            Ok(found) => Ok(Self { document, found }),
            Err(error) => {
                let problem = Problem::Syntax(format!("is no result of a measurement: {error}"));
                Err(FileError::new(path, problem, REMEDY))
            }
        }
    }

    /// The plan with the share of each of its features.
    ///
    /// # Errors
    /// They were found with another plan or another rig file, or the file lacks the share of a feature.
    pub fn join(&self, plan: Plan, plan_sha256: &str, rig: &RigFile) -> Result<Plan, FileError> {
        let made = &self.found.provenance;
        self.check("plan", made.plan_sha256.as_deref(), plan_sha256, &format!("the plan \"{}\"", plan.name))?;
        self.check("rig file", made.rig_sha256.as_deref(), &rig.sha256, &rig.path.display().to_string())?;
        let shares = plan.features.iter().map(|feature| self.share(&feature.name).map(Some));
        let shares = shares.collect::<Result<Vec<_>, _>>()?;
        Ok(plan.with_calibration(&shares))
    }

    fn check(
        &self,
        what: &'static str,
        here: Option<&str>,
        wanted: &str,
        there: &str,
    ) -> Result<(), FileError> {
        if here == Some(wanted) {
            return Ok(());
        }
        let here = match here {
            Some(sha256) => format!("this part was measured with one of SHA-256 {sha256}"),
            None => "this part was measured without one".to_owned(),
        };
        let problem = Problem::Disagreement { what, here, there: format!("{there} has {wanted}") };
        let key = format!("provenance.{}_sha256", if what == "plan" { "plan" } else { "rig" });
        Err(FileError::new(&self.document.path, problem, REMEDY).at(&key))
    }

    fn share(&self, name: &str) -> Result<f64, FileError> {
        let place = self.found.features.iter().position(|feature| feature.name == name);
        let share = place.and_then(|place| self.found.features[place].u_calibration);
        let fault = |problem| {
            let key = place.map_or("features".to_owned(), |place| format!("features[{place}].u_calibration"));
            Err(FileError::new(&self.document.path, problem, REMEDY).at(&key))
        };
        match share {
            Some(share) if share.is_finite() && share >= 0.0 => Ok(share),
            Some(share) => fault(Problem::Value { value: share.to_string(), limit: "0 and more".into() }),
            None => fault(Problem::Missing(format!("the share of feature \"{name}\""))),
        }
    }
}
