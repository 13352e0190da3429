//! How far a mesh lies from the points that it was made of.

use super::SurfaceNet;
use crate::spatial::{MeshError, TriangleMesh};
use fringe::cloud::Point;
use rayon::prelude::*;

/// Points farther from the mesh than this, in cells, have no part of it.
const REACH_CELLS: f64 = 2.0;

/// Deviations of the points from a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NetCheck {
    /// Root mean square distance of the points, mm.
    pub rms_mm: f64,
    /// Mean signed distance, mm, positive where points lie outside.
    pub mean_mm: f64,
    /// Distance that 95 % of the points stay below, mm.
    pub within_95_mm: f64,
    /// Largest distance of a point, mm.
    pub largest_mm: f64,
    /// Points without a part of the mesh within two cells.
    pub without: usize,
}

impl NetCheck {
    /// Looks up the nearest place of the mesh for each point.
    ///
    /// # Errors
    /// As [`TriangleMesh::new`].
    pub fn of(net: &SurfaceNet, points: &[Point]) -> Result<Self, MeshError> {
        let mesh = TriangleMesh::new(&net.positions())?;
        let found: Vec<Option<f64>> = points
            .par_iter()
            .map(|point| {
                mesh.nearest(&point.position(), REACH_CELLS * net.cell_mm).map(|foot| foot.signed_mm)
            })
            .collect();
        let signed: Vec<f64> = found.iter().flatten().copied().collect();
        let count = signed.len().max(1) as f64;
        let mut sizes: Vec<f64> = signed.iter().map(|d| d.abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        let share = |share: f64| sizes.get((share * (count - 1.0)).ceil() as usize).copied().unwrap_or(0.0);
        Ok(Self {
            rms_mm: (signed.iter().map(|d| d * d).sum::<f64>() / count).sqrt(),
            mean_mm: signed.iter().sum::<f64>() / count,
            within_95_mm: share(0.95),
            largest_mm: share(1.0),
            without: points.len() - signed.len(),
        })
    }
}
