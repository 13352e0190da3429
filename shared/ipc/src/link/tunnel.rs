//! The link over Zenoh.

use super::{LINK_BUFFER, LinkEnd, LinkPlan};
use crate::error::IpcError;
use crate::header::{LINK_BYTES, Link};
use iceoryx2::node::Node;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2_integrations_zenoh_link_carrier::ZenohCarrier;
use iceoryx2_link_tunnel::Tunnel;
use std::os::unix::fs::DirBuilderExt;
use std::time::{Duration, Instant};

/// Pause between two looks for services of other hosts.
const DISCOVERY_PAUSE: Duration = Duration::from_millis(100);

/// Publishers and subscribers of a service, each: this process, the link, and those of a process that was killed.
const PORTS: usize = 3;

/// Messages that a receiver may hold.
const HELD: usize = 2;

/// Longest state of the host that leads, bytes.
const STATE_BYTES: usize = 1 << 16;

/// Both directions between this host and another one.
struct Channel {
    sender: Publisher<ipc::Service, [u8], Link>,
    receiver: Subscriber<ipc::Service, [u8], Link>,
}

/// The link of this host to others. All of it must stay on one thread.
pub struct HostLink {
    // Dropped in this order: ports before their node.
    channels: Vec<Channel>,
    tunnel: iceoryx2_link::Link<ipc::Service, Tunnel<ZenohCarrier>>,
    _node: Node<ipc::Service>,
    address: String,
    discovered: Option<Instant>,
}

impl HostLink {
    /// Opens this end of a link; the other ends may come and go later.
    ///
    /// # Errors
    /// [`IpcError::Service`]: the address cannot be used, or iceoryx2 reports an error.
    pub fn open(plan: &LinkPlan) -> Result<Self, IpcError> {
        let address = plan.address.to_string();
        let fail =
            |what: &'static str, reason: String| IpcError::Service { what, name: address.clone(), reason };
        let config = iox_config(plan)?;
        let node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| fail("joining the link at", format!("{e:?}")))?;
        let (hosts, leads) = match &plan.end {
            LinkEnd::Leads(hosts) => (hosts.clone(), true),
            LinkEnd::Follows(host) => (vec![host.clone()], false),
        };
        let prefix = format!("fringecell/{}/", plan.cell);
        let channels = hosts.iter().map(|host| channel(&node, &format!("{prefix}{host}"), leads));
        let channels = channels.collect::<Result<Vec<_>, _>>()?;
        let tunnel_node = NodeBuilder::new()
            .config(&config)
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| fail("joining the link at", format!("{e:?}")))?;
        let zenoh = zenoh::Config::from_json5(&zenoh_config(plan, leads))
            .map_err(|e| fail("setting up the link at", e.to_string()))?;
        let carrier = ZenohCarrier::create(zenoh).map_err(|e| {
            let reason = format!("{e}; another program may have the port, or this host not the address");
            fail("opening the link at", reason)
        })?;
        // A link would also bring services here that are for other hosts.
        let own: Vec<String> = hosts.iter().map(|host| format!("{prefix}{host}/")).collect();
        let tunnel = iceoryx2_link::Link::new(tunnel_node, Tunnel::new(carrier, &config)).with_filter(
            move |name: &ServiceName| own.iter().any(|own| name.as_str().starts_with(own.as_str())),
        );
        Ok(Self { channels, tunnel, _node: node, address, discovered: None })
    }

    /// Moves what waits in both directions. What the link cannot carry is lost, as on a network.
    pub fn spin(&mut self) {
        if self.discovered.is_none_or(|then| then.elapsed() >= DISCOVERY_PAUSE) {
            self.discovered = Some(Instant::now());
            let _found_later = self.tunnel.discover();
        }
        let _sent_again = self.tunnel.propagate();
    }

    /// Sends a message to a host, by its place in the plan.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn send(&mut self, host: usize, header: Link, payload: &[u8]) -> Result<(), IpcError> {
        let fail = |e: String| IpcError::Service {
            what: "sending on the link at",
            name: self.address.clone(),
            reason: e,
        };
        let channel = &self.channels[host];
        let loan = channel.sender.loan_slice_uninit(payload.len()).map_err(|e| fail(format!("{e:?}")))?;
        let mut sample = loan.write_from_slice(payload);
        *sample.user_header_mut() = header.sealed(payload);
        sample.send().map_err(|e| fail(format!("{e:?}"))).map(|_| ())
    }

    /// The next message of a host whose hash is right; others are dropped.
    ///
    /// # Errors
    /// [`IpcError::Service`].
    pub fn receive(&mut self, host: usize) -> Result<Option<(Link, Vec<u8>)>, IpcError> {
        loop {
            let received = self.channels[host].receiver.receive();
            let received = received.map_err(|e| IpcError::Service {
                what: "receiving on the link at",
                name: self.address.clone(),
                reason: format!("{e:?}"),
            })?;
            let Some(sample) = received else { return Ok(None) };
            let header = *sample.user_header();
            if header.is_sound(sample.payload()) {
                return Ok(Some((header, sample.payload().to_vec())));
            }
        }
    }
}

/// A root below the runtime folder of the cell: the link sees what is in it, and nothing else of the cell.
fn iox_config(plan: &LinkPlan) -> Result<Config, IpcError> {
    let root = plan.runtime.folder().join("link");
    let made = std::fs::DirBuilder::new().recursive(true).mode(0o700).create(&root);
    made.map_err(|source| IpcError::File { path: root.clone(), action: "creating the folder", source })?;
    let fail =
        |reason: String| IpcError::Service { what: "naming the link in", name: plan.cell.clone(), reason };
    let mut config = Config::default();
    let path = root.to_str().ok_or_else(|| fail("the folder is not UTF-8".into()))?;
    config.global.set_root_path(&Path::new(path.as_bytes()).map_err(|e| fail(format!("{e:?}")))?);
    config.global.prefix =
        FileName::new(plan.runtime.run_prefix()?.as_bytes()).map_err(|e| fail(format!("{e:?}")))?;
    Ok(config)
}

/// The services of both directions with a host.
fn channel(node: &Node<ipc::Service>, name: &str, leads: bool) -> Result<Channel, IpcError> {
    let service = |direction: &str| {
        let name = format!("{name}/{direction}");
        let fail =
            |e: String| IpcError::Service { what: "creating link service", name: name.clone(), reason: e };
        node.service_builder(&ServiceName::new(&name).map_err(|e| fail(format!("{e:?}")))?)
            .publish_subscribe::<[u8]>()
            .user_header::<Link>()
            .max_publishers(PORTS)
            .max_subscribers(PORTS)
            .subscriber_max_buffer_size(LINK_BUFFER)
            .subscriber_max_borrowed_samples(HELD)
            .history_size(0)
            .enable_safe_overflow(true)
            .max_nodes(2 * PORTS)
            .open_or_create()
            .map_err(|e| fail(format!("{e:?}")))
    };
    let (down, up) = (service("down")?, service("up")?);
    let (to, from) = if leads { (down, up) } else { (up, down) };
    let fail =
        |e: String| IpcError::Service { what: "opening link service", name: name.to_owned(), reason: e };
    let sender = to
        .publisher_builder()
        .initial_max_slice_len(if leads { STATE_BYTES } else { LINK_BYTES })
        .max_loaned_samples(1)
        .allocation_strategy(AllocationStrategy::Static)
        .create()
        .map_err(|e| fail(format!("{e:?}")))?;
    let receiver = from.subscriber_builder().create().map_err(|e| fail(format!("{e:?}")))?;
    Ok(Channel { sender, receiver })
}

/// Zenoh between these hosts alone: no scouting, no other peers, connections that are tried again for ever.
fn zenoh_config(plan: &LinkPlan, leads: bool) -> String {
    let endpoint = format!("\"tcp/{}\"", plan.address);
    let (listen, connect) = if leads { (endpoint.as_str(), "") } else { ("", endpoint.as_str()) };
    // A dead connection ends before its partner counts as lost twice, so that a new one is made.
    let lease_ms = plan.silence_ms.clamp(500, 60_000);
    format!(
        r#"{{
  mode: "peer",
  listen: {{ endpoints: [{listen}], timeout_ms: 0, exit_on_failure: true }},
  connect: {{ endpoints: [{connect}], timeout_ms: -1, exit_on_failure: false,
    retry: {{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }} }},
  scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
  transport: {{
    link: {{ tx: {{ lease: {lease_ms}, keep_alive: 4,
      queue: {{ congestion_control: {{ drop: {{ wait_before_drop: 20000, max_wait_before_drop_fragments: 200000 }} }} }} }} }},
    shared_memory: {{ enabled: false }},
  }},
}}"#
    )
}
