//! Who is refused, and that refusals do nothing.

use super::http::{connect, get, post, raw};
use super::{MARKUP, Page, address};
use crate::running::{Cell, text, wait};
use serde_json::json as value;
use std::io::{Read as _, Write as _};

/// Proves: whatever is wrong with a request, it gets its status, and the cell does nothing.
#[test]
fn wrong_requests_get_their_status_and_change_nothing() {
    let page = Page::serving("refused", &[]).ready();
    let host = page.address;
    let inspect = r#"{"command":"inspect","part":"1"}"#;
    let long = "x".repeat(70_000);
    for (request, status) in [
        (format!("GET /api/command HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"), 405),
        (format!("POST /api/state HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"), 405),
        (format!("GET /nothing HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"), 404),
        (format!("GET /../../etc/passwd HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"), 404),
        ("GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n".to_owned(), 421),
        ("GET / HTTP/1.0\r\n\r\n".to_owned(), 421),
        (format!("GET / HTTP/1.1\r\nHost: {host}\r\nX: {long}\r\n\r\n"), 431),
        ("dance\r\n\r\n".to_owned(), 400),
        ("\x00\x01\r\n\r\n".to_owned(), 400),
    ] {
        assert_eq!(raw(host, request.as_bytes()).status, status, "{}", &request[..request.len().min(80)]);
    }
    for (body, more, status) in [
        (inspect, "Origin: http://evil.example\r\n", 403),
        (inspect, "Origin: null\r\n", 403),
        (inspect, "Sec-Fetch-Site: cross-site\r\n", 403),
        (r#"{"command":"stop"}"#, "", 403),
        (r#"{"command":"status"}"#, "", 403),
        (r#"{"command":"state"}"#, "", 403),
        (r#"{"command":"metrics"}"#, "", 403),
        (r#"{"command":"spans"}"#, "", 403),
        (r#"{"command":"watch"}"#, "", 403),
        (r#"{"command":"begin"}"#, "", 403),
        (r#"{"command":"dance"}"#, "", 400),
        (r#"{"command":"inspect","part":"1","now":true}"#, "", 400),
        ("[", "", 400),
        ("", "", 400),
        (&long, "", 413),
        (r#"{"command":"inspect","part":""}"#, "", 422),
        (r#"{"command":"inspect","part":"1","recipe":"none"}"#, "", 422),
        (r#"{"command":"restart","stage":"none"}"#, "", 422),
    ] {
        let answer = post(host, "/api/command", body, more);
        assert_eq!(answer.status, status, "{more}{}: {}", &body[..body.len().min(60)], answer.text());
    }
    assert_eq!(page.cell.status().unwrap()["cycles_done"], 0);
    assert_eq!(post(host, "/api/command", inspect, &format!("Origin: http://{host}\r\n")).status, 200);
    page.stop();
}

/// Proves: of two operators who press at once one is served, and the other reads why not.
#[test]
fn of_two_operators_who_press_at_once_one_reads_why_not() {
    let cell = Cell::played("two", 40.0, "");
    let page = Page::start(cell, &["--serve"]).ready();
    let press = |part: &str| {
        let (at, body) = (page.address, value!({"command": "inspect", "part": part}).to_string());
        std::thread::spawn(move || post(at, "/api/command", &body, ""))
    };
    let answers = [press("a"), press(MARKUP)].map(|pressed| pressed.join().unwrap());
    let mut codes = answers.each_ref().map(|answer| answer.status);
    codes.sort_unstable();
    assert_eq!(codes, [200, 409], "{answers:?}");
    let refused = answers.iter().find(|answer| answer.status == 409).unwrap();
    assert_eq!(refused.json()["not_ready"]["state"], "SingleExecution");
    assert_eq!(page.command(&value!({"command": "halt"})).status, 200);
    assert_eq!(page.command(&value!({"command": "inspect", "part": "c"})).status, 422);
    assert_eq!(page.command(&value!({"command": "reset"})).status, 200);
    assert_eq!(page.cell.status().unwrap()["cycles_done"], 1);
    page.stop();
}

/// Proves: an address that other machines can reach needs a token, and who does not know it sees nothing.
#[test]
fn an_address_that_others_can_reach_needs_a_token() {
    let cell = Cell::played("token", 50.0, "");
    let refused = cell.run("played.toml", &["--page", "0.0.0.0:0"]);
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("other machines can reach this address; add --page-token FILE"), "{said}");
    let token = cell.small.path("token");
    for bad in ["", "short", "has a space in it, so it is none"] {
        std::fs::write(&token, bad).unwrap();
        let refused = cell.run("played.toml", &["--page", "0.0.0.0:0", "--page-token", &token]);
        assert_eq!(refused.status.code(), Some(2));
        assert!(text(&refused.stderr).contains("a token has 16 to 256"), "{}", text(&refused.stderr));
    }
    let endless = cell.run("played.toml", &["--page", "0.0.0.0:0", "--page-token", "/dev/zero"]);
    assert!(text(&endless.stderr).contains("/dev/zero: longer than 4096 bytes"), "{}", text(&endless.stderr));
    std::fs::write(&token, "0123456789abcdef\n").unwrap();
    let arguments = ["--page", "0.0.0.0:0", "--page-token", &token, "--serve"];
    let mut run = cell.program("played.toml", &arguments).spawn().unwrap();
    let port = address(&mut run, "page at http://").port();
    let at = ([127, 0, 0, 1], port).into();
    cell.until("ready", |status| status["state"] == "Ready");
    for path in ["/", "/api/state", "/metrics", "/?token=0123456789abcdee"] {
        assert_eq!(get(at, path).status, 401, "{path}");
    }
    assert_eq!(post(at, "/api/command", r#"{"command":"halt"}"#, "").status, 401);
    let kept = get(at, "/?token=0123456789abcdef");
    assert_eq!((kept.status, kept.header("location")), (303, Some("/")));
    let cookie = kept.header("set-cookie").unwrap();
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"), "{cookie}");
    let with = |line: &str| {
        raw(
            at,
            format!("GET /api/state HTTP/1.1\r\nHost: cell\r\nConnection: close\r\n{line}\r\n\r\n")
                .as_bytes(),
        )
    };
    assert_eq!(with("Cookie: fringecell=0123456789abcdef").status, 200);
    assert_eq!(with("Authorization: Bearer 0123456789abcdef").status, 200);
    crate::running::signal("INT", run.id().into());
    wait(run);
}

/// Proves: `--metrics` serves the metrics and nothing else, and not beside a page.
#[test]
fn the_metrics_alone_give_nothing_else() {
    let cell = Cell::played("alone", 50.0, "");
    let both = cell.run("played.toml", &["--metrics", "127.0.0.1:0", "--page", "127.0.0.1:0"]);
    assert_eq!(both.status.code(), Some(2));
    let mut run = cell.program("played.toml", &["--serve", "--metrics", "127.0.0.1:0"]).spawn().unwrap();
    let at = address(&mut run, "metrics at http://");
    cell.until("ready", |status| status["state"] == "Ready");
    for (path, status) in
        [("/metrics", 200), ("/metrics?x=1", 200), ("/", 404), ("/api/state", 404), ("/page.js", 404)]
    {
        assert_eq!(get(at, path).status, status, "{path}");
    }
    assert_eq!(post(at, "/api/command", r#"{"command":"halt"}"#, "").status, 404);
    assert_eq!(post(at, "/metrics", "", "").status, 405);
    // Half a head keeps nobody else from being served, and is disconnected.
    let mut half = connect(at);
    half.write_all(b"GET /metr").unwrap();
    assert_eq!(get(at, "/metrics").status, 200);
    let mut rest = String::new();
    half.read_to_string(&mut rest).unwrap();
    crate::running::signal("INT", run.id().into());
    wait(run);
}

/// Proves: a body that never comes holds its connection no longer than a head that never comes.
#[test]
fn a_body_that_never_comes_is_not_waited_for() {
    let page = Page::serving("bodiless", &[]).ready();
    let begin = std::time::Instant::now();
    let head =
        format!("POST /api/command HTTP/1.1\r\nHost: {}\r\nContent-Length: 20\r\n\r\n{{", page.address);
    let answer = raw(page.address, head.as_bytes());
    assert_eq!(answer.status, 408, "{}", answer.text());
    assert!(answer.text().contains("within 10 s"), "{}", answer.text());
    assert!(begin.elapsed().as_secs() < 40, "the connection was held for {:?}", begin.elapsed());
    page.stop();
}
