//! The stage `link` of a cell on several computers: speaks with the other hosts.
//!
//! Hosts tell each other their whole state again and again, so that a message that is lost, late, doubled or out of order changes
//! nothing. Clouds travel in chunks that the host that leads asks for, and asks for again. Pure modules decide
//! ([`leader`], [`follower`], [`assembly`]); [`speaker`] connects them to the link and the clock, on a thread of its own,
//! because a host has to give signs of life between cycles as well.

mod assembly;
mod deliver;
mod drill;
mod follower;
mod leader;
mod message;
mod partner;
mod receive;
mod speaker;

pub use deliver::Deliver;
pub use receive::Receive;

use crate::software::FRINGECELL;
use anyhow::{Context, Result, ensure};
use devices::LoadedCell;
use ipc::cell::CellName;
use ipc::link::{LinkEnd, LinkPlan};
use message::Identity;
use std::path::Path;

/// Digits of the hash of a file that are told: enough to detect every change.
const SHORT_HASH: usize = 16;

/// This end of the link.
fn plan(cell: &LoadedCell, end: LinkEnd) -> Result<LinkPlan> {
    let address = cell.config.hosts.iter().find_map(|host| host.listen);
    Ok(LinkPlan {
        runtime: CellName::new(&cell.name)?,
        cell: cell.shared_name.clone(),
        end,
        address: address.context("no host has `listen`")?,
        silence_ms: cell.config.limits.silence_ms,
    })
}

/// What this host says of itself, and expects of the others.
fn identity(cell: &LoadedCell) -> Result<Identity> {
    let here = cell.graph.here;
    ensure!(here.is_some(), "the stage link is only for a cell on several hosts");
    let short = |(name, sha256): (String, String)| {
        // Folders may differ from host to host.
        let name =
            Path::new(&name).file_name().map_or(name.clone(), |file| file.to_string_lossy().into_owned());
        [name, sha256.chars().take(SHORT_HASH).collect()]
    };
    Ok(Identity {
        software: format!("{} {}", FRINGECELL.version, FRINGECELL.commit),
        host: here.map_or("", |here| cell.graph.host_name(here)).to_owned(),
        files: cell.file.read_files().into_iter().map(short).collect(),
    })
}
