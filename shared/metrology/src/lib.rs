//! From clouds to values: fits, inspection plans, comparison, registration, acceptance tests, uncertainty.
//!
//! Pure: no files, no clock, no environment, no logging, no `unsafe`. It depends on clouds ([`fringe::cloud`]) and not on
//! how they were measured. Conventions and determinism are those of [`fringe`].

pub mod acceptance;
pub mod cad;
pub mod compare;
mod counted_order;
pub mod facing;
pub mod fit;
pub mod general_tolerance;
pub mod inspection;
pub mod probing;
pub mod reference;
pub mod register;
pub mod spatial;
pub mod spc;
mod spread;
pub mod surface_net;
pub mod uncertainty;
pub mod verdict;
pub mod view_planning;
