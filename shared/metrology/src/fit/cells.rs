//! Points sorted into cubes.

use nalgebra::Vector3;

/// Cells along one axis that fit into a third of the key.
const CELLS_PER_AXIS: f64 = 2_097_151.0;

/// Points by the cell they lie in: (key of the cell, index), sorted.
pub(super) fn cells_of(points: &[Vector3<f64>], edge_mm: f64) -> Vec<(u64, u32)> {
    let lowest = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(p));
    let axis_key = |value: f64| (value / edge_mm).clamp(0.0, CELLS_PER_AXIS) as u64;
    let mut keyed: Vec<(u64, u32)> = points
        .iter()
        .enumerate()
        .map(|(index, p)| {
            let offset = p - lowest;
            let key = (axis_key(offset.x) << 42) | (axis_key(offset.y) << 21) | axis_key(offset.z);
            (key, index as u32)
        })
        .collect();
    keyed.sort_unstable();
    keyed
}
