//! What needs no client: refused options, and bytes that are no OPC UA.

use super::{Line, gateway, recipes};
use crate::running::{Cell, text};
use serde_json::json as value;
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::process::Command;
use std::time::Duration;

/// Proves: an address that other machines can reach is refused without protection, and a file of users is checked, each with the remedy.
#[test]
fn unsafe_options_are_refused_with_the_remedy() {
    use std::os::unix::fs::PermissionsExt as _;
    let cell = recipes(Cell::played("opcrefused", 0.0, ""));
    let config = cell.small.path("played.toml");
    let users = cell.small.path("users");
    std::fs::write(&users, "operator\n").unwrap();
    let pki = cell.small.path("pki");
    let try_with = |arguments: &[&str], expected: &str| {
        let mut program = Command::new(env!("CARGO_BIN_EXE_fringecell"));
        let output = program.args(["opcua", &config]).args(arguments).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(text(&output.stderr).contains(expected), "{arguments:?}: {}", text(&output.stderr));
    };
    try_with(&["--address", "0.0.0.0:0"], "add --pki DIR, or use 127.0.0.1");
    try_with(&["--address", "0.0.0.0:0", "--pki", &pki], "add --users FILE or --allow-anonymous");
    try_with(&["--users", &users], "chmod 600");
    std::fs::set_permissions(&users, std::fs::Permissions::from_mode(0o600)).unwrap();
    try_with(&["--users", &users], "users:1: a line has a name and a password");
    std::fs::write(&users, "\n").unwrap();
    try_with(&["--users", &users], "no user is in this file");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    try_with(&["--address", &address], "cannot listen on this address");
}

/// Proves: bytes that are no message, messages that promise too much, and silent connections end with their connection; the cell and the
/// gateway go on.
#[test]
fn bytes_that_are_no_message_end_their_connection_only() {
    let mut line = Line::new("opcbytes", 0.0, "");
    let mut hello = b"HELF".to_vec();
    hello.extend(u32::MAX.to_le_bytes());
    let mut open = b"OPNF".to_vec();
    open.extend(64_u32.to_le_bytes());
    open.extend([0xff; 56]);
    for bytes in [&b"GET / HTTP/1.1\r\n\r\n"[..], &[0; 4096], &vec![0xff; 100_000], &hello, &open, b"HELF"] {
        let mut stream = TcpStream::connect(line.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        // The gateway may close before all of it is written.
        let _ = stream.write_all(bytes);
        let mut answer = Vec::new();
        let ended = stream.read_to_end(&mut answer);
        assert!(ended.is_ok() || answer.len() < 1000, "{ended:?}");
    }
    let silent: Vec<TcpStream> = (0..200).map(|_| TcpStream::connect(line.address).unwrap()).collect();
    let inspected = line.ask(&value!({"command": "inspect", "part": "meanwhile"}));
    assert_eq!(inspected["inspected"]["outcome"], "ok");
    assert!(line.gateway.try_wait().unwrap().is_none(), "the gateway lives");
    drop(silent);
    line.stop();
}

/// Proves: a gateway ends by a termination signal, in good order.
#[test]
fn a_gateway_ends_when_it_is_asked_to() {
    let cell = recipes(Cell::played("opcend", 0.0, ""));
    let (gateway, _) = gateway(&cell, &["--address", "127.0.0.1:0"]);
    crate::running::signal("TERM", gateway.id().into());
    assert_eq!(crate::running::wait(gateway).status.code(), Some(0));
}
