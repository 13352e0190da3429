//! Square markers in the light squares of a board: which one a square carries, and how it is turned.

use super::dictionaries::{
    APRILTAG_16H5, APRILTAG_25H9, APRILTAG_36H10, APRILTAG_36H11, DICT_4X4, DICT_5X5, DICT_6X6, DICT_7X7,
    MIP_36H12, ORIGINAL,
};
use super::raster::{Grey, Image};
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

/// Places within a cell that are read, from its middle, in cells: its rim is blurred.
const READ_AT: [f64; 3] = [-0.2, 0.0, 0.2];

/// A set of markers, named as in OpenCV.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum MarkerDictionary {
    /// 50 markers of 4 × 4 bits.
    #[serde(rename = "DICT_4X4_50")]
    D4x4n50,
    /// 100 markers of 4 × 4 bits.
    #[serde(rename = "DICT_4X4_100")]
    D4x4n100,
    /// 250 markers of 4 × 4 bits.
    #[serde(rename = "DICT_4X4_250")]
    D4x4n250,
    /// 1000 markers of 4 × 4 bits.
    #[serde(rename = "DICT_4X4_1000")]
    D4x4n1000,
    /// 50 markers of 5 × 5 bits.
    #[serde(rename = "DICT_5X5_50")]
    D5x5n50,
    /// 100 markers of 5 × 5 bits.
    #[serde(rename = "DICT_5X5_100")]
    D5x5n100,
    /// 250 markers of 5 × 5 bits.
    #[serde(rename = "DICT_5X5_250")]
    D5x5n250,
    /// 1000 markers of 5 × 5 bits.
    #[serde(rename = "DICT_5X5_1000")]
    D5x5n1000,
    /// 50 markers of 6 × 6 bits.
    #[serde(rename = "DICT_6X6_50")]
    D6x6n50,
    /// 100 markers of 6 × 6 bits.
    #[serde(rename = "DICT_6X6_100")]
    D6x6n100,
    /// 250 markers of 6 × 6 bits.
    #[serde(rename = "DICT_6X6_250")]
    D6x6n250,
    /// 1000 markers of 6 × 6 bits.
    #[serde(rename = "DICT_6X6_1000")]
    D6x6n1000,
    /// 50 markers of 7 × 7 bits.
    #[serde(rename = "DICT_7X7_50")]
    D7x7n50,
    /// 100 markers of 7 × 7 bits.
    #[serde(rename = "DICT_7X7_100")]
    D7x7n100,
    /// 250 markers of 7 × 7 bits.
    #[serde(rename = "DICT_7X7_250")]
    D7x7n250,
    /// 1000 markers of 7 × 7 bits.
    #[serde(rename = "DICT_7X7_1000")]
    D7x7n1000,
    /// 1024 markers of 5 × 5 bits: the first ArUco.
    #[serde(rename = "DICT_ARUCO_ORIGINAL")]
    Original,
    /// 250 markers of 6 × 6 bits, at least 12 bits apart.
    #[serde(rename = "DICT_ARUCO_MIP_36h12")]
    Mip36h12,
    /// 30 AprilTags of 4 × 4 bits.
    #[serde(rename = "DICT_APRILTAG_16h5")]
    April16h5,
    /// 35 AprilTags of 5 × 5 bits.
    #[serde(rename = "DICT_APRILTAG_25h9")]
    April25h9,
    /// 2320 AprilTags of 6 × 6 bits.
    #[serde(rename = "DICT_APRILTAG_36h10")]
    April36h10,
    /// 587 AprilTags of 6 × 6 bits, as on an AprilGrid.
    #[serde(rename = "DICT_APRILTAG_36h11")]
    April36h11,
}

impl MarkerDictionary {
    /// All of them, with the smallest ones of each size first.
    #[cfg(test)]
    pub(crate) const ALL: [Self; 22] = [
        Self::D4x4n50,
        Self::D4x4n100,
        Self::D4x4n250,
        Self::D4x4n1000,
        Self::D5x5n50,
        Self::D5x5n100,
        Self::D5x5n250,
        Self::D5x5n1000,
        Self::D6x6n50,
        Self::D6x6n100,
        Self::D6x6n250,
        Self::D6x6n1000,
        Self::D7x7n50,
        Self::D7x7n100,
        Self::D7x7n250,
        Self::D7x7n1000,
        Self::Original,
        Self::Mip36h12,
        Self::April16h5,
        Self::April25h9,
        Self::April36h10,
        Self::April36h11,
    ];

    /// Bits along a side, and the markers by number.
    fn table(self) -> (usize, &'static [u64]) {
        match self {
            Self::D4x4n50 => (4, &DICT_4X4[..50]),
            Self::D4x4n100 => (4, &DICT_4X4[..100]),
            Self::D4x4n250 => (4, &DICT_4X4[..250]),
            Self::D4x4n1000 => (4, &DICT_4X4),
            Self::D5x5n50 => (5, &DICT_5X5[..50]),
            Self::D5x5n100 => (5, &DICT_5X5[..100]),
            Self::D5x5n250 => (5, &DICT_5X5[..250]),
            Self::D5x5n1000 => (5, &DICT_5X5),
            Self::D6x6n50 => (6, &DICT_6X6[..50]),
            Self::D6x6n100 => (6, &DICT_6X6[..100]),
            Self::D6x6n250 => (6, &DICT_6X6[..250]),
            Self::D6x6n1000 => (6, &DICT_6X6),
            Self::D7x7n50 => (7, &DICT_7X7[..50]),
            Self::D7x7n100 => (7, &DICT_7X7[..100]),
            Self::D7x7n250 => (7, &DICT_7X7[..250]),
            Self::D7x7n1000 => (7, &DICT_7X7),
            Self::Original => (5, &ORIGINAL),
            Self::Mip36h12 => (6, &MIP_36H12),
            Self::April16h5 => (4, &APRILTAG_16H5),
            Self::April25h9 => (5, &APRILTAG_25H9),
            Self::April36h10 => (6, &APRILTAG_36H10),
            Self::April36h11 => (6, &APRILTAG_36H11),
        }
    }

    /// Bits along a side.
    pub fn side(self) -> usize {
        self.table().0
    }

    /// How many markers it has.
    pub fn count(self) -> usize {
        self.codes().len()
    }

    /// Whether a bit of a marker is light, column and row from its top left; beyond the marker and the dictionary it is not.
    pub fn is_light(self, number: usize, column: usize, row: usize) -> bool {
        let side = self.side();
        let code = self.codes().get(number).filter(|_| column < side && row < side);
        code.is_some_and(|code| code >> (side * side - 1 - (row * side + column)) & 1 == 1)
    }

    /// The markers, by number.
    pub(crate) fn codes(self) -> &'static [u64] {
        self.table().1
    }

    /// Wrong bits that are forgiven: fewer than half of the least distance of any two markers.
    fn wrong_bits(self) -> u32 {
        match self {
            // 1000 markers of 16 bits are 2 bits apart, some of the first ArUco not at all.
            Self::D4x4n1000 | Self::Original => 0,
            _ => 1,
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

/// Width of a marker's dark rim, in cells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Rim(pub usize);

/// Reads a square given by its corners in the image at (u, v) = (0, 0), (1, 0), (0, 1), (1, 1); `None` when it holds no marker of
/// the dictionary. `size` is the marker's side over the square's.
pub(crate) fn read(
    image: &Image,
    corners: [Point2<f64>; 4],
    size: f64,
    (dictionary, Rim(rim)): (MarkerDictionary, Rim),
    min_contrast_dn: f64,
) -> Option<Marker> {
    let cells = dictionary.side() + 2 * rim;
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
        x.min(y) < rim || x.max(y) + rim >= cells
    };
    let light = levels.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let edge: Vec<f64> = (0..levels.len()).filter(is_rim).map(|index| levels[index]).collect();
    let dark = edge.iter().sum::<f64>() / edge.len() as f64;
    let middle = 0.5 * (light + dark);
    if middle - dark < min_contrast_dn || edge.iter().any(|level| *level > middle) {
        return None;
    }
    let inner = (0..levels.len()).filter(|index| !is_rim(index));
    let bits = inner.fold(0_u64, |bits, index| bits << 1 | u64::from(levels[index] > middle));
    matching(bits, dictionary)
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

/// The marker next to some bits, in any turn; `None` where two are equally near, as of markers that look alike after a turn.
fn matching(bits: u64, dictionary: MarkerDictionary) -> Option<Marker> {
    let (side, codes) = dictionary.table();
    let mut least = dictionary.wrong_bits() + 1;
    let mut best = None;
    let mut turned = bits;
    for turn in 0..4 {
        for (number, code) in codes.iter().enumerate() {
            let wrong = (turned ^ code).count_ones();
            if wrong < least {
                (least, best) = (wrong, Some(Marker { number, turn }));
            } else if wrong == least {
                best = None;
            }
        }
        turned = turned_on(turned, side);
    }
    best
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

    #[test]
    fn four_turns_are_none_and_each_is_told() {
        for dictionary in MarkerDictionary::ALL {
            let side = dictionary.side();
            let mut told = 0;
            for (number, code) in dictionary.codes().iter().enumerate() {
                let mut seen = *code;
                for turns in 0..4 {
                    let turn = (4 - turns) % 4;
                    let found = matching(seen, dictionary);
                    told += usize::from(found == Some(Marker { number, turn }));
                    assert!(
                        found.is_none_or(|marker| marker == Marker { number, turn }),
                        "{dictionary:?} {number}"
                    );
                    seen = turned_on(seen, side);
                }
                assert_eq!(seen, *code);
            }
            let all = 4 * dictionary.codes().len();
            // Some markers of the first ArUco look like themselves or another one after a turn.
            assert!(
                told == all || dictionary == MarkerDictionary::Original && told > all * 9 / 10,
                "{dictionary:?} {told}"
            );
        }
    }

    #[test]
    fn one_wrong_bit_is_forgiven_where_no_other_marker_is_as_near() {
        for dictionary in [MarkerDictionary::D4x4n250, MarkerDictionary::April16h5, MarkerDictionary::D7x7n50]
        {
            for (number, code) in dictionary.codes().iter().enumerate() {
                for bit in 0..dictionary.side().pow(2) {
                    let one = matching(code ^ (1 << bit), dictionary);
                    assert_eq!(one, Some(Marker { number, turn: 0 }));
                }
            }
        }
        assert_eq!(matching(DICT_4X4[3] ^ 1, MarkerDictionary::D4x4n1000), None);
    }
}
