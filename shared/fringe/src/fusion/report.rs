//! What a fusion says of its clouds: how many points stayed, and how well pairs agree.

use serde::{Deserialize, Serialize};
use std::fmt;

/// How well two pairs agree where both see the part. Lengths in mm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// Number of a cloud.
    pub a: usize,
    /// Number of a later cloud.
    pub b: usize,
    /// Points of a that were compared: those with a surface of b beside them; of n > 2 clouds, in every (n − 1)th cell of the search.
    pub count: u32,
    /// Mean signed distance; positive where a lies outside of b. Zero without points.
    pub mean_mm: f64,
    /// Sample standard deviation of the signed distance. Zero below two points.
    pub sd_mm: f64,
    /// Largest absolute distance, mm.
    pub max_mm: f64,
    /// Root mean square of (distance − mean) over its predicted uncertainty, which takes the points as independent; about 1
    /// when noise is all there is, some 1.1 where neighbours share noise because they were smoothed. Absent without points or uncertainties.
    pub sd_over_sigma: Option<f64>,
}

impl fmt::Display for Overlap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.count == 0 {
            return write!(f, "none, so that nothing tells whether they agree");
        }
        let (mean_um, sd_um) = (1e3 * self.mean_mm, 1e3 * self.sd_mm);
        write!(f, "{} points, mean {mean_um:+.1} µm, standard deviation {sd_um:.1} µm", self.count)
    }
}

/// Counts and overlaps of a fusion.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct FusionReport {
    /// Points of the fused cloud.
    pub points: u32,
    /// Points removed, per cloud.
    pub removed: Vec<u32>,
    /// Neighbourhood that was used, mm; zero without points.
    pub radius_mm: f64,
    /// All pairs of clouds in order: (0, 1), (0, 2), … (1, 2), …
    pub overlaps: Vec<Overlap>,
    /// Points of the fused cloud whose uncertainty was raised, since pairs disagree there beyond what they state.
    pub disagreeing: u32,
}
