//! Frames over the network: the bytes are those of the twin, and what is lost for good is told.

use super::{cell, hashes, network, run, serve};
use std::net::{Ipv4Addr, UdpSocket};
use std::time::Duration;

#[test]
fn a_cell_of_cameras_on_the_network_gives_the_bytes_of_the_twin() {
    let (folder, simulated, live) = cell(1);
    let twin = run(folder.path(), &simulated, "twin", "2");
    assert!(twin.status.success(), "{}", String::from_utf8_lossy(&twin.stderr));
    let served = serve(&simulated, 1, &["drop=11", "duplicate=13", "swap=7"]);
    let ran = run(folder.path(), &live, "net", "2");
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    drop(served);
    let cloud = |out: &str| std::fs::read(folder.path().join(out).join("cloud.ply")).unwrap();
    // The headers hold dates and configurations: the points are behind them.
    let points = |bytes: Vec<u8>| {
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        bytes[end..].to_vec()
    };
    let (a, b) = (points(cloud("twin")), points(cloud("net")));
    assert!(a.len() > 1000 && a == b, "{} and {} bytes", a.len(), b.len());
    assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "net"));
}

#[test]
fn packets_and_triggers_that_are_lost_for_good_end_the_cycle_with_their_reason() {
    for (test, faults, reason) in [
        (2, vec!["drop=11", "no-resend"], "is not complete"),
        (3, vec!["ignore-trigger=9"], "no frame within"),
    ] {
        let (folder, simulated, live) = cell(test);
        let served = serve(&simulated, test, &faults);
        let ran = run(folder.path(), &live, "net", "1");
        drop(served);
        let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
        assert_eq!(ran.status.code(), Some(1), "{faults:?}: {text}");
        assert!(text.contains(reason), "{faults:?}: {text}");
    }
}

#[test]
fn a_camera_that_is_not_there_is_named() {
    let (folder, _, live) = cell(4);
    let ran = run(folder.path(), &live, "net", "1");
    let text = String::from_utf8_lossy(&ran.stdout).into_owned() + &String::from_utf8_lossy(&ran.stderr);
    assert!(!ran.status.success(), "{text}");
    let [a, b, c] = network(4);
    assert!(text.contains(&format!("{a}.{b}.{c}.1")), "{text}");
}

/// A client that only knows the standard: discovery, the description, and the refusal to serve two masters.
#[test]
fn a_device_answers_a_plain_client_as_the_standard_says() {
    let (_folder, simulated, _) = cell(5);
    let _served = serve(&simulated, 5, &[]);
    let [a, b, c] = network(5);
    let device = (Ipv4Addr::new(a, b, c, 11), 3956);
    let client = || {
        let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        socket.connect(device).unwrap();
        socket
    };
    let ask = |socket: &UdpSocket, request: &[u8]| {
        socket.send(request).unwrap();
        let mut answer = [0; 600];
        let length = socket.recv(&mut answer).unwrap();
        answer[..length].to_vec()
    };
    let first = client();
    let discovery = ask(&first, &[0x42, 0x11, 0, 2, 0, 0, 0xff, 0xff]);
    assert_eq!((discovery.len(), &discovery[..4]), (8 + 248, &[0, 0, 0, 3][..]));
    assert!(discovery[8 + 0xd8..].starts_with(b"TWIN-0001"));
    assert!(discovery[8 + 0xe8..].starts_with(b"cam1"));

    let url = ask(&first, &[0x42, 1, 0, 0x84, 0, 8, 0, 1, 0, 0, 2, 0, 0, 0, 0, 64]);
    let url = String::from_utf8_lossy(&url[12..]).trim_end_matches('\0').to_owned();
    assert!(url.starts_with("Local:twin.xml;10000;"), "{url}");

    let take = [0x42, 1, 0, 0x82, 0, 8, 0, 2, 0, 0, 0x0a, 0, 0, 0, 0, 2];
    assert_eq!(ask(&first, &take)[..4], [0, 0, 0, 0x83]);
    let second = client();
    assert_eq!(ask(&second, &take)[..4], [0x80, 6, 0, 0x83], "access denied");
    let payload = [0x42, 1, 0, 0x82, 0, 8, 0, 3, 0, 0, 0xa0, 0x0c, 0, 0, 0, 5];
    assert_eq!(ask(&first, &payload)[..4], [0x80, 4, 0, 0x83], "write protected");
    let width = [0x42, 1, 0, 0x82, 0, 8, 0, 7, 0, 0, 0xa0, 0, 0, 0, 0, 5];
    assert_eq!(ask(&first, &width)[..4], [0x80, 2, 0, 0x83], "not in its steps");
    let odd = [0x42, 1, 0, 0x80, 0, 4, 0, 4, 0, 0, 0, 1];
    assert_eq!(ask(&first, &odd)[..2], [0x80, 5], "alignment");
    let beyond = [0x42, 1, 0, 0x80, 0, 4, 0, 5, 0xff, 0xff, 0xff, 0xfc];
    assert_eq!(ask(&first, &beyond)[..2], [0x80, 3], "address");
    let unknown = [0x42, 1, 1, 0, 0, 0, 0, 6];
    assert_eq!(ask(&first, &unknown)[..2], [0x80, 1], "not implemented");
}
