//! Cameras on the network and on USB, and which of them is the one that a configuration means.

use super::WantedCamera;
use super::connect::missing_feature;
use super::found::{FoundCamera, Place};
use crate::error::DeviceError;
use cell::genicam_camera::{GenicamCamera, Transport};
use std::net::Ipv4Addr;
use std::time::Duration;
use telegenic::gige::discovery::{
    DiscoveredDevice, DiscoveryConfig, NetworkAdapter, discover, enumerate_adapters,
};

/// How long devices may take to answer a search: the standard lets them wait for a second.
const SEARCH: Duration = Duration::from_millis(1200);

/// Searches all network adapters for cameras, and USB in a program with Aravis; sorted by address, USB last.
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
    #[cfg(feature = "aravis")]
    cameras.extend(super::aravis_link::usb_cameras());
    Ok(cameras)
}

fn describe(device: &DiscoveredDevice) -> FoundCamera {
    let info = &device.info;
    FoundCamera {
        transport: Transport::Gige.name(),
        address: Some(info.ip),
        serial: info.serial.clone(),
        user_name: info.user_defined_name.clone(),
        manufacturer: info.manufacturer.clone(),
        model: info.model.clone(),
        version: info.device_version.clone(),
        mac: info.mac.map(|byte| format!("{byte:02x}")).join(":"),
        usb_id: String::new(),
    }
}

/// Where the camera is: at its address, or where the device with the serial number or name was found.
pub(super) fn place(wanted: &WantedCamera) -> Result<Place, DeviceError> {
    let fail = |reason: String| DeviceError::Frame(format!("camera \"{}\": {reason}", wanted.name));
    let settings = &wanted.settings;
    if let Some([problem, remedy]) = missing_feature(settings.transport) {
        return Err(fail(format!("{problem}; {remedy}")));
    }
    let found = if settings.address.is_none() { find_cameras()? } else { Vec::new() };
    place_of(settings, &found).map_err(fail)
}

/// Where the camera of a configuration is, among those that were found; one with an address is there.
///
/// # Errors
/// No device, or more than one, has the serial number or name; the text lists them.
pub fn place_of(settings: &GenicamCamera, found: &[FoundCamera]) -> Result<Place, String> {
    let on_usb = settings.transport == Transport::Usb3;
    let place = if let Some(address) = settings.address {
        Place::Gige(address)
    } else {
        let there: Vec<&FoundCamera> = found.iter().filter(|c| c.address.is_none() == on_usb).collect();
        choose(&there, settings.serial.as_deref().unwrap_or_default())?.place()
    };
    Ok(match (place, settings.transport) {
        (Place::Gige(address), Transport::Aravis) => Place::Aravis(address),
        (place, _) => place,
    })
}

/// The only device with this serial number; where none has it, the only one with this name.
fn choose<'a>(found: &[&'a FoundCamera], serial: &str) -> Result<&'a FoundCamera, String> {
    let listed = |cameras: &[&FoundCamera]| {
        let text = |camera: &&FoundCamera| {
            let name = if camera.user_name.is_empty() {
                String::new()
            } else {
                format!(" (\"{}\")", camera.user_name)
            };
            format!("{}{name} at {}", camera.serial, camera.place())
        };
        if cameras.is_empty() {
            return "no camera answers".to_owned();
        }
        cameras.iter().map(text).collect::<Vec<_>>().join(", ")
    };
    let with =
        |has: &dyn Fn(&FoundCamera) -> bool| found.iter().copied().filter(|c| has(c)).collect::<Vec<_>>();
    let mut meant = with(&|camera| camera.serial == serial);
    if meant.is_empty() {
        meant = with(&|camera| camera.user_name == serial);
    }
    match meant.as_slice() {
        [camera] => Ok(camera),
        [] => Err(format!(
            "no device has the serial number or name \"{serial}\"; found: {}; see `fringetool cameras`",
            listed(found)
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
    use std::net::IpAddr;

    fn camera(last: u8, serial: &str, user_name: &str) -> FoundCamera {
        FoundCamera {
            transport: "gige",
            address: Some(Ipv4Addr::new(192, 168, 1, last)),
            serial: serial.into(),
            user_name: user_name.into(),
            manufacturer: String::new(),
            model: String::new(),
            version: String::new(),
            mac: String::new(),
            usb_id: String::new(),
        }
    }

    fn on_usb(serial: &str) -> FoundCamera {
        FoundCamera {
            transport: "usb3",
            address: None,
            usb_id: format!("Maker-{serial}"),
            ..camera(0, serial, "")
        }
    }

    fn settings(transport: Transport, serial: &str) -> GenicamCamera {
        GenicamCamera { serial: Some(serial.into()), ..super::super::tests::settings(transport) }
    }

    fn choose_camera(found: &[FoundCamera], serial: &str) -> Result<Place, String> {
        place_of(&settings(Transport::Gige, serial), found)
    }

    #[test]
    fn a_camera_is_the_only_one_with_its_serial_number_or_name() {
        let found = [camera(1, "A1", "left"), camera(2, "A2", "right"), camera(3, "A3", "right")];
        assert_eq!(choose_camera(&found, "A3"), Ok(found[2].place()));
        assert_eq!(choose_camera(&found, "left"), Ok(found[0].place()));
        // Another camera's name is no reason to doubt a serial number.
        let named = [camera(1, "A1", ""), camera(2, "A2", "A1")];
        assert_eq!(choose_camera(&named, "A1"), Ok(named[0].place()));
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

    #[test]
    fn a_camera_is_looked_for_where_its_transport_is() {
        let found = [camera(1, "A1", ""), on_usb("A1"), on_usb("A2")];
        let address = IpAddr::from([192, 168, 1, 1]);
        let place = |transport, serial| place_of(&settings(transport, serial), &found);
        assert_eq!(place(Transport::Gige, "A1"), Ok(Place::Gige(address)));
        assert_eq!(place(Transport::Aravis, "A1"), Ok(Place::Aravis(address)));
        assert_eq!(place(Transport::Usb3, "A1"), Ok(Place::Usb("Maker-A1".into())));
        let elsewhere = place(Transport::Gige, "A2").unwrap_err();
        assert!(elsewhere.contains("found: A1 at 192.168.1.1; see"), "{elsewhere}");
        let elsewhere = place(Transport::Usb3, "A3").unwrap_err();
        assert!(elsewhere.contains("found: A1 at USB (Maker-A1), A2 at USB (Maker-A2);"), "{elsewhere}");
        let written = GenicamCamera { address: Some(address), ..settings(Transport::Aravis, "") };
        assert_eq!(place_of(&written, &[]), Ok(Place::Aravis(address)));
    }
}
