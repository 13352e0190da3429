//! The controller of the LightCrafter 4500: patterns from flash or from the video input.
//!
//! Commands, values and their order are those of DLPU010 (DLPC350 programmer's guide) and of the software that Texas Instruments
//! published with it (`dlpc350_api.cpp`), whose comments repeat the guide's tables.

use super::link::{Command, Link};
use super::{RUNNING, check_hardware, commands};
use cell::configuration::LightCrafterSettings;
use cell::lightcrafter::{PatternSource, Place};
use std::time::Duration;

/// Product number on USB; the vendor is 0x0451.
pub const PRODUCT: u16 = 0x6401;

/// 0 = normal operation.
pub const POWER: Command = Command(0x0200, "power mode");
/// 0 = video, 1 = patterns.
pub const MODE: Command = Command(0x1a1b, "display mode");
/// 0 = video input, 3 = flash.
pub const SOURCE: Command = Command(0x1a22, "source of patterns");
/// 0 = the vertical sync of the video starts a sequence, 1 = the controller itself or an input.
pub const TRIGGER: Command = Command(0x1a23, "trigger of patterns");
/// Exposure and period, µs, 32 bits each.
pub const TIMES: Command = Command(0x1a29, "exposure and period");
/// Number of patterns − 1, repeat, patterns for trigger 2 − 1, images − 1.
pub const SEQUENCE: Command = Command(0x1a31, "control of the pattern table");
/// Place in the open table.
pub const TABLE_PLACE: Command = Command(0x1a32, "place in a table");
/// 0 = closed, 1 = numbers of images, 2 = patterns.
pub const TABLE: Command = Command(0x1a33, "open or close a table");
/// Content of the open table.
pub const TABLE_DATA: Command = Command(0x1a34, "content of a table");
/// Checks all settings; bit 7 of its value stands until it is done.
pub const VALIDATE: Command = Command(0x1a1a, "check of the settings");
/// Polarity, rising and falling edge of output 1: 0xBB = no delay, a step is 107.2 ns.
pub const TRIGGER_OUT_1: Command = Command(0x1a1d, "trigger output 1");
/// Number of images in flash.
pub const IMAGES: Command = Command(0x1a42, "number of images in flash");

/// Edges of the trigger output at the beginning and the end of a pattern.
pub const NO_DELAY: u8 = 0xbb;

/// A pattern starts by the controller's own clock; or, after the first one, goes on from the pattern before.
const INTERNAL: u8 = 0;
/// The mirrors are dark from the end of the exposure to the end of the period.
const DARK: u32 = 1 << 17;
/// The image in the buffer is exchanged for the next one before this pattern.
const SWAP_IMAGES: u32 = 1 << 18;

/// Longest time until the controller has changed its mode.
const MODE_WAIT: Duration = Duration::from_secs(3);
/// Longest time for a check, and until a sequence runs.
const CHECK_WAIT: Duration = Duration::from_secs(2);

/// Names of the bits of a check (DLPU010, pattern display lookup table validation): the first two are errors, the rest warnings.
const CHECK_BITS: [&str; 5] = [
    "exposure or period",
    "number of a pattern",
    "trigger output 1 without a pause",
    "no dark time before an external trigger",
    "period less exposure below 230 µs",
];

/// Prepares the board; `last_image` is the number of the last image in flash that the sequence needs.
pub fn prepare(link: &mut Link, board: &LightCrafterSettings, last_image: usize) -> Result<(), String> {
    check_hardware(link)?;
    link.write(POWER, &[0])?;
    link.write(commands::START, &[commands::STOPPED])?;
    let flash = board.source == PatternSource::Flash;
    if flash {
        let images = usize::from(link.read(IMAGES, 1)?[0]);
        if last_image >= images {
            return Err(format!(
                "image {last_image} (from 0) is needed, the flash has {images} images; write those of `fringetool patterns` \
                 to it, or correct first_image"
            ));
        }
    }
    link.write(MODE, &[1])?;
    link.until(MODE, MODE_WAIT, |mode| mode == 1)?;
    link.set(SOURCE, &[if flash { 3 } else { 0 }])?;
    link.set(TRIGGER, &[u8::from(flash)])?;
    let times: Vec<u8> =
        [board.exposure_us, board.period_us].iter().flat_map(|us| us.to_le_bytes()).collect();
    link.set(TIMES, &times)?;
    link.set(TRIGGER_OUT_1, &[0, NO_DELAY, NO_DELAY])
}

/// Shows one pattern again and again. With the video input every place means the picture that stands there.
pub fn show(link: &mut Link, board: &LightCrafterSettings, place: Place) -> Result<(), String> {
    // Repeated, trigger 2 with each; all but the second counted from 0.
    start(link, board, &[place], [0, 1, 0, 0])
}

/// Shows patterns from flash once, in their order; output 1 frames the exposure of each.
pub fn run(link: &mut Link, board: &LightCrafterSettings, places: &[Place]) -> Result<(), String> {
    let last = |count: usize| u8::try_from(count.saturating_sub(1)).unwrap_or(u8::MAX);
    let patterns = last(places.len());
    start(link, board, places, [patterns, 0, patterns, last(images(places).len())])
}

/// Starts patterns; `control`: see [`SEQUENCE`].
fn start(
    link: &mut Link,
    board: &LightCrafterSettings,
    places: &[Place],
    control: [u8; 4],
) -> Result<(), String> {
    link.write(commands::START, &[commands::STOPPED])?;
    link.set(SEQUENCE, &control)?;
    if board.source == PatternSource::Flash {
        table(link, 1, &images(places))?;
    }
    let mut rows = Vec::with_capacity(3 * places.len());
    for (number, place) in places.iter().enumerate() {
        let swap = number == 0 || places[number - 1].image != place.image;
        rows.extend(&entry(board, *place, swap).to_le_bytes()[..3]);
    }
    table(link, 2, &rows)?;
    check(link, board)?;
    link.write(commands::START, &[commands::RUN])?;
    link.until(commands::START, CHECK_WAIT, |state| state == commands::RUN)?;
    link.until(commands::STATUS, CHECK_WAIT, |status| status & RUNNING != 0)?;
    check_hardware(link)
}

/// Numbers in flash of the images that patterns lie in, in their order.
fn images(places: &[Place]) -> Vec<u8> {
    let mut images: Vec<u8> = places.iter().map(|place| place.image as u8).collect();
    images.dedup();
    images
}

/// A row of the pattern table, three bytes: trigger (bits 0, 1), number of the pattern (2 … 7), bits (8 … 11), light (12 … 14),
/// dark after the exposure (17), exchange of images (18).
pub fn entry(board: &LightCrafterSettings, place: Place, swap: bool) -> u32 {
    // Patterns of 8 bits are numbered by colour: green 0, red 1, blue 2; those of one bit by bit, in the same order.
    let number = if place.bits == 8 { place.bit / 8 } else { place.bit };
    u32::from(INTERNAL)
        | u32::from(number) << 2
        | u32::from(place.bits) << 8
        | u32::from(board.led.bits()) << 12
        | if board.period_us > board.exposure_us { DARK } else { 0 }
        | if swap { SWAP_IMAGES } else { 0 }
}

/// Writes a table from its beginning, and reads it back.
fn table(link: &mut Link, number: u8, data: &[u8]) -> Result<(), String> {
    link.write(TABLE, &[number])?;
    link.write(TABLE_PLACE, &[0])?;
    link.write(TABLE_DATA, data)?;
    link.write(TABLE_PLACE, &[0])?;
    let found = link.read(TABLE_DATA, data.len())?;
    link.write(TABLE, &[0])?;
    if found[..data.len()] != *data {
        let found = &found[..data.len()];
        return Err(format!(
            "{TABLE_DATA}: {data:02x?} was written to table {number}, the board has {found:02x?}"
        ));
    }
    Ok(())
}

/// The board's own check of all that was set. Without dark time the warnings of outputs and periods mean nothing.
fn check(link: &mut Link, board: &LightCrafterSettings) -> Result<(), String> {
    link.write(VALIDATE, &[0])?;
    let found = link.until(VALIDATE, CHECK_WAIT, |found| found & 0x80 == 0)?;
    let fatal = if board.period_us > board.exposure_us { 0x13 } else { 0x03 };
    let named = CHECK_BITS.iter().enumerate().filter(|(bit, _)| found & fatal & (1 << bit) != 0);
    let named: Vec<&str> = named.map(|(_, name)| *name).collect();
    if named.is_empty() {
        return Ok(());
    }
    Err(format!("{VALIDATE}: the board finds faults in: {}", named.join(", ")))
}
