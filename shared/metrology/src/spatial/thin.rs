//! One point for each cell of a grid.

use super::CHUNK;
use super::bvh::Aabb;
use crate::counted_order::counted_order;
use fringe::cloud::Point;
use nalgebra::Point3;
use rayon::prelude::*;

/// Cells along one axis that fit into a third of the key.
const CELLS_PER_AXIS: f64 = 2_097_151.0;

/// The point of the smallest uncertainty in each cube of a grid with this edge, mm, in the order of the cloud; of equal ones the first.
/// Points stay as they were measured.
pub fn thinned_cloud(points: &[Point], edge_mm: f64) -> Vec<Point> {
    let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
    let best = |cell: &[(u64, u32)]| {
        let sigma = |index: u32| points[index as usize].sigma_mm;
        cell.iter().map(|(_, index)| *index).min_by(|a, b| sigma(*a).total_cmp(&sigma(*b)).then(a.cmp(b)))
    };
    let Some(grid) = Grid::new(&positions, edge_mm) else { return Vec::new() };
    let mut kept: Vec<u32> = grid.by_cell(&positions).chunk_by(|a, b| a.0 == b.0).filter_map(best).collect();
    kept.sort_unstable();
    kept.into_iter().map(|index| points[index as usize]).collect()
}

/// The extent of points along the axis where it is largest, and the smallest edge that a grid about them can have, mm.
pub fn extent_and_least_edge_mm(points: &[Point]) -> (f64, f64) {
    let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
    let bounds = Aabb::of(&positions);
    let extent_mm = (bounds.high - bounds.low).max();
    (extent_mm, least_edge_mm(extent_mm))
}

/// The smallest edge of which the cubes over an extent can be numbered, mm.
fn least_edge_mm(extent_mm: f64) -> f64 {
    extent_mm / CELLS_PER_AXIS
}

/// Indices, ascending, of the first point in each cube of a grid with this edge, mm.
pub(crate) fn thinned(points: &[Point3<f64>], edge_mm: f64) -> Vec<u32> {
    let Some(grid) = Grid::new(points, edge_mm) else { return Vec::new() };
    if let Some(cells) = grid.few_cells(points.len()) {
        let mut held = vec![false; cells];
        let first = |(p, _): &(&Point3<f64>, u32)| !std::mem::replace(&mut held[grid.place(p)], true);
        return points.iter().zip(0..).filter(first).map(|(_, index)| index).collect();
    }
    let keyed = grid.by_cell(points);
    let mut kept: Vec<u32> =
        keyed.chunk_by(|a, b| a.0 == b.0).filter_map(|cell| Some(cell.first()?.1)).collect();
    kept.sort_unstable();
    kept
}

/// Indices of points in an order in which those of a cube of about this edge, mm, follow each other.
pub(crate) fn in_cells(points: &[Point3<f64>], edge_mm: f64) -> Vec<u32> {
    let Some(grid) = Grid::new(points, edge_mm) else { return Vec::new() };
    if let Some(cells) = grid.few_cells(points.len()) {
        let places: Vec<u32> = points.par_iter().map(|p| grid.place(p) as u32).collect();
        return counted_order(&places, cells);
    }
    grid.by_cell(points).into_iter().map(|(_, index)| index).collect()
}

/// Cubes of one edge about points.
struct Grid {
    low: Point3<f64>,
    edge_mm: f64,
    /// Cubes along each axis.
    size: [u64; 3],
}

impl Grid {
    /// `None` without points. Absurdly small cells grow instead of running out of numbers.
    fn new(points: &[Point3<f64>], edge_mm: f64) -> Option<Self> {
        let ends = points.par_iter().with_min_len(CHUNK).map(|p| (*p, *p));
        let (low, high) = ends.reduce_with(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)))?;
        let edge_mm = edge_mm.max(least_edge_mm((high - low).max())).max(f64::MIN_POSITIVE);
        let mut grid = Self { low, edge_mm, size: [1; 3] };
        grid.size = grid.cell(&high).map(|last| last + 1);
        Some(grid)
    }

    /// Numbers of a point's cube along the axes.
    fn cell(&self, p: &Point3<f64>) -> [u64; 3] {
        [0, 1, 2].map(|axis| ((p[axis] - self.low[axis]) / self.edge_mm).clamp(0.0, CELLS_PER_AXIS) as u64)
    }

    /// Number of all cubes, if they are no more than a few a point.
    fn few_cells(&self, points: usize) -> Option<usize> {
        let [x, y, z] = self.size.map(|n| n as usize);
        let cells = x.checked_mul(y)?.checked_mul(z)?;
        (cells <= 4 * points).then_some(cells)
    }

    /// Place of a point's cube among all.
    fn place(&self, p: &Point3<f64>) -> usize {
        let [i, j, k] = self.cell(p);
        ((i * self.size[1] + j) * self.size[2] + k) as usize
    }

    /// Numbers of the cubes and of the points in them, both ascending.
    fn by_cell(&self, points: &[Point3<f64>]) -> Vec<(u64, u32)> {
        let key = |p: &Point3<f64>| {
            let [i, j, k] = self.cell(p);
            (i << 42) | (j << 21) | k
        };
        let mut keyed: Vec<(u64, u32)> = points.iter().map(key).zip(0..).collect();
        keyed.par_sort_unstable();
        keyed
    }
}

/// Indices of about `wanted` points: one of each cell of a grid whose edge is found by trial.
pub(crate) fn thin_to(positions: &[Point3<f64>], wanted: usize) -> Vec<u32> {
    if positions.len() <= wanted {
        return (0..positions.len() as u32).collect();
    }
    let bounds = Aabb::of(positions);
    // A surface of the size of the box's diagonal squared would need this edge; a few steps reach most parts.
    let mut edge_mm = (bounds.high - bounds.low).norm() / (wanted as f64).sqrt();
    let mut kept = thinned(positions, edge_mm);
    for _ in 0..6 {
        if kept.len() >= wanted {
            break;
        }
        edge_mm *= (kept.len() as f64 / (1.2 * wanted as f64)).sqrt().clamp(0.25, 0.9);
        kept = thinned(positions, edge_mm);
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_certain_point_of_each_cell_stays_as_it_is() {
        let point = |x: f64, sigma_mm: f32| Point {
            position_mm: [x, 0.0, 0.0],
            sigma_mm,
            ..bytemuck::Zeroable::zeroed()
        };
        let points = [point(0.1, 0.3), point(0.2, 0.1), point(1.3, 0.2), point(1.2, 0.2)];
        assert_eq!(thinned_cloud(&points, 1.0), [points[1], points[2]]);
        assert_eq!(thinned_cloud(&points, 1e-9), points);
    }

    #[test]
    fn the_least_edge_is_that_of_the_largest_extent() {
        let point = |x: f64| Point { position_mm: [x, 1.0, 2.0], ..bytemuck::Zeroable::zeroed() };
        let (extent_mm, edge_mm) = extent_and_least_edge_mm(&[point(-1e6), point(0.0), point(1e6)]);
        assert_eq!((extent_mm, edge_mm), (2e6, 2e6 / CELLS_PER_AXIS));
    }

    #[test]
    fn the_first_point_of_each_cell_stays() {
        let points = [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [1.1, 0.0, 0.0], [0.9, 0.0, 0.0]].map(Point3::from);
        assert_eq!(thinned(&points, 1.0), [0, 2]);
        let many: Vec<Point3<f64>> = (0..600_u32)
            .map(|i| Point3::new(f64::from(i * 7919 % 601), f64::from(i * 31 % 97), f64::from(i % 50)))
            .collect();
        // Few cubes are counted, many sorted: both are met.
        for (edge_mm, few) in
            [(0.5, false), (3.0, false), (12.0, true), (20.0, true), (40.0, true), (1e3, true)]
        {
            let grid = Grid::new(&many, edge_mm).unwrap();
            assert_eq!(grid.few_cells(many.len()).is_some(), few, "{edge_mm}");
            let keyed = grid.by_cell(&many);
            let mut sorted: Vec<u32> = keyed.chunk_by(|a, b| a.0 == b.0).map(|cell| cell[0].1).collect();
            sorted.sort_unstable();
            assert_eq!(thinned(&many, edge_mm), sorted, "{edge_mm}");
        }
        assert_eq!(thinned(&points, 1e-3), [0, 1, 2, 3]);
        assert_eq!(thinned(&[], 1.0), [0_u32; 0]);
        assert_eq!(thinned(&points, f64::MIN_POSITIVE), [0, 1, 2, 3]);
    }
}
