//! Which side of a cloud without normals is outside.
//!
//! Normals of neighbours face alike: a spanning tree carries the side from the point above all others to the rest, first along
//! neighbours whose normals agree most and that lie in each other's planes, so that it does not cross a thin wall (after Hoppe et al.,
//! Surface reconstruction from unorganized points, SIGGRAPH 1992). Of a closed surface the outside is that of a positive volume; of an
//! open one, the side that faces a given direction.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use crate::reference::{CloudError, CloudReference};

/// Neighbours lie within so many spacings: a dozen.
const NEIGHBOUR_SPACINGS: f64 = 2.0;

/// Length of the mean normal up to which a surface counts as closed: 0 for a whole one, a half for half a sphere.
const CLOSED_MEAN: f64 = 0.3;

/// An open surface shows its outside along a direction where its mean normal lies by more than this along it.
const SHOWN: f64 = 0.1;

/// A piece with a larger share of the points has to show its outside; smaller ones face the direction as they can.
const LARGE_SHARE: f64 = 0.1;

/// How a cloud without normals was faced.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Facing {
    /// Closed pieces, faced by their volume.
    pub closed: usize,
    /// Open pieces, faced along the given direction.
    pub open: usize,
}

impl CloudReference {
    /// Gives a cloud without normals those of a consistent orientation; others stay as they are.
    ///
    /// # Errors
    /// A large open piece that shows no outside along the given direction.
    pub fn faced(self) -> Result<(Self, Facing), CloudError> {
        if self.has_normals() {
            return Ok((self, Facing::default()));
        }
        let with = self.with_normals();
        let mut normals = with.normals.clone();
        let mut known = vec![false; normals.len()];
        let mut facing = Facing::default();
        for first in 0..normals.len() {
            if known[first] || normals[first].is_none() {
                continue;
            }
            let piece = spread(&with, first, &mut normals, &mut known);
            if piece.len() < 2 {
                continue;
            }
            let closed = face(&with, &piece, &mut normals)?;
            *(if closed { &mut facing.closed } else { &mut facing.open }) += 1;
        }
        let given = |n: &Option<Vector3<f64>>| n.map_or([0.0; 3], |n| n.map(|v| v as f32).into());
        Ok((with.with_given(normals.iter().map(given).collect()), facing))
    }
}

/// Turns the normals of all points that hang together with the first one like its own; returns their slots.
fn spread(
    cloud: &CloudReference,
    first: usize,
    normals: &mut [Option<Vector3<f64>>],
    known: &mut [bool],
) -> Vec<usize> {
    let sites = cloud.tree.sites();
    let reach_mm = NEIGHBOUR_SPACINGS * cloud.spacing_mm();
    let mut piece = Vec::new();
    // The bits of numbers that are not negative order as they do.
    let mut next = BinaryHeap::from([Reverse((0_u64, first, first))]);
    while let Some(Reverse((_, slot, from))) = next.pop() {
        let (Some(normal), Some(before), false) = (normals[slot], normals[from], known[slot]) else {
            continue;
        };
        let normal = if normal.dot(&before) < 0.0 { -normal } else { normal };
        (normals[slot], known[slot]) = (Some(normal), true);
        piece.push(slot);
        let site = sites[slot];
        cloud.tree.within(&site, reach_mm, |near| {
            if let (Some(other), false) = (normals[near], known[near]) {
                next.push(Reverse((cost(&normal, &other, &(sites[near] - site)).to_bits(), near, slot)));
            }
        });
    }
    piece
}

/// How badly two neighbours tell of the same side: normals that differ, and an arm that leaves their planes.
fn cost(a: &Vector3<f64>, b: &Vector3<f64>, arm: &Vector3<f64>) -> f64 {
    let length = arm.norm().max(f64::MIN_POSITIVE);
    (1.0 - a.dot(b).abs()).max(0.0) + (a.dot(arm).abs() + b.dot(arm).abs()) / length
}

/// Turns a piece as a whole outside; says whether it is closed.
fn face(
    cloud: &CloudReference,
    piece: &[usize],
    normals: &mut [Option<Vector3<f64>>],
) -> Result<bool, CloudError> {
    let sites = cloud.tree.sites();
    let count = piece.len() as f64;
    let middle = Point3::from(piece.iter().map(|s| sites[*s].coords).sum::<Vector3<f64>>() / count);
    let of = |slot: &usize| normals[*slot].unwrap_or_default();
    let mean = piece.iter().map(of).sum::<Vector3<f64>>() / count;
    let closed = mean.norm() < CLOSED_MEAN;
    let side = if closed {
        piece.iter().map(|s| of(s).dot(&(sites[*s] - middle))).sum::<f64>()
    } else {
        let towards = cloud.towards();
        let shown = mean.dot(&towards) / towards.norm().max(f64::MIN_POSITIVE);
        if shown.abs() < SHOWN * mean.norm() && count > LARGE_SHARE * sites.len() as f64 {
            return Err(CloudError::Side { towards: towards.into(), mean: mean.into() });
        }
        shown
    };
    if side < 0.0 {
        for slot in piece {
            normals[*slot] = normals[*slot].map(|n| -n);
        }
    }
    Ok(closed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::cloud::Point;
    use fringe::synthetic::Noise;

    fn bare(places: impl IntoIterator<Item = Vector3<f64>>) -> Vec<Point> {
        let zero: Point = bytemuck::Zeroable::zeroed();
        places.into_iter().map(|p| Point { position_mm: p.into(), ..zero }).collect()
    }

    fn faced(points: &[Point], towards: Vector3<f64>) -> Result<(CloudReference, Facing), CloudError> {
        CloudReference::new(points, towards, None).unwrap().faced()
    }

    /// Share of the normals that look along those of a function.
    fn right(cloud: &CloudReference, outside: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> f64 {
        let normals = &cloud.normals;
        let sites = cloud.tree.sites();
        let good = (0..sites.len()).filter(|slot| {
            let given = cloud.given_normal(*slot);
            normals[*slot].is_some() && given.dot(&outside(&sites[*slot].coords)) > 0.0
        });
        good.count() as f64 / sites.len() as f64
    }

    /// A sphere, and a sheet of 0.6 mm with two sides and round rims, whichever way is given.
    #[test]
    fn closed_surfaces_face_outwards() {
        let mut noise = Noise(3);
        let ball: Vec<Vector3<f64>> = (0..8000)
            .map(|_| Vector3::new(noise.gauss(), noise.gauss(), noise.gauss()).normalize() * 10.0)
            .collect();
        let flat: Vec<Vector3<f64>> = (0..30_000)
            .map(|_| {
                let at = Vector3::new(20.0 * noise.unit() - 10.0, 20.0 * noise.unit() - 10.0, 0.0);
                at + Vector3::z() * if noise.unit() < 0.5 { 2.0 } else { -2.0 }
            })
            .collect();
        let rims = (0..12_000).map(|_| {
            let (along, up, side) = (20.0 * noise.unit() - 10.0, 4.0 * noise.unit() - 2.0, noise.unit());
            let end = if noise.unit() < 0.5 { 10.0 } else { -10.0 };
            if side < 0.5 { Vector3::new(end, along, up) } else { Vector3::new(along, end, up) }
        });
        let rims: Vec<Vector3<f64>> = rims.collect();
        let plate: Vec<Vector3<f64>> = flat.into_iter().chain(rims).collect();
        let out = |p: &Vector3<f64>| {
            let over = [p.x.abs() - 10.0, p.y.abs() - 10.0, p.z.abs() - 2.0];
            let most = (0..3).fold(0, |m, i| if over[i] > over[m] { i } else { m });
            Vector3::ith(most, p[most].signum())
        };
        for towards in [Vector3::z(), Vector3::x(), -Vector3::z()] {
            let (cloud, facing) = faced(&bare(ball.clone()), towards).unwrap();
            assert_eq!((facing.closed, facing.open), (1, 0));
            assert!(right(&cloud, |p| *p) > 0.999);
            let (cloud, facing) = faced(&bare(plate.clone()), towards).unwrap();
            assert_eq!(facing.closed, 1, "{facing:?}");
            // On an edge either face is right.
            assert!(right(&cloud, out) > 0.97, "{}", right(&cloud, out));
        }
    }

    /// A half sphere faces the direction that is given; one along its rim says nothing and is refused.
    #[test]
    fn open_surfaces_face_the_direction_or_are_refused() {
        let mut noise = Noise(3);
        let dome: Vec<Vector3<f64>> = (0..8000)
            .map(|_| {
                let d = Vector3::new(noise.gauss(), noise.gauss(), noise.gauss()).normalize() * 10.0;
                Vector3::new(d.x, d.y, d.z.abs())
            })
            .collect();
        for side in [1.0, -1.0] {
            let (cloud, facing) = faced(&bare(dome.clone()), Vector3::z() * side).unwrap();
            assert_eq!((facing.closed, facing.open), (0, 1));
            assert!(right(&cloud, |p| p * side) > 0.995);
        }
        let told = faced(&bare(dome), Vector3::x()).unwrap_err().to_string();
        assert!(told.contains("no outside") && told.contains("(1, 0, 0)"), "{told}");
    }
}
