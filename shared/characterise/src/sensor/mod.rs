//! The sensor and lens of a camera, after EMVA 1288: what a pixel averages, from the edges of a calibration's boards, and how its
//! grey values scatter, from the residuals of stepped fringes (photon transfer).
//!
//! Both are found where there is plenty of evidence, from pictures that a calibration takes anyway; a part that fills 2 % of the
//! picture shows them badly.

mod footprint;
mod footprint_effect;
mod photon_transfer;

pub use footprint::{FootprintEstimate, footprint};
pub use footprint_effect::FootprintEffect;
pub use photon_transfer::{NoiseEstimate, photon_transfer};
