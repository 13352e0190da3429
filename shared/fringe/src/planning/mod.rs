//! Which patterns to project: period, steps and code for a noise and a wanted uncertainty of the point.
//!
//! For each candidate the phase noise is √(2/N) σ_I/B, with the contrast that blur and the projector's pixels leave at its period,
//! B = B₀ exp(−2π²b²/p²) sinc(1/p); the coordinate's is p/2π times that. The pattern itself errs, too: by the harmonics of the
//! projector's response that N steps let pass, and by the rounding of its levels ([`pattern`]); a pair of cameras sees the same error
//! at the same place and does not mind. The point's uncertainty follows from the geometry ([`geometry`]), and the chance of
//! a wrong order from [`OrderRisk`](crate::decode::OrderRisk) and the bits. Short periods gain until blur takes their contrast and the order its margin.
//!
//! It is a plan for one brightness of a smooth face. Edges, where a footprint mixes two faces, light that bounces, and a part that moves
//! are not in it; against light that bounces, `most_period_px` keeps the periods short.

mod brightness;
pub mod geometry;
pub mod pattern;
pub mod resolution;
mod sets;
pub mod step_edge;
#[cfg(test)]
mod tests;

use self::geometry::Depth;
use crate::decode::{DecodeSettings, OrderMethod};
use crate::pattern::{Axis, PatternSet, frame_count};
use serde::Serialize;
use std::f64::consts::TAU;
use thiserror::Error;

pub use brightness::Brightness;
pub use sets::ORDERS;

/// Periods that are tried, projector pixels.
const PERIODS_PX: [f64; 12] = [6.0, 8.0, 10.0, 12.0, 16.0, 18.0, 20.0, 24.0, 32.0, 40.0, 48.0, 64.0];
/// Steps that are tried.
const STEPS: [u32; 10] = [3, 4, 5, 6, 8, 10, 12, 16, 24, 32];

/// Properties of the cell and the wanted uncertainty.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Requirements {
    /// Axis along which the patterns vary.
    pub axis: Axis,
    /// Projector pixels along it.
    pub extent_px: u32,
    /// Largest grey value, DN.
    pub full_scale_dn: f64,
    /// Modulation of a coarse fringe: half the difference between white and black, DN.
    pub modulation_dn: f64,
    /// Background of the fringes, DN.
    pub background_dn: f64,
    /// Noise of a grey value in the dark, quantisation included, DN; less than that of whole DN, 1/√12, counts as it.
    pub read_noise_dn: f64,
    /// Grey values per photo-electron, DN.
    pub gain_dn: f64,
    /// Blur of projector and camera together, standard deviation in projector pixels.
    pub blur_px: f64,
    /// Exponent of the projector's response, light = level^γ; 1 for corrected patterns.
    pub projector_gamma: f64,
    /// How coordinates become points.
    pub depth: Depth,
    /// Longest finest period, projector pixels: light that bounces moves points by as much less as the period is shorter; none: any.
    pub most_period_px: Option<f64>,
    /// Wanted standard uncertainty of a point, µm; none: the best.
    pub want_u_um: Option<f64>,
    /// Largest chance of a wrong order.
    pub most_wrong: f64,
}

/// What makes a plan impossible.
#[derive(Debug, Error, Clone, PartialEq)]
#[error("{key} = {value}: must be {limit}")]
pub struct WantedError {
    /// Key of the value.
    pub key: &'static str,
    /// Value given for the key.
    pub value: f64,
    /// What it may be.
    pub limit: &'static str,
}

/// One choice of patterns.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Proposal {
    /// Method of the fringe order, as for `decode --order`.
    pub order: &'static str,
    /// Finest period, projector pixels.
    pub period_px: f64,
    /// Steps of each sine set.
    pub steps: u32,
    /// Number of frames of the proposal.
    pub frames: usize,
    /// Modulation at the finest period, DN.
    pub modulation_dn: f64,
    /// Standard deviation of the phase by noise, rad.
    pub sigma_phase_rad: f64,
    /// Error of the pattern itself: harmonics of the response, rounding of the levels; root mean square over all phases, rad.
    pub pattern_error_rad: f64,
    /// Standard uncertainty of the projector coordinate from both, px.
    pub sigma_coordinate_px: f64,
    /// Standard uncertainty of a point, µm.
    pub u_point_um: f64,
    /// Chance of a wrong order of a pixel on its own.
    pub wrong_order: f64,
    /// Whether the decoder takes its fringes by default: not too faint, not clipped, not too noisy.
    pub usable: bool,
    /// Whether it is usable and meets what is wanted.
    pub meets: bool,
    /// Pattern sets to project.
    pub sequence: Vec<PatternSet>,
}

impl Requirements {
    fn check(&self) -> Result<(), WantedError> {
        let within = |key, value: f64, (least, most): (f64, f64), limit| {
            if value >= least && value <= most { Ok(()) } else { Err(WantedError { key, value, limit }) }
        };
        within("extent_px", self.extent_px.into(), (16.0, 65_535.0), "16 to 65535 projector pixels")?;
        within("full_scale_dn", self.full_scale_dn, (1.0, 65_535.0), "1 to 65535 DN")?;
        within("modulation_dn", self.modulation_dn, (1e-3, 65_535.0), "0.001 to 65535 DN")?;
        within("background_dn", self.background_dn, (0.0, 65_535.0), "0 to 65535 DN")?;
        let brighter = "at most background_dn: no light is less than black";
        within("modulation_dn", self.modulation_dn, (1e-3, self.background_dn), brighter)?;
        within("read_noise_dn", self.read_noise_dn, (0.0, 65_535.0), "0 to 65535 DN")?;
        within("gain_dn", self.gain_dn, (0.0, 65_535.0), "0 to 65535 DN per electron")?;
        within("blur_px", self.blur_px, (0.0, 100.0), "0 to 100 projector pixels")?;
        within("projector_gamma", self.projector_gamma, (0.1, 10.0), "0.1 to 10; 1 for corrected patterns")?;
        within("um_per_px", self.depth.um_per_px, (1e-6, 1e9), "above 0 µm per projector pixel")?;
        let periods = "6 projector pixels or more";
        within(
            "most_period_px",
            self.most_period_px.unwrap_or(PERIODS_PX[0]),
            (PERIODS_PX[0], 1e9),
            periods,
        )?;
        within("most_wrong", self.most_wrong, (1e-300, 1.0), "above 0 and at most 1")?;
        within("want_u_um", self.want_u_um.unwrap_or(1.0), (1e-6, 1e9), "above 0 µm")
    }

    /// What a camera sees of these fringes.
    fn brightness(&self) -> Brightness {
        let Self { full_scale_dn, modulation_dn, background_dn, read_noise_dn, gain_dn, blur_px, .. } = *self;
        Brightness { full_scale_dn, modulation_dn, background_dn, read_noise_dn, gain_dn, blur_px }
    }
}

/// All choices that are no worse in every respect than another one: those that meet what is wanted first, fewest frames first.
///
/// # Errors
/// A number outside its range.
pub fn propose(wanted: &Requirements) -> Result<Vec<Proposal>, WantedError> {
    wanted.check()?;
    let mut all = Vec::new();
    let most_px = wanted.most_period_px.unwrap_or(f64::INFINITY).min(0.5 * f64::from(wanted.extent_px));
    for period_px in PERIODS_PX.into_iter().filter(|p| *p <= most_px) {
        for steps in STEPS {
            for order in sets::ORDERS {
                all.extend(evaluate(wanted, order, period_px, steps));
            }
        }
    }
    let beaten = |one: &Proposal| {
        all.iter().any(|o| {
            o.order == one.order
                && o.meets >= one.meets
                && (o.frames < one.frames && o.u_point_um <= one.u_point_um
                    || o.frames <= one.frames && o.u_point_um < one.u_point_um)
        })
    };
    let mut kept: Vec<Proposal> = all.iter().filter(|p| !beaten(p)).cloned().collect();
    kept.sort_by(|a, b| {
        let key = |p: &Proposal| (!p.meets, if p.meets { p.frames } else { 0 });
        key(a).cmp(&key(b)).then(a.u_point_um.total_cmp(&b.u_point_um)).then(a.order.cmp(b.order))
    });
    Ok(kept)
}

/// One choice; `None` where the code cannot number this projector or the decoder would not take it.
fn evaluate(wanted: &Requirements, order: OrderMethod, period_px: f64, steps: u32) -> Option<Proposal> {
    let (sequence, periods_px) = sets::sequence(wanted, order, period_px, steps)?;
    let (modulation_dn, sigma_phase_rad) = wanted.brightness().phase_noise(period_px, steps);
    let pattern_error_rad = pattern::error_rad(wanted.projector_gamma, wanted.blur_px, period_px, steps);
    let both_rad = (sigma_phase_rad * sigma_phase_rad + pattern_error_rad * pattern_error_rad).sqrt();
    let wrong_order = sets::wrong_order(wanted, order, &periods_px, steps, both_rad)?;
    let sigma_coordinate_px = both_rad * period_px / TAU;
    let u_point_um = wanted.depth.u_point_um(sigma_phase_rad, pattern_error_rad, period_px);
    let usable = wanted.brightness().usable(&DecodeSettings::default(), modulation_dn, sigma_phase_rad);
    let fine = wanted.want_u_um.is_none_or(|want| u_point_um <= want);
    Some(Proposal {
        order: order.name(),
        period_px,
        steps,
        frames: frame_count(&sequence),
        modulation_dn,
        sigma_phase_rad,
        pattern_error_rad,
        sigma_coordinate_px,
        u_point_um,
        wrong_order,
        usable,
        meets: fine && usable && wrong_order <= wanted.most_wrong,
        sequence,
    })
}
