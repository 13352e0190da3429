//! The controller of the boards LightCrafter 6500 and 9000: patterns that are sent over USB when the cell starts.
//!
//! Commands, values and their order are those of DLPU018J (DLPC900 programmer's guide); section 5 has the example that this follows.

use super::erle::compressed;
use super::link::{Command, Link};
use super::{RUNNING, check_hardware, commands};
use cell::configuration::LightCrafterSettings;
use cell::lightcrafter::Place;
use std::time::Duration;

/// Product number on USB; the vendor is 0x0451.
pub const PRODUCT: u16 = 0xc900;

/// 3 = patterns sent over USB. Section 2.4.1.
pub const MODE: Command = Command(0x1a1b, "display mode");
/// Kind of mirrors and name of the firmware. Section 2.1.5.
pub const HARDWARE: Command = Command(0x0206, "kind of hardware");
/// One pattern, 12 bytes.
pub const PATTERN: Command = Command(0x1a34, "definition of a pattern");
/// Number of patterns (16 bits) and how many are shown (32 bits, 0 = without end).
pub const SEQUENCE: Command = Command(0x1a31, "control of the pattern table");
/// The same, and the patterns that are shown (16 bits each).
pub const ORDER: Command = Command(0x1a32, "order of the patterns");
/// Number of an image (16 bits) and its bytes with header (32 bits); for the left and the right controller.
pub const BEGIN_IMAGE: [Command; 2] =
    [Command(0x1a2a, "begin of an image"), Command(0x1a2c, "begin of a right half")];
/// Number of bytes (16 bits) and as many bytes, at most 504.
pub const IMAGE_DATA: [Command; 2] =
    [Command(0x1a2b, "data of an image"), Command(0x1a2d, "data of a right half")];

/// The mode of patterns that are sent.
const ON_THE_FLY: u8 = 3;

/// Most bytes of an image in one message: its buffer of 512 bytes less header, command and number of bytes.
const PART_BYTES: usize = 504;

/// Longest time until the controller has changed its mode.
const MODE_WAIT: Duration = Duration::from_secs(5);
/// Longest time until a sequence runs.
const RUN_WAIT: Duration = Duration::from_secs(2);

/// Mirrors by the first byte of [`HARDWARE`] (section 2.1.5).
const MIRRORS: [(u8, &str, [u32; 2]); 3] =
    [(1, "DLP6500", [1920, 1080]), (2, "DLP9000", [2560, 1600]), (5, "DLP5500", [1024, 768])];

/// Prepares the board and sends the images, numbered from 0, each with three bytes a pixel.
pub fn prepare(
    link: &mut Link,
    board: &LightCrafterSettings,
    size_px: [u32; 2],
    places: &[Place],
    images: &[Vec<u8>],
) -> Result<(), String> {
    check_hardware(link)?;
    let found = link.read(HARDWARE, 1)?[0];
    let known = MIRRORS.iter().find(|(number, ..)| *number == found);
    let [width, height] = size_px;
    match known {
        Some((.., size)) if *size == size_px => {}
        Some((_, name, [columns, rows])) => {
            return Err(format!(
                "the board has a {name} of {columns} × {rows} px, the projector of the configuration {width} × {height}; correct \
                 width_px and height_px"
            ));
        }
        None => {
            return Err(format!(
                "{HARDWARE}: {found:#04x} is none of DLP6500, DLP9000 and DLP5500, which are supported"
            ));
        }
    }
    link.write(commands::START, &[commands::STOPPED])?;
    link.write(MODE, &[ON_THE_FLY])?;
    link.until(MODE, MODE_WAIT, |found| found & 3 == ON_THE_FLY)?;
    for (number, place) in places.iter().enumerate() {
        link.write(PATTERN, &definition(board, number, *place))?;
    }
    let mut all = (places.len() as u16).to_le_bytes().to_vec();
    all.extend(0_u32.to_le_bytes());
    link.set(SEQUENCE, &all)?;
    // In reverse order, as the guide demands (Initialize Pattern BMP Load).
    images.iter().enumerate().rev().try_for_each(|(number, rgb)| send_image(link, number, size_px, rgb))
}

/// A row of the pattern table (section 2.4.4.3.5): number, exposure in 24 bits, depth and light, dark time in 24 bits, trigger 2,
/// image and bit.
pub fn definition(board: &LightCrafterSettings, number: usize, place: Place) -> [u8; 12] {
    let exposure = board.exposure_us.to_le_bytes();
    let dark = (board.period_us - board.exposure_us).to_le_bytes();
    let [low, high] = (number as u16).to_le_bytes();
    // Cleared after its exposure, as in the guide's example; depth less 1; light; started by the controller itself.
    let how = 1 | (place.bits - 1) << 1 | board.led.bits() << 4;
    let from = (place.image as u16 & 0x7ff) | u16::from(place.bit) << 11;
    let [image, bit] = from.to_le_bytes();
    [low, high, exposure[0], exposure[1], exposure[2], how, dark[0], dark[1], dark[2], 0, image, bit]
}

/// Sends an image, to two controllers where there are two: the left half to the first one.
fn send_image(link: &mut Link, number: usize, [width, height]: [u32; 2], rgb: &[u8]) -> Result<(), String> {
    if width <= MOST_COLUMNS {
        return send_to(link, 0, number, &compressed(width, height, rgb));
    }
    let row_bytes = width as usize * 3;
    for side in 0..2 {
        let half =
            rgb.chunks_exact(row_bytes).filter_map(|row| row.chunks_exact(row_bytes / 2).nth(side)).flatten();
        let half: Vec<u8> = half.copied().collect();
        send_to(link, side, number, &compressed(width / 2, height, &half))?;
    }
    Ok(())
}

/// Most columns that one controller drives.
const MOST_COLUMNS: u32 = 1920;

fn send_to(link: &mut Link, side: usize, number: usize, image: &[u8]) -> Result<(), String> {
    let mut begin = (number as u16).to_le_bytes().to_vec();
    begin.extend((image.len() as u32).to_le_bytes());
    link.write(BEGIN_IMAGE[side], &begin)?;
    for part in image.chunks(PART_BYTES) {
        let mut data = (part.len() as u16).to_le_bytes().to_vec();
        data.extend(part);
        link.write(IMAGE_DATA[side], &data)?;
    }
    Ok(())
}

/// Shows one of the patterns again and again.
pub fn show(link: &mut Link, number: usize) -> Result<(), String> {
    start(link, &[number], 0)
}

/// Shows so many patterns once, in their order; output 1 frames the exposure of each.
pub fn run(link: &mut Link, patterns: usize) -> Result<(), String> {
    let all: Vec<usize> = (0..patterns).collect();
    start(link, &all, patterns)
}

/// Starts patterns in this order; so many are shown in all, 0: without end. The message holds 250 of them.
fn start(link: &mut Link, patterns: &[usize], shown: usize) -> Result<(), String> {
    link.write(commands::START, &[commands::STOPPED])?;
    let mut order = (patterns.len() as u16).to_le_bytes().to_vec();
    order.extend((shown as u32).to_le_bytes());
    order.extend(patterns.iter().flat_map(|number| (*number as u16).to_le_bytes()));
    link.write(ORDER, &order)?;
    link.write(commands::START, &[commands::RUN])?;
    link.until(commands::STATUS, RUN_WAIT, |status| status & RUNNING != 0)?;
    check_hardware(link)
}
