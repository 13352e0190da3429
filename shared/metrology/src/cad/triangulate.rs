//! One face in its chart: borders as constraints, points where triangles are too far off, what lies inside.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::Point3;
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, PositionInTriangulation, Triangulation as _};

use super::chart::Chart;
use super::shape::{CadShape, Surface};

/// Rounds of refinement; each halves what is too long.
const ROUNDS: usize = 100;

/// Most comparisons of places with sides of a border.
const MOST_COMPARED: usize = 50_000_000;

/// Cosine between normals at the corners of a triangle.
const BEND_COSINE: f64 = 0.877;

/// A triangulated face: new points inside, and triangles that face along the surface's own normal.
pub(super) struct Patch {
    /// Points of the interior, in 3D.
    pub inner: Vec<Point3<f64>>,
    /// Triangles; numbers below the border's are its, the others those of `inner` after them.
    pub triangles: Vec<[u32; 3]>,
}

/// A face to be triangulated.
pub(super) struct Domain<'a> {
    /// The surface under it.
    pub surface: &'a Surface,
    /// All points of its borders, and single corners in it.
    pub points: &'a [Point3<f64>],
    /// Lines between them that bound it, the face on the left of each when its own normal is seen.
    pub sides: &'a [[u32; 2]],
    /// Largest distance of triangles from the surface, mm.
    pub chord_mm: f64,
    /// Most triangles of the face.
    pub limit: usize,
}

type Net = ConstrainedDelaunayTriangulation<Point2<f64>>;

/// Triangulates a face in the first chart that has it on the left of its border.
pub(super) fn patch(domain: &Domain) -> Result<Patch, &'static str> {
    let mut fault = "its border runs all around its surface in two ways";
    for chart in Chart::candidates(domain.surface, domain.points) {
        let places = chart.border(domain.points);
        let turned: f64 = domain
            .sides
            .iter()
            .map(|[a, b]| {
                let ([ax, ay], [bx, by]) = (places[*a as usize], places[*b as usize]);
                0.5 * (ax * by - bx * ay)
            })
            .sum();
        // Borders turn the other way round where the chart shows the surface from behind.
        if (turned > 0.0) != chart.positive {
            fault = "its border does not surround it";
            continue;
        }
        match in_chart(domain, &chart, &places) {
            Ok(patch) => return Ok(patch),
            Err(reason) => fault = reason,
        }
    }
    Err(fault)
}

fn in_chart(domain: &Domain, chart: &Chart, places: &[[f64; 2]]) -> Result<Patch, &'static str> {
    let mut net = Net::new();
    let mut handles: Vec<FixedVertexHandle> = Vec::with_capacity(places.len());
    // The point of each vertex, by the index of its handle.
    let mut points: Vec<u32> = Vec::new();
    for (index, [x, y]) in places.iter().enumerate() {
        let handle = net.insert(Point2::new(*x, *y)).map_err(|_| "its border leaves the range of numbers")?;
        if handle.index() < points.len() {
            return Err("two corners of its border are one");
        }
        points.push(index as u32);
        handles.push(handle);
    }
    for [a, b] in domain.sides {
        let ends = [*a, *b].map(|i| handles[i as usize]);
        if !net.can_add_constraint(ends[0], ends[1]) {
            return Err("its border meets itself");
        }
        net.add_constraint(ends[0], ends[1]);
    }
    let mut growing = Growing { domain, chart, net, points, inner: Vec::new() };
    if let Some(sheet) = chart.sheet() {
        growing.give(nodes_inside(&growing.net, domain, places, sheet.nodes()))?;
    }
    if !matches!(domain.surface, Surface::Element(CadShape::Plane { .. })) {
        growing.refine()?;
    }
    let Growing { net, points, inner, .. } = growing;
    let inside = inside(&net);
    let mut triangles = Vec::new();
    for face in net.inner_faces() {
        if inside[face.fix().index()] {
            let triangle = face.vertices().map(|v| points[v.fix().index()]);
            triangles.push(if chart.positive { triangle } else { [triangle[0], triangle[2], triangle[1]] });
        }
    }
    Ok(Patch { inner, triangles })
}

/// Which triangles lie inside: an odd number of borders away from the outside.
fn inside(net: &Net) -> Vec<bool> {
    let mut known: Vec<Option<bool>> = vec![None; net.num_all_faces()];
    let outer = net.outer_face().fix().index();
    known[outer] = Some(false);
    let mut open = VecDeque::new();
    for edge in net.directed_edges() {
        if edge.face().is_outer() {
            open.push_back((edge.rev().fix(), edge.is_constraint_edge()));
        }
    }
    while let Some((edge, within)) = open.pop_front() {
        let edge = net.directed_edge(edge);
        let face = edge.face().fix().index();
        if known[face].is_some() {
            continue;
        }
        known[face] = Some(within);
        for next in [edge, edge.next(), edge.prev()] {
            let beyond = next.rev();
            if known[beyond.face().fix().index()].is_none() {
                open.push_back((beyond.fix(), within != next.is_constraint_edge()));
            }
        }
    }
    known.into_iter().map(|k| k == Some(true)).collect()
}

/// Places inside of a face that are not near to its border: a quarter of the way to the next of them.
fn nodes_inside(net: &Net, domain: &Domain, border: &[[f64; 2]], nodes: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let inside = inside(net);
    let is_in = |[x, y]: &[f64; 2]| match net.locate(Point2::new(*x, *y)) {
        PositionInTriangulation::OnFace(face) => inside[face.index()],
        _ => false,
    };
    let mut nodes: Vec<[f64; 2]> = nodes.into_iter().filter(is_in).collect();
    // Every place is held against every side of the border: fewer places for long ones.
    let most = (MOST_COMPARED / domain.sides.len().max(1)).max(1);
    nodes = nodes.iter().copied().step_by(nodes.len().div_ceil(most).max(1)).collect();
    let [low, high] = nodes.iter().fold([[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]], |[low, high], p| {
        [[low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]]
    });
    let apart = ((high[0] - low[0]) * (high[1] - low[1]) / nodes.len().max(1) as f64).sqrt();
    let is_far = |node: &[f64; 2]| {
        let near = |[a, b]: &[u32; 2]| {
            square_to_side(node, &border[*a as usize], &border[*b as usize]) < 0.0625 * apart * apart
        };
        !domain.sides.iter().any(near)
    };
    nodes.retain(is_far);
    nodes
}

/// Square of the distance of a place from a side.
fn square_to_side(place: &[f64; 2], a: &[f64; 2], b: &[f64; 2]) -> f64 {
    let (side, arm) = ([b[0] - a[0], b[1] - a[1]], [place[0] - a[0], place[1] - a[1]]);
    let length = side[0] * side[0] + side[1] * side[1];
    let share =
        if length > 0.0 { ((arm[0] * side[0] + arm[1] * side[1]) / length).clamp(0.0, 1.0) } else { 0.0 };
    let off = [arm[0] - share * side[0], arm[1] - share * side[1]];
    off[0] * off[0] + off[1] * off[1]
}

/// A triangulation that gains points.
struct Growing<'a> {
    domain: &'a Domain<'a>,
    chart: &'a Chart,
    net: Net,
    /// The point of each vertex, by the index of its handle.
    points: Vec<u32>,
    inner: Vec<Point3<f64>>,
}

/// A place to be given a point, by what asks for it: the ends of an edge, so that two triangles on its sides ask for one point.
type Wanted = BTreeMap<[u32; 3], [f64; 2]>;

impl Growing<'_> {
    /// Puts points of the surface at places of the chart.
    fn give(&mut self, places: impl IntoIterator<Item = [f64; 2]>) -> Result<(), &'static str> {
        for [x, y] in places {
            let handle = self.net.insert(Point2::new(x, y)).map_err(|_| "it leaves the range of numbers")?;
            if handle.index() == self.points.len() {
                self.points.push((self.domain.points.len() + self.inner.len()) as u32);
                self.inner.push(self.chart.lift([x, y]));
            }
        }
        Ok(())
    }

    fn place(&self, index: u32) -> Point3<f64> {
        match (index as usize).checked_sub(self.domain.points.len()) {
            Some(own) => self.inner[own],
            None => self.domain.points[index as usize],
        }
    }

    /// Puts points of the surface where triangles lie too far off it.
    fn refine(&mut self) -> Result<(), &'static str> {
        // Triangles that were found near enough, by their corners.
        let mut near: BTreeSet<[u32; 3]> = BTreeSet::new();
        for _ in 0..ROUNDS {
            let wanted = self.wanted(&mut near);
            if wanted.is_empty() {
                return Ok(());
            }
            if self.net.num_inner_faces() + 2 * wanted.len() > self.domain.limit {
                return Err("it takes too many triangles");
            }
            self.give(wanted.into_values())?;
        }
        Err("its triangles do not come near enough to the surface")
    }

    /// Where points are missing.
    fn wanted(&self, near: &mut BTreeSet<[u32; 3]>) -> Wanted {
        let inside = inside(&self.net);
        let mut wanted = Wanted::new();
        for face in self.net.inner_faces() {
            if !inside[face.fix().index()] {
                continue;
            }
            let names = face.vertices().map(|v| self.points[v.fix().index()]);
            let mut key = names;
            key.sort_unstable();
            if near.contains(&key) {
                continue;
            }
            let corners = names.map(|name| self.place(name));
            let flat = face.vertices().map(|v| [v.position().x, v.position().y]);
            // Between corners of a straight border there is nothing to divide.
            if is_thin(&flat) {
                continue;
            }
            let edges = face.adjacent_edges();
            let fixed = [0, 1, 2].map(|i| {
                let starts_here = edges.iter().find(|e| self.points[e.from().fix().index()] == names[i]);
                starts_here.is_some_and(|edge| edge.is_constraint_edge())
            });
            if !self.is_off(&flat, &corners, fixed) {
                near.insert(key);
                continue;
            }
            let longest = (0..3)
                .filter(|e| !edges[*e].is_constraint_edge())
                .filter(|e| {
                    let beyond = edges[*e].rev().face().as_inner();
                    beyond.is_none_or(|f| !is_thin(&f.vertices().map(|v| [v.position().x, v.position().y])))
                })
                .map(|e| {
                    let ends = [edges[e].from(), edges[e].to()].map(|v| self.points[v.fix().index()]);
                    let ends = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                    let flat = [edges[e].from(), edges[e].to()].map(|v| v.position());
                    (ends, ends.map(|name| self.place(name)), flat)
                })
                .max_by(|a, b| (a.1[1] - a.1[0]).norm().total_cmp(&(b.1[1] - b.1[0]).norm()));
            let size = |[a, b]: [Point3<f64>; 2]| (b - a).norm();
            let [a, b, c] = corners;
            let whole = size([a, b]).max(size([b, c])).max(size([c, a]));
            let (key, at) = match longest {
                Some((ends, places, [p, q])) if size(places) > 0.6 * whole => {
                    ([ends[0], ends[1], u32::MAX], [0.5 * (p.x + q.x), 0.5 * (p.y + q.y)])
                }
                _ => {
                    let middle = face.center();
                    (key, [middle.x, middle.y])
                }
            };
            wanted.insert(key, at);
        }
        wanted
    }

    fn is_off(&self, flat: &[[f64; 2]; 3], corners: &[Point3<f64>; 3], fixed: [bool; 3]) -> bool {
        match (self.domain.surface, self.chart.sheet()) {
            (_, Some(sheet)) => sheet.is_off(flat, corners, fixed, self.domain.chord_mm),
            (Surface::Element(shape), None) => is_off(shape, corners, fixed, self.domain.chord_mm),
            (Surface::Free(_), None) => false,
        }
    }
}

/// Whether a triangle of a chart has hardly any height: a point put into it could come to lie on the border.
fn is_thin([a, b, c]: &[[f64; 2]; 3]) -> bool {
    let side = |a: &[f64; 2], b: &[f64; 2]| [b[0] - a[0], b[1] - a[1]];
    let square = |s: [f64; 2]| s[0] * s[0] + s[1] * s[1];
    let (ab, ac) = (side(a, b), side(a, c));
    let longest = square(ab).max(square(ac)).max(square(side(b, c)));
    (ab[0] * ac[1] - ab[1] * ac[0]).abs() < 1e-9 * longest
}

/// Whether a triangle lies too far off its surface, or spans too much of its curvature. Sides that are fixed (from each corner to the next) are edges
/// of the solid: no more can be asked for than what they leave.
fn is_off(shape: &CadShape, corners: &[Point3<f64>; 3], fixed: [bool; 3], chord_mm: f64) -> bool {
    let [a, b, c] = corners;
    let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let places = [middle, nalgebra::center(a, b), nalgebra::center(b, c), nalgebra::center(c, a)];
    let of_sides = (0..3).filter(|i| fixed[*i]).map(|i| places[i + 1]);
    let own =
        corners.iter().copied().chain(of_sides).map(|p| shape.distance_mm(&p).abs()).fold(0.0, f64::max);
    let off = places.iter().map(|p| shape.distance_mm(p).abs()).fold(0.0, f64::max);
    let [n, m, o] = corners.map(|p| shape.normal_at(&p));
    let zero = |v: &nalgebra::Vector3<f64>| v.norm_squared() < 0.5;
    let bent = !(zero(&n) || zero(&m) || zero(&o))
        && (n.dot(&m) < BEND_COSINE || m.dot(&o) < BEND_COSINE || o.dot(&n) < BEND_COSINE);
    off > chord_mm.max(1.01 * own) || bent
}
