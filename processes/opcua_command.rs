//! `fringecell opcua`: OPC UA for Machine Vision in front of a cell.

use anyhow::Result;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Command-line arguments of `fringecell opcua`.
// Without the gateway nobody reads them, and the help text tells them all the same.
#[cfg_attr(not(feature = "opcua"), allow(dead_code))]
#[derive(Debug, Clone, clap::Args)]
pub struct GatewayArgs {
    /// Configuration of the cell (TOML).
    #[arg(value_name = "CONFIG")]
    pub config: PathBuf,
    /// Name of the cell, where it runs under another name than its configuration states.
    #[arg(long, value_name = "NAME")]
    pub cell: Option<String>,
    /// Address to serve at; port 0: any free port.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:4840")]
    pub address: SocketAddr,
    /// Folder of certificates and keys, made if absent: signed and encrypted connections. Needed where other machines can
    /// reach the address.
    #[arg(long, value_name = "DIR")]
    pub pki: Option<PathBuf>,
    /// File with a name and a password on each line, which only its owner may read: clients must log in.
    #[arg(long, value_name = "FILE")]
    pub users: Option<PathBuf>,
    /// Serve clients without a user where other machines can reach the address, or beside --users.
    #[arg(long)]
    pub allow_anonymous: bool,
}

/// Serves until a termination signal.
///
/// # Errors
/// The configuration or an option is invalid, or the address is taken.
#[cfg(feature = "opcua")]
pub fn opcua(args: &GatewayArgs) -> Result<u8> {
    crate::gateway::run(args)
}

/// Says that this program has no gateway.
///
/// # Errors
/// In any case: with the remedy.
#[cfg(not(feature = "opcua"))]
pub fn opcua(_args: &GatewayArgs) -> Result<u8> {
    anyhow::bail!(
        "this program is built without OPC UA, whose library takes minutes to compile; build it with `cargo build --release --features \
         opcua`"
    )
}
