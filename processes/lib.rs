//! What a cell computes, apart from the processes that compute it: its graph and schedule, its kernels, its drivers.
//!
//! Both binaries stand on it: `fringecell` runs it in many processes over shared memory, `fringetool replay` runs the
//! same steps in one.

pub mod cycle_number;
pub mod drivers;
pub mod graph;
pub mod judgement;
pub mod kernels;
pub mod output_check;
pub mod rerun;
pub mod schedule;
