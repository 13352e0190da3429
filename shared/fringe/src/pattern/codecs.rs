//! Lines, micro and modulated phase shifting: sets of frames that are no plain sines but are decoded like them.

use super::check::{check_shifts, check_steps, length};
use super::{Axis, Direction, PatternError, PatternSet};
use crate::math::cos;
use std::f64::consts::{PI, TAU};

/// Most frequencies of a micro set: published ones have 5 to 10.
const MOST_PERIODS: usize = 16;
/// Most frames of a modulated set, as of a sine set.
const MOST_FRAMES: u32 = 64;
/// Frames of the first frequency of a micro set.
const MICRO_STEPS: usize = 3;

impl PatternSet {
    /// Checks the numbers of these sets.
    pub(super) fn check_codec(&self) -> Result<(), PatternError> {
        match self {
            Self::Lines { period_px, steps, width_px, .. } => {
                length("period_px", *period_px, 3.0)?;
                if !(*width_px > 0.0 && width_px < period_px) {
                    return Err(PatternError::LineWidth { width_px: *width_px, period_px: *period_px });
                }
                check_steps(*steps)
            }
            Self::Micro { periods_px, shifts_rad, .. } => {
                if !(2..=MOST_PERIODS).contains(&periods_px.len()) {
                    return Err(PatternError::MicroPeriods { count: periods_px.len(), most: MOST_PERIODS });
                }
                periods_px.iter().try_for_each(|period_px| length("periods_px", *period_px, 2.0))?;
                let (shifts, frames) = (shifts_rad.len(), self.frames());
                if shifts > 0 && (shifts != frames || !shifts_rad.iter().all(|shift| shift.is_finite())) {
                    return Err(PatternError::MicroShifts { shifts, frames });
                }
                check_shifts(MICRO_STEPS as u32, shifts_rad.get(..MICRO_STEPS).unwrap_or_default())
            }
            Self::Modulated { period_px, steps, carrier_px, carrier_steps, .. } => {
                length("period_px", *period_px, 2.0)?;
                length("carrier_px", *carrier_px, 2.0)?;
                check_steps(*steps)?;
                check_steps(*carrier_steps)
                    .map_err(|_| PatternError::CarrierSteps { carrier_steps: *carrier_steps })?;
                if steps * carrier_steps > MOST_FRAMES {
                    return Err(PatternError::ModulatedFrames {
                        steps: *steps,
                        carrier_steps: *carrier_steps,
                    });
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Phase step δ of one frame, rad. A line stands in the middle of its columns.
    pub(super) fn codec_step_rad(&self, step: usize) -> f64 {
        match self {
            Self::Lines { period_px, steps, width_px, direction, .. } => {
                let moved = direction.sign() * TAU * step as f64 / f64::from(*steps);
                moved + PI * (width_px - 1.0) / period_px
            }
            Self::Micro { direction, shifts_rad, .. } => {
                let even = if step < MICRO_STEPS { TAU * step as f64 / MICRO_STEPS as f64 } else { 0.0 };
                direction.sign() * shifts_rad.get(step).copied().unwrap_or(even)
            }
            Self::Modulated { steps, carrier_steps, direction, .. } => {
                let own = step / (*carrier_steps).max(1) as usize;
                direction.sign() * TAU * own as f64 / f64::from(*steps)
            }
            _ => 0.0,
        }
    }

    /// Ideal intensity 0 … 1 of one frame; of a modulated set the factor along its axis.
    pub(super) fn codec_intensity(&self, step: usize, coordinate_px: f64) -> f64 {
        match self {
            Self::Lines { period_px, steps, width_px, direction, .. } => {
                let column = (coordinate_px + 0.5).floor();
                let moved = direction.sign() * step as f64 * period_px / f64::from(*steps);
                // A column is lit or not: a period that is no whole number rounds it.
                let place = (column - moved).rem_euclid(*period_px);
                f64::from(u8::from(place < *width_px || place >= period_px - 1e-9))
            }
            _ => match self.micro_period_px(step) {
                Some(period_px) => 0.5 + 0.5 * cos(TAU * coordinate_px / period_px - self.step_rad(step)),
                None => 0.0,
            },
        }
    }

    /// Period of the sine that a frame shows along the axis of its set.
    fn micro_period_px(&self, step: usize) -> Option<f64> {
        match self {
            Self::Micro { periods_px, .. } => periods_px.get((step + 1).saturating_sub(MICRO_STEPS)).copied(),
            Self::Modulated { period_px, .. } => Some(*period_px),
            _ => None,
        }
    }

    /// The carrier of a frame of a modulated set: a plain set across its axis, and the frame of it that is the factor.
    pub fn carrier(&self, step: usize) -> Option<(Self, usize)> {
        let Self::Modulated { axis, carrier_px, carrier_steps, .. } = self else { return None };
        let across = match axis {
            Axis::X => Axis::Y,
            Axis::Y => Axis::X,
        };
        Some((Self::sine(across, *carrier_px, *carrier_steps), step % (*carrier_steps).max(1) as usize))
    }

    /// Projector pixels per 2π of a set with a phase; of a micro set those of its first frequency.
    pub fn period_px(&self) -> Option<f64> {
        match self {
            Self::Sine { period_px, .. }
            | Self::Lines { period_px, .. }
            | Self::Modulated { period_px, .. } => Some(*period_px),
            Self::Micro { periods_px, .. } => periods_px.first().copied(),
            _ => None,
        }
    }

    /// Line shift as it is usual: lines of one column that step by one column.
    pub const fn lines(axis: Axis, period_px: f64, steps: u32) -> Self {
        Self::Lines { axis, period_px, steps, width_px: 1.0, direction: Direction::Forward }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn micro(periods_px: &[f64], shifts_rad: &[f64]) -> PatternSet {
        PatternSet::Micro {
            axis: Axis::X,
            periods_px: periods_px.to_vec(),
            direction: Direction::Forward,
            shifts_rad: shifts_rad.to_vec(),
        }
    }

    #[test]
    fn lines_light_one_column_in_a_period_and_step_over_it() {
        let set = PatternSet::lines(Axis::X, 8.0, 8);
        for step in 0..8 {
            for column in 0..40_u32 {
                let lit = set.intensity(step, f64::from(column), 40).unwrap();
                assert_eq!(lit == 1.0, column as usize % 8 == step, "{step} {column}");
            }
        }
        // Half the period in steps of half a column more would light nothing twice: each column is lit once in six steps of six.
        let six = PatternSet::lines(Axis::X, 6.0, 6);
        let shown = |column: f64| (0..6).map(|step| six.intensity(step, column, 60).unwrap()).sum::<f64>();
        assert!((0..60).all(|column| shown(f64::from(column)) == 1.0));
    }

    #[test]
    fn frames_of_a_micro_set_are_three_steps_and_one_frame_of_each_further_period() {
        let set = micro(&[16.0, 17.0, 19.0], &[]);
        assert_eq!(set.frames(), 5);
        let level = |step, x| set.intensity(step, x, 600).unwrap();
        assert!((level(1, 16.0 / 3.0) - 1.0).abs() < 1e-12);
        assert!((level(3, 17.0) - 1.0).abs() < 1e-12 && (level(4, 19.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_modulated_frame_names_the_carrier_across() {
        let set = PatternSet::Modulated {
            axis: Axis::X,
            period_px: 16.0,
            steps: 3,
            carrier_px: 9.0,
            carrier_steps: 4,
            direction: Direction::Forward,
        };
        assert_eq!(set.frames(), 12);
        let (carrier, frame) = set.carrier(6).unwrap();
        assert_eq!((carrier, frame), (PatternSet::sine(Axis::Y, 9.0, 4), 2));
        assert!((set.step_rad(6) - TAU / 3.0).abs() < 1e-12);
        assert!(PatternSet::sine(Axis::X, 16.0, 4).carrier(0).is_none());
    }

    #[test]
    fn impossible_numbers_are_named() {
        let wide = PatternSet::Lines {
            axis: Axis::X,
            period_px: 8.0,
            steps: 8,
            width_px: 8.0,
            direction: Direction::Forward,
        };
        let modulated = |steps, carrier_steps, carrier_px| PatternSet::Modulated {
            axis: Axis::X,
            period_px: 16.0,
            steps,
            carrier_px,
            carrier_steps,
            direction: Direction::Forward,
        };
        for (set, key) in [
            (wide, "width_px = 8"),
            (PatternSet::lines(Axis::X, 2.0, 8), "period_px = 2"),
            (PatternSet::lines(Axis::X, 8.0, 2), "steps = 2"),
            (micro(&[16.0], &[]), "periods_px has 1"),
            (micro(&[16.0, f64::NAN], &[]), "periods_px"),
            (micro(&[16.0, 17.0], &[0.0; 3]), "shifts_rad has 3"),
            (micro(&[16.0, 17.0], &[0.0; 4]), "shifts_rad"),
            (modulated(9, 9, 9.0), "at most 64"),
            (modulated(3, 3, 1.0), "carrier_px = 1"),
            (modulated(3, 1, 9.0), "carrier_steps = 1"),
        ] {
            let error = set.check().unwrap_err().to_string();
            assert!(error.contains(key), "{error} lacks {key}");
        }
    }
}
