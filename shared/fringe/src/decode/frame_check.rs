//! Checks of a frame before the decoder takes it.

use super::{DecodeError, Decoder};
use crate::frame::{FrameView, Pixels};

impl Decoder {
    /// Refuses a frame out of turn, of another size or grey scale, or with a value beyond full scale.
    pub(super) fn check_frame(&self, index: usize, frame: &FrameView) -> Result<(), DecodeError> {
        let count = self.plan.roles.len();
        if index != self.next || index >= count {
            return Err(DecodeError::FrameOrder { expected: self.next, got: index, count });
        }
        let pixels = frame.pixels.len();
        if (frame.width_px, frame.height_px) != (self.width_px, self.height_px) || pixels != self.pixels {
            return Err(DecodeError::FrameSize {
                index,
                width_px: frame.width_px,
                height_px: frame.height_px,
                pixels,
                want_width_px: self.width_px,
                want_height_px: self.height_px,
            });
        }
        if frame.full_scale_dn != self.full_scale_dn {
            return Err(DecodeError::FrameFullScale {
                index,
                got_dn: frame.full_scale_dn,
                want_dn: self.full_scale_dn,
            });
        }
        let full_scale_dn = self.full_scale_dn;
        match above(frame.pixels, full_scale_dn) {
            Some((pixel, value_dn)) => {
                Err(DecodeError::AboveFullScale { index, pixel, value_dn, full_scale_dn })
            }
            None => Ok(()),
        }
    }

    /// Refuses an axis of which a frame is wrong that cannot be left out.
    pub(super) fn check_sets(&self, home: usize) -> Result<(), DecodeError> {
        for slot in &self.plan.axes[home].sines {
            let steps = self.plan.sines[*slot].steps;
            if let Some(finding) = self.findings[*slot].iter().find(|found| found.is_fatal(steps as usize)) {
                return Err(DecodeError::WrongFrame { finding: Box::new(*finding), steps });
            }
        }
        Ok(())
    }
}

/// First value above full scale, if any.
fn above(pixels: Pixels, full_scale_dn: u16) -> Option<(usize, u16)> {
    match pixels {
        Pixels::Mono8(_) if full_scale_dn >= 255 => None,
        Pixels::Mono8(values) => first_above(values, full_scale_dn as u8).map(|(i, v)| (i, u16::from(v))),
        Pixels::Mono16(_) if full_scale_dn == u16::MAX => None,
        Pixels::Mono16(values) => first_above(values, full_scale_dn),
    }
}

fn first_above<T: Copy + PartialOrd>(values: &[T], limit: T) -> Option<(usize, T)> {
    // Without an exit the loop vectorises; frames beyond the limit are the exception.
    #[allow(clippy::needless_bitwise_bool)]
    let any = values.iter().fold(false, |any, value| any | (*value > limit));
    if any { values.iter().copied().enumerate().find(|(_, value)| *value > limit) } else { None }
}
