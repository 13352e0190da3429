//! How reports reach a board: USB, or a socket behind which an emulated board answers.

use hidapi::{HidApi, HidDevice};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// Bytes of a report, without its number (DLPU010 1.2, DLPU018 1.2: reports of 64 bytes with the number 0).
pub const REPORT_BYTES: usize = 64;

/// A report, without its number.
pub type Report = [u8; REPORT_BYTES];

/// Carries reports to a board and back.
pub trait Transport: Send {
    /// Sends a report.
    ///
    /// # Errors
    /// The device is gone.
    fn send(&mut self, report: &Report) -> io::Result<()>;

    /// Waits for a report; the number of bytes that came, 0 when none came in time.
    ///
    /// # Errors
    /// The device is gone.
    fn receive(&mut self, report: &mut Report, wait: Duration) -> io::Result<usize>;
}

/// USB: vendor and product of the boards, as their controllers announce themselves.
const VENDOR: u16 = 0x0451;

/// Opens the board of this product: by path, by serial number, or the only one there is.
///
/// # Errors
/// There is none, there are several, or it may not be opened; the text states what to do.
pub fn open(product: u16, device: Option<&str>) -> Result<(Box<dyn Transport>, String), String> {
    let path = device.map(Path::new).filter(|path| path.is_absolute());
    if let Some(path) = path
        && path.metadata().is_ok_and(|found| found.file_type().is_socket())
    {
        let stream = UnixStream::connect(path).map_err(|error| format!("{}: {error}", path.display()))?;
        return Ok((Box::new(Socket(stream)), path.display().to_string()));
    }
    let usb = HidApi::new().map_err(|error| format!("USB devices cannot be listed: {error}"))?;
    // A board that announces several interfaces takes commands on the first.
    let boards: Vec<_> = usb
        .device_list()
        .filter(|found| found.vendor_id() == VENDOR && found.product_id() == product)
        .filter(|found| found.interface_number() <= 0)
        .collect();
    let listed = || {
        let of = |found: &&hidapi::DeviceInfo| {
            format!("{} (serial \"{}\")", found.path().to_string_lossy(), found.serial_number().unwrap_or(""))
        };
        boards.iter().map(of).collect::<Vec<_>>().join(", ")
    };
    let chosen: Vec<_> = boards
        .iter()
        .filter(|found| match (path, device) {
            (Some(path), _) => found.path().to_bytes() == path.as_os_str().as_encoded_bytes(),
            (None, Some(serial)) => found.serial_number() == Some(serial),
            (None, None) => true,
        })
        .collect();
    let board = match chosen.as_slice() {
        [board] => board,
        [] if boards.is_empty() => {
            return Err(format!(
                "no board is connected (USB {VENDOR:04x}:{product:04x}); connect it and switch it on; `lsusb` lists what is \
                 there"
            ));
        }
        [] => {
            return Err(format!(
                "device = \"{}\" is not connected; found: {}",
                device.unwrap_or(""),
                listed()
            ));
        }
        _ => {
            return Err(format!(
                "several boards are connected: {}; name one of them by device = \"…\"",
                listed()
            ));
        }
    };
    let name = board.path().to_string_lossy().into_owned();
    let opened = board.open_device(&usb).map_err(|error| {
        format!(
            "{name} cannot be opened: {error}; a udev rule must let this user write it (docs/hardware.md)"
        )
    })?;
    Ok((Box::new(Usb(opened)), name))
}

struct Usb(HidDevice);

impl Transport for Usb {
    fn send(&mut self, report: &Report) -> io::Result<()> {
        let mut numbered = [0; REPORT_BYTES + 1];
        numbered[1..].copy_from_slice(report);
        match self.0.write(&numbered).map_err(io::Error::other)? {
            // With or without the number of the report: systems differ.
            REPORT_BYTES.. => Ok(()),
            sent => Err(io::Error::other(format!("only {sent} of {REPORT_BYTES} bytes were sent"))),
        }
    }

    fn receive(&mut self, report: &mut Report, wait: Duration) -> io::Result<usize> {
        let wait_ms = i32::try_from(wait.as_millis()).unwrap_or(i32::MAX);
        self.0.read_timeout(report, wait_ms).map_err(io::Error::other)
    }
}

/// Reports of an emulated board, one after another.
struct Socket(UnixStream);

impl Transport for Socket {
    fn send(&mut self, report: &Report) -> io::Result<()> {
        self.0.write_all(report)
    }

    fn receive(&mut self, report: &mut Report, wait: Duration) -> io::Result<usize> {
        // A socket refuses to wait for no time at all.
        self.0.set_read_timeout(Some(wait.max(Duration::from_micros(100))))?;
        match self.0.read(report) {
            Ok(0) => Err(io::Error::new(ErrorKind::UnexpectedEof, "the device has gone")),
            Ok(count) => Ok(count),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => Ok(0),
            Err(error) => Err(error),
        }
    }
}
