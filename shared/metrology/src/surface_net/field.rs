//! On which side of the surface the corners of a grid lie.

use super::NetError;
use fringe::cloud::Point;
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// A point tells the side of corners within so many cells.
const REACH_CELLS: f64 = 1.5;
/// Most corners along an axis: three numbers of 21 bits make a key.
const MOST: u32 = (1 << 21) - 1;

/// Signed distances at corners of a grid near a cloud.
pub struct Field {
    origin: Point3<f64>,
    cell_mm: f64,
    /// Distance of each corner that points reach, mm, positive outside.
    distance_mm: BTreeMap<[u32; 3], f64>,
}

impl Field {
    /// Sums up what the points say, in their order.
    pub fn new(points: &[Point], cell_mm: f64) -> Result<Self, NetError> {
        let reach_mm = REACH_CELLS * cell_mm;
        let first = points.iter().map(Point::position).reduce(|a, b| a.inf(&b)).unwrap_or_default();
        let last = points.iter().map(Point::position).reduce(|a, b| a.sup(&b)).unwrap_or_default();
        let origin = first - Vector3::repeat(reach_mm + cell_mm);
        let cells = (last - origin).max() / cell_mm + REACH_CELLS + 2.0;
        if !cells.is_finite() || cells > f64::from(MOST) {
            return Err(NetError::TooFine { cell_mm, cells, limit: MOST });
        }
        let mut sums: BTreeMap<[u32; 3], [f64; 2]> = BTreeMap::new();
        for point in points {
            let (p, n) = (point.position(), point.normal_vector());
            if n.norm_squared() > 0.25 {
                add(&mut sums, &p, &n, &origin, cell_mm);
            }
        }
        let distance_mm = sums
            .into_iter()
            .filter(|(_, [weight, _])| *weight > 0.0)
            .map(|(k, [w, sum])| (k, sum / w))
            .collect();
        Ok(Self { origin, cell_mm, distance_mm })
    }

    /// Place of a corner, mm.
    fn place(&self, corner: [u32; 3]) -> Point3<f64> {
        self.origin + Vector3::from(corner.map(f64::from)) * self.cell_mm
    }

    /// Edges that the surface crosses.
    pub fn crossings(&self) -> Vec<Crossing> {
        let mut crossings = Vec::new();
        for (corner, here) in &self.distance_mm {
            for axis in 0..3 {
                let mut next = *corner;
                next[axis] += 1;
                let Some(there) = self.distance_mm.get(&next) else { continue };
                if (*here < 0.0) != (*there < 0.0) {
                    let at = self.place(*corner).lerp(&self.place(next), here / (here - there));
                    crossings.push(Crossing { corner: *corner, axis, outward: *here < 0.0, at });
                }
            }
        }
        crossings
    }
}

/// An edge of the grid that the surface crosses.
pub struct Crossing {
    corner: [u32; 3],
    axis: usize,
    /// Whether the edge leads outwards.
    pub outward: bool,
    at: Point3<f64>,
}

impl Crossing {
    /// The cells around the edge, counter-clockwise when seen from its end; none below the first one.
    pub fn cells(&self) -> [Option<[u32; 3]>; 4] {
        let [across, along] = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(back_across, back_along)| {
            let mut cell = self.corner;
            cell[across] = cell[across].checked_sub(back_across)?;
            cell[along] = cell[along].checked_sub(back_along)?;
            Some(cell)
        })
    }
}

/// Cells that the surface passes, and in each the mean of the places where it crosses the edges, mm.
pub fn vertices(crossings: &[Crossing]) -> Vec<([u32; 3], Point3<f64>)> {
    let mut cells: BTreeMap<[u32; 3], (Vector3<f64>, f64)> = BTreeMap::new();
    for crossing in crossings {
        for cell in crossing.cells().into_iter().flatten() {
            let sum = cells.entry(cell).or_insert((Vector3::zeros(), 0.0));
            sum.0 += crossing.at.coords;
            sum.1 += 1.0;
        }
    }
    cells.into_iter().map(|(cell, (sum, count))| (cell, Point3::from(sum / count))).collect()
}

/// Adds what a point says to all corners within its reach.
fn add(
    sums: &mut BTreeMap<[u32; 3], [f64; 2]>,
    p: &Point3<f64>,
    n: &Vector3<f64>,
    origin: &Point3<f64>,
    cell_mm: f64,
) {
    let at = (p - origin) / cell_mm;
    // The origin lies more than the reach below every point.
    let range = |k: usize| ((at[k] - REACH_CELLS).ceil() as u32)..=((at[k] + REACH_CELLS).floor() as u32);
    for x in range(0) {
        for y in range(1) {
            for z in range(2) {
                let off = Vector3::new(f64::from(x), f64::from(y), f64::from(z)) - at;
                let near = 1.0 - off.norm_squared() / (REACH_CELLS * REACH_CELLS);
                if near > 0.0 {
                    let sum = sums.entry([x, y, z]).or_default();
                    sum[0] += near * near;
                    sum[1] += near * near * n.dot(&off) * cell_mm;
                }
            }
        }
    }
}
