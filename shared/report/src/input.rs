//! Content of a measurement report.

use files::result::CycleResult;
use fringe::cloud::Point;
use fringe::fusion::Overlap;
use fringe::phase::PhaseView;
use metrology::inspection::FeatureResult;
use metrology::verdict::Verdict;

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
    /// The word at the top; `None`: the cycle did not end well, or no feature has limits.
    pub verdict: Option<Verdict>,
    /// One sentence below it: why there is no result, for instance. May be empty.
    pub reason: String,
    /// What stands beside the verdict although the cycle is ok: a part that moved, a camera that the rig file does not describe.
    pub warnings: Vec<String>,
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
    /// Overlap of the pairs, which it counts as `pair_names` does.
    pub overlaps: &'a [Overlap],
    /// The last cycle: rows in order of their first span.
    pub timeline: Vec<Span>,
    /// Moments of the last cycle, drawn as lines.
    pub marks: Vec<Mark>,
    /// Each cycle, with the times of its stages.
    pub cycles: &'a [CycleResult],
    /// Remarks at the end, a paragraph each.
    pub notes: Vec<String>,
}

/// One row of the table of features.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FeatureRow {
    /// The result of the feature.
    pub feature: FeatureResult,
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

/// What a process did in a span.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Waited for its input.
    Wait,
    /// The stage computed its output.
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
