//! The checked configuration of a cell: every reference is resolved, and no file is needed any more.
//!
//! `files` reads it from TOML and points into that file where something is wrong.

use crate::genicam_camera::GenicamCamera;
use crate::lightcrafter::{Controller, Led, PatternSource};
use fringe::decode::DecodeSettings;
use fringe::fusion::FusionSettings;
use fringe::geometry::rig::Rig;
use fringe::matching::MatchSettings;
use fringe::pattern::{LevelTable, PatternError, PatternSet, frame_count, locate};
use metrology::inspection::Plan;
use std::net::SocketAddr;

/// Name of the recipe that is used where none is named.
pub const DEFAULT_RECIPE: &str = "default";

/// A cell as its configuration means it.
#[derive(Debug, Clone)]
pub struct Configuration {
    /// Name of the cell.
    pub name: String,
    /// Number of cycles; `None`: until stopped.
    pub cycles: Option<u32>,
    /// What the measuring side knows. Its pairs are those that the cell runs, in the order of the rig file, each
    /// with its projector.
    pub rig: Rig,
    /// Budgets and restart policy.
    pub limits: Limits,
    /// What lights, in the order of projection.
    pub projectors: Vec<ProjectorConfig>,
    /// Cameras, in the order of the configuration.
    pub cameras: Vec<CameraConfig>,
    /// How frames become points.
    pub settings: Settings,
    /// All that a request may choose; at least one. The first one counts where none is named.
    pub recipes: Vec<Recipe>,
    /// Cores and cycles in flight.
    pub schedule: ScheduleConfig,
    /// Groups of projectors that show at the same time, by their indices; those in none show alone. Empty where nothing was asked for.
    pub together: Vec<Vec<usize>>,
    /// Frames per second of a recording that is played, if one is; 0: as fast as possible.
    pub rate_hz: Option<f64>,
    /// When the cameras count as warm; absent: always.
    pub warm_up: Option<WarmUp>,
    /// The computers of a cell that can run on several, at least two; none: it runs on one.
    pub hosts: Vec<HostConfig>,
}

/// A computer of a cell that runs on several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HostConfig {
    /// Unique among the hosts of the cell.
    pub name: String,
    /// Names of the pairs whose cameras and projectors are connected to it.
    pub pairs: Vec<String>,
    /// Where the host that leads waits for the others; exactly one host has it.
    pub listen: Option<SocketAddr>,
}

/// When the temperature of the cameras has settled: before that no cycle is ok.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarmUp {
    /// Largest change within the window, K.
    pub max_change_k: f64,
    /// Time over which the temperature must be known, s.
    pub window_s: f64,
}

/// How frames become points: the tables `[decode]`, `[matching]` and `[fusion]`.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Settings of the decoder.
    pub decode: DecodeSettings,
    /// Of the matcher; depth and surface hold for pairs of a camera and a projector too.
    pub matching: MatchSettings,
    /// Settings of the fusion.
    pub fusion: FusionSettings,
}

/// A way to inspect a part.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Unique; [`DEFAULT_RECIPE`] is the plan at the top of the configuration.
    pub name: String,
    /// What is inspected, with the shares of the calibration where they are known; absent: nothing, the cloud alone is wanted.
    pub plan: Option<Plan>,
    /// SHA-256 of the file of the plan.
    pub plan_sha256: Option<String>,
    /// SHA-256 of the file of the calibration's shares, where it has one.
    pub calibration_shares_sha256: Option<String>,
}

/// Where frames come from or patterns go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Driver {
    /// The digital twin simulates the device.
    Twin,
    /// A folder of frames.
    Recording,
    /// A GenICam camera: GigE Vision, or USB3 Vision.
    Genicam,
    /// A projector that another program drives: it receives over the network what to show.
    Network,
    /// A projector that is a screen of this computer.
    Screen,
    /// A projector board with its own pattern memory, over USB.
    LightCrafter,
}

impl Driver {
    /// All drivers, in the order in which messages name them.
    pub const ALL: [Self; 6] =
        [Self::Twin, Self::Recording, Self::Genicam, Self::Network, Self::Screen, Self::LightCrafter];

    /// Name in the configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Twin => "twin",
            Self::Recording => "recording",
            Self::Genicam => "genicam",
            Self::Network => "network",
            Self::Screen => "screen",
            Self::LightCrafter => "lightcrafter",
        }
    }

    /// Whether it drives projectors and no cameras.
    pub fn is_light(self) -> bool {
        match self {
            Self::Network | Self::Screen | Self::LightCrafter => true,
            Self::Twin | Self::Recording | Self::Genicam => false,
        }
    }

    /// Whether the frames show the world, not a simulation or a recording.
    pub fn is_live(self) -> bool {
        match self {
            Self::Genicam | Self::Network | Self::Screen | Self::LightCrafter => true,
            Self::Twin | Self::Recording => false,
        }
    }
}

/// Who fires the cameras, and when.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum TriggerMode {
    /// A pattern is shown; when it stands the cameras are triggered; when all have exposed the next one is shown.
    #[default]
    Stepped,
    /// The projector shows its whole sequence in its own time, one pattern every so many ms, and fires the cameras with each.
    Sequenced {
        /// From one pattern to the next, ms.
        period_ms: f64,
    },
}

impl TriggerMode {
    /// Name in the configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stepped => "stepped",
            Self::Sequenced { .. } => "sequenced",
        }
    }
}

/// A screen of this computer that is a projector.
#[derive(Debug, Clone, PartialEq)]
pub struct ScreenSettings {
    /// The X11 display, such as ":0"; absent: that of the environment.
    pub display: Option<String>,
    /// Which output of the display.
    pub place: ScreenPlace,
    /// Refreshes in a second, Hz.
    pub refresh_hz: f64,
    /// Refreshes from the moment that the display has presented a pattern until the projector's light stands.
    pub delay_refreshes: u32,
}

/// An output of the display.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ScreenPlace {
    /// By its name, such as "HDMI-1".
    Output(String),
    /// By the place of its top left corner on the desktop, px.
    Corner([i32; 2]),
}

/// A projector board with its own pattern memory.
#[derive(Debug, Clone, PartialEq)]
pub struct LightCrafterSettings {
    /// The controller of the board.
    pub controller: Controller,
    /// Where the patterns come from.
    pub source: PatternSource,
    /// Exposure of a pattern, µs.
    pub exposure_us: u32,
    /// From pattern to pattern, µs.
    pub period_us: u32,
    /// Which of its lights shines.
    pub led: Led,
    /// Patterns of black and white alone have one bit; else all have eight.
    pub one_bit: bool,
    /// Number in flash of the first image, from 0.
    pub first_image: u8,
    /// From the start of a pattern until its light stands, ms.
    pub settle_ms: u32,
    /// Path of the device, or serial number; absent: the only board there is.
    pub device: Option<String>,
    /// With patterns from the video input: the output that they are shown on.
    pub screen: Option<ScreenSettings>,
}

/// A projector of the cell.
#[derive(Debug, Clone, PartialEq)]
pub struct ProjectorConfig {
    /// Unique among projectors and cameras.
    pub name: String,
    /// Where the patterns go to.
    pub driver: Driver,
    /// Columns of the projector, px.
    pub width_px: u32,
    /// Rows of the projector, px.
    pub height_px: u32,
    /// Who looks while it is on.
    pub cameras: Vec<String>,
    /// Pattern sets, in the order of projection.
    pub sequence: Vec<PatternSet>,
    /// Exposure times, ms, of a recording that has several: all of the sequence is seen once for each. Else empty.
    pub exposures_ms: Vec<f64>,
    /// Of a projector that another program works: its address.
    pub address: Option<SocketAddr>,
    /// Refreshes in a second, Hz, where they are stated and the screen does not have them.
    pub refresh_hz: Option<f64>,
    /// Who fires the cameras.
    pub trigger: TriggerMode,
    /// Of a projector that is a screen.
    pub screen: Option<ScreenSettings>,
    /// Of a projector board.
    pub lightcrafter: Option<LightCrafterSettings>,
    /// How levels are drawn so that the light is proportional to them.
    pub level_table: Option<LevelTable>,
}

impl ProjectorConfig {
    /// A projector that nobody looks at yet, with nothing but its patterns.
    pub fn new(
        name: &str,
        driver: Driver,
        [width_px, height_px]: [u32; 2],
        sequence: Vec<PatternSet>,
    ) -> Self {
        Self {
            name: name.to_owned(),
            driver,
            width_px,
            height_px,
            cameras: Vec::new(),
            sequence,
            exposures_ms: Vec::new(),
            address: None,
            refresh_hz: None,
            trigger: TriggerMode::Stepped,
            screen: None,
            lightcrafter: None,
            level_table: None,
        }
    }

    /// Frames of a cycle: those of the sequence, once for each exposure.
    pub fn frames(&self) -> usize {
        frame_count(&self.sequence) * self.exposures_ms.len().max(1)
    }

    /// Columns and rows, px.
    pub fn size_px(&self) -> [u32; 2] {
        [self.width_px, self.height_px]
    }

    /// The screen that shows its pictures, its own or that behind a board's video input.
    pub fn shown_on(&self) -> Option<&ScreenSettings> {
        self.screen.as_ref().or_else(|| self.lightcrafter.as_ref()?.screen.as_ref())
    }

    /// Period in which the light comes, µs: a refresh, or a pattern of a board; `None`: nobody knows.
    pub fn light_period_us(&self) -> Option<f64> {
        let refresh_hz = self.shown_on().map(|screen| screen.refresh_hz).or(self.refresh_hz);
        let board = self.lightcrafter.as_ref();
        refresh_hz.map(|hz| 1e6 / hz).or(board.map(|board| f64::from(board.period_us)))
    }

    /// From the command to show a frame until its light stands, µs, as far as the configuration states it.
    pub fn settle_us(&self) -> f64 {
        let board = self.lightcrafter.as_ref();
        let shown_us = self
            .shown_on()
            .map_or(0.0, |screen| f64::from(screen.delay_refreshes + 1) * 1e6 / screen.refresh_hz);
        shown_us + board.map_or(0.0, |board| f64::from(board.settle_ms) * 1e3)
    }

    /// The 8-bit image of a frame of the sequence, counted from 0, row by row.
    ///
    /// # Errors
    /// A set that cannot be generated. `None`: the sequence is shorter.
    pub fn image_u8(&self, frame: usize) -> Option<Result<Vec<u8>, PatternError>> {
        let (set, step) = locate(&self.sequence, frame)?;
        Some(self.sequence[set].image_u8(step, self.size_px(), self.level_table.as_ref()))
    }

    /// Bits of the pattern of each frame on a board: 8, or 1 for black and white where `one_bit` is set.
    ///
    /// # Errors
    /// A set that cannot be generated.
    pub fn pattern_bits(&self, one_bit: bool) -> Result<Vec<u8>, PatternError> {
        let mut bits = Vec::new();
        for set in &self.sequence {
            let plain = one_bit && set.is_black_and_white(self.size_px(), self.level_table.as_ref())?;
            bits.resize(bits.len() + set.frames(), if plain { 1 } else { 8 });
        }
        Ok(bits)
    }
}

/// A camera of the cell.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraConfig {
    /// As in the rig file.
    pub name: String,
    /// Where the frames come from.
    pub driver: Driver,
    /// Columns, from the rig file.
    pub width_px: u32,
    /// Rows, from the rig file.
    pub height_px: u32,
    /// Of a GenICam camera: how it is found and set.
    pub genicam: Option<GenicamCamera>,
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
    /// A host of the cell that is silent for this long is lost, ms. Default 1000.
    pub silence_ms: u64,
}

/// Cores, pinning and cycles in flight.
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
