//! A cell that takes jobs: states, recipes, refusals, metrics. Through the real binary and its socket.

use crate::running::{Cell, json, text, wait};
use serde_json::{Value, json as value};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::process::{Child, Command, Output};
use std::time::Duration;

const PLAN: &str = "format = \"fringecell-plan/1\"\nname = \"part of these tests\"\n";

/// A running cell with two recipes beside the default one; it has no plan at the top, so the first one is its default.
struct Served {
    cell: Cell,
    run: Child,
}

impl Served {
    fn new(name: &str, more: &[&str]) -> Self {
        let cell = Cell::played(name, 0.0, "");
        let (pass, fail) = (cell.small.path("pass.plan.toml"), cell.small.path("fail.plan.toml"));
        std::fs::write(pass, plan(0.0, 400.0)).unwrap();
        std::fs::write(fail, plan(0.0, 0.5)).unwrap();
        cell.small.edit(
            "played.toml",
            "[limits]\n",
            "[[recipe]]\nname = \"pass\"\nplan = \"pass.plan.toml\"\n[[recipe]]\nname = \"fail\"\nplan = \"fail.plan.toml\"\n[limits]\n",
        );
        let mut arguments = vec!["--serve"];
        arguments.extend(more);
        let run = cell.program("played.toml", &arguments).spawn().unwrap();
        cell.until("ready", |status| status["state"] == "Ready");
        Self { cell, run }
    }

    fn connect(&self) -> UnixStream {
        let stream = UnixStream::connect(ipc::cell::CellName::new(&self.cell.name).unwrap().socket()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream
    }

    fn ask(&self, request: &Value) -> Value {
        exchange(&self.connect(), &format!("{request}\n"))
    }

    fn trigger(&self, arguments: &[&str]) -> Output {
        let program = env!("CARGO_BIN_EXE_fringecell");
        Command::new(program).args(["trigger", &self.cell.name]).args(arguments).output().unwrap()
    }

    fn stop(self) -> Output {
        self.ask(&value!({"command": "stop"}));
        wait(self.run)
    }
}

fn exchange(mut stream: &UnixStream, line: &str) -> Value {
    stream.write_all(line.as_bytes()).unwrap();
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).unwrap();
    serde_json::from_str(&answer).unwrap_or_else(|e| panic!("{e}: {answer:?}"))
}
