//! Clients that misbehave, and requests to a cell that ends.

use super::*;
use std::io::Read;

/// A cell that answers every request with its debug text.
fn cell() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("command");
    let (calls, requests) = bounded::<Call>(4);
    listen(&path, calls).unwrap();
    std::thread::spawn(move || {
        for (request, reply) in requests {
            let _ = reply.send(Answer::Done(format!("{request:?}")));
        }
    });
    (folder, path)
}

fn received(mut stream: &UnixStream) -> String {
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}

#[test]
fn one_connection_carries_several_requests() {
    let (_folder, path) = cell();
    let answer = ask(&path, &Request::Restart { stage: "decode/cam1".into() }).unwrap();
    assert!(matches!(answer, Answer::Done(text) if text.contains("decode/cam1")));
    let stream = UnixStream::connect(&path).unwrap();
    (&stream)
        .write_all(b"{\"command\":\"status\"}\n\n{\"command\":\"stop\"}\r\n{\"command\":\"state\"}")
        .unwrap();
    stream.shutdown(std::net::Shutdown::Write).unwrap();
    assert_eq!(received(&stream), "{\"done\":\"Status\"}\n{\"done\":\"Stop\"}\n{\"done\":\"State\"}\n");
}

#[test]
fn an_invalid_request_is_refused_with_its_reason_and_the_connection_stays_usable() {
    let (_folder, path) = cell();
    for invalid in [
        &b"{\"command\":\"dance\"}"[..],
        b"{\"command\":\"stop\",\"now\":true}",
        b"{\"command\":\"inspect\"}",
        b"[]",
        b"status",
        b"\x00\xff\xfe\x80",
        b"{\"command\":\"inspect\",\"part\":\"\xff\"}",
        &[b'['; 4000],
    ] {
        let stream = UnixStream::connect(&path).unwrap();
        (&stream).write_all(invalid).unwrap();
        (&stream).write_all(b"\n{\"command\":\"stop\"}\n").unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let text = received(&stream);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[0].starts_with("{\"refused\":\"not a request: "), "{text}");
        assert_eq!(lines[1..], ["{\"done\":\"Stop\"}"], "{text}");
    }
}

#[test]
fn a_line_without_end_is_refused_when_it_is_too_long() {
    let (_folder, path) = cell();
    let stream = UnixStream::connect(&path).unwrap();
    // The cell may close before all of it is written.
    let _ = (&stream).write_all(&vec![b'x'; 3 * MAX_REQUEST]);
    let mut line = String::new();
    BufReader::new(&stream).read_line(&mut line).unwrap();
    assert_eq!(line, "{\"refused\":\"a request has at most 4096 bytes\"}\n");
}

/// Proves: connected clients lock out neither each other nor a short `status` or `stop`.
#[test]
fn more_clients_than_allowed_get_short_requests_answered() {
    let (_folder, path) = cell();
    let clients: Vec<UnixStream> = (0..MAX_CLIENTS).map(|_| UnixStream::connect(&path).unwrap()).collect();
    // Half a line in each: none of them keeps another from being served.
    for mut client in &clients[1..] {
        client.write_all(b"{\"comm").unwrap();
    }
    for request in [Request::Status {}, Request::Stop {}] {
        assert!(matches!(ask(&path, &request).unwrap(), Answer::Done(_)), "{request:?}");
    }
    let inspect = Request::Inspect { part: "1".into(), recipe: None };
    assert!(
        matches!(ask(&path, &inspect).unwrap(), Answer::Refused(why) if why.contains("32 clients are connected"))
    );
    (&clients[0]).write_all(b"{\"command\":\"stop\"}\n").unwrap();
    let mut line = String::new();
    BufReader::new(&clients[0]).read_line(&mut line).unwrap();
    assert_eq!(line, "{\"done\":\"Stop\"}\n");
    let silent: Vec<UnixStream> =
        (0..RESERVED_CLIENTS).map(|_| UnixStream::connect(&path).unwrap()).collect();
    assert!(received(&UnixStream::connect(&path).unwrap()).contains("32 clients are connected"));
    // A silent client on a reserved place loses it soon.
    assert!(received(&silent[0]).contains("32 clients are connected"));
    drop((clients, silent));
    let begin = Instant::now();
    while !matches!(ask(&path, &inspect), Ok(Answer::Done(_))) {
        assert!(begin.elapsed() < Duration::from_secs(60), "the places are not given back");
    }
}

#[test]
fn a_client_that_is_refused_before_it_has_spoken_learns_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("command");
    let listener = UnixListener::bind(&path).unwrap();
    let asking = {
        let path = path.clone();
        std::thread::spawn(move || {
            let stream = UnixStream::connect(&path).unwrap();
            // The other end is closed before the request is written.
            std::thread::sleep(Duration::from_millis(50));
            exchange(&stream, &Request::Status {})
        })
    };
    write(&listener.accept().unwrap().0, &refused("no thread".into())).unwrap();
    assert_eq!(asking.join().unwrap().unwrap(), Answer::Refused("no thread".into()));
}

#[test]
fn a_request_to_a_cell_that_has_stopped_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("command");
    let (calls, requests) = bounded::<Call>(4);
    let clients = listen(&path, calls).unwrap();
    let stopping = std::thread::spawn(move || {
        let call = requests.recv().unwrap();
        let unanswered = clients.unanswered();
        drop(call);
        unanswered
    });
    let answer = ask(&path, &Request::Inspect { part: "1".into(), recipe: None }).unwrap();
    assert_eq!(answer, Answer::Refused(STOPPED.into()));
    assert_eq!(stopping.join().unwrap(), 1);
}

#[test]
fn an_inspection_by_a_cell_that_answers_nothing_ends_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("command");
    // The system accepts connections for it, as for a supervisor that was stopped by a signal.
    let _listener = UnixListener::bind(&path).unwrap();
    let error = ask(&path, &Request::Inspect { part: "1".into(), recipe: None }).unwrap_err();
    let told = format!("{error:#}");
    assert!(
        told.contains("its result is not known") && told.contains("did not answer within 10 s"),
        "{told}"
    );
}
