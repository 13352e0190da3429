//! A mesh of triangles through a cloud, closed where the surface was seen and open where it was not.
//!
//! Around its points a cloud says on which side of the surface a place lies: the weighted mean of n · (c − p) over the points p within reach
//! of c. On a grid the sign of that mean changes from corner to corner where the surface passes. Each cell that it passes gets a vertex,
//! each edge of the grid that it crosses a square between the four cells around it (surface nets: Gibson, Constrained elastic surface nets,
//! MICCAI 1998). Skins of several views over each other become one. Vertices then move onto a paraboloid through the points around
//! them, for a mean of planes lies beside a curved surface. Edges that four triangles share are drawn together ([`manifold`]).
//!
//! Points are visited in their order and cells in that of their numbers: the same cloud gives the same mesh.

mod check;
mod field;
mod manifold;
mod openings;
#[cfg(test)]
mod tests;

pub use check::NetCheck;
pub use openings::Opening;

use crate::spatial::{CHUNK, Place, PointTree, Vicinity, groups};
use field::{Crossing, Field, vertices};
use fringe::cloud::Point;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use std::collections::BTreeMap;
use thiserror::Error;

/// Edge of a cell without being told, in distances of neighbouring points.
const CELL_SPACINGS: f64 = 2.0;
/// A vertex without a point so near, in cells, is no surface that was seen.
const SEEN_CELLS: f64 = 0.75;
/// Points within so many cells of a vertex give its paraboloid.
const PATCH_CELLS: f64 = 1.5;
/// A paraboloid farther away than this, in cells, is not the surface of the vertex.
const MOST_MOVE_CELLS: f64 = 0.5;

/// Why a cloud gives no mesh.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum NetError {
    /// Which side is outside is not known.
    #[error(
        "{without} of {given} points have no normal; a mesh needs them: take the cloud as `reconstruct` or `run` wrote it"
    )]
    NoNormals {
        /// Points without a normal.
        without: usize,
        /// Points of the cloud.
        given: usize,
    },
    /// The cloud has nothing to connect.
    #[error("{given} points give no surface with cells of {cell_mm} mm; choose larger cells")]
    Empty {
        /// Points of the cloud.
        given: usize,
        /// Edge of a cell, mm.
        cell_mm: f64,
    },
    /// Points that say nothing about how far apart points are.
    #[error(
        "{given} points lie in one place; a mesh needs a surface: take more points, or a smaller --decimate"
    )]
    OnePlace {
        /// Points of the cloud.
        given: usize,
    },
    /// Each point would stand alone.
    #[error(
        "cells of {cell_mm} mm are smaller than neighbouring points are apart ({spacing_mm:.3} mm); choose larger cells"
    )]
    Sparse {
        /// Edge of a cell, mm.
        cell_mm: f64,
        /// Distance of neighbouring points, mm.
        spacing_mm: f64,
    },
    /// The grid would have more cells than can be numbered.
    #[error("cells of {cell_mm} mm: the cloud is {cells:.0} cells long, limit {limit}; choose larger cells")]
    TooFine {
        /// Edge of a cell, mm.
        cell_mm: f64,
        /// Cells along the longest axis.
        cells: f64,
        /// Most cells along an axis.
        limit: u32,
    },
}

/// Triangles with common corners, counter-clockwise when seen from outside.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceNet {
    /// Corners that triangles share, mm.
    pub corners: Vec<Point3<f64>>,
    /// Three numbers of corners for each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Edge of a cell of the grid, mm.
    pub cell_mm: f64,
}

impl SurfaceNet {
    /// Connects a cloud. Without `cell_mm` the cells are twice as wide as neighbouring points are apart.
    ///
    /// # Errors
    /// Points without normals, cells that are too small to be numbered or too small to hold points together.
    pub fn new(points: &[Point], cell_mm: Option<f64>) -> Result<Self, NetError> {
        let without = points.iter().filter(|p| p.normal_vector().norm() < 0.5).count();
        // Single points at a rim may lack one.
        if 10 * without > points.len() || points.is_empty() {
            return Err(NetError::NoNormals { without, given: points.len() });
        }
        let positions: Vec<Point3<f64>> = points.iter().map(Point::position).collect();
        let tree = PointTree::new(&positions);
        let spacing_mm = tree.spacing_mm();
        let cell_mm = cell_mm.unwrap_or(CELL_SPACINGS * spacing_mm);
        if spacing_mm <= 0.0 {
            return Err(NetError::OnePlace { given: points.len() });
        }
        if cell_mm < spacing_mm {
            return Err(NetError::Sparse { cell_mm, spacing_mm });
        }
        let crossings = Field::new(points, cell_mm)?.crossings();
        let cells = vertices(&crossings);
        let vertices: Vec<Option<Point3<f64>>> = cells
            .par_chunks(CHUNK)
            .flat_map_iter(|part| on_the_surface(&tree, part.iter().map(|(_, at)| *at), cell_mm))
            .collect();
        let mut numbers = BTreeMap::new();
        let mut corners = Vec::new();
        for ((cell, _), vertex) in cells.iter().zip(vertices) {
            if let Some(vertex) = vertex {
                numbers.insert(*cell, corners.len() as u32);
                corners.push(vertex);
            }
        }
        let triangles = triangles(&crossings, &numbers, &corners);
        let (corners, triangles) = manifold::manifold((corners, triangles));
        let net = Self { corners, triangles, cell_mm }.without_loose_corners();
        if net.triangles.is_empty() {
            return Err(NetError::Empty { given: points.len(), cell_mm });
        }
        Ok(net)
    }

    /// Corners of each triangle, mm.
    pub fn positions(&self) -> Vec<[Point3<f64>; 3]> {
        self.triangles.iter().map(|t| t.map(|corner| self.corners[corner as usize])).collect()
    }

    /// Area of all triangles, mm².
    pub fn area_mm2(&self) -> f64 {
        self.positions().iter().map(|[a, b, c]| 0.5 * (b - a).cross(&(c - a)).norm()).sum()
    }

    fn without_loose_corners(mut self) -> Self {
        let mut used = vec![false; self.corners.len()];
        self.triangles.iter().flatten().for_each(|corner| used[*corner as usize] = true);
        let mut number = 0;
        let numbers: Vec<u32> = used
            .iter()
            .map(|used| {
                let own = number;
                number += u32::from(*used);
                own
            })
            .collect();
        let mut place = 0;
        self.corners.retain(|_| {
            place += 1;
            used[place - 1]
        });
        self.triangles.iter_mut().flatten().for_each(|corner| *corner = numbers[*corner as usize]);
        self
    }
}

/// Where the surface passes vertices; `None` where no point was seen.
fn on_the_surface(
    tree: &PointTree,
    vertices: impl Iterator<Item = Point3<f64>>,
    cell_mm: f64,
) -> Vec<Option<Point3<f64>>> {
    let radius_mm = PATCH_CELLS * cell_mm;
    let mut vicinity = Vicinity::new();
    let places: Vec<Place> = vertices.map(|at| (at, [0.0; 3])).collect();
    let mut moved = Vec::with_capacity(places.len());
    for group in groups(places.iter().map(|p| p.0), cell_mm) {
        let places = &places[group];
        vicinity.gather(tree, &[], places, radius_mm);
        for ((at, _), patch) in places.iter().zip(vicinity.patches(places.len())) {
            let seen = tree.nearest(at, SEEN_CELLS * cell_mm).is_some();
            let distance_mm = patch.map_or(f64::INFINITY, |patch| patch.distance_mm(at));
            let near = patch.filter(|_| distance_mm.abs() < MOST_MOVE_CELLS * cell_mm);
            moved.push(seen.then(|| near.map_or(*at, |patch| at - patch.normal() * distance_mm)));
        }
    }
    moved
}

/// Two triangles for each edge of the grid that the surface crosses between four cells with vertices, cut along the shorter diagonal.
fn triangles(
    crossings: &[Crossing],
    numbers: &BTreeMap<[u32; 3], u32>,
    corners: &[Point3<f64>],
) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for crossing in crossings {
        let around = crossing.cells().map(|cell| numbers.get(&cell?).copied());
        let [Some(a), Some(b), Some(c), Some(d)] = around else { continue };
        let [a, b, c, d] = if crossing.outward { [a, b, c, d] } else { [a, d, c, b] };
        let length = |a: u32, b: u32| -> f64 {
            let difference: Vector3<f64> = corners[a as usize] - corners[b as usize];
            difference.norm_squared()
        };
        if length(a, c) <= length(b, d) {
            triangles.extend([[a, b, c], [a, c, d]]);
        } else {
            triangles.extend([[a, b, d], [b, c, d]]);
        }
    }
    triangles
}
