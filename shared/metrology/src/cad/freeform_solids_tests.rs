//! Solids with free forms as walls: closed ones, poles, extrusions and offsets, against closed forms.

use super::freeform_tests::{free, lofted, round, straight};
use super::tests::{LIMIT, circle, face, level, rims, tube};
use super::*;
use fringe::math;
use nalgebra::{Matrix3, Point3, Vector3};
use std::f64::consts::PI;

/// Volume within what the distance allows, and an area that no fold adds to.
fn check(brep: &Brep, volume: f64, area: f64, what: &str) {
    for chord_mm in [0.05, 0.01] {
        let mesh =
            brep.mesh(chord_mm, LIMIT).unwrap_or_else(|error| panic!("{what}, {chord_mm} mm: {error}"));
        let off = mesh.volume_mm3() - volume;
        assert!(
            off.abs() < area * chord_mm,
            "{what}, {chord_mm} mm: {} instead of {volume}",
            mesh.volume_mm3()
        );
        let found: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|corner| mesh.corners[corner as usize]);
                0.5 * (b - a).cross(&(c - a)).norm()
            })
            .sum();
        assert!((found / area - 1.0).abs() < 0.02, "{what}, {chord_mm} mm: area {found} instead of {area}");
    }
}

/// The tube of the tests of elements, its walls as splines that close: without a seam, with one, and in two halves across it.
#[test]
fn walls_that_close_need_no_seam_and_may_have_one() {
    let wall = |radius: f64| {
        let line = |z: f64| round(Point3::new(0.0, 0.0, z), Vector3::x() * radius, Vector3::y() * radius);
        lofted(&[line(0.0), line(10.0)], straight(), &[1.0; 2])
    };
    let (volume, area) = (PI * 20.0 * 10.0, 2.0 * PI * 20.0 + 2.0 * PI * 10.0 * 10.0);
    let mut brep = tube();
    brep.faces[2].surface = Surface::Free(Box::new(wall(6.0)));
    brep.faces[3].surface = Surface::Free(Box::new(wall(4.0)));
    check(&brep, volume, area, "without seams");
    assert_eq!(free_faces(&brep, &brep.mesh(0.1, LIMIT).unwrap()).len(), 2);
    let mut seam = brep.clone();
    seam.edges.push(BrepEdge { id: 9, curve: Curve::Line, ends: [0, 1], along: true });
    seam.faces[2].bounds = vec![Bound::Loop(vec![(0, true), (4, true), (1, false), (4, false)])];
    check(&seam, volume, area, "with a seam");
    // Two halves, of which one lies across the place where the spline begins.
    let mut halves = brep;
    halves.vertices = [
        [0.0, 6.0, 0.0],
        [0.0, 6.0, 10.0],
        [4.0, 0.0, 0.0],
        [4.0, 0.0, 10.0],
        [0.0, -6.0, 0.0],
        [0.0, -6.0, 10.0],
    ]
    .map(Point3::from)
    .to_vec();
    let arc = |id, z, ends| BrepEdge { id, curve: circle(z, 6.0), ends, along: true };
    halves.edges[0] = arc(1, 0.0, [0, 4]);
    halves.edges[1] = arc(2, 10.0, [1, 5]);
    halves.edges.push(arc(5, 0.0, [4, 0]));
    halves.edges.push(arc(6, 10.0, [5, 1]));
    halves.edges.push(BrepEdge { id: 7, curve: Curve::Line, ends: [0, 1], along: true });
    halves.edges.push(BrepEdge { id: 8, curve: Curve::Line, ends: [4, 5], along: true });
    halves.faces[0].bounds[0] = Bound::Loop(vec![(4, false), (0, false)]);
    halves.faces[1].bounds[0] = Bound::Loop(vec![(1, true), (5, true)]);
    let half = |id, bounds| free(id, wall(6.0), true, vec![Bound::Loop(bounds)]);
    halves.faces[2] = half(13, vec![(0, true), (7, true), (1, false), (6, false)]);
    halves.faces.push(half(15, vec![(4, true), (6, true), (5, false), (7, false)]));
    check(&halves, volume, area, "two halves");
}

/// Half a ball, a whole one, and half an ellipsoid as lines turned about z: poles with and without a corner.
#[test]
fn poles_are_points_of_one_face() {
    let arc = |radius: f64, height: f64| Spline {
        knots: Knots { degree: 2, values: vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0] },
        poles: vec![
            Point3::new(radius, 0.0, 0.0),
            Point3::new(radius, 0.0, height),
            Point3::new(0.0, 0.0, height),
        ],
        weights: vec![1.0, 0.5_f64.sqrt(), 1.0],
    };
    let turned = |profile| Freeform::Revolved { point_mm: Point3::origin(), axis: Vector3::z(), profile };
    let rim = BrepEdge { id: 1, curve: circle(0.0, 5.0), ends: [0; 2], along: true };
    let base = || face(1, level(0.0), false, vec![Bound::Loop(vec![(0, false)])]);
    let start = Point3::new(5.0, 0.0, 0.0);
    let dome = |surface: Freeform, height: f64, more: Option<Bound>| Brep {
        vertices: vec![start, Point3::new(0.0, 0.0, height)],
        edges: vec![rim.clone()],
        faces: vec![
            base(),
            free(
                2,
                surface,
                true,
                [Some(Bound::Loop(vec![(0, true)])), more].into_iter().flatten().collect(),
            ),
        ],
    };
    let half_ball = (PI * 125.0 * 2.0 / 3.0, 3.0 * PI * 25.0);
    let of = |height: f64| turned(Profile::Spline(arc(5.0, height)));
    check(&dome(of(5.0), 5.0, None), half_ball.0, half_ball.1, "half a ball");
    check(&dome(of(5.0), 5.0, Some(Bound::Corner(1))), half_ball.0, half_ball.1, "half a ball with its pole");
    let mut seam = dome(of(5.0), 5.0, None);
    seam.edges.push(BrepEdge { id: 2, curve: Curve::Spline(arc(5.0, 5.0)), ends: [0, 1], along: true });
    seam.faces[1].bounds = vec![Bound::Loop(vec![(0, true), (1, true), (1, false)])];
    check(&seam, half_ball.0, half_ball.1, "half a ball with a seam");
    // An ellipse all around closes in both directions; only the border tells where its surface is cut.
    let ellipse = Profile::Ellipse(
        Frame {
            origin: Point3::origin(),
            axes: Matrix3::from_columns(&[Vector3::x(), Vector3::z(), -Vector3::y()]),
        },
        [5.0, 8.0],
    );
    let eccentricity = (1.0 - 25.0 / 64.0_f64).sqrt();
    let side = PI * 25.0 * (1.0 + 8.0 / (5.0 * eccentricity) * math::asin(eccentricity));
    let egg = dome(turned(ellipse), 8.0, Some(Bound::Corner(1)));
    check(&egg, 0.5 * PI * 4.0 / 3.0 * 25.0 * 8.0, side + PI * 25.0, "half an ellipsoid");
    // From pole to pole nothing bounds it.
    let meridian = Spline {
        knots: Knots { degree: 2, values: vec![0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0] },
        poles: [[0, -1], [1, -1], [1, 0], [1, 1], [0, 1]]
            .map(|[x, z]| Point3::new(5.0 * f64::from(x), 0.0, 5.0 * f64::from(z)))
            .to_vec(),
        weights: vec![1.0, 0.5_f64.sqrt(), 1.0, 0.5_f64.sqrt(), 1.0],
    };
    let whole =
        Brep { faces: vec![free(1, turned(Profile::Spline(meridian)), true, vec![])], ..Brep::default() };
    check(&whole, PI * 125.0 * 4.0 / 3.0, 4.0 * PI * 25.0, "a whole ball");
}

/// A torus as a spline that closes in both directions: all of it, its outer and its inner half.
#[test]
fn what_closes_in_both_directions_is_cut_where_no_border_lies() {
    let section = round(Point3::new(8.0, 0.0, 0.0), Vector3::x() * 2.0, Vector3::z() * 2.0);
    let ring = round(Point3::origin(), Vector3::x(), Vector3::y());
    let lines: Vec<Spline> = section
        .poles
        .iter()
        .map(|pole| {
            let mut line = ring.clone();
            for p in &mut line.poles {
                *p = Point3::new(p.x * pole.x, p.y * pole.x, pole.z);
            }
            line
        })
        .collect();
    let torus = || lofted(&lines, section.knots.clone(), &section.weights);
    let whole = Brep { faces: vec![free(1, torus(), true, vec![])], ..Brep::default() };
    check(&whole, 2.0 * PI * PI * 8.0 * 4.0, 4.0 * PI * PI * 8.0 * 2.0, "a whole torus");
    let half = |outer: bool| Brep {
        faces: vec![
            face(1, level(-2.0), false, vec![Bound::Loop(vec![(0, false)])]),
            face(2, level(2.0), true, vec![Bound::Loop(vec![(1, true)])]),
            free(3, torus(), outer, vec![Bound::Loop(vec![(0, true)]), Bound::Loop(vec![(1, false)])]),
        ],
        ..rims()
    };
    let disc = PI * 64.0;
    let bulge = 2.0 * 4.0 / (3.0 * PI);
    let (tube, side) = (PI * 2.0 * 2.0 * PI, 4.0 / PI);
    let outer = (4.0 * PI * PI * (8.0 + bulge) + disc * 4.0, tube * (8.0 + side) + 2.0 * disc);
    check(&half(true), outer.0, outer.1, "outer half");
    let inner = (disc * 4.0 - 4.0 * PI * PI * (8.0 - bulge), tube * (8.0 - side) + 2.0 * disc);
    check(&half(false), inner.0, inner.1, "inner half");
}

/// An ellipse that is moved along a slanted way, and a surface beside another one.
#[test]
fn extrusions_and_offsets_have_their_closed_forms() {
    let ellipse = |z: f64| Frame { origin: Point3::new(0.3 * z, 0.0, z), axes: Matrix3::identity() };
    let way = Vector3::new(0.3, 0.0, 1.0).normalize();
    let profile = Profile::Ellipse(ellipse(-3.0), [6.0, 4.0]);
    let rim = |id, z: f64, end| BrepEdge {
        id,
        curve: Curve::Ellipse(ellipse(z), [6.0, 4.0]),
        ends: [end; 2],
        along: true,
    };
    let brep = Brep {
        vertices: vec![Point3::new(6.0, 0.0, 0.0), Point3::new(9.0, 0.0, 10.0)],
        edges: vec![rim(1, 0.0, 0), rim(2, 10.0, 1)],
        faces: vec![
            face(1, level(0.0), false, vec![Bound::Loop(vec![(0, false)])]),
            face(2, level(10.0), true, vec![Bound::Loop(vec![(1, true)])]),
            free(
                3,
                Freeform::Extruded { direction: way, profile },
                true,
                vec![Bound::Loop(vec![(0, true)]), Bound::Loop(vec![(1, false)])],
            ),
        ],
    };
    // The wall: the length of the ellipse across the way, by many pieces.
    let wall: f64 = (0..100_000)
        .map(|k| {
            let angle = 2.0 * PI * (f64::from(k) + 0.5) / 1e5;
            let tangent = Vector3::new(-6.0 * math::sin(angle), 4.0 * math::cos(angle), 0.0);
            tangent.cross(&Vector3::new(3.0, 0.0, 10.0)).norm() * 2.0 * PI / 1e5
        })
        .sum();
    check(&brep, PI * 24.0 * 10.0, wall + 2.0 * PI * 24.0, "a slanted cylinder");
    let ring = Profile::Ellipse(
        Frame {
            origin: Point3::new(8.0, 0.0, 0.0),
            axes: Matrix3::from_columns(&[Vector3::x(), Vector3::z(), -Vector3::y()]),
        },
        [1.5; 2],
    );
    let basis =
        Box::new(Freeform::Revolved { point_mm: Point3::origin(), axis: Vector3::z(), profile: ring });
    let thick = Freeform::Offset { basis, distance_mm: 0.5 };
    let whole = Brep { faces: vec![free(1, thick, true, vec![])], ..Brep::default() };
    check(&whole, 2.0 * PI * PI * 8.0 * 4.0, 4.0 * PI * PI * 8.0 * 2.0, "a torus about a torus");
}
