//! Cameras on the network, and which of them is the one that a configuration means.

use super::WantedCamera;
use crate::error::DeviceError;
use std::net::{IpAddr, Ipv4Addr};
use std::time::Duration;
use telegenic::gige::discovery::{
    DiscoveredDevice, DiscoveryConfig, NetworkAdapter, discover, enumerate_adapters,
};

/// How long devices may take to answer a search: the standard lets them wait for a second.
const SEARCH: Duration = Duration::from_millis(1200);

/// A device that answered a search.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct FoundCamera {
    /// Address of the device.
    pub address: Ipv4Addr,
    /// Serial number of the device.
    pub serial: String,
    /// Name that a person gave it; may be empty.
    pub user_name: String,
    /// Manufacturer of the device.
    pub manufacturer: String,
    /// Model of the device.
    pub model: String,
    /// Version of the device.
    pub version: String,
    /// Hardware address, hexadecimal bytes.
    pub mac: String,
}

/// Searches all network adapters for cameras; sorted by address.
///
/// # Errors
/// No adapter can be used.
pub fn find_cameras() -> Result<Vec<FoundCamera>, DeviceError> {
    let fail = |e: &dyn std::fmt::Display| DeviceError::Frame(format!("searching for cameras: {e}"));
    let mut adapters = enumerate_adapters().map_err(|e| fail(&e))?;
    // Simulated cameras are on this computer.
    adapters.push(NetworkAdapter {
        name: "lo".to_owned(),
        ip: Ipv4Addr::LOCALHOST,
        netmask: Ipv4Addr::new(255, 0, 0, 0),
        broadcast: Ipv4Addr::new(127, 255, 255, 255),
    });
    let config =
        DiscoveryConfig { adapters: Some(adapters), recv_window: SEARCH, ..DiscoveryConfig::default() };
    let found = discover(&config).map_err(|e| fail(&e))?;
    let mut cameras: Vec<FoundCamera> = found.iter().map(describe).collect();
    cameras.sort_by_key(|camera| camera.address);
    Ok(cameras)
}

fn describe(device: &DiscoveredDevice) -> FoundCamera {
    let info = &device.info;
    FoundCamera {
        address: info.ip,
        serial: info.serial.clone(),
        user_name: info.user_defined_name.clone(),
        manufacturer: info.manufacturer.clone(),
        model: info.model.clone(),
        version: info.device_version.clone(),
        mac: info.mac.map(|byte| format!("{byte:02x}")).join(":"),
    }
}

/// The address of the camera: as written, or that of the device with the serial number or name.
pub(super) fn address(wanted: &WantedCamera) -> Result<IpAddr, DeviceError> {
    if let Some(address) = wanted.settings.address {
        return Ok(address);
    }
    let serial = wanted.settings.serial.as_deref().unwrap_or_default();
    choose_camera(&find_cameras()?, serial)
        .map(IpAddr::from)
        .map_err(|reason| DeviceError::Frame(format!("camera \"{}\": {reason}", wanted.name)))
}

/// The only device with this serial number; where none has it, the only one with this name.
///
/// # Errors
/// There is none, or more than one; the text lists them.
pub fn choose_camera(found: &[FoundCamera], serial: &str) -> Result<Ipv4Addr, String> {
    let listed = |cameras: &[&FoundCamera]| {
        let text = |camera: &&FoundCamera| {
            let name = if camera.user_name.is_empty() {
                String::new()
            } else {
                format!(" (\"{}\")", camera.user_name)
            };
            format!("{}{name} at {}", camera.serial, camera.address)
        };
        if cameras.is_empty() {
            return "no camera answers".to_owned();
        }
        cameras.iter().map(text).collect::<Vec<_>>().join(", ")
    };
    let with = |has: &dyn Fn(&FoundCamera) -> bool| found.iter().filter(|c| has(c)).collect::<Vec<_>>();
    let mut meant = with(&|camera| camera.serial == serial);
    if meant.is_empty() {
        meant = with(&|camera| camera.user_name == serial);
    }
    match meant.as_slice() {
        [camera] => Ok(camera.address),
        [] => Err(format!(
            "no device has the serial number or name \"{serial}\"; found: {}; see `fringetool cameras`",
            listed(&found.iter().collect::<Vec<_>>())
        )),
        several => Err(format!(
            "{} devices have the serial number or name \"{serial}\": {}; write the serial number or the address of one of them",
            several.len(),
            listed(several)
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(last: u8, serial: &str, user_name: &str) -> FoundCamera {
        FoundCamera {
            address: Ipv4Addr::new(192, 168, 1, last),
            serial: serial.into(),
            user_name: user_name.into(),
            manufacturer: String::new(),
            model: String::new(),
            version: String::new(),
            mac: String::new(),
        }
    }

    #[test]
    fn a_camera_is_the_only_one_with_its_serial_number_or_name() {
        let found = [camera(1, "A1", "left"), camera(2, "A2", "right"), camera(3, "A3", "right")];
        assert_eq!(choose_camera(&found, "A3"), Ok(found[2].address));
        assert_eq!(choose_camera(&found, "left"), Ok(found[0].address));
        // Another camera's name is no reason to doubt a serial number.
        let named = [camera(1, "A1", ""), camera(2, "A2", "A1")];
        assert_eq!(choose_camera(&named, "A1"), Ok(named[0].address));
        let twice = choose_camera(&found, "right").unwrap_err();
        assert!(
            twice.starts_with(
                "2 devices have the serial number or name \"right\": A2 (\"right\") at 192.168.1.2, A3"
            ) && twice.contains("write the serial number or the address"),
            "{twice}"
        );
        let same = [camera(1, "A1", ""), camera(2, "A1", "")];
        assert!(choose_camera(&same, "A1").unwrap_err().contains("A1 at 192.168.1.1, A1 at 192.168.1.2"));
        let none = choose_camera(&found, "A9").unwrap_err();
        assert!(
            none.contains("\"A9\"; found: A1 (\"left\") at 192.168.1.1")
                && none.contains("fringetool cameras"),
            "{none}"
        );
        assert!(choose_camera(&[], "A9").unwrap_err().contains("no camera answers"));
    }
}
