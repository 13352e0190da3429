//! Shared memory between the processes of a cell: frames, phase maps and clouds as loaned samples with typed headers.
//!
//! - [`port`]: nodes, topics and notifications; the only module that uses iceoryx2.
//! - [`header`]: the header in front of each payload.
//! - [`payload`]: typed views of payload bytes, after a check that header and payload agree.
//! - [`output_hash`]: the hash of a frame, phase map, cloud or result.
//! - [`link`]: messages to the other hosts of a cell, over iceoryx2's link; only with the feature `hosts`.
//! - [`cell`]: the runtime folder of a cell: its lock, its files, its part of `/dev/shm`.
//! - [`sequence`]: the order of the activations on each core.
//! - [`os`]: system calls that the standard library does not offer; [`large_pages`]: pages of 2 MB for the buffers of a stage.
//!
//! # Transport rules
//! - Lossless: a full buffer blocks the sender up to a deadline; then the send fails. No message is overwritten or dropped.
//! - No polling: each process sleeps on one [`port::Listener`], and each sender notifies it.
//! - The supervisor creates every service before a stage starts; a stage only opens services. A stage that is killed during
//!   its start therefore never leaves a half-created service.

pub mod cell;
pub mod error;
pub mod header;
pub mod large_pages;
pub mod left_behind;
pub mod link;
pub mod long_text;
pub mod os;
mod output_hash;
pub mod payload;
pub mod port;
mod runtime_folder;
mod segments;
pub mod sequence;

pub use error::IpcError;
pub use output_hash::output_hash;
