//! Messages between the hosts of a cell: iceoryx2's own link, tunnelled over Zenoh.
//!
//! Each host has two services with every host that it speaks with, one for each direction. They are in a root of their own, so
//! that the link cannot see frames. The link does not promise that a message arrives, nor once, nor in order; whoever uses it
//! has sequence numbers, hashes ([`crate::header::Link`]) and asks again.

#[cfg(feature = "hosts")]
mod tunnel;
#[cfg(feature = "hosts")]
pub use tunnel::HostLink;

#[cfg(not(feature = "hosts"))]
mod absent;
#[cfg(not(feature = "hosts"))]
pub use absent::HostLink;

use crate::cell::{CellName, random};
use crate::error::IpcError;
use std::net::SocketAddr;

/// Whether this program is built with the link.
pub const IS_BUILT_IN: bool = cfg!(feature = "hosts");

/// What is missing in a program without the link, and the remedy.
pub const NOT_BUILT_IN: [&str; 2] =
    ["this program is built without the link between hosts", "build it with `--features hosts`"];

/// Messages that may wait in front of a receiver; the oldest ones make room for new ones.
pub const LINK_BUFFER: usize = 32;

/// Which end of the link a host is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LinkEnd {
    /// It leads these hosts, and waits for them.
    Leads(Vec<String>),
    /// It is this host, and connects to the one that leads.
    Follows(String),
}

/// Where a link begins and ends.
#[derive(Debug, Clone)]
pub struct LinkPlan {
    /// Name of the cell in its runtime folder on this host.
    pub runtime: CellName,
    /// Name of the cell on all hosts.
    pub cell: String,
    /// This end of the link.
    pub end: LinkEnd,
    /// Address of the host that leads.
    pub address: SocketAddr,
    /// A partner that is silent for this long is lost, ms.
    pub silence_ms: u64,
}

/// A number that tells this start of a host from all others; never 0.
///
/// # Errors
/// The system gives no random numbers.
pub fn new_session() -> Result<u64, IpcError> {
    Ok(random()?.max(1))
}
