//! Both ends of the link against each other, over a network that loses, doubles, damages and reorders.

use super::super::follower::Follower;
use super::super::message::Identity;
use super::*;
use ipc::output_hash;

const MS: u64 = 1_000_000;
const SILENCE_NS: u64 = 1000 * MS;
const POINT: usize = 56;

fn identity(host: &str) -> Identity {
    Identity { software: "1".into(), host: host.into(), files: vec![["cell.toml".into(), "ab".into()]] }
}

fn peer() -> Peer {
    Peer::new("right", identity("left"), 100, BTreeMap::from([(1, 1 << 30)]), POINT, SILENCE_NS)
}

fn follower(session: u64) -> Follower {
    let mut follower = Follower::new(identity("right"), session, SILENCE_NS);
    follower.set_ready();
    follower
}

/// A number of the next message, and which of them the network treats how.
struct Network {
    sequence: u64,
    dice: u64,
    /// Of a hundred messages: lost, doubled, late, damaged.
    harm: [u64; 4],
    late: Vec<(Link, Vec<u8>)>,
}

impl Network {
    fn new(harm: [u64; 4]) -> Self {
        Self { sequence: 0, dice: 7, harm, late: Vec::new() }
    }

    /// What arrives of a message, and of earlier ones.
    fn carry(&mut self, header: Link, payload: &[u8]) -> Vec<(Link, Vec<u8>)> {
        self.sequence += 1;
        let sealed = Link { sequence: self.sequence, ..header }.sealed(payload);
        self.dice = self.dice.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let dice = (self.dice >> 33) % 100;
        let [lost, doubled, late, damaged] = self.harm;
        let mut arrives = std::mem::take(&mut self.late);
        let message = (sealed, payload.to_vec());
        if dice < lost {
        } else if dice < lost + doubled {
            arrives.extend([message.clone(), message]);
        } else if dice < lost + doubled + late {
            self.late.push(message);
        } else if dice < lost + doubled + late + damaged {
            let mut payload = payload.to_vec();
            payload[0] ^= 1;
            arrives.push((sealed, payload));
        } else {
            arrives.push(message);
        }
        // What the link does with all messages.
        arrives.retain(|(header, payload)| header.is_sound(payload));
        arrives
    }
}

fn json<T: serde::Serialize>(state: &T) -> Vec<u8> {
    serde_json::to_vec(state).unwrap()
}

fn header(sender: u64, receiver: u64) -> Link {
    Link { sender, receiver, kind: LinkKind::State as u32, ..Link::default() }
}

/// Ten milliseconds of both ends.
fn exchange(
    now: u64,
    peer: &mut Peer,
    host: &mut Follower,
    session: u64,
    down: &mut Network,
    up: &mut Network,
) {
    let (to, state) = peer.tell();
    for (header, payload) in down.carry(header(100, to), &json(&state)) {
        host.hear(now, &header, &payload);
    }
    while let Some((chunk, payload)) = host.next_chunk() {
        for (header, payload) in up.carry(Link { sender: session, ..chunk }, payload) {
            peer.hear(now, &header, &payload);
        }
    }
    let (to, state) = host.tell(now);
    for (header, payload) in up.carry(header(session, to), &json(&state)) {
        peer.hear(now, &header, &payload);
    }
    peer.update(now);
}

/// Proves: over any such network the cloud is the one that was sent, and both ends know that it came.
#[test]
fn a_cloud_comes_whole_over_a_network_that_loses_doubles_delays_and_damages() {
    for harm in [[0, 0, 0, 0], [30, 0, 0, 0], [0, 40, 0, 0], [0, 0, 50, 0], [0, 0, 0, 30], [15, 15, 15, 15]] {
        let (mut peer, mut host) = (peer(), follower(200));
        let (mut down, mut up) = (Network::new(harm), Network::new(harm));
        let points = 60_000;
        let bytes: Vec<u8> = (0..points * POINT).map(|i| (i * i / 7) as u8).collect();
        let (mut now, mut cloud, mut begun) = (0, None, false);
        let mut delivered = false;
        for _ in 0..3000 {
            now += 10 * MS;
            exchange(now, &mut peer, &mut host, 200, &mut down, &mut up);
            if !begun && peer.ready(now) == Ok(true) {
                peer.begin(1);
                begun = true;
            }
            if host.wanted(now) == Some(1) {
                host.requested(1);
                host.begin(1);
                host.acquired();
                host.matched(vec![(1, points as u32, bytes.clone())]);
            }
            if begun && cloud.is_none() {
                cloud = peer.take_cloud(now, 1).unwrap();
            }
            if begun && host.wanted(now).is_none() && cloud.is_some() && host.is_delivered(now).unwrap() {
                delivered = true;
                break;
            }
        }
        let cloud = cloud.unwrap_or_else(|| panic!("{harm:?}: no cloud"));
        assert!(delivered, "{harm:?}");
        assert!(cloud.bytes == bytes && cloud.hash == output_hash(&bytes), "{harm:?}");
        let spotless = Counts { chunks: bytes.len().div_ceil(1 << 18) as u64, ..Counts::default() };
        // What is late alone comes without being asked for again.
        assert!(harm != [0; 4] || cloud.counts == spotless, "{:?}", cloud.counts);
    }
}

/// Proves: silence, a restart, another configuration and a failure at the other end are told apart, each by name.
#[test]
fn what_goes_wrong_is_told_by_name() {
    let told = |result: Result<bool, String>, part: &str| {
        let reason = result.unwrap_err();
        assert!(reason.contains("\"right\"") && reason.contains(part), "{reason} lacks {part}");
    };
    let (mut peer, mut host) = (peer(), follower(200));
    told(peer.ready(0), "was not heard yet");
    let (mut down, mut up) = (Network::new([0; 4]), Network::new([0; 4]));
    exchange(MS, &mut peer, &mut host, 200, &mut down, &mut up);
    assert_eq!(peer.ready(MS), Ok(true));
    told(peer.ready(MS + SILENCE_NS + 1), "no sign of life");
    // The host comes back by itself, in a new process.
    let mut again = follower(300);
    let later = 3 * SILENCE_NS;
    exchange(later, &mut peer, &mut again, 300, &mut down, &mut up);
    assert_eq!(peer.ready(later), Ok(true));
    peer.begin(1);
    assert!(!peer.has_begun(later) && !peer.is_acquired(later).unwrap());
    exchange(later, &mut peer, &mut again, 300, &mut down, &mut up);
    assert_eq!(again.wanted(later), Some(1));
    again.begin(1);
    again.failed();
    exchange(later, &mut peer, &mut again, 300, &mut down, &mut up);
    told(peer.is_acquired(later), "ended the cycle");
    // It dies in the middle of the next cycle and is there again before anybody asked.
    peer.begin(2);
    let mut third = follower(400);
    let later = 5 * SILENCE_NS;
    exchange(later, &mut peer, &mut third, 400, &mut down, &mut up);
    told(peer.is_acquired(later), "was started again");
    // Another configuration.
    let mut other = identity("right");
    other.files[0][1] = "cd".into();
    let mut stranger = Follower::new(other, 500, SILENCE_NS);
    let later = 7 * SILENCE_NS;
    exchange(later, &mut peer, &mut stranger, 500, &mut down, &mut up);
    told(peer.ready(later), "cell.toml is another file");
    peer.begin(3);
    exchange(later, &mut peer, &mut stranger, 500, &mut down, &mut up);
    assert_eq!(stranger.wanted(later), None, "nor does the other host begin");
}

/// Proves: of two hosts of one name, and of two leaders, the second is refused by name; the first goes on.
/// Proves: a host whose leader was lost is not counted on by the next run that leads, which makes it begin anew; by one that only was
/// silent it is, as soon as both hear each other.
#[test]
fn a_host_that_will_begin_anew_is_not_ready() {
    let clean = || (Network::new([0; 4]), Network::new([0; 4]));
    let (mut first, mut host) = (peer(), follower(200));
    let (mut down, mut up) = clean();
    for now in 0..3 {
        exchange(now * 10 * MS, &mut first, &mut host, 200, &mut down, &mut up);
    }
    assert_eq!(first.ready(30 * MS), Ok(true));
    let lost = 30 * MS + 2 * SILENCE_NS;
    let (to, state) = host.tell(lost);
    assert_eq!((to, state.phase), (0, Phase::Starting));
    // The same run is heard again.
    for step in 0..3 {
        exchange(lost + step * 10 * MS, &mut first, &mut host, 200, &mut down, &mut up);
    }
    assert_eq!(first.ready(lost + 30 * MS), Ok(true));
    // Another run.
    let lost = lost + 3 * SILENCE_NS;
    let mut next =
        Peer::new("right", identity("left"), 300, BTreeMap::from([(1, 1 << 30)]), POINT, SILENCE_NS);
    let (to, state) = host.tell(lost);
    next.hear(lost, &Link { sequence: 9000, ..header(200, to) }, &json(&state));
    assert_eq!(next.ready(lost), Ok(false), "it would begin anew in the first cycle");
    let (to, state) = next.tell();
    host.hear(lost, &Link { sequence: 9000, ..header(300, to) }, &json(&state));
    assert!(host.must_renew());
    assert_eq!(host.tell(lost).1.phase, Phase::Starting);
}

#[test]
fn the_second_of_a_name_and_the_second_leader_are_refused() {
    let mut peer = peer();
    let (mut first, mut second) = (follower(200), follower(300));
    let mut other_leader =
        Peer::new("right", identity("left"), 101, BTreeMap::from([(1, 1)]), POINT, SILENCE_NS);
    let mut networks: Vec<Network> = (0..6).map(|_| Network::new([0; 4])).collect();
    let mut now = 0;
    for _ in 0..300 {
        now += 10 * MS;
        let [a, b, c, d, e, f] = &mut networks[..] else { unreachable!() };
        exchange(now, &mut peer, &mut first, 200, a, b);
        exchange(now, &mut peer, &mut second, 300, c, d);
        let (to, state) = other_leader.tell();
        for (header, payload) in e.carry(header(101, to), &json(&state)) {
            first.hear(now, &header, &payload);
        }
        if let Some((to, state)) = first.refusal(now) {
            for (header, payload) in f.carry(header(200, to), &json(&state)) {
                other_leader.hear(now, &header, &payload);
            }
        }
        if let Some((to, state)) = peer.refusal(now) {
            assert_eq!(to, 300);
            for (header, payload) in e.carry(header(100, to), &json(&state)) {
                second.hear(now, &header, &payload);
            }
        }
    }
    assert_eq!(peer.ready(now), Ok(true));
    assert!(first.refused().is_none() && second.refused().unwrap().contains("\"right\""));
    assert!(other_leader.ready(now).unwrap_err().contains("led by another supervisor"));
    assert!(!first.must_renew());
    // The first leader goes; the second one takes over, and the host begins anew.
    now += 2 * SILENCE_NS;
    let (to, state) = other_leader.tell();
    let message = Link { sequence: 9999, ..header(101, to) };
    first.hear(now, &message, &json(&state));
    assert!(first.must_renew());
}

/// Proves: what a stranger sends, by chance or by design, changes nothing, and is counted.
#[test]
fn messages_that_do_not_belong_here_change_nothing() {
    let (mut peer, mut host) = (peer(), follower(200));
    let (mut down, mut up) = (Network::new([0; 4]), Network::new([0; 4]));
    exchange(MS, &mut peer, &mut host, 200, &mut down, &mut up);
    peer.begin(1);
    let wild = [
        (Link { kind: 9, ..header(200, 0) }, b"{}".to_vec()),
        (header(200, 0), b"no json".to_vec()),
        (header(200, 0), json(&HostState { identity: identity("middle"), ..HostState::default() })),
        (
            Link { kind: LinkKind::Chunk as u32, cycle: 77, chunk: u32::MAX, pair: 5, ..header(999, 0) },
            vec![1],
        ),
    ];
    for (header, payload) in &wild {
        peer.hear(MS, header, payload);
        host.hear(MS, header, payload);
    }
    assert_eq!(peer.counts.strange, wild.len() as u64);
    assert_eq!((peer.ready(MS), peer.is_acquired(MS)), (Ok(true), Ok(false)));
    // A host that offers more than its pair can have.
    exchange(2 * MS, &mut peer, &mut host, 200, &mut down, &mut up);
    host.begin(1);
    host.matched(vec![(1, 3, vec![0; 10])]);
    exchange(3 * MS, &mut peer, &mut host, 200, &mut down, &mut up);
    assert!(peer.is_acquired(3 * MS).unwrap_err().contains("offers a cloud of 10 bytes"));
}
