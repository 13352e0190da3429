//! Wrapped phases from other methods than the running sums, put in their place before the order is sought.

use super::roles::SineKind;
use super::sums::Replaced;
use super::{DecodeError, Decoder};
use crate::math::sincos;
use crate::pattern::Axis;
use crate::wrapped::{Limits, Wrapped};

/// A sine set that the decoder uses.
#[derive(Debug, Clone, PartialEq)]
pub struct SineSet {
    /// Position in the sequence.
    pub index: usize,
    /// Number of the set's first frame in the sequence, from 0.
    pub first_frame: usize,
    /// Projector axis of the set.
    pub axis: Axis,
    /// Phase step of each frame, rad.
    pub shifts_rad: Vec<f64>,
    /// Whether the steps are 2π/N.
    pub even: bool,
    /// Whether the frames are a sine each: no lines, no carrier, no further frequencies.
    pub plain: bool,
    /// Periods over the projector.
    pub periods: f64,
}

impl Decoder {
    /// The sine sets in use, in the order of the axes, the finest of each axis first.
    pub fn sine_sets(&self) -> Vec<SineSet> {
        let slots = self.plan.axes.iter().flat_map(|axis| axis.sines.iter().map(move |slot| (slot, axis)));
        slots
            .map(|(slot, axis)| {
                let sine = &self.plan.sines[*slot];
                let is_first = |role: &super::Role| *role == super::Role::Sine { slot: *slot, step: 0 };
                SineSet {
                    index: sine.index,
                    first_frame: self.plan.roles.iter().position(is_first).unwrap_or(0),
                    axis: sine.axis,
                    shifts_rad: sine.shifts_rad.clone(),
                    even: sine.even,
                    plain: sine.kind == SineKind::Plain && axis.micro.is_none(),
                    periods: axis.extent_px / sine.period_px,
                }
            })
            .collect()
    }

    /// Limits for a method of [`crate::wrapped`], with the noise estimated from the frames of an axis so far.
    ///
    /// # Errors
    /// [`DecodeError::NoSuchAxis`].
    pub fn limits(&mut self, axis: Axis) -> Result<Limits, DecodeError> {
        let home =
            self.plan.axes.iter().position(|a| a.axis == axis).ok_or(DecodeError::NoSuchAxis { axis })?;
        // A single frame leaves the noise to the code, and few steps to neighbouring pixels: all of them are there already.
        if self.axes[home].estimate.is_none() {
            self.estimate_from_neighbours(home);
        }
        let noise = self.noise(&self.axes[home]);
        Ok(Limits {
            least_modulation_dn: self.least_modulation_dn(),
            clipped_dn: self.clipped_dn,
            read_variance_dn2: noise.read_variance_dn2,
            gain_dn: noise.gain_dn,
        })
    }

    /// Puts a wrapped phase in the place of a set's own; until the next [`Decoder::begin`]. A pixel that is masked in the map has
    /// no modulation and stays masked.
    ///
    /// # Errors
    /// [`DecodeError::Replace`].
    pub fn replace(&mut self, index: usize, map: &Wrapped) -> Result<(), DecodeError> {
        let slot = self.plan.sines.iter().position(|sine| sine.index == index);
        let slot = slot.filter(|_| {
            (map.width_px, map.height_px) == (self.width_px, self.height_px) && map.len() == self.pixels
        });
        let slot = slot.ok_or(DecodeError::Replace { index, pixels: map.len() })?;
        let half = 0.5 * f64::from(self.steps[slot]);
        let (mut cos, mut sin) = (vec![0.0; map.len()], vec![0.0; map.len()]);
        for i in 0..map.len() {
            if map.valid[i] == 1 {
                let (s, c) = sincos(f64::from(map.phase_rad[i]));
                let b = half * f64::from(map.modulation[i]);
                (cos[i], sin[i]) = ((b * c) as f32, (b * s) as f32);
            }
        }
        self.sums[slot].replaced = Some(Replaced { cos, sin, sigma_rad: map.sigma_rad.clone() });
        Ok(())
    }
}
