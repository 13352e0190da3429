//! The state of a view that may have drifted, and the views that see the same places.

use super::matches::Match;
use super::rows::CAUSES;
use crate::calibration::{PARAMETERS, moved};
use fringe::geometry::camera::Camera;

/// Unknowns: rotations, shifts, focal length, as in [`CAUSES`].
pub(super) const UNKNOWNS: usize = CAUSES.len();

/// A view that did not drift, and the places that it shares with the one that did, in one recording.
#[derive(Debug, Clone, Copy)]
pub struct Partner<'a> {
    /// The view that counts.
    pub fixed: &'a Camera,
    /// Its number, from 0 without gaps: what several recordings or pairs show of one view has the same.
    pub device: usize,
    /// Matches with the partner on the left and the corrected view on the right.
    pub matches: &'a [Match],
    /// Another view that counts and sees the same places, with its number: the projector that lights both, or a second camera where the corrected view is the
    /// projector.
    pub lit_by: Option<(&'a Camera, usize)>,
    /// Whether the rig measures lengths with this pair.
    pub measures: bool,
}

/// Names of the parameters of the pose, in the order of the unknowns.
pub(super) const POSE: [&str; 6] = ["rx_rad", "ry_rad", "rz_rad", "tx_mm", "ty_mm", "tz_mm"];

/// A view after a drift: rotations (rad), shifts (mm), relative change of the focal length.
pub fn stepped(view: &Camera, drift: &[f64; UNKNOWNS]) -> Camera {
    let mut step = [0.0; PARAMETERS.len()];
    for (parameter, step) in step.iter_mut().enumerate() {
        *step = match POSE.iter().position(|name| *name == PARAMETERS[parameter]) {
            Some(i) => drift[i],
            None if parameter < 2 => drift[6] * view.focal_px[parameter],
            None => 0.0,
        };
    }
    moved(view, &step)
}
