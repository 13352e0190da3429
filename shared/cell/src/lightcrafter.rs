//! Projector boards of Texas Instruments: what their controllers can show, and where a frame lies among their patterns.
//!
//! Sizes, times and numbers are those of the programmer's guides (DLPU010 for the DLPC350, DLPU018 for the DLPC900) and of the
//! software that the manufacturer published for the boards.

/// Bits of an image in the memory of a board: three colours of eight.
pub const IMAGE_BITS: usize = 24;

/// The controller of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Controller {
    /// Of the LightCrafter 4500.
    Dlpc350,
    /// Of the boards LightCrafter 6500 and 9000 and their relatives.
    Dlpc900,
}

impl Controller {
    /// All controllers, in the order in which messages name them.
    pub const ALL: [Self; 2] = [Self::Dlpc350, Self::Dlpc900];

    /// Name in the configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dlpc350 => "dlpc350",
            Self::Dlpc900 => "dlpc900",
        }
    }

    /// Sizes of the mirror arrays that can stand behind it, columns and rows. Those of 2560 × 1600 have two controllers.
    pub fn sizes_px(self) -> &'static [[u32; 2]] {
        match self {
            Self::Dlpc350 => &[[912, 1140]],
            Self::Dlpc900 => &[[1920, 1080], [2560, 1600], [1024, 768]],
        }
    }

    /// Sources of patterns that it has.
    pub fn sources(self) -> &'static [PatternSource] {
        match self {
            Self::Dlpc350 => &[PatternSource::Flash, PatternSource::Video],
            Self::Dlpc900 => &[PatternSource::Usb],
        }
    }

    /// Shortest exposure of a pattern of 1 … 8 bits, µs.
    pub fn least_exposure_us(self, bits: u8) -> u32 {
        let least = match self {
            // DLPU010, section on pattern exposure; the manufacturer's software for the board has the same.
            Self::Dlpc350 => [235, 700, 1570, 1700, 2000, 2500, 4500, 8333],
            // DLPU018; with a margin of 0.5 % for the trigger, as the manufacturer's software for the board.
            Self::Dlpc900 => [120, 320, 420, 840, 1230, 1506, 2016, 4065],
        };
        least[usize::from(bits.clamp(1, 8)) - 1]
    }

    /// Longest exposure and period, µs. The DLPC900 counts in 24 bits.
    pub fn most_exposure_us(self) -> u32 {
        10_000_000
    }

    /// A period is as long as the exposure, or longer by so many µs at least.
    pub fn least_dark_us(self) -> u32 {
        match self {
            Self::Dlpc350 => 230,
            Self::Dlpc900 => 105,
        }
    }

    /// Most patterns of a sequence.
    pub fn most_patterns(self) -> usize {
        match self {
            Self::Dlpc350 => 128,
            Self::Dlpc900 => 400,
        }
    }

    /// Most patterns of a sequence that the board shows by itself, once and in its order: rows of the pattern table, or what a message about
    /// the order holds.
    pub fn most_run_patterns(self) -> usize {
        match self {
            Self::Dlpc350 => 128,
            // 508 bytes of a message, 2 of them the command, 6 the counts, 2 for each pattern.
            Self::Dlpc900 => 250,
        }
    }

    /// Most images of a sequence: those in flash that one sequence can name, or those that the memory holds.
    pub fn most_images(self) -> usize {
        match self {
            Self::Dlpc350 => 64,
            // DLPU018J, Initialize Pattern BMP Load: image index 0 … 17. 400 bit planes fill 17 of them.
            Self::Dlpc900 => 17,
        }
    }
}

/// Where a board takes its patterns from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PatternSource {
    /// Images that were written to its flash memory before.
    Flash,
    /// Its video input: this computer shows the images on a screen.
    Video,
    /// Images that are sent over USB when the cell starts.
    Usb,
}

impl PatternSource {
    /// All sources, in the order in which messages name them.
    pub const ALL: [Self; 3] = [Self::Flash, Self::Video, Self::Usb];

    /// Name in the configuration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Flash => "flash",
            Self::Video => "video",
            Self::Usb => "usb",
        }
    }
}

/// The light of a board, as the bits of its pattern tables: red 1, green 2, blue 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Led(u8);

impl Led {
    /// All three at once.
    pub const WHITE: Self = Self(7);

    /// Names in the configuration, in the order of their bits from 1.
    pub const NAMES: [&str; 7] = ["red", "green", "yellow", "blue", "magenta", "cyan", "white"];

    /// The light of this name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().position(|known| *known == name).map(|place| Self(place as u8 + 1))
    }

    /// Bits of the pattern tables, 1 … 7.
    pub fn bits(self) -> u8 {
        self.0
    }
}

/// Where the pattern of a frame lies in the images of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Number of the image of 24 bits, from 0.
    pub image: usize,
    /// First bit of the pattern within the image, 0 … 23: green, then red, then blue, least significant bits first.
    pub bit: u8,
    /// Bits of the pattern: 1 or 8.
    pub bits: u8,
}

impl Place {
    /// Byte of an RGB pixel that the pattern lies in.
    fn channel(self) -> usize {
        [1, 0, 2][usize::from(self.bit / 8)]
    }
}

/// Lays patterns of 1 or 8 bits into images of 24, in their order; a pattern of 8 bits takes a colour of its own.
pub fn places(bits: impl IntoIterator<Item = u8>) -> Vec<Place> {
    let mut next = 0;
    let place = |bits: u8| {
        if bits == 8 {
            next = next_multiple(next, 8);
        }
        let place = Place { image: next / IMAGE_BITS, bit: (next % IMAGE_BITS) as u8, bits };
        next += usize::from(bits);
        place
    };
    bits.into_iter().map(place).collect()
}

fn next_multiple(number: usize, of: usize) -> usize {
    number.div_ceil(of) * of
}

/// Number of images that these patterns take.
pub fn image_count(places: &[Place]) -> usize {
    places.last().map_or(0, |last| last.image + 1)
}

/// Draws a pattern into an image: `rgb` has three bytes a pixel, `pattern` one.
pub fn draw(rgb: &mut [u8], place: Place, pattern: &[u8]) {
    let channel = place.channel();
    for (pixel, level) in rgb.chunks_exact_mut(3).zip(pattern) {
        if place.bits == 8 {
            pixel[channel] = *level;
        } else if *level != 0 {
            pixel[channel] |= 1 << (place.bit % 8);
        }
    }
}

/// Takes a pattern out of an image, as the mirrors show it: levels 0 … 255.
pub fn taken(rgb: &[u8], place: Place) -> Vec<u8> {
    let channel = place.channel();
    let level = |pixel: &[u8]| match place.bits {
        8 => pixel[channel],
        _ => 255 * (pixel[channel] >> (place.bit % 8) & 1),
    };
    rgb.chunks_exact(3).map(level).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_lie_one_after_another_and_do_not_touch_each_other() {
        let bits = [8, 8, 1, 1, 8, 8, 1, 8, 1];
        let found = places(bits);
        let at: Vec<(usize, u8)> = found.iter().map(|place| (place.image, place.bit)).collect();
        // The two single bits take a colour of which the rest stays empty.
        let expected = [(0, 0), (0, 8), (0, 16), (0, 17), (1, 0), (1, 8), (1, 16), (2, 0), (2, 8)];
        assert_eq!(at, expected);
        assert_eq!(image_count(&found), 3);
        let pattern = |number: usize| -> Vec<u8> {
            let level = |pixel: usize| (pixel * 37 + number * 11) as u8;
            let levels = (0..5).map(level);
            if bits[number] == 8 { levels.collect() } else { levels.map(|l| 255 * (l & 1)).collect() }
        };
        let mut images = vec![vec![0; 15]; 3];
        for (number, place) in found.iter().enumerate() {
            draw(&mut images[place.image], *place, &pattern(number));
        }
        for (number, place) in found.iter().enumerate() {
            assert_eq!(taken(&images[place.image], *place), pattern(number), "{number}");
        }
    }

    #[test]
    fn a_full_image_holds_24_single_bits_or_three_patterns_of_8() {
        assert_eq!(image_count(&places([1; 24])), 1);
        assert_eq!(image_count(&places([1; 25])), 2);
        assert_eq!(image_count(&places([8; 3])), 1);
        assert_eq!(image_count(&places([8; 4])), 2);
        assert_eq!(image_count(&[]), 0);
        assert_eq!((Led::of_name("green"), Led::of_name("cyan")), (Some(Led(2)), Some(Led(6))));
        assert_eq!(Led::of_name("white"), Some(Led::WHITE));
        assert_eq!(Led::of_name("infrared"), None);
    }

    #[test]
    fn green_is_the_first_colour_of_an_image() {
        let mut rgb = vec![0; 3];
        draw(&mut rgb, places([8])[0], &[200]);
        assert_eq!(rgb, [0, 200, 0]);
        draw(&mut rgb, places([8, 8])[1], &[100]);
        draw(&mut rgb, places([8, 8, 8])[2], &[50]);
        assert_eq!(rgb, [100, 200, 50]);
    }
}
