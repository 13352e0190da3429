//! The shared memory of a cell, held by the supervisor.

use crate::stage::populated;
use anyhow::Result;
use ipc::IpcError;
use ipc::cell::CellLock;
use ipc::port::{Node, ServiceHandle};

/// Keeps the shared memory alive.
pub(super) struct Ports {
    _services: Vec<ServiceHandle>,
    pub(super) node: Node,
    lock: CellLock,
}

impl Ports {
    /// Keeps these services, the node and the folder of the cell.
    pub(super) fn new(services: Vec<ServiceHandle>, node: Node, lock: CellLock) -> Self {
        Self { _services: services, node, lock }
    }

    /// Takes all shared memory that the supervisor writes, so that none is missing when it sends a command.
    ///
    /// # Errors
    /// There is not enough: touching it later would end the supervisor by a bus error.
    pub(super) fn reserve(&self) -> Result<()> {
        let bytes = ipc::os::populate_writable(&self.lock.name().segments());
        populated(bytes, "the supervisor").map(drop)
    }

    /// Releases the shared memory of dead processes.
    ///
    /// # Errors
    /// Another process changed the shared memory: iceoryx2 might not return then.
    pub(super) fn clean_up_dead(&self) -> Result<(), IpcError> {
        self.lock.check_segments()?;
        self.node.clean_up_dead();
        Ok(())
    }
}
