//! The cell configuration as written; unknown keys are refused here, meaning is checked in `check`.

use fringe::pattern::PatternSet;
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawConfig {
    #[serde(rename = "format")]
    _format: String,
    pub name: String,
    pub rig: String,
    pub plan: Option<String>,
    pub calibration_shares: Option<String>,
    #[serde(default)]
    pub recipe: Vec<RawRecipe>,
    pub cycles: Option<u32>,
    pub pairs: Option<Vec<String>>,
    #[serde(default)]
    pub limits: RawLimits,
    #[serde(default)]
    pub projector: Vec<RawProjector>,
    #[serde(default)]
    pub camera: Vec<RawCamera>,
    #[serde(default)]
    pub decode: toml::Table,
    #[serde(default)]
    pub matching: toml::Table,
    #[serde(default)]
    pub fusion: toml::Table,
    pub twin: Option<RawTwin>,
    pub recording: Option<RawRecording>,
    #[serde(default)]
    pub schedule: RawSchedule,
    #[serde(default)]
    pub results: RawResults,
    pub warm_up: Option<RawWarmUp>,
    #[serde(default)]
    pub host: Vec<RawHost>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawHost {
    pub name: String,
    pub pairs: Vec<String>,
    pub listen: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawWarmUp {
    pub max_change_k: f64,
    pub window_s: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawResults {
    #[serde(rename = "keep_results")]
    pub results: Option<u64>,
    #[serde(rename = "keep_parts")]
    pub parts: Option<u64>,
    #[serde(rename = "keep_mb")]
    pub size_mb: Option<u64>,
    #[serde(default)]
    pub formats: Vec<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawLimits {
    pub stage_budget_ms: Option<u64>,
    pub cycle_deadline_ms: Option<u64>,
    pub start_ms: Option<u64>,
    pub stop_ms: Option<u64>,
    pub restarts_max: Option<u64>,
    pub restart_window_ms: Option<u64>,
    pub silence_ms: Option<u64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawProjector {
    pub name: String,
    pub driver: String,
    pub width_px: Option<u32>,
    pub height_px: Option<u32>,
    pub cameras: Option<Vec<String>>,
    pub sequence: Option<Vec<PatternSet>>,
    pub pattern_correction: Option<String>,
    pub address: Option<String>,
    pub trigger: Option<String>,
    pub period_ms: Option<f64>,
    pub refresh_hz: Option<f64>,
    pub display: Option<String>,
    pub output: Option<String>,
    pub position_px: Option<[i32; 2]>,
    pub delay_refreshes: Option<i64>,
    pub controller: Option<String>,
    pub source: Option<String>,
    pub exposure_us: Option<i64>,
    pub period_us: Option<i64>,
    pub led: Option<String>,
    pub one_bit: Option<bool>,
    pub first_image: Option<i64>,
    pub settle_ms: Option<i64>,
    pub device: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRecipe {
    pub name: String,
    pub plan: String,
    pub calibration_shares: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawCamera {
    pub name: String,
    pub driver: String,
    pub transport: Option<String>,
    pub address: Option<String>,
    pub serial: Option<String>,
    pub pixel_format: Option<String>,
    pub exposure_us: Option<f64>,
    pub gain_db: Option<f64>,
    pub offset_px: Option<[u32; 2]>,
    pub packet_bytes: Option<u16>,
    pub packet_delay_ticks: Option<u32>,
    pub ptp: Option<bool>,
    pub trigger_line: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawTwin {
    pub scene: String,
    pub rig: Option<String>,
    #[serde(default)]
    pub seed: u64,
    #[serde(default)]
    pub settings: toml::Table,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawRecording {
    pub path: String,
    #[serde(default)]
    pub rate_hz: f64,
    #[serde(default, rename = "loop")]
    pub repeat: bool,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSchedule {
    pub cores: Option<u32>,
    pub cycles_in_flight: Option<u32>,
    pub pin: Option<bool>,
    pub realtime_priority: Option<u32>,
    pub lock_memory: Option<bool>,
    pub together: Option<RawTogether>,
}

/// Projectors that show at the same time.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
pub(super) enum RawTogether {
    Word(String),
    Groups(Vec<Vec<String>>),
}
