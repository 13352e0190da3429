//! Where turns along the least spanning tree of the pixels jump, found from the residues.
//!
//! Taking all edges by rising key, each that closes a loop left out, gives the tree (Kruskal 1956); as no two edges are equal (ties go
//! by number) there is only one. The edges that it leaves out are, from face to face, the greatest spanning tree of the faces
//! (Whitney 1932). One of them parts the faces into two sides, and the loop that it closes runs about one of these: between its
//! ends the turns jump by the charge of that side. So they jump only on ways that join charges, and only these are
//! looked for: from a charge on, the greatest edge that leads out is in the tree of the faces (Prim 1957), until charges that met
//! sum to zero or the outside is reached. What such groups join beyond has no charge on either side.
//!
//! With the jumps added to the steps of their edges every loop closes: any way gives the turns of the tree.

use super::edges::{Edge, Grid};
use super::faces::{Faces, OUTSIDE};
use std::collections::BinaryHeap;

/// An edge across which the turns along the tree jump.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Jump {
    /// Number of the edge as of [`Grid::edge`].
    pub edge: u32,
    /// Whole turns to be added to the step from its first pixel to its second.
    pub turns: i32,
}

/// The jumps of the least spanning tree of the edges by key, by rising edge.
pub fn jumps(faces: &Faces, grid: &Grid<'_>, key: impl Fn(Edge) -> u32) -> Vec<Jump> {
    let mut growth = Growth::new(faces, grid, key);
    for charge in 0..growth.groups.len() {
        growth.grow(charge);
    }
    growth.balance()
}

/// A face, or a hole, that a group holds.
#[derive(Debug)]
struct Node {
    /// Another node of the group, or itself at the root.
    parent: u32,
    /// Edges of the tree of the faces at this node.
    ways: u32,
    /// Their numbers, each bit the parity of its sum: the number itself where there is one.
    mixed: u32,
    charge: i32,
}

/// Charges that ways of the tree have joined.
#[derive(Debug, Default)]
struct Group {
    /// Edges that may lead out: keys above numbers.
    edges: BinaryHeap<u64>,
    /// A face whose edges are not among these yet, and the edge by which it was reached.
    fresh: Option<(usize, Option<u32>)>,
    charge: i32,
    outside: bool,
}

struct Growth<'a, K> {
    faces: &'a Faces,
    grid: &'a Grid<'a>,
    key: K,
    /// Number of the node + 1 by face; 0 where no group has come to.
    node: Vec<u32>,
    nodes: Vec<Node>,
    /// By root, each of which is a charge or the outside: they are the first nodes.
    groups: Vec<Group>,
}

impl<'a, K: Fn(Edge) -> u32> Growth<'a, K> {
    /// Each charge by itself, and the outside.
    fn new(faces: &'a Faces, grid: &'a Grid<'a>, key: K) -> Self {
        let (node, nodes, groups) = (vec![0; faces.charge.len()], Vec::new(), Vec::new());
        let mut growth = Self { faces, grid, key, node, nodes, groups };
        for (face, charge) in faces.charge.iter().enumerate() {
            if *charge != 0 || face == OUTSIDE {
                let root = growth.nodes.len();
                let (fresh, outside) = (Some((face, None)), face == OUTSIDE);
                growth.groups.push(Group { fresh, charge: *charge, outside, ..Group::default() });
                growth.enter(face, root);
            }
        }
        growth
    }

    /// Puts a face into the group of a root.
    fn enter(&mut self, face: usize, root: usize) {
        let charge = self.faces.charge[face];
        self.nodes.push(Node { parent: root as u32, ways: 0, mixed: 0, charge });
        self.node[face] = self.nodes.len() as u32;
    }

    /// Looks at the edges of a face in the group of a root, but not at the one by which it was reached.
    fn look(&mut self, root: usize) {
        let (grid, key, group) = (self.grid, &self.key, &mut self.groups[root]);
        let Some((face, reached)) = group.fresh.take() else { return };
        self.faces.edges(face, grid, |number| {
            if Some(number) != reached {
                group.edges.push(u64::from(key(grid.edge(number))) << 32 | u64::from(number));
            }
        });
    }

    /// Follows the tree from a charge until its group has none or holds the outside.
    fn grow(&mut self, charge: usize) {
        let mut root = self.root(charge);
        while self.groups[root].charge != 0 && !self.groups[root].outside {
            self.look(root);
            let Some(edge) = self.groups[root].edges.pop() else { return };
            let sides = self.faces.sides(edge as u32);
            let (plus, minus) = (self.root_of(sides.plus), self.root_of(sides.minus));
            if plus == minus {
                continue;
            }
            if let Some((plus, minus)) = plus.zip(minus) {
                root = self.unite(plus, minus);
            } else {
                let face = if plus.is_none() { sides.plus } else { sides.minus };
                self.enter(face, root);
                self.groups[root].fresh = Some((face, Some(edge as u32)));
            }
            for face in [sides.plus, sides.minus] {
                let node = &mut self.nodes[self.node[face] as usize - 1];
                node.ways += 1;
                node.mixed ^= edge as u32;
            }
        }
    }

    fn root_of(&mut self, face: usize) -> Option<usize> {
        let node = self.node[face].checked_sub(1)?;
        Some(self.root(node as usize))
    }

    /// Root of a node's group; halves the path on its way.
    fn root(&mut self, node: usize) -> usize {
        let mut at = node;
        loop {
            let parent = self.nodes[at].parent as usize;
            if parent == at {
                return at;
            }
            let above = self.nodes[parent].parent;
            self.nodes[at].parent = above;
            at = above as usize;
        }
    }

    /// Makes two groups one; gives its root.
    fn unite(&mut self, one: usize, other: usize) -> usize {
        let fewer = self.groups[one].edges.len() < self.groups[other].edges.len();
        let (low, high) = if fewer { (other, one) } else { (one, other) };
        let mut joined = std::mem::take(&mut self.groups[high]);
        let group = &mut self.groups[low];
        group.edges.append(&mut joined.edges);
        group.fresh = group.fresh.or(joined.fresh);
        group.charge += joined.charge;
        group.outside |= joined.outside;
        self.nodes[high].parent = low as u32;
        low
    }

    /// Leads each charge along the tree to where it vanishes, from the ends of the tree inwards.
    fn balance(mut self) -> Vec<Jump> {
        let mut jumps = Vec::new();
        let mut ends: Vec<usize> = (0..self.nodes.len()).filter(|node| self.nodes[*node].ways == 1).collect();
        while let Some(end) = ends.pop() {
            let Node { ways: 1, mixed: edge, charge, .. } = self.nodes[end] else { continue };
            let sides = self.faces.sides(edge);
            let [plus, minus] = [sides.plus, sides.minus].map(|face| self.node[face] as usize - 1);
            let (next, turns) = if plus == end { (minus, -charge) } else { (plus, charge) };
            if turns != 0 {
                jumps.push(Jump { edge, turns });
            }
            let node = &mut self.nodes[next];
            node.charge += charge;
            node.ways -= 1;
            node.mixed ^= edge;
            if node.ways == 1 {
                ends.push(next);
            }
        }
        jumps.sort_unstable_by_key(|jump| jump.edge);
        jumps
    }
}
