//! Pure mathematics of fringe projection: no files, no clock, no environment, no logging, no `unsafe`.
//!
//! The order of the modules is the flow of the cell:
//! pattern → frame → phase (decode) → match → cloud → fused cloud → features → verdict.
//!
//! # Conventions
//! Lengths are in mm, angles in rad, times in ns, pixel (0, 0) is the centre of the top-left pixel; x right, y down,
//! z forward. `camera_from_world` maps world points into the camera. Units stand in names. NaN occurs only inside
//! rasters, beside a validity mask.
//!
//! # Determinism
//! Same input, same bytes: reductions run in a fixed order, parallel work is cut in fixed chunks whose results are
//! joined in order, transcendental functions come from [`math`] (never from the system's libm), and no product is
//! fused.

// What everything stands on.
pub mod geometry;
pub mod math;
pub mod text;

// The flow, in its order.
pub mod pattern;
pub mod planning;

pub mod frame;

pub mod decode;
pub mod filter;
pub mod phase;
pub mod unwrap;
pub mod wrapped;

pub mod matching;
pub mod projector;
pub mod rectify;
pub mod surface;

pub mod cloud;
pub mod fusion;

pub mod synthetic;
