//! Drives the client, a program in Python.

use crate::running::PATIENCE;
use serde_json::{Value, json as value};
use std::io::{BufRead as _, BufReader, Write as _};
use std::net::SocketAddr;
use std::process::{Child, ChildStdout, Command, Stdio};

/// A running client program in Python.
pub struct Client {
    child: Child,
    answers: BufReader<ChildStdout>,
    /// Index of the namespace of the specification.
    pub standard: u64,
}

impl Client {
    /// Without a connection yet.
    pub fn new() -> Self {
        let script = crate::support::root().join("tests/opcua/client.py");
        let mut program = Command::new("python");
        let mut child = program
            .arg(script)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python with asyncua");
        let answers = BufReader::new(child.stdout.take().unwrap());
        Self { child, answers, standard: 0 }
    }

    /// Connected without a user.
    pub fn connect(address: SocketAddr) -> Self {
        let mut client = Self::new();
        client.open(address);
        client
    }

    /// Connects, once more if need be.
    pub fn open(&mut self, address: SocketAddr) {
        let told = self.ask("connect", &value!({"url": format!("opc.tcp://{address}/")}));
        self.standard = told["standard"].as_u64().unwrap();
    }

    /// What the client says, or its error.
    pub fn try_ask(&mut self, what: &str, with: &Value) -> Result<Value, String> {
        let request = value!({"do": what, "with": with});
        writeln!(self.child.stdin.as_mut().unwrap(), "{request}").unwrap();
        let mut line = String::new();
        self.answers.read_line(&mut line).unwrap();
        let mut answer: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"));
        match answer.get("error") {
            Some(error) => Err(error.as_str().unwrap().to_owned()),
            None => Ok(answer["ok"].take()),
        }
    }

    pub fn ask(&mut self, what: &str, with: &Value) -> Value {
        self.try_ask(what, with).unwrap_or_else(|error| panic!("{what} {with}: {error}"))
    }

    /// Calls a method; returns status and outputs.
    pub fn call(&mut self, object: &str, method: &str, arguments: &Value) -> (String, Value) {
        let mut answer = self.ask("call", &value!({"object": object, "method": method, "args": arguments}));
        (answer["status"].as_str().unwrap().to_owned(), answer["outputs"].take())
    }

    /// Waits until the gateway shows a state of the cell.
    pub fn shows(&mut self, state: &str) {
        let begin = std::time::Instant::now();
        let path = match state {
            "Preoperational" | "Halted" | "Error" => "VisionStateMachine/CurrentState",
            _ => "VisionStateMachine/AutomaticModeStateMachine/CurrentState",
        };
        loop {
            let shown = self.ask("read", &value!({"path": path}));
            if shown["value"] == state {
                return;
            }
            assert!(begin.elapsed() < PATIENCE, "the gateway never showed {state}: {shown}");
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
