//! Branch cuts: closed edges that leave no charge unbalanced (Goldstein, Zebker, Werner, Radio Science 23, 1988).
//!
//! Residues are paired as Goldstein does: a box about each residue grows until it meets another one, a hole or the border;
//! the tree so built is finished when its charges sum to zero. A cut runs between faces and closes edges, not
//! pixels: no pixel is lost to it. What is left (holes that carry charge, residues without a partner in reach) is led
//! to the outside along the tree of shortest ways, on which opposite charges meet and vanish. Holes cost nothing to cross.

use super::edges::Grid;
use super::faces::{Faces, OUTSIDE};
use std::collections::VecDeque;

/// Closed edges by [`Grid::edge`] number.
#[derive(Debug)]
pub struct Cuts {
    closed: Vec<bool>,
}

impl Cuts {
    /// Connects residues until all charges are balanced.
    pub fn new(faces: &Faces, grid: &Grid<'_>, reach_px: u32) -> Self {
        let mut search = Search {
            faces,
            grid,
            charge: faces.charge.clone(),
            cuts: Self { closed: vec![false; 2 * grid.valid.len()] },
        };
        search.charge[OUTSIDE] = 0;
        for face in 0..faces.charge.len() {
            if faces.open[face] && search.charge[face] != 0 {
                search.grow_tree(face, reach_px as usize);
            }
        }
        if search.charge.iter().any(|charge| *charge != 0) {
            search.lead_outside();
        }
        search.cuts
    }

    /// Whether no path may cross this edge.
    pub fn is_closed(&self, number: u32) -> bool {
        self.closed[number as usize]
    }

    /// How many edges between valid pixels are closed.
    pub fn count(&self, grid: &Grid<'_>) -> usize {
        grid.edges().filter(|(number, _)| self.is_closed(*number)).count()
    }
}

struct Search<'a> {
    faces: &'a Faces,
    grid: &'a Grid<'a>,
    /// What is still to be balanced, by face or first face of a hole; the outside takes everything.
    charge: Vec<i32>,
    cuts: Cuts,
}

impl Search<'_> {
    /// Pairs a residue; what finds no partner stays at it.
    fn grow_tree(&mut self, start: usize, reach: usize) {
        let mut tree = vec![start];
        let mut scanned = vec![0_usize];
        let mut sum = std::mem::take(&mut self.charge[start]);
        for radius in 1..=reach {
            let mut member = 0;
            while member < tree.len() {
                // A member that joined late looks at the rings it has missed.
                for ring in scanned[member] + 1..=radius {
                    for met in ring_of(self.faces, tree[member], ring) {
                        let hole = !self.faces.open[met];
                        if !hole && self.charge[met] == 0 {
                            continue;
                        }
                        self.cut(tree[member], met);
                        if hole {
                            let hole = self.faces.hole[met] as usize;
                            self.charge[hole] += if hole == OUTSIDE { 0 } else { sum };
                            return;
                        }
                        sum += std::mem::take(&mut self.charge[met]);
                        if sum == 0 {
                            return;
                        }
                        tree.push(met);
                        scanned.push(0);
                    }
                    scanned[member] = ring;
                }
                member += 1;
            }
        }
        self.charge[start] = sum;
    }

    /// Closes the edges on a straight way between two faces.
    fn cut(&mut self, from: usize, to: usize) {
        let w = self.faces.width;
        let (mut x, mut y) = (from % w, from / w);
        let (to_x, to_y) = (to % w, to / w);
        while (x, y) != (to_x, to_y) {
            let next = if x.abs_diff(to_x) > y.abs_diff(to_y) {
                (if to_x > x { x + 1 } else { x - 1 }, y)
            } else {
                (x, if to_y > y { y + 1 } else { y - 1 })
            };
            self.close(y * w + x, next.1 * w + next.0);
            (x, y) = next;
        }
    }

    /// Closes the edge between two faces side by side, if it is one.
    fn close(&mut self, a: usize, b: usize) {
        if let Some(number) = between(self.grid, self.faces, a.min(b), a.max(b)) {
            self.cuts.closed[number as usize] = true;
        }
    }

    fn lead_outside(&mut self) {
        let (order, parent) = shortest_ways(self.faces);
        for face in order.into_iter().rev() {
            let hole = self.faces.hole[face as usize] as usize;
            // The charge of a hole leaves it at the face by which the way reached it first.
            let entry = parent[face as usize] != face
                && self.faces.hole[parent[face as usize] as usize] as usize != hole;
            if !entry || self.charge[hole] == 0 {
                continue;
            }
            let charge = std::mem::take(&mut self.charge[hole]);
            let above = self.faces.hole[parent[face as usize] as usize] as usize;
            self.close(face as usize, parent[face as usize] as usize);
            if above != OUTSIDE {
                self.charge[above] += charge;
            }
        }
    }
}

/// The faces on the border of a square about a face, within the image, row by row.
fn ring_of(faces: &Faces, centre: usize, radius: usize) -> impl Iterator<Item = usize> + use<> {
    let (w, h) = (faces.width as i64, faces.height as i64);
    let (x, y, r) = (centre as i64 % w, centre as i64 / w, radius as i64);
    (y - r..=y + r).filter(move |row| (0..h).contains(row)).flat_map(move |row| {
        let step = if (row - y).abs() == r { 1 } else { 2 * r };
        (x - r..=x + r)
            .step_by(step as usize)
            .filter(move |column| (0..w).contains(column))
            .map(move |column| (row * w + column) as usize)
    })
}

/// Number of the edge between a face and the one right of or below it; `None` where its pixels are not both valid.
fn between(grid: &Grid<'_>, faces: &Faces, first: usize, second: usize) -> Option<u32> {
    let (x, y) = (first % faces.width, first / faces.width);
    let rightwards = second == first + 1;
    // Going right crosses the edge between (x, y − 1) and (x, y); going down that between (x − 1, y) and (x, y).
    let (column, row) = if rightwards { (Some(x), y.checked_sub(1)) } else { (x.checked_sub(1), Some(y)) };
    let (column, row) = column.zip(row)?;
    if column >= grid.width || row >= grid.height {
        return None;
    }
    let pixel = row * grid.width + column;
    let edge = if rightwards { grid.down(pixel) } else { grid.right(pixel) };
    edge.map(|_| 2 * pixel as u32 + u32::from(rightwards))
}

/// Faces by rising number of edges crossed from the outside, and from where each was reached first; roots point to
/// themselves. All faces of a hole are as far as its nearest one.
fn shortest_ways(faces: &Faces) -> (Vec<u32>, Vec<u32>) {
    let n = faces.charge.len();
    let mut members: Vec<u32> = (0..n as u32).filter(|face| !faces.open[*face as usize]).collect();
    members.sort_by_key(|face| faces.hole[*face as usize]);
    let group = |hole: u32| {
        let start = members.partition_point(|face| faces.hole[*face as usize] < hole);
        members[start..].iter().copied().take_while(move |face| faces.hole[*face as usize] == hole)
    };
    let mut parent = vec![u32::MAX; n];
    let mut queue = VecDeque::new();
    let mut order = Vec::with_capacity(n);
    for face in group(OUTSIDE as u32) {
        parent[face as usize] = face;
        queue.push_back(face);
    }
    while let Some(face) = queue.pop_front() {
        order.push(face);
        let (x, y) = (face as usize % faces.width, face as usize / faces.width);
        let neighbours = [
            (y > 0).then(|| face - faces.width as u32),
            (x > 0).then(|| face - 1),
            (x + 1 < faces.width).then_some(face + 1),
            (y + 1 < faces.height).then(|| face + faces.width as u32),
        ];
        for next in neighbours.into_iter().flatten() {
            if parent[next as usize] != u32::MAX {
                continue;
            }
            parent[next as usize] = face;
            queue.push_back(next);
            if !faces.open[next as usize] {
                for other in group(faces.hole[next as usize]).filter(|other| *other != next) {
                    // Reached from within: the hole is one node.
                    parent[other as usize] = next;
                    queue.push_back(other);
                }
            }
        }
    }
    (order, parent)
}
