//! Projectors that are screens: under a virtual X11 display every pixel of every pattern is read back by another client, and a cell
//! that shows its patterns there gives the bytes of the twin.

use crate::gige::{hashes, run, serve};
use crate::lights::{Witness, cell, images, load, points};
use crate::running::text;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ConnectionExt, CreateWindowAux, ImageFormat, WindowClass};
use x11rb::rust_connection::RustConnection;

/// Not as a multiple of anything, and beyond one request of pixels.
const SIZE_PX: [u32; 2] = [608, 684];

/// A display of its own, without a window manager; stopped when dropped.
pub struct Display {
    server: Child,
    /// Its name for clients.
    pub name: String,
}

impl Display {
    /// A display of this size, with further options of its server.
    pub fn start([width, height]: [u32; 2], more: &[&str]) -> Self {
        let mut server = Command::new("Xvfb")
            .args([
                "-displayfd",
                "1",
                "-nolisten",
                "tcp",
                "-noreset",
                "-screen",
                "0",
                &format!("{width}x{height}x24"),
            ])
            .args(more)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut line).unwrap();
        Self { server, name: format!(":{}", line.trim()) }
    }

    /// A connection of another client.
    pub fn client(&self) -> RustConnection {
        RustConnection::connect(Some(&self.name)).unwrap().0
    }
}

impl Drop for Display {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

/// What stands on the display, four bytes a pixel; `None` when it has ended.
pub fn pixels(client: &RustConnection, [width, height]: [u32; 2]) -> Option<Vec<u8>> {
    let root = client.setup().roots[0].root;
    let image = client.get_image(ImageFormat::Z_PIXMAP, root, 0, 0, width as u16, height as u16, !0);
    Some(image.ok()?.reply().ok()?.data)
}

/// The same in grey; panics at a pixel in colours.
fn picture(client: &RustConnection, size_px: [u32; 2]) -> Vec<u8> {
    let grey = |pixel: &[u8]| {
        assert!(pixel[0] == pixel[1] && pixel[1] == pixel[2], "{pixel:?}");
        pixel[0]
    };
    pixels(client, size_px).unwrap().chunks_exact(4).map(grey).collect()
}

fn keys(display: &str, more: &str) -> String {
    format!("driver = \"screen\"\ndisplay = \"{display}\"\nposition_px = [0, 0]\n{more}")
}

#[test]
#[cfg_attr(not(xvfb), ignore = "no Xvfb: install it, then cargo test --test main screen::")]
fn every_pixel_of_every_pattern_stands_on_the_display() {
    let display = Display::start(SIZE_PX, &[]);
    let (_folder, _, live) = cell(50, SIZE_PX, &keys(&display.name, "delay_refreshes = 0"), 16667.0);
    let loaded = load(&live);
    let patterns = images(&loaded);
    let client = display.client();
    let mut projector = devices::projector(&loaded).unwrap();
    projector.begin(0, 0).unwrap();
    assert!(picture(&client, SIZE_PX).iter().all(|level| *level == 0), "dark before the first pattern");
    for frame in (0..patterns.len()).chain([3, 0, 12]) {
        projector.show(0, frame, 0).unwrap();
        assert!(picture(&client, SIZE_PX) == patterns[frame], "frame {frame}");
    }
    projector.begin(1, 0).unwrap();
    assert!(picture(&client, SIZE_PX).iter().all(|level| *level == 0));
}

#[test]
#[cfg_attr(not(xvfb), ignore = "no Xvfb: install it, then cargo test --test main screen::")]
fn a_window_over_the_pattern_and_a_display_that_ends_are_told() {
    let mut display = Display::start(SIZE_PX, &[]);
    let (_folder, _, live) = cell(51, SIZE_PX, &keys(&display.name, "delay_refreshes = 0"), 16667.0);
    let loaded = load(&live);
    let mut projector = devices::projector(&loaded).unwrap();
    projector.begin(0, 0).unwrap();
    projector.show(0, 0, 0).unwrap();
    let client = display.client();
    let (window, root) = (client.generate_id().unwrap(), client.setup().roots[0].root);
    let how = CreateWindowAux::new().override_redirect(1).background_pixel(0x12_34_56);
    let created =
        client.create_window(24, window, root, 100, 200, 10, 5, 0, WindowClass::INPUT_OUTPUT, 0, &how);
    created.unwrap().check().unwrap();
    client.map_window(window).unwrap().check().unwrap();
    let covered = projector.show(0, 1, 0).unwrap_err().to_string();
    assert!(covered.contains("50 pixels on the screen are not those of the pattern"), "{covered}");
    assert!(
        covered.contains("the first at column 100, row 200") && covered.contains("\"proj1\""),
        "{covered}"
    );
    // The next cycle opens the window anew, above the other one.
    projector.begin(1, 0).unwrap();
    projector.show(0, 1, 0).unwrap();
    display.server.kill().unwrap();
    display.server.wait().unwrap();
    let ended = projector.show(0, 2, 0).unwrap_err().to_string();
    assert!(ended.contains("the X11 display does not take it") && ended.contains("\"proj1\""), "{ended}");
    let again = projector.begin(2, 0).unwrap_err().to_string();
    assert!(again.contains("the X11 display cannot be opened"), "{again}");
}

#[test]
#[cfg_attr(not(xvfb), ignore = "no Xvfb: install it, then cargo test --test main screen::")]
fn displays_that_would_change_the_pattern_are_refused() {
    let display = Display::start([640, 480], &[]);
    let refused = |keys: &str| {
        let (_folder, _, live) = cell(52, SIZE_PX, keys, 16667.0);
        devices::projector(&load(&live)).err().unwrap().to_string()
    };
    let size = refused(&keys(&display.name, ""));
    assert!(
        size.contains("has 640 × 480 px") && size.contains("608 × 684") && size.contains("xrandr --output"),
        "{size}"
    );
    let name = refused(&format!("driver = \"screen\"\ndisplay = \"{}\"\noutput = \"HDMI-7\"", display.name));
    assert!(
        name.contains("output = \"HDMI-7\"; it has: ") && name.contains("640 × 480 px at 0, 0"),
        "{name}"
    );
    let absent = refused(&keys(":4321", ""));
    assert!(absent.contains("the X11 display cannot be opened") && absent.contains("DISPLAY"), "{absent}");
}

#[test]
fn a_cell_without_a_display_ends_with_what_to_do() {
    let (folder, _, live) = cell(53, SIZE_PX, &keys(":4321", ""), 16667.0);
    let ran = run(folder.path(), &live, "none", "1");
    let said = text(&ran.stdout) + &text(&ran.stderr);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    assert!(said.contains("the X11 display cannot be opened"), "{said}");
}

/// Watches a display and tells the twin what its projector shows; stopped when dropped.
struct Watching(Arc<AtomicBool>, Option<std::thread::JoinHandle<()>>);

impl Watching {
    fn start(display: &Display, mut witness: Witness) -> Self {
        let (stop, client) = (Arc::new(AtomicBool::new(false)), display.client());
        let stopped = stop.clone();
        let thread = std::thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                witness.sees(&picture(&client, SIZE_PX));
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        Self(stop, Some(thread))
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        let _ = self.1.take().map(std::thread::JoinHandle::join);
    }
}

#[test]
#[cfg_attr(not(xvfb), ignore = "no Xvfb: install it, then cargo test --test main screen::")]
fn a_cell_that_shows_on_a_display_gives_the_bytes_of_the_twin() {
    let display = Display::start(SIZE_PX, &[]);
    // The served twin is as bright as the twin itself at 10 ms. The eye in front of the display needs some refreshes to see a pattern and to tell the twin.
    let (folder, twin, live) =
        cell(54, SIZE_PX, &keys(&display.name, "delay_refreshes = 18\nrefresh_hz = 100"), 10000.0);
    let simulated = run(folder.path(), &twin, "twin", "2");
    assert!(simulated.status.success(), "{}", text(&simulated.stderr));
    let served = serve(&twin, 54, &[]);
    let watching = Watching::start(&display, Witness::new(54, images(&load(&live))));
    let ran = run(folder.path(), &live, "screen", "2");
    drop(watching);
    drop(served);
    assert!(ran.status.success(), "{}{}", text(&ran.stdout), text(&ran.stderr));
    assert_eq!(points(folder.path(), "twin"), points(folder.path(), "screen"));
    assert_eq!(hashes(folder.path(), "twin"), hashes(folder.path(), "screen"));
}

#[test]
#[ignore = "a figure: cargo test --release --test main pace_of_patterns -- --ignored --nocapture"]
fn pace_of_patterns_on_a_virtual_display() {
    for delay_refreshes in [0, 2] {
        let size_px = [912, 1140];
        let display = Display::start(size_px, &[]);
        let more = format!("delay_refreshes = {delay_refreshes}");
        let (_folder, _, live) = cell(55, size_px, &keys(&display.name, &more), 16667.0);
        let loaded = load(&live);
        let mut projector = devices::projector(&loaded).unwrap();
        let frames = loaded.config.projectors[0].frames();
        projector.begin(0, 0).unwrap();
        let mut times_ms: Vec<f64> = (0..200)
            .map(|number| {
                let start = Instant::now();
                projector.show(0, number % frames, 0).unwrap();
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times_ms.sort_by(f64::total_cmp);
        let at = |part: f64| times_ms[(part * 199.0) as usize];
        println!(
            "{} × {} px, delay_refreshes = {delay_refreshes}: {:.1} ms a pattern (median), {:.1} (90 %), {:.1} (largest)",
            size_px[0],
            size_px[1],
            at(0.5),
            at(0.9),
            at(1.0)
        );
    }
}
