//! The link between two runtime roots on one machine, over TCP: what it carries, and at which cost.

#![cfg(feature = "hosts")]

mod late;

use ipc::cell::{CellLock, CellName};
use ipc::header::{LINK_BYTES, Link};
use ipc::link::{HostLink, LinkEnd, LinkPlan};
use ipc::os::Usage;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(60);

/// Two ends with runtime folders of their own.
struct Ends {
    leader: HostLink,
    follower: HostLink,
    locks: [CellLock; 2],
}

/// Shared memory that the schedule allows for each link, bytes.
const LINK_MEMORY: u64 = 64 << 20;

fn plan(runtime: &CellName, end: LinkEnd, address: SocketAddr) -> LinkPlan {
    LinkPlan {
        runtime: runtime.clone(),
        cell: format!("t-{}", std::process::id()),
        end,
        address,
        silence_ms: 1000,
    }
}

fn ends(name: &str) -> Ends {
    let address = free_address();
    ends_at(name, address, address)
}

fn free_address() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// Two ends; the one that follows finds the other one at an address of its own.
fn ends_at(name: &str, address: SocketAddr, seen_at: SocketAddr) -> Ends {
    let names = ["left", "right"]
        .map(|host| CellName::new(&format!("l{name}{}-{host}", std::process::id())).unwrap());
    let locks = [CellLock::take(&names[0]).unwrap(), CellLock::take(&names[1]).unwrap()];
    let leader = HostLink::open(&plan(&names[0], LinkEnd::Leads(vec!["right".into()]), address)).unwrap();
    let follower = HostLink::open(&plan(&names[1], LinkEnd::Follows("right".into()), seen_at)).unwrap();
    let mut ends = Ends { leader, follower, locks };
    // The first messages are lost until both ends have found each other.
    let begin = Instant::now();
    loop {
        ends.leader.send(0, Link { sequence: 1, ..Link::default() }, b"hello").unwrap();
        ends.spin();
        if ends.follower.receive(0).unwrap().is_some() {
            break;
        }
        assert!(begin.elapsed() < PATIENCE, "the ends never found each other");
        std::thread::sleep(Duration::from_millis(5));
    }
    ends
}

impl Ends {
    fn spin(&mut self) {
        self.leader.spin();
        self.follower.spin();
    }

    /// Sends chunks to the leader, so many at once, until all came; how many were sent.
    fn carry(&mut self, chunks: u32, at_once: u32) -> u32 {
        let payload: Vec<u8> = (0..LINK_BYTES).map(|i| (i * 7) as u8).collect();
        let (mut missing, mut sent): (Vec<u32>, u32) = ((0..chunks).collect(), 0);
        let begin = Instant::now();
        while !missing.is_empty() {
            assert!(begin.elapsed() < PATIENCE, "{} chunks never came", missing.len());
            let window: Vec<u32> = missing.iter().copied().take(at_once as usize).collect();
            for chunk in &window {
                let header =
                    Link { sender: 1, sequence: u64::from(*chunk) + 1, chunk: *chunk, ..Link::default() };
                self.follower.send(0, header, &payload).unwrap();
                self.follower.spin();
                sent += 1;
            }
            let asked = Instant::now();
            while window.iter().any(|chunk| missing.contains(chunk))
                && asked.elapsed() < Duration::from_millis(250)
            {
                self.spin();
                while let Some((header, bytes)) = self.leader.receive(0).unwrap() {
                    assert!(bytes == payload);
                    missing.retain(|chunk| *chunk != header.chunk);
                }
                std::thread::yield_now();
            }
        }
        sent
    }
}

/// A cable between both ends that delays what it carries, and can be cut.
struct Cable {
    /// Where the end that follows finds the other one.
    address: SocketAddr,
    state: Arc<CableState>,
}

#[derive(Default)]
struct CableState {
    is_cut: AtomicBool,
    delay_us: AtomicU64,
    carried: Mutex<Vec<TcpStream>>,
}

impl Cable {
    fn to(leader: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let state = Arc::new(CableState::default());
        let shared = Arc::clone(&state);
        // The threads end with the process.
        std::thread::spawn(move || {
            for near in listener.incoming().flatten() {
                let Ok(far) = TcpStream::connect(leader) else { continue };
                if shared.is_cut.load(Ordering::SeqCst) {
                    continue;
                }
                for (from, to) in [(&near, &far), (&far, &near)] {
                    to.set_nodelay(true).unwrap();
                    let state = Arc::clone(&shared);
                    late::carry(from.try_clone().unwrap(), to.try_clone().unwrap(), move || {
                        Duration::from_micros(state.delay_us.load(Ordering::SeqCst))
                    });
                }
                shared.carried.lock().unwrap().extend([near, far]);
            }
        });
        Self { address, state }
    }

    fn delay(&self, delay: Duration) {
        self.state.delay_us.store(delay.as_micros() as u64, Ordering::SeqCst);
    }

    /// Ends all connections, and refuses new ones until it is joined again.
    fn cut(&self, is_cut: bool) {
        self.state.is_cut.store(is_cut, Ordering::SeqCst);
        for stream in self.state.carried.lock().unwrap().drain(..).filter(|_| is_cut) {
            let _ = stream.shutdown(Shutdown::Both);
        }
    }
}

/// Proves: over a slow cable everything arrives; nothing crosses a cut one, and when it is joined again both ends find each other by
/// themselves, within some seconds.
#[test]
fn a_cable_that_is_slow_and_cut_is_found_again() {
    let leader = free_address();
    let cable = Cable::to(leader);
    let mut ends = ends_at("cable", leader, cable.address);
    cable.delay(Duration::from_millis(20));
    let sent = ends.carry(32, 16);
    assert!(sent < 64, "{sent} sent for 32");
    cable.cut(true);
    // What was on its way may still come.
    let cut = Instant::now();
    while cut.elapsed() < Duration::from_millis(1500) {
        ends.spin();
        while ends.leader.receive(0).unwrap().is_some() {}
        std::thread::sleep(Duration::from_millis(5));
    }
    for sequence in 1..20 {
        ends.follower.send(0, Link { sequence, ..Link::default() }, b"lost").unwrap();
        ends.spin();
        assert!(ends.leader.receive(0).unwrap().is_none(), "a cut cable carries nothing");
        std::thread::sleep(Duration::from_millis(5));
    }
    cable.cut(false);
    let joined = Instant::now();
    loop {
        ends.follower.send(0, Link { sequence: 99, ..Link::default() }, b"again").unwrap();
        ends.spin();
        if ends.leader.receive(0).unwrap().is_some_and(|(header, _)| header.sequence == 99) {
            break;
        }
        assert!(joined.elapsed() < PATIENCE, "the ends never found each other again");
        std::thread::sleep(Duration::from_millis(5));
    }
    // Those that were sent before.
    let found = Instant::now();
    while found.elapsed() < Duration::from_millis(500) {
        ends.spin();
        while ends.leader.receive(0).unwrap().is_some() {}
    }
    println!("a cut cable: found again after {:?}", found - joined);
    assert!(ends.carry(32, 16) < 64);
}

/// Proves: header and payload cross between two roots unchanged in both directions, a cloud of 16 MB in chunks, too.
#[test]
fn messages_and_chunks_cross_between_two_roots() {
    let mut ends = ends("cross");
    let sent = ends.carry(64, 16);
    for lock in &ends.locks {
        let prefix = lock.name().prefix();
        let entries = std::fs::read_dir("/dev/shm").unwrap().map(Result::unwrap);
        let of_end = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&prefix));
        let bytes: u64 = of_end.map(|entry| entry.metadata().unwrap().len()).sum();
        assert!((1..LINK_MEMORY).contains(&bytes), "{bytes} bytes");
    }
    assert!(sent < 128, "{sent} sent for 64");
    let begin = Instant::now();
    let header = Link { sender: 7, receiver: 9, sequence: 5, cycle: 3, kind: 1, ..Link::default() };
    let came = loop {
        ends.leader.send(0, header, b"{}").unwrap();
        ends.spin();
        if let Some((came, payload)) =
            ends.follower.receive(0).unwrap().filter(|(_, payload)| payload == b"{}")
        {
            break (came, payload);
        }
        assert!(begin.elapsed() < PATIENCE);
    };
    assert_eq!((came.0.sender, came.0.receiver, came.0.sequence, came.0.cycle), (7, 9, 5, 3));
}

/// Proves: an address that another program has is refused with the address.
#[test]
fn an_address_that_is_taken_is_refused() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let name = CellName::new(&format!("ltaken{}-left", std::process::id())).unwrap();
    let _lock = CellLock::take(&name).unwrap();
    let address = taken.local_addr().unwrap();
    let refused = HostLink::open(&plan(&name, LinkEnd::Leads(vec!["right".into()]), address));
    let error = refused.err().expect("the port is taken").to_string();
    assert!(error.contains(&address.to_string()), "{error}");
}

#[test]
#[ignore = "prints figures: cargo test -p fringe-ipc --features hosts --test link figures -- --ignored --nocapture"]
fn figures_of_the_link() {
    let mut ends = ends("figures");
    ends.carry(32, 16);
    for at_once in [8, 16, 32] {
        let (chunks, before, begin) = (384, Usage::now(), Instant::now());
        let sent = ends.carry(chunks, at_once);
        let (cpu_ns, elapsed) = (Usage::now().since(before).cpu_ns, begin.elapsed());
        let mb = f64::from(chunks) * LINK_BYTES as f64 / 1e6;
        println!(
            "{mb:.0} MB, {at_once} chunks at once: {sent} sent for {chunks}, {:.2} ms of processor time per MB at both ends \
             together, elapsed {elapsed:?} on a shared machine",
            cpu_ns as f64 / 1e6 / mb
        );
    }
    let leader = free_address();
    let cable = Cable::to(leader);
    let mut ends = ends_at("slow", leader, cable.address);
    for delay_ms in [0, 5, 20] {
        cable.delay(Duration::from_millis(delay_ms));
        let begin = Instant::now();
        let sent = ends.carry(96, 16);
        let mb = 96.0 * LINK_BYTES as f64 / 1e6;
        let seconds = begin.elapsed().as_secs_f64();
        println!(
            "{delay_ms} ms each way, 16 chunks at once: {sent} sent for 96, {:.0} MB/s on a shared machine, the window alone allows {:.0} MB/s",
            mb / seconds,
            16.0 * LINK_BYTES as f64 / 1e6 / (2e-3 * delay_ms as f64).max(1e-9)
        );
    }
}
