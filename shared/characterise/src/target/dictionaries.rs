//! The dictionaries of square markers that OpenCV predefined, read from text tables when the program is compiled.
//!
//! Each table states its provenance and licence.

/// Numbers in hexadecimal digits, separated by spaces; lines that begin with `#` are remarks.
const fn table<const N: usize>(text: &str) -> [u64; N] {
    let bytes = text.as_bytes();
    let mut codes = [0; N];
    let (mut at, mut count, mut inside) = (0, 0, false);
    while at < bytes.len() {
        let digit = match bytes[at] {
            b'#' => {
                while bytes[at] != b'\n' {
                    at += 1;
                }
                None
            }
            digit @ b'0'..=b'9' => Some(digit - b'0'),
            digit @ b'a'..=b'f' => Some(digit - b'a' + 10),
            _ => None,
        };
        match digit {
            Some(digit) => {
                codes[count] = codes[count] << 4 | digit as u64;
                inside = true;
            }
            None if inside => {
                count += 1;
                inside = false;
            }
            None => {}
        }
        at += 1;
    }
    assert!(count == N, "a table has another number of markers than declared");
    codes
}

/// Markers of 4 × 4 bits: the first 50, 100 and 250 are dictionaries of their own.
pub(super) static DICT_4X4: [u64; 1000] = table(include_str!("dictionaries/4x4.txt"));
/// Markers of 5 × 5 bits: the first 50, 100 and 250 are dictionaries of their own.
pub(super) static DICT_5X5: [u64; 1000] = table(include_str!("dictionaries/5x5.txt"));
/// Markers of 6 × 6 bits: the first 50, 100 and 250 are dictionaries of their own.
pub(super) static DICT_6X6: [u64; 1000] = table(include_str!("dictionaries/6x6.txt"));
/// Markers of 7 × 7 bits: the first 50, 100 and 250 are dictionaries of their own.
pub(super) static DICT_7X7: [u64; 1000] = table(include_str!("dictionaries/7x7.txt"));
/// Markers of 5 × 5 bits of the first ArUco; some look like others, or like themselves, after a turn.
pub(super) static ORIGINAL: [u64; 1024] = table(include_str!("dictionaries/original.txt"));
/// Markers of 6 × 6 bits, any two at least 12 bits apart.
pub(super) static MIP_36H12: [u64; 250] = table(include_str!("dictionaries/mip_36h12.txt"));
/// AprilTag's family 16h5 of 4 × 4 bits.
pub(super) static APRILTAG_16H5: [u64; 30] = table(include_str!("dictionaries/april_16h5.txt"));
/// AprilTag's family 25h9 of 5 × 5 bits.
pub(super) static APRILTAG_25H9: [u64; 35] = table(include_str!("dictionaries/april_25h9.txt"));
/// AprilTag's family 36h10 of 6 × 6 bits.
pub(super) static APRILTAG_36H10: [u64; 2320] = table(include_str!("dictionaries/april_36h10.txt"));
/// AprilTag's family 36h11 of 6 × 6 bits.
pub(super) static APRILTAG_36H11: [u64; 587] = table(include_str!("dictionaries/april_36h11.txt"));
