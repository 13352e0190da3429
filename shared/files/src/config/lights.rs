//! What the projectors of a cell say of each other and of the cameras that look: who shows, and how long it takes.

use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem};
use cell::configuration::{Configuration, Driver, ProjectorConfig, ScreenPlace, TriggerMode};
use fringe::pattern::{PatternError, PatternSet};

/// A camera's exposure may miss whole periods of the light by this part of a period: then brightness differs by as much
/// from frame to frame, at the worst. Whole µs of 60 Hz fit within it, and 59.94 Hz for up to ten periods.
const PERIOD_TOLERANCE: f64 = 0.01;

/// Projectors of one cell can take turns, and their times fit cameras and deadline.
pub(super) fn check_lights(document: &Document, cell: &Configuration) -> Result<(), FileError> {
    check_together(document, &cell.projectors)?;
    check_places(document, &cell.projectors)?;
    let mut needed_us = 0.0;
    for (index, projector) in cell.projectors.iter().enumerate() {
        let Some(period_us) = projector.light_period_us() else { continue };
        check_generated(document, (index, projector))?;
        if projector.trigger != TriggerMode::Stepped {
            continue;
        }
        let longest_us = check_exposures(document, cell, (index, projector), period_us)?;
        needed_us += projector.frames() as f64 * (projector.settle_us() + longest_us);
    }
    let (needed_ms, limit_ms) = ((needed_us / 1e3).ceil() as u64, cell.limits.cycle_deadline_ms);
    if needed_ms > limit_ms {
        let frames: usize = cell.projectors.iter().map(ProjectorConfig::frames).sum();
        let problem = value(
            format!("{limit_ms} ms"),
            format!("at least {needed_ms} ms, which {frames} frames take to be shown and exposed"),
        );
        let remedy = "raise it, or shorten what the projectors need for a frame";
        return Err(document.fault("limits.cycle_deadline_ms", problem, remedy));
    }
    Ok(())
}

/// Who shows the patterns of a projector.
#[derive(PartialEq)]
enum Shows {
    Cell,
    Program(std::net::SocketAddr),
    Devices,
}

impl Shows {
    fn of(projector: &ProjectorConfig) -> Self {
        match (projector.driver, projector.address) {
            (_, Some(address)) => Self::Program(address),
            (Driver::Screen | Driver::LightCrafter, None) => Self::Devices,
            _ => Self::Cell,
        }
    }

    fn words(&self) -> String {
        match self {
            Self::Cell => "the cell itself".into(),
            Self::Program(address) => format!("the program at {address}"),
            Self::Devices => "a device of this computer".into(),
        }
    }
}

/// A projector goes dark when the next one has its turn: nobody could tell another program to do that.
fn check_together(document: &Document, projectors: &[ProjectorConfig]) -> Result<(), FileError> {
    for (index, projector) in projectors.iter().enumerate() {
        let here = Shows::of(projector);
        if let Some(other) = projectors[..index].iter().find(|other| Shows::of(other) != here) {
            let problem = Problem::Disagreement {
                what: "projectors",
                here: format!("projector \"{}\" is shown by {}", projector.name, here.words()),
                there: format!("projector \"{}\" by {}", other.name, Shows::of(other).words()),
            };
            let remedy = "let one program show the patterns of all projectors";
            return Err(document.fault(&format!("projector[{index}].driver"), problem, remedy));
        }
    }
    Ok(())
}

/// Each projector is a device of its own, and it is stated which one.
fn check_places(document: &Document, projectors: &[ProjectorConfig]) -> Result<(), FileError> {
    let place = |p: &ProjectorConfig| -> Option<ScreenPlace> {
        let of_board = p.lightcrafter.as_ref().and_then(|board| board.screen.as_ref());
        p.screen.as_ref().or(of_board).map(|screen| screen.place.clone())
    };
    for (index, projector) in projectors.iter().enumerate() {
        let earlier = &projectors[..index];
        if let Some(screen) = place(projector)
            && let Some(other) = earlier.iter().find(|other| place(other).as_ref() == Some(&screen))
        {
            let part = if matches!(screen, ScreenPlace::Output(_)) { "output" } else { "position_px" };
            let problem = Problem::Disagreement {
                what: "outputs",
                here: format!("projector \"{}\" has the same output", projector.name),
                there: format!("projector \"{}\"", other.name),
            };
            let remedy = "give each projector an output of its own";
            return Err(document.fault(&format!("projector[{index}].{part}"), problem, remedy));
        }
        let Some(board) = &projector.lightcrafter else { continue };
        let same = |other: &&ProjectorConfig| {
            let other = other.lightcrafter.as_ref();
            other.is_some_and(|o| {
                let unknown = o.device.is_none() || board.device.is_none();
                o.device == board.device || (unknown && o.controller == board.controller)
            })
        };
        if let Some(other) = earlier.iter().find(same) {
            let problem = Problem::Missing(format!(
                "which board is \"{}\" and which is \"{}\"",
                projector.name, other.name
            ));
            let remedy = "give each projector a device = \"…\" of its own: a serial number, or a path such as /dev/hidraw0";
            return Err(document.fault(&format!("projector[{index}]"), problem, remedy));
        }
    }
    Ok(())
}

/// Light that comes in pulses is exposed for whole periods, else frames differ in brightness. The longest exposure, µs.
fn check_exposures(
    document: &Document,
    cell: &Configuration,
    (index, projector): (usize, &ProjectorConfig),
    period_us: f64,
) -> Result<f64, FileError> {
    let mut longest_us: f64 = 0.0;
    for (number, camera) in cell.cameras.iter().enumerate() {
        let (true, Some(genicam)) = (projector.cameras.contains(&camera.name), &camera.genicam) else {
            continue;
        };
        let key = format!("camera[{number}].exposure_us");
        let whole = |exposure_us: f64| (exposure_us / period_us).round().max(1.0);
        let light =
            format!("the light of projector \"{}\" comes in periods of {period_us:.0} µs", projector.name);
        let Some(exposure_us) = genicam.exposure_us else {
            let problem = Problem::Missing(format!("exposure_us of camera \"{}\"", camera.name));
            let remedy = format!("{light}: add exposure_us = {period_us:.0}, or a multiple of it");
            return Err(document.fault(&format!("camera[{number}]"), problem, remedy));
        };
        let periods = whole(exposure_us);
        if (exposure_us - periods * period_us).abs() > PERIOD_TOLERANCE * period_us {
            let problem = value(format!("{exposure_us} µs"), format!("a multiple of {period_us:.0} µs"));
            let remedy =
                format!("{light}; write exposure_us = {:.0} (projector[{index}])", periods * period_us);
            return Err(document.fault(&key, problem, remedy));
        }
        longest_us = longest_us.max(exposure_us);
    }
    Ok(longest_us)
}

/// What is shown has to be computed.
pub(super) fn check_generated(
    document: &Document,
    (index, projector): (usize, &ProjectorConfig),
) -> Result<(), FileError> {
    let foreign = |set: &PatternSet| matches!(set, PatternSet::Random { .. });
    let Some(set) = projector.sequence.iter().position(foreign) else { return Ok(()) };
    let problem = Problem::Pattern(PatternError::NotGenerated("random"));
    let key = format!("projector[{index}].sequence[{set}]");
    Err(document.fault(&key, problem, "remove it from what is projected; it can only be recorded"))
}
