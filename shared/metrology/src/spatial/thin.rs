//! One point for each cell of a grid.

use super::bvh::Aabb;
use nalgebra::Point3;
use rayon::prelude::*;

/// Cells along one axis that fit into a third of the key.
const CELLS_PER_AXIS: f64 = 2_097_151.0;

/// Indices, ascending, of the first point in each cube of a grid with this edge, mm.
pub(crate) fn thinned(points: &[Point3<f64>], edge_mm: f64) -> Vec<u32> {
    let Some(low) = points.iter().copied().reduce(|a, b| a.inf(&b)) else {
        return Vec::new();
    };
    let high = points.iter().fold(low, |high, p| high.sup(p));
    // Absurdly small cells grow instead of running out of numbers.
    let edge_mm = edge_mm.max((high - low).max() / CELLS_PER_AXIS).max(f64::MIN_POSITIVE);
    let axis = |value: f64| (value / edge_mm).clamp(0.0, CELLS_PER_AXIS) as u64;
    let key = |p: &Point3<f64>| (axis(p.x - low.x) << 42) | (axis(p.y - low.y) << 21) | axis(p.z - low.z);
    let mut keyed: Vec<(u64, u32)> = points.iter().map(key).zip(0..).collect();
    keyed.par_sort_unstable();
    let mut kept: Vec<u32> =
        keyed.chunk_by(|a, b| a.0 == b.0).filter_map(|cell| Some(cell.first()?.1)).collect();
    kept.sort_unstable();
    kept
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
    fn the_first_point_of_each_cell_stays() {
        let points = [[0.1, 0.0, 0.0], [0.2, 0.0, 0.0], [1.1, 0.0, 0.0], [0.9, 0.0, 0.0]].map(Point3::from);
        assert_eq!(thinned(&points, 1.0), [0, 2]);
        assert_eq!(thinned(&points, 1e-3), [0, 1, 2, 3]);
        assert_eq!(thinned(&[], 1.0), [0_u32; 0]);
        assert_eq!(thinned(&points, f64::MIN_POSITIVE), [0, 1, 2, 3]);
    }
}
