//! Numbers that no decoder could use, by their keys.

use super::{PatternError, PatternSet};
use crate::wrapped::LeastSquares;

impl PatternSet {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Names the key that no decoder could use.
    pub fn check(&self) -> Result<(), PatternError> {
        match self {
            Self::Lines { .. } | Self::Micro { .. } | Self::Modulated { .. } => self.check_codec(),
            Self::Sine { period_px, steps, first_step_rad, shifts_rad, .. } => {
                length("period_px", *period_px, 2.0)?;
                if !first_step_rad.is_finite() {
                    return Err(PatternError::FirstStep);
                }
                if *steps == 1 && shifts_rad.is_empty() {
                    return Ok(());
                }
                check_steps(*steps)?;
                check_shifts(*steps, shifts_rad)
            }
            Self::Gray { bits, stripe_px, shift_px, .. } => {
                length("stripe_px", *stripe_px, 1.0)?;
                if !(0.0..*stripe_px).contains(shift_px) {
                    return Err(PatternError::CodeShift { shift_px: *shift_px, stripe_px: *stripe_px });
                }
                if (1..=16).contains(bits) { Ok(()) } else { Err(PatternError::Bits { bits: *bits }) }
            }
            Self::Stair { stair_px, steps, .. } => {
                length("stair_px", *stair_px, 2.0)?;
                if *steps == 1 || (3..=64).contains(steps) {
                    Ok(())
                } else {
                    Err(PatternError::StairSteps { steps: *steps })
                }
            }
            Self::Check { stripe_px, .. } => length("stripe_px", *stripe_px, 1.0),
            Self::Ramp { axis: Some(_), levels: Some(_) } => Err(PatternError::RampKind),
            Self::Ramp { levels: Some(levels), .. } => levels.check(),
            Self::White {} | Self::Black {} | Self::Ramp { .. } | Self::Random { .. } => Ok(()),
        }
    }
}

/// Refuses a length that is not finite or too small.
pub(super) fn length(key: &'static str, value: f64, least: f64) -> Result<(), PatternError> {
    if value.is_finite() && value >= least { Ok(()) } else { Err(PatternError::Length { key, value, least }) }
}

/// Refuses numbers of steps that no phase can be found from.
pub(super) fn check_steps(steps: u32) -> Result<(), PatternError> {
    if (3..=64).contains(&steps) { Ok(()) } else { Err(PatternError::Steps { steps }) }
}

/// Unequal shifts must determine three unknowns without multiplying the noise.
pub(super) fn check_shifts(steps: u32, shifts_rad: &[f64]) -> Result<(), PatternError> {
    if shifts_rad.is_empty() {
        return Ok(());
    }
    if shifts_rad.len() != steps as usize || !shifts_rad.iter().all(|shift| shift.is_finite()) {
        return Err(PatternError::Shifts { shifts: shifts_rad.len(), steps });
    }
    // Three steps of 120° give 0.8; ten times that wastes a hundred times the frames.
    let most = 8.0;
    match LeastSquares::new(shifts_rad).map(|fit| fit.mean_noise()) {
        Some(gain) if gain <= most => Ok(()),
        gain => Err(PatternError::ShiftsAlike { gain: gain.unwrap_or(f64::INFINITY), most }),
    }
}
