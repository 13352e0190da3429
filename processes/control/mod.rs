//! Control of a cell by a PLC gateway or a script: states and allowed requests.
//!
//! The states are those of OPC UA for Machine Vision (OPC 40100-1), so that a gateway maps them one to one. Pure.

mod machine;

pub use machine::{Action, Event, Machine, Refusal, State};
