//! The gateway: OPC UA for Machine Vision (OPC 40100-1) in front of the command socket of a cell. It is a process of its own that
//! may end at any time: cycles, jobs and results are the cell's.

mod arguments;
mod events;
mod filters;
mod link;
mod lists;
mod machine;
mod mark;
mod methods;
mod names;
mod nodeset;
mod results;
mod security;
mod server;
mod shown;
mod types;
mod vision;
mod watch;

use crate::gateway_arguments::GatewayArgs;
use crate::terminal;
use anyhow::{Context as _, Result, anyhow};
use events::Sessions;
use files::config::Config;
use ipc::cell::CellName;
use ipc::os;
use names::Identity;
use nodeset::Import;
use opcua::server::ServerBuilder;
use opcua::server::address_space::AddressSpace;
use opcua::server::node_manager::ServerContext;
use opcua::server::node_manager::memory::InMemoryNodeManagerBuilder;
use server::{Manager, Plan};
use std::sync::Arc;
use types::{ConfigurationId, Types};

/// Serves until a termination signal.
///
/// # Errors
/// The configuration or an option is invalid, or the address is taken.
pub fn run(args: &GatewayArgs) -> Result<u8> {
    let config = Config::load(&args.config)?;
    let name = CellName::new(args.cell.as_deref().unwrap_or(&config.cell.name))?;
    let address = args.address;
    let access = security::Access::new(args)?;
    let listener = std::net::TcpListener::bind(address)
        .with_context(|| format!("--address {address}: cannot listen on this address"))?;
    listener.set_nonblocking(true)?;
    let local = listener.local_addr()?;
    os::catch_termination().context("handling the termination signals")?;
    // Cycles come first, whoever asks for them.
    let _refused = os::yield_to_others();
    let sessions = Arc::new(Sessions::default());
    let identity = identity(&config, &name);
    let plan =
        Plan { import: Import::new()?, identity, socket: name.socket(), sessions: Arc::clone(&sessions) };
    let nodes = move |context: ServerContext, space: &mut AddressSpace| plan.build(&context, space);
    let builder = access
        .configure(ServerBuilder::new(), &name, local)
        .with_type_tree_getter(sessions)
        .with_type_loader(Arc::new(Types))
        .with_node_manager(InMemoryNodeManagerBuilder::new(nodes));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(async {
        let (server, handle) = builder.build().map_err(|error| anyhow!("the server: {error}"))?;
        filters::install(&mut handle.info().type_loaders.write());
        let manager = handle.node_managers().get_of_type::<Manager>().context("the server has no nodes")?;
        let listener = tokio::net::TcpListener::from_std(listener)?;
        terminal::print_line(&format!("OPC UA at opc.tcp://{local}"));
        let watching = watch::watch(&name, &handle, &manager);
        tokio::select! {
            ended = server.run_with(listener) => ended.map_err(|error| anyhow!("the server: {error}")),
            () = watching => Ok(()),
        }
    })?;
    Ok(0)
}

/// What is known before the cell is reached.
fn identity(config: &Config, name: &CellName) -> Identity {
    let simulated =
        config.cell.cameras.iter().all(|camera| matches!(camera.driver, cell::configuration::Driver::Twin));
    let hash: Vec<u8> = (0..config.sha256.len() / 2)
        .filter_map(|n| u8::from_str_radix(config.sha256.get(2 * n..2 * n + 2)?, 16).ok())
        .collect();
    Identity {
        standard: 0,
        system: opcua::types::NodeId::null(),
        cell: name.as_str().to_owned(),
        configuration: ConfigurationId {
            id: config.cell.name.as_str().into(),
            hash: Some(hash.into()),
            hash_algorithm: Some("SHA-256".into()),
            ..ConfigurationId::default()
        },
        simulated,
    }
}
