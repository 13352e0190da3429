//! Projectors that this computer drives itself: screens and boards with their own pattern memory.

use super::devices::{needs, within_if_there};
use super::raw::RawProjector;
use super::values::value;
use crate::document::Document;
use crate::error::{FileError, Problem};
use crate::rig_file::unknown;
use cell::configuration::{
    Driver, LightCrafterSettings, ProjectorConfig, ScreenPlace, ScreenSettings, TriggerMode,
};
use cell::lightcrafter::{Controller, Led, PatternSource, image_count, places};

/// Refreshes of a screen in a second where none are stated.
const REFRESH_HZ: f64 = 60.0;
/// Refresh rates of screens, and of projectors that others work, Hz.
const SCREEN_HZ: [f64; 2] = [1.0, 1000.0];
const PROJECTOR_HZ: [f64; 2] = [1.0, 20_000.0];
/// Refreshes until the light stands where none are stated: what projectors with a frame memory need.
const DELAY_REFRESHES: u32 = 2;
/// Images that a flash holds at most, as one byte numbers them; and those that the DLPC350 holds at once.
const FLASH_IMAGES: usize = 256;
const LOADED_IMAGES: usize = 2;
/// Loading an image from flash, ms; measured by nobody here, so the configuration may state another time.
const FLASH_SETTLE_MS: u32 = 250;
/// Starting a sequence that is already in memory, ms.
const USB_SETTLE_MS: u32 = 50;

/// What a screen and a board need to be found, as the configuration states it.
#[derive(Default)]
pub(super) struct Light {
    /// With the driver "screen".
    pub(super) screen: Option<ScreenSettings>,
    /// With the driver "lightcrafter".
    pub(super) lightcrafter: Option<LightCrafterSettings>,
    /// With any other driver, where it is stated.
    pub(super) refresh_hz: Option<f64>,
}

/// Reads the keys of the drivers "screen" and "lightcrafter"; refuses them for other drivers.
pub(super) fn light(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    driver: Driver,
) -> Result<Light, FileError> {
    let board = [
        ("controller", raw.controller.is_some()),
        ("source", raw.source.is_some()),
        ("exposure_us", raw.exposure_us.is_some()),
        ("period_us", raw.period_us.is_some()),
        ("led", raw.led.is_some()),
        ("one_bit", raw.one_bit.is_some()),
        ("first_image", raw.first_image.is_some()),
        ("settle_ms", raw.settle_ms.is_some()),
        ("device", raw.device.is_some()),
    ];
    let screen = [
        ("display", raw.display.is_some()),
        ("output", raw.output.is_some()),
        ("position_px", raw.position_px.is_some()),
        ("refresh_hz", raw.refresh_hz.is_some()),
        ("delay_refreshes", raw.delay_refreshes.is_some()),
    ];
    let foreign = |keys: &[(&str, bool)], other: &str| match keys.iter().find(|(_, present)| *present) {
        Some((part, _)) => Err(needs(document, &format!("{key}.{part}"), &raw.driver, other)),
        None => Ok(()),
    };
    match driver {
        Driver::Screen => {
            foreign(&board, "lightcrafter")?;
            Ok(Light { screen: Some(screen_settings(document, key, raw)?), ..Light::default() })
        }
        Driver::LightCrafter => {
            let settings = board_settings(document, key, raw)?;
            if settings.source != PatternSource::Video
                && let Some((part, _)) = screen.iter().find(|(_, present)| *present)
            {
                let problem = Problem::Unsupported(format!(
                    "a board with source = \"{}\" takes no pictures from a screen",
                    settings.source.name()
                ));
                let remedy = "remove the key, or use source = \"video\"";
                return Err(document.fault(&format!("{key}.{part}"), problem, remedy));
            }
            Ok(Light { lightcrafter: Some(settings), ..Light::default() })
        }
        _ => {
            foreign(&board, "lightcrafter")?;
            // Every projector may state how often it refreshes.
            let of_screens: Vec<_> = screen.into_iter().filter(|(part, _)| *part != "refresh_hz").collect();
            foreign(&of_screens, "screen")?;
            let key = format!("{key}.refresh_hz");
            Ok(Light {
                refresh_hz: within_if_there(document, &key, raw.refresh_hz, PROJECTOR_HZ, "Hz")?,
                ..Light::default()
            })
        }
    }
}

fn screen_settings(document: &Document, key: &str, raw: &RawProjector) -> Result<ScreenSettings, FileError> {
    let place = match (&raw.output, raw.position_px) {
        (Some(name), None) => ScreenPlace::Output(name.clone()),
        (None, Some(corner)) => ScreenPlace::Corner(corner),
        _ => {
            let problem =
                Problem::Missing(format!("either output or position_px of projector \"{}\"", raw.name));
            let remedy = "`xrandr` lists the outputs and where they stand, for instance output = \"HDMI-1\"; write one of them";
            return Err(document.fault(key, problem, remedy));
        }
    };
    let refresh_hz =
        within_if_there(document, &format!("{key}.refresh_hz"), raw.refresh_hz, SCREEN_HZ, "Hz")?;
    let delay =
        whole(document, &format!("{key}.delay_refreshes"), raw.delay_refreshes, 0..=100, "refreshes")?;
    Ok(ScreenSettings {
        display: raw.display.clone(),
        place,
        refresh_hz: refresh_hz.unwrap_or(REFRESH_HZ),
        delay_refreshes: delay.unwrap_or(DELAY_REFRESHES),
    })
}

fn board_settings(
    document: &Document,
    key: &str,
    raw: &RawProjector,
) -> Result<LightCrafterSettings, FileError> {
    let at = |part: &str| format!("{key}.{part}");
    let missing = |part: &str, remedy: &str| {
        let problem = Problem::Missing(format!("{part} of projector \"{}\"", raw.name));
        document.fault(key, problem, remedy)
    };
    let names = Controller::ALL.map(Controller::name);
    let Some(name) = &raw.controller else {
        return Err(missing("controller", "add controller = \"dlpc350\" (LightCrafter 4500) or \"dlpc900\""));
    };
    let controller = Controller::ALL.into_iter().find(|c| c.name() == name);
    let controller =
        controller.ok_or_else(|| unknown(document, &at("controller"), "controller", name, names))?;
    let source = source(document, &at("source"), raw, controller)?;
    let most_us = controller.most_exposure_us();
    let exposure_us = whole(document, &at("exposure_us"), raw.exposure_us, 1..=most_us, "µs")?
        .ok_or_else(|| missing("exposure_us", "add exposure_us = 8334, for instance"))?;
    let period_us = whole(document, &at("period_us"), raw.period_us, 1..=most_us, "µs")?;
    let led = match &raw.led {
        None => Led::WHITE,
        Some(name) => {
            Led::of_name(name).ok_or_else(|| unknown(document, &at("led"), "light", name, Led::NAMES))?
        }
    };
    if raw.first_image.is_some() && source != PatternSource::Flash {
        let problem = Problem::Unsupported(format!("source = \"{}\" has no images in flash", source.name()));
        return Err(document.fault(&at("first_image"), problem, "remove the key"));
    }
    let settle_ms = whole(document, &at("settle_ms"), raw.settle_ms, 0..=10_000, "ms")?;
    Ok(LightCrafterSettings {
        controller,
        source,
        exposure_us,
        period_us: period_us.unwrap_or(exposure_us),
        led,
        one_bit: raw.one_bit.unwrap_or(false),
        first_image: whole(document, &at("first_image"), raw.first_image, 0..=255, "")?.unwrap_or(0) as u8,
        settle_ms: settle_ms.unwrap_or(match source {
            PatternSource::Flash => FLASH_SETTLE_MS,
            PatternSource::Usb => USB_SETTLE_MS,
            PatternSource::Video => 0,
        }),
        device: raw.device.clone(),
        screen: match source {
            PatternSource::Video => Some(screen_settings(document, key, raw)?),
            PatternSource::Flash | PatternSource::Usb => None,
        },
    })
}

fn source(
    document: &Document,
    key: &str,
    raw: &RawProjector,
    controller: Controller,
) -> Result<PatternSource, FileError> {
    let known = controller.sources().iter().map(|source| source.name());
    let Some(name) = &raw.source else { return Ok(controller.sources()[0]) };
    let source = PatternSource::ALL.into_iter().find(|source| source.name() == name);
    match source {
        Some(source) if controller.sources().contains(&source) => Ok(source),
        Some(_) => {
            let possible: Vec<&str> = known.collect();
            let problem = value(
                format!("{name:?}"),
                format!("\"{}\" with the {}", possible.join("\" or \""), controller.name()),
            );
            Err(document.fault(key, problem, ""))
        }
        None => Err(unknown(document, key, "source", name, known)),
    }
}

/// What a board can show of the sequence of its projector, once that is checked.
pub(super) fn check_board(
    document: &Document,
    key: &str,
    projector: &ProjectorConfig,
) -> Result<(), FileError> {
    let Some(board) = &projector.lightcrafter else { return Ok(()) };
    let (controller, name) = (board.controller, board.controller.name());
    let size = |[width, height]: [u32; 2]| format!("{width} × {height}");
    if !controller.sizes_px().contains(&projector.size_px()) {
        let possible: Vec<String> = controller.sizes_px().iter().map(|other| size(*other)).collect();
        let problem = value(
            format!("{} px", size(projector.size_px())),
            format!("{} px, the mirrors of boards with the {name}", possible.join(" or ")),
        );
        let remedy = "write width_px and height_px of the board; its rows of mirrors are shown one to one";
        return Err(document.fault(&format!("{key}.width_px"), problem, remedy));
    }
    let bits = projector
        .pattern_bits(board.one_bit)
        .map_err(|error| document.fault(&format!("{key}.sequence"), Problem::Pattern(error), ""))?;
    let deepest = bits.iter().copied().max().unwrap_or(8);
    check_times(document, key, (board, projector.trigger), deepest)?;
    check_memory(document, key, (board, projector.trigger), &bits)
}

/// The patterns fit into the memory of the board and into one sequence, and images from flash are there in time.
fn check_memory(
    document: &Document,
    key: &str,
    (board, trigger): (&LightCrafterSettings, TriggerMode),
    bits: &[u8],
) -> Result<(), FileError> {
    let (controller, name) = (board.controller, board.controller.name());
    let places = places(bits.iter().copied());
    let (images, runs) = (image_count(&places), trigger != TriggerMode::Stepped);
    let first = usize::from(board.first_image);
    let limits = [
        (
            board.source == PatternSource::Usb,
            images,
            controller.most_images(),
            "images of 24 bits in its memory",
        ),
        (board.source == PatternSource::Flash, first + images, FLASH_IMAGES, "images in flash"),
        (
            board.source == PatternSource::Usb,
            bits.len(),
            controller.most_patterns(),
            "patterns of a sequence",
        ),
        (runs, bits.len(), controller.most_run_patterns(), "patterns of a sequence that runs by itself"),
        (runs, images, controller.most_images(), "images of a sequence that runs by itself"),
    ];
    if let Some((_, found, most, what)) =
        limits.iter().find(|(counts, found, most, _)| *counts && found > most)
    {
        let problem = value(format!("{found} {what}"), format!("at most {most} with the {name}"));
        let remedy = "one_bit = true makes frames of black and white alone smaller; or show fewer frames";
        return Err(document.fault(&format!("{key}.sequence"), problem, remedy));
    }
    // Two images are loaded before the start; each further one while the patterns of the one before it stand.
    if board.source != PatternSource::Flash || !runs || images <= LOADED_IMAGES {
        return Ok(());
    }
    let patterns = |image: usize| places.iter().filter(|place| place.image == image).count();
    let fewest = (0..images - 1).map(patterns).min().unwrap_or(1).max(1) as u32;
    if board.settle_ms * 1000 > fewest * board.period_us {
        let least_us = (board.settle_ms * 1000).div_ceil(fewest);
        let problem = value(
            format!("{} µs", board.period_us),
            format!(
                "{least_us} µs and more: while {fewest} patterns of an image stand, the next one is loaded from flash, which \
                 takes {} ms",
                board.settle_ms
            ),
        );
        let remedy = "lengthen it and period_ms, or write the load time of your images as settle_ms (the manufacturer's \
                      software shows it when the firmware is built)";
        let part = if board.period_us == board.exposure_us { "exposure_us" } else { "period_us" };
        return Err(document.fault(&format!("{key}.{part}"), problem, remedy));
    }
    Ok(())
}

fn check_times(
    document: &Document,
    key: &str,
    (board, trigger): (&LightCrafterSettings, TriggerMode),
    bits: u8,
) -> Result<(), FileError> {
    let (controller, name) = (board.controller, board.controller.name());
    let (exposure_us, period_us) = (board.exposure_us, board.period_us);
    let least_us = controller.least_exposure_us(bits);
    if exposure_us < least_us {
        let problem = value(
            format!("{exposure_us} µs"),
            format!("{least_us} µs and more for patterns of {bits} bits with the {name}"),
        );
        let remedy = format!("write exposure_us = {least_us} or more");
        return Err(document.fault(&format!("{key}.exposure_us"), problem, remedy));
    }
    let dark_us = controller.least_dark_us();
    if period_us != exposure_us && period_us < exposure_us + dark_us {
        let problem = value(
            format!("{period_us} µs"),
            format!("exposure_us = {exposure_us}, or {} µs and more with the {name}", exposure_us + dark_us),
        );
        return Err(document.fault(
            &format!("{key}.period_us"),
            problem,
            "leave the key out for no dark time",
        ));
    }
    if let TriggerMode::Sequenced { period_ms } = trigger
        && (period_ms * 1e3 - f64::from(period_us)).abs() > 0.5
    {
        let problem = value(
            format!("{period_ms} ms"),
            format!("{} ms, the period of the board", f64::from(period_us) / 1e3),
        );
        return Err(document.fault(&format!("{key}.period_ms"), problem, "or change period_us"));
    }
    let Some(screen) = &board.screen else { return Ok(()) };
    let refresh_us = 1e6 / screen.refresh_hz;
    if f64::from(period_us) > refresh_us {
        let problem = value(
            format!("{period_us} µs"),
            format!(
                "at most {:.0} µs, a refresh of the video at {} Hz",
                refresh_us.floor(),
                screen.refresh_hz
            ),
        );
        let part = if period_us == exposure_us { "exposure_us" } else { "period_us" };
        return Err(document.fault(&format!("{key}.{part}"), problem, "shorten it, or lower refresh_hz"));
    }
    Ok(())
}

fn whole(
    document: &Document,
    key: &str,
    found: Option<i64>,
    limit: std::ops::RangeInclusive<u32>,
    unit: &str,
) -> Result<Option<u32>, FileError> {
    let Some(found) = found else { return Ok(None) };
    match u32::try_from(found) {
        Ok(number) if limit.contains(&number) => Ok(Some(number)),
        _ => {
            let text = format!("{} … {} {unit}", limit.start(), limit.end());
            Err(document.fault(key, value(found, text.trim_end()), ""))
        }
    }
}
