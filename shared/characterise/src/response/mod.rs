//! The projector's response: from the level that is drawn to the light that arrives, and back.
//!
//! A projector answers a level with light that is not proportional to it ("gamma"), so that a drawn sinusoid arrives with
//! harmonics, which an N-step phase takes for phase: harmonics of the orders N·m ± 1 shift it by an error that repeats N
//! times a fringe. This module measures the response from frames of even grey levels ([`Stack`], [`ResponseCurve`]), fits the
//! thesis' inverse polynomial of order 7 ([`InversePolynomial`], eq. 3.2) and the power law ([`PowerLaw`], eq. 3.1), makes
//! the table that pattern generation applies ([`fringe::pattern::LevelTable`]), and reports harmonics and phase error before and after, both
//! as the curve predicts them ([`waveform`]) and as recorded fringes show them ([`recorded`]). Without grey frames the
//! exponent can be had from the fringes themselves ([`fringes`]).
//!
//! Levels are 0 … 1 of the projector's range. The camera is taken as linear; its black level and ambient light drop out.
//!
//! The table inverts the measured curve itself: the inverse of a power law has an infinite slope at black, which no
//! polynomial follows, so that eq. 3.2 leaves some of the error. Its table can be had too, for comparison.

mod curve;
mod error;
pub mod fringes;
mod inverse;
mod power;
pub mod recorded;
mod region;
#[cfg(test)]
mod tests;
pub mod waveform;

pub use curve::ResponseCurve;
pub use error::ResponseError;
pub use inverse::{COEFFICIENTS, InversePolynomial};
pub use power::PowerLaw;
pub use region::{GreyLevel, Roi, Stack};
