//! What is planned and refused of a cell on several hosts, without running one.

use super::{Cell, HOSTS};
use crate::running::json;
use crate::support::{SMALL_PX, fringecell_in};
use serde_json::Value;

/// A change of the configuration and a part of the message that has to follow.
type Fault = (&'static str, &'static str, &'static str);

/// Proves: a configuration whose hosts cannot work is refused with file, key and remedy.
#[test]
fn hosts_that_cannot_work_are_refused() {
    let cell = Cell::new("refused", 2, "");
    let good = std::fs::read_to_string(cell.path("cell.toml")).unwrap();
    let schedule = |more: &[&str]| {
        let config = cell.path("cell.toml").display().to_string();
        let mut words = vec!["schedule", &config];
        words.extend(more);
        fringecell_in(cell.folder.path(), &words)
    };
    assert_eq!(schedule(&[]).code, Some(0));
    let listen = good.lines().find(|line| line.starts_with("listen")).unwrap().to_owned();
    let faults: [Fault; 10] = [
        ("[[host]]\nname = \"right\"\npairs = [\"pair2\"]", "", "2 … 16 tables [[host]]"),
        ("pairs = [\"pair2\"]", "pairs = [\"pair2\", \"pair1\"]", "it belongs to host \"left\", too"),
        ("pairs = [\"pair2\"]", "pairs = [\"pair9\"]", "pair9"),
        ("pairs = [\"pair2\"]", "pairs = []", "a pair of host \"right\""),
        ("name = \"right\"", "name = \"left\"", "left"),
        ("name = \"right\"", "name = \"Right\"", "host[1].name"),
        ("name = \"right\"", "name = \"a-name-that-is-too-long-for-it\"", "shorten one of them"),
        ("name = \"right\"", "name = \"right\"\nlisten = \"127.0.0.1:9\"", "one host leads"),
        ("LISTEN", "", "`listen` of the host that leads"),
        ("LISTEN", "listen = \"0.0.0.0:7447\"", "an IP address and a port"),
    ];
    for (from, to, part) in faults {
        let from = if from == "LISTEN" { listen.as_str() } else { from };
        assert!(good.contains(from), "{from}");
        cell.write("cell.toml", &good.replacen(from, to, 1));
        let ran = schedule(&[]);
        assert_eq!(ran.code, Some(2), "{}", ran.stdout);
        let named = ran.stderr.contains(part) && ran.stderr.contains("cell.toml");
        assert!(named, "{}\nlacks {part}", ran.stderr);
    }
    // A camera of both hosts, and cycles in flight.
    let shared =
        good.replacen("cameras = [\"cam3\", \"cam4\"]", "cameras = [\"cam3\", \"cam4\", \"cam1\"]", 1);
    cell.write("cell.toml", &shared);
    let ran = schedule(&[]);
    assert!(ran.stderr.contains("projector \"proj2\" belongs to host"), "{}", ran.stderr);
    cell.write("cell.toml", &format!("{good}[schedule]\ncycles_in_flight = 2\n"));
    assert!(schedule(&[]).stderr.contains("1 in a cell with [[host]]"));
    cell.write("cell.toml", &good);
    let ran = schedule(&["--host", "middle"]);
    assert!(
        ran.stderr.contains("no host \"middle\"") && ran.stderr.contains("left, right"),
        "{}",
        ran.stderr
    );
    let config = cell.path("cell.toml").display().to_string();
    let run = |more: &[&str]| fringecell_in(cell.folder.path(), &[&["run", &config], more].concat());
    for refused in [
        &["--host", "right", "--serve"][..],
        &["--host", "right", "--cycles", "1"],
        &["--host", "left", "--record", "rec"],
    ] {
        let ran = run(refused);
        assert!(ran.code == Some(2) && ran.stderr.contains("leave it out"), "{}", ran.stderr);
    }
    if !ipc::link::IS_BUILT_IN {
        let ran = run(&["--host", "left"]);
        assert!(ran.code == Some(2) && ran.stderr.contains("--features hosts"), "{}", ran.stderr);
    }
}

/// Proves: the schedule of each host has its own cameras and pairs only, all of them together those of one computer.
#[test]
fn the_schedules_of_the_hosts_divide_that_of_one_computer() {
    let cell = Cell::new("divide", 3, "");
    let config = cell.path("cell.toml").display().to_string();
    let plan = |host: Option<&str>| {
        let mut words = vec!["schedule", &config, "--json", "plan.json"];
        words.extend(host.iter().flat_map(|host| ["--host", host]));
        let ran = fringecell_in(cell.folder.path(), &words);
        assert_eq!(ran.code, Some(0), "{}", ran.stderr);
        crate::schema::assert_valid("schedule", &cell.path("plan.json"));
        (json(&cell.path("plan.json")), ran.stdout)
    };
    let names = |plan: &Value, list: &str| -> Vec<String> {
        plan[list].as_array().unwrap().iter().map(|row| row["name"].as_str().unwrap().to_owned()).collect()
    };
    let (whole, said) = plan(None);
    assert!(said.contains("leads") && said.contains("1 Gbit/s"), "{said}");
    assert!(!names(&whole, "stages").contains(&"link".to_owned()));
    let mut stages: Vec<String> = Vec::new();
    for (number, host) in HOSTS.iter().enumerate() {
        let (plan, said) = plan(Some(host));
        assert!(said.contains("link to other hosts"), "{said}");
        let here = names(&plan, "stages");
        assert_eq!(here.contains(&"fusion".to_owned()), number == 0);
        assert_eq!(plan["hosts"][number]["here"], true);
        let topics = names(&plan, "topics");
        for camera in 1..=6 {
            let mine = (camera - 1) / 2 == number;
            assert_eq!(topics.contains(&format!("frame/cam{camera}")), mine, "{host}: frames stay");
        }
        stages.extend(here.into_iter().filter(|stage| stage != "link"));
    }
    stages.sort();
    stages.dedup();
    let mut expected = names(&whole, "stages");
    expected.sort();
    assert_eq!(stages, expected);
    let sent = |host: usize| whole["hosts"][host]["sent_bytes"].as_u64().unwrap();
    let pixels = u64::from(SMALL_PX.0) * u64::from(SMALL_PX.1);
    assert_eq!([sent(0), sent(1), sent(2)], [0, 56 * pixels, 56 * pixels]);
    // Two cameras, 13 frames of 8 bit.
    assert_eq!(whole["hosts"][1]["frame_bytes"], 2 * 13 * pixels);
}
