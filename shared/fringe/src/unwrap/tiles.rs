//! The least spanning tree of a grid of pixels, decided tile by tile.
//!
//! Taking all edges by rising key, each that closes a loop left out, gives the tree (Kruskal 1956); as no two edges are equal (ties go
//! by number) there is only one. An edge that closes a loop within its tile closes it in the whole image, too. An edge that joins
//! two groups of a tile of which one does not touch the tile's border is the least of all that lead out of that group, so it
//! belongs to the tree whatever lies outside. What remains for the whole image are the edges between groups that touch
//! borders: a twentieth at most. So nearly all work is done within the cache, and each tile by itself.

use super::angle::Angles;
use super::edges::{Edge, Grid};
use super::forest::{Forest, Link};
use rayon::prelude::*;

/// Side of a tile, px: all that is kept for it fits the second-level cache, and its pixels have 16-bit numbers.
const TILE: usize = 64;
const PIXELS: usize = TILE * TILE;

/// Joins along the least spanning tree of the edges by key.
pub fn span(angles: &Angles<'_>, grid: &Grid<'_>, key: impl Fn(Edge) -> u32 + Sync) -> Forest {
    let mut forest = Forest::new(grid.valid.len());
    let strips = forest.pieces(grid.width * TILE).enumerate();
    let left: Vec<Vec<u64>> = strips
        .map_init(Scratch::default, |scratch, (strip, (links, size))| {
            let mut open = Vec::new();
            for left in (0..grid.width).step_by(TILE) {
                let tile = Tile::new(grid, left, strip * TILE);
                tile.solve(scratch, &key, &mut open);
                tile.keep(scratch, angles, links, size);
                tile.border_edges(&key, &mut open);
            }
            open
        })
        .collect();
    let mut open = left.concat();
    open.par_sort_unstable();
    for edge in open {
        let (a, b) = grid.edge(edge as u32);
        forest.join(a, b, angles.step(a, b));
    }
    forest
}

/// What the work on a tile needs; kept from one to the next.
#[derive(Default)]
struct Scratch {
    /// Keys above the tile's own numbers: 2 · pixel of the tile to the right, 2 · pixel + 1 downwards. Pixels are numbered with
    /// [`TILE`] a row in narrow tiles, too.
    edges: Vec<u64>,
    spare: Vec<u64>,
    groups: Groups,
    /// From each pixel of the tile, the neighbours that it is joined with for sure: bits [`RIGHT`] …, and [`SEEN`].
    ways: Ways,
    stack: Vec<u16>,
}

const RIGHT: u8 = 1;
const DOWN: u8 = 2;
const LEFT: u8 = 4;
const UP: u8 = 8;
const SEEN: u8 = 16;

struct Ways(Box<[u8; PIXELS]>);

impl Default for Ways {
    fn default() -> Self {
        Self(Box::new([0; PIXELS]))
    }
}

impl Ways {
    #[inline]
    fn at(&mut self, pixel: usize) -> &mut u8 {
        &mut self.0[pixel % PIXELS]
    }
}

/// Pixels of a tile that its own edges join: a union–find forest.
struct Groups {
    parent: Box<[u16; PIXELS]>,
    /// At a root, the number of pixels, and [`AT_BORDER`] where one of them lies at a border beyond which the image goes on.
    weight: Box<[u16; PIXELS]>,
}

const AT_BORDER: u16 = 1 << 15;

impl Default for Groups {
    fn default() -> Self {
        Self { parent: Box::new([0; PIXELS]), weight: Box::new([0; PIXELS]) }
    }
}

impl Groups {
    /// Root of a pixel's group; halves the path on its way. The remainders show the compiler that no index is out of bounds.
    #[inline]
    fn find(&mut self, pixel: usize) -> usize {
        let mut at = pixel;
        loop {
            let parent = usize::from(self.parent[at % PIXELS]);
            if parent == at {
                return at;
            }
            let above = self.parent[parent % PIXELS];
            self.parent[at % PIXELS] = above;
            at = usize::from(above);
        }
    }

    /// Whether both hang below one pixel: then they are one group, which saves the way to the root.
    #[inline]
    fn siblings(&self, a: usize, b: usize) -> bool {
        self.parent[a % PIXELS] == self.parent[b % PIXELS]
    }

    /// Joins the groups of two roots; returns whether both are at a border.
    #[inline]
    fn link(&mut self, a: usize, b: usize) -> bool {
        let (weight_a, weight_b) = (self.weight[a % PIXELS], self.weight[b % PIXELS]);
        let (low, high) = if weight_a >= weight_b { (a, b) } else { (b, a) };
        self.parent[high % PIXELS] = low as u16;
        let flag = (weight_a | weight_b) & AT_BORDER;
        self.weight[low % PIXELS] = ((weight_a & !AT_BORDER) + (weight_b & !AT_BORDER)) | flag;
        weight_a & weight_b & AT_BORDER != 0
    }
}

struct Tile<'a> {
    grid: &'a Grid<'a>,
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl<'a> Tile<'a> {
    fn new(grid: &'a Grid<'a>, left: usize, top: usize) -> Self {
        let (width, height) = (TILE.min(grid.width - left), TILE.min(grid.height - top));
        Self { grid, left, top, width, height }
    }

    /// The image's pixel of a column and row of the tile.
    #[inline]
    fn pixel(&self, x: usize, y: usize) -> usize {
        (self.top + y) * self.grid.width + self.left + x
    }

    /// Finds the joints that are certain, and returns the other edges that may belong to the tree, as [`Grid::edge`] numbers them.
    fn solve(&self, scratch: &mut Scratch, key: &impl Fn(Edge) -> u32, open: &mut Vec<u64>) {
        self.inner_edges(key, &mut scratch.edges);
        sort(&mut scratch.edges, &mut scratch.spare);
        self.begin(&mut scratch.groups);
        scratch.ways.0.fill(0);
        for edge in &scratch.edges {
            let number = *edge as u32;
            let a = number as usize / 2;
            let (b, way, back) =
                if number.is_multiple_of(2) { (a + 1, RIGHT, LEFT) } else { (a + TILE, DOWN, UP) };
            if scratch.groups.siblings(a, b) {
                continue;
            }
            let (root_a, root_b) = (scratch.groups.find(a), scratch.groups.find(b));
            if root_a == root_b {
                continue;
            }
            if scratch.groups.link(root_a, root_b) {
                let pixel = self.pixel(a % TILE, a / TILE) as u32;
                open.push(edge >> 32 << 32 | u64::from(2 * pixel + number % 2));
            } else {
                *scratch.ways.at(a) |= way;
                *scratch.ways.at(b) |= back;
            }
        }
    }

    /// Each pixel by itself.
    fn begin(&self, groups: &mut Groups) {
        groups.parent.iter_mut().zip(0..).for_each(|(parent, pixel)| *parent = pixel);
        let (on_right, below) =
            (self.left + self.width < self.grid.width, self.top + self.height < self.grid.height);
        for (y, row) in groups.weight.chunks_mut(TILE).take(self.height).enumerate() {
            let outer = (y == 0 && self.top > 0) || (y + 1 == self.height && below);
            row.fill(if outer { 1 | AT_BORDER } else { 1 });
            row[0] |= if self.left > 0 { AT_BORDER } else { 0 };
            row[self.width - 1] |= if on_right { AT_BORDER } else { 0 };
        }
    }

    fn inner_edges(&self, key: &impl Fn(Edge) -> u32, edges: &mut Vec<u64>) {
        edges.clear();
        let valid = self.grid.valid;
        for y in 0..self.height {
            let row = self.pixel(0, y);
            for x in (0..self.width).filter(|x| valid[row + x]) {
                let (pixel, number) = (row + x, 2 * (y * TILE + x) as u64);
                if x + 1 < self.width && valid[pixel + 1] {
                    edges.push(u64::from(key((pixel, pixel + 1))) << 32 | number);
                }
                let below = pixel + self.grid.width;
                if y + 1 < self.height && valid[below] {
                    edges.push(u64::from(key((pixel, below))) << 32 | (number + 1));
                }
            }
        }
    }

    /// Edges to the tiles right of and below this one.
    fn border_edges(&self, key: &impl Fn(Edge) -> u32, open: &mut Vec<u64>) {
        let mut push = |number: usize, edge: Edge| open.push(u64::from(key(edge)) << 32 | number as u64);
        for pixel in (0..self.height).map(|y| self.pixel(self.width - 1, y)) {
            if let Some(edge) = self.grid.right(pixel) {
                push(2 * pixel, edge);
            }
        }
        for pixel in (0..self.width).map(|x| self.pixel(x, self.height - 1)) {
            if let Some(edge) = self.grid.down(pixel) {
                push(2 * pixel + 1, edge);
            }
        }
    }

    /// Puts what is sure into the strip of the image's forest that the tile lies in: every pixel below the first of its group.
    fn keep(&self, scratch: &mut Scratch, angles: &Angles<'_>, links: &mut [Link], size: &mut [u32]) {
        let Scratch { ways, stack, .. } = scratch;
        let strip = self.top * self.grid.width;
        let place = |pixel: usize| self.pixel(pixel % TILE, pixel / TILE) - strip;
        for first in 0..TILE * self.height {
            if *ways.at(first) == 0 || *ways.at(first) & SEEN != 0 {
                continue;
            }
            let (root, mut pixels) = (place(first), 0);
            let parent = (strip + root) as u32;
            *ways.at(first) |= SEEN;
            stack.push(first as u16);
            while let Some(pixel) = stack.pop() {
                let pixel = usize::from(pixel);
                let at = place(pixel);
                pixels += 1;
                let open = *ways.at(pixel);
                let mut enter = |way: u8, neighbour: usize, place: usize| {
                    if open & way != 0 && *ways.at(neighbour) & SEEN == 0 {
                        *ways.at(neighbour) |= SEEN;
                        // Half a turn exactly goes the way that it goes from the first pixel of an edge to the second.
                        let turns = if place > at {
                            links[at].turns + angles.step(strip + at, strip + place)
                        } else {
                            links[at].turns - angles.step(strip + place, strip + at)
                        };
                        links[place] = Link { parent, turns };
                        stack.push(neighbour as u16);
                    }
                };
                enter(RIGHT, pixel + 1, at + 1);
                enter(DOWN, pixel + TILE, at + self.grid.width);
                enter(LEFT, pixel.wrapping_sub(1), at.wrapping_sub(1));
                enter(UP, pixel.wrapping_sub(TILE), at.wrapping_sub(self.grid.width));
            }
            size[root] = pixels;
        }
    }
}

/// Bits of a key that are looked at in one round.
const DIGIT_BITS: u32 = 11;
const DIGITS: usize = 1 << DIGIT_BITS;

/// Sorts by the upper 32 bits, digit by digit from the last; equal ones keep their order, which is that of their numbers.
fn sort(edges: &mut Vec<u64>, spare: &mut Vec<u64>) {
    let digit = |edge: u64, round: usize| (edge >> (32 + DIGIT_BITS * round as u32)) as usize % DIGITS;
    // A tile has at most 2 · 64² edges.
    let mut counts = [[0_u16; DIGITS]; 3];
    for edge in edges.iter() {
        for (round, counts) in counts.iter_mut().enumerate() {
            counts[digit(*edge, round)] += 1;
        }
    }
    spare.resize(edges.len(), 0);
    for (round, counts) in counts.iter_mut().enumerate() {
        if counts.iter().any(|count| *count as usize == edges.len()) {
            continue;
        }
        let mut start = 0;
        for count in counts.iter_mut() {
            (*count, start) = (start, start + *count);
        }
        for edge in edges.iter() {
            let place = &mut counts[digit(*edge, round)];
            spare[*place as usize] = *edge;
            *place += 1;
        }
        std::mem::swap(edges, spare);
    }
}
