//! The GenICam description of the simulated camera: its features by the names of the Standard Features Naming
//! Convention, each in one register.

use super::device::{LINE1, SOFTWARE};
use super::registers::feature;
use cell::pixel_format::PixelFormat;
use std::fmt::Write;

const HEAD: &str = r#"<?xml version="1.0" encoding="utf-8"?>
<RegisterDescription ModelName="Twin" VendorName="fringecell" StandardNameSpace="GEV" SchemaMajorVersion="1"
    SchemaMinorVersion="1" SchemaSubMinorVersion="0" MajorVersion="1" MinorVersion="0" SubMinorVersion="0"
    ToolTip="Simulated camera" ProductGuid="6f9f1b8e-55a6-4a0e-9c6e-6f0f6f6e6365" VersionGuid="6f9f1b8e-55a6-4a0e-9c6e-6f0f6f6e6366"
    xmlns="http://www.genicam.org/GenApi/Version_1_1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:schemaLocation="http://www.genicam.org/GenApi/Version_1_1 http://www.genicam.org/GenApi/GenApiSchema_Version_1_1.xsd">
"#;

/// Features of the root category, in the order in which a viewer shows them.
const FEATURES: [&str; 15] = [
    "Width",
    "Height",
    "PixelFormat",
    "PayloadSize",
    "AcquisitionMode",
    "AcquisitionStart",
    "AcquisitionStop",
    "TriggerSelector",
    "TriggerMode",
    "TriggerSource",
    "TriggerSoftware",
    "ExposureTime",
    "Gain",
    "DeviceTemperature",
    "TLParamsLocked",
];

fn register(xml: &mut String, kind: &str, name: &str, address: u32, access: &str) {
    let _ = writeln!(
        xml,
        "  <{kind} Name=\"{name}Reg\"><Address>0x{address:X}</Address><Length>4</Length><AccessMode>{access}</AccessMode>\
         <pPort>Device</pPort><Cachable>NoCache</Cachable>{}<Endianess>BigEndian</Endianess></{kind}>",
        if kind == "IntReg" { "<Sign>Unsigned</Sign>" } else { "" }
    );
}

fn integer(xml: &mut String, name: &str, address: u32, access: &str) {
    let _ = writeln!(xml, "  <Integer Name=\"{name}\"><pValue>{name}Reg</pValue></Integer>");
    register(xml, "IntReg", name, address, access);
}

fn float(xml: &mut String, name: &str, address: u32, unit: &str, limits: Option<[f64; 2]>) {
    let range =
        limits.map_or(String::new(), |[least, most]| format!("<Min>{least:?}</Min><Max>{most:?}</Max>"));
    let _ = writeln!(
        xml,
        "  <Float Name=\"{name}\"><pValue>{name}Reg</pValue>{range}<Unit>{unit}</Unit></Float>"
    );
    register(xml, "FloatReg", name, address, if limits.is_some() { "RW" } else { "RO" });
}

fn command(xml: &mut String, name: &str, pointer: &str, value: u32) {
    let _ = writeln!(
        xml,
        "  <Command Name=\"{name}\"><pValue>{pointer}Reg</pValue><CommandValue>{value}</CommandValue></Command>"
    );
}

fn enumeration(xml: &mut String, name: &str, address: u32, entries: &[(&str, u32)]) {
    let _ = write!(xml, "  <Enumeration Name=\"{name}\">");
    for (entry, value) in entries {
        let _ = write!(xml, "<EnumEntry Name=\"{entry}\"><Value>{value}</Value></EnumEntry>");
    }
    let _ = writeln!(xml, "<pValue>{name}Reg</pValue></Enumeration>");
    register(xml, "IntReg", name, address, "RW");
}

/// The description of a camera with this pixel format.
pub fn xml(pixel_format: PixelFormat) -> String {
    let mut xml = HEAD.to_owned();
    xml.push_str("  <Category Name=\"Root\" NameSpace=\"Standard\">");
    for name in FEATURES {
        let _ = write!(xml, "<pFeature>{name}</pFeature>");
    }
    xml.push_str("</Category>\n");
    integer(&mut xml, "Width", feature::WIDTH, "RO");
    integer(&mut xml, "Height", feature::HEIGHT, "RO");
    integer(&mut xml, "PayloadSize", feature::PAYLOAD_BYTES, "RO");
    integer(&mut xml, "TLParamsLocked", feature::LOCKED, "RW");
    let only = [(pixel_format.name(), pixel_format.code())];
    enumeration(&mut xml, "PixelFormat", feature::PIXEL_FORMAT, &only);
    enumeration(&mut xml, "AcquisitionMode", feature::ACQUISITION_MODE, &[("Continuous", 0)]);
    enumeration(&mut xml, "TriggerSelector", feature::TRIGGER_SELECTOR, &[("FrameStart", 0)]);
    enumeration(&mut xml, "TriggerMode", feature::TRIGGER_MODE, &[("Off", 0), ("On", 1)]);
    enumeration(
        &mut xml,
        "TriggerSource",
        feature::TRIGGER_SOURCE,
        &[("Software", SOFTWARE), ("Line1", LINE1)],
    );
    register(&mut xml, "IntReg", "Acquisition", feature::ACQUISITION, "RW");
    command(&mut xml, "AcquisitionStart", "Acquisition", 1);
    command(&mut xml, "AcquisitionStop", "Acquisition", 0);
    register(&mut xml, "IntReg", "TriggerSoftware", feature::TRIGGER_SOFTWARE, "WO");
    command(&mut xml, "TriggerSoftware", "TriggerSoftware", 1);
    float(&mut xml, "ExposureTime", feature::EXPOSURE_US, "us", Some([10.0, 1e6]));
    float(&mut xml, "Gain", feature::GAIN_DB, "dB", Some([0.0, 24.0]));
    float(&mut xml, "DeviceTemperature", feature::TEMPERATURE_C, "C", None);
    xml.push_str("  <Port Name=\"Device\"/>\n</RegisterDescription>\n");
    xml
}
