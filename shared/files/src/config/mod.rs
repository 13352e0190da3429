//! The cell configuration: one page of TOML that states what the whole cell is.
//!
//! Two steps: `RawConfig` is what is written (unknown keys refused), [`Configuration`] is what is meant (every reference
//! resolved, every gap found). A configuration that exists can be run.
//!
//! ```toml
//! format = "fringecell-config/1"
//! name = "demo"                       # [a-z0-9-]{1,32}: the runtime root and the service prefix derive from it
//! rig = "demo-rig.toml"               # what the measuring side knows; paths are relative to this file
//! plan = "artefact.plan.toml"         # optional inspection plan: the recipe "default"
//! calibration_shares = "part.json"    # optional: result of `fringetool measure --rig` on a part, whose shares join every uncertainty
//! cycles = 5                          # optional; absent: until stopped
//! pairs = ["pair1"]                   # optional; absent: all pairs of the rig file
//! [limits]                            # all optional, defaults as in [`Limits`]
//! stage_budget_ms = 5000
//! [[projector]]
//! name = "proj1"
//! driver = "twin"                     # twin | recording | network | screen | lightcrafter
//! width_px = 608                      # width, height, cameras, sequence: with driver "recording" they may be left
//! height_px = 684                     # out and are then those of the recording
//! cameras = ["cam1", "cam2"]
//! sequence = [{ set = "sine", axis = "x", period_px = 16.0, steps = 10 }, …]
//! trigger = "stepped"                 # or "sequenced" with period_ms: the projector fires the cameras
//! pattern_correction = "gamma.toml"   # optional, from `fringetool gamma`; not with driver "recording"
//! [[camera]]
//! name = "cam1"
//! driver = "twin"
//! [[recipe]]                          # optional further plans, any of which a request may name
//! name = "spheres"
//! plan = "spheres.plan.toml"
//! [decode]                            # settings of decode, matching, fusion: all optional
//! [twin]                              # needed by the twin drivers
//! scene = "artefact.scene.toml"
//! rig = "demo-rig.toml"               # optional: the true rig, with projectors; absent: the rig above
//! seed = 1
//! settings = {}                       # optional
//! [recording]                         # needed by the recording drivers
//! path = "scan1"
//! rate_hz = 0                         # 0: as fast as possible
//! loop = true                         # begin again at the end
//! [schedule]
//! cores = 2
//! cycles_in_flight = 1                # 2 … 4: the next cycle is acquired while the last one is evaluated
//! pin = false
//! realtime_priority = 50              # optional, 1 … 98: first come first served by the kernel (SCHED_FIFO), where permitted
//! together = "auto"                   # or groups of names: projectors whose light does not meet show at the same time
//! lock_memory = false                 # keep all buffers in memory from the start (mlockall), where permitted
//! [warm_up]                           # no cycle is ok before the temperature of the cameras has settled
//! max_change_k = 0.5
//! window_s = 600
//! [results]                           # what a cell that runs without end keeps; the oldest are removed
//! keep_results = 100000
//! keep_parts = 1000                   # cloud and report of so many; 0: none
//! keep_mb = 10000
//! formats = ["pdf", "qif"]             # further files of each result: html, pdf, csv, qif, dfq
//! [[host]]                            # optional: the computers of a cell that runs on several
//! name = "left"
//! pairs = ["pair1"]                   # its cameras and projectors are connected to this host
//! listen = "192.168.1.10:7447"        # of one host, which leads: where the others find it
//! ```

mod check;
mod devices;
mod hosts;
mod limits;
mod projector_output;
mod projector_relations;
mod projectors;
mod raw;
mod recipes;
mod references;
#[cfg(test)]
mod tests;
mod together;
mod trigger;
mod values;
mod warm_up;

pub use together::{Meeting, meetings};

use crate::correction::PatternCorrection;
use crate::document::Document;
use crate::hash::sha256_hex;
use crate::recording::Recording;
use crate::scene_file::MeshFile;
use cell::Configuration;
use fringe::geometry::rig::Rig;
use metrology::inspection::Plan;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use twin::TwinSettings;

/// Value of `format` in a configuration.
pub const CONFIG_FORMAT: &str = "fringecell-config/1";

/// The file of a cell, and what it means.
#[derive(Debug, Clone)]
pub struct Config {
    /// The file itself, for messages that point into it.
    pub document: Document,
    /// SHA-256 of its bytes.
    pub sha256: String,
    /// The cell: checked, with every file resolved.
    pub cell: Configuration,
    /// Where the rig was read from.
    pub rig_path: PathBuf,
    /// SHA-256 of the rig file.
    pub rig_sha256: String,
    /// Whether the rig file names the covariance of its calibration.
    pub has_covariance: bool,
    /// The files of all recipes, in their order: each plan, and after it that of the calibration's shares where the recipe names one.
    pub plans: Vec<Document>,
    /// The pattern correction of each projector that has one.
    pub corrections: BTreeMap<String, PatternCorrection>,
    /// The digital twin; present whenever a driver needs it.
    pub twin: Option<TwinConfig>,
    /// The recording to play; present whenever a driver needs it.
    pub recording: Option<RecordingConfig>,
    /// How much a cell that runs without end keeps of its results.
    pub results: ResultRetention,
    /// Formats beside JSON that each result with features is written in, each once.
    pub formats: Vec<ResultFormat>,
}

/// A format of the result of a cycle, beside JSON.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ResultFormat {
    /// Report as one HTML file.
    Html,
    /// Report as PDF, A4.
    Pdf,
    /// Table with one line a feature.
    Csv,
    /// QIF 3.0 with plan and results (ISO 23952).
    Qif,
    /// Q-DAS ASCII transfer format.
    Dfq,
}

impl ResultFormat {
    /// All formats, in their order.
    pub const ALL: [Self; 5] = [Self::Html, Self::Pdf, Self::Csv, Self::Qif, Self::Dfq];

    /// Its name in a configuration, which also ends the names of its files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Html => "html",
            Self::Pdf => "pdf",
            Self::Csv => "csv",
            Self::Qif => "qif",
            Self::Dfq => "dfq",
        }
    }
}

/// How much a cell that runs without end keeps of its results, earlier runs in the same folder included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ResultRetention {
    /// Result files of the cycles.
    pub results: u64,
    /// Parts whose cloud and report are kept; 0: none.
    pub parts: u64,
    /// Size of clouds and reports in all, MB.
    pub size_mb: u64,
}

/// What the twin simulates.
#[derive(Debug, Clone)]
pub struct TwinConfig {
    /// The scene file; [`crate::scene_file`] parses it.
    pub scene: Document,
    /// The meshes that the scene names.
    pub meshes: Vec<MeshFile>,
    /// The true rig, with projectors. The measuring side must not look at it.
    pub rig: Rig,
    /// Where the true rig was read from.
    pub rig_path: PathBuf,
    /// SHA-256 of the true rig's file.
    pub rig_sha256: String,
    /// `settings`, checked, with the seed of all noise.
    pub settings: TwinSettings,
}

/// The recording that the recording drivers play.
#[derive(Debug, Clone)]
pub struct RecordingConfig {
    /// Opened and checked; its folder is absolute.
    pub recording: Recording,
    /// Frames per second; 0: as fast as possible.
    pub rate_hz: f64,
    /// Begin again at the end.
    pub repeat: bool,
}

impl Config {
    /// Names of the projectors that draw corrected patterns.
    pub fn corrected(&self) -> impl Iterator<Item = &str> {
        self.cell.projectors.iter().filter(|p| p.level_table.is_some()).map(|p| p.name.as_str())
    }

    /// Names of the recipes in whose verdicts the calibration counts for nothing, although the rig file says what is known of it: without its
    /// shares, and with features for which the plan states nothing either.
    pub fn without_calibration(&self) -> Vec<&str> {
        let holds_none = |plan: &Plan| {
            plan.features.iter().any(|feature| feature.u_calibration.is_none() && feature.u_system == 0.0)
        };
        let recipes = self.cell.recipes.iter().filter(|recipe| recipe.plan.as_ref().is_some_and(holds_none));
        recipes.filter(|_| self.has_covariance).map(|recipe| recipe.name.as_str()).collect()
    }

    /// All that was read, each with its hash, the configuration first: equal hashes mean the same cell. Frames are not among
    /// it; each camera knows its own.
    pub fn read_files(&self) -> Vec<(String, String)> {
        let mut files: Vec<(String, String)> =
            self.hashed().into_iter().map(|(path, sha256)| (path.display().to_string(), sha256)).collect();
        let corrections = self.corrections.iter();
        files.extend(corrections.map(|(projector, correction)| {
            (format!("the pattern correction of projector \"{projector}\""), correction.sha256())
        }));
        files
    }

    /// The files among [`Self::read_files`] that have a path here: what no output may overwrite.
    pub fn paths(&self) -> Vec<&Path> {
        self.hashed().into_iter().map(|(path, _)| path).collect()
    }

    fn hashed(&self) -> Vec<(&Path, String)> {
        let text = |file: &Document| sha256_hex(file.text.as_bytes());
        let mut files = vec![
            (self.document.path.as_path(), self.sha256.clone()),
            (&self.rig_path, self.rig_sha256.clone()),
        ];
        files.extend(self.plans.iter().map(|plan| (plan.path.as_path(), text(plan))));
        if let Some(twin) = &self.twin {
            files.push((&twin.scene.path, text(&twin.scene)));
            files.push((&twin.rig_path, twin.rig_sha256.clone()));
            files.extend(twin.meshes.iter().map(|mesh| (mesh.path.as_path(), format!("{:032x}", mesh.hash))));
        }
        if let Some(RecordingConfig { recording, .. }) = &self.recording {
            files.push((&recording.document.path, recording.sha256.clone()));
        }
        files
    }
}
