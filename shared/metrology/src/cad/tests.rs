//! Solids made by hand against closed forms, and what must be refused.

use super::*;
use crate::inspection::Geometry;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use std::f64::consts::PI;

pub(super) const LIMIT: usize = 2_000_000;

pub(super) fn circle(z: f64, radius: f64) -> Curve {
    Curve::Ellipse(Frame { origin: Point3::new(0.0, 0.0, z), axes: Matrix3::identity() }, [radius; 2])
}

pub(super) fn face(id: u64, shape: CadShape, outward: bool, bounds: Vec<Bound>) -> BrepFace {
    BrepFace { id, name: format!("f{id}"), surface: shape.into(), outward, bounds }
}

pub(super) fn level(z: f64) -> CadShape {
    CadShape::Plane { point_mm: Point3::new(0.0, 0.0, z), normal: Vector3::z() }
}

fn wall(radius_mm: f64) -> CadShape {
    CadShape::Cylinder { point_mm: Point3::new(0.0, 0.0, 3.0), axis: Vector3::z(), radius_mm }
}

/// Corners and edges of half a torus: circles of 8 mm at both its rims, 2 mm above and below its middle.
pub(super) fn rims() -> Brep {
    let rim = |z: f64, end: usize| BrepEdge {
        id: 1 + end as u64,
        curve: circle(z, 8.0),
        ends: [end; 2],
        along: true,
    };
    Brep {
        vertices: vec![Point3::new(8.0, 0.0, -2.0), Point3::new(8.0, 0.0, 2.0)],
        edges: vec![rim(-2.0, 0), rim(2.0, 1)],
        ..Brep::default()
    }
}

/// A tube about z of height 10: radii 6 and 4, four closed edges without seams.
pub(super) fn tube() -> Brep {
    let edge =
        |id, z, radius: f64, end| BrepEdge { id, curve: circle(z, radius), ends: [end; 2], along: true };
    let around = |edge, forward| Bound::Loop(vec![(edge, forward)]);
    Brep {
        vertices: [[6.0, 0.0, 0.0], [6.0, 0.0, 10.0], [4.0, 0.0, 0.0], [4.0, 0.0, 10.0]]
            .map(Point3::from)
            .to_vec(),
        edges: vec![edge(1, 0.0, 6.0, 0), edge(2, 10.0, 6.0, 1), edge(3, 0.0, 4.0, 2), edge(4, 10.0, 4.0, 3)],
        faces: vec![
            face(11, level(0.0), false, vec![around(0, false), around(2, true)]),
            face(12, level(10.0), true, vec![around(1, true), around(3, false)]),
            face(13, wall(6.0), true, vec![around(0, true), around(1, false)]),
            face(14, wall(4.0), false, vec![around(2, false), around(3, true)]),
        ],
    }
}

#[test]
fn a_tube_is_closed_has_its_volume_and_its_elements() {
    let brep = tube();
    for chord_mm in [0.1, 0.01, 0.001] {
        let mesh = brep.mesh(chord_mm, LIMIT).unwrap();
        let off = (mesh.volume_mm3() - PI * 20.0 * 10.0).abs();
        // A wall that is off by a chord at most.
        assert!(off < 2.0 * PI * 10.0 * 10.0 * chord_mm, "{chord_mm}: {off}");
        for (triangle, face) in mesh.triangles.iter().zip(&mesh.face_of) {
            let [a, b, c] = triangle.map(|corner| mesh.corners[corner as usize].coords);
            let middle = Point3::from((a + b + c) / 3.0);
            assert!(
                brep.faces[*face as usize].surface.element().unwrap().distance_mm(&middle).abs() <= chord_mm
            );
        }
    }
    let place = Isometry3::translation(100.0, 0.0, 0.0);
    let mesh = brep.mesh(0.01, LIMIT).unwrap().moved(&place);
    let found = features(&brep, &place, &mesh);
    let faces: Vec<&[u64]> = found.iter().map(|f| f.faces.as_slice()).collect();
    assert_eq!(faces, [[11], [12], [13], [14]]);
    let Geometry::Plane { normal, point_mm, half_size_mm, exclusions, .. } = &found[0].geometry else {
        panic!("{found:?}")
    };
    assert!(
        (point_mm - Point3::new(100.0, 0.0, 0.0)).norm() < 0.05 && (normal + Vector3::z()).norm() < 1e-12
    );
    assert!(half_size_mm.iter().all(|h| (h - 6.0).abs() < 0.05) && exclusions.len() == 1);
    for (index, radius, inside) in [(2, 6.0, false), (3, 4.0, true)] {
        let Geometry::Cylinder { point_mm, radius_mm, half_length_mm, internal, sector, .. } =
            &found[index].geometry
        else {
            panic!("{found:?}")
        };
        assert!((point_mm - Point3::new(100.0, 0.0, 5.0)).norm() < 1e-9);
        assert_eq!((*radius_mm, *internal, *sector), (radius, inside, None));
        assert!((half_length_mm - 5.0).abs() < 1e-9);
        assert!((found[index].area_mm2 - 2.0 * PI * radius * 10.0).abs() < 0.5);
    }
}

#[test]
fn a_gap_a_turned_face_and_an_edge_beside_its_curve_are_refused() {
    let mut open = tube();
    open.faces.remove(1);
    assert!(matches!(open.mesh(0.1, LIMIT), Err(BrepError::Open { .. })));
    let mut turned = tube();
    turned.faces[2].outward = false;
    assert!(matches!(turned.mesh(0.1, LIMIT), Err(BrepError::Face { face: 13, .. })));
    let mut off = tube();
    off.vertices[1].x = 6.5;
    assert!(matches!(off.mesh(0.1, LIMIT), Err(BrepError::Edge { edge: 2, .. })));
    assert!(tube().mesh(1e-5, 1000).is_err());
    let mut inside_out = tube();
    for face in &mut inside_out.faces {
        face.outward = !face.outward;
        for bound in &mut face.bounds {
            if let Bound::Loop(edges) = bound {
                for edge in edges {
                    edge.1 = !edge.1;
                }
            }
        }
    }
    assert!(matches!(inside_out.mesh(0.1, LIMIT), Err(BrepError::InsideOut { .. })));
}

/// A cone with its tip, a half and a whole sphere, a whole torus and its outer half.
#[test]
fn round_solids_have_the_volumes_of_closed_forms() {
    let base = |id| face(id, level(0.0), false, vec![Bound::Loop(vec![(0, false)])]);
    let rim = |radius: f64| BrepEdge { id: 1, curve: circle(0.0, radius), ends: [0; 2], along: true };
    let around = || Bound::Loop(vec![(0, true)]);
    let at = |x: f64, z: f64| Point3::new(x, 0.0, z);
    let down = CadShape::Cone {
        point_mm: at(0.0, 0.0),
        axis: -Vector3::z(),
        radius_mm: 5.0,
        half_angle_rad: fringe::math::atan2(5.0, 12.0),
    };
    let ball = CadShape::Sphere { center_mm: at(0.0, 0.0), radius_mm: 5.0 };
    let ring = CadShape::Torus {
        center_mm: at(0.0, 0.0),
        axis: Vector3::z(),
        ring_radius_mm: 8.0,
        tube_radius_mm: 2.0,
    };
    let tip = Brep {
        vertices: vec![at(5.0, 0.0), at(0.0, 12.0)],
        edges: vec![rim(5.0)],
        faces: vec![base(1), face(2, down, true, vec![around(), Bound::Corner(1)])],
    };
    let half = Brep {
        vertices: vec![at(5.0, 0.0)],
        edges: vec![rim(5.0)],
        faces: vec![base(1), face(2, ball, true, vec![around()])],
    };
    let whole = |shape| Brep { faces: vec![face(1, shape, true, vec![])], ..Brep::default() };
    let outer = Brep {
        faces: vec![
            face(1, level(-2.0), false, vec![Bound::Loop(vec![(0, false)])]),
            face(2, level(2.0), true, vec![Bound::Loop(vec![(1, true)])]),
            face(3, ring, true, vec![Bound::Loop(vec![(0, true)]), Bound::Loop(vec![(1, false)])]),
        ],
        ..rims()
    };
    let half_torus = PI * 4.0 * 0.5 * 2.0 * PI * (8.0 + 4.0 * 2.0 / (3.0 * PI)) + PI * 64.0 * 4.0;
    for (brep, volume, kind) in [
        (tip, PI * 25.0 * 12.0 / 3.0, "cone"),
        (half, PI * 125.0 * 2.0 / 3.0, "sphere"),
        (whole(ball), PI * 125.0 * 4.0 / 3.0, "sphere"),
        (whole(ring), 2.0 * PI * PI * 8.0 * 4.0, "torus"),
        (outer, half_torus, "torus"),
    ] {
        for chord_mm in [0.1, 0.005] {
            let mesh = brep.mesh(chord_mm, LIMIT).unwrap_or_else(|error| panic!("{kind}: {error}"));
            let area: f64 = features(&brep, &Isometry3::identity(), &mesh).iter().map(|f| f.area_mm2).sum();
            let off = mesh.volume_mm3() - volume;
            assert!(off.abs() < area * chord_mm, "{kind} {chord_mm}: {} {volume}", mesh.volume_mm3());
        }
        let mesh = brep.mesh(0.02, LIMIT).unwrap();
        let found = features(&brep, &Isometry3::identity(), &mesh);
        assert!(found.iter().any(|f| f.geometry.kind() == kind), "{found:?}");
    }
}

/// Distances and normals of each surface against differences along many rays.
#[test]
fn distances_are_those_along_the_normals() {
    let axis = Vector3::new(0.3, -0.5, 0.8).normalize();
    let at = Point3::new(1.0, 2.0, -3.0);
    let shapes = [
        CadShape::Plane { point_mm: at, normal: axis },
        CadShape::Cylinder { point_mm: at, axis, radius_mm: 4.0 },
        CadShape::Cone { point_mm: at, axis, radius_mm: 4.0, half_angle_rad: 0.4 },
        CadShape::Sphere { center_mm: at, radius_mm: 5.0 },
        CadShape::Torus { center_mm: at, axis, ring_radius_mm: 7.0, tube_radius_mm: 2.0 },
    ];
    for (i, shape) in shapes.iter().enumerate() {
        for k in 0..20 {
            let p = Point3::new(f64::from(k) - 6.0, 9.0 - 0.7 * f64::from(k), 0.3 * f64::from(k));
            let (distance, normal) = (shape.distance_mm(&p), shape.normal_at(&p));
            assert!((normal.norm() - 1.0).abs() < 1e-12);
            assert!(shape.distance_mm(&shape.foot(&p).unwrap()).abs() < 1e-9, "{shape:?} {p}");
            let ahead = shape.distance_mm(&(p + normal * 1e-3));
            assert!((ahead - distance - 1e-3).abs() < 1e-9, "{shape:?} {p}");
        }
        for (j, other) in shapes.iter().enumerate() {
            assert_eq!(shape.is_same(other, 1e-4, 100.0), i == j);
        }
    }
}

/// Each chart leads back to where it came from, and shows its surface from the side that it says.
#[test]
fn charts_lead_back_and_know_their_side() {
    let at = Point3::new(1.0, 2.0, -3.0);
    let axis = Vector3::new(0.3, -0.5, 0.8).normalize();
    let [x, y] = crate::fit::tangents(&axis);
    let border: Vec<Point3<f64>> = (0..6)
        .map(|k| {
            let (sin, cos) = fringe::math::sincos(0.2 * f64::from(k));
            at + (x * cos + y * sin) * 9.0 + axis * (1.0 + 0.1 * f64::from(k))
        })
        .collect();
    for shape in [
        CadShape::Plane { point_mm: at, normal: axis },
        CadShape::Cylinder { point_mm: at, axis, radius_mm: 9.0 },
        CadShape::Cone { point_mm: at, axis, radius_mm: 8.0, half_angle_rad: 0.4 },
        CadShape::Sphere { center_mm: at, radius_mm: 9.0 },
        CadShape::Torus { center_mm: at, axis, ring_radius_mm: 7.0, tube_radius_mm: 2.0 },
    ] {
        let border: Vec<Point3<f64>> = border.iter().filter_map(|p| shape.foot(p)).collect();
        for chart in chart::Chart::candidates(&shape.into(), &border) {
            for p in &border {
                let [x, y] = chart.place(p);
                assert!((chart.lift([x, y]) - p).norm() < 1e-9, "{shape:?} {chart:?}");
                let step = 1e-6 * (x * x + y * y).sqrt().max(1e-3);
                let [a, b] = [[x + step, y], [x, y + step]].map(|place| chart.lift(place) - p);
                let seen = a.cross(&b).dot(&shape.normal_at(p));
                assert_eq!(seen > 0.0, chart.positive, "{shape:?} {chart:?}");
            }
        }
    }
}

/// A circle as a rational spline: every point lies on it.
#[test]
fn a_rational_spline_is_the_circle_it_stands_for() {
    let half = 0.5_f64.sqrt();
    let poles = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
        .map(|[x, y]| Point3::new(7.0 * f64::from(x), 7.0 * f64::from(y), 1.0));
    let spline = Spline {
        knots: Knots { degree: 2, values: vec![0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0] },
        poles: poles.to_vec(),
        weights: vec![1.0, half, 1.0, half, 1.0, half, 1.0, half, 1.0],
    };
    assert_eq!(spline.fault(), None);
    for k in 0..=100 {
        let p = spline.at(0.04 * f64::from(k));
        assert!((fringe::math::hypot(p.x, p.y) - 7.0).abs() < 1e-12 && (p.z - 1.0).abs() < 1e-12, "{k}");
    }
    let ends = [spline.at(0.5), spline.at(2.5)];
    let points = Curve::Spline(spline).between(1, ends, false, true, [0.01, 1.0]).unwrap();
    assert!(points.len() > 10);
    let mut all = vec![ends[0]];
    all.extend(points);
    all.push(ends[1]);
    for pair in all.windows(2) {
        let middle = nalgebra::center(&pair[0], &pair[1]);
        assert!((fringe::math::hypot(middle.x, middle.y) - 7.0).abs() < 0.01);
        assert!((pair[0] - Point3::origin()).cross(&(pair[1] - pair[0])).z > 0.0, "turns back");
    }
}

/// Proves: a surface within itself, which closes like any other, is told from a solid by how often it goes round a place.
#[test]
fn a_surface_that_passes_through_itself_is_found() {
    let corner = |k: usize| [k & 1, (k >> 1) & 1, (k >> 2) & 1].map(|bit| bit as f64);
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut mesh = CadMesh::default();
    for (size, first) in [(10.0, 0_u32), (4.0, 8)] {
        mesh.corners.extend((0..8).map(|k| Point3::from(corner(k).map(|c| size * (c - 0.5)))));
        for side in sides {
            let face = mesh.face_of.last().map_or(0, |face| face + 1);
            let [a, b, c, d] = side.map(|k| first + k);
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
            mesh.face_of.extend([face; 2]);
        }
        let found = super::enclosed::folded(&mesh);
        assert_eq!(found, (first > 0).then_some(6), "{size}");
    }
}
