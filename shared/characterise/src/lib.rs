//! From images to a rig: what is known of cameras, projectors and stages before a part is measured.
//!
//! Pure: no files, no clock, no environment, no logging, no `unsafe`. Conventions and determinism are those of
//! [`fringe`].

pub mod calibration;
mod chi_square;
pub mod explore;
pub mod exposure;
pub mod focus;
pub mod health;
mod least_squares;
pub mod nominal;
pub mod rectified_images;
pub mod reference_plane;
pub mod response;
pub mod rotation_stage;
pub mod self_calibration;
pub mod sensor;
pub mod target;
