//! Jobs and their results: each one comes once, with its part, whatever becomes of the gateway.

use super::client::Client;
use super::{Line, MARKUP, gateway};
use crate::page::load::{processor_ms, viewed_beside};
use serde_json::{Value, json as value};
use std::collections::BTreeMap;

const AUTOMATIC: &str = "VisionStateMachine/AutomaticModeStateMachine";

/// Number of the type of the events of results.
const RESULT_READY: u64 = 1024;

fn id(kind: &str, id: &str) -> Value {
    value!({"type": kind, "value": {"Id": id}})
}

/// Starts a job for a part as soon as the cell is ready.
fn start(client: &mut Client, part: &str, recipe: &str) -> String {
    let arguments = value!([
        id("MeasIdDataType", &format!("meas of {part}")),
        id("PartIdDataType", part),
        id("RecipeIdExternalDataType", recipe),
        id("ProductIdDataType", "product"),
        {"type": "Variants", "value": []}
    ]);
    loop {
        let (status, outputs) = client.call(AUTOMATIC, "StartSingleJob", &arguments);
        if status == "Good" {
            assert_eq!(outputs[1], 0, "{outputs}");
            return outputs[0]["Id"].as_str().unwrap().to_owned();
        }
        assert_eq!(status, "BadInvalidState");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

/// The events of results among those that came, until there are so many of them.
fn results(client: &mut Client, count: usize) -> Vec<Value> {
    let mut all = Vec::new();
    while all.len() < count {
        let events = client.ask("take", &value!({"count": 1}));
        let events = events.as_array().unwrap();
        assert!(!events.is_empty(), "{} of {count} results came", all.len());
        all.extend(events.iter().filter(|event| event["ResultId"]["Id"].is_string()).cloned());
    }
    all
}

/// Proves: a job gives one event with all that the client called it, and the result can be asked for in three ways.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn a_result_comes_as_event_and_is_found_by_its_identification() {
    let line = Line::new("opcresult", 0.0, "");
    let mut client = line.client();
    client.ask("subscribe", &value!({"types": [RESULT_READY]}));
    let job = start(&mut client, "<i>4711</i>", MARKUP);
    let event = results(&mut client, 1).remove(0);
    assert_eq!(
        (&event["JobId"]["Id"], &event["PartId"]["Id"]),
        (&job.as_str().into(), &"<i>4711</i>".into())
    );
    assert_eq!(
        (&event["MeasId"]["Id"], &event["ProductId"]["Id"]),
        (&"meas of <i>4711</i>".into(), &"product".into())
    );
    assert_eq!((&event["InternalRecipeId"]["Id"], &event["ResultState"]), (&MARKUP.into(), &1.into()));
    let content = event["ResultContent"].as_array().unwrap();
    assert_eq!(content[..2], ["fail".into(), Value::from("ok")]);
    let told: Value = serde_json::from_str(content[2].as_str().unwrap()).unwrap();
    let written = crate::running::json(&line.cell.out().join("result.json"));
    for key in ["part", "recipe", "verdict", "features", "hashes", "number", "date"] {
        assert_eq!(told[key], written[key], "{key}");
    }
    let result_id = event["ResultId"]["Id"].as_str().unwrap();
    let ask = value!([id("ResultIdDataType", result_id), {"type": "Int32", "value": 0}]);
    let (_, by_id) = client.call("ResultManagement", "GetResultById", &ask);
    assert_eq!((&by_id[1]["ResultContent"], &by_id[2]), (&event["ResultContent"], &0.into()));
    let (_, parts) = client.call("ResultManagement", "GetResultComponentsById", &ask);
    assert_eq!(
        (&parts[6]["Id"], &parts[15], &parts[16]),
        (&"<i>4711</i>".into(), &event["ResultContent"], &0.into())
    );
    let node = client.ask("read", &value!({"path": format!("ResultManagement/Results/{result_id}/PartId")}));
    assert_eq!(node["value"]["Id"], "<i>4711</i>");
    let listed = |client: &mut Client, part: &str| {
        let number = |kind: &str| value!({"type": kind, "value": 0});
        let arguments = value!([
            number("Int32"),
            null,
            id("PartIdDataType", part),
            null,
            null,
            null,
            null,
            null,
            null,
            number("UInt32"),
            number("UInt32"),
            number("Int32")
        ]);
        let (status, outputs) = client.call("ResultManagement", "GetResultListFiltered", &arguments);
        assert_eq!(status, "Good");
        outputs[1].as_u64().unwrap()
    };
    assert_eq!(
        [listed(&mut client, "<i>4711</i>"), listed(&mut client, "other"), listed(&mut client, "")],
        [1, 0, 1]
    );
    let handle = value!([{"type": "UInt32", "value": by_id[0]}]);
    assert_eq!(client.call("ResultManagement", "ReleaseResultHandle", &handle).1, value!([0]));
    assert_eq!(client.call("ResultManagement", "ReleaseResultHandle", &handle).1, value!([8]));
    line.stop();
}

/// So many jobs give as many events of results, each with its part and its job.
fn as_many_results_as_jobs(count: usize, queue: u64) {
    let line = Line::new(&format!("opcjobs{count}"), 0.0, "");
    line.cell.until("ready", |status| status["state"] == "Ready");
    let mut client = line.client();
    let mut listener = line.client();
    listener.ask("subscribe", &value!({"types": [RESULT_READY], "queue": queue}));
    let jobs: BTreeMap<String, String> = (0..count)
        .map(|number| {
            let part = format!("part {number}");
            (start(&mut client, &part, "pass"), part)
        })
        .collect();
    assert_eq!(jobs.len(), count);
    let events = results(&mut listener, count);
    assert_eq!(events.len(), count);
    let told: BTreeMap<String, String> = events
        .iter()
        .map(|event| {
            let text = |key: &str| event[key]["Id"].as_str().unwrap().to_owned();
            (text("JobId"), text("PartId"))
        })
        .collect();
    assert_eq!(told, jobs);
    line.stop();
}

#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn twenty_jobs_give_twenty_results_with_their_parts() {
    as_many_results_as_jobs(20, 0);
}

#[test]
#[ignore = "minutes, the short form always runs: cargo test --features opcua --test main a_thousand_jobs -- --ignored"]
fn a_thousand_jobs_give_a_thousand_results_with_their_parts() {
    as_many_results_as_jobs(1000, 100);
}

/// Proves: a gateway that is killed during a job loses neither that result nor those of jobs that nobody heard of; the next gateway
/// tells them with what their clients called them.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn a_gateway_that_is_killed_during_a_job_loses_no_result() {
    let mut line = Line::new("opckill", 20.0, "");
    let mut client = line.client();
    client.ask("subscribe", &value!({"types": [RESULT_READY]}));
    let first = start(&mut client, "first", "pass");
    assert_eq!(results(&mut client, 1)[0]["JobId"]["Id"], first.as_str());
    let second = start(&mut client, "second", "pass");
    // What a client called its job is written with the next delivery.
    std::thread::sleep(std::time::Duration::from_millis(300));
    line.gateway.kill().unwrap();
    line.gateway.wait().unwrap();
    line.cell.until("done", |status| status["cycles_done"] == 2 && status["state"] == "Ready");
    line.ask(&value!({"command": "inspect", "part": "third"}));
    line.replace_gateway();
    client.ask("new", &value!({}));
    client.open(line.address);
    client.ask("subscribe", &value!({"types": [RESULT_READY]}));
    let events = results(&mut client, 2);
    let text = |event: &Value, key: &str| event[key]["Id"].as_str().unwrap_or_default().to_owned();
    // The first may come twice: it was not yet certain that the client had it.
    let events: Vec<&Value> = events.iter().filter(|event| text(event, "PartId") != "first").collect();
    let mut parts: Vec<String> = events.iter().map(|event| text(event, "PartId")).collect();
    if parts.len() < 2 {
        parts.extend(results(&mut client, 1).iter().map(|event| text(event, "PartId")));
    }
    assert_eq!(parts, ["second", "third"]);
    assert_eq!(text(events[0], "JobId"), second);
    assert_eq!(text(events[0], "MeasId"), "meas of second");
    line.stop();
}

/// Proves: events that nobody listened to come to the first who does.
#[test]
#[cfg_attr(
    not(asyncua),
    ignore = "needs asyncua: pip install asyncua==2.1.0, then cargo test --features opcua --test main opcua"
)]
fn events_wait_for_a_client() {
    let line = Line::new("opcwait", 0.0, "");
    let mut client = line.client();
    start(&mut client, "unheard", "pass");
    line.cell.until("done", |status| status["cycles_done"] == 1);
    client.ask("subscribe", &value!({"types": [RESULT_READY]}));
    assert_eq!(results(&mut client, 1)[0]["PartId"]["Id"], "unheard");
    line.stop();
}

/// Proves: ten viewers of the page and a client of the gateway change no byte of any cycle, and the client hears of each.
fn viewed_by_a_machine_too(cycles: usize) {
    let (mut client, mut gateway) = viewed_beside(cycles, "opcviewed", |page| {
        let (gateway, address) = gateway(&page.cell, &["--address", "127.0.0.1:0"]);
        let mut client = Client::connect(address);
        client.ask("subscribe", &value!({"types": [RESULT_READY], "queue": 100}));
        client.ask("watch", &value!({"paths": ["SystemState", "VisionStateMachine/CurrentState"]}));
        (client, gateway)
    });
    let seen = client.ask("take", &value!({"count": 0}));
    let results = seen.as_array().unwrap().iter().filter(|event| event["ResultId"]["Id"].is_string()).count();
    // The gateway came when the first cycles were over, and the cell ended with the last.
    assert!(results + 20 > cycles, "{results} of {cycles}");
    gateway.kill().unwrap();
    gateway.wait().unwrap();
}

#[test]
#[ignore = "minutes: cargo test --features opcua --test main ten_viewers -- --ignored"]
fn ten_viewers_and_a_machine_change_no_byte_of_500_cycles() {
    viewed_by_a_machine_too(500);
}

/// Prints the processor time of the gateway, without and with a client, idle and per job.
#[test]
#[ignore = "prints figures for docs/opcua.md: cargo test --features opcua --test main processor_time_of_the_gateway -- --ignored --nocapture"]
fn processor_time_of_the_gateway() {
    const JOBS: u32 = 30;
    for clients in [0, 1, 5] {
        let line = Line::new(&format!("opccpu{clients}"), 0.0, "");
        let mut listening: Vec<Client> = (0..clients).map(|_| line.client()).collect();
        for client in &mut listening {
            client.ask("subscribe", &value!({}));
            client.ask("watch", &value!({"paths": ["SystemState", "VisionStateMachine/CurrentState"]}));
        }
        let pid = line.gateway.id().into();
        std::thread::sleep(std::time::Duration::from_secs(1));
        let before = processor_ms(pid);
        std::thread::sleep(std::time::Duration::from_secs(20));
        let idle = (processor_ms(pid) - before) / 20.0;
        let before = processor_ms(pid);
        for job in 0..JOBS {
            line.ask(&value!({"command": "inspect", "part": job.to_string()}));
        }
        let jobs = (processor_ms(pid) - before) / f64::from(JOBS);
        println!("{clients} clients: idle {idle:.1} ms a second, {jobs:.1} ms a job");
        line.stop();
    }
}
