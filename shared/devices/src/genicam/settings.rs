//! Settings of a camera: each is written, read back from the device and compared.

use super::WantedCamera;
use super::link::{Link, exposure_key};
use crate::error::DeviceError;
use std::fmt::Display;
use std::time::{Duration, Instant};
use telegenic::gige::proto::bootstrap::{STREAM_CHANNEL_PACKET_DELAY, STREAM_CHANNEL_PACKET_SIZE};

/// Numbers with a fraction that differ by more than this part are others: cameras round to their clock and steps.
const ROUNDING: f64 = 0.01;

/// What is switched off where a camera has it: grey values are proportional to light, and of one exposure.
const AUTOMATIC: [&str; 2] = ["ExposureAuto", "GainAuto"];

/// Switch, state and update of the camera's clock that follows the network's: by the names of the Standard Features Naming
/// Convention, and by those before its version 2.
const CLOCKS: [[&str; 3]; 2] = [
    ["PtpEnable", "PtpStatus", "PtpDataSetLatch"],
    ["GevIEEE1588", "GevIEEE1588Status", "GevIEEE1588DataSetLatch"],
];

/// A camera that is being set.
pub(super) struct Settings<'a> {
    link: &'a mut dyn Link,
    /// Name of the camera, for messages.
    name: &'a str,
}

/// How a kind of value is written and read, what is close enough, and what the device takes.
struct Kind<T> {
    write: fn(&mut dyn Link, &str, &T) -> Result<(), String>,
    read: fn(&mut dyn Link, &str) -> Result<T, String>,
    same: fn(&T, &T) -> bool,
    takes: fn(&mut dyn Link, &str) -> Option<String>,
}

const INTEGER: Kind<i64> = Kind {
    write: |link, key, value| link.set_integer(key, *value),
    read: |link, key| link.integer(key),
    same: |is, wanted| is == wanted,
    takes: |link, key| {
        let [least, most, step] = link.integer_limits(key)?;
        let steps = if step > 1 { format!(" in steps of {step}") } else { String::new() };
        (least > i64::MIN && most < i64::MAX).then(|| format!("{least} … {most}{steps}"))
    },
};

const FLOAT: Kind<f64> = Kind {
    write: |link, key, value| link.set_float(key, *value),
    read: |link, key| link.float(key),
    same: |is, wanted| (is - wanted).abs() <= ROUNDING * wanted.abs().max(0.1),
    takes: |link, key| {
        let [least, most] = link.float_limits(key)?;
        (least > f64::MIN && most < f64::MAX).then(|| format!("{least} … {most}"))
    },
};

const NAME: Kind<String> = Kind {
    write: |link, key, value| link.set_entry(key, value),
    read: |link, key| link.entry(key),
    same: |is, wanted| is == wanted,
    takes: |link, key| link.entries(key).map(|entries| entries.join(", ")),
};

const SWITCH: Kind<bool> = Kind {
    write: |link, key, value| link.set_switch(key, *value),
    read: |link, key| link.switch(key),
    same: |is, wanted| is == wanted,
    takes: |_, _| None,
};

impl<'a> Settings<'a> {
    /// Of this camera; `name` is that of the configuration.
    pub fn of(link: &'a mut dyn Link, name: &'a str) -> Self {
        Self { link, name }
    }

    /// Sets all that the configuration states, before the stream opens; the exposure time. The clock may take `clock_wait` until
    /// it follows the network's.
    pub fn apply(&mut self, wanted: &WantedCamera, clock_wait: Duration) -> Result<Duration, DeviceError> {
        let settings = &wanted.settings;
        // A client that died may have left it running, or for one frame only.
        let _ = self.link.execute("AcquisitionStop");
        self.choose_if_there("AcquisitionMode", "Continuous")?;
        self.choose("PixelFormat", settings.pixel_format.name(), "pixel_format")?;
        self.region(settings.offset_px, wanted.size_px)?;
        self.trigger(wanted)?;
        for key in AUTOMATIC {
            self.choose_if_there(key, "Off")?;
        }
        self.choose_if_there("ExposureMode", "Timed")?;
        if let Some(gain_db) = settings.gain_db {
            self.exchange(&FLOAT, "Gain", gain_db, "gain_db, dB")?;
        }
        let exposure = exposure_key(self.link);
        if let Some(exposure_us) = settings.exposure_us {
            self.exposure_us(exposure_us)?;
        }
        if let Some(on) = settings.ptp {
            self.clock(on, clock_wait)?;
        }
        let exposure_us = self.link.float(exposure).unwrap_or(0.0);
        Ok(Duration::from_secs_f64(exposure_us.clamp(0.0, 1e7) * 1e-6))
    }

    /// Sets the exposure time; the one that the camera took, µs.
    pub fn exposure_us(&mut self, exposure_us: f64) -> Result<f64, DeviceError> {
        let key = exposure_key(self.link);
        self.exchange(&FLOAT, key, exposure_us, "exposure_us, µs")
    }

    /// Packets of the open stream are as large and as far from each other as the configuration states.
    pub fn check_stream(&self, wanted: &WantedCamera) -> Result<(), DeviceError> {
        let settings = &wanted.settings;
        let size = settings.packet_bytes.map(u32::from);
        let registers = [
            ("GevSCPSPacketSize", STREAM_CHANNEL_PACKET_SIZE, 0xffff, size, "packet_bytes"),
            (
                "GevSCPD",
                STREAM_CHANNEL_PACKET_DELAY,
                u32::MAX,
                settings.packet_delay_ticks,
                "packet_delay_ticks",
            ),
        ];
        for (key, register, mask, asked, source) in registers {
            let Some(asked) = asked else { continue };
            let is = self.link.register(register).map_err(|e| self.fault(key, e))? & mask;
            if is != asked {
                return Err(self.fault(key, format!("{asked} was asked for ({source}), the camera has {is}")));
            }
        }
        Ok(())
    }

    fn fault(&self, key: &str, reason: impl Display) -> DeviceError {
        DeviceError::Frame(format!("camera \"{}\": {key}: {reason}", self.name))
    }

    /// Writes a value, reads it back from the device and compares; the value that the camera took. `source`: where the value comes
    /// from, for messages.
    fn exchange<T: Display + Clone>(
        &mut self,
        kind: &Kind<T>,
        key: &str,
        value: T,
        source: &str,
    ) -> Result<T, DeviceError> {
        let refused = (kind.write)(self.link, key, &value).err();
        // Else some descriptions give back what was written.
        self.link.forget();
        let is = (kind.read)(self.link, key).map_err(|error| self.fault(key, error))?;
        // What cannot be written may be as wanted from the start.
        if (kind.same)(&is, &value) {
            return Ok(is);
        }
        let source = if source.is_empty() { String::new() } else { format!(" ({source})") };
        let refused = refused.map_or_else(String::new, |error| format!(" ({error})"));
        let takes = (kind.takes)(self.link, key).map_or_else(String::new, |all| format!("; it takes {all}"));
        Err(self.fault(key, format!("{value} was asked for{source}, the camera has {is}{refused}{takes}")))
    }

    fn choose(&mut self, key: &str, entry: &str, source: &str) -> Result<(), DeviceError> {
        self.exchange(&NAME, key, entry.to_owned(), source).map(|_| ())
    }

    /// The same of a feature that not every camera has, or that it describes without having it.
    fn choose_if_there(&mut self, key: &str, entry: &str) -> Result<(), DeviceError> {
        if self.link.entry(key).is_ok() { self.choose(key, entry, "") } else { Ok(()) }
    }

    /// The window of the sensor: its size is that of the rig file.
    fn region(&mut self, offset_px: Option<[u32; 2]>, size_px: [u32; 2]) -> Result<(), DeviceError> {
        const CORNER: [&str; 2] = ["OffsetX", "OffsetY"];
        const SIZE: [&str; 2] = ["Width", "Height"];
        let size = size_px.map(i64::from);
        let corner = CORNER.map(|key| self.link.integer(key).unwrap_or(0));
        let is_size = SIZE.iter().zip(size).all(|(key, size)| self.link.integer(key).ok() == Some(size));
        let mut begins = String::new();
        if !is_size && offset_px.is_some() {
            // A window grows only as far as its corner leaves room; what goes wrong here shows below.
            for key in CORNER {
                let _ = self.link.set_integer(key, 0);
            }
        } else if corner != [0, 0] {
            let [column, row] = corner;
            begins = format!(
                "; the window begins at column {column}, row {row} of the sensor: write offset_px to move it"
            );
        }
        let source = format!("width_px and height_px of the rig file{begins}");
        for (key, size) in SIZE.iter().zip(size) {
            self.exchange(&INTEGER, key, size, &source)?;
        }
        let Some(offset_px) = offset_px else { return Ok(()) };
        for (key, offset) in CORNER.iter().zip(offset_px) {
            if self.link.has(key) {
                self.exchange(&INTEGER, key, offset.into(), "offset_px")?;
            } else if offset != 0 {
                return Err(self.fault(
                    key,
                    format!("{offset} was asked for (offset_px), the camera has no such feature"),
                ));
            }
        }
        Ok(())
    }

    fn trigger(&mut self, wanted: &WantedCamera) -> Result<(), DeviceError> {
        let fired = wanted.fired > 0;
        if self.link.has("TriggerSelector") {
            self.choose("TriggerSelector", "FrameStart", "")?;
        }
        self.choose("TriggerMode", "On", "")?;
        if !fired {
            return self.choose("TriggerSource", "Software", "trigger = \"stepped\"");
        }
        self.choose("TriggerSource", &wanted.settings.trigger_line, "trigger_line")?;
        // A board's output is high while a pattern is exposed.
        self.choose_if_there("TriggerActivation", "RisingEdge")
    }

    /// Switches the clock that follows the network's on or off, and waits until it follows.
    fn clock(&mut self, on: bool, wait: Duration) -> Result<(), DeviceError> {
        let known = CLOCKS.into_iter().find(|[switch, ..]| self.link.has(switch));
        let Some([switch, state, update]) = known else {
            let reason =
                "the camera has neither this feature nor GevIEEE1588; remove ptp from the configuration";
            return Err(self.fault("PtpEnable", reason));
        };
        self.exchange(&SWITCH, switch, on, "ptp")?;
        if !on {
            return Ok(());
        }
        let start = Instant::now();
        loop {
            if self.link.has(update) {
                self.link.execute(update).map_err(|error| self.fault(update, error))?;
            }
            self.link.forget();
            let is = self.link.entry(state).map_err(|error| self.fault(state, error))?;
            if matches!(is.as_str(), "Slave" | "Master") {
                return Ok(());
            }
            if start.elapsed() >= wait {
                return Err(self.fault(
                    state,
                    format!(
                        "Slave or Master was asked for (ptp), the camera has {is} after {:.1} s; is there a PTP clock on its \
                         network, and does the switch pass its messages?",
                        start.elapsed().as_secs_f64()
                    ),
                ));
            }
            std::thread::sleep(Duration::from_millis(100));
        }
    }
}
