//! What holds the points of a target that are adjusted: its position, orientation and scale in its own frame.
//!
//! A similarity of all points is met by one of all poses and devices without changing any pixel. Seven inner
//! constraints take it out: Σ δ = 0, Σ p × δ = 0, Σ p·δ = 0 for displacements δ of points p about their mean (free
//! network adjustment). So the scale is that of the declared points on the average, and no single point decides it on its
//! own. As the freedom is exact and the displacements start from zero, the constraints stand in the matrix alone.
//!
//! Source: Strobl, Hirzinger, "More accurate pinhole camera calibration with imperfect planar target", 2011; they hold
//! three corners instead, whose own errors then turn and scale everything.

use fringe::math::linear::dot;
use nalgebra::Vector3;

/// Weight of the constraints over that of a point's coordinate: what they hold is a thousand times surer than a point.
const HELD: f64 = 1e6;

/// Damping of points that no view shows, over the weight of a point: they stay where they are.
const UNSEEN: f64 = 1e-9;

/// The constraints on 3 N displacements.
#[derive(Debug, Clone)]
pub(super) struct Datum {
    /// 7 rows of 3 N, of unit length.
    rows: Vec<Vec<f64>>,
}

impl Datum {
    /// How many parameters the constraints take out.
    pub const HELD: usize = 7;

    /// For points about any centre, not all in one place, and for the scale the same points, each about the middle of its face: only within
    /// faces are lengths declared.
    pub fn new(points: &[Vector3<f64>], within: &[Vector3<f64>]) -> Self {
        let centred = |points: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
            let middle = points.iter().fold(Vector3::zeros(), |sum, p| sum + p) / points.len().max(1) as f64;
            points.iter().map(|p| p - middle).collect()
        };
        let (around, within) = (centred(points), centred(within));
        let row = |of: &dyn Fn(usize) -> Vector3<f64>| -> Vec<f64> {
            let row: Vec<f64> = (0..around.len()).flat_map(|i| of(i).data.0[0]).collect();
            let length = dot(&row, &row).sqrt().max(1e-300);
            row.iter().map(|v| v / length).collect()
        };
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut rows: Vec<Vec<f64>> = axes.iter().map(|axis| row(&|_| *axis)).collect();
        rows.extend(axes.iter().map(|axis| row(&|i| axis.cross(&around[i]))));
        rows.push(row(&|i| within[i]));
        Self { rows }
    }

    /// Number of displacements' coordinates.
    pub fn size(&self) -> usize {
        self.rows.first().map_or(0, Vec::len)
    }

    /// The constraints on the points that are seen, their weight, and the damping that holds the others; `trace` is that of the
    /// points' normal matrix.
    pub fn held(&self, trace: f64, seen: &[bool]) -> (Vec<Vec<f64>>, f64, f64) {
        // Of data without any noise the weights differ by many powers of ten: the constraints go with them.
        let weight = trace / self.size().max(1) as f64;
        // A point that no view shows would give way to any similarity of the others.
        let row = |row: &Vec<f64>| {
            row.iter().enumerate().map(|(i, v)| if seen[i / 3] { *v } else { 0.0 }).collect()
        };
        (self.rows.iter().map(row).collect(), HELD * weight, UNSEEN * weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::math::linear::{Dense, Factor};

    /// Without the constraints the matrix of a free network is singular in seven directions; a similarity of all points
    /// is what they resist, anything else they leave alone.
    #[test]
    fn only_similarities_are_held() {
        let points: Vec<Vector3<f64>> =
            (0..12).map(|i| Vector3::new(f64::from(i % 4), f64::from(i / 4) * 1.5, 0.0)).collect();
        let datum = Datum::new(&points, &points);
        let size = datum.size();
        let (rows, held, _) = datum.held(size as f64, &vec![true; points.len()]);
        let mut matrix = Dense::identity(size);
        for row in &rows {
            for (i, a) in row.iter().enumerate() {
                row.iter().enumerate().for_each(|(j, b)| matrix.add(i, j, held * a * b));
            }
        }
        assert!(Factor::new(&matrix).is_ok());
        let energy = |of: &dyn Fn(usize, &Vector3<f64>) -> Vector3<f64>| {
            let flat: Vec<f64> = points.iter().enumerate().flat_map(|(i, p)| of(i, p).data.0[0]).collect();
            dot(&flat, &matrix.apply(&flat)) / dot(&flat, &flat)
        };
        let turn = Vector3::new(0.1, -0.2, 0.3);
        assert!(energy(&|_, p| turn.cross(p) + p * 0.4 + Vector3::new(1.0, 2.0, 3.0)) > 0.1 * HELD);
        // A bend and a stretch across each other: orthogonal to all seven.
        let middle = points.iter().fold(Vector3::zeros(), |s, p| s + p) / 12.0;
        let flat = |p: &Vector3<f64>| p - middle;
        let (sx, sy) = points.iter().map(flat).fold((0.0, 0.0), |(a, b), p| (a + p.x * p.x, b + p.y * p.y));
        let skewed: f64 = points.iter().map(flat).map(|p| p.x * p.y).sum();
        assert!(skewed.abs() < 1e-9);
        let stretch = energy(&|_, p| Vector3::new(flat(p).x / sx, -flat(p).y / sy, 0.0));
        assert!(stretch < 10.0, "{stretch}");
    }
}
