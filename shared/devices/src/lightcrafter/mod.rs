//! Projector boards of Texas Instruments with their own pattern memory, over USB.
//!
//! A pattern is shown again and again until the next one is asked for, so a camera may expose it for any whole number of periods.
//! Every setting is read back where the guide states how. No real device has been tried: see `docs/hardware.md`.

pub(crate) mod dlpc350;
pub(crate) mod dlpc900;
mod erle;
mod link;
mod transport;

pub(crate) use link::Command;

use crate::error::DeviceError;
use crate::light::Light;
use crate::screen::Screen;
use cell::configuration::{LightCrafterSettings, ProjectorConfig};
use cell::lightcrafter::{Controller, PatternSource, Place, draw, image_count, places};
use link::Link;
use std::time::Duration;
pub use transport::{REPORT_BYTES, Report, Transport};

/// What both controllers have in common.
pub(crate) mod commands {
    use super::Command;

    /// 0 = stopped, 1 = paused, 2 = running. DLPU018J 2.4.4.1.
    pub const START: Command = Command(0x1a24, "start or stop");
    /// Dark; the next start begins anew.
    pub const STOPPED: u8 = 0;
    /// Patterns are being shown.
    pub const RUN: u8 = 2;
    /// Faults of the board. DLPU018J 2.1.1.
    pub const HARDWARE_STATUS: Command = Command(0x1a0a, "status of the hardware");
    /// State of the board; bit 1: a sequence runs. Both guides, main status.
    pub const STATUS: Command = Command(0x1a0c, "main status");
}

/// Bit of the main status: a sequence runs.
pub(crate) const RUNNING: u8 = 2;

/// Bits of the hardware status that state a fault, with bit 0 clear: not initialised (DLPU018J 2.1.1; those of the DLPC350 are the
/// same, but for bit 1, which it has reserved).
const FAULTS: [(u8, &str); 3] = [
    (2, "two resets of the same mirrors overlap"),
    (6, "the sequencer has stopped"),
    (7, "the sequencer has a fault"),
];

fn check_hardware(link: &mut Link) -> Result<(), String> {
    let status = link.read(commands::HARDWARE_STATUS, 1)?[0];
    if status & 1 == 0 {
        return Err("the board is not initialised; switch it off and on".into());
    }
    match FAULTS.iter().find(|(bit, _)| status & (1 << bit) != 0) {
        Some((_, fault)) => {
            Err(format!("{}: {fault}; switch the board off and on", commands::HARDWARE_STATUS))
        }
        None => Ok(()),
    }
}

/// A board, ready to show the frames of its projector.
pub(crate) struct LightCrafter {
    /// Name of the projector and place of the device, for messages.
    name: String,
    link: Link,
    settings: LightCrafterSettings,
    places: Vec<Place>,
    /// With patterns from the video input: the screen there, and what it shows.
    screen: Option<(Screen, ProjectorConfig)>,
}

impl LightCrafter {
    /// Opens the board of a projector and sends or finds its patterns.
    pub fn open(projector: &ProjectorConfig, settings: &LightCrafterSettings) -> Result<Self, DeviceError> {
        let controller = settings.controller;
        let product = match controller {
            Controller::Dlpc350 => dlpc350::PRODUCT,
            Controller::Dlpc900 => dlpc900::PRODUCT,
        };
        let opened = transport::open(product, settings.device.as_deref());
        let (transport, device) =
            opened.map_err(|text| DeviceError::Frame(format!("projector \"{}\": {text}", projector.name)))?;
        Self::over(transport, &device, projector, settings)
    }

    /// The same over a transport that is open.
    pub fn over(
        transport: Box<dyn Transport>,
        device: &str,
        projector: &ProjectorConfig,
        settings: &LightCrafterSettings,
    ) -> Result<Self, DeviceError> {
        let name = format!("projector \"{}\" ({} at {device})", projector.name, settings.controller.name());
        let mut link = Link::new(transport, settings.controller == Controller::Dlpc900);
        let of_board = |text: String| DeviceError::Frame(format!("{name}: {text}"));
        let undrawn = |error| DeviceError::Frame(format!("{name}: {error}"));
        let bits = projector.pattern_bits(settings.one_bit).map_err(undrawn)?;
        let mut places = places(bits);
        if settings.source == PatternSource::Flash {
            for place in &mut places {
                place.image += usize::from(settings.first_image);
            }
        }
        match settings.controller {
            Controller::Dlpc350 => {
                let last = places.last().map_or(0, |place| place.image);
                dlpc350::prepare(&mut link, settings, last).map_err(of_board)?;
            }
            Controller::Dlpc900 => {
                let images = images(projector, settings, &places).map_err(undrawn)?;
                dlpc900::prepare(&mut link, settings, projector.size_px(), &places, &images)
                    .map_err(of_board)?;
            }
        }
        let screen = match &settings.screen {
            Some(screen) => Some((Screen::open(projector, screen)?, projector.clone())),
            None => None,
        };
        let mut board = Self { name, link, settings: settings.clone(), places, screen };
        if board.screen.is_some() {
            board.start_video()?;
        }
        Ok(board)
    }

    /// Every refresh of the video shows its green channel as a pattern; the screen has grey pictures.
    fn start_video(&mut self) -> Result<(), DeviceError> {
        let grey = Place { image: 0, bit: 0, bits: 8 };
        dlpc350::show(&mut self.link, &self.settings, grey).map_err(|text| self.failed(&text))
    }

    fn failed(&self, text: &str) -> DeviceError {
        DeviceError::Frame(format!("{}: {text}", self.name))
    }
}

impl Drop for LightCrafter {
    fn drop(&mut self) {
        // A board that is gone is dark without that.
        let _ = self.link.write(commands::START, &[commands::STOPPED]);
    }
}

/// The images of 24 bits that are sent to a board; none where it has them in flash.
fn images(
    projector: &ProjectorConfig,
    settings: &LightCrafterSettings,
    places: &[Place],
) -> Result<Vec<Vec<u8>>, fringe::pattern::PatternError> {
    if settings.source != PatternSource::Usb {
        return Ok(Vec::new());
    }
    let [width, height] = projector.size_px();
    let mut images = vec![vec![0; width as usize * height as usize * 3]; image_count(places)];
    for (frame, place) in places.iter().enumerate() {
        if let Some(pattern) = projector.image_u8(frame) {
            draw(&mut images[place.image], *place, &pattern?);
        }
    }
    Ok(images)
}

impl Light for LightCrafter {
    fn show(&mut self, frame: usize) -> Result<(), DeviceError> {
        if let Some((screen, projector)) = &mut self.screen {
            screen.show_frame(projector, frame)?;
            // The screen cannot know whether the board still runs.
            let status = self.link.read(commands::STATUS, 1).map_err(|text| self.failed(&text))?[0];
            if status & RUNNING == 0 {
                return Err(self.failed("its sequence has stopped; is the video signal there?"));
            }
        } else {
            let Some(place) = self.places.get(frame).copied() else {
                return Err(self.failed(&format!("the sequence has no frame {}", frame + 1)));
            };
            let shown = match self.settings.controller {
                Controller::Dlpc350 => dlpc350::show(&mut self.link, &self.settings, place),
                Controller::Dlpc900 => dlpc900::show(&mut self.link, frame),
            };
            shown.map_err(|text| self.failed(&text))?;
        }
        std::thread::sleep(Duration::from_millis(self.settings.settle_ms.into()));
        Ok(())
    }

    fn run(&mut self) -> Result<(), DeviceError> {
        let run = match (self.settings.controller, self.settings.source) {
            (_, PatternSource::Video) => Err("a screen shows frame by frame only".to_owned()),
            (Controller::Dlpc350, _) => dlpc350::run(&mut self.link, &self.settings, &self.places),
            (Controller::Dlpc900, _) => dlpc900::run(&mut self.link, self.places.len()),
        };
        run.map_err(|text| self.failed(&text))
    }

    fn darken(&mut self) -> Result<(), DeviceError> {
        if let Some((screen, _)) = &mut self.screen {
            return screen.darken();
        }
        let stopped = self.link.write(commands::START, &[commands::STOPPED]);
        stopped.map_err(|text| self.failed(&text))
    }
}
