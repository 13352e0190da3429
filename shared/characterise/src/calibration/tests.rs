//! The adjustment against a rig whose truth is known, against real point lists, and on inputs that determine nothing.

mod bad;
mod faces;
mod held_out;
mod lenses;
mod links;
mod predicted;
mod real;
mod synthetic;
mod truth;
