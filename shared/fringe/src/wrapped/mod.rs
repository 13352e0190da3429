//! Wrapped phase: the methods of the field side by side, each with its noise and its mask.
//!
//! | method | frames | takes | source |
//! |---|---|---|---|
//! | [`Method::LeastSquares`] | N ≥ 3 | any known shifts | eq. 2.15, 2.16 and their normal equations |
//! | [`Method::ThreeStep`] | 3 | shifts −α, 0, α | eq. 2.10 – 2.12 |
//! | [`Method::Carre`] | 4 | equal steps of unknown size | Carré, Metrologia 2, 13, 1966 |
//! | [`Method::Hariharan`] | 5 | steps of about 90° | Hariharan, Oreb, Eiju, Appl. Opt. 26, 2504, 1987 |
//! | [`Method::FourierRows`], [`Method::Fourier`] | 1 | a carrier | eq. 2.3 – 2.9; Takeda and Mutoh, 1983 |
//!
//! [`windowed::filter`] takes the noise out of any of them (windowed Fourier filtering), and [`harmonics`] the error that
//! a projector's response leaves in the phase.
//!
//! # Convention
//! Iᵢ = A + B cos(φ − δᵢ), φ in [0, 2π). NaN stands where a pixel is masked; a mask is never filled. The noise of the
//! phase follows from that of the grey values, read² + gain · A, by the method's own derivatives.

mod fourier;
pub mod harmonics;
mod self_calibrating;
mod steps;
#[cfg(test)]
mod tests;
pub mod windowed;

pub use steps::LeastSquares;

use crate::frame::FrameView;
use crate::math::{atan2, wrap_positive_rad};
use thiserror::Error;

/// How a wrapped phase is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Known shifts, by least squares.
    LeastSquares,
    /// Three steps in closed form.
    ThreeStep,
    /// Four equal steps of unknown size.
    Carre,
    /// Five steps of about 90°.
    Hariharan,
    /// One frame, row by row (along columns when the carrier runs down).
    FourierRows,
    /// One frame, in the plane.
    Fourier,
}

impl Method {
    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::LeastSquares => "least-squares",
            Self::ThreeStep => "three-step",
            Self::Carre => "carre",
            Self::Hariharan => "hariharan",
            Self::FourierRows => "fourier-rows",
            Self::Fourier => "fourier",
        }
    }
}

/// Limits, and the noise of the grey values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Least modulation B, DN.
    pub least_modulation_dn: f64,
    /// A frame at or above this is clipped; its pixel is masked.
    pub clipped_dn: u16,
    /// Variance in the dark, DN².
    pub read_variance_dn2: f64,
    /// Variance per DN of signal, DN.
    pub gain_dn: f64,
}

impl Limits {
    /// Standard deviation of a grey value, DN.
    fn noise_dn(&self, level_dn: f64) -> f64 {
        (self.read_variance_dn2 + self.gain_dn * level_dn.max(0.0)).max(0.0).sqrt()
    }
}

/// A wrapped phase map.
#[derive(Debug, Clone, PartialEq)]
pub struct Wrapped {
    /// Columns of the map, px.
    pub width_px: u32,
    /// Rows of the map, px.
    pub height_px: u32,
    /// Phase in [0, 2π), rad; NaN where not valid.
    pub phase_rad: Vec<f32>,
    /// Its standard uncertainty, rad; NaN where not valid.
    pub sigma_rad: Vec<f32>,
    /// Modulation B of each pixel, DN.
    pub modulation: Vec<f32>,
    /// Background A of each pixel, DN.
    pub background: Vec<f32>,
    /// 1 where the phase may be used, else 0.
    pub valid: Vec<u8>,
}

/// What a method finds at one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PixelPhase {
    phase_rad: f64,
    modulation_dn: f64,
    background_dn: f64,
    sigma_rad: f64,
}

impl Wrapped {
    /// A map without any valid pixel.
    pub fn new(width_px: u32, height_px: u32) -> Self {
        let n = width_px as usize * height_px as usize;
        Self {
            width_px,
            height_px,
            phase_rad: vec![f32::NAN; n],
            sigma_rad: vec![f32::NAN; n],
            modulation: vec![0.0; n],
            background: vec![0.0; n],
            valid: vec![0; n],
        }
    }

    /// Number of pixels: columns times rows.
    pub fn len(&self) -> usize {
        self.valid.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.valid.is_empty()
    }

    /// Number of valid pixels.
    pub fn valid_count(&self) -> usize {
        self.valid.iter().map(|v| usize::from(*v)).sum()
    }

    fn set(&mut self, index: usize, found: &PixelPhase, least_modulation_dn: f64) {
        let PixelPhase { phase_rad, modulation_dn, background_dn, sigma_rad } = *found;
        self.modulation[index] = if modulation_dn.is_finite() { modulation_dn as f32 } else { 0.0 };
        self.background[index] = if background_dn.is_finite() { background_dn as f32 } else { 0.0 };
        let lit = modulation_dn >= least_modulation_dn && modulation_dn > 0.0 && modulation_dn.is_finite();
        if lit && phase_rad.is_finite() && sigma_rad.is_finite() {
            self.phase_rad[index] = wrap_f32(phase_rad);
            self.sigma_rad[index] = sigma_rad as f32;
            self.valid[index] = 1;
        }
    }

    fn mask(&mut self, index: usize) {
        (self.phase_rad[index], self.sigma_rad[index], self.valid[index]) = (f32::NAN, f32::NAN, 0);
    }
}

/// Into [0, 2π) also after the rounding to single precision.
fn wrap_f32(phase_rad: f64) -> f32 {
    let wrapped = wrap_positive_rad(phase_rad) as f32;
    if wrapped >= std::f32::consts::TAU { 0.0 } else { wrapped }
}

/// Why a phase cannot be had.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum WrapError {
    /// Another number of frames than the method takes.
    #[error(
        "method {method}: takes {needed}, but the sine set has {got} frames; choose another method or sequence"
    )]
    Frames {
        /// As on the command line.
        method: &'static str,
        /// Number of frames that the method takes.
        needed: &'static str,
        /// Number of frames given.
        got: usize,
    },
    /// Shifts that the method does not take.
    #[error("method {method}: {needed}, but the sine set has shifts of {got} degrees; use least-squares")]
    Shifts {
        /// As on the command line.
        method: &'static str,
        /// Phase shifts that the method takes.
        needed: &'static str,
        /// Phase shifts given, degrees, as text.
        got: String,
    },
    /// Frames of unequal size, or none.
    #[error("frame {index} has {got} pixels, the first one {want} in {width_px} x {height_px}")]
    Size {
        /// Frame number in the set, from 0.
        index: usize,
        /// Pixels of the frame.
        got: usize,
        /// Pixels of the first.
        want: usize,
        /// Columns of the first frame, px.
        width_px: u32,
        /// Rows of the first frame, px.
        height_px: u32,
    },
    /// Nothing periodic in the picture.
    #[error(
        "method {method}: no carrier: the strongest frequency holds {share:.1} % of the power, least 1 %; are there fringes, at \
         least 4 periods over the picture and 3 px a period?"
    )]
    NoCarrier {
        /// As on the command line.
        method: &'static str,
        /// Share of the strongest frequency in the power beside the mean, percent.
        share: f64,
    },
    /// Four or five frames whose steps are not equal to each other.
    #[error(
        "method {method}: the step size cannot be computed at any pixel; is there light, are the frames in order?"
    )]
    NoStep {
        /// As on the command line.
        method: &'static str,
    },
}

/// The frames of one sine set with their nominal shifts δᵢ, rad.
#[derive(Debug, Clone, Copy)]
pub struct Stack<'a> {
    frames: &'a [FrameView<'a>],
    shifts_rad: &'a [f64],
    width_px: u32,
    height_px: u32,
}

impl<'a> Stack<'a> {
    /// Joins frames of one size with their shifts.
    ///
    /// # Errors
    /// No frame, frames of unequal size, another number of shifts.
    pub fn new(frames: &'a [FrameView<'a>], shifts_rad: &'a [f64]) -> Result<Self, WrapError> {
        let wrong = |needed| WrapError::Frames { method: "phase", needed, got: frames.len() };
        let first = frames.first().ok_or_else(|| wrong("at least one frame"))?;
        if frames.len() != shifts_rad.len() {
            return Err(wrong("one shift per frame"));
        }
        let (width_px, height_px) = (first.width_px, first.height_px);
        let want = width_px as usize * height_px as usize;
        let unequal = frames.iter().position(|f| {
            (f.width_px, f.height_px) != (width_px, height_px) || f.pixels.len() != want || want == 0
        });
        match unequal {
            Some(index) => {
                Err(WrapError::Size { index, got: frames[index].pixels.len(), want, width_px, height_px })
            }
            None => Ok(Self { frames, shifts_rad, width_px, height_px }),
        }
    }

    /// Number of pixels: columns times rows.
    pub fn len(&self) -> usize {
        self.width_px as usize * self.height_px as usize
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Grey values of one pixel; `false` where one of them is clipped.
    fn pixel(&self, index: usize, clipped_dn: u16, values: &mut [f64]) -> bool {
        let mut lit = true;
        for (value, frame) in values.iter_mut().zip(self.frames) {
            let dn = frame.pixels.get(index);
            lit &= dn < f32::from(clipped_dn);
            *value = f64::from(dn);
        }
        lit
    }

    /// Finds the wrapped phase of every pixel.
    ///
    /// # Errors
    /// Frames or shifts that the method does not take; no carrier, no step that could be determined.
    pub fn wrap(&self, method: Method, limits: &Limits) -> Result<Wrapped, WrapError> {
        match method {
            Method::LeastSquares => steps::least_squares(self, limits),
            Method::ThreeStep => steps::three_step(self, limits),
            Method::Carre => self_calibrating::carre(self, limits),
            Method::Hariharan => self_calibrating::hariharan(self, limits),
            Method::FourierRows => fourier::rows(self, limits),
            Method::Fourier => fourier::plane(self, limits),
        }
    }

    /// Applies a formula to the grey values of every pixel that is not clipped.
    fn map(&self, limits: &Limits, formula: impl Fn(&[f64]) -> PixelPhase) -> Wrapped {
        let mut out = Wrapped::new(self.width_px, self.height_px);
        let mut values = vec![0.0; self.frames.len()];
        for index in 0..self.len() {
            if self.pixel(index, limits.clipped_dn, &mut values) {
                out.set(index, &formula(&values), limits.least_modulation_dn);
            }
        }
        out
    }

    fn degrees(&self) -> String {
        let list: Vec<String> = self.shifts_rad.iter().map(|s| format!("{:.1}", s.to_degrees())).collect();
        list.join(", ")
    }

    /// The equal step of the shifts, rad; `None` where they are unequal by more than 1e-6.
    fn equal_step_rad(&self) -> Option<f64> {
        let step_rad = self.shifts_rad.get(1)? - self.shifts_rad.first()?;
        let equal = self.shifts_rad.windows(2).all(|w| (w[1] - w[0] - step_rad).abs() < 1e-6);
        (equal && step_rad.abs() > 1e-6).then_some(step_rad)
    }
}

/// Polar angle in (−π, π] and length of (c, s).
fn polar(s: f64, c: f64) -> (f64, f64) {
    (atan2(s, c), (c * c + s * s).sqrt())
}
