//! Mathematics whose bits do not depend on the machine.
//!
//! Transcendental functions: glibc picks fused or unfused variants by processor; the `libm` crate is plain Rust and gives the
//! same bits everywhere. `sqrt` is exact by IEEE 754 and may be called directly.

pub mod cosine;
pub mod fourier;
pub mod linear;
pub mod parallel;
pub mod random;
pub(crate) mod simd;
pub mod statistics;

use std::f64::consts::{PI, TAU};

pub use libm::{
    acos, asin, atan, atan2, cbrt, cos, erf, erfc, exp, hypot, lgamma, log as ln, log1p, log10, pow, sin,
    sincos, tan,
};

/// Wraps an angle into (−π, π].
///
/// ```
/// assert!((fringe::math::wrap_rad(7.0) - (7.0 - std::f64::consts::TAU)).abs() < 1e-12);
/// ```
pub fn wrap_rad(angle_rad: f64) -> f64 {
    let wrapped = angle_rad - TAU * (angle_rad / TAU).round();
    if wrapped <= -PI { wrapped + TAU } else { wrapped }
}

/// Wraps an angle into [0, 2π).
pub fn wrap_positive_rad(angle_rad: f64) -> f64 {
    let wrapped = angle_rad - TAU * (angle_rad / TAU).floor();
    if wrapped >= TAU { 0.0 } else { wrapped }
}
