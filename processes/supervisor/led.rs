//! What the supervisor of a host that is led does for the host that leads.

use super::cycle::Input;
use super::state::Supervisor;
use anyhow::Result;
use cell::cycle_number::unwire;
use files::result::CycleResult;
use ipc::header::{Event, EventKind};

impl Supervisor<'_> {
    /// Starts a cycle that the host that leads wants, ends one that it does not want any more, or ends the run for a new one.
    pub(super) fn led(
        &mut self,
        kind: EventKind,
        event: Event,
        text: &str,
        each: &mut dyn FnMut(&CycleResult),
    ) -> Result<()> {
        let reason = text.to_owned();
        let input = match (kind, unwire(event.cycle)) {
            (EventKind::Request, Some(cycle)) => Input::RequestNumber { cycle },
            (EventKind::Withdraw, _) => Input::Abort { reason },
            (EventKind::Renew, _) => {
                self.tally.renew = true;
                Input::Stop { reason }
            }
            _ => return Ok(()),
        };
        self.step(input, each)
    }

    /// Names of the cameras that are connected to this computer.
    pub(super) fn cameras_here(cell: &cell::Cell) -> Vec<String> {
        let here = (0..cell.graph.cameras.len()).filter(|&camera| cell.graph.has_camera(camera));
        here.map(|camera| cell.graph.camera_name(camera).to_owned()).collect()
    }
}
