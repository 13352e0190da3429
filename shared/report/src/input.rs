//! Content of a measurement report.

use fringe::cloud::Point;
use fringe::phase::PhaseView;

/// Verdict of the measurement or of a feature.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Verdict {
    /// Conforms to its limits.
    Pass,
    /// The uncertainty reaches across a limit.
    Indeterminate,
    /// Non-conformity is proven.
    Fail,
    /// Nothing can be evaluated: the cycle failed.
    #[default]
    NoResult,
}

/// Content of the report. Empty parts are left out or named as absent.
#[derive(Debug, Clone, Default)]
pub struct ReportInput<'a> {
    /// Name of the cell.
    pub cell: String,
    /// Name or serial number of the part.
    pub part: String,
    /// When it was measured, as it shall be printed.
    pub date: String,
    /// Name and version of the software.
    pub software_version: String,
    /// Hash of the rig file.
    pub rig_hash: String,
    /// Name or hash of the inspection plan.
    pub plan_id: String,
    /// Further lines of the header: label and text.
    pub details: Vec<(String, String)>,
    /// Verdict of the whole measurement.
    pub verdict: Verdict,
    /// One sentence below it: why there is no result, for instance. May be empty.
    pub reason: String,
    /// Uncertainties are printed as expanded, U = k·u, with this k; as standard uncertainty u if `None`.
    pub coverage_factor: Option<f64>,
    /// How uncertainty enters the verdict, as one sentence below the table. May be empty.
    pub decision_rule: String,
    /// Features in the order of the plan.
    pub features: Vec<FeatureRow>,
    /// Grey images of the cameras.
    pub camera_views: Vec<GreyPicture>,
    /// Phase maps: each is shown absolute and wrapped.
    pub phase_maps: Vec<PhasePicture<'a>>,
    /// The fused cloud, world frame.
    pub cloud: &'a [Point],
    /// Names of the pairs by the number in [`Point::pair`].
    pub pair_names: Vec<String>,
    /// Index into `cloud` and signed deviation, mm. Points without one stay grey.
    pub deviations: &'a [(u32, f32)],
    /// From what the deviations are taken, as a sentence: "Distance from the fitted feature, positive outside."
    pub deviation_meaning: String,
    /// End of the colour bar, mm; if `None`, the 99th percentile of the magnitudes, rounded up to 1, 2 or 5 · 10ⁿ.
    pub deviation_half_range_mm: Option<f64>,
    /// Overlap of the pairs.
    pub overlaps: Vec<OverlapRow>,
    /// The last cycle: rows in order of their first span.
    pub timeline: Vec<Span>,
    /// Moments of the last cycle, drawn as lines.
    pub marks: Vec<Mark>,
    /// Times of each stage over all cycles.
    pub stages: Vec<StageTimes>,
    /// Outcome of each cycle of the run.
    pub cycles: Vec<CycleRow>,
    /// Remarks at the end, a paragraph each.
    pub notes: Vec<String>,
}

/// One measured feature with its limits.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FeatureRow {
    /// Name in the plan.
    pub name: String,
    /// Small print below it: number of points, form. May be empty.
    pub detail: String,
    /// Unit of all numbers of the row: `mm`, `deg`, `um`.
    pub unit: String,
    /// Measured value; NaN if it could not be measured.
    pub value: f64,
    /// Standard uncertainty (k = 1), also where the expanded one is printed.
    pub standard_uncertainty: Option<f64>,
    /// Lower limit of the value, in its unit.
    pub lower: Option<f64>,
    /// Upper limit of the value, in its unit.
    pub upper: Option<f64>,
    /// Verdict of the feature; `None` without limits.
    pub verdict: Option<Verdict>,
    /// The simulator's true value, in a demonstration. Adds the columns truth and error.
    pub truth: Option<f64>,
}

/// An 8-bit camera image.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct GreyPicture {
    /// Text below the picture.
    pub caption: String,
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// width × height grey values.
    pub values: Vec<u8>,
}

/// A phase map to be shown.
#[derive(Debug, Clone, Copy)]
pub struct PhasePicture<'a> {
    /// Text below the picture.
    pub caption: &'a str,
    /// The absolute phase map.
    pub phase: PhaseView<'a>,
}

/// Signed distance between two pairs where both saw the part.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OverlapRow {
    /// Name of the first pair.
    pub a: String,
    /// Name of the second pair.
    pub b: String,
    /// Mean distance between both clouds, mm.
    pub mean_mm: f64,
    /// Sample standard deviation, mm.
    pub sd_mm: f64,
    /// Number of points compared.
    pub count: u64,
}

/// What a process did in a span.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Waited for its input.
    Wait,
    /// The stage computed.
    Compute,
}

/// A bar of the timeline.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Name of the stage: its row.
    pub stage: String,
    /// Whether the stage computed or waited.
    pub activity: Activity,
    /// Start on any clock, the same for all spans, ns.
    pub start_ns: u64,
    /// End of the span, ns.
    pub end_ns: u64,
}

/// A moment of the timeline.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mark {
    /// Short name, for the legend.
    pub name: String,
    /// On the clock of the spans, ns.
    pub at_ns: u64,
}

/// All times of one stage, a value for each cycle.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StageTimes {
    /// Name of the stage.
    pub name: String,
    /// Waiting time of each cycle, ns.
    pub wait_ns: Vec<u64>,
    /// Computing time of each cycle, ns.
    pub compute_ns: Vec<u64>,
}

/// Outcome of one cycle.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct CycleRow {
    /// Number of the cycle, as in the result.
    pub cycle: u64,
    /// `ok`, or the reason.
    pub outcome: String,
    /// `None` if the outcome is not `ok`.
    pub verdict: Option<Verdict>,
    /// From the last frame to the verdict, ns.
    pub latency_ns: Option<u64>,
    /// Points of the fused cloud.
    pub points: Option<u64>,
}
