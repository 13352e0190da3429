//! The live page over HTTP, through the real binaries: what it serves, what it refuses, and that nothing of it costs a cycle.

mod browser;
mod chromium;
mod http;
pub mod load;
mod security;

use crate::control::plan;
use crate::running::{Cell, children, json, wait};
use http::{Answer, get, post};
use serde_json::{Value, json as value};
use std::io::{BufRead as _, BufReader};
use std::net::SocketAddr;
use std::process::Child;

/// Markup for every name that a person or a configuration gives.
pub const MARKUP: &str = "<img src=x onerror=alert(1)>";

/// A cell with a page.
pub struct Page {
    pub cell: Cell,
    pub run: Child,
    pub address: SocketAddr,
}

impl Page {
    /// A serving cell with the recipes `pass` and [`MARKUP`], whose features have markup in their names.
    pub fn serving(name: &str, more: &[&str]) -> Self {
        let cell = Cell::played(name, 0.0, "");
        let passing = plan(-50.0, 50.0);
        std::fs::write(cell.small.path("pass.plan.toml"), &passing).unwrap();
        let marked = passing.replace("name = \"sphere1_diameter\"", &format!("name = \"{MARKUP}\""));
        assert_ne!(marked, passing);
        std::fs::write(cell.small.path("marked.plan.toml"), marked).unwrap();
        let recipes = format!(
            "[[recipe]]\nname = \"pass\"\nplan = \"pass.plan.toml\"\n[[recipe]]\nname = \"{MARKUP}\"\nplan = \
             \"marked.plan.toml\"\n[limits]\n"
        );
        cell.small.edit("played.toml", "[limits]\n", &recipes);
        Self::start(cell, &[&["--serve"], more].concat())
    }

    /// Any run of a played cell.
    pub fn start(cell: Cell, more: &[&str]) -> Self {
        let mut run =
            cell.program("played.toml", &[&["--page", "127.0.0.1:0"], more].concat()).spawn().unwrap();
        let address = address(&mut run, "page at http://");
        Self { cell, run, address }
    }

    pub fn ready(self) -> Self {
        self.cell.until("ready", |status| status["state"] == "Ready");
        self.until("served", |page| page.get("/api/state").json()["state"]["state"] == "Ready");
        self
    }

    pub fn get(&self, path: &str) -> Answer {
        get(self.address, path)
    }

    pub fn command(&self, request: &Value) -> Answer {
        post(self.address, "/api/command", &request.to_string(), "")
    }

    pub fn until(&self, what: &str, test: impl Fn(&Self) -> bool) {
        let begin = std::time::Instant::now();
        while !test(self) {
            assert!(begin.elapsed() < crate::running::PATIENCE, "never {what}");
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }

    /// Process id of the monitor.
    pub fn monitor(&self) -> Option<u64> {
        let is_monitor = |pid: &u64| {
            let line = std::fs::read(format!("/proc/{pid}/cmdline")).unwrap_or_default();
            line.split(|b| *b == 0).nth(1) == Some(b"monitor")
        };
        children(self.run.id()).into_iter().find(is_monitor)
    }

    pub fn stop(self) -> std::process::Output {
        let name = self.cell.name.clone();
        let stopped =
            std::process::Command::new(env!("CARGO_BIN_EXE_fringecell")).args(["stop", &name]).output();
        assert!(stopped.unwrap().status.success());
        wait(self.run)
    }
}

/// The address that the first line of a run names.
pub fn address(run: &mut Child, before: &str) -> SocketAddr {
    let mut line = String::new();
    BufReader::new(run.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    let rest = line.trim().strip_prefix(before).unwrap_or_else(|| panic!("{line:?}"));
    rest.split('/').next().unwrap().parse().unwrap()
}

/// Proves: a part that is asked for over the page is inspected, and everything about it is there.
#[test]
fn a_part_is_inspected_over_the_page_and_everything_about_it_is_served() {
    let page = Page::serving("live", &[]).ready();
    let events = http::Events::open(page.address);
    let answer = page.command(&value!({"command": "inspect", "part": MARKUP, "recipe": MARKUP}));
    assert_eq!(answer.status, 200, "{}", answer.text());
    let result = answer.json()["inspected"].clone();
    assert_eq!((&result["part"], &result["outcome"]), (&MARKUP.into(), &"ok".into()), "{result}");
    let ended = events.until("ended");
    assert_eq!(ended["brief"]["number"], 1);
    assert_eq!(ended["features"], result["features"]);
    assert_eq!(ended["places"].as_array().unwrap().len(), result["features"].as_array().unwrap().len());
    assert!(!ended["spans"].as_array().unwrap().is_empty());
    let scan = events.until("scan");
    shows_the_scan(&page, &scan, &result);
    let state = page.get("/api/state").json();
    assert_eq!(state["history"].as_array().unwrap().len(), 1);
    assert_eq!((&state["last"], &state["cell"]["demo"]), (&ended, &false.into()));
    assert_eq!(page.get("/api/result/1").json(), json(&page.cell.out().join("result.json")));
    let report = page.get("/report/1");
    assert!(report.text().contains("&lt;img src=x") && !report.text().contains(MARKUP));
    assert!(report.header("content-security-policy").unwrap().starts_with("sandbox"));
    assert_eq!(page.get("/report/2").status, 404);
    assert!(page.get("/metrics").text().contains("fringecell_cycles_total"));
    assert_eq!(page.get("/api/status").json()["cycles_done"], 1);
    page.stop();
}

/// Proves: pictures and cloud are those of the cycle, and an older one is not mistaken for them.
fn shows_the_scan(page: &Page, scan: &Value, result: &Value) {
    assert_eq!((&scan["cloud_number"], &scan["all_points"]), (&1.into(), &result["points"]), "{scan}");
    let cloud = page.get("/api/cloud/1");
    let points = usize::try_from(scan["points"].as_u64().unwrap()).unwrap();
    assert_eq!((cloud.status, cloud.body.len(), &cloud.body[..4]), (200, 40 + 24 * points, &b"FCC1"[..]));
    assert_eq!(cloud.body[4..8], (points as u32).to_le_bytes());
    for layer in ["grey", "modulation", "phase", "noise", "risk"] {
        let picture = page.get(&format!("/api/picture/1/0/0/{layer}"));
        assert_eq!((picture.status, &picture.body[1..4]), (200, &b"PNG"[..]), "{layer}");
        image::load_from_memory(&picture.body).unwrap();
    }
    for (path, status) in [
        ("/api/picture/1/9/0/grey", 404),
        ("/api/picture/1/0/0/secret", 404),
        ("/api/picture/2/0/0/grey", 410),
        ("/api/picture/1/a/0/grey", 400),
        ("/api/cloud/2", 410),
        ("/api/cloud/-1", 400),
    ] {
        assert_eq!(page.get(path).status, status, "{path}");
    }
}

/// Proves: every file that the page loads is there, and three.js is the packed one.
#[test]
fn the_files_of_the_page_are_part_of_the_program() {
    let page = Page::start(Cell::played("assets", 50.0, ""), &[]);
    for file in [
        "/",
        "/page.css",
        "/page.js",
        "/text.js",
        "/charts.js",
        "/cameras.js",
        "/cloud.js",
        "/icon.svg",
        "/three.LICENSE",
    ] {
        let answer = page.get(file);
        assert_eq!((answer.status, answer.body.is_empty()), (200, false), "{file}");
        assert!(!answer.text().contains("https://"), "{file} loads nothing from elsewhere");
        assert!(answer.header("content-security-policy").unwrap().contains("script-src 'self'"));
    }
    let three = page.get("/three.js");
    assert_eq!((three.header("content-encoding"), &three.body[..2]), (Some("gzip"), &[0x1f, 0x8b][..]));
    let state = page.get("/api/state").json();
    assert_eq!(state["cell"]["cell"], page.cell.name.as_str());
    page.stop();
}
