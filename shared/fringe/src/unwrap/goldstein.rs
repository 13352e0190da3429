//! Branch-cut unwrapping: any way that crosses no cut gives the same phase.

use super::angle::Angles;
use super::cuts::Cuts;
use super::edges::{Edge, Grid};
use super::faces::{Charges, Faces, OUTSIDE};
use super::forest::{Forest, Labels};
use super::report::Residues;

/// Joins over the open edges, and regions that cuts enclose over the closed edge with the smallest difference.
pub fn unwrap(angles: &Angles<'_>, grid: &Grid<'_>, reach_px: u32) -> (Labels, Residues) {
    let faces = Faces::new(Charges::new(angles, grid), grid);
    let cuts = Cuts::new(&faces, grid, reach_px);
    let mut forest = Forest::new(angles.turn.len());
    for (_, (a, b)) in grid.edges().filter(|(number, _)| !cuts.is_closed(*number)) {
        forest.join(a, b, angles.step(a, b));
    }
    let mut closed: Vec<(u32, Edge)> = grid
        .edges()
        .filter(|(number, _)| cuts.is_closed(*number))
        .map(|(_, (a, b))| (angles.difference(a, b).unsigned_abs(), (a, b)))
        .collect();
    closed.sort_unstable();
    let joined = closed.iter().filter(|(_, (a, b))| forest.join(*a, *b, angles.step(*a, *b))).count();
    let of = |charged: &dyn Fn(usize) -> bool| (0..faces.charge.len()).filter(|face| charged(*face)).count();
    let residues = Residues {
        positive: of(&|face| faces.open[face] && faces.charge[face] > 0),
        negative: of(&|face| faces.open[face] && faces.charge[face] < 0),
        charged_holes: of(&|face| face != OUTSIDE && !faces.open[face] && faces.charge[face] != 0),
        cut_edges: cuts.count(grid),
        joined_across_cuts: joined,
    };
    (forest.labels(&angles.valid), residues)
}
