//! General tolerances of drawings: ISO 2768-1 for lengths and angles, ISO 2768-2 for flatness.

/// Tolerance class of lengths and angles (ISO 2768-1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LengthClass {
    /// Class f, the finest one.
    Fine,
    /// Class m, the usual one.
    Medium,
    /// Class c, for castings and the like.
    Coarse,
    /// Class v, the widest one.
    VeryCoarse,
}

/// Tolerance class of form (ISO 2768-2).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FormClass {
    /// Class H, the finest one.
    H,
    /// Class K, the usual one.
    K,
    /// Class L, the widest one.
    L,
}

/// Upper ends of the ranges of linear sizes, mm, with the deviations of the classes f, m, c, v (ISO 2768-1, table 1).
const LENGTHS: [(f64, [Option<f64>; 4]); 8] = [
    (3.0, [Some(0.05), Some(0.1), Some(0.2), None]),
    (6.0, [Some(0.05), Some(0.1), Some(0.3), Some(0.5)]),
    (30.0, [Some(0.1), Some(0.2), Some(0.5), Some(1.0)]),
    (120.0, [Some(0.15), Some(0.3), Some(0.8), Some(1.5)]),
    (400.0, [Some(0.2), Some(0.5), Some(1.2), Some(2.5)]),
    (1000.0, [Some(0.3), Some(0.8), Some(2.0), Some(4.0)]),
    (2000.0, [Some(0.5), Some(1.2), Some(3.0), Some(6.0)]),
    (4000.0, [None, Some(2.0), Some(4.0), Some(8.0)]),
];

/// Upper ends of the ranges of external radii, mm, with the deviations of the classes f, m, c, v (ISO 2768-1, table 2).
const RADII: [(f64, [f64; 4]); 3] =
    [(3.0, [0.2, 0.2, 0.4, 0.4]), (6.0, [0.5, 0.5, 1.0, 1.0]), (f64::INFINITY, [1.0, 1.0, 2.0, 2.0])];

/// Upper ends of the ranges of the shorter side, mm, with the deviations of the classes f, m, c, v in minutes of arc (table 3).
const ANGLES: [(f64, [f64; 4]); 5] = [
    (10.0, [60.0, 60.0, 90.0, 180.0]),
    (50.0, [30.0, 30.0, 60.0, 120.0]),
    (120.0, [20.0, 20.0, 30.0, 60.0]),
    (400.0, [10.0, 10.0, 15.0, 30.0]),
    (f64::INFINITY, [5.0, 5.0, 10.0, 20.0]),
];

/// Upper ends of the ranges of lengths, mm, with the flatness of the classes H, K, L (ISO 2768-2, table 1).
const FLATNESS: [(f64, [f64; 3]); 6] = [
    (10.0, [0.02, 0.05, 0.1]),
    (30.0, [0.05, 0.1, 0.2]),
    (100.0, [0.1, 0.2, 0.4]),
    (300.0, [0.2, 0.4, 0.8]),
    (1000.0, [0.3, 0.6, 1.2]),
    (3000.0, [0.4, 0.8, 1.6]),
];

/// Smallest size with a general tolerance, mm; smaller ones are stated on the drawing.
const LEAST_MM: f64 = 0.5;

impl LengthClass {
    /// Deviation of a linear size, ± mm; `None` where the standard leaves it to the drawing.
    pub fn length_mm(self, nominal_mm: f64) -> Option<f64> {
        let row = LENGTHS.iter().find(|(upper, _)| nominal_mm <= *upper)?;
        if nominal_mm >= LEAST_MM { row.1[self as usize] } else { None }
    }

    /// Deviation of an external radius, ± mm; `None` below the smallest one.
    pub fn radius_mm(self, nominal_mm: f64) -> Option<f64> {
        let row = RADII.iter().find(|(upper, _)| nominal_mm <= *upper)?;
        (nominal_mm >= LEAST_MM).then_some(row.1[self as usize])
    }

    /// Deviation of an angle, ± degrees, by the length of its shorter side.
    pub fn angle_deg(self, shorter_side_mm: f64) -> f64 {
        let row = ANGLES.iter().find(|(upper, _)| shorter_side_mm <= *upper).unwrap_or(&ANGLES[4]);
        row.1[self as usize] / 60.0
    }
}

impl FormClass {
    /// Flatness of a face by its longer side, mm; `None` beyond the table.
    pub fn flatness_mm(self, length_mm: f64) -> Option<f64> {
        let row = FLATNESS.iter().find(|(upper, _)| length_mm <= *upper)?;
        Some(row.1[self as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_tables_with_each_limit_in_the_lower_range() {
        for (class, nominal, expected) in [
            (LengthClass::Medium, 0.49, None),
            (LengthClass::Medium, 0.5, Some(0.1)),
            (LengthClass::Medium, 6.0, Some(0.1)),
            (LengthClass::Medium, 6.1, Some(0.2)),
            (LengthClass::Fine, 30.0, Some(0.1)),
            (LengthClass::Coarse, 31.0, Some(0.8)),
            (LengthClass::VeryCoarse, 2.0, None),
            (LengthClass::VeryCoarse, 400.5, Some(4.0)),
            (LengthClass::Fine, 3000.0, None),
            (LengthClass::Medium, 4000.1, None),
            (LengthClass::Medium, f64::NAN, None),
        ] {
            assert_eq!(class.length_mm(nominal), expected, "{class:?} {nominal}");
        }
        assert_eq!(LengthClass::Medium.radius_mm(3.0), Some(0.2));
        assert_eq!(LengthClass::Coarse.radius_mm(1e4), Some(2.0));
        assert_eq!(LengthClass::Medium.angle_deg(10.0), 1.0);
        assert_eq!(LengthClass::Fine.angle_deg(50.1), 20.0 / 60.0);
        assert_eq!(LengthClass::VeryCoarse.angle_deg(1e9), 20.0 / 60.0);
        assert_eq!(FormClass::K.flatness_mm(100.0), Some(0.2));
        assert_eq!(FormClass::H.flatness_mm(5.0), Some(0.02));
        assert_eq!(FormClass::L.flatness_mm(3000.1), None);
    }

    /// Each class is at least as wide as the one before, and each range as the smaller one.
    #[test]
    fn tables_never_fall() {
        let classes = [LengthClass::Fine, LengthClass::Medium, LengthClass::Coarse, LengthClass::VeryCoarse];
        for (row, next) in LENGTHS.iter().zip(&LENGTHS[1..]) {
            for class in classes {
                if let (Some(a), Some(b)) = (row.1[class as usize], next.1[class as usize]) {
                    assert!(b >= a);
                }
            }
        }
        for pair in classes.windows(2) {
            for size in [1.0, 5.0, 20.0, 100.0, 300.0, 900.0, 1500.0] {
                if let (Some(a), Some(b)) = (pair[0].length_mm(size), pair[1].length_mm(size)) {
                    assert!(b > a, "{pair:?} {size}");
                }
                assert!(pair[1].angle_deg(size) >= pair[0].angle_deg(size));
            }
        }
    }
}
