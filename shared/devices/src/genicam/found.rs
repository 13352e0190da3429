//! A camera that a search found, and where it is.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr};

/// Where a camera is, and by which way it is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// On the network, without a system library.
    Gige(IpAddr),
    /// On the network, by Aravis.
    Aravis(IpAddr),
    /// On USB, by Aravis, which has this name for it.
    Usb(String),
}

impl Place {
    /// Address on the network; `None` on USB.
    pub fn address(&self) -> Option<IpAddr> {
        match self {
            Self::Gige(address) | Self::Aravis(address) => Some(*address),
            Self::Usb(_) => None,
        }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gige(address) | Self::Aravis(address) => address.fmt(f),
            Self::Usb(id) => write!(f, "USB ({id})"),
        }
    }
}

/// A device that answered a search.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct FoundCamera {
    /// Its transport, as the configuration names it.
    pub transport: &'static str,
    /// Address of the device; absent on USB.
    pub address: Option<Ipv4Addr>,
    /// Serial number of the device.
    pub serial: String,
    /// Name that a person gave it; may be empty.
    pub user_name: String,
    /// Manufacturer of the device.
    pub manufacturer: String,
    /// Model of the device.
    pub model: String,
    /// Version of the device; empty on USB.
    pub version: String,
    /// Hardware address, hexadecimal bytes; empty on USB.
    pub mac: String,
    /// Name that Aravis has for a device on USB.
    #[serde(skip)]
    pub usb_id: String,
}

impl FoundCamera {
    /// Where it is; by the way that needs no system library, if there is one.
    pub fn place(&self) -> Place {
        self.address.map_or_else(|| Place::Usb(self.usb_id.clone()), |address| Place::Gige(address.into()))
    }
}
