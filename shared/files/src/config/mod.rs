//! The cell configuration: one page of TOML that says what the whole cell is.
//!
//! Two stages: `RawConfig` is what is written (unknown keys refused), [`Config`] is what is meant (every reference
//! resolved, every gap found). A [`Config`] that exists can be run.
//!
//! ```toml
//! format = "fringecell-config/1"
//! name = "demo"                       # [a-z0-9-]{1,32}: the runtime root and the service prefix derive from it
//! rig = "demo-rig.toml"               # what the measuring side knows; paths are relative to this file
//! plan = "artefact.plan.toml"         # optional inspection plan: the recipe "default"
//! cycles = 5                          # optional; absent: until stopped
//! pairs = ["pair1"]                   # optional; absent: all pairs of the rig file
//! [limits]                            # all optional, defaults as in [`Limits`]
//! stage_budget_ms = 5000
//! [[projector]]
//! name = "proj1"
//! driver = "twin"                     # twin | recording
//! width_px = 608                      # width, height, cameras, sequence: with driver "recording" they may be left
//! height_px = 684                     # out and are then those of the recording
//! cameras = ["cam1", "cam2"]
//! sequence = [{ set = "sine", axis = "x", period_px = 16.0, steps = 10 }, …]
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
//! lock_memory = false                 # keep all buffers in memory from the start (mlockall), where permitted
//! ```

mod check;
mod graph;
mod light;
mod limits;
mod raw;
mod recipes;
#[cfg(test)]
mod tests;
mod values;

use crate::correction::PatternCorrection;
use crate::document::{Document, read_text};
use crate::error::FileError;
use crate::hash::sha256_hex;
use crate::recording::Recording;
use fringe::geometry::rig::Rig;
use fringe::pattern::PatternSet;
use std::path::{Path, PathBuf};

/// Value of `format` in a configuration.
pub const CONFIG_FORMAT: &str = "fringecell-config/1";

/// Name of the recipe that is used where none is named.
pub const DEFAULT_RECIPE: &str = "default";

/// A cell, checked and with every file resolved.
#[derive(Debug, Clone)]
pub struct Config {
    /// The file itself, for messages that point into it.
    pub document: Document,
    /// SHA-256 of its bytes.
    pub sha256: String,
    /// Cell name: `[a-z0-9-]{1,32}`.
    pub name: String,
    /// Number of cycles; `None`: until stopped.
    pub cycles: Option<u32>,
    /// What the measuring side knows. Its pairs are those that the cell runs, in the order of the rig file, each
    /// with its projector.
    pub rig: Rig,
    /// Where the rig was read from.
    pub rig_path: PathBuf,
    /// SHA-256 of the rig file.
    pub rig_sha256: String,
    /// Inspection plan: that of the recipe [`DEFAULT_RECIPE`].
    pub plan: Option<TextFile>,
    /// Further inspection plans.
    pub recipes: Vec<Recipe>,
    /// Budgets and restart policy.
    pub limits: Limits,
    /// What lights, in the order of projection.
    pub projectors: Vec<ProjectorConfig>,
    /// What looks.
    pub cameras: Vec<CameraConfig>,
    /// `[decode]`, as written.
    pub decode: toml::Table,
    /// `[matching]`, as written.
    pub matching: toml::Table,
    /// `[fusion]`, as written.
    pub fusion: toml::Table,
    /// The digital twin; present whenever a driver needs it.
    pub twin: Option<TwinConfig>,
    /// The recording to play; present whenever a driver needs it.
    pub recording: Option<RecordingConfig>,
    /// Cores.
    pub schedule: ScheduleConfig,
}

/// Where frames come from or patterns go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driver {
    /// The digital twin.
    Twin,
    /// A folder of frames.
    Recording,
}

/// A text file that another part of the program reads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextFile {
    /// Absolute.
    pub path: PathBuf,
    /// Contents.
    pub text: String,
}

/// An inspection plan that a request can choose.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recipe {
    /// Unique; [`DEFAULT_RECIPE`] is taken.
    pub name: String,
    /// What is inspected.
    pub plan: TextFile,
}

/// A projector of the cell.
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectorConfig {
    /// Unique among projectors and cameras.
    pub name: String,
    /// Driver.
    pub driver: Driver,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Who looks while it is on.
    pub cameras: Vec<String>,
    /// What it shows.
    pub sequence: Vec<PatternSet>,
    /// How levels are drawn so that the light is proportional to them.
    pub pattern_correction: Option<PatternCorrection>,
}

/// A camera of the cell.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraConfig {
    /// As in the rig file.
    pub name: String,
    /// Driver.
    pub driver: Driver,
    /// Columns, from the rig file.
    pub width_px: u32,
    /// Rows, from the rig file.
    pub height_px: u32,
}

/// Budgets and restart policy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// A stage without progress for this long while it has work is hung, ms. Default 5000.
    pub stage_budget_ms: u64,
    /// A cycle that has not ended by then is ended, ms. Default 20 000.
    pub cycle_deadline_ms: u64,
    /// A stage must report ready this long after its start, ms. Default 20 000.
    pub start_ms: u64,
    /// A stage that was asked to stop is killed after this long, ms. Default 3000.
    pub stop_ms: u64,
    /// Restarts of one stage within the window before the cell gives up. Default 5.
    pub restarts_max: u32,
    /// The window, ms. Default 60 000.
    pub restart_window_ms: u64,
}

/// What the twin simulates.
#[derive(Debug, Clone)]
pub struct TwinConfig {
    /// The scene file; the twin crate parses it.
    pub scene: TextFile,
    /// The true rig, with projectors. The measuring side must not look at it.
    pub rig: Rig,
    /// Where the true rig was read from.
    pub rig_path: PathBuf,
    /// SHA-256 of the true rig's file.
    pub rig_sha256: String,
    /// Seed of all noise.
    pub seed: u64,
    /// `settings`, as written.
    pub settings: toml::Table,
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

/// Cores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ScheduleConfig {
    /// Cores to plan for. Default 2. A constant of the cell, not of the machine: the schedule depends on it.
    pub cores: u32,
    /// How many cycles may be under way at once, 1 … 4. Default 1. From 2 on the next cycle is acquired while the last one
    /// is evaluated.
    pub cycles_in_flight: u32,
    /// Pin each stage to its planned core. Default false.
    pub pin: bool,
    /// `SCHED_FIFO` priority of the stages; the supervisor takes the one above, so that it can end a stage that spins.
    /// Absent: none.
    pub realtime_priority: Option<u32>,
    /// Whether each stage keeps all its memory resident. Default false.
    pub lock_memory: bool,
}

impl Config {
    /// A projector by name.
    pub fn projector(&self, name: &str) -> Option<&ProjectorConfig> {
        self.projectors.iter().find(|projector| projector.name == name)
    }

    /// Names of the projectors that draw corrected patterns.
    pub fn corrected(&self) -> impl Iterator<Item = &str> {
        self.projectors.iter().filter(|p| p.pattern_correction.is_some()).map(|p| p.name.as_str())
    }

    /// All that was read, each with its SHA-256, the configuration first: equal hashes mean the same cell. Frames and
    /// meshes are not among it; they are what the cell looks at.
    pub fn read_files(&self) -> Vec<(String, String)> {
        let mut files: Vec<(String, String)> =
            self.hashed().into_iter().map(|(path, sha256)| (path.display().to_string(), sha256)).collect();
        for projector in &self.projectors {
            let correction = projector.pattern_correction.as_ref().map(PatternCorrection::sha256);
            let name = format!("the pattern correction of projector \"{}\"", projector.name);
            files.extend(correction.map(|sha256| (name, sha256)));
        }
        files
    }

    /// The files among [`Self::read_files`] that have a path here: what no output may overwrite.
    pub fn paths(&self) -> Vec<&Path> {
        self.hashed().into_iter().map(|(path, _)| path).collect()
    }

    fn hashed(&self) -> Vec<(&Path, String)> {
        let text = |file: &TextFile| sha256_hex(file.text.as_bytes());
        let mut files = vec![
            (self.document.path.as_path(), self.sha256.clone()),
            (&self.rig_path, self.rig_sha256.clone()),
        ];
        let plans = self.plan.iter().chain(self.recipes.iter().map(|recipe| &recipe.plan));
        files.extend(plans.map(|plan| (plan.path.as_path(), text(plan))));
        if let Some(twin) = &self.twin {
            files.push((&twin.scene.path, text(&twin.scene)));
            files.push((&twin.rig_path, twin.rig_sha256.clone()));
        }
        if let Some(RecordingConfig { recording, .. }) = &self.recording {
            files.push((&recording.document.path, recording.sha256.clone()));
        }
        files
    }

    /// A camera by name.
    pub fn camera(&self, name: &str) -> Option<&CameraConfig> {
        self.cameras.iter().find(|camera| camera.name == name)
    }
}

impl TextFile {
    /// Reads a text file.
    ///
    /// # Errors
    /// As [`read_text`].
    pub fn read(path: &Path) -> Result<Self, FileError> {
        Ok(Self { path: path.to_owned(), text: read_text(path)? })
    }
}
