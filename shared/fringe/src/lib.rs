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

pub mod acceptance;
pub mod calibration;
pub mod camera;
pub mod cloud;

pub mod compare;
pub mod decode;
pub mod filter;
pub mod fit;
pub mod focus;
mod fourier;
pub mod frame;
pub mod fusion;
pub mod health;
pub mod inspection;
pub mod matching;
pub mod math;
mod parallel;
pub mod pattern;
pub mod phase;
pub mod planning;
pub mod pose;
pub mod probing;
pub mod projector;
pub mod random;
pub mod rectify;

pub mod reference;
pub mod reference_plane;
pub mod register;
pub mod response;
pub mod rig;
pub mod rotation_stage;
pub mod spatial;
pub mod surface;
pub mod target;
#[cfg(test)]
mod testing;
mod text;
pub mod triangulate;
pub mod uncertainty;
pub mod unwrap;
pub mod wrapped;
