//! What iceoryx2's link over Zenoh carries by itself, between two roots: the ground that the link between hosts stands on.

#![cfg(feature = "hosts")]

use ::ipc::header::Link;
use iceoryx2::prelude::*;
use iceoryx2_integrations_zenoh_link_carrier::ZenohCarrier;
use iceoryx2_link_tunnel::Tunnel;
use std::time::{Duration, Instant};

type Service = iceoryx2::service::ipc::Service;
type Bridge = iceoryx2_link::Link<Service, Tunnel<ZenohCarrier>>;

fn config(name: &str) -> Config {
    let root = std::env::temp_dir().join(format!("link-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&root).unwrap();
    let mut config = Config::default();
    config.global.set_root_path(&Path::new(root.to_str().unwrap().as_bytes()).unwrap());
    config.global.prefix = FileName::new(format!("lc{}{name}_", std::process::id()).as_bytes()).unwrap();
    config
}

fn node(config: &Config) -> Node<Service> {
    let builder = NodeBuilder::new().config(config).signal_handling_mode(SignalHandlingMode::Disabled);
    builder.create::<Service>().unwrap()
}

fn bridge(config: &Config, listens: bool, address: &str) -> Bridge {
    let ends = if listens { ("listen", "connect") } else { ("connect", "listen") };
    let text = format!(
        "{{ mode: \"peer\", {}: {{ endpoints: [\"tcp/{address}\"] }}, {}: {{ endpoints: [] }}, \
         scouting: {{ multicast: {{ enabled: false }} }} }}",
        ends.0, ends.1
    );
    let carrier = ZenohCarrier::create(zenoh::Config::from_json5(&text).unwrap()).unwrap();
    iceoryx2_link::Link::new(node(config), Tunnel::new(carrier, config))
}

/// Turns both ends until something is there, or the time is over.
fn until<T>(bridges: &mut [Bridge; 2], seconds: u64, mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(seconds) {
        for bridge in bridges.iter_mut() {
            bridge.discover().unwrap();
            let _ = bridge.propagate();
        }
        if let Some(found) = look() {
            return Some(found);
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    None
}

#[test]
#[ignore = "prints what is carried: cargo test -p fringe-ipc --features hosts --test link_carries -- --ignored --nocapture"]
fn figures_of_large_samples_late_joiners_events_and_requests() {
    let address = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let configs = [config("a"), config("b")];
    let nodes = [node(&configs[0]), node(&configs[1])];
    let mut bridges = [bridge(&configs[0], true, &address), bridge(&configs[1], false, &address)];
    let topic = |node: &Node<Service>| {
        node.service_builder(&"cloud".try_into().unwrap())
            .publish_subscribe::<[u8]>()
            .user_header::<Link>()
            .max_publishers(4)
            .max_subscribers(4)
            .history_size(2)
            .subscriber_max_buffer_size(4)
            .open_or_create()
            .unwrap()
    };
    let (here, there) = (topic(&nodes[0]), topic(&nodes[1]));
    let publisher = here
        .publisher_builder()
        .initial_max_slice_len(1 << 27)
        .allocation_strategy(AllocationStrategy::Static)
        .create()
        .unwrap();
    let subscriber = there.subscriber_builder().create().unwrap();
    until(&mut bridges, 2, || None::<()>);
    for mb in [1_usize, 16, 64, 96] {
        let payload: Vec<u8> = (0..mb << 20).map(|i| (i * 31 / 7) as u8).collect();
        let mut came = 0;
        for _ in 0..4 {
            let mut sample = publisher.loan_slice_uninit(payload.len()).unwrap().write_from_slice(&payload);
            sample.user_header_mut().cycle = mb as u64;
            sample.send().unwrap();
            let received = until(&mut bridges, 5, || subscriber.receive().unwrap());
            came += usize::from(
                received.is_some_and(|s| s.user_header().cycle == mb as u64 && *s.payload() == *payload),
            );
        }
        println!("samples of {mb} MiB with their header: {came} of 4 came unchanged");
    }
    let late = there.subscriber_builder().create().unwrap();
    let history = until(&mut bridges, 2, || late.receive().unwrap());
    println!(
        "a subscriber that joins late, far side, history 2: {}",
        if history.is_some() { "gets one" } else { "gets none" }
    );
    let event = |node: &Node<Service>| {
        node.service_builder(&"event".try_into().unwrap()).event().open_or_create().unwrap()
    };
    let (sends, hears) = (event(&nodes[0]), event(&nodes[1]));
    let (notifier, listener) =
        (sends.notifier_builder().create().unwrap(), hears.listener_builder().create().unwrap());
    until(&mut bridges, 2, || None::<()>);
    notifier.notify().unwrap();
    let mut heard = false;
    until(&mut bridges, 5, || {
        listener.try_wait(|_| heard = true).unwrap();
        heard.then_some(())
    });
    println!("an event: {}", if heard { "comes" } else { "does not come" });
    let request = |node: &Node<Service>| {
        node.service_builder(&"request".try_into().unwrap())
            .request_response::<u64, u64>()
            .open_or_create()
            .unwrap()
    };
    let (asks, answers) = (request(&nodes[0]), request(&nodes[1]));
    let (client, server) =
        (asks.client_builder().create().unwrap(), answers.server_builder().create().unwrap());
    until(&mut bridges, 2, || None::<()>);
    let pending = client.send_copy(7).unwrap();
    let asked = until(&mut bridges, 3, || server.receive().unwrap());
    println!("a request: {}", if asked.is_some() { "comes" } else { "does not come" });
    drop(pending);
}
