//! Spatial phase unwrapping: from a wrapped phase, its mask and its neighbours to a continuous phase (thesis section 2.2.1).
//!
//! ```text
//! wrapped phase, mask ─▶ angles ─▶ faces ─▶ jumps or cuts ─▶ rows, forest ─▶ whole turns per pixel ─▶ anchor ─▶ phase
//!                            │       └─ where all loops close ─▶ ┘                ▲
//!                            └───▶ least squares ─▶ nearest congruent phase ──────┘
//! ```
//!
//! | method | what decides | source |
//! |---|---|---|
//! | [`Method::Itoh`] | rows, then columns: the naive baseline | Itoh 1982 |
//! | [`Method::Goldstein`] | residues paired by branch cuts that no path crosses | Goldstein 1988, eq. 2.20–2.24 |
//! | [`Method::Quality`] | best pixels first | eq. 2.31–2.33 |
//! | [`Method::Reliability`] | best edges first, by second differences | Herráez 2002, eq. 2.34–2.39 |
//! | [`Method::LeastSquares`] | least squared difference of the gradients | eq. 2.40–2.44 |
//! | [`Method::WeightedLeastSquares`] | the same, weighted by the quality | eq. 2.45–2.48 |
//!
//! # What a spatial result is
//! Neighbours that are joined by valid pixels (4-connected) form a component. Within it the phase is known up to one
//! constant, a whole number of turns, that no spatial method can determine: the first pixel of the component, row by row, keeps
//! its wrapped phase in [0, 2π) unless an [`Anchor`] gives the absolute phase of some pixels. Between components nothing
//! is known. Pixels that are not valid, NaN or infinite stay NaN: nothing is ever filled.
//!
//! # Exactness
//! Angles are 32-bit fractions of a turn ([`angle`]): wrapped differences are exact integer differences, residues are exact integers
//! and the whole turns between two pixels are exact. The result is the input plus whole turns, bit for bit the same for any number of
//! threads. Ties are broken by the index of the edge.

mod anchor;
mod angle;
mod cuts;
mod edges;
mod error;
mod faces;
mod forest;
mod goldstein;
mod jumps;
mod least_squares;
mod poisson;
mod quality;
mod reliability;
mod report;
mod rows;
#[cfg(test)]
mod tests;

pub use anchor::Anchor;
pub use error::UnwrapError;
pub use quality::QualityMap;
pub use report::{Component, Convergence, Residues, UnwrapReport};

use crate::frame::MAX_PIXELS;
use angle::Angles;
use edges::{Grid, best_pixels_first};
use rayon::prelude::*;
use rows::{along_rows, along_tree};
use std::f64::consts::TAU;

/// A wrapped phase stored elsewhere, row by row without padding.
#[derive(Debug, Clone, Copy)]
pub struct Wrapped<'a> {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// Phase, rad, in any interval: only its fraction of a turn counts.
    pub phase_rad: &'a [f32],
    /// 1 where the phase may be used, else 0.
    pub valid: &'a [u8],
    /// Modulation B, DN, or another quality that grows with reliability; needed by [`QualityMap::Modulation`] only.
    pub modulation: Option<&'a [f32]>,
}

/// Method of spatial unwrapping.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Along the rows, which the first columns join.
    Itoh,
    /// Branch cuts between residues.
    Goldstein,
    /// Flood fill in the order of a quality map.
    Quality(QualityMap),
    /// Joins edges in the order of their reliability.
    Reliability,
    /// Least squares, all pixels alike.
    LeastSquares,
    /// Least squares, each pair of neighbours with the lesser squared quality of the two.
    WeightedLeastSquares(QualityMap),
}

/// Settings of all methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnwrapSettings {
    /// Method of unwrapping and its quality map.
    pub method: Method,
    /// Branch cuts: farthest partner that a residue is paired with, px; beyond, it is led to the border or a hole.
    pub reach_px: u32,
    /// Least squares: the iteration ends when the residual is this fraction of the first.
    pub tolerance: f64,
    /// Least squares: and after so many steps at the latest.
    pub max_iterations: u32,
    /// Least squares: give the wrapped phase plus whole turns (`true`), or the smooth solution itself.
    pub congruent: bool,
}

impl UnwrapSettings {
    /// A method with the settings that suit most maps.
    pub fn new(method: Method) -> Self {
        Self { method, reach_px: 64, tolerance: 1e-4, max_iterations: 200, congruent: true }
    }
}

/// A phase that is continuous within each component.
#[derive(Debug, Clone, PartialEq)]
pub struct Unwrapped {
    /// Phase, rad; NaN where the input is not valid.
    pub phase_rad: Vec<f32>,
    /// Number of the component, from 0; [`NO_COMPONENT`] where not valid.
    pub component: Vec<u32>,
    /// Figures of the result.
    pub report: UnwrapReport,
}

/// In [`Unwrapped::component`]: not valid.
pub const NO_COMPONENT: u32 = u32::MAX;

/// Unwraps.
///
/// Time is bounded: the path methods take two edges per pixel at most, by order of their keys, the cuts search within `reach_px`, and
/// least squares end after `max_iterations`.
///
/// # Errors
/// Planes of unequal size, more than [`MAX_PIXELS`] pixels, settings out of range, or a quality map without modulation.
pub fn unwrap(
    wrapped: &Wrapped<'_>,
    anchor: Option<&Anchor<'_>>,
    settings: &UnwrapSettings,
) -> Result<Unwrapped, UnwrapError> {
    check(wrapped, anchor, settings)?;
    let angles = Angles::new(wrapped);
    let grid = Grid::new(wrapped.width_px as usize, wrapped.height_px as usize, &angles.valid);
    let mut report = UnwrapReport::default();
    let mut smooth_turns = None;
    let mut discontinuities = None;
    let mut of_tree = |(labels, count)| {
        discontinuities = Some(count);
        labels
    };
    let labels = match settings.method {
        Method::Itoh => along_rows(&angles, &grid, &[]),
        Method::Goldstein => {
            let (labels, residues) = goldstein::unwrap(&angles, &grid, settings.reach_px);
            report.residues = Some(residues);
            labels
        }
        Method::Quality(map) => {
            let quality = || quality::map(map, wrapped, &angles, &grid);
            of_tree(along_tree(&angles, &grid, || best_pixels_first(quality())))
        }
        Method::Reliability => of_tree(along_tree(&angles, &grid, || reliability::key(&angles, &grid))),
        Method::LeastSquares | Method::WeightedLeastSquares(_) => {
            let quality = match settings.method {
                Method::WeightedLeastSquares(map) => Some(quality::map(map, wrapped, &angles, &grid)),
                _ => None,
            };
            let solved = least_squares::solve(&angles, &grid, quality.as_deref(), settings);
            report.convergence = Some(solved.convergence);
            smooth_turns = (!settings.congruent).then_some(solved.smooth_turns);
            solved.labels
        }
    };
    let mut turns = labels.turns;
    report.components = anchor::place(&labels.component, &angles, anchor, &mut turns, grid.width);
    report.valid = report.components.iter().map(|c| c.pixels).sum();
    report.discontinuities =
        discontinuities.unwrap_or_else(|| edges::discontinuities(&grid, &angles, &turns));
    let phase_rad = phase(&angles, &turns, smooth_turns.as_deref(), &labels.component, &report);
    Ok(Unwrapped { phase_rad, component: labels.component, report })
}

fn phase(
    angles: &Angles<'_>,
    turns: &[i32],
    smooth: Option<&[f64]>,
    component: &[u32],
    report: &UnwrapReport,
) -> Vec<f32> {
    let Some(smooth) = smooth else { return angles.unwrapped(turns, component) };
    // The smooth solution begins at the first pixel of its component; the anchor's turns come on top.
    let whole = |i: usize| smooth[i] + f64::from(report.components[component[i] as usize].turns);
    let value = |i: usize| if component[i] == NO_COMPONENT { f32::NAN } else { (whole(i) * TAU) as f32 };
    (0..turns.len()).into_par_iter().map(value).collect()
}

fn check(
    wrapped: &Wrapped<'_>,
    anchor: Option<&Anchor<'_>>,
    settings: &UnwrapSettings,
) -> Result<(), UnwrapError> {
    let pixels = u64::from(wrapped.width_px) * u64::from(wrapped.height_px);
    if pixels == 0 || pixels > MAX_PIXELS as u64 {
        return Err(UnwrapError::Size { width_px: wrapped.width_px, height_px: wrapped.height_px });
    }
    let planes = [
        ("phase_rad", Some(wrapped.phase_rad.len())),
        ("valid", Some(wrapped.valid.len())),
        ("modulation", wrapped.modulation.map(<[f32]>::len)),
        ("anchor", anchor.map(|a| a.absolute_rad.len())),
    ];
    for (plane, length) in planes {
        if let Some(length) = length.filter(|length| *length as u64 != pixels) {
            return Err(UnwrapError::Plane { plane, length, expected: pixels as usize });
        }
    }
    let map = match settings.method {
        Method::Quality(map) | Method::WeightedLeastSquares(map) => Some(map),
        _ => None,
    };
    if map == Some(QualityMap::Modulation) && wrapped.modulation.is_none() {
        return Err(UnwrapError::Modulation);
    }
    if !(settings.tolerance > 0.0 && settings.tolerance < 1.0) {
        return Err(UnwrapError::Tolerance { value: settings.tolerance });
    }
    if settings.max_iterations == 0 || settings.max_iterations > 10_000 {
        return Err(UnwrapError::Iterations { value: settings.max_iterations });
    }
    Ok(())
}
