//! What the driver needs of the way by which a camera is reached: its features by name, and its frames.

use crate::device::LinkCounts;
use std::time::Duration;

/// Bytes that may at least wait while the receiver does not run.
pub(crate) const LEAST_SOCKET_BYTES: usize = 8 << 20;

/// Packets that may be asked for again, over those of a frame: lost ones are asked for until all are there.
pub(super) const REQUEST_RATIO: f64 = 2.0;

/// How long a frame may wait for its lost packets.
pub(super) const RETENTION: Duration = Duration::from_millis(500);

/// Block numbers of 16 bits (GigE Vision before its version 2) run from 1 to this one.
pub(super) const LAST_BLOCK: u64 = 65_535;

/// The text of a library's error.
pub(super) fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

/// A frame as it came.
pub(crate) struct Received {
    /// Number that the camera gave it.
    pub id: u64,
    /// Why it is not whole; `None`: it is.
    pub fault: Option<String>,
    /// Columns and rows that it states, px.
    pub size_px: [u32; 2],
    /// Number of its pixel format (GenICam).
    pub pixel_format: u32,
    /// Its bytes, as the camera sent them.
    pub pixels: Box<dyn AsRef<[u8]>>,
}

/// How the frames of a camera shall come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Streaming {
    /// Bytes of a frame as the camera sends it.
    pub payload: usize,
    /// Frames that the receiver keeps.
    pub buffers: usize,
    /// Bytes that may wait while the receiver does not run.
    pub socket_bytes: usize,
    /// Bytes of a packet; absent: the largest that arrives.
    pub packet_bytes: Option<u16>,
    /// Pause between two packets, ticks of the camera's clock; absent: as the camera is.
    pub packet_delay_ticks: Option<u32>,
}

/// A connection to a camera. Errors are texts of the library, without the camera's name.
pub(crate) trait Link: Send {
    /// Model and serial number.
    fn identity(&mut self) -> [String; 2];
    /// Whether the camera describes this feature.
    fn has(&self, key: &str) -> bool;
    /// Runs a command of the camera.
    fn execute(&mut self, key: &str) -> Result<(), String>;
    /// Reads a feature that is a whole number.
    fn integer(&mut self, key: &str) -> Result<i64, String>;
    /// Writes a feature that is a whole number.
    fn set_integer(&mut self, key: &str, value: i64) -> Result<(), String>;
    /// Least value, largest value and step of a whole number.
    fn integer_limits(&mut self, key: &str) -> Option<[i64; 3]>;
    /// Reads a feature that is a number.
    fn float(&mut self, key: &str) -> Result<f64, String>;
    /// Writes a feature that is a number.
    fn set_float(&mut self, key: &str, value: f64) -> Result<(), String>;
    /// Least and largest value of a number.
    fn float_limits(&mut self, key: &str) -> Option<[f64; 2]>;
    /// Reads the entry that is chosen.
    fn entry(&mut self, key: &str) -> Result<String, String>;
    /// Chooses an entry of a list.
    fn set_entry(&mut self, key: &str, value: &str) -> Result<(), String>;
    /// All entries that may be chosen.
    fn entries(&mut self, key: &str) -> Option<Vec<String>>;
    /// Reads whether a switch is on.
    fn switch(&mut self, key: &str) -> Result<bool, String>;
    /// Switches a feature on or off.
    fn set_switch(&mut self, key: &str, value: bool) -> Result<(), String>;
    /// The next reading of each feature comes from the device.
    fn forget(&mut self);
    /// Reads a bootstrap register of GigE Vision.
    fn register(&self, register: u32) -> Result<u32, String>;

    /// Opens the stream, before the acquisition starts.
    fn open(&mut self, streaming: Streaming) -> Result<(), String>;
    /// Bytes of a packet of the open stream; `None`: it has no packets.
    fn packet_bytes(&self) -> Option<u16>;
    /// The next frame, if one comes in time.
    fn next(&mut self, patience: Duration) -> Option<Received>;
    /// Numbers of all frames that have come, which are thrown away.
    fn discard(&mut self) -> Vec<u64>;
    /// The number due after `last`; where the numbers may end at 16 bits or go on, the one that fits `got`.
    fn due(&self, last: u64, got: u64) -> u64;
    /// What has come, and what not, so far.
    fn counts(&self) -> LinkCounts;
    /// Whether the camera still answers this client.
    fn is_connected(&self) -> bool;
}

/// The exposure time; older cameras have it by another name.
pub(crate) fn exposure_key(link: &dyn Link) -> &'static str {
    if link.has("ExposureTime") { "ExposureTime" } else { "ExposureTimeAbs" }
}
