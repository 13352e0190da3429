//! How grey levels become pixels of a display.

use x11rb::connection::Connection;
use x11rb::protocol::xproto::{ImageOrder, Visualtype};
use x11rb::rust_connection::RustConnection;

/// How a pixel of the display lies in four bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    /// Bits of a pixel that count.
    pub depth: u8,
    /// Places of red, green and blue among the four bytes.
    places: [usize; 3],
}

impl Layout {
    /// Of a visual of the display; `None` where its pixels are others.
    pub fn of(connection: &RustConnection, depth: u8, visual: &Visualtype) -> Option<Self> {
        let setup = connection.setup();
        let format = setup.pixmap_formats.iter().find(|format| format.depth == depth)?;
        let place = |mask: u32| {
            let byte = (0..4).find(|byte| mask == 0xff << (8 * byte))?;
            Some(if setup.image_byte_order == ImageOrder::LSB_FIRST { byte } else { 3 - byte })
        };
        let places = [place(visual.red_mask)?, place(visual.green_mask)?, place(visual.blue_mask)?];
        (format.bits_per_pixel == 32 && format.scanline_pad == 32).then_some(Self { depth, places })
    }

    /// The pixels of a pattern.
    pub fn drawn(self, pattern: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0; pattern.len() * 4];
        for (pixel, level) in bytes.chunks_exact_mut(4).zip(pattern) {
            for place in self.places {
                pixel[place] = *level;
            }
        }
        bytes
    }

    /// Number of pixels that are not those of the pattern, and the first of them.
    pub fn differs(self, bytes: &[u8], pattern: &[u8]) -> Option<(usize, usize)> {
        let wrong = bytes
            .chunks_exact(4)
            .zip(pattern)
            .enumerate()
            .filter(|(_, (pixel, level))| self.places.iter().any(|place| pixel[*place] != **level));
        let mut wrong = wrong.map(|(place, _)| place);
        let first = wrong.next()?;
        Some((wrong.count() + 1, first))
    }
}
