//! A printed checkerboard: its brightness at a point, and exactly over the footprint of a ray.

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
}

/// A convex polygon of at most eight corners: a quadrilateral cut along four lines.
type Polygon = ([Point2<f64>; 8], usize);

impl Checkerboard {
    /// Factor on the albedo. Inner corner (i, j) lies at ((i − (columns−1)/2)·pitch, (j − (rows−1)/2)·pitch); the
    /// square that ends at corner (0, 0) is dark; outside of the (columns+1)×(rows+1) squares it is light.
    pub fn factor(&self, x_mm: f64, y_mm: f64) -> f64 {
        let at = self.squares(&Point2::new(x_mm, y_mm));
        if self.is_dark(at.x.floor() as i64, at.y.floor() as i64) { self.dark } else { 1.0 }
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
                dark += area_within(whole, i as f64, j as f64);
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
        in_x && in_y && (edge_x || edge_y)
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

/// Area of a polygon within the unit square at a corner (Sutherland and Hodgman, Reentrant polygon clipping, 1974).
fn area_within(polygon: Polygon, x: f64, y: f64) -> f64 {
    let right_of = cut(cut(polygon, |p| p.x - x), |p| x + 1.0 - p.x);
    area(&cut(cut(right_of, |p| p.y - y), |p| y + 1.0 - p.y))
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

    const BOARD: Checkerboard = Checkerboard { columns: 4, rows: 3, pitch_mm: 8.0, dark: 0.1 };

    fn around(x: f64, y: f64, along: [f64; 2], across: [f64; 2]) -> [Point2<f64>; 4] {
        [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
            .map(|(s, t)| Point2::new(x + s * along[0] + t * across[0], y + s * along[1] + t * across[1]))
    }

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
        let key = Key::new(5);
        let mut mixed = 0;
        for number in 0..60 {
            let any = |i: u64| key.with(number).symmetric(i);
            let (x, y) = (24.0 * any(0), 20.0 * any(1));
            let (along, across) = ([3.0 * any(2), 2.0 + any(3)], [2.0 + any(4), any(5)]);
            let mut sum = 0.0;
            for (i, j) in (0..400).flat_map(|i| (0..400).map(move |j| (i, j))) {
                let (s, t) = ((f64::from(i) - 199.5) / 200.0, (f64::from(j) - 199.5) / 200.0);
                sum += BOARD.factor(x + s * along[0] + t * across[0], y + s * along[1] + t * across[1]);
            }
            let Some(mean) = BOARD.mean_factor(&around(x, y, along, across)) else { continue };
            assert!((mean - sum / 160_000.0).abs() < 3e-3, "{mean} beside {}", sum / 160_000.0);
            let length = |v: [f64; 2]| (v[0] * v[0] + v[1] * v[1]).sqrt();
            let reach = length(along) + length(across);
            if (BOARD.factor(x, y) - mean).abs() > 1e-9 {
                mixed += 1;
                assert!(BOARD.changes_within(x, y, reach), "{x} {y}");
            }
        }
        assert!(mixed > 20);
        assert!(!BOARD.changes_within(0.0, 4.0, 3.9) && !BOARD.changes_within(30.0, 0.0, 2.0));
    }
}
