//! What a result was made with: when, of which part, by which cell, software, rig and plan.
//!
//! It stands beside what was measured and never in anything that is hashed or compared between runs.

use crate::clock;
use serde::{Deserialize, Serialize};

/// A program that makes results.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Software {
    /// Name of the program: `fringecell` or `fringetool`.
    pub name: &'static str,
    /// Version of the program, from Cargo.toml.
    pub version: &'static str,
    /// The git commit that it was built from, with `-dirty` where files differed from it; `unknown` without git.
    pub commit: &'static str,
}

impl Software {
    /// Name, version and commit on one line, for reports.
    pub fn line(&self) -> String {
        format!("{} {} ({})", self.name, self.version, self.commit)
    }
}

/// What a machine-readable result was made with; the key `provenance` of every `--json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// When it was written, UTC (ISO 8601): `2026-01-31T08:00:00Z`.
    pub date: String,
    /// Name of the program.
    pub software: String,
    /// Version of the program.
    pub version: String,
    /// The git commit that it was built from, or `unknown`.
    pub commit: String,
    /// The cell, where one measured.
    pub cell: Option<String>,
    /// The part, where one is named.
    pub part: Option<String>,
    /// The recipe, where there is one.
    pub recipe: Option<String>,
    /// SHA-256 of the rig file, hexadecimal, where one was used.
    pub rig_sha256: Option<String>,
    /// SHA-256 of the inspection plan or test plan, hexadecimal, where one was used.
    pub plan_sha256: Option<String>,
}

impl Provenance {
    /// Of a result that is written now.
    pub fn now(software: &Software) -> Self {
        Self {
            date: clock::rfc3339_now(),
            software: software.name.to_owned(),
            version: software.version.to_owned(),
            commit: software.commit.to_owned(),
            cell: None,
            part: None,
            recipe: None,
            rig_sha256: None,
            plan_sha256: None,
        }
    }

    /// Made with a rig file of this SHA-256.
    #[must_use]
    pub fn rig(self, sha256: &str) -> Self {
        Self { rig_sha256: Some(sha256.to_owned()), ..self }
    }

    /// Made with a plan of this name and SHA-256.
    #[must_use]
    pub fn plan(self, part: &str, sha256: &str) -> Self {
        Self { part: Some(part.to_owned()), plan_sha256: Some(sha256.to_owned()), ..self }
    }
}

/// A result with its provenance beside its own keys.
#[derive(Debug, Serialize)]
pub struct WithProvenance<'a, T> {
    /// The result: an object.
    #[serde(flatten)]
    pub result: &'a T,
    /// What it was made with.
    pub provenance: Provenance,
}
