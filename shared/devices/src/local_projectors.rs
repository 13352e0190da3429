//! Projectors that this computer drives itself, one device each.

use crate::device::Projector;
use crate::error::DeviceError;
use crate::light::Light;
use crate::lightcrafter::LightCrafter;
use crate::network_projector::LEAD_NS;
use crate::screen::ScreenProjector;
use cell::configuration::{ProjectorConfig, TriggerMode};

/// Opens the device of a projector.
fn open(projector: &ProjectorConfig) -> Result<Box<dyn Light>, DeviceError> {
    if let Some(settings) = &projector.lightcrafter {
        return Ok(Box::new(LightCrafter::open(projector, settings)?));
    }
    let settings = projector.screen.as_ref().ok_or(DeviceError::Missing("projector.output"))?;
    Ok(Box::new(ScreenProjector::open(projector, settings)?))
}

/// All projectors of a cell, of which one shines at a time.
pub(crate) struct LocalProjectors {
    projectors: Vec<ProjectorConfig>,
    /// Absent after a fault, until the next cycle begins.
    devices: Vec<Option<Box<dyn Light>>>,
    /// The projector whose pattern stands.
    shining: Option<usize>,
    /// When the first sequence that runs by itself may start.
    ready_ns: Option<u64>,
    open: fn(&ProjectorConfig) -> Result<Box<dyn Light>, DeviceError>,
}

impl LocalProjectors {
    /// Opens the devices of all projectors.
    pub fn new(projectors: &[ProjectorConfig]) -> Result<Self, DeviceError> {
        Self::opened_by(projectors, open)
    }

    fn opened_by(
        projectors: &[ProjectorConfig],
        open: fn(&ProjectorConfig) -> Result<Box<dyn Light>, DeviceError>,
    ) -> Result<Self, DeviceError> {
        let devices =
            projectors.iter().map(|projector| open(projector).map(Some)).collect::<Result<_, _>>()?;
        Ok(Self { projectors: projectors.to_vec(), devices, shining: None, ready_ns: None, open })
    }

    /// Asks a projector to do something. One that fails is opened again when the next cycle begins: a cable may be back.
    fn ask(
        &mut self,
        projector: usize,
        what: impl FnOnce(&mut dyn Light) -> Result<(), DeviceError>,
    ) -> Result<(), DeviceError> {
        let Some(light) = self.devices.get_mut(projector).and_then(Option::as_mut) else {
            return Err(DeviceError::Missing("projector that is open"));
        };
        let done = what(light.as_mut());
        if done.is_err() {
            self.devices[projector] = None;
            self.shining = None;
        }
        done
    }
}

impl Projector for LocalProjectors {
    fn begin(&mut self, _cycle: u64, now_ns: u64) -> Result<(), DeviceError> {
        for number in 0..self.devices.len() {
            if self.devices[number].is_none() {
                self.devices[number] = Some((self.open)(&self.projectors[number])?);
            }
            self.ask(number, |light| light.darken())?;
        }
        self.shining = None;
        let runs = self.projectors.iter().any(|projector| projector.trigger != TriggerMode::Stepped);
        self.ready_ns = runs.then_some(now_ns + LEAD_NS);
        Ok(())
    }

    fn due_ns(&self) -> Option<u64> {
        self.ready_ns
    }

    fn show(&mut self, projector: usize, frame: usize, _now_ns: u64) -> Result<(), DeviceError> {
        if let Some(other) = self.shining.filter(|other| *other != projector) {
            self.ask(other, |light| light.darken())?;
        }
        self.shining = Some(projector);
        self.ready_ns = None;
        match self.projectors.get(projector).map(|projector| projector.trigger) {
            Some(TriggerMode::Sequenced { .. }) if frame == 0 => self.ask(projector, |light| light.run()),
            // The sequence runs: the cameras are fired without the cell.
            Some(TriggerMode::Sequenced { .. }) => Ok(()),
            _ => self.ask(projector, |light| light.show(frame)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cell::configuration::Driver;
    use std::sync::Mutex;

    static TOLD: Mutex<Vec<String>> = Mutex::new(Vec::new());

    struct Lamp(String);

    impl Light for Lamp {
        fn show(&mut self, frame: usize) -> Result<(), DeviceError> {
            if frame == 9 {
                return Err(DeviceError::Frame("unplugged".into()));
            }
            TOLD.lock().unwrap().push(format!("{} {frame}", self.0));
            Ok(())
        }

        fn darken(&mut self) -> Result<(), DeviceError> {
            TOLD.lock().unwrap().push(format!("{} dark", self.0));
            Ok(())
        }
    }

    #[allow(clippy::unnecessary_wraps)] // the signature of every opener
    fn lamp(projector: &ProjectorConfig) -> Result<Box<dyn Light>, DeviceError> {
        TOLD.lock().unwrap().push(format!("{} open", projector.name));
        Ok(Box::new(Lamp(projector.name.clone())))
    }

    #[test]
    fn one_projector_shines_at_a_time_and_a_lost_one_is_opened_again() {
        let projector = |name: &str| ProjectorConfig::new(name, Driver::Screen, [1, 1], Vec::new());
        let mut lights = LocalProjectors::opened_by(&[projector("a"), projector("b")], lamp).unwrap();
        let said = || std::mem::take(&mut *TOLD.lock().unwrap()).join(", ");
        lights.begin(0, 0).unwrap();
        for (projector, frame) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            lights.show(projector, frame, 0).unwrap();
        }
        assert_eq!(said(), "a open, b open, a dark, b dark, a 0, a 1, a dark, b 0, b 1");
        let lost = lights.show(1, 9, 0).unwrap_err().to_string();
        assert_eq!(lost, "unplugged");
        // Until the next cycle it stays lost, and says so.
        assert!(lights.show(1, 0, 0).is_err());
        lights.begin(1, 0).unwrap();
        lights.show(1, 0, 0).unwrap();
        assert_eq!(said(), "a dark, b open, b dark, b 0");
    }
}
