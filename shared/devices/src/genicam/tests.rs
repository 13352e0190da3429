//! Settings of a camera against simulated ones on loopback: what is set arrives, and what is not as asked is told with both values.

use super::{GenicamDevice, WantedCamera};
use crate::device::Camera as _;
use crate::gige_simulator::registers::{bootstrap, feature};
use crate::gige_simulator::{Faults, FrameSource, Identity, NoFrame, Pattern, Quirks, Server};
use cell::genicam_camera::{GenicamCamera, Transport};
use cell::pixel_format::PixelFormat;
use std::net::Ipv4Addr;
use std::time::Duration;
use telegenic::GenICamera;
use telegenic::gige::GigeConfig;

const SENSOR_PX: [u32; 2] = [64, 32];

/// The ways to a camera on the network that this program has: each passes all tests.
const WAYS: &[Transport] =
    if cfg!(feature = "aravis") { &[Transport::Gige, Transport::Aravis] } else { &[Transport::Gige] };

/// Pixels that tell where they lie.
struct Ramp;

fn level(x: usize, y: usize) -> u8 {
    (x + 7 * y) as u8
}

impl FrameSource for Ramp {
    fn expose(&mut self, _: f32, _: Option<Pattern>, pixels: &mut Vec<u8>) -> Result<(), NoFrame> {
        let [width, height] = SENSOR_PX.map(|size| size as usize);
        *pixels = (0..height).flat_map(|y| (0..width).map(move |x| level(x, y))).collect();
        Ok(())
    }
}

/// A camera on an address of this test alone.
fn serve(test: u8, quirks: Quirks) -> (Server, Ipv4Addr) {
    let pid = std::process::id();
    let address = Ipv4Addr::new(127, 216 + (pid % 30) as u8, (pid / 30) as u8, test);
    let identity = Identity {
        address,
        mac: [2, 0, 0, 0, 0, test],
        serial: format!("S{test}"),
        user_name: String::new(),
        width_px: SENSOR_PX[0],
        height_px: SENSOR_PX[1],
        full_scale_dn: 255,
    };
    (Server::start(identity, Box::new(Ramp), Faults { quirks, ..Faults::default() }).unwrap(), address)
}

/// The settings of a camera that has its own of everything.
pub(super) fn settings(transport: Transport) -> GenicamCamera {
    GenicamCamera {
        transport,
        address: None,
        serial: None,
        pixel_format: PixelFormat::Mono8,
        exposure_us: None,
        gain_db: None,
        offset_px: None,
        packet_bytes: None,
        packet_delay_ticks: None,
        ptp: None,
        trigger_line: "Line1".into(),
    }
}

fn wanted(transport: Transport, address: Ipv4Addr, size_px: [u32; 2]) -> WantedCamera {
    WantedCamera {
        name: "cam1".into(),
        settings: GenicamCamera { address: Some(address.into()), ..settings(transport) },
        size_px,
        fired: 0,
    }
}

/// The camera with some settings; its clock may take a second.
fn open(
    transport: Transport,
    address: Ipv4Addr,
    size_px: [u32; 2],
    with: impl FnOnce(&mut GenicamCamera),
) -> Result<GenicamDevice, String> {
    let mut wanted = wanted(transport, address, size_px);
    with(&mut wanted.settings);
    GenicamDevice::new(wanted, Duration::from_secs(1)).map_err(|error| error.to_string())
}

fn refused(transport: Transport, address: Ipv4Addr, with: impl FnOnce(&mut GenicamCamera)) -> String {
    open(transport, address, SENSOR_PX, with).err().unwrap()
}

#[test]
fn a_window_of_the_sensor_is_set_and_seen() {
    for &way in WAYS {
        let (_server, address) = serve(1, Quirks::default());
        for ([x, y], [width, height]) in [([8, 4], [24, 10]), ([40, 0], [24, 32]), ([0, 22], [64, 10])] {
            let mut device = open(way, address, [width, height], |s| s.offset_px = Some([x, y])).unwrap();
            let mut frame = vec![0; (width * height) as usize];
            device.begin(0).unwrap();
            device.expose(0, 0, &mut frame).unwrap();
            let rows = (y as usize..).take(height as usize);
            let expected: Vec<u8> =
                rows.flat_map(|y| (x as usize..).take(width as usize).map(move |x| level(x, y))).collect();
            assert!(frame == expected, "{width} × {height} px at {x}, {y}");
        }
        // The window of the client before: the rig file has the whole sensor, and nobody states where it begins.
        let kept = open(way, address, SENSOR_PX, |_| ()).err().unwrap();
        assert!(
            kept.contains("camera \"cam1\": Height: 32 was asked for (width_px and height_px of the rig file; the window begins at column 0, row 22")
                && kept.contains("the camera has 10") && kept.contains("it takes 2 … 10 in steps of 2"),
            "{kept}"
        );
        open(way, address, SENSOR_PX, |s| s.offset_px = Some([0, 0])).unwrap();
    }
}

#[test]
fn windows_that_the_sensor_does_not_have_are_told_with_its_limits() {
    for &way in WAYS {
        let (_server, address) = serve(2, Quirks::default());
        for (offset_px, size_px, parts) in [
            (
                [44, 0],
                [24, 32],
                ["OffsetX: 44 was asked for (offset_px), the camera has 0", "it takes 0 … 40 in steps of 4"],
            ),
            ([6, 0], [24, 32], ["OffsetX: 6 was asked for (offset_px), the camera has 0", "in steps of 4"]),
            (
                [0, 9],
                [24, 10],
                ["OffsetY: 9 was asked for (offset_px), the camera has 0", "it takes 0 … 22 in steps of 2"],
            ),
            (
                [0, 0],
                [128, 32],
                [
                    "Width: 128 was asked for (width_px and height_px of the rig file)",
                    "it takes 4 … 64 in steps of 4",
                ],
            ),
            (
                [0, 0],
                [30, 32],
                ["Width: 30 was asked for (width_px and height_px of the rig file)", "in steps of 4"],
            ),
        ] {
            let error = open(way, address, size_px, |s| s.offset_px = Some(offset_px)).err().unwrap();
            assert!(error.starts_with("camera \"cam1\": "), "{error}");
            for part in parts {
                assert!(error.contains(part), "{error} lacks {part}");
            }
        }
    }
}

#[test]
fn values_that_the_camera_does_not_take_are_told_with_both() {
    for &way in WAYS {
        let (_server, address) = serve(3, Quirks::default());
        let exposure = refused(way, address, |s| s.exposure_us = Some(2e6));
        assert!(
            exposure.contains("ExposureTime: 2000000 was asked for (exposure_us, µs), the camera has 10000")
                && exposure.contains("it takes 10 … 1000000"),
            "{exposure}"
        );
        let gain = refused(way, address, |s| s.gain_db = Some(30.0));
        assert!(
            gain.contains("Gain: 30 was asked for (gain_db, dB), the camera has 0")
                && gain.contains("0 … 24"),
            "{gain}"
        );
        let format = refused(way, address, |s| s.pixel_format = PixelFormat::Mono12);
        assert!(
            format.contains("PixelFormat: Mono12 was asked for (pixel_format), the camera has Mono8")
                && format.contains("it takes Mono8"),
            "{format}"
        );
        let mut fired = wanted(way, address, SENSOR_PX);
        (fired.fired, fired.settings.trigger_line) = (3, "Line7".into());
        let line = GenicamDevice::new(fired, Duration::ZERO).err().unwrap().to_string();
        assert!(
            line.contains("TriggerSource: Line7 was asked for (trigger_line), the camera has Software")
                && line.contains("it takes Software, Line1"),
            "{line}"
        );
    }
}

#[test]
fn a_camera_that_takes_a_value_and_keeps_its_own_is_told() {
    for &way in WAYS {
        type With = fn(&mut GenicamCamera);
        let cases: [(u32, With, &str); 6] = [
            (
                feature::EXPOSURE_US,
                |s| s.exposure_us = Some(5000.0),
                "ExposureTime: 5000 was asked for (exposure_us, µs), the camera has 10000",
            ),
            (
                feature::OFFSET_Y,
                |s| s.offset_px = Some([0, 2]),
                "OffsetY: 2 was asked for (offset_px), the camera has 0",
            ),
            (feature::TRIGGER_MODE, |_| (), "TriggerMode: On was asked for, the camera has Off"),
            (
                feature::CLOCK,
                |s| s.ptp = Some(true),
                "PtpEnable: true was asked for (ptp), the camera has false",
            ),
            (
                bootstrap::STREAM_DELAY,
                |s| s.packet_delay_ticks = Some(700),
                "GevSCPD: 700 was asked for (packet_delay_ticks), the camera has 0",
            ),
            (
                bootstrap::STREAM_PACKET,
                |s| s.packet_bytes = Some(1200),
                "GevSCPSPacketSize: 1200 was asked for (packet_bytes), the camera has 1500",
            ),
        ];
        for (number, (register, with, expected)) in cases.into_iter().enumerate() {
            let (_server, address) =
                serve(10 + number as u8, Quirks { stuck: Some(register), ..Quirks::default() });
            let mut wanted = wanted(way, address, [64, 30]);
            wanted.settings.offset_px = Some([0, 0]);
            with(&mut wanted.settings);
            let error = GenicamDevice::new(wanted, Duration::ZERO).err().unwrap().to_string();
            assert!(
                error.contains("camera \"cam1\": ") && error.contains(expected),
                "{error} lacks {expected}"
            );
        }
    }
}

#[test]
fn packets_are_as_large_and_as_far_apart_as_asked_for() {
    for &way in WAYS {
        let (_server, address) = serve(4, Quirks::default());
        let mut device = open(way, address, SENSOR_PX, |s| {
            (s.packet_bytes, s.packet_delay_ticks) = (Some(576), Some(2000));
        })
        .unwrap();
        let mut frame = vec![0; 64 * 32];
        device.begin(0).unwrap();
        device.expose(0, 0, &mut frame).unwrap();
        // 540 bytes of pixels a packet, leader and trailer.
        assert_eq!(device.state().link.unwrap().packets, 2048_u64.div_ceil(540) + 2);
    }
}

#[test]
fn a_clock_that_follows_the_network_is_awaited() {
    for &way in WAYS {
        for (number, old_names) in [false, true].into_iter().enumerate() {
            let (_server, address) = serve(20 + number as u8, Quirks { old_names, ..Quirks::default() });
            let state = |device: &mut GenicamDevice| {
                device.link.entry(if old_names { "GevIEEE1588Status" } else { "PtpStatus" }).unwrap()
            };
            let mut device =
                open(way, address, SENSOR_PX, |s| (s.ptp, s.exposure_us) = (Some(true), Some(3000.0)))
                    .unwrap();
            assert_eq!(state(&mut device), "Slave");
            drop(device);
            // As the camera is.
            let mut device = open(way, address, SENSOR_PX, |_| ()).unwrap();
            assert_eq!(state(&mut device), "Slave");
            drop(device);
            let mut device = open(way, address, SENSOR_PX, |s| s.ptp = Some(false)).unwrap();
            assert_eq!(state(&mut device), "Disabled");
            drop(device);
            // A cycle after a loss does not wait for it.
            let mut wanted = wanted(way, address, SENSOR_PX);
            wanted.settings.ptp = Some(true);
            let early = GenicamDevice::new(wanted, Duration::ZERO).err().unwrap().to_string();
            let node = if old_names { "GevIEEE1588Status" } else { "PtpStatus" };
            assert!(
                early.contains(&format!(
                    "camera \"cam1\": {node}: Slave or Master was asked for (ptp), the camera has Listening"
                )),
                "{early}"
            );
        }
        let (_server, address) = serve(22, Quirks { no_clock: true, ..Quirks::default() });
        let alone = refused(way, address, |s| s.ptp = Some(true));
        assert!(
            alone.contains("the camera has Listening after 1.") && alone.contains("PTP clock"),
            "{alone}"
        );
    }
}

#[test]
fn what_another_client_left_is_set_right() {
    for &way in WAYS {
        let (_server, address) = serve(5, Quirks::default());
        let mut other = GenICamera::with_config(GigeConfig::new(address));
        other.connect().unwrap();
        other.set_enum("ExposureAuto", "Continuous").unwrap();
        other.execute("AcquisitionStart").unwrap();
        other.disconnect(Duration::from_secs(1));
        let mut device = open(way, address, SENSOR_PX, |s| s.exposure_us = Some(4000.0)).unwrap();
        assert_eq!(device.link.entry("ExposureAuto").unwrap(), "Off");
        assert!((device.link.float("ExposureTime").unwrap() - 4000.0).abs() < 1.0);
    }
}

#[test]
fn a_camera_that_vanishes_after_the_search_is_named() {
    for &way in WAYS {
        let (server, address) = serve(6, Quirks::default());
        drop(server);
        let gone = refused(way, address, |_| ());
        assert!(gone.starts_with(&format!("camera \"cam1\": connecting to {address}: ")), "{gone}");
    }
}
