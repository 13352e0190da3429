//! Colour maps whose steps look equal to the eye, so that a picture shows the data and not the palette.
//!
//! 33 samples each, linear between them (within 3 of 255 of the full tables).
//! - sequential: *viridis*, S. van der Walt and N. Smith, 2015 (CC0);
//! - diverging: *vik*, and cyclic: *romaO*, F. Crameri, Scientific colour maps 8.0, doi:10.5281/zenodo.1243862
//!   (MIT licence, Copyright (c) 2023 Fabio Crameri); also readable with a colour vision deficiency.

/// An sRGB colour: red, green, blue.
pub type Rgb = [u8; 3];

/// Colour of the paper.
pub const WHITE: Rgb = [255, 255, 255];

/// Colour of lines and text.
pub const INK: Rgb = [31, 41, 51];

/// Where a raster has no valid value: lighter than any colour of the maps.
pub const INVALID: Rgb = [240, 241, 243];

/// One of the maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourMap {
    /// Dark to bright, for quantities that run one way.
    Sequential,
    /// Blue – light grey – red, for deviations around zero.
    Diverging,
    /// Ends where it begins, for angles.
    Cyclic,
}

impl ColourMap {
    /// The samples, from 0 to 1.
    pub fn table(self) -> &'static [Rgb; 33] {
        match self {
            Self::Sequential => &VIRIDIS,
            Self::Diverging => &VIK,
            Self::Cyclic => &ROMA_O,
        }
    }

    /// Colour at `t` of 0 … 1; beyond it the end colours, [`INVALID`] for NaN.
    pub fn colour(self, t: f64) -> Rgb {
        if t.is_nan() {
            return INVALID;
        }
        let table = self.table();
        let place = t.clamp(0.0, 1.0) * (table.len() - 1) as f64;
        let index = (place as usize).min(table.len() - 2);
        let share = place - index as f64;
        let mix = |a: u8, b: u8| (f64::from(a) * (1.0 - share) + f64::from(b) * share + 0.5) as u8;
        let (a, b) = (table[index], table[index + 1]);
        [mix(a[0], b[0]), mix(a[1], b[1]), mix(a[2], b[2])]
    }
}

/// Colours of pairs, distinguishable also with a colour vision deficiency.
///
/// Source: M. Okabe and K. Ito, Color Universal Design, 2008.
const PAIRS: [Rgb; 7] = [
    [0, 114, 178],
    [230, 159, 0],
    [0, 158, 115],
    [204, 121, 167],
    [86, 180, 233],
    [213, 94, 0],
    [240, 228, 66],
];

/// Colour of a pair by its number; they repeat after seven.
pub fn pair_colour(pair: usize) -> Rgb {
    PAIRS[pair % PAIRS.len()]
}

/// The colour as `#rrggbb`.
pub fn hex(colour: Rgb) -> String {
    format!("#{:02x}{:02x}{:02x}", colour[0], colour[1], colour[2])
}

const VIRIDIS: [[u8; 3]; 33] = [
    [68, 1, 84],
    [71, 13, 96],
    [72, 24, 106],
    [72, 35, 116],
    [71, 45, 123],
    [69, 55, 129],
    [66, 64, 134],
    [62, 73, 137],
    [59, 82, 139],
    [55, 91, 141],
    [51, 99, 141],
    [47, 107, 142],
    [44, 114, 142],
    [41, 122, 142],
    [38, 130, 142],
    [35, 137, 142],
    [33, 145, 140],
    [31, 152, 139],
    [31, 160, 136],
    [34, 167, 133],
    [40, 174, 128],
    [50, 182, 122],
    [63, 188, 115],
    [78, 195, 107],
    [94, 201, 98],
    [112, 207, 87],
    [132, 212, 75],
    [152, 216, 62],
    [173, 220, 48],
    [194, 223, 35],
    [216, 226, 25],
    [236, 229, 27],
    [253, 231, 37],
];

const VIK: [[u8; 3]; 33] = [
    [0, 18, 97],
    [2, 31, 105],
    [2, 43, 113],
    [2, 55, 121],
    [3, 68, 129],
    [5, 81, 137],
    [12, 94, 146],
    [28, 109, 156],
    [48, 125, 166],
    [72, 141, 178],
    [97, 158, 189],
    [122, 174, 200],
    [148, 190, 210],
    [173, 205, 221],
    [198, 219, 230],
    [222, 230, 233],
    [236, 229, 224],
    [238, 217, 205],
    [233, 202, 184],
    [226, 186, 162],
    [219, 170, 141],
    [213, 155, 121],
    [207, 140, 102],
    [201, 126, 83],
    [194, 112, 65],
    [188, 98, 47],
    [178, 81, 29],
    [163, 62, 13],
    [145, 45, 6],
    [129, 31, 6],
    [115, 20, 6],
    [101, 9, 7],
    [89, 0, 8],
];

const ROMA_O: [[u8; 3]; 33] = [
    [115, 57, 87],
    [121, 56, 76],
    [126, 57, 66],
    [132, 61, 58],
    [139, 68, 51],
    [146, 77, 47],
    [153, 88, 44],
    [162, 102, 44],
    [170, 117, 47],
    [180, 134, 54],
    [189, 152, 66],
    [198, 170, 82],
    [207, 188, 102],
    [212, 203, 123],
    [214, 215, 144],
    [211, 222, 163],
    [203, 225, 179],
    [191, 225, 191],
    [175, 220, 200],
    [157, 213, 205],
    [139, 203, 207],
    [120, 190, 206],
    [104, 177, 203],
    [92, 162, 198],
    [83, 147, 191],
    [79, 132, 183],
    [79, 117, 172],
    [83, 102, 159],
    [89, 88, 145],
    [96, 76, 129],
    [103, 67, 114],
    [109, 61, 100],
    [114, 57, 89],
];

/// What the colours of a cloud mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Colouring<'a> {
    /// One colour, shaded by the normal.
    Normal,
    /// A colour for each pair, shaded by the normal.
    Pair,
    /// A colour for each point, shaded by the normal.
    Given {
        /// In the order of the points; white where there are fewer.
        colours: &'a [Rgb],
    },
    /// Signed deviation, blue below, red above; not shaded, so that the colour bar holds.
    Deviation {
        /// Index of a point and its deviation, mm.
        values: &'a [(u32, f32)],
        /// Deviation of the end colours, mm.
        half_range_mm: f64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luma(c: Rgb) -> f64 {
        0.2126 * f64::from(c[0]) + 0.7152 * f64::from(c[1]) + 0.0722 * f64::from(c[2])
    }

    #[test]
    fn the_sequential_map_gets_brighter_at_every_step() {
        let lumas: Vec<f64> = ColourMap::Sequential.table().iter().map(|c| luma(*c)).collect();
        assert!(lumas.is_sorted_by(|a, b| a < b), "{lumas:?}");
    }

    #[test]
    fn the_diverging_map_is_brightest_near_zero_and_its_sides_differ() {
        let brightest = (0..=100).max_by(|a, b| {
            let l = |i: &i32| luma(ColourMap::Diverging.colour(f64::from(*i) / 100.0));
            l(a).total_cmp(&l(b))
        });
        assert!((45..=55).contains(&brightest.unwrap()), "{brightest:?}");
        let (low, high) = (ColourMap::Diverging.colour(0.2), ColourMap::Diverging.colour(0.8));
        assert!(low[2] > low[0] && high[0] > high[2], "blue {low:?} below zero, red {high:?} above");
    }

    #[test]
    fn the_cyclic_map_closes() {
        let (a, b) = (ColourMap::Cyclic.colour(0.0), ColourMap::Cyclic.colour(1.0));
        assert!(a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 3), "{a:?} {b:?}");
    }

    #[test]
    fn values_that_are_no_numbers_or_out_of_range_have_a_colour() {
        assert_eq!(ColourMap::Diverging.colour(f64::NAN), INVALID);
        assert_eq!(ColourMap::Diverging.colour(f64::INFINITY), ColourMap::Diverging.colour(1.0));
        assert_eq!(ColourMap::Diverging.colour(-3.0), ColourMap::Diverging.colour(0.0));
        assert_eq!(ColourMap::Sequential.colour(0.5), ColourMap::Sequential.table()[16]);
    }
}
