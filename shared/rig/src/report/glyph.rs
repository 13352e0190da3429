//! A bitmap font of the few signs that the labels of a colour bar need, 5 × 7 pixels each.
//!
//! A stand-alone PNG cannot carry text, and a font file would be a dependency for two dozen signs.

use super::colour::Rgb;
use super::raster::Raster;

/// Columns of a sign, with the gap to the next.
const ADVANCE: usize = 6;

/// Rows of a sign.
const ROWS: usize = 7;

/// Rows of a sign, each with the leftmost pixel in bit 4; a box for a sign that is not here.
fn rows(sign: char) -> [u8; ROWS] {
    match sign {
        ' ' => [0; ROWS],
        '0' => [0x0e, 0x11, 0x13, 0x15, 0x19, 0x11, 0x0e],
        '1' => [0x04, 0x0c, 0x04, 0x04, 0x04, 0x04, 0x0e],
        '2' => [0x0e, 0x11, 0x01, 0x02, 0x04, 0x08, 0x1f],
        '3' => [0x1f, 0x02, 0x04, 0x02, 0x01, 0x11, 0x0e],
        '4' => [0x02, 0x06, 0x0a, 0x12, 0x1f, 0x02, 0x02],
        '5' => [0x1f, 0x10, 0x1e, 0x01, 0x01, 0x11, 0x0e],
        '6' => [0x06, 0x08, 0x10, 0x1e, 0x11, 0x11, 0x0e],
        '7' => [0x1f, 0x01, 0x02, 0x04, 0x08, 0x08, 0x08],
        '8' => [0x0e, 0x11, 0x11, 0x0e, 0x11, 0x11, 0x0e],
        '9' => [0x0e, 0x11, 0x11, 0x0f, 0x01, 0x02, 0x0c],
        '.' => [0, 0, 0, 0, 0, 0x0c, 0x0c],
        '-' | '−' => [0, 0, 0, 0x1f, 0, 0, 0],
        '+' => [0, 0x04, 0x04, 0x1f, 0x04, 0x04, 0],
        '/' => [0, 0x01, 0x02, 0x04, 0x08, 0x10, 0],
        '°' => [0x0c, 0x12, 0x12, 0x0c, 0, 0, 0],
        '%' => [0x18, 0x19, 0x02, 0x04, 0x08, 0x13, 0x03],
        'µ' => [0, 0x11, 0x11, 0x11, 0x13, 0x1d, 0x10],
        'a' => [0, 0, 0x0e, 0x01, 0x0f, 0x11, 0x0f],
        'd' => [0x01, 0x01, 0x0d, 0x13, 0x11, 0x11, 0x0f],
        'e' => [0, 0, 0x0e, 0x11, 0x1f, 0x10, 0x0e],
        'g' => [0, 0x0f, 0x11, 0x11, 0x0f, 0x01, 0x0e],
        'm' => [0, 0, 0x1a, 0x15, 0x15, 0x11, 0x11],
        'n' => [0, 0, 0x16, 0x19, 0x11, 0x11, 0x11],
        'o' => [0, 0, 0x0e, 0x11, 0x11, 0x11, 0x0e],
        'p' => [0, 0, 0x1e, 0x11, 0x1e, 0x10, 0x10],
        'r' => [0, 0, 0x16, 0x19, 0x10, 0x10, 0x10],
        's' => [0, 0, 0x0f, 0x10, 0x0e, 0x01, 0x1e],
        'x' => [0, 0, 0x11, 0x0a, 0x04, 0x0a, 0x11],
        'D' => [0x1c, 0x12, 0x11, 0x11, 0x11, 0x12, 0x1c],
        'N' => [0x11, 0x11, 0x19, 0x15, 0x13, 0x11, 0x11],
        _ => [0x1f, 0x11, 0x11, 0x11, 0x11, 0x11, 0x1f],
    }
}

/// Width of a text in pixels of the picture.
pub fn text_width(text: &str, scale: usize) -> usize {
    (text.chars().count() * ADVANCE).saturating_sub(1) * scale
}

/// Height of a text in pixels of the picture.
pub fn text_height(scale: usize) -> usize {
    ROWS * scale
}

/// Writes a text, its top-left corner at (x, y), each pixel of the font `scale` pixels wide.
pub fn write_text(raster: &mut Raster, x: usize, y: usize, text: &str, scale: usize, colour: Rgb) {
    for (place, sign) in text.chars().enumerate() {
        for (row, bits) in rows(sign).into_iter().enumerate() {
            for column in (0..5).filter(|c| bits & (0x10 >> c) != 0) {
                let left = x + (place * ADVANCE + column) * scale;
                raster.fill(left, y + row * scale, scale, scale, colour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::colour::WHITE;

    #[test]
    fn every_sign_that_a_label_uses_is_drawn_and_differs_from_the_others() {
        let signs: Vec<char> = "0123456789.-+/°%µadegmnoprsxDN".chars().collect();
        for (i, a) in signs.iter().enumerate() {
            assert_ne!(rows(*a), rows('?'), "{a} is missing");
            assert!(signs[i + 1..].iter().all(|b| rows(*a) != rows(*b)), "{a} looks like another sign");
        }
    }

    #[test]
    fn a_text_stays_within_its_width() {
        let mut raster = Raster::new(40, 20, WHITE).unwrap();
        write_text(&mut raster, 2, 3, "8+8", 2, [0; 3]);
        let dark = |x: usize, y: usize| raster.pixels[y * 40 + x] == [0; 3];
        let columns: Vec<usize> = (0..40).filter(|x| (0..20).any(|y| dark(*x, y))).collect();
        assert_eq!((columns[0], *columns.last().unwrap()), (2, 2 + text_width("8+8", 2) - 1));
    }
}
