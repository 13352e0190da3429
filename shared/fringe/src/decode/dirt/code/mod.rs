//! Frames of a code, and white and black, that do not show what the sequence says: black, brighter as a whole, blurred, shifted, inverse, exchanged
//! with another.
//!
//! The bits of a pixel cannot tell which of them is wrong; the fringes can. Where a surface is smooth the wrapped phase runs on, and
//! carries the order from pixel to pixel without any code (`regions`). Such a region is a strip of stripes of which only one number is not
//! known: which fringe it begins with. Each frame, drawn along that strip, must be a piece of its own pattern of light and dark. One
//! number for all frames of a region (`begins`) is so much less than what the frames say that those which contradict stand out (`strips`).
//!
//! A frame that was exchanged is taken from where it is, a level is normalised, an inverse stands for its frame, and a bit that nothing
//! shows is written as the phase of the region demands it (`repair`), where the other bits confirm that all around (`demanded`).

mod begins;
mod bit_edges;
mod covers;
mod demanded;
mod displaced;
mod edge_zones;
mod frame_levels;
mod regions;
mod repair;
mod steps;
mod strips;
mod toggles;
mod without_inverses;

use super::{Fault, Finding, Remedy};
use crate::decode::rasters::Rasters;
use crate::decode::roles::CodePlan;
use crate::pattern::Code;
use covers::Covers;
use regions::Regions;
use strips::Strips;

/// Stripes are wide from so many periods on.
const WIDE_PERIODS: f64 = 1.5;

/// What a frame of the code should show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shown {
    /// Light all over the projector.
    White,
    /// No light from the projector.
    Black,
    /// A bit of a code, 0 the first frame; of its inverse where `inverse`.
    Bit {
        /// Stripes of the code and their numbering.
        code: CodePlan,
        /// Number of the frame in its set.
        bit: usize,
        /// Light and dark exchanged.
        inverse: bool,
    },
}

impl Shown {
    /// Whether a coordinate is light, and how far the next edge is, projector pixels.
    pub fn at(&self, x_px: f64) -> (bool, f64) {
        let Self::Bit { code, bit, inverse } = self else {
            return (*self == Self::White, f64::INFINITY);
        };
        let at = (x_px + 0.5 + code.shift_px) / code.stripe_px;
        let number = at.floor();
        let last = f64::from((1_u32 << code.bits.min(16)) - 1);
        let word = word_of(number.clamp(0.0, last) as u16, code.code);
        let light = (word >> (code.bits - 1 - bit)) & 1 == 1;
        let edge = (at - number).min(number + 1.0 - at) * code.stripe_px;
        (light ^ code.invert ^ inverse, edge)
    }
}

/// The bits of a stripe, the first frame the most significant.
fn word_of(number: u16, code: Code) -> u16 {
    match code {
        Code::Binary => number,
        Code::Gray => number ^ (number >> 1),
    }
}

/// A frame of the code as it is stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CodeFrame {
    /// Number of the stored raster.
    pub raster: usize,
    /// Position of its set in the sequence, from 0.
    pub set: usize,
    /// Number of the frame in its set, from 0.
    pub step: usize,
    /// What it should show.
    pub shown: Shown,
}

impl CodeFrame {
    /// Whether its stripes are wider than a fringe.
    pub fn is_wide(&self, period_px: f64) -> bool {
        let Shown::Bit { code, bit, .. } = self.shown else { return false };
        code.stripe_px * f64::from(1_u32 << (code.bits - 1 - bit)) > WIDE_PERIODS * period_px
    }
}

/// What the inspection needs to know of the pixels.
#[derive(Debug, Clone, Copy)]
pub struct CodeLook<'a> {
    /// Columns of the image, px.
    pub width: usize,
    /// Absolute phase as decoded, of which only the fraction of a turn counts; NaN where masked.
    pub phase_rad: &'a [f32],
    /// Grey value between light and dark of each pixel, DN.
    pub middle_dn: &'a [f32],
    /// Half the difference between light and dark, DN, but for a factor that all pixels share.
    pub contrast_dn: &'a [f32],
    /// Projector pixels per turn of the phase.
    pub period_px: f64,
    /// Projector pixels along the axis.
    pub extent_px: f64,
    /// The frames that are looked at.
    pub frames: &'a [CodeFrame],
}

impl CodeLook<'_> {
    /// Grey values of a frame as a number: −1 dark, 1 light.
    fn level(&self, rasters: &Rasters, frame: usize, place: usize) -> f32 {
        let value = f32::from(rasters.value(self.frames[frame].raster, place));
        ((value - self.middle_dn[place]) / self.contrast_dn[place]).clamp(-4.0, 4.0)
    }

    /// Whether a frame is nearer to light than to dark, at a pixel with contrast.
    fn is_light(&self, rasters: &Rasters, frame: usize, place: usize) -> bool {
        let value = rasters.value(self.frames[frame].raster, place);
        f32::from(value) > self.middle_dn[place]
    }

    /// What frames show at a pixel, each with whether it is its inverse that is read: the first one is the most significant bit. `None` where the
    /// code has no contrast.
    fn word(&self, rasters: &Rasters, from: &[(usize, bool)], place: usize) -> Option<u16> {
        let light = |&(frame, inverse): &(usize, bool)| self.is_light(rasters, frame, place) ^ inverse;
        (self.contrast_dn[place] > 0.0)
            .then(|| from.iter().fold(0, |word, of_bit| word << 1 | u16::from(light(of_bit))))
    }

    /// Numbering of the stripes of a frame.
    fn code_of(&self, frame: usize) -> Code {
        match self.frames[frame].shown {
            Shown::Bit { code, .. } => code.code,
            Shown::White | Shown::Black => Code::Gray,
        }
    }

    /// Writes a frame anew as another one with light and dark exchanged.
    fn put_inverse(&self, rasters: &mut Rasters, frame: usize, of: usize) {
        let values = rasters.taken(self.frames[of].raster);
        rasters.put(self.frames[frame].raster, |place| {
            let mirrored = 2.0 * self.middle_dn[place] - f32::from(values[place]);
            mirrored.round().clamp(0.0, f32::from(u16::MAX)) as u16
        });
    }

    /// Fraction of a turn, 0 to 1, of a pixel that is not masked.
    fn turn(&self, place: usize) -> Option<f64> {
        let phase = f64::from(self.phase_rad[place]) / std::f64::consts::TAU;
        (phase.is_finite() && self.contrast_dn[place] > 0.0).then(|| phase - phase.floor())
    }

    fn finding(&self, frame: usize, fault: Fault, remedy: Remedy) -> Finding {
        let CodeFrame { set, step, .. } = self.frames[frame];
        Finding { set, step: Some(step), fault, remedy }
    }
}

/// What was found in the frames of a code.
#[derive(Debug, Clone, PartialEq)]
pub struct CodeVerdict {
    /// The faults, in the order of the frames.
    pub findings: Vec<Finding>,
    /// Share of the pixels whose order the frames confirm, of those where they should.
    pub confirmed: f64,
    /// Coordinate that the region of each pixel demands, projector pixels, NaN where nothing is known, infinite where what is seen contradicts it;
    /// empty where no frame is wrong.
    pub demanded_px: Vec<f32>,
}

/// Looks for wrong frames of a code beside fringes, and writes the stored ones anew where what is left determines them.
pub fn mend(look: &CodeLook, rasters: &mut Rasters) -> CodeVerdict {
    let regions = Regions::new(look);
    // What shows neither light nor dark has no word in where a region begins.
    let mut covers = Covers::new(look, rasters);
    let begins = Strips::new(look, &regions, rasters, &covers).begins(look);
    let confirmed = regions.share(&begins);
    // What is wrong with a frame as a whole shows at all pixels …
    let mut judged = Strips::new(look, &regions, rasters, &Covers::none(look)).judge(look, &begins);
    // … and where the regions are known, what shows the wrong one of light and dark is seen as well.
    let doubted: Vec<bool> = judged.frames.iter().map(|judged| judged.fault.is_some()).collect();
    let mut demanded_px = demanded::demanded_px(look, &regions, &begins);
    covers.add_demanded(look, rasters, &demanded_px, &doubted);
    judged.cover(look, rasters, &demanded_px, &mut covers);
    let findings = repair::repair((look, &regions), &judged, &covers, &mut demanded_px, rasters);
    // A frame that is there, if elsewhere, leaves nothing to the phase.
    let shown = |found: &Finding| matches!(found.remedy, Remedy::OtherFrame | Remedy::Inverse);
    let demanded_px = if findings.iter().all(shown) { Vec::new() } else { demanded_px };
    CodeVerdict { findings, confirmed, demanded_px }
}

pub use toggles::mend as mend_alone;
