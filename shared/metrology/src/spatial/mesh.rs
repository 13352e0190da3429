//! A triangle mesh with queries for its nearest point and for the side of a point.

use super::bvh::{Aabb, Bvh};
use super::creases::{CREASE_COSINE, Creases};
use super::error::{MOST_TRIANGLES, MeshError};
use super::orient::orient;
use super::topology::{corner_names, edges};
use super::triangle::{Part, Triangle};
use nalgebra::{Point3, Vector3};

/// The nearest point of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// Nearest point of the mesh, mm.
    pub position: Point3<f64>,
    /// Signed distance of the queried point, mm; positive outside.
    pub signed_mm: f64,
    /// Unit normal of the triangle.
    pub normal: Vector3<f64>,
    /// Whether it lies on an edge where the mesh ends.
    pub at_border: bool,
}

/// Triangles with a tree, and pseudo-normals on edges and corners.
///
/// The sign of a distance whose foot lies on an edge or corner does not follow from any one of the triangles that meet
/// there. The sum of their normals, weighted by the angle of each, gives it for every closed mesh:
/// Bærentzen & Aanæs, Signed distance computation using the angle weighted pseudonormal, IEEE TVCG 11(3), 2005.
#[derive(Debug, Clone)]
pub struct TriangleMesh {
    triangles: Vec<Triangle>,
    tree: Bvh,
    /// For each corner of each triangle.
    corner_normals: Vec<[Vector3<f64>; 3]>,
    /// For each edge of each triangle.
    edge_normals: Vec<[Vector3<f64>; 3]>,
    /// Bit e: the mesh ends at edge e; bit 3 + c: at corner c.
    borders: Vec<u8>,
    without_area: usize,
    border_edges: usize,
    turned: usize,
    /// Triangle and its edge, once for each edge at which the surface turns sharply.
    creases: Vec<(u32, u8)>,
}

impl TriangleMesh {
    /// Builds a mesh of triangles, mm. Triangles without area are left out and counted. Triangles that do not face like their
    /// neighbours, and closed bodies that are inside out, are turned round and counted; of an open surface the corners have to
    /// run counter-clockwise when seen from outside.
    ///
    /// # Errors
    /// Corners that are not finite, no triangle with an area, more than [`MOST_TRIANGLES`], a surface with one side only.
    pub fn new(corners: &[[Point3<f64>; 3]]) -> Result<Self, MeshError> {
        let finite = |c: &[Point3<f64>; 3]| c.iter().all(|p| p.iter().all(|x| x.is_finite()));
        if let Some(triangle) = corners.iter().position(|c| !finite(c)) {
            return Err(MeshError::NotFinite { triangle });
        }
        if corners.len() > MOST_TRIANGLES {
            return Err(MeshError::TooLarge { given: corners.len() });
        }
        let mut corners = corners.to_vec();
        let turned = orient(&mut corners)?;
        let corners = &corners[..];
        let mut triangles = Vec::with_capacity(corners.len());
        let mut places = Vec::with_capacity(corners.len());
        for corners in corners {
            let triangle = Triangle::new(*corners);
            places.push(triangle.as_ref().map(|_| triangles.len() as u32));
            triangles.extend(triangle);
        }
        if triangles.is_empty() {
            return Err(MeshError::Empty { given: corners.len() });
        }
        let tree = Bvh::over(triangles.len(), 4, &|item| Aabb::of(&triangles[item as usize].corners));
        let mut mesh = Self {
            without_area: corners.len() - triangles.len(),
            tree,
            corner_normals: vec![[Vector3::zeros(); 3]; triangles.len()],
            edge_normals: vec![[Vector3::zeros(); 3]; triangles.len()],
            borders: vec![0; triangles.len()],
            border_edges: 0,
            turned,
            creases: Vec::new(),
            triangles,
        };
        mesh.join(&corner_names(corners), &places);
        Ok(mesh)
    }

    /// Triangles with an area.
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }

    /// The tree over their boxes.
    pub(super) fn tree(&self) -> &Bvh {
        &self.tree
    }

    /// Triangles left out since they have no area.
    pub fn without_area(&self) -> usize {
        self.without_area
    }

    /// Edges that belong to one triangle only; a closed surface has none.
    pub fn border_edges(&self) -> usize {
        self.border_edges
    }

    /// Triangles that were turned round, because they did not face like their neighbours or their body was inside out.
    pub fn turned(&self) -> usize {
        self.turned
    }

    /// Edges at which the surface turns by more than 20°.
    pub fn creases(&self) -> Creases {
        let ends = |(place, edge): &(u32, u8)| {
            let corners = &self.triangles[*place as usize].corners;
            [corners[*edge as usize], corners[(*edge as usize + 1) % 3]]
        };
        Creases::new(self.creases.iter().map(ends).collect())
    }

    /// Bounding box of the mesh, mm.
    pub fn bounds(&self) -> Aabb {
        self.tree.bounds().unwrap_or(Aabb::of(&[]))
    }

    /// The nearest point of the surface within a distance; of equally near triangles the first.
    pub fn nearest(&self, p: &Point3<f64>, limit_mm: f64) -> Option<Foot> {
        let mut best: Option<(f64, u32, Point3<f64>, Part)> = None;
        self.tree.around_point(p, limit_mm, |item, limit| {
            let (foot, part) = self.triangles[item as usize].nearest_part(p);
            let distance = (p - foot).norm();
            let better =
                |(d, i, ..): (f64, u32, Point3<f64>, Part)| distance < d || (distance == d && item < i);
            if distance <= limit && best.is_none_or(better) {
                best = Some((distance, item, foot, part));
            }
            limit.min(distance)
        });
        let (distance, item, position, part) = best?;
        let item = item as usize;
        let normal = self.triangles[item].normal;
        let (pseudo, bit) = match part {
            Part::Face => (normal, None),
            Part::Edge(edge) => (self.edge_normals[item][edge], Some(edge)),
            Part::Corner(corner) => (self.corner_normals[item][corner], Some(3 + corner)),
        };
        let outside = pseudo.dot(&(p - position)) >= 0.0;
        let at_border = bit.is_some_and(|bit| self.borders[item] & (1 << bit) != 0);
        Some(Foot { position, signed_mm: if outside { distance } else { -distance }, normal, at_border })
    }

    /// Sums the normals that meet at each corner and edge, and finds where the mesh ends.
    ///
    /// Triangles without area (`places` is `None`) have no normal, but they do join their neighbours: CAD systems close
    /// the gaps along T-shaped joints with them.
    fn join(&mut self, names: &[[u32; 3]], places: &[Option<u32>]) {
        let count = names.iter().flatten().max().map_or(0, |most| *most as usize + 1);
        let mut at_corner = vec![Vector3::zeros(); count];
        let mut border_corner = vec![false; count];
        let placed =
            || names.iter().zip(places).filter_map(|(names, place)| Some((names, (*place)? as usize)));
        for (names, place) in placed() {
            let triangle = &self.triangles[place];
            for corner in 0..3 {
                at_corner[names[corner] as usize] += triangle.normal * triangle.angle_rad(corner);
            }
        }
        for same in edges(names).chunk_by(|a, b| a.0 == b.0) {
            let owners = || {
                same.iter().filter_map(|(_, item, e)| Some((places[*item as usize]? as usize, *e as usize)))
            };
            let sum: Vector3<f64> = owners().map(|(place, _)| self.triangles[place].normal).sum();
            if let Some((place, edge)) = owners().next() {
                let first = self.triangles[place].normal;
                if owners().any(|(other, _)| self.triangles[other].normal.dot(&first) < CREASE_COSINE) {
                    self.creases.push((place as u32, edge as u8));
                }
            }
            for (place, edge) in owners() {
                self.edge_normals[place][edge] = sum;
                if same.len() == 1 {
                    self.borders[place] |= 1 << edge;
                    self.border_edges += 1;
                    same[0].0.iter().for_each(|end| border_corner[*end as usize] = true);
                }
            }
        }
        for (names, place) in placed() {
            self.corner_normals[place] = names.map(|name| at_corner[name as usize]);
            for (corner, _) in names.iter().enumerate().filter(|(_, name)| border_corner[**name as usize]) {
                self.borders[place] |= 8 << corner;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::synthetic::Noise;

    /// A box with edges of 2, 3 and 4 mm about the origin, as twelve triangles.
    fn cuboid() -> Vec<[Point3<f64>; 3]> {
        let corner = |i: usize| {
            let side = |bit: usize, half: f64| if i >> bit & 1 == 1 { half } else { -half };
            Point3::new(side(0, 1.0), side(1, 1.5), side(2, 2.0))
        };
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).map(|t| t.map(corner)).collect()
    }

    /// Exact signed distance from that box.
    fn from_cuboid(p: &Point3<f64>) -> f64 {
        let q = p.coords.abs() - Vector3::new(1.0, 1.5, 2.0);
        q.sup(&Vector3::zeros()).norm() + q.max().min(0.0)
    }

    #[test]
    fn the_signed_distance_of_a_box_is_exact_at_faces_edges_and_corners() {
        let mesh = TriangleMesh::new(&cuboid()).unwrap();
        assert_eq!(mesh.border_edges(), 0);
        let mut noise = Noise(3);
        for _ in 0..5000 {
            let p = Point3::from(Vector3::from_fn(|_, _| 8.0 * noise.unit() - 4.0));
            let foot = mesh.nearest(&p, f64::INFINITY).unwrap();
            let expected = from_cuboid(&p);
            assert!((foot.signed_mm - expected).abs() < 1e-12, "{p}: {} {expected}", foot.signed_mm);
            assert!(!foot.at_border);
        }
    }

    #[test]
    fn the_tree_finds_what_all_triangles_give() {
        let mut noise = Noise(11);
        let mut place = || Point3::from(Vector3::from_fn(|_, _| 10.0 * noise.unit()));
        let soup: Vec<[Point3<f64>; 3]> = (0..300).map(|_| [place(), place(), place()]).collect();
        let mesh = TriangleMesh::new(&soup).unwrap();
        for _ in 0..300 {
            let p = place();
            let brute =
                mesh.triangles().iter().map(|t| (p - t.nearest(&p)).norm()).fold(f64::INFINITY, f64::min);
            assert_eq!(mesh.nearest(&p, f64::INFINITY).unwrap().signed_mm.abs(), brute);
            assert_eq!(mesh.nearest(&p, 0.999 * brute), None);
        }
    }

    #[test]
    fn an_acute_corner_keeps_its_sign_where_one_triangle_would_err() {
        // A needle: just off the tip, the side faces look away from some points outside.
        let (tip, a, b, c) = (
            Point3::new(0.0, 0.0, 10.0),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(-0.5, 0.9, 0.0),
            Point3::new(-0.5, -0.9, 0.0),
        );
        let mesh = TriangleMesh::new(&[[a, b, tip], [b, c, tip], [c, a, tip], [a, c, b]]).unwrap();
        let mut noise = Noise(5);
        for _ in 0..500 {
            let p = tip + Vector3::new(noise.unit() - 0.5, noise.unit() - 0.5, 0.2 + noise.unit());
            assert!(mesh.nearest(&p, f64::INFINITY).unwrap().signed_mm > 0.0, "{p}");
        }
        assert!(mesh.nearest(&Point3::new(0.0, 0.0, 1.0), f64::INFINITY).unwrap().signed_mm < 0.0);
    }

    #[test]
    fn an_open_mesh_tells_its_border() {
        let [a, b, c, d] =
            [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0));
        let mesh = TriangleMesh::new(&[[a, b, c], [a, c, d], [a, a, b]]).unwrap();
        assert_eq!((mesh.border_edges(), mesh.without_area()), (4, 1));
        let at = |x: f64, y: f64| mesh.nearest(&Point3::new(x, y, -0.5), f64::INFINITY).unwrap();
        assert!(!at(0.5, 0.5).at_border && at(1.5, 0.5).at_border && at(-1.0, -1.0).at_border);
        assert_eq!(at(0.5, 0.5).signed_mm, -0.5);
    }

    #[test]
    fn what_is_no_surface_is_refused() {
        let p = Point3::origin();
        assert_eq!(TriangleMesh::new(&[]).unwrap_err(), MeshError::Empty { given: 0 });
        assert_eq!(TriangleMesh::new(&[[p; 3]]).unwrap_err(), MeshError::Empty { given: 1 });
        let nan = Point3::new(f64::NAN, 0.0, 0.0);
        assert_eq!(TriangleMesh::new(&[[p, nan, p]]).unwrap_err(), MeshError::NotFinite { triangle: 0 });
    }
}
