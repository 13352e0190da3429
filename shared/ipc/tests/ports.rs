//! Topics and notifications between nodes of one process: what arrives and what is refused. Times are not asserted.

use ipc::IpcError;
use ipc::cell::{CellLock, CellName};
use ipc::header::{Command, Control, Event, EventKind, Frame, MAX_TEXT_BYTES};
use ipc::long_text::{Joined, TextKey, parts};
use ipc::payload;
use ipc::port::{Node, ServiceHandle, TopicSize};
use std::time::Duration;

const PATIENCE: Duration = Duration::from_millis(20);
const LONG: Duration = Duration::from_secs(10);
/// Longer than any of these takes on a busy machine.
const WATCHDOG: Duration = Duration::from_secs(60);

struct Cell {
    // Dropped in this order: the services before the node, the node before the folder.
    _held: Vec<ServiceHandle>,
    node: Node,
    _lock: CellLock,
    name: CellName,
}

fn cell(name: &str) -> Cell {
    // As long as a name may be: the sockets below its folder must still fit.
    let name = CellName::new(&format!("{name:x<20}-{:011}", std::process::id())).unwrap();
    let lock = CellLock::take(&name).unwrap();
    let node = Node::join(&name, "supervisor").unwrap();
    let size = TopicSize { publishers: 2, subscribers: 2, buffer: 3, borrowed: 1 };
    let held = vec![
        node.create_topic::<Frame>("frame/cam1", size).unwrap(),
        node.create_topic::<Control>("control", size).unwrap(),
        node.create_topic::<Event>("event", size).unwrap(),
        node.create_notification("decode/cam1").unwrap(),
    ];
    Cell { _held: held, node, _lock: lock, name }
}

fn consumers() -> Vec<String> {
    vec!["decode/cam1".to_owned()]
}

fn frame(number: u32) -> Frame {
    Frame {
        cycle: 7,
        frame: number,
        width_px: 5,
        height_px: 3,
        bytes_per_px: 1,
        full_scale_dn: 255,
        ..Frame::default()
    }
}

#[test]
fn a_frame_arrives_as_it_was_written_and_aligned() {
    let cell = cell("roundtrip");
    let stage = Node::join(&cell.name, "decode/cam1").unwrap();
    let listener = stage.listener("decode/cam1").unwrap();
    let subscriber = stage.subscriber::<Frame>("frame/cam1").unwrap();
    let publisher = cell.node.publisher::<Frame>("frame/cam1", 15, &consumers(), PATIENCE).unwrap();
    assert!(!listener.wait(Duration::ZERO).unwrap());

    for number in 0..9 {
        let mut loan = publisher.loan(frame(number)).unwrap();
        assert_eq!(loan.payload_mut().as_ptr().align_offset(64), 0);
        loan.payload_mut().fill(number as u8);
        loan.send().unwrap();
        assert!(listener.wait(LONG).unwrap());
        let received = subscriber.receive().unwrap().unwrap();
        assert_eq!(received.header(), &frame(number));
        let view = payload::frame(received.header(), received.payload()).unwrap();
        assert_eq!((view.pixels.len(), view.pixels.get(14)), (15, number as f32));
    }
    assert!(subscriber.receive().unwrap().is_none());
}

#[test]
fn a_full_buffer_fails_the_send_and_loses_nothing_that_was_accepted() {
    let cell = cell("full");
    let subscriber = cell.node.subscriber::<Frame>("frame/cam1").unwrap();
    let publisher = cell.node.publisher::<Frame>("frame/cam1", 15, &consumers(), PATIENCE).unwrap();
    subscriber.connect().unwrap();
    for number in 0..3 {
        publisher.send(frame(number), &[1; 15]).unwrap();
    }
    let error = publisher.send(frame(3), &[1; 15]).unwrap_err();
    assert!(matches!(error, IpcError::Full { buffer: 3, .. }), "{error}");
    let numbers: Vec<u32> =
        std::iter::from_fn(|| subscriber.receive().unwrap().map(|r| r.header().frame)).collect();
    assert_eq!(numbers, [0, 1, 2]);
    publisher.send(frame(4), &[1; 15]).unwrap();
}

#[test]
fn a_message_without_a_receiver_is_an_error() {
    let cell = cell("nobody");
    let publisher = cell.node.publisher::<Frame>("frame/cam1", 15, &consumers(), PATIENCE).unwrap();
    let error = publisher.send(frame(0), &[1; 15]).unwrap_err();
    assert!(matches!(error, IpcError::NotReached { reached: 0, expected: 1, .. }), "{error}");
}

#[test]
fn a_header_changed_after_the_loan_is_not_sent() {
    let cell = cell("invalid");
    let _subscriber = cell.node.subscriber::<Frame>("frame/cam1").unwrap();
    let publisher = cell.node.publisher::<Frame>("frame/cam1", 15, &consumers(), PATIENCE).unwrap();
    let mut loan = publisher.loan(frame(0)).unwrap();
    loan.header_mut().height_px = 4;
    assert!(matches!(loan.send(), Err(IpcError::Message { .. })));
    // The refused loan gave its memory back: the next one is possible though only one may be out.
    publisher.send(frame(1), &[1; 15]).unwrap();
    assert!(publisher.loan(Frame { width_px: 50, ..frame(2) }).is_err(), "larger than announced");
}

#[test]
fn texts_and_commands_arrive() {
    let cell = cell("texts");
    let events = cell.node.subscriber::<Event>("event").unwrap();
    let commands = cell.node.subscriber::<Control>("control").unwrap();
    let publisher = cell.node.publisher::<Event>("event", 1024, &consumers(), PATIENCE).unwrap();
    let reason = "frames/proj1/cam1/003.png: truncated";
    let header =
        Event { kind: EventKind::Failed as u32, text_bytes: reason.len() as u32, ..Event::default() };
    publisher.send(header, reason.as_bytes()).unwrap();
    publisher.send(Event { text_bytes: 0, ..header }, b"").unwrap();
    let received = events.receive().unwrap().unwrap();
    assert_eq!(received.header().kind().unwrap(), EventKind::Failed);
    assert_eq!(payload::text(received.header().text_bytes, received.payload()).unwrap(), reason);
    drop(received);
    let received = events.receive().unwrap().unwrap();
    assert_eq!(payload::text(received.header().text_bytes, received.payload()).unwrap(), "");

    let control = cell.node.publisher::<Control>("control", 1, &consumers(), PATIENCE).unwrap();
    control.send(Control::new(Command::Abort, 4), &[]).unwrap();
    let received = commands.receive().unwrap().unwrap();
    assert_eq!((received.header().command().unwrap(), received.header().cycle), (Command::Abort, 4));
}

#[test]
fn nothing_is_left_in_shared_memory_at_the_end() {
    let cell = cell("gone");
    let name = cell.name.clone();
    let publisher = cell.node.publisher::<Frame>("frame/cam1", 15, &consumers(), PATIENCE).unwrap();
    drop(publisher);
    drop(cell);
    let prefix = name.prefix();
    let left: Vec<_> = std::fs::read_dir("/dev/shm")
        .unwrap()
        .filter_map(Result::ok)
        .map(|e| e.file_name().to_string_lossy().into_owned())
        .filter(|f| f.contains(name.as_str()) || f.starts_with(&prefix))
        .collect();
    assert!(left.is_empty(), "{left:?}");
}

/// The report on the fusion of 64 pairs, 2016 overlaps, through a topic whose buffer holds three messages.
#[test]
fn a_report_of_64_pairs_travels_in_parts_and_comes_out_whole() {
    let overlap = |a: usize, b: usize| {
        format!("{{\"a\":{a},\"b\":{b},\"count\":{},\"mean_mm\":{}}}", 1000 * a + b, -1.0 / (a + b) as f64)
    };
    let overlaps: Vec<String> = (0..64).flat_map(|a| (a + 1..64).map(move |b| overlap(a, b))).collect();
    let report = format!("{{\"overlaps\":[{}]}}", overlaps.join(","));
    assert!(report.len() > 5 * MAX_TEXT_BYTES, "{} bytes", report.len());

    let cell = cell("long");
    let subscriber = cell.node.subscriber::<Event>("event").unwrap();
    let name = cell.name.clone();
    let sent = report.clone();
    // A publisher that is gone takes what was not received yet with it.
    let (done, received_all) = std::sync::mpsc::channel::<()>();
    let (joined_cell, has_joined) = std::sync::mpsc::channel::<()>();
    let (connected, may_send) = std::sync::mpsc::channel::<()>();
    let stage = std::thread::spawn(move || {
        let stage = Node::join(&name, "decode/cam1").unwrap();
        let events = stage.publisher::<Event>("event", MAX_TEXT_BYTES, &consumers(), LONG).unwrap();
        // As in a cell: a stage sends reports only after all receivers connected. For a receiver that is not connected
        // a publisher does not wait when the buffer is full.
        joined_cell.send(()).unwrap();
        may_send.recv().unwrap();
        let all: Vec<&str> = parts(&sent, MAX_TEXT_BYTES).collect();
        for (number, part) in all.iter().enumerate() {
            let kind = if number + 1 == all.len() { EventKind::Done } else { EventKind::Part };
            let event = Event { kind: kind as u32, text_bytes: part.len() as u32, ..Event::default() };
            events.send(event, part.as_bytes()).unwrap();
        }
        let _ = received_all.recv();
    });
    has_joined.recv().unwrap();
    subscriber.connect().unwrap();
    connected.send(()).unwrap();
    let started = std::time::Instant::now();
    let mut joined = Joined::default();
    let received = loop {
        let Some(message) = subscriber.receive().unwrap() else {
            assert!(started.elapsed() < WATCHDOG, "the report does not arrive");
            std::thread::sleep(Duration::from_millis(1));
            continue;
        };
        let text = payload::text(message.header().text_bytes, message.payload()).unwrap();
        match message.header().kind().unwrap() {
            EventKind::Part => joined.push(TextKey::of(message.header()), text).unwrap(),
            _ => break joined.take(TextKey::of(message.header()), text),
        }
    };
    done.send(()).unwrap();
    stage.join().unwrap();
    assert_eq!(received, report);
}
