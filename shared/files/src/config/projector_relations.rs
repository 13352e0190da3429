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
        if projector.screen.is_some() || projector.lightcrafter.is_some() {
            check_generated(document, (index, projector))?;
        }
        let exposed = exposed(document, cell, (index, projector))?;
        let longest_us = exposed.iter().map(|(_, exposure_us)| *exposure_us).fold(0.0, f64::max);
        match projector.trigger {
            TriggerMode::Sequenced { period_ms } => {
                check_period(document, (index, projector), period_ms, &exposed)?;
            }
            TriggerMode::Stepped if projector.light_period_us().is_some() => {
                needed_us += projector.frames() as f64 * (projector.settle_us() + longest_us);
            }
            TriggerMode::Stepped => {}
        }
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
    let place = |p: &ProjectorConfig| -> Option<ScreenPlace> { Some(p.shown_on()?.place.clone()) };
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

/// Cameras of a projector by their numbers, with their exposures, µs, as far as they are stated. Where the light comes in refreshes, or stands
/// for whole patterns of a board, they are stated and last for whole ones: else frames differ in brightness.
fn exposed(
    document: &Document,
    cell: &Configuration,
    (index, projector): (usize, &ProjectorConfig),
) -> Result<Vec<(usize, f64)>, FileError> {
    // A board that runs by itself shows each pattern once.
    let once = projector.trigger != TriggerMode::Stepped && projector.lightcrafter.is_some();
    let period_us = projector.light_period_us().filter(|_| !once);
    let mut exposed = Vec::new();
    for (number, camera) in cell.cameras.iter().enumerate() {
        let (true, Some(genicam)) = (projector.cameras.contains(&camera.name), &camera.genicam) else {
            continue;
        };
        match (genicam.exposure_us, period_us) {
            (Some(exposure_us), None) => exposed.push((number, exposure_us)),
            (None, None) => {}
            (None, Some(period_us)) => {
                let problem = Problem::Missing(format!("exposure_us of camera \"{}\"", camera.name));
                let light = light(projector, period_us);
                let remedy = format!("{light}: add exposure_us = {period_us:.0}, or a multiple of it");
                return Err(document.fault(&format!("camera[{number}]"), problem, remedy));
            }
            (Some(exposure_us), Some(period_us)) => {
                if let Some(whole_us) = missed(exposure_us, period_us) {
                    let problem =
                        value(format!("{exposure_us} µs"), format!("a multiple of {period_us:.0} µs"));
                    let light = light(projector, period_us);
                    let remedy = format!("{light}; write exposure_us = {whole_us:.0} (projector[{index}])");
                    return Err(document.fault(&format!("camera[{number}].exposure_us"), problem, remedy));
                }
                exposed.push((number, exposure_us));
            }
        }
    }
    Ok(exposed)
}

fn light(projector: &ProjectorConfig, period_us: f64) -> String {
    format!("the light of projector \"{}\" comes in periods of {period_us:.0} µs", projector.name)
}

/// The nearest whole number of periods to a time, where it is none, µs.
fn missed(time_us: f64, period_us: f64) -> Option<f64> {
    let whole_us = (time_us / period_us).round().max(1.0) * period_us;
    ((time_us - whole_us).abs() > PERIOD_TOLERANCE * period_us).then_some(whole_us)
}

/// A projector that runs by itself goes on after whole refreshes, and after every camera has exposed.
fn check_period(
    document: &Document,
    (index, projector): (usize, &ProjectorConfig),
    period_ms: f64,
    exposed: &[(usize, f64)],
) -> Result<(), FileError> {
    let refresh_us = projector.refresh_hz.map(|hz| 1e6 / hz);
    if let Some(refresh_us) = refresh_us
        && let Some(whole_us) = missed(period_ms * 1e3, refresh_us)
    {
        let limit = format!(
            "a multiple of {:.3} ms, one refresh of projector \"{}\"",
            refresh_us / 1e3,
            projector.name
        );
        let remedy = format!("write period_ms = {:.3}", whole_us / 1e3);
        let key = format!("projector[{index}].period_ms");
        return Err(document.fault(&key, value(format!("{period_ms} ms"), limit), remedy));
    }
    match exposed.iter().find(|(_, exposure_us)| *exposure_us >= period_ms * 1e3) {
        Some((number, exposure_us)) => {
            let limit =
                format!("below {} µs, the period_ms of projector \"{}\"", period_ms * 1e3, projector.name);
            let key = format!("camera[{number}].exposure_us");
            Err(document.fault(&key, value(format!("{exposure_us} µs"), limit), "or raise period_ms"))
        }
        None => Ok(()),
    }
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
