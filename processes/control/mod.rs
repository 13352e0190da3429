//! The control of a cell by a PLC gateway or a script: in which state it is and what it may be asked.
//!
//! The states are those of OPC UA for Machine Vision (OPC 40100-1): a gateway maps them one to one. Pure.

mod machine;

pub use machine::{Action, Event, Machine, Refusal, State};
