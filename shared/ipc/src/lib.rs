//! Shared memory between the processes of a cell: frames, phase maps and clouds as loaned samples with typed headers.
//!
//! [`port`] is the only room that speaks to iceoryx2; [`header`] says what lies in front of each payload and [`payload`]
//! turns bytes into the views of `fringe` after checking that the header does not lie. [`cell`] is the private place of
//! a cell in the machine: its lock, its files, its share of `/dev/shm`. [`os`] holds the few calls to the kernel, [`turn`]
//! the order of work on each core.
//!
//! # Rules of the traffic
//! - Lossless: a full buffer holds the sender up to a deadline, then the send fails; nothing is overwritten or dropped.
//! - Nobody polls: each process sleeps on one [`port::Bell`], and whoever sends to it rings.
//! - The supervisor creates every service before a stage starts; a stage only opens. A stage killed in the middle of
//!   its start can then never leave a half-born service behind.

pub mod cell;
pub mod error;
pub mod header;
pub mod os;
pub mod payload;
pub mod port;
pub mod turn;

pub use error::IpcError;
