//! The live page in a real browser: what stands there, what is drawn, and that it comes back. Figures are printed, not judged:
//! `cargo test --test main page::browser -- --nocapture`.

use super::chromium::Chromium;
use super::{MARKUP, Page};
use crate::running::{Cell, signal, wait};
use serde_json::{Value, json};
use std::time::{SystemTime, UNIX_EPOCH};

/// Share of the pixels of the 3D view on which something is drawn.
const DRAWN: &str = "(() => { const from = document.getElementById('cloud'), to = document.createElement('canvas'); \
    [to.width, to.height] = [from.width, from.height]; const context = to.getContext('2d'); context.drawImage(from, 0, 0); \
    const data = context.getImageData(0, 0, to.width, to.height).data; let count = 0; \
    for (let n = 3; n < data.length; n += 4) count += data[n] > 0; return count / (to.width * to.height); })()";

fn open(page: &Page) -> Chromium {
    let mut browser = Chromium::start();
    browser.size(1280, 800, false);
    browser.open(&format!("http://{}/", page.address));
    browser.until("document.getElementById('state')?.textContent === 'Ready'");
    browser
}

/// Time of the outcome of the last cycle, ms since 1970.
fn outcome_ms(page: &Page) -> f64 {
    let socket = ipc::cell::CellName::new(&page.cell.name).unwrap().socket();
    let mut stream = std::os::unix::net::UnixStream::connect(socket).unwrap();
    std::io::Write::write_all(&mut stream, b"{\"command\":\"spans\"}\n").unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stream), &mut line).unwrap();
    let answer: Value = serde_json::from_str(&line).unwrap();
    let end_ns = answer["spans"]["cycles"].as_array().unwrap().last().unwrap()["end_ns"].as_f64().unwrap();
    let now_ms = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64() * 1000.0;
    now_ms - (ipc::os::now_ns() as f64 - end_ns) / 1e6
}

/// Proves: a verdict appears with everything about its part, names with markup stay text, everything that matters fits into
/// 1280 × 800, and the browser reports no error.
#[test]
#[cfg_attr(not(chromium), ignore = "no Chromium: install it, then cargo test --test main page::browser")]
fn a_verdict_appears_with_its_cloud_and_names_stay_text() {
    let page = Page::serving("browser", &[]).ready();
    let mut browser = open(&page);
    browser.until("performance.getEntriesByType('paint').length > 0");
    println!("first paint: {} ms", browser.value("performance.getEntriesByType('paint')[0].startTime"));
    browser.value(
        "new MutationObserver(() => { if (document.getElementById('verdict').textContent === 'PASS') window.passed ??= \
         performance.timeOrigin + performance.now(); }).observe(document.getElementById('verdict'), {childList: true}), 1",
    );
    let inspect = json!({"command": "inspect", "part": MARKUP, "recipe": MARKUP});
    assert_eq!(page.command(&inspect).status, 200);
    browser.until("document.getElementById('verdict').textContent === 'PASS'");
    let shown_ms = browser.value("window.passed").as_f64().unwrap();
    println!("outcome to page: {:.0} ms", shown_ms - outcome_ms(&page));
    let features = page.get("/api/state").json()["last"]["features"].as_array().unwrap().len();
    browser.until(&format!("document.querySelectorAll('#featuretable tbody tr').length === {features}"));
    browser.until("Number(document.getElementById('cloud').dataset.points) > 1000");
    let drawn = browser.value(DRAWN).as_f64().unwrap();
    assert!(drawn > 0.01, "only {drawn} of the 3D view is drawn");
    for (name, place) in [("part", "partline"), ("feature", "featuretable"), ("recipe", "logtable")] {
        let text = browser.value(&format!("document.getElementById('{place}').textContent"));
        assert!(text.as_str().unwrap().contains(MARKUP), "{name}: {text}");
    }
    assert_eq!(browser.value("document.querySelectorAll('img[src=x]').length"), 0);
    let colour = browser.value("getComputedStyle(document.getElementById('band')).backgroundColor");
    assert_eq!(colour, "rgb(17, 112, 58)");
    let fits = browser.value(
        "document.documentElement.scrollHeight <= innerHeight && ['job', 'verdict', 'cloud', 'featuretable', 'logtable']\
         .every((id) => { const box = document.getElementById(id).getBoundingClientRect(); return box.top >= 0 && box.left >= 0 && \
         box.right <= innerWidth && box.top < innerHeight - 60; })",
    );
    assert_eq!(fits, true);
    browser.picture("verdict");
    assert_eq!(browser.errors, Vec::<String>::new());
    page.stop();
}

/// Proves: tabs, theme and tablet: every panel shows what it should, reachable by keys, in both colours, without scrolling
/// sideways.
#[test]
#[cfg_attr(not(chromium), ignore = "no Chromium: install it, then cargo test --test main page::browser")]
fn panels_are_reached_by_keys_in_light_and_dark_and_on_a_tablet() {
    let page = Page::serving("panels", &[]).ready();
    let mut browser = open(&page);
    for part in ["1", "2"] {
        assert_eq!(page.command(&json!({"command": "inspect", "part": part})).status, 200);
        // A cloud that is not fetched when the next part is done is gone, which the browser reports as an error.
        browser
            .until(&format!("document.getElementById('cloudline').textContent.startsWith('cycle {part}: ')"));
    }
    browser.until("document.querySelectorAll('#logtable tbody tr').length === 2");
    for (key, panel, shows) in [
        ("2", "cameras", "document.querySelectorAll('#cameras canvas:not(.hist)').length === 2"),
        ("3", "trend", "document.querySelectorAll('#trend .dot').length >= 2"),
        ("4", "stages", "document.querySelectorAll('#stages svg rect').length > 10"),
    ] {
        browser.press(key);
        browser.until(&format!("!document.getElementById('{panel}').hidden && {shows}"));
        browser.picture(panel);
    }
    browser.press("ArrowRight");
    browser.until("!document.getElementById('log').hidden && document.activeElement.id === 'tab-log'");
    let light = browser.value("getComputedStyle(document.body).backgroundColor");
    browser.value("document.getElementById('theme').click()");
    let dark = browser.value("getComputedStyle(document.body).backgroundColor");
    assert_eq!((light, dark), (json!("rgb(244, 245, 247)"), json!("rgb(18, 22, 27)")));
    browser.size(820, 1180, true);
    assert_eq!(browser.value("document.documentElement.scrollWidth <= innerWidth"), true);
    browser.picture("tablet");
    // The keys of the cloud turn it.
    let turned = "(() => { const cloud = document.getElementById('cloud'); cloud.focus(); return cloud.toDataURL(); })()";
    browser.until("Number(document.getElementById('cloud').dataset.points) > 1000");
    let before = browser.value(turned);
    browser.press("ArrowLeft");
    std::thread::sleep(std::time::Duration::from_millis(500));
    assert_ne!(browser.value(turned), before);
    assert_eq!(browser.value(LABELS), true);
    assert_eq!(browser.errors, Vec::<String>::new());
    page.stop();
}

/// Whether ten labels at the same place stand clear of each other, wherever that place is: with fractions of pixels the search for a free
/// place ended only by luck.
const LABELS: &str = "(async () => { const { below } = await import('/cloud.js'); \
    for (let n = 0; n < 1000; n++) { const taken = [], top = 0.37 * n * Math.sqrt(3); \
      for (let label = 0; label < 10; label++) { const y = below(taken, 7.3, top, 80); \
        if (Math.abs(y - top - 20 * label) > 0.5) return `${y} for label ${label} at ${top}`; taken.push({ x: 7.3, y, wide: 80 }); } } \
    return true; })()";

/// Proves: no verdict stays on the page when the cell is gone, and the page comes back by itself with the next cell.
#[test]
#[cfg_attr(not(chromium), ignore = "no Chromium: install it, then cargo test --test main page::browser")]
fn the_page_says_that_the_cell_is_gone_and_comes_back_with_the_next_one() {
    let page = Page::start(Cell::played("back", 0.0, ""), &["--serve"]).ready();
    let mut browser = open(&page);
    assert_eq!(page.command(&json!({"command": "inspect", "part": "1"})).status, 200);
    browser.until("document.getElementById('partline').textContent === '1'");
    signal("INT", page.run.id().into());
    wait(page.run);
    browser.until("document.getElementById('verdict').textContent === 'NO CONNECTION'");
    let address = page.address.to_string();
    let run = page.cell.program("played.toml", &["--serve", "--page", &address]).spawn().unwrap();
    browser.until("document.getElementById('state').textContent === 'Ready'");
    browser.until("document.getElementById('partline').textContent === 'no part yet'");
    signal("INT", run.id().into());
    wait(run);
}

/// Proves: of a cloud of a million points all are drawn at rest, and while it turns frames go on coming.
#[test]
#[cfg_attr(not(chromium), ignore = "no Chromium: install it, then cargo test --test main page::browser")]
fn a_million_points_are_drawn() {
    let page = Page::serving("million", &[]).ready();
    let mut browser = open(&page);
    let frames = browser.value(MILLION);
    println!("a million points: {frames}");
    assert_eq!(frames["points"], 1_000_000);
    // How many depends on the graphics card and on what else the machine does: they are printed, not judged.
    assert!(frames["frames"].as_u64().unwrap() >= 2, "{frames}");
    assert!(browser.value(DRAWN).as_f64().unwrap() > 0.05);
    assert_eq!(browser.errors, Vec::<String>::new());
    page.stop();
}

/// A sphere of a million points in place of what the cell has, turned for two seconds.
const MILLION: &str = "(async () => { const n = 1e6, buffer = new ArrayBuffer(40 + 24 * n), view = new DataView(buffer); \
    view.setUint32(0, 0x31434346, true); view.setUint32(4, n, true); view.setUint32(8, n, true); \
    const at = new Float32Array(buffer, 40, 3 * n), ways = new Int8Array(buffer, 40 + 20 * n, 4 * n); \
    for (let i = 0; i < n; i++) { const z = 1 - 2 * i / n, r = Math.sqrt(1 - z * z), a = 2.4 * i; \
      const p = [r * Math.cos(a), r * Math.sin(a), z]; at.set(p.map((v) => 40 * v), 3 * i); ways.set(p.map((v) => 127 * v), 4 * i); } \
    const given = window.fetch; window.fetch = async () => new Response(buffer); \
    const cloud = new (await import('/cloud.js')).Cloud(); await cloud.show({number: 1, cloud_number: 1}, ['pair1']); window.fetch = given; \
    const wait = (ms) => new Promise((done) => setTimeout(done, ms)); await wait(800); \
    const canvas = document.getElementById('cloud'); let frames = 0, fewest = 1e9, slowest = 0; const end = performance.now() + 2000; \
    while (performance.now() < end) { cloud.key({key: 'ArrowLeft', preventDefault() {}}); await new Promise(requestAnimationFrame); frames++; \
      fewest = Math.min(fewest, Number(canvas.dataset.points)); slowest = Math.max(slowest, Number(canvas.dataset.frame_ms)); } \
    await wait(1500); return {frames, fewest, slowest, points: Number(canvas.dataset.points)}; })()";
