//! From projected patterns to one cloud: the mathematics of fringe projection.
//!
//! Pure: no files, no clock, no environment, no logging, no `unsafe`. The modules stand below in the order of the flow: pattern →
//! frame → phase → point → cloud; what all of them rest on comes first.
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

// What everything rests on.
pub mod geometry;
pub mod math;
pub mod text;

// What is projected, and how it is chosen.
pub mod pattern;

pub mod planning;

// What a camera sees, and what is known of it.
pub mod frame;

pub mod sensor;

// Phase modulo one period, then without ambiguity: from neighbouring pixels or from further patterns.
pub mod wrapped;

pub mod unwrap;

pub mod decode;

pub mod phase;

pub mod filter;

// From phase to depth: between two cameras, or between a camera and the projector.
pub mod rectify;

pub mod matching;

pub mod projector;

// From depth to points, and from the points of all pairs to one cloud.
pub mod surface;

pub mod cloud;

pub mod fusion;

// Scenes with known phase, for tests of this crate and of those above it.
pub mod synthetic;
