//! The compression of images for the DLPC900: enhanced run-length encoding, and the header in front of it.
//!
//! DLPU018J section 2.4.3 (table 2-115): `n p` repeats the pixel p n times, `0 n p…` gives n > 1 pixels as they are, `0 1 n` copies n
//! pixels from the row above, `0 1 0` ends the image. Numbers from 128 on have two bytes: the low seven bits with the highest bit
//! set, then the rest. The table also has `0 0` for the end of a row; the manufacturer's software does not write it, and a row
//! ends where it is full.

/// Bytes of the header.
pub const HEADER_BYTES: usize = 48;

/// Header and compressed pixels of an image; `rgb` has three bytes a pixel, rows from the top.
pub fn compressed(width_px: u32, height_px: u32, rgb: &[u8]) -> Vec<u8> {
    let width = width_px as usize;
    let pixels: Vec<[u8; 3]> = rgb.chunks_exact(3).map(|p| in_memory([p[0], p[1], p[2]])).collect();
    let mut out = vec![0; HEADER_BYTES];
    let mut above: Option<&[[u8; 3]]> = None;
    for row in pixels.chunks_exact(width) {
        encode_row(row, above, &mut out);
        above = Some(row);
    }
    out.extend([0, 1, 0]);
    let bytes = (out.len() - HEADER_BYTES) as u32;
    out[..HEADER_BYTES].copy_from_slice(&header(width_px, height_px, bytes));
    out
}

/// DLPU018J section 2.4.2. Signature, size, bytes of data, two fields that are not used, background; then pixels of 24 bits (1),
/// enhanced run-length encoding (2) and the order of bytes (1), as the manufacturer's program sends them (e2e.ti.com 599044).
fn header(width_px: u32, height_px: u32, bytes: u32) -> [u8; HEADER_BYTES] {
    let mut header = [0; HEADER_BYTES];
    header[..4].copy_from_slice(b"Spld");
    header[4..6].copy_from_slice(&(width_px as u16).to_le_bytes());
    header[6..8].copy_from_slice(&(height_px as u16).to_le_bytes());
    header[8..12].copy_from_slice(&bytes.to_le_bytes());
    header[12..20].fill(0xff);
    header[24..27].copy_from_slice(&[1, 2, 1]);
    header[29] = 1;
    header
}

/// Bytes of a pixel as they are sent: blue, red, green, so that the first eight bits of an image are its green ones. The
/// manufacturer's software exchanges green and red of a BMP file (blue, green, red) before it compresses.
fn in_memory([red, green, blue]: [u8; 3]) -> [u8; 3] {
    [blue, red, green]
}

fn encode_row(row: &[[u8; 3]], above: Option<&[[u8; 3]]>, out: &mut Vec<u8>) {
    let mut raw = 0;
    let mut at = 0;
    while at < row.len() {
        let same = row[at..].iter().take_while(|pixel| **pixel == row[at]).count();
        let copied = above.map_or(0, |above| {
            row[at..].iter().zip(&above[at..]).take_while(|(here, there)| here == there).count()
        });
        // A copy takes three bytes or four, a repetition four or five.
        let run = copied.max(same);
        if run < 2 {
            raw += 1;
            at += 1;
            continue;
        }
        flush(&row[at - raw..at], out);
        raw = 0;
        if copied >= same {
            out.extend([0, 1]);
            number(copied, out);
        } else {
            number(same, out);
            out.extend(row[at]);
        }
        at += run;
    }
    flush(&row[at - raw..at], out);
}

/// Pixels as they are. One alone is a repetition of one, since `0 1` means something else.
fn flush(pixels: &[[u8; 3]], out: &mut Vec<u8>) {
    match pixels {
        [] => return,
        [_] => out.push(1),
        _ => {
            out.push(0);
            number(pixels.len(), out);
        }
    }
    out.extend(pixels.as_flattened());
}

fn number(count: usize, out: &mut Vec<u8>) {
    if count < 128 {
        out.push(count as u8);
    } else {
        out.extend([(count & 0x7f) as u8 | 0x80, (count >> 7) as u8]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lightcrafter_emulator::erle::decompressed;
    use proptest::prelude::*;

    #[test]
    fn the_header_is_that_of_the_manufacturers_program() {
        // Recorded from the program by a user, e2e.ti.com 599044: 1920 × 1080, 4336 bytes of data.
        let recorded = "53706c64 8007 3804 f0100000 ffffffff ffffffff 00000000 010201000001 0000 00000000 00000000 00000000 00000000";
        let recorded: String = recorded.split_whitespace().collect();
        let byte = |place: usize| u8::from_str_radix(&recorded[2 * place..2 * place + 2], 16).unwrap();
        let recorded: Vec<u8> = (0..recorded.len() / 2).map(byte).collect();
        assert_eq!(header(1920, 1080, 4336).to_vec(), recorded);
    }

    #[test]
    fn numbers_of_two_bytes_have_the_low_bits_first() {
        for (count, bytes) in
            [(1, vec![1]), (127, vec![127]), (128, vec![0x80, 1]), (0x1234, vec![0xb4, 0x24])]
        {
            let mut out = Vec::new();
            number(count, &mut out);
            assert_eq!(out, bytes, "{count}");
        }
    }

    #[test]
    fn fringes_shrink_to_a_row_and_some_bytes() {
        let row: Vec<u8> = (0..1920_u32 * 3).map(|byte| (byte * 7) as u8).collect();
        let rgb = row.repeat(1080);
        let small = compressed(1920, 1080, &rgb);
        assert!(small.len() < 1920 * 3 + 1080 * 6 + 100, "{}", small.len());
        assert_eq!(decompressed(&small).unwrap(), (1920, 1080, rgb));
    }

    proptest! {
        #[test]
        fn every_image_comes_back(width in 1_u32..300, height in 1_u32..6, seed in any::<u64>(), levels in 1_u64..5) {
            let mut state = seed | 1;
            let mut byte = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                ((state >> 33) % levels) as u8 * 60
            };
            let rgb: Vec<u8> = (0..width * height * 3).map(|_| byte()).collect();
            let small = compressed(width, height, &rgb);
            prop_assert_eq!(decompressed(&small).unwrap(), (width, height, rgb));
        }
    }
}
