//! Square markers in the light squares of a board: which one a square carries, and how it is turned.

use super::dictionaries::{DICT_4X4_50, DICT_5X5_100, DICT_6X6_250};
use super::raster::Raster;
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

/// Wrong bits that are forgiven: fewer than half of the least distance of any two markers, which is 4.
const WRONG_BITS: u32 = 1;
/// Places within a cell that are read, from its middle, in cells: its rim is blurred.
const READ_AT: [f64; 3] = [-0.2, 0.0, 0.2];

/// A set of markers, named as in OpenCV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum MarkerDictionary {
    /// 50 markers of 4 × 4 bits.
    #[serde(rename = "DICT_4X4_50")]
    D4x4n50,
    /// 100 markers of 5 × 5 bits.
    #[serde(rename = "DICT_5X5_100")]
    D5x5n100,
    /// 250 markers of 6 × 6 bits.
    #[serde(rename = "DICT_6X6_250")]
    D6x6n250,
}

impl MarkerDictionary {
    /// Bits along a side.
    fn side(self) -> usize {
        match self {
            Self::D4x4n50 => 4,
            Self::D5x5n100 => 5,
            Self::D6x6n250 => 6,
        }
    }

    /// The markers, by number.
    pub(crate) fn codes(self) -> &'static [u64] {
        match self {
            Self::D4x4n50 => &DICT_4X4_50,
            Self::D5x5n100 => &DICT_5X5_100,
            Self::D6x6n250 => &DICT_6X6_250,
        }
    }
}

/// A marker that was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Marker {
    pub number: usize,
    /// Quarter turns: with t = 0, 1, 2, 3 the marker's x runs along u, v, −u, −v of the square.
    pub turn: usize,
}

/// Reads a square given by its corners in the image at (u, v) = (0, 0), (1, 0), (0, 1), (1, 1); `None` when it holds no marker of
/// the dictionary. `size` is the marker's side over the square's.
pub(crate) fn read(
    image: &Raster,
    corners: [Point2<f64>; 4],
    size: f64,
    dictionary: MarkerDictionary,
    min_contrast_dn: f64,
) -> Option<Marker> {
    let side = dictionary.side();
    // The marker has a dark rim of one cell.
    let cells = side + 2;
    let level = |x: f64, y: f64| {
        let along = |at: f64| 0.5 + size * ((at + 0.5) / cells as f64 - 0.5);
        let mut sum = 0.0;
        for dy in READ_AT {
            for dx in READ_AT {
                sum += f64::from(image.sample(inside(&corners, along(x + dx), along(y + dy)))?);
            }
        }
        Some(sum / (READ_AT.len() * READ_AT.len()) as f64)
    };
    let mut levels = Vec::with_capacity(cells * cells);
    for y in 0..cells {
        for x in 0..cells {
            levels.push(level(x as f64, y as f64)?);
        }
    }
    let is_rim = |index: &usize| {
        let (x, y) = (index % cells, index / cells);
        x == 0 || y == 0 || x + 1 == cells || y + 1 == cells
    };
    let light = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let rim: Vec<f64> = (0..levels.len()).filter(is_rim).map(|index| levels[index]).collect();
    let dark = rim.iter().sum::<f64>() / rim.len() as f64;
    let middle = 0.5 * (light + dark);
    if middle - dark < min_contrast_dn || rim.iter().any(|level| *level > middle) {
        return None;
    }
    let inner = (0..levels.len()).filter(|index| !is_rim(index));
    let bits = inner.fold(0_u64, |bits, index| bits << 1 | u64::from(levels[index] > middle));
    matching(bits, side, dictionary.codes())
}

/// A point of the square, bilinear: within one square perspective bends that by less than a cell's margin.
fn inside(corners: &[Point2<f64>; 4], u: f64, v: f64) -> Point2<f64> {
    let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
    Point2::from(
        corners
            .iter()
            .zip(weights)
            .map(|(corner, weight)| corner.coords * weight)
            .sum::<nalgebra::Vector2<f64>>(),
    )
}

/// The marker next to some bits, in any turn.
fn matching(bits: u64, side: usize, codes: &[u64]) -> Option<Marker> {
    let mut best: Option<(u32, Marker)> = None;
    let mut turned = bits;
    for turn in 0..4 {
        for (number, code) in codes.iter().enumerate() {
            let wrong = (turned ^ code).count_ones();
            if wrong <= WRONG_BITS && best.is_none_or(|(least, _)| wrong < least) {
                best = Some((wrong, Marker { number, turn }));
            }
        }
        turned = turned_on(turned, side);
    }
    best.map(|(_, marker)| marker)
}

/// Bits by (X, Y) where those given are by (x, y), with X = y and Y = side − 1 − x.
fn turned_on(bits: u64, side: usize) -> u64 {
    let last = side * side - 1;
    let bit = |x: usize, y: usize| bits >> (last - (y * side + x)) & 1;
    let all = (0..side * side).map(|index| (index % side, index / side));
    all.fold(0, |turned, (to_x, to_y)| turned << 1 | bit(side - 1 - to_y, to_x))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [MarkerDictionary; 3] =
        [MarkerDictionary::D4x4n50, MarkerDictionary::D5x5n100, MarkerDictionary::D6x6n250];

    #[test]
    fn four_turns_are_none_and_each_is_told() {
        for dictionary in ALL {
            let side = dictionary.side();
            for (number, code) in dictionary.codes().iter().enumerate() {
                let mut seen = *code;
                for turns in 0..4 {
                    let turn = (4 - turns) % 4;
                    assert_eq!(matching(seen, side, dictionary.codes()), Some(Marker { number, turn }));
                    seen = turned_on(seen, side);
                }
                assert_eq!(seen, *code);
            }
        }
    }

    #[test]
    fn one_wrong_bit_changes_nothing_and_two_give_no_other_marker_of_four_bits() {
        for (number, code) in DICT_4X4_50.iter().enumerate() {
            for bit in 0..16 {
                let one = matching(code ^ (1 << bit), 4, &DICT_4X4_50);
                assert_eq!(one, Some(Marker { number, turn: 0 }));
            }
        }
        let next = |bits: u64| bits.count_ones() >= 4;
        for dictionary in ALL {
            let codes = dictionary.codes();
            for (i, a) in codes.iter().enumerate() {
                assert!(codes[..i].iter().all(|b| next(a ^ b)), "{dictionary:?} {i}");
            }
        }
    }
}
