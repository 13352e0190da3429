//! What real devices need to be found: cameras and projectors on the network.

use super::raw::{RawCamera, RawProjector};
use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::rig_file::unknown;
use cell::configuration::{CameraConfig, Driver};
use cell::genicam_camera::{GenicamCamera, Transport};
use cell::pixel_format::PixelFormat;
use std::net::{IpAddr, SocketAddr};

/// Exposure times of cameras, µs.
const EXPOSURE_US: [f64; 2] = [1.0, 1e7];

/// Gains of cameras, dB.
const GAIN_DB: [f64; 2] = [0.0, 100.0];

/// Farthest column or row of a sensor at which a frame begins, px.
const MOST_OFFSET_PX: u32 = 65_534;

/// Packets, IP and UDP header included: what every network carries, and what a jumbo frame holds with room to spare.
const PACKET_BYTES: [u16; 2] = [576, 16_000];

/// Keys that a camera has on a network alone.
const NETWORK_KEYS: [&str; 4] = ["address", "packet_bytes", "packet_delay_ticks", "ptp"];

/// Input of a camera where none is named: the first one.
const TRIGGER_LINE: &str = "Line1";

/// How a camera with the driver "genicam" is found and set; `None` for another driver.
pub(super) fn genicam(
    document: &Document,
    key: &str,
    raw: &RawCamera,
) -> Result<Option<GenicamCamera>, FileError> {
    let written = [
        ("transport", raw.transport.is_some()),
        ("address", raw.address.is_some()),
        ("serial", raw.serial.is_some()),
        ("pixel_format", raw.pixel_format.is_some()),
        ("exposure_us", raw.exposure_us.is_some()),
        ("gain_db", raw.gain_db.is_some()),
        ("offset_px", raw.offset_px.is_some()),
        ("packet_bytes", raw.packet_bytes.is_some()),
        ("packet_delay_ticks", raw.packet_delay_ticks.is_some()),
        ("ptp", raw.ptp.is_some()),
        ("trigger_line", raw.trigger_line.is_some()),
    ];
    if raw.driver != "genicam" {
        return match written.iter().find(|(_, present)| *present) {
            Some((part, _)) => Err(needs(document, &format!("{key}.{part}"), &raw.driver, "genicam")),
            None => Ok(None),
        };
    }
    let transport = transport(document, key, raw)?;
    if transport == Transport::Usb3 {
        no_network(document, key, raw, &written)?;
    }
    let address = raw.address.as_ref().map(|text| {
        text.parse::<IpAddr>().map_err(|_| {
            let problem = value(format!("{text:?}"), "an IP address");
            document.fault(&format!("{key}.address"), problem, "for instance \"192.168.1.10\"")
        })
    });
    if raw.address.is_some() == raw.serial.is_some() {
        let problem = Problem::Missing(format!("either address or serial of camera \"{}\"", raw.name));
        return Err(document.fault(key, problem, "`fringetool cameras` lists both; write one of them"));
    }
    Ok(Some(GenicamCamera {
        transport,
        address: address.transpose()?,
        serial: raw.serial.clone(),
        pixel_format: pixel_format(document, key, raw)?,
        exposure_us: within_if_there(
            document,
            &format!("{key}.exposure_us"),
            raw.exposure_us,
            EXPOSURE_US,
            "µs",
        )?,
        gain_db: within_if_there(document, &format!("{key}.gain_db"), raw.gain_db, GAIN_DB, "dB")?,
        offset_px: offset_px(document, key, raw)?,
        packet_bytes: packet_bytes(document, key, raw)?,
        packet_delay_ticks: raw.packet_delay_ticks,
        ptp: raw.ptp,
        trigger_line: raw.trigger_line.clone().unwrap_or_else(|| TRIGGER_LINE.to_owned()),
    }))
}

fn transport(document: &Document, key: &str, raw: &RawCamera) -> Result<Transport, FileError> {
    let Some(name) = &raw.transport else { return Ok(Transport::default()) };
    let known = Transport::ALL.map(Transport::name);
    Transport::ALL
        .into_iter()
        .find(|transport| transport.name() == name)
        .ok_or_else(|| unknown(document, &format!("{key}.transport"), "transport", name, known))
}

/// A camera on USB is found by its serial number, and has nothing that belongs to a network.
fn no_network(
    document: &Document,
    key: &str,
    raw: &RawCamera,
    written: &[(&str, bool)],
) -> Result<(), FileError> {
    let is_network = |part: &str| NETWORK_KEYS.contains(&part);
    if let Some((part, _)) = written.iter().find(|(part, present)| *present && is_network(part)) {
        let problem = Problem::Unsupported(
            "a camera with transport = \"usb3\" has no such key: it is not on a network".into(),
        );
        let remedy = if *part == "address" {
            "write its serial number (serial); `fringetool cameras` lists it"
        } else {
            "remove it, or use transport = \"gige\""
        };
        return Err(document.fault(&format!("{key}.{part}"), problem, remedy));
    }
    if raw.serial.is_none() {
        let problem = Problem::Missing(format!("serial of camera \"{}\"", raw.name));
        return Err(document.fault(key, problem, "write its serial number; `fringetool cameras` lists it"));
    }
    Ok(())
}

/// No two cameras of a cell are the same device, as far as the configuration states it.
pub(super) fn check_apart(document: &Document, cameras: &[CameraConfig]) -> Result<(), FileError> {
    let device = |camera: &CameraConfig| {
        let genicam = camera.genicam.as_ref()?;
        let address = genicam.address.map(|address| ("address", address.to_string()));
        address.or(genicam.serial.clone().map(|serial| ("serial", serial)))
    };
    for (index, camera) in cameras.iter().enumerate() {
        let Some((part, here)) = device(camera) else { continue };
        let same = |other: &&CameraConfig| device(other).is_some_and(|there| there == (part, here.clone()));
        if let Some(other) = cameras[..index].iter().find(same) {
            let problem = Problem::Disagreement {
                what: "cameras",
                here: format!("camera \"{}\" has the {part} \"{here}\"", camera.name),
                there: format!("camera \"{}\" too", other.name),
            };
            let remedy = "each camera is a device of its own; `fringetool cameras` lists them";
            return Err(document.fault(&format!("camera[{index}].{part}"), problem, remedy));
        }
    }
    Ok(())
}

/// The first column and row of the window; the frame of the rig file begins there.
fn offset_px(document: &Document, key: &str, raw: &RawCamera) -> Result<Option<[u32; 2]>, FileError> {
    match raw.offset_px {
        Some([x, y]) if x.max(y) > MOST_OFFSET_PX => {
            let problem = value(format!("[{x}, {y}]"), format!("0 … {MOST_OFFSET_PX} px each"));
            let remedy = "column and row of the sensor at which the frame of the rig file begins";
            Err(document.fault(&format!("{key}.offset_px"), problem, remedy))
        }
        offset_px => Ok(offset_px),
    }
}

fn packet_bytes(document: &Document, key: &str, raw: &RawCamera) -> Result<Option<u16>, FileError> {
    let [least, most] = PACKET_BYTES;
    match raw.packet_bytes {
        Some(bytes) if !(least..=most).contains(&bytes) || !bytes.is_multiple_of(4) => {
            let problem = value(bytes, format!("{least} … {most} bytes in steps of 4"));
            let remedy =
                "leave the key out for the largest packets that arrive; `fringetool doctor` tries them";
            Err(document.fault(&format!("{key}.packet_bytes"), problem, remedy))
        }
        bytes => Ok(bytes),
    }
}

fn pixel_format(document: &Document, key: &str, raw: &RawCamera) -> Result<PixelFormat, FileError> {
    let Some(name) = &raw.pixel_format else { return Ok(PixelFormat::default()) };
    let known = PixelFormat::ALL.map(PixelFormat::name);
    PixelFormat::ALL
        .into_iter()
        .find(|format| format.name() == name)
        .ok_or_else(|| unknown(document, &format!("{key}.pixel_format"), "pixel format", name, known))
}

/// Address of a projector with the driver "network"; `None` for another driver.
pub(super) fn network_address(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    driver: Driver,
) -> Result<Option<SocketAddr>, FileError> {
    let key = format!("{key}.address");
    match (&raw.address, driver == Driver::Network) {
        (None, false) => Ok(None),
        (Some(_), false) => Err(needs(document, &key, &raw.driver, "network")),
        (None, true) => {
            let problem = Problem::Missing(format!("address of projector \"{}\"", raw.name));
            Err(document.fault(&key, problem, "add address = \"127.0.0.1:3957\", where the program listens"))
        }
        (Some(text), true) => text.parse().map(Some).map_err(|_| {
            let problem = value(format!("{text:?}"), "an IP address and a port");
            document.fault(&key, problem, "for instance \"127.0.0.1:3957\"")
        }),
    }
}

/// The fault of a key that only another driver has.
pub(super) fn needs(document: &Document, key: &str, driver: &str, other: &str) -> FileError {
    let problem = Problem::Unsupported(format!("a device with the driver \"{driver}\" has no such key"));
    document.fault(key, problem, format!("remove it, or use the driver \"{other}\""))
}

/// A number within its limits.
pub(super) fn within(
    document: &Document,
    key: &str,
    found: f64,
    [least, most]: [f64; 2],
    unit: &str,
) -> Result<f64, FileError> {
    if (least..=most).contains(&found) {
        return Ok(found);
    }
    Err(document.fault(key, value(found, format!("{least} … {most} {unit}")), ""))
}

/// The same of a key that may be absent.
pub(super) fn within_if_there(
    document: &Document,
    key: &str,
    found: Option<f64>,
    limits: [f64; 2],
    unit: &str,
) -> Result<Option<f64>, FileError> {
    found.map(|found| within(document, key, found, limits, unit)).transpose()
}
