//! What a cell computes, apart from the processes and devices of it: its graph and schedule, and one executor for each kind
//! of work.
//!
//! Both programs stand on it: `fringecell` runs a cell in many processes over shared memory, `fringetool replay` runs the
//! same steps in one. Pure: no files, no clock, no environment, no logging, no `unsafe`.

#![forbid(unsafe_code)]

mod cell;
pub mod configuration;
pub mod cycle_number;
mod error;
pub mod executor;
mod frame_format;
pub mod genicam_camera;
pub mod graph;
mod host_node;
mod hosts;
pub mod lightcrafter;
mod options;
pub mod pixel_format;
mod retention;
pub mod schedule;
pub mod together;

pub use cell::Cell;
pub use configuration::{Configuration, Recipe, Settings};
pub use error::{CellError, ScheduleError};
pub use frame_format::FrameFormat;
pub use options::Options;
pub use retention::Retention;
