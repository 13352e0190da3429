//! One face in its chart: borders as constraints, points where triangles are too far off, what lies inside.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::Point3;
use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};

use super::chart::Chart;
use super::shape::CadShape;

/// Rounds of refinement; each halves what is too long.
const ROUNDS: usize = 100;

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
    pub shape: &'a CadShape,
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
    for chart in Chart::candidates(domain.shape, domain.points) {
        let places: Vec<[f64; 2]> = domain.points.iter().map(|p| chart.place(p)).collect();
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
    let mut inner = Vec::new();
    if !matches!(domain.shape, CadShape::Plane { .. }) {
        refine(domain, chart, &mut net, &mut points, &mut inner)?;
    }
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

/// Puts points of the surface where triangles lie too far off it.
fn refine(
    domain: &Domain,
    chart: &Chart,
    net: &mut Net,
    points: &mut Vec<u32>,
    inner: &mut Vec<Point3<f64>>,
) -> Result<(), &'static str> {
    let count = domain.points.len() as u32;
    for _ in 0..ROUNDS {
        let place = |index: u32, inner: &[Point3<f64>]| match index.checked_sub(count) {
            Some(own) => inner[own as usize],
            None => domain.points[index as usize],
        };
        let inside = inside(net);
        // By the ends of the edge, so that two triangles on its sides ask for one point.
        let mut wanted: BTreeMap<[u32; 3], [f64; 2]> = BTreeMap::new();
        for face in net.inner_faces() {
            if !inside[face.fix().index()] {
                continue;
            }
            let names = face.vertices().map(|v| points[v.fix().index()]);
            let corners = names.map(|name| place(name, inner));
            if !is_off(domain, &corners) {
                continue;
            }
            let edges = face.adjacent_edges();
            let longest = (0..3)
                .filter(|e| !edges[*e].is_constraint_edge())
                .map(|e| {
                    let ends = [edges[e].from(), edges[e].to()].map(|v| points[v.fix().index()]);
                    let ends = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                    let flat = [edges[e].from(), edges[e].to()].map(|v| v.position());
                    (ends, ends.map(|name| place(name, inner)), flat)
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
                    let mut key = names;
                    key.sort_unstable();
                    let middle = face.center();
                    (key, [middle.x, middle.y])
                }
            };
            wanted.insert(key, at);
        }
        if wanted.is_empty() {
            return Ok(());
        }
        if net.num_inner_faces() + 2 * wanted.len() > domain.limit {
            return Err("it takes too many triangles");
        }
        for [x, y] in wanted.into_values() {
            let handle = net.insert(Point2::new(x, y)).map_err(|_| "it leaves the range of numbers")?;
            if handle.index() == points.len() {
                points.push(count + inner.len() as u32);
                inner.push(chart.lift([x, y]));
            }
        }
    }
    Err("its triangles do not come near enough to the surface")
}

/// Whether a triangle lies too far off its surface, or spans too much of its curvature.
fn is_off(domain: &Domain, corners: &[Point3<f64>; 3]) -> bool {
    let [a, b, c] = corners;
    let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let places = [middle, nalgebra::center(a, b), nalgebra::center(b, c), nalgebra::center(c, a)];
    let own = corners.iter().map(|p| domain.shape.distance_mm(p).abs()).fold(0.0, f64::max);
    let off = places.iter().map(|p| domain.shape.distance_mm(p).abs()).fold(0.0, f64::max);
    let [n, m, o] = corners.map(|p| domain.shape.normal_at(&p));
    let zero = |v: &nalgebra::Vector3<f64>| v.norm_squared() < 0.5;
    let bent = !(zero(&n) || zero(&m) || zero(&o))
        && (n.dot(&m) < BEND_COSINE || m.dot(&o) < BEND_COSINE || o.dot(&n) < BEND_COSINE);
    off > domain.chord_mm.max(1.01 * own) || bent
}
