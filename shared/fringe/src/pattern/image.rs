//! What the frames of a pattern show: the intensity at a coordinate, and whole patterns, pixel by pixel, as a projector gets them.

use super::levels::ALL_LEVELS;
use super::{Axis, Code, LevelTable, PatternError, PatternSet};
use crate::math::random::Key;
use crate::math::{cos, wrap_positive_rad};
use std::f64::consts::TAU;

/// Parts of an 8-bit level that count when it is rounded: a hundred times the rounding errors of a cosine's argument at 10⁵ periods.
const PARTS_OF_A_LEVEL: f64 = 1_048_576.0;

/// The 8-bit value that a projector shows for a level 0 … 1; halfway between two it is the upper one.
///
/// Halfway between black and white is 127.5, which both flanks of a sine reach wherever columns and steps divide the period alike. The
/// last digits of the cosine would send one flank up and the other down: the rounded sine would not be symmetrical, and all of its
/// phases would be too small or too large by up to 0.001 px. So the last digits do not count.
pub fn level_u8(level: f64) -> u8 {
    ((level * 255.0 * PARTS_OF_A_LEVEL).round() / PARTS_OF_A_LEVEL).round() as u8
}

impl PatternSet {
    /// Ideal intensity 0 … 1 of one frame at a projector coordinate along the set's axis.
    ///
    /// `step` counts from 0 inside the set; `size_px` is the projector's extent along the axis. Of a modulated set it is the factor along the
    /// axis; the frame shows its product with the [`Self::carrier`].
    ///
    /// # Errors
    /// [`PatternError::NotGenerated`] for random dots.
    pub fn intensity(&self, step: usize, coordinate_px: f64, size_px: u32) -> Result<f64, PatternError> {
        Ok(match self {
            Self::Sine { period_px, .. } => {
                0.5 + 0.5 * cos(TAU * coordinate_px / period_px - self.step_rad(step))
            }
            Self::Lines { .. } | Self::Micro { .. } | Self::Modulated { .. } => {
                self.codec_intensity(step, coordinate_px)
            }
            Self::Gray { bits, stripe_px, shift_px, invert, code, .. } => {
                let column = (coordinate_px + 0.5).floor().max(0.0) + shift_px;
                let stripe = (column / stripe_px).floor() as u32;
                let number = if *code == Code::Gray { stripe ^ (stripe >> 1) } else { stripe };
                let bit = (number >> (*bits as usize - 1 - step)) & 1;
                f64::from(bit ^ u32::from(*invert))
            }
            Self::Check { stripe_px, seed, .. } => {
                let stripe = ((coordinate_px + 0.5).floor().max(0.0) / stripe_px).floor() as u64;
                f64::from((Key::new(u64::from(*seed)).bits(stripe) >> 63) as u32)
            }
            Self::White {} => 1.0,
            Self::Black {} => 0.0,
            Self::Stair { stair_px, steps, .. } => {
                let column = (coordinate_px + 0.5).floor().max(0.0);
                let stairs = (f64::from(size_px) / stair_px).ceil();
                let number = (column / stair_px).floor();
                if *steps == 1 {
                    return Ok((number / (stairs - 1.0).max(1.0)).min(1.0));
                }
                let phase_rad = -std::f64::consts::PI + TAU * (number + 0.5) / stairs;
                0.5 + 0.5 * cos(wrap_positive_rad(phase_rad - TAU * step as f64 / f64::from(*steps)))
            }
            Self::Ramp { axis: Some(_), .. } => {
                (coordinate_px / f64::from(size_px.max(2) - 1)).clamp(0.0, 1.0)
            }
            Self::Ramp { levels, .. } => levels.as_ref().unwrap_or(&ALL_LEVELS).level(step),
            Self::Random { .. } => return Err(PatternError::NotGenerated("random")),
        })
    }

    /// The 8-bit values that a projector shows along the set's axis, one per column (or row), corrected for its
    /// response where a table is given.
    ///
    /// # Errors
    /// As [`Self::intensity`].
    pub fn columns_u8(
        &self,
        step: usize,
        size_px: u32,
        correction: Option<&LevelTable>,
    ) -> Result<Vec<u8>, PatternError> {
        let value = |column| {
            let level = self.intensity(step, f64::from(column), size_px)?;
            let level = correction.map_or(level, |table| table.at(level));
            Ok(level_u8(level))
        };
        (0..size_px).map(value).collect()
    }

    /// The 8-bit image of one frame on a projector of `size_px` [width, height], row by row from the top, corrected for its
    /// response where a table is given. `step` counts from 0 inside the set.
    ///
    /// # Errors
    /// As [`Self::intensity`].
    pub fn image_u8(
        &self,
        step: usize,
        size_px: [u32; 2],
        correction: Option<&LevelTable>,
    ) -> Result<Vec<u8>, PatternError> {
        let [width, height] = size_px.map(|size| size as usize);
        if let Some((carrier, frame)) = self.carrier(step) {
            return self.product_u8(step, (&carrier, frame), size_px, correction);
        }
        match self.axis() {
            None => Ok(vec![self.columns_u8(step, 1, correction)?[0]; width * height]),
            Some(Axis::X) => Ok(self.columns_u8(step, size_px[0], correction)?.repeat(height)),
            Some(Axis::Y) => {
                let rows = self.columns_u8(step, size_px[1], correction)?;
                Ok(rows.into_iter().flat_map(|level| std::iter::repeat_n(level, width)).collect())
            }
        }
    }

    /// A frame with a carrier across its fringes: the product is corrected and rounded, not its factors.
    fn product_u8(
        &self,
        step: usize,
        (carrier, frame): (&Self, usize),
        size_px: [u32; 2],
        correction: Option<&LevelTable>,
    ) -> Result<Vec<u8>, PatternError> {
        let levels = |set: &Self, step: usize, axis: Option<Axis>| -> Result<Vec<f64>, PatternError> {
            let extent = size_px[usize::from(axis == Some(Axis::Y))];
            (0..extent).map(|place| set.intensity(step, f64::from(place), extent)).collect()
        };
        let along = levels(self, step, self.axis())?;
        let across = levels(carrier, frame, carrier.axis())?;
        let (columns, rows) = if self.axis() == Some(Axis::Y) { (across, along) } else { (along, across) };
        let value = |level: f64| level_u8(correction.map_or(level, |table| table.at(level)));
        Ok(rows.iter().flat_map(|row| columns.iter().map(move |column| value(row * column))).collect())
    }

    /// Whether every frame shows black and white alone, so that one bit a pixel holds it.
    ///
    /// # Errors
    /// As [`Self::intensity`].
    pub fn is_black_and_white(
        &self,
        size_px: [u32; 2],
        correction: Option<&LevelTable>,
    ) -> Result<bool, PatternError> {
        if self.carrier(0).is_some() {
            return Ok(false);
        }
        let extent = size_px[usize::from(self.axis() == Some(Axis::Y))];
        for step in 0..self.frames() {
            let levels = self.columns_u8(step, extent, correction)?;
            if levels.iter().any(|level| !matches!(level, 0 | 255)) {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::Direction;

    #[test]
    fn an_image_repeats_its_columns_or_its_rows() {
        let size_px = [20, 7];
        for (axis, extent) in [(Axis::X, 20), (Axis::Y, 7)] {
            let set = PatternSet::sine(axis, 8.0, 4);
            let image = set.image_u8(1, size_px, None).unwrap();
            let levels = set.columns_u8(1, extent, None).unwrap();
            assert_eq!(image.len(), 140);
            for (place, level) in image.iter().enumerate() {
                let along = if axis == Axis::X { place % 20 } else { place / 20 };
                assert_eq!(*level, levels[along]);
            }
        }
        assert_eq!(PatternSet::White {}.image_u8(0, [3, 2], None).unwrap(), [255; 6]);
        assert!(PatternSet::Random { frames: 1 }.image_u8(0, [3, 2], None).is_err());
    }

    #[test]
    fn a_carrier_multiplies_before_it_is_rounded() {
        let modulated = |axis| PatternSet::Modulated {
            axis,
            period_px: 8.0,
            steps: 3,
            carrier_px: 6.0,
            carrier_steps: 4,
            direction: Direction::Forward,
        };
        for axis in [Axis::X, Axis::Y] {
            let set = modulated(axis);
            let image = set.image_u8(5, [16, 12], None).unwrap();
            let (carrier, frame) = set.carrier(5).unwrap();
            for (place, level) in image.iter().enumerate() {
                let (x, y) = ((place % 16) as f64, (place / 16) as f64);
                let (along, across) = if axis == Axis::X { (x, y) } else { (y, x) };
                let light =
                    set.intensity(5, along, 16).unwrap() * carrier.intensity(frame, across, 16).unwrap();
                assert_eq!(*level, level_u8(light));
            }
        }
    }

    #[test]
    fn codes_are_black_and_white_and_sines_are_not() {
        let of = |set: PatternSet| set.is_black_and_white([64, 48], None).unwrap();
        assert!(
            of(PatternSet::gray(Axis::X, 3, 8.0)) && of(PatternSet::White {}) && of(PatternSet::Black {})
        );
        assert!(of(PatternSet::lines(Axis::Y, 8.0, 8)));
        assert!(!of(PatternSet::sine(Axis::X, 8.0, 3)));
        // A correction that dims white takes it out of one bit.
        let dim = LevelTable::sample(256, |level| 0.8 * level).unwrap();
        let white = PatternSet::White {};
        let corrected = white.is_black_and_white([64, 48], Some(&dim)).unwrap();
        assert_eq!(corrected, white.image_u8(0, [1, 1], Some(&dim)).unwrap() == [255]);
    }
}
