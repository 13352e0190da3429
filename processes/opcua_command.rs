//! `fringecell opcua`: OPC UA for Machine Vision in front of a cell.

use crate::gateway_arguments::GatewayArgs;
use anyhow::Result;

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
