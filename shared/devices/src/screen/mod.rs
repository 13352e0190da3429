//! A projector that is a screen of this computer: a window over a whole output of an X11 display, pixel for pixel.
//!
//! The window belongs to nobody but the display (override-redirect), so no window manager moves, decorates or scales it. What the
//! display has presented is awaited, and the pixels of the window are read back each time.

mod layout;
mod output;

use crate::error::DeviceError;
use crate::light::Light;
use cell::configuration::{ProjectorConfig, ScreenSettings};
use layout::Layout;
use output::{check_output, check_picture_path, choose, outputs};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::time::{Duration, Instant};
use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::Event;
use x11rb::protocol::present::{self, ConnectionExt as _};
use x11rb::protocol::xproto::{
    ConfigureWindowAux, ConnectionExt as _, CreateGCAux, CreateWindowAux, EventMask, Gcontext, ImageFormat,
    Pixmap, Rectangle, StackMode, Window, WindowClass,
};
use x11rb::rust_connection::RustConnection;

/// Longest time until the display has presented a picture: some refreshes of the slowest one.
const PRESENT_WAIT: Duration = Duration::from_secs(2);

/// A window over an output, with a picture behind it.
pub(crate) struct Screen {
    /// Name of the projector, for messages.
    name: String,
    connection: RustConnection,
    window: Window,
    /// The desktop that the window lies on, and where.
    root: Window,
    corner: [i16; 2],
    picture: Pixmap,
    context: Gcontext,
    size_px: [u32; 2],
    layout: Layout,
    /// Whether the display tells when a picture stands.
    presents: bool,
    serial: u32,
    refresh: Duration,
    delay_refreshes: u32,
}

impl Screen {
    /// Opens a window over the output of a projector.
    ///
    /// # Errors
    /// No display, no such output, or one that would not show the pixels as they are.
    pub fn open(projector: &ProjectorConfig, settings: &ScreenSettings) -> Result<Self, DeviceError> {
        Self::connect(projector, settings)
            .map_err(|text| DeviceError::Frame(format!("projector \"{}\": {text}", projector.name)))
    }

    fn connect(projector: &ProjectorConfig, settings: &ScreenSettings) -> Result<Self, String> {
        let (connection, number) = RustConnection::connect(settings.display.as_deref()).map_err(|error| {
            format!(
                "the X11 display cannot be opened ({error}); start the cell in a session of Xorg, or set DISPLAY and \
                 XAUTHORITY to those of one"
            )
        })?;
        let screen = &connection.setup().roots[number];
        let root = screen.root;
        let outputs = outputs(&connection, root).map_err(|error| lost(&error))?;
        let output = choose(&outputs, &settings.place)?;
        check_output(output, projector.size_px(), settings)?;
        check_picture_path(&connection, output).map_err(|error| lost(&error))??;
        let visuals = screen.allowed_depths.iter().flat_map(|depth| &depth.visuals);
        let visual = visuals.clone().find(|visual| visual.visual_id == screen.root_visual);
        let layout = visual.and_then(|visual| Layout::of(&connection, screen.root_depth, visual));
        let layout = layout.ok_or_else(|| {
            format!(
                "the display has {} bits a pixel in colours, 24 are needed; start Xorg with DefaultDepth 24",
                screen.root_depth
            )
        })?;
        let black = screen.black_pixel;
        let opened = Self {
            name: projector.name.clone(),
            window: id(&connection)?,
            root,
            corner: output.corner.map(|place| place as i16),
            picture: id(&connection)?,
            context: id(&connection)?,
            size_px: projector.size_px(),
            layout,
            presents: presents(&connection).map_err(|error| lost(&error))?,
            serial: 0,
            refresh: Duration::from_secs_f64(1.0 / settings.refresh_hz),
            delay_refreshes: settings.delay_refreshes,
            connection,
        };
        opened.create(black).map_err(|error| lost(&error))?;
        let mut opened = opened;
        opened.darken_text()?;
        Ok(opened)
    }

    /// Window, cursor and picture.
    fn create(&self, black: u32) -> Result<(), Fault> {
        let (c, root, [x, y]) = (&self.connection, self.root, self.corner);
        let [width, height] = self.size_px.map(|size| size as u16);
        // A cursor without any pixel.
        let (blank, cursor) = (c.generate_id()?, c.generate_id()?);
        c.create_pixmap(1, blank, root, 1, 1)?;
        let blank_context = c.generate_id()?;
        c.create_gc(blank_context, blank, &CreateGCAux::new().foreground(0))?;
        c.poly_fill_rectangle(blank, blank_context, &[Rectangle { x: 0, y: 0, width: 1, height: 1 }])?;
        c.create_cursor(cursor, blank, blank, 0, 0, 0, 0, 0, 0, 0, 0)?;
        let how = CreateWindowAux::new()
            .override_redirect(1)
            .background_pixel(black)
            .border_pixel(black)
            .cursor(cursor)
            .event_mask(EventMask::STRUCTURE_NOTIFY);
        let (depth, class) = (self.layout.depth, WindowClass::INPUT_OUTPUT);
        c.create_window(depth, self.window, root, x, y, width, height, 0, class, 0, &how)?.check()?;
        // Compositors let such a window alone.
        let bypass = c.intern_atom(false, b"_NET_WM_BYPASS_COMPOSITOR")?.reply()?.atom;
        let cardinal = x11rb::protocol::xproto::AtomEnum::CARDINAL;
        x11rb::wrapper::ConnectionExt::change_property32(
            c,
            x11rb::protocol::xproto::PropMode::REPLACE,
            self.window,
            bypass,
            cardinal,
            &[1],
        )?;
        c.create_pixmap(depth, self.picture, self.window, width, height)?.check()?;
        c.create_gc(self.context, self.window, &CreateGCAux::new().graphics_exposures(0))?;
        if self.presents {
            c.present_select_input(c.generate_id()?, self.window, present::EventMask::COMPLETE_NOTIFY)?
                .check()?;
        }
        c.map_window(self.window)?.check()?;
        Ok(())
    }

    /// Shows a frame of a projector's sequence.
    ///
    /// # Errors
    /// As [`Self::show`]; a frame that the sequence does not have.
    pub fn show_frame(&mut self, projector: &ProjectorConfig, frame: usize) -> Result<(), DeviceError> {
        let drawn = match projector.image_u8(frame) {
            Some(Ok(pattern)) => self.show(&pattern),
            Some(Err(error)) => Err(error.to_string()),
            None => Err(format!("the sequence has no frame {}", frame + 1)),
        };
        drawn.map_err(|text| DeviceError::Frame(format!("projector \"{}\": {text}", self.name)))
    }

    /// Shows black.
    ///
    /// # Errors
    /// As [`Self::show`].
    pub fn darken(&mut self) -> Result<(), DeviceError> {
        self.darken_text().map_err(|text| DeviceError::Frame(format!("projector \"{}\": {text}", self.name)))
    }

    fn darken_text(&mut self) -> Result<(), String> {
        self.show(&vec![0; (self.size_px[0] * self.size_px[1]) as usize])
    }

    /// Shows a pattern: returns when the display has presented it, its pixels were read back, and the configured number of
    /// refreshes has passed.
    fn show(&mut self, pattern: &[u8]) -> Result<(), String> {
        self.draw(pattern).map_err(|error| lost(&error))?;
        let presented = if self.presents { Some(self.present()?) } else { None };
        if presented.is_none() {
            self.copy().map_err(|error| lost(&error))?;
        }
        self.check_shown(pattern)?;
        if let Some(refresh) = presented {
            return self.wait_for_refresh(refresh + u64::from(self.delay_refreshes));
        }
        // One more than asked for, because the copy may have come in the middle of a refresh.
        std::thread::sleep(self.refresh * (self.delay_refreshes + 1));
        Ok(())
    }

    /// Sends the pixels to the display, as many rows at once as a request holds.
    fn draw(&self, pattern: &[u8]) -> Result<(), Fault> {
        let [width, height] = self.size_px.map(|size| size as usize);
        let bytes = self.layout.drawn(pattern);
        // The head of the request takes 28 bytes at most.
        let most = self.connection.maximum_request_bytes().saturating_sub(64);
        let rows = (most / (width * 4)).clamp(1, height);
        for (number, part) in bytes.chunks(rows * width * 4).enumerate() {
            let (top, count) = (number * rows, part.len() / (width * 4));
            self.connection.put_image(
                ImageFormat::Z_PIXMAP,
                self.picture,
                self.context,
                width as u16,
                count as u16,
                0,
                top as i16,
                0,
                self.layout.depth,
                part,
            )?;
        }
        Ok(())
    }

    fn copy(&self) -> Result<(), Fault> {
        let [width, height] = self.size_px.map(|size| size as u16);
        let c = &self.connection;
        c.copy_area(self.picture, self.window, self.context, 0, 0, 0, 0, width, height)?.check()?;
        Ok(())
    }

    /// Hands the picture to the display; the number of the refresh that it came with.
    fn present(&mut self) -> Result<u64, String> {
        self.serial = self.serial.wrapping_add(1);
        let asked = || -> Result<(), Fault> {
            // Copied rather than exchanged, so that the picture may be drawn on again.
            let how = present::Option::COPY.into();
            let (window, picture, serial) = (self.window, self.picture, self.serial);
            let c = &self.connection;
            c.present_pixmap(window, picture, serial, 0, 0, 0, 0, 0, 0, 0, how, 0, 0, 0, &[])?.check()?;
            Ok(())
        };
        asked().map_err(|error| lost(&error))?;
        let event = self.completed(present::CompleteKind::PIXMAP)?;
        if event.mode == present::CompleteMode::SKIP {
            return Err("the display has left the pattern out; is the output switched off?".into());
        }
        Ok(event.msc)
    }

    fn wait_for_refresh(&mut self, number: u64) -> Result<(), String> {
        if !self.presents || self.delay_refreshes == 0 {
            return Ok(());
        }
        self.serial = self.serial.wrapping_add(1);
        let asked = || -> Result<(), Fault> {
            self.connection.present_notify_msc(self.window, self.serial, number, 0, 0)?.check()?;
            Ok(())
        };
        asked().map_err(|error| lost(&error))?;
        self.completed(present::CompleteKind::NOTIFY_MSC).map(|_| ())
    }

    /// Waits until the display tells that the last request is done.
    fn completed(&self, kind: present::CompleteKind) -> Result<present::CompleteNotifyEvent, String> {
        let until = Instant::now() + PRESENT_WAIT + self.refresh * self.delay_refreshes;
        loop {
            while let Some(event) = self.connection.poll_for_event().map_err(|error| lost(&error.into()))? {
                match event {
                    Event::PresentCompleteNotify(event)
                        if event.kind == kind
                            && event.serial == self.serial
                            && event.window == self.window =>
                    {
                        return Ok(event);
                    }
                    _ => {}
                }
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(format!(
                    "the display has not presented the pattern within {} s; is the output switched off or asleep?",
                    PRESENT_WAIT.as_secs()
                ));
            }
            let wait = Timespec {
                tv_sec: 0,
                tv_nsec: i64::from(left.min(Duration::from_millis(100)).subsec_nanos()),
            };
            let mut readable = [PollFd::new(self.connection.stream(), PollFlags::IN)];
            poll(&mut readable, Some(&wait))
                .or_else(|e| if e == rustix::io::Errno::INTR { Ok(0) } else { Err(e) })
                .map_err(|error| error.to_string())?;
        }
    }

    /// What stands on the desktop is the pattern, and nothing lies over it. (What a window gives back where another one covers it is
    /// not defined.)
    fn check_shown(&self, pattern: &[u8]) -> Result<(), String> {
        let [width, height] = self.size_px.map(|size| size as u16);
        let [x, y] = self.corner;
        let read = || -> Result<Vec<u8>, Fault> {
            let format = ImageFormat::Z_PIXMAP;
            Ok(self.connection.get_image(format, self.root, x, y, width, height, !0)?.reply()?.data)
        };
        let bytes = read().map_err(|error| lost(&error))?;
        if bytes.len() != pattern.len() * 4 {
            return Err(format!(
                "the display gives {} bytes of the window back instead of {}",
                bytes.len(),
                pattern.len() * 4
            ));
        }
        let Some((count, first)) = self.layout.differs(&bytes, pattern) else { return Ok(()) };
        // The next pattern shall not fail for the same reason where that can be helped.
        let above = ConfigureWindowAux::new().stack_mode(StackMode::ABOVE);
        if let Ok(raised) = self.connection.configure_window(self.window, &above) {
            let _ = raised.check();
        }
        let width = usize::from(width);
        Err(format!(
            "{count} pixels on the screen are not those of the pattern, the first at column {}, row {}; does a window lie over \
             it?",
            first % width,
            first / width
        ))
    }
}

/// What the connection to the display can report.
type Fault = Box<dyn std::error::Error>;

fn lost(error: &Fault) -> String {
    format!("the X11 display does not take it ({error}); does it still run?")
}

fn id(connection: &RustConnection) -> Result<u32, String> {
    connection.generate_id().map_err(|error| lost(&error.into()))
}

/// Whether the display has the extension that tells when a picture stands.
fn presents(connection: &RustConnection) -> Result<bool, Fault> {
    if connection.extension_information(present::X11_EXTENSION_NAME)?.is_none() {
        return Ok(false);
    }
    connection.present_query_version(1, 0)?.reply()?;
    Ok(true)
}

/// A screen that shows the sequence of its projector.
pub(crate) struct ScreenProjector {
    screen: Screen,
    projector: ProjectorConfig,
}

impl ScreenProjector {
    /// Opens the window over the output of the projector.
    pub fn open(projector: &ProjectorConfig, settings: &ScreenSettings) -> Result<Self, DeviceError> {
        Ok(Self { screen: Screen::open(projector, settings)?, projector: projector.clone() })
    }
}

impl Light for ScreenProjector {
    fn show(&mut self, frame: usize) -> Result<(), DeviceError> {
        self.screen.show_frame(&self.projector, frame)
    }

    fn darken(&mut self) -> Result<(), DeviceError> {
        self.screen.darken()
    }
}
