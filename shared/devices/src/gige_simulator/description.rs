//! The GenICam description of the simulated camera: its features by the names of the Standard Features Naming
//! Convention, each in one register.

use super::region::{AXES, Axis};
use super::registers::feature;
use cell::pixel_format::PixelFormat;
use std::fmt::Write;

/// Values of the feature `TriggerSource`.
pub const SOFTWARE: u32 = 0;
/// The first input, which the projector of the twin fires.
pub const LINE1: u32 = 1;

/// Exposure times that the camera takes, µs; and gains, dB.
pub const EXPOSURE_US: [f32; 2] = [10.0, 1e6];
pub const GAIN_DB: [f32; 2] = [0.0, 24.0];

const HEAD: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Twin" VendorName="fringecell" StandardNameSpace="GEV" SchemaMajorVersion="1"
    SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
    ToolTip="Simulated camera" ProductGuid="6f9f1b8e-55a6-4a0e-9c6e-6f0f6f6e6365" VersionGuid="6f9f1b8e-55a6-4a0e-9c6e-6f0f6f6e6366"
    xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1 http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">
"#;

/// Port states of IEEE 1588, by their numbers.
pub const CLOCK_STATES: [(&str, u32); 9] = [
    ("Initializing", 1),
    ("Faulty", 2),
    ("Disabled", 3),
    ("Listening", 4),
    ("PreMaster", 5),
    ("Master", 6),
    ("Passive", 7),
    ("Uncalibrated", 8),
    ("Slave", 9),
];

/// Nodes of a description, and the names of those that a viewer shows, in their order.
#[derive(Default)]
struct Nodes {
    xml: String,
    features: Vec<&'static str>,
}

impl Nodes {
    fn register(&mut self, kind: &str, name: &str, address: u32, access: &str) {
        let _ = writeln!(
            self.xml,
            "  <{kind} Name=\"{name}Reg\"><Address>0x{address:X}</Address><Length>4</Length><AccessMode>{access}</AccessMode>\
             <pPort>Device</pPort><Cachable>NoCache</Cachable>{}<Endianess>BigEndian</Endianess></{kind}>",
            if kind == "IntReg" { "<Sign>Unsigned</Sign>" } else { "" }
        );
    }

    fn integer(&mut self, name: &'static str, address: u32, access: &str) {
        self.features.push(name);
        let _ = writeln!(self.xml, "  <Integer Name=\"{name}\"><pValue>{name}Reg</pValue></Integer>");
        self.register("IntReg", name, address, access);
    }

    /// A size or an offset, whose limit depends on the other one.
    fn extent(&mut self, name: &'static str, [address, limit]: [u32; 2], least: u32, step: u32) {
        self.features.push(name);
        let _ = writeln!(
            self.xml,
            "  <Integer Name=\"{name}\"><pValue>{name}Reg</pValue><Min>{least}</Min><pMax>{name}LimitReg</pMax>\
             <Inc>{step}</Inc></Integer>"
        );
        self.register("IntReg", name, address, "RW");
        self.register("IntReg", &format!("{name}Limit"), limit, "RO");
    }

    fn float(&mut self, name: &'static str, address: u32, unit: &str, limits: Option<[f32; 2]>) {
        self.features.push(name);
        let range =
            limits.map_or(String::new(), |[least, most]| format!("<Min>{least:?}</Min><Max>{most:?}</Max>"));
        let _ = writeln!(
            self.xml,
            "  <Float Name=\"{name}\"><pValue>{name}Reg</pValue>{range}<Unit>{unit}</Unit></Float>"
        );
        self.register("FloatReg", name, address, if limits.is_some() { "RW" } else { "RO" });
    }

    fn boolean(&mut self, name: &'static str, address: u32) {
        self.features.push(name);
        let _ = writeln!(
            self.xml,
            "  <Boolean Name=\"{name}\"><pValue>{name}Reg</pValue><OnValue>1</OnValue><OffValue>0</OffValue></Boolean>"
        );
        self.register("IntReg", name, address, "RW");
    }

    fn command(&mut self, name: &'static str, pointer: &str, value: u32) {
        self.features.push(name);
        let _ = writeln!(
            self.xml,
            "  <Command Name=\"{name}\"><pValue>{pointer}Reg</pValue><CommandValue>{value}</CommandValue></Command>"
        );
    }

    fn enumeration(&mut self, name: &'static str, address: u32, access: &str, entries: &[(&str, u32)]) {
        self.features.push(name);
        let _ = write!(self.xml, "  <Enumeration Name=\"{name}\">");
        for (entry, value) in entries {
            let _ = write!(self.xml, "<EnumEntry Name=\"{entry}\"><Value>{value}</Value></EnumEntry>");
        }
        let _ = writeln!(self.xml, "<pValue>{name}Reg</pValue></Enumeration>");
        self.register("IntReg", name, address, access);
    }
}

/// The description of a camera with this pixel format and sensor; with the names of before version 2 of the convention where they
/// were others.
pub fn xml(pixel_format: PixelFormat, sensor_px: [u32; 2], old_names: bool) -> String {
    let mut n = Nodes::default();
    let named = |name: &'static str, old: &'static str| if old_names { old } else { name };
    for (axis, sensor_px) in AXES.iter().zip(sensor_px) {
        let step = axis.step_px(sensor_px);
        let Axis { size, size_limit, offset, offset_limit, sensor, names, .. } = *axis;
        n.extent(names[0], [size, size_limit], step, step);
        n.extent(names[1], [offset, offset_limit], 0, step);
        n.integer(names[2], sensor, "RO");
    }
    n.integer("PayloadSize", feature::PAYLOAD_BYTES, "RO");
    n.integer("TLParamsLocked", feature::LOCKED, "RW");
    let rw = "RW";
    n.enumeration("PixelFormat", feature::PIXEL_FORMAT, rw, &[(pixel_format.name(), pixel_format.code())]);
    n.enumeration("AcquisitionMode", feature::ACQUISITION_MODE, rw, &[("Continuous", 0)]);
    n.enumeration("TriggerSelector", feature::TRIGGER_SELECTOR, rw, &[("FrameStart", 0)]);
    n.enumeration("TriggerMode", feature::TRIGGER_MODE, rw, &[("Off", 0), ("On", 1)]);
    n.enumeration("TriggerSource", feature::TRIGGER_SOURCE, rw, &[("Software", SOFTWARE), ("Line1", LINE1)]);
    n.enumeration("TriggerActivation", feature::TRIGGER_ACTIVATION, rw, &[("RisingEdge", 0)]);
    n.register("IntReg", "Acquisition", feature::ACQUISITION, "RW");
    n.command("AcquisitionStart", "Acquisition", 1);
    n.command("AcquisitionStop", "Acquisition", 0);
    n.register("IntReg", "TriggerSoftware", feature::TRIGGER_SOFTWARE, "WO");
    n.command("TriggerSoftware", "TriggerSoftware", 1);
    n.enumeration("ExposureAuto", feature::EXPOSURE_AUTO, rw, &[("Off", 0), ("Continuous", 1)]);
    n.float(named("ExposureTime", "ExposureTimeAbs"), feature::EXPOSURE_US, "us", Some(EXPOSURE_US));
    n.float("Gain", feature::GAIN_DB, "dB", Some(GAIN_DB));
    n.float("DeviceTemperature", feature::TEMPERATURE_C, "C", None);
    n.boolean(named("PtpEnable", "GevIEEE1588"), feature::CLOCK);
    n.enumeration(named("PtpStatus", "GevIEEE1588Status"), feature::CLOCK_STATE, "RO", &CLOCK_STATES);
    n.register("IntReg", "PtpDataSetLatch", feature::CLOCK_UPDATE, "WO");
    n.command(named("PtpDataSetLatch", "GevIEEE1588DataSetLatch"), "PtpDataSetLatch", 1);
    let mut xml = format!("{HEAD}  <Category Name=\"Root\" NameSpace=\"Standard\">");
    for name in n.features {
        let _ = write!(xml, "<pFeature>{name}</pFeature>");
    }
    xml + "</Category>\n" + &n.xml + "  <Port Name=\"Device\"/>\n</RegisterDescription>\n"
}
