//! A bounding-volume tree over boxes: the order in which a ray or a point has to look at things.

use nalgebra::{Point3, Vector3};
use std::ops::Range;

/// Boxes per leaf: below this a plain loop is as fast as two more box tests.
const LEAF: usize = 4;

/// Above this number of things both halves are built at once.
const PARALLEL: usize = 1 << 14;

/// Deepest tree: halving 2³² things takes 32 levels, and a walk keeps one sibling per level.
const DEPTH: usize = 64;

/// A box parallel to the axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Corner with the smallest coordinates, mm.
    pub low: Point3<f64>,
    /// Corner with the largest coordinates, mm.
    pub high: Point3<f64>,
}

impl Aabb {
    /// The box of some points.
    pub fn of(points: &[Point3<f64>]) -> Self {
        let empty = Self {
            low: Point3::from(Vector3::repeat(f64::INFINITY)),
            high: Point3::from(Vector3::repeat(f64::NEG_INFINITY)),
        };
        points.iter().fold(empty, |b, p| Self { low: b.low.inf(p), high: b.high.sup(p) })
    }

    /// The box of both.
    #[must_use]
    pub fn join(&self, other: &Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    /// Centre of the box, mm.
    pub fn centre(&self) -> Point3<f64> {
        nalgebra::center(&self.low, &self.high)
    }

    /// Distance of a point, mm; zero inside.
    pub fn distance_mm(&self, p: &Point3<f64>) -> f64 {
        let clamped = self.low.sup(&self.high.inf(p));
        (p - clamped).norm()
    }

    /// Whether both have a place in common.
    pub(crate) fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
    }

    /// Square of the distance of both, mm²; zero where they meet.
    #[inline]
    pub(crate) fn apart2_mm2(&self, other: &Self) -> f64 {
        let apart =
            |axis: usize| (self.low[axis] - other.high[axis]).max(other.low[axis] - self.high[axis]).max(0.0);
        let [x, y, z] = [apart(0), apart(1), apart(2)];
        x * x + y * y + z * z
    }

    /// First parameter of a ray inside the box, if it lies below `limit`.
    fn entry(&self, origin: &Point3<f64>, inverse: &Vector3<f64>, limit: f64) -> Option<f64> {
        let (mut near, mut far) = (0.0_f64, limit);
        for axis in 0..3 {
            let a = (self.low[axis] - origin[axis]) * inverse[axis];
            let b = (self.high[axis] - origin[axis]) * inverse[axis];
            // A ray that runs inside a face gives 0·∞ = NaN: this axis then bounds nothing.
            if a.is_nan() || b.is_nan() {
                continue;
            }
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        // One part in 10¹² against rounding: a box may be visited in vain, never missed.
        (near <= far * (1.0 + 1e-12) + 1e-12).then_some(near)
    }
}

#[derive(Debug, Clone, PartialEq)]
struct Node {
    bounds: Aabb,
    /// Leaf: first item; inner: right child (the left one follows directly).
    link: u32,
    /// Number of items; zero for an inner node.
    count: u32,
}

/// A thing while the tree is built.
#[derive(Clone, Copy)]
struct Entry {
    centre: Point3<f64>,
    item: u32,
}

/// A tree of bounding boxes.
#[derive(Debug, Clone, PartialEq)]
pub struct Bvh {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

impl Bvh {
    /// Builds the tree by halving at the median of the widest axis. The same boxes give the same tree.
    pub fn new(boxes: &[Aabb]) -> Self {
        Self::over(boxes.len(), LEAF, &|item| boxes[item as usize])
    }

    /// As [`Self::new`] for `count` things (below 2³²) with their boxes from a function, and up to `leaf` of them in a leaf.
    pub(crate) fn over(count: usize, leaf: usize, bounds: &(impl Fn(u32) -> Aabb + Sync)) -> Self {
        let mut entries: Vec<Entry> =
            (0..count as u32).map(|item| Entry { centre: bounds(item).centre(), item }).collect();
        let mut nodes = Vec::with_capacity(count.div_ceil(leaf) * 3);
        if !entries.is_empty() {
            grow(&mut entries, 0, leaf, bounds, &mut nodes);
        }
        Self { nodes, items: entries.into_iter().map(|e| e.item).collect() }
    }

    /// The things in the order of the leaves.
    pub(crate) fn items(&self) -> &[u32] {
        &self.items
    }

    /// Box of everything; `None` for an empty tree.
    pub fn bounds(&self) -> Option<Aabb> {
        self.nodes.first().map(|n| n.bounds)
    }

    /// Walks the boxes that a ray meets below `limit_mm`, near ones first.
    ///
    /// `visit(item, limit)` returns the new limit; a negative one ends the walk.
    pub fn along_ray(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        limit_mm: f64,
        mut visit: impl FnMut(u32, f64) -> f64,
    ) {
        let inverse = direction.map(|c| 1.0 / c);
        self.walk_items(limit_mm, |b, limit| b.entry(origin, &inverse, limit), &mut visit);
    }

    /// Walks the boxes nearer to a point than `limit_mm`, near ones first; `visit` as for rays.
    pub fn around_point(&self, p: &Point3<f64>, limit_mm: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        let key = |b: &Aabb, limit: f64| Some(b.distance_mm(p)).filter(|d| *d <= limit);
        self.walk_items(limit_mm, key, &mut visit);
    }

    fn walk_items(
        &self,
        limit: f64,
        key: impl Fn(&Aabb, f64) -> Option<f64>,
        visit: &mut impl FnMut(u32, f64) -> f64,
    ) {
        self.walk(limit, key, &mut |slots, mut limit| {
            for item in &self.items[slots] {
                limit = visit(*item, limit);
                if limit < 0.0 {
                    break;
                }
            }
            limit
        });
    }

    /// Walks the leaves whose boxes have a key, those with small keys first; `visit` gets places in [`Self::items`] and
    /// returns the new limit, a negative one to end.
    pub(crate) fn walk(
        &self,
        mut limit: f64,
        key: impl Fn(&Aabb, f64) -> Option<f64>,
        visit: &mut impl FnMut(Range<usize>, f64) -> f64,
    ) {
        let mut stack = [(0_u32, 0.0_f64); DEPTH];
        let mut height = 0;
        let Some(root) = self.nodes.first() else { return };
        if let Some(near) = key(&root.bounds, limit) {
            stack[0] = (0, near);
            height = 1;
        }
        while height > 0 {
            height -= 1;
            let (index, near) = stack[height];
            if near > limit {
                continue;
            }
            let node = &self.nodes[index as usize];
            if node.count > 0 {
                limit = visit(node.link as usize..(node.link + node.count) as usize, limit);
                if limit < 0.0 {
                    return;
                }
                continue;
            }
            let of = |child: u32| (child, key(&self.nodes[child as usize].bounds, limit));
            let (left, right) = (of(index + 1), of(node.link));
            // The nearer child is taken from the stack first.
            let left_first = matches!((left.1, right.1), (Some(a), Some(b)) if a <= b);
            for (child, near) in if left_first { [right, left] } else { [left, right] } {
                if let Some(near) = near {
                    stack[height] = (child, near);
                    height += 1;
                }
            }
        }
    }
}

/// Appends the tree of some things, whose places in the order of the leaves begin at `first`; returns their box.
fn grow(
    entries: &mut [Entry],
    first: usize,
    leaf: usize,
    bounds: &(impl Fn(u32) -> Aabb + Sync),
    nodes: &mut Vec<Node>,
) -> Aabb {
    if entries.len() <= leaf {
        let joined =
            entries.iter().map(|e| bounds(e.item)).reduce(|a, b| a.join(&b)).unwrap_or(Aabb::of(&[]));
        nodes.push(Node { bounds: joined, link: first as u32, count: entries.len() as u32 });
        return joined;
    }
    let middle = halve(entries);
    let node = nodes.len();
    nodes.push(Node { bounds: Aabb::of(&[]), link: 0, count: 0 });
    let parallel = entries.len() > PARALLEL;
    let (low, high) = entries.split_at_mut(middle);
    let (left, right) = if parallel {
        let sub = |part: &mut [Entry], first| {
            let mut nodes = Vec::new();
            let joined = grow(part, first, leaf, bounds, &mut nodes);
            (nodes, joined)
        };
        let (a, b) = rayon::join(|| sub(low, first), || sub(high, first + middle));
        append(nodes, &a.0);
        nodes[node].link = nodes.len() as u32;
        append(nodes, &b.0);
        (a.1, b.1)
    } else {
        let left = grow(low, first, leaf, bounds, nodes);
        nodes[node].link = nodes.len() as u32;
        (left, grow(high, first + middle, leaf, bounds, nodes))
    };
    nodes[node].bounds = left.join(&right);
    nodes[node].bounds
}

/// Puts the lower half along the widest axis first; returns its length.
fn halve(entries: &mut [Entry]) -> usize {
    let start = Aabb::of(&[]);
    let extent =
        entries.iter().fold(start, |b, e| Aabb { low: b.low.inf(&e.centre), high: b.high.sup(&e.centre) });
    let axis = (extent.high - extent.low).imax();
    let middle = entries.len() / 2;
    // The number breaks ties, so that the tree does not depend on the selection's inner ways.
    entries.select_nth_unstable_by(middle, |a, b| {
        a.centre[axis].total_cmp(&b.centre[axis]).then(a.item.cmp(&b.item))
    });
    middle
}

/// Appends a tree that was built apart.
fn append(nodes: &mut Vec<Node>, apart: &[Node]) {
    let base = nodes.len() as u32;
    nodes.extend(apart.iter().map(|node| {
        let link = if node.count == 0 { node.link + base } else { node.link };
        Node { link, ..node.clone() }
    }));
}
