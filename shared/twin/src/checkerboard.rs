//! A printed checkerboard, with or without markers: its brightness at a point, and exactly over the footprint of a ray.

use characterise::target::MarkerDictionary;
use nalgebra::Point2;

/// A checkerboard on the plane z = 0 of a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checkerboard {
    /// Inner corners along x.
    pub columns: u32,
    /// Inner corners along y.
    pub rows: u32,
    /// Side of a square, mm.
    pub pitch_mm: f64,
    /// Albedo of the dark squares as a fraction of the light ones'.
    pub dark: f64,
    /// What the light squares carry.
    pub markers: Option<Markers>,
}

/// Markers in the light squares of a ChArUco board, which count row by row from the top left, seen from the front. The square there is
/// dark, so the board has an even number of rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Markers {
    /// The markers by number.
    pub dictionary: MarkerDictionary,
    /// Side of a marker with its dark rim over that of a square.
    pub size: f64,
    /// Number of the first one.
    pub first: usize,
}

impl Markers {
    /// Cells along a side, the rim of one cell included.
    fn cells(&self) -> usize {
        self.dictionary.side() + 2
    }

    /// Whether a cell of a marker is dark; column and row from the top left, rim included.
    fn is_dark(&self, number: usize, column: usize, row: usize) -> bool {
        let inner = |at: usize| at.checked_sub(1).filter(|at| *at < self.dictionary.side());
        let light = inner(column).zip(inner(row));
        light.is_none_or(|(column, row)| !self.dictionary.is_light(self.first + number, column, row))
    }
}

/// A convex polygon of at most eight corners: a quadrilateral cut along four lines.
type Polygon = ([Point2<f64>; 8], usize);

impl Checkerboard {
    /// Factor on the albedo. Inner corner (i, j) lies at ((i − (columns−1)/2)·pitch, (j − (rows−1)/2)·pitch); the
    /// square that ends at corner (0, 0) is dark; outside of the (columns+1)×(rows+1) squares it is light.
    pub fn factor(&self, x_mm: f64, y_mm: f64) -> f64 {
        let at = self.squares(&Point2::new(x_mm, y_mm));
        let (i, j) = (at.x.floor() as i64, at.y.floor() as i64);
        if self.is_dark(i, j) || self.is_marked(&at, i, j) { self.dark } else { 1.0 }
    }

    /// Mean of [`Self::factor`] over a convex quadrilateral, mm: the parts that lie in dark squares are cut out exactly, so
    /// that an edge moves through a footprint without steps. `None` for one without area.
    pub fn mean_factor(&self, footprint: &[Point2<f64>; 4]) -> Option<f64> {
        let corners = footprint.map(|p| self.squares(&p));
        let mut whole: Polygon = ([Point2::origin(); 8], 4);
        whole.0[..4].copy_from_slice(&corners);
        let area = area(&whole);
        let range = |axis: usize, inner_corners: u32| {
            let places = corners.iter().map(|p| p[axis]);
            let low = places.clone().fold(f64::INFINITY, f64::min).floor().max(0.0);
            let high = places.fold(f64::NEG_INFINITY, f64::max).floor().min(f64::from(inner_corners));
            low as i64..=high as i64
        };
        let mut dark = 0.0;
        for i in range(0, self.columns) {
            for j in range(1, self.rows).filter(|j| self.is_dark(i, *j)) {
                dark += area_within(whole, i as f64, j as f64, 1.0);
            }
            for j in range(1, self.rows) {
                dark += self.marked_area(&whole, i, j);
            }
        }
        (area > 1e-15).then(|| 1.0 - (1.0 - self.dark) * dark / area)
    }

    /// Whether the factor may change within a distance of a point, mm.
    pub fn changes_within(&self, x_mm: f64, y_mm: f64, reach_mm: f64) -> bool {
        let at = self.squares(&Point2::new(x_mm, y_mm));
        let reach = reach_mm / self.pitch_mm;
        let near = |place: f64, inner_corners: u32| {
            let on_board = place > -reach && place < f64::from(inner_corners + 1) + reach;
            (on_board, (place - place.round()).abs() <= reach)
        };
        let ((in_x, edge_x), (in_y, edge_y)) = (near(at.x, self.columns), near(at.y, self.rows));
        in_x && in_y && (edge_x || edge_y || self.markers.is_some())
    }

    /// Number of the marker in a light square of the board, counted from 0.
    fn marker(&self, i: i64, j: i64) -> Option<(Markers, usize)> {
        let markers = self.markers?;
        let (x, y) = (usize::try_from(i).ok()?, usize::try_from(i64::from(self.rows) - j).ok()?);
        let width = self.columns as usize + 1;
        let on_board = x < width && y <= self.rows as usize;
        // Rows with an even number begin with a dark square.
        let above = (y - y / 2) * (width / 2) + y / 2 * width.div_ceil(2);
        let before = if y.is_multiple_of(2) { x / 2 } else { x.div_ceil(2) };
        (on_board && !self.is_dark(i, j)).then_some((markers, above + before))
    }

    /// Whether a place in a square, counted in squares, lies on a dark cell of its marker.
    fn is_marked(&self, at: &Point2<f64>, i: i64, j: i64) -> bool {
        let Some((markers, number)) = self.marker(i, j) else { return false };
        let cell = |along: f64| ((along - 0.5) / markers.size + 0.5) * markers.cells() as f64;
        let (column, row) = (cell(at.x - i as f64), cell(1.0 - (at.y - j as f64)));
        let within = 0.0..markers.cells() as f64;
        within.contains(&column)
            && within.contains(&row)
            && markers.is_dark(number, column as usize, row as usize)
    }

    /// Area of a polygon within the dark cells of the marker of a square.
    fn marked_area(&self, polygon: &Polygon, i: i64, j: i64) -> f64 {
        let Some((markers, number)) = self.marker(i, j) else { return 0.0 };
        let cells = markers.cells();
        let side = markers.size / cells as f64;
        let from = |cell: usize| 0.5 * (1.0 - markers.size) + cell as f64 * side;
        let reaches = |low: f64, axis: usize| {
            let places = || polygon.0[..polygon.1].iter().map(|p| p[axis]);
            places().any(|p| p > low) && places().any(|p| p < low + side)
        };
        let mut sum = 0.0;
        for column in (0..cells).filter(|column| reaches(i as f64 + from(*column), 0)) {
            for row in (0..cells).filter(|row| markers.is_dark(number, column, *row)) {
                let y = (j + 1) as f64 - from(row) - side;
                if reaches(y, 1) {
                    sum += area_within(*polygon, i as f64 + from(column), y, side);
                }
            }
        }
        sum
    }

    /// A place counted in squares from the outer corner of the first one.
    fn squares(&self, p: &Point2<f64>) -> Point2<f64> {
        let place = |at_mm: f64, corners: u32| at_mm / self.pitch_mm + 0.5 * f64::from(corners + 1);
        Point2::new(place(p.x, self.columns), place(p.y, self.rows))
    }

    fn is_dark(&self, i: i64, j: i64) -> bool {
        (0..=i64::from(self.columns)).contains(&i)
            && (0..=i64::from(self.rows)).contains(&j)
            && (i + j) % 2 == 0
    }
}

/// Area of a polygon within a square at a corner (Sutherland and Hodgman, Reentrant polygon clipping, 1974).
fn area_within(polygon: Polygon, x: f64, y: f64, side: f64) -> f64 {
    let right_of = cut(cut(polygon, |p| p.x - x), |p| x + side - p.x);
    area(&cut(cut(right_of, |p| p.y - y), |p| y + side - p.y))
}

/// The part of a convex polygon where a linear function is not negative.
fn cut((corners, count): Polygon, inside: impl Fn(&Point2<f64>) -> f64) -> Polygon {
    let mut left: Polygon = ([Point2::origin(); 8], 0);
    let mut keep = |p: Point2<f64>| {
        // Rounding could give a ninth corner where two coincide.
        if left.1 < 8 {
            left.0[left.1] = p;
            left.1 += 1;
        }
    };
    for (number, here) in corners[..count].iter().enumerate() {
        let next = &corners[(number + 1) % count];
        let (a, b) = (inside(here), inside(next));
        if a >= 0.0 {
            keep(*here);
        }
        if (a < 0.0) != (b < 0.0) {
            keep(here + (next - here) * (a / (a - b)));
        }
    }
    left
}

fn area((corners, count): &Polygon) -> f64 {
    let ends = corners[..*count].iter().zip(corners[..*count].iter().cycle().skip(1));
    0.5 * ends.map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>().abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::random::Key;

    const BOARD: Checkerboard = Checkerboard { columns: 4, rows: 3, pitch_mm: 8.0, dark: 0.1, markers: None };

    fn around(x: f64, y: f64, along: [f64; 2], across: [f64; 2]) -> [Point2<f64>; 4] {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(s, t)| Point2::new(x + s * along[0] + t * across[0], y + s * along[1] + t * across[1]))
    }

    const MARKED: Checkerboard = Checkerboard {
        columns: 5,
        rows: 4,
        markers: Some(Markers { dictionary: MarkerDictionary::D4x4n50, size: 0.7, first: 12 }),
        ..BOARD
    };

    #[test]
    fn a_footprint_on_an_edge_has_the_mean_of_both_sides() {
        // Corner (1, 1) of 4 × 3 lies at (−4, 0).
        let mean = |x: f64, y: f64| BOARD.mean_factor(&around(x, y, [0.1, 0.0], [0.0, 0.1])).unwrap();
        assert!((mean(0.0, 4.0) - BOARD.factor(0.0, 4.0)).abs() < 1e-12);
        assert!((mean(-4.0, 4.0) - 0.55).abs() < 1e-12 && (mean(-4.0, 0.0) - 0.55).abs() < 1e-12);
        // A quarter of the footprint lies beyond the edge.
        let dark_left = BOARD.factor(-5.0, 4.0) < 1.0;
        let share = if dark_left { 0.25 } else { 0.75 };
        assert!((mean(-3.95, 4.0) - (1.0 - 0.9 * share)).abs() < 1e-12);
        assert!((mean(500.0, 0.0) - 1.0).abs() < 1e-12);
        assert!(BOARD.mean_factor(&around(0.0, 0.0, [0.1, 0.0], [0.1, 0.0])).is_none());
    }

    /// Turned and slanted footprints all over the board and its rim, beside 400 × 400 points within each.
    #[test]
    fn the_mean_is_that_of_many_points() {
        the_mean_of_many(&BOARD);
        the_mean_of_many(&MARKED);
        assert!(!BOARD.changes_within(0.0, 4.0, 3.9) && !BOARD.changes_within(30.0, 0.0, 2.0));
        // The light squares of 6 × 5 from the top left, row by row: 1, 3, 5 of the first row, 0, 2, 4 of the second.
        let number = |i: i64, j: i64| MARKED.marker(i, j).map(|(_, number)| number);
        assert_eq!(
            [number(1, 4), number(5, 4), number(0, 3), number(4, 3)],
            [Some(0), Some(2), Some(3), Some(5)]
        );
        assert_eq!([number(0, 4), number(6, 3), number(1, -1)], [None; 3]);
    }

    fn the_mean_of_many(board: &Checkerboard) {
        let key = Key::new(5);
        let mut mixed = 0;
        for number in 0..60 {
            let any = |i: u64| key.with(number).symmetric(i);
            let (x, y) = (24.0 * any(0), 20.0 * any(1));
            let (along, across) = ([3.0 * any(2), 2.0 + any(3)], [2.0 + any(4), any(5)]);
            let mut sum = 0.0;
            for (i, j) in (0..400).flat_map(|i| (0..400).map(move |j| (i, j))) {
                let (s, t) = ((f64::from(i) - 199.5) / 200.0, (f64::from(j) - 199.5) / 200.0);
                sum += board.factor(x + s * along[0] + t * across[0], y + s * along[1] + t * across[1]);
            }
            let Some(mean) = board.mean_factor(&around(x, y, along, across)) else { continue };
            assert!((mean - sum / 160_000.0).abs() < 3e-3, "{mean} beside {}", sum / 160_000.0);
            let length = |v: [f64; 2]| (v[0] * v[0] + v[1] * v[1]).sqrt();
            let reach = length(along) + length(across);
            if (board.factor(x, y) - mean).abs() > 1e-9 {
                mixed += 1;
                assert!(board.changes_within(x, y, reach), "{x} {y}");
            }
        }
        assert!(mixed > 20);
    }
}
