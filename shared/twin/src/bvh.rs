//! A bounding-volume tree over boxes: the order in which a ray or a point has to look at things.

use nalgebra::{Point3, Vector3};

/// Boxes per leaf: below this a plain loop is as fast as two more box tests.
const LEAF: usize = 4;

/// Deepest tree: halving 2³² things takes 32 levels, and a walk keeps one sibling per level.
const DEPTH: usize = 64;

/// An axis-parallel box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Lower corner, mm.
    pub low: Point3<f64>,
    /// Upper corner, mm.
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

    /// Middle, mm.
    pub fn centre(&self) -> Point3<f64> {
        nalgebra::center(&self.low, &self.high)
    }

    /// Distance of a point, mm; zero inside.
    pub fn distance_mm(&self, p: &Point3<f64>) -> f64 {
        let clamped = self.low.sup(&self.high.inf(p));
        (p - clamped).norm()
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

/// The tree.
#[derive(Debug, Clone, PartialEq)]
pub struct Bvh {
    nodes: Vec<Node>,
    items: Vec<u32>,
}

impl Bvh {
    /// Builds the tree by halving at the median of the widest axis. The same boxes give the same tree.
    pub fn new(boxes: &[Aabb]) -> Self {
        let mut tree =
            Self { nodes: Vec::with_capacity(boxes.len()), items: (0..boxes.len() as u32).collect() };
        if !boxes.is_empty() {
            tree.split(boxes, 0, boxes.len());
        }
        tree
    }

    fn split(&mut self, boxes: &[Aabb], first: usize, end: usize) {
        let items = &mut self.items[first..end];
        let centres: Vec<_> = items.iter().map(|i| boxes[*i as usize].centre()).collect();
        let extent = Aabb::of(&centres);
        let bounds = items
            .iter()
            .map(|i| boxes[*i as usize])
            .reduce(|a, b| a.join(&b))
            .unwrap_or(Aabb { low: Point3::origin(), high: Point3::origin() });
        let node = self.nodes.len();
        if items.len() <= LEAF {
            self.nodes.push(Node { bounds, link: first as u32, count: items.len() as u32 });
            return;
        }
        let axis = (extent.high - extent.low).imax();
        let middle = items.len() / 2;
        items.select_nth_unstable_by(middle, |a, b| {
            let key = |i: &u32| boxes[*i as usize].centre()[axis];
            // The number breaks ties, so that the tree does not depend on the selection's inner ways.
            key(a).total_cmp(&key(b)).then(a.cmp(b))
        });
        self.nodes.push(Node { bounds, link: 0, count: 0 });
        self.split(boxes, first, first + middle);
        self.nodes[node].link = self.nodes.len() as u32;
        self.split(boxes, first + middle, end);
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
        self.walk(limit_mm, |b, limit| b.entry(origin, &inverse, limit), &mut visit);
    }

    /// Walks the boxes nearer to a point than `limit_mm`, near ones first; `visit` as for rays.
    pub fn around_point(&self, p: &Point3<f64>, limit_mm: f64, mut visit: impl FnMut(u32, f64) -> f64) {
        let key = |b: &Aabb, limit: f64| Some(b.distance_mm(p)).filter(|d| *d <= limit);
        self.walk(limit_mm, key, &mut visit);
    }

    fn walk(
        &self,
        mut limit: f64,
        key: impl Fn(&Aabb, f64) -> Option<f64>,
        visit: &mut impl FnMut(u32, f64) -> f64,
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
                for item in &self.items[node.link as usize..(node.link + node.count) as usize] {
                    limit = visit(*item, limit);
                    if limit < 0.0 {
                        return;
                    }
                }
                continue;
            }
            let children = [index + 1, node.link];
            let mut keyed = children.map(|c| (c, key(&self.nodes[c as usize].bounds, limit)));
            // The nearer child is taken from the stack first.
            if let [(_, Some(a)), (_, Some(b))] = keyed
                && a <= b
            {
                keyed.swap(0, 1);
            }
            for (child, near) in keyed {
                if let Some(near) = near {
                    stack[height] = (child, near);
                    height += 1;
                }
            }
        }
    }
}
