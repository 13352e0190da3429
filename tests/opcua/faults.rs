//! Wrong arguments, wrong nodes, two clients at once, a cell that comes and goes, users: explicit answers.

use super::client::Client;
use super::states::arguments;
use super::{Line, gateway, recipes};
use crate::running::{Cell, wait};
use serde_json::{Value, json as value};
use std::process::Stdio;

const AUTOMATIC: &str = "VisionStateMachine/AutomaticModeStateMachine";

fn int(number: i64) -> Value {
    value!({"type": "Int32", "value": number})
}

/// Proves: wrong numbers and types of arguments, unknown nodes and methods, and writes are refused, and the cell does not move.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn wrong_calls_are_refused_and_change_nothing() {
    let line = Line::new("opcwrong", 0.0, "");
    let mut client = line.client();
    let text = |text: &str| value!({"type": "String", "value": text});
    let part = value!({"type": "PartIdDataType", "value": {"Id": "x"}});
    for (object, method, arguments, expected) in [
        ("VisionStateMachine", "Halt", value!([]), "BadArgumentsMissing"),
        ("VisionStateMachine", "Halt", value!([int(0)]), "BadArgumentsMissing"),
        ("VisionStateMachine", "Halt", value!([int(0), text("x"), int(0)]), "BadTooManyArguments"),
        ("VisionStateMachine", "Halt", value!([text("x"), int(0)]), "BadInvalidArgument"),
        ("VisionStateMachine", "SelectModeAutomatic", value!([int(0)]), "BadTooManyArguments"),
        (AUTOMATIC, "StartSingleJob", value!([part, part, null, null, null]), "BadInvalidArgument"),
        (AUTOMATIC, "StartSingleJob", value!([null, int(4711), null, null, null]), "BadInvalidArgument"),
        ("VisionStateMachine", "Dance", value!([]), "BadMethodInvalid"),
        ("Server", "i=11492", value!([]), "BadArgumentsMissing"),
        ("ns=99;s=none", "ns=99;s=none", value!([]), "BadMethodInvalid"),
        ("VisionStateMachine", "ns=2;i=7094", value!([int(0), text("x")]), "BadMethodInvalid"),
        ("ResultManagement", "GetResultById", value!([part, int(0)]), "BadInvalidArgument"),
    ] {
        let answer = client.ask("call", &value!({"object": object, "method": method, "args": arguments}));
        let status = answer["status"].as_str().unwrap();
        // How the library words a call of a node that is not there is its own affair.
        let is_refused = status == expected || (expected == "BadMethodInvalid" && status.starts_with("Bad"));
        assert!(is_refused || object == "Server", "{object}/{method}: {answer}");
        assert_ne!(status, "Good", "{object}/{method}");
        if status == "BadInvalidArgument" && object != "Server" {
            let wrong = answer["arguments"].as_array().unwrap();
            assert!(wrong.contains(&"BadTypeMismatch".into()), "{answer}");
        }
    }
    let write =
        value!({"path": "VisionStateMachine/CurrentState", "value": {"type": "LocalizedText", "value": "x"}});
    assert!(client.try_ask("write", &write).is_err());
    let unknown = value!([{"type": "ResultIdDataType", "value": {"Id": "none"}}, int(0)]);
    assert_eq!(client.call("ResultManagement", "GetResultById", &unknown).1[2], 5);
    let parameters = value!([null, part, null, null, {"type": "Variants", "value": [1]}]);
    assert_eq!(client.call(AUTOMATIC, "StartSingleJob", &parameters).1[1], 6);
    let long = value!({"type": "PartIdDataType", "value": {"Id": "x".repeat(257)}});
    let (status, outputs) = client.call(AUTOMATIC, "StartSingleJob", &value!([null, long, null, null, null]));
    assert_eq!((status.as_str(), &outputs[1]), ("Good", &1.into()));
    let status = line.cell.status().unwrap();
    assert_eq!((&status["state"], &status["cycles_done"]), (&"Ready".into(), &0.into()));
    line.stop();
}

/// Proves: of two clients that press at once one starts its job, and the other hears that it is too late.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn of_two_clients_that_press_at_once_one_is_first() {
    let line = Line::new("opctwo", 8.0, "");
    let clients = [line.client(), line.client()];
    let barrier = std::sync::Arc::new(std::sync::Barrier::new(2));
    let pressing = clients.map(|mut client| {
        let barrier = std::sync::Arc::clone(&barrier);
        std::thread::spawn(move || {
            barrier.wait();
            client.call(AUTOMATIC, "StartSingleJob", &arguments("StartSingleJob")).0
        })
    });
    let mut answers = pressing.map(|thread| thread.join().unwrap());
    answers.sort();
    assert_eq!(answers, ["BadInvalidState", "Good"]);
    line.stop();
}

/// Proves: without the cell the gateway says so, finds the cell when it comes, and says so again when it has gone.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn a_gateway_waits_for_its_cell_and_outlives_it() {
    let cell = recipes(Cell::played("opcalone", 0.0, ""));
    let (gateway, address) = gateway(&cell, &["--address", "127.0.0.1:0"]);
    let mut line = Line { cell, run: None, gateway, address };
    let mut client = line.client();
    let absent = |client: &mut Client| {
        let state = client.ask("read", &value!({"path": "VisionStateMachine/CurrentState"}));
        assert_eq!(state["status"], "BadNoCommunication", "{state}");
        let (status, _) = client.call("VisionStateMachine", "Halt", &arguments("Halt"));
        assert_eq!(status, "BadNoCommunication");
    };
    absent(&mut client);
    line.run = Some(line.cell.program("played.toml", &["--serve"]).stdout(Stdio::null()).spawn().unwrap());
    client.shows("Ready");
    line.ask(&value!({"command": "stop"}));
    wait(line.run.take().unwrap());
    let begin = std::time::Instant::now();
    while client.ask("read", &value!({"path": "SystemState"}))["status"] == "Good" {
        assert!(begin.elapsed() < crate::running::PATIENCE);
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    absent(&mut client);
    line.stop();
}

/// A file with one user, `operator`, whose password is `secret`.
fn users_of(cell: &Cell) -> String {
    use std::os::unix::fs::PermissionsExt as _;
    let users = cell.small.path("users");
    std::fs::write(&users, "operator secret\n").unwrap();
    std::fs::set_permissions(&users, std::fs::Permissions::from_mode(0o600)).unwrap();
    users
}

/// Proves: with users nobody comes in without one.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn users_must_log_in() {
    let cell = recipes(Cell::played("opcusers", 0.0, ""));
    let users = users_of(&cell);
    let (gateway, address) = gateway(&cell, &["--address", "127.0.0.1:0", "--users", &users]);
    let line = Line { cell, run: None, gateway, address };
    let url = format!("opc.tcp://{address}/");
    let mut client = Client::new();
    for with in [value!({"url": url}), value!({"url": url, "user": "operator", "password": "guess"})] {
        let refused = client.try_ask("connect", &with).unwrap_err();
        assert!(refused.contains("Identity"), "{refused}");
        client.ask("new", &value!({}));
    }
    client.ask("connect", &value!({"url": url, "user": "operator", "password": "secret"}));
    assert_eq!(client.ask("read", &value!({"path": "SystemState"}))["status"], "BadNoCommunication");
    line.stop();
}

/// Proves: with certificates a client that is not trusted is refused and its certificate laid aside; once trusted, it comes in by every
/// policy, signed and encrypted, with its password only.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn clients_are_let_in_by_their_certificates() {
    let cell = recipes(Cell::played("opcsecret", 0.0, ""));
    let (users, pki) = (users_of(&cell), cell.small.path("pki"));
    let options = ["--address", "127.0.0.1:0", "--users", &users, "--pki", &pki];
    let (gateway, address) = gateway(&cell, &options);
    let line = Line { cell, run: None, gateway, address };
    let mut client = Client::new();
    let made = client.ask("certificate", &value!({"folder": line.cell.small.path("")}));
    let [certificate, key] = [0, 1].map(|n| made[n].as_str().unwrap().to_owned());
    let with = |policy: &str, mode: &str, password: &str| {
        let security = format!("{policy},{mode},{certificate},{key}");
        let url = format!("opc.tcp://{address}/");
        value!({"url": url, "user": "operator", "password": password, "security": security, "types": false})
    };
    let refused = client.try_ask("connect", &with("Basic256Sha256", "SignAndEncrypt", "secret")).unwrap_err();
    assert!(refused.contains("Certificate") || refused.contains("Security"), "{refused}");
    let folder = |name: &str| std::path::Path::new(&pki).join(name);
    let laid: Vec<_> =
        std::fs::read_dir(folder("rejected")).unwrap().map(|one| one.unwrap().path()).collect();
    assert_eq!(laid.len(), 1, "{laid:?}");
    std::fs::rename(&laid[0], folder("trusted").join(laid[0].file_name().unwrap())).unwrap();
    for policy in ["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"] {
        for mode in ["Sign", "SignAndEncrypt"] {
            client.ask("new", &value!({}));
            let refused = client.try_ask("connect", &with(policy, mode, "guess")).unwrap_err();
            assert!(refused.contains("Identity"), "{policy} {mode}: {refused}");
            client.ask("new", &value!({}));
            client.ask("connect", &with(policy, mode, "secret"));
            let state = client.ask("read", &value!({"path": "SystemState"}));
            assert_eq!(state["status"], "BadNoCommunication", "{policy} {mode}");
            client.ask("disconnect", &value!({}));
        }
    }
    line.stop();
}
