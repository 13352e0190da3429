//! Whether the cameras of a cell can be reached, and how large their packets may be.

use super::{Check, State};
use cell::genicam_camera::GenicamCamera;
use devices::{FoundCamera, LoadedCell, Place, ProbedCamera};

/// Packets below this size cost the processor more than the frames.
const LARGE_PACKET_BYTES: u16 = 8000;

/// All checks of the cameras of a cell; without one, of those that answer.
pub(super) fn checks(cell: Option<&LoadedCell>) -> Vec<Check> {
    let wanted: Vec<(&str, &GenicamCamera)> = cell.map_or(Vec::new(), |cell| {
        let cameras = cell.config.cameras.iter();
        cameras.filter_map(|camera| Some((camera.name.as_str(), camera.genicam.as_ref()?))).collect()
    });
    if cell.is_some() && wanted.is_empty() {
        return vec![Check::new("cameras", State::Good, "the cell has no camera of its own")];
    }
    let found = match devices::find_cameras() {
        Ok(found) => found,
        Err(error) => return vec![Check::new("cameras", State::Bad, error.to_string())],
    };
    if cell.is_none() {
        return any(&found);
    }
    wanted.iter().flat_map(|(name, wanted)| of_cell(name, wanted, &found)).collect()
}

fn any(found: &[FoundCamera]) -> Vec<Check> {
    if found.is_empty() {
        let check = Check::new("cameras", State::Warning, "no camera answers a search");
        let mend = "power the camera, put it and this computer into one network: ip address add 169.254.0.1/16 dev ETH";
        return vec![check.mended_by("a GenICam camera, where the cell shall have one", mend)];
    }
    found.iter().flat_map(|camera| reached(&format!("camera {}", camera.serial), &camera.place())).collect()
}

fn of_cell(name: &str, wanted: &GenicamCamera, found: &[FoundCamera]) -> Vec<Check> {
    let name = format!("camera \"{name}\"");
    if let Some([problem, remedy]) = devices::missing_feature(wanted.transport) {
        return vec![
            Check::new(name, State::Bad, problem).mended_by("a program that is built with it", remedy),
        ];
    }
    match devices::place_of(wanted, found) {
        Ok(place) => reached(&name, &place),
        Err(reason) => {
            let check = Check::new(name, State::Bad, reason);
            vec![check.mended_by(
                "one camera with this serial number or name, powered, in the network of an adapter of this computer",
                "fringetool cameras",
            )]
        }
    }
}

/// Connects to a camera, as a cell does, and lets go of it.
fn reached(name: &str, place: &Place) -> Vec<Check> {
    match devices::probe_camera(place) {
        Err(error) => {
            let check = Check::new(name, State::Bad, format!("{place}: {error}"));
            let ping = place.address().map_or_else(String::new, |address| format!("ping {address}; "));
            vec![check.mended_by(
                "a camera that answers and that no other program controls",
                format!("{ping}stop other programs that use the camera; fringetool cameras"),
            )]
        }
        Ok(probed) => {
            let ProbedCamera { model, serial, width_px, height_px, temperature_c, .. } = &probed;
            let warmth = temperature_c.map_or(String::new(), |celsius| format!(", {celsius:.1} °C"));
            let found = format!("{place}: {model} {serial}, {width_px} × {height_px} px{warmth}");
            let mut checks = vec![Check::new(name, State::Good, found)];
            if place.address().is_some() {
                checks.push(packets(name, &probed));
            }
            checks
        }
    }
}

fn packets(name: &str, probed: &ProbedCamera) -> Check {
    let ProbedCamera { packet_bytes, adapter, mtu, .. } = probed;
    let name = format!("packets of {name}");
    let Some(packet_bytes) = packet_bytes else {
        let check = Check::new(name, State::Bad, "no packet of any size arrives");
        return check.mended_by(
            "packets that arrive",
            "sudo ufw allow in proto udp from the camera, or another firewall's command",
        );
    };
    let state = if *packet_bytes >= LARGE_PACKET_BYTES { State::Good } else { State::Warning };
    let adapter = adapter.as_deref().unwrap_or("ETH");
    let known = mtu.map_or("unknown".to_owned(), |mtu| mtu.to_string());
    let found = format!("{packet_bytes} bytes arrive whole (adapter {adapter}, MTU {known})");
    let mend = if mtu.is_some_and(|mtu| mtu > LARGE_PACKET_BYTES.into()) {
        "allow jumbo frames on every switch between, or a larger packet size at the camera (GevSCPSPacketSize)".to_owned()
    } else {
        format!("sudo ip link set dev {adapter} mtu 9000, and jumbo frames on every switch between")
    };
    Check::new(name, state, found)
        .mended_by(format!("{LARGE_PACKET_BYTES} bytes and more (jumbo frames)"), mend)
}
