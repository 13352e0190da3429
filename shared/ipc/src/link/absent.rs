//! What stands for the link in a program that is built without it.

use super::{LinkPlan, NOT_BUILT_IN};
use crate::error::IpcError;
use crate::header::Link;

/// A link that cannot be opened.
#[derive(Debug)]
pub enum HostLink {}

impl HostLink {
    /// Refuses to open a link.
    ///
    /// # Errors
    /// [`IpcError::Service`], always.
    pub fn open(plan: &LinkPlan) -> Result<Self, IpcError> {
        let name = plan.address.to_string();
        Err(IpcError::Service { what: "opening the link at", name, reason: NOT_BUILT_IN.join("; ") })
    }

    /// Moves what waits in both directions.
    pub fn spin(&mut self) {
        match *self {}
    }

    /// Sends a message to a host.
    ///
    /// # Errors
    /// Never: there is no such link.
    pub fn send(&mut self, _host: usize, _header: Link, _payload: &[u8]) -> Result<(), IpcError> {
        match *self {}
    }

    /// The next message of a host.
    ///
    /// # Errors
    /// Never: there is no such link.
    pub fn receive(&mut self, _host: usize) -> Result<Option<(Link, Vec<u8>)>, IpcError> {
        match *self {}
    }
}
