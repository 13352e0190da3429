//! Where a mesh ends: holes and its outer border.

use super::SurfaceNet;
use nalgebra::{Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// A closed line at which the mesh ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Opening {
    /// Length of the line, mm.
    pub perimeter_mm: f64,
    /// Area that triangles from the line to its middle would have, mm²: that of a flat hole.
    pub area_mm2: f64,
    /// Middle of the line, mm.
    pub middle_mm: [f64; 3],
}

impl SurfaceNet {
    /// All openings, the largest area first; that of an open surface is its outer border.
    pub fn openings(&self) -> Vec<Opening> {
        let mut ends = BTreeSet::new();
        for [a, b, c] in &self.triangles {
            for edge in [(*a, *b), (*b, *c), (*c, *a)] {
                if !ends.remove(&(edge.1, edge.0)) {
                    ends.insert(edge);
                }
            }
        }
        let mut next: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (from, to) in ends {
            next.entry(from).or_default().push(to);
        }
        let mut openings = Vec::new();
        while let Some((start, _)) = next.first_key_value() {
            let start = *start;
            let mut line = vec![start];
            let mut at = start;
            while let Some(targets) = next.get_mut(&at) {
                let Some(to) = targets.pop() else { break };
                if targets.is_empty() {
                    next.remove(&at);
                }
                at = to;
                if at == start {
                    break;
                }
                line.push(at);
            }
            openings.push(self.opening(&line));
        }
        openings.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2));
        openings
    }

    fn opening(&self, line: &[u32]) -> Opening {
        let places: Vec<Point3<f64>> = line.iter().map(|corner| self.corners[*corner as usize]).collect();
        let middle = places.iter().map(|p| p.coords).sum::<Vector3<f64>>() / places.len() as f64;
        let sides = || places.iter().zip(places.iter().cycle().skip(1));
        Opening {
            perimeter_mm: sides().map(|(a, b)| (b - a).norm()).sum(),
            area_mm2: sides()
                .map(|(a, b)| 0.5 * (a.coords - middle).cross(&(b.coords - middle)).norm())
                .sum(),
            middle_mm: middle.into(),
        }
    }
}
