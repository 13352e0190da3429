//! Arguments of the gateway to OPC UA.

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
