//! The way to a camera by its place, as far as this program has it.

use super::found::Place;
use super::gige_link::GigeLink;
use super::link::Link;
use cell::genicam_camera::Transport;

/// What this program lacks for a transport, and the remedy; `None`: nothing.
pub fn missing_feature(transport: Transport) -> Option<[String; 2]> {
    if cfg!(feature = "aravis") || transport == Transport::Gige {
        return None;
    }
    let problem = format!(
        "transport = \"{}\" needs the library Aravis, and this program is built without it",
        transport.name()
    );
    let remedy =
        "apt-get install libaravis-dev libusb-1.0-0-dev, then `cargo build --release --features aravis`";
    Some([problem, remedy.to_owned()])
}

/// Takes control of the camera there.
pub(crate) fn connect(place: &Place) -> Result<Box<dyn Link>, String> {
    match place {
        Place::Gige(address) => Ok(Box::new(GigeLink::connect(*address)?)),
        Place::Aravis(address) => by_aravis(Transport::Aravis, &address.to_string()),
        Place::Usb(id) => by_aravis(Transport::Usb3, id),
    }
}

#[cfg(feature = "aravis")]
fn by_aravis(transport: Transport, name: &str) -> Result<Box<dyn Link>, String> {
    Ok(Box::new(super::aravis_link::AravisLink::connect(transport, name)?))
}

#[cfg(not(feature = "aravis"))]
fn by_aravis(transport: Transport, _name: &str) -> Result<Box<dyn Link>, String> {
    Err(missing_feature(transport).unwrap_or_default().join("; "))
}
