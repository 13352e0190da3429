//! Inspection of synthetic clouds of the demo part, and of everything that is not that part.

mod artefact;
mod clouds;
mod flatness;
mod places;
mod plans;
