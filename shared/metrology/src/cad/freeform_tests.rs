//! Surfaces of two parameters against recursion, closed forms and dense sampling; seams, poles, degenerate knots.

use super::tests::{LIMIT, circle, face, level, tube};
use super::*;
use fringe::math;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use proptest::prelude::*;
use std::f64::consts::PI;

/// The basis function of a control point by the recursion that defines it.
fn cox_de_boor(knots: &[f64], index: usize, degree: usize, t: f64, last: f64) -> f64 {
    if degree == 0 {
        let closes = t == last && knots[index + 1] == last && knots[index] < last;
        return f64::from(u8::from((knots[index] <= t && t < knots[index + 1]) || closes));
    }
    let part = |from: f64, to: f64, value: f64| if to > from { value / (to - from) } else { 0.0 };
    let (low, high) = (knots[index], knots[index + degree + 1]);
    part(low, knots[index + degree], t - low) * cox_de_boor(knots, index, degree - 1, t, last)
        + part(knots[index + 1], high, high - t) * cox_de_boor(knots, index + 1, degree - 1, t, last)
}

/// Knots of some degree with the given steps between them; steps of 0 repeat a knot.
fn knots(degree: usize, steps: &[u8]) -> Knots {
    let mut values = vec![0.0; degree + 1];
    let (mut at, mut times) = (0.0, degree + 1);
    for step in steps {
        let step = if times >= degree && *step == 0 { 1 } else { *step };
        at += f64::from(step);
        times = if step == 0 { times + 1 } else { 1 };
        values.push(at);
    }
    values.extend(vec![at + 1.0; degree + 1]);
    Knots { degree, values }
}

/// A number within -1 … 1 that follows from two others.
fn scatter(k: usize, seed: usize) -> f64 {
    math::sin((k * 37 + seed * 101) as f64 * 12.9898)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// Points and tangents of curves: the sum of all control points by the recursion, and differences.
    #[test]
    fn curves_are_what_the_recursion_says(degree in 1_usize..6, steps in prop::collection::vec(0_u8..3, 0..8), seed in 0_usize..1000) {
        let knots = knots(degree, &steps);
        let count = knots.values.len() - degree - 1;
        let poles: Vec<Point3<f64>> =
            (0..count).map(|k| Point3::new(scatter(k, seed), scatter(k, seed + 1), scatter(k, seed + 2)) * 10.0).collect();
        let weights: Vec<f64> = (0..count).map(|k| 1.0 + 0.5 * scatter(k, seed + 3)).collect();
        let spline = Spline { knots: knots.clone(), poles: poles.clone(), weights: weights.clone() };
        prop_assert_eq!(spline.fault(), None);
        let [from, to] = knots.domain();
        for k in 0..=23 {
            let t = from + (to - from) * f64::from(k) / 23.0;
            let (mut sum, mut weight) = (Vector3::zeros(), 0.0);
            for (index, pole) in poles.iter().enumerate() {
                let factor = weights[index] * cox_de_boor(&knots.values, index, degree, t, to);
                sum += pole.coords * factor;
                weight += factor;
            }
            let (point, tangent) = spline.with_tangent(t);
            prop_assert!((point.coords - sum / weight).norm() < 1e-10, "{} of {:?}", t, knots);
            let step = 1e-6;
            let inside = knots.values.iter().all(|knot| (knot - t).abs() > 2.0 * step);
            if inside {
                let slope = (spline.at(t + step) - spline.at(t - step)) / (2.0 * step);
                prop_assert!((tangent - slope).norm() < 1e-5 * (1.0 + slope.norm()));
            }
        }
        let back = spline.clone().reversed();
        prop_assert!((back.at(-0.3 * to) - spline.at(0.3 * to)).norm() < 1e-10);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    /// Triangles of a bumpy patch keep the distance at places that nobody chose, and enclose the volume beneath it.
    #[test]
    fn patches_keep_the_distance(degrees in prop::array::uniform2(2_usize..5), repeat in prop::bool::ANY, seed in 0_usize..1000) {
        let steps: &[u8] = if repeat { &[1, 0, 1] } else { &[1, 1] };
        let (brep, surface) = bumpy(degrees.map(|degree| knots(degree, steps)), seed);
        let chord_mm = 0.02;
        let mesh = brep.mesh(chord_mm, LIMIT).unwrap();
        let mut worst = 0.0_f64;
        let own: Vec<usize> = (0..mesh.triangles.len()).filter(|index| mesh.face_of[*index] == 0).collect();
        for index in own.iter().copied().step_by(own.len() / 300 + 1) {
            let triangle = mesh.triangles[index];
            let corners = triangle.map(|c| mesh.corners[c as usize]);
            let mut shares = [0, 1, 2].map(|k| scatter(index, seed + k).abs() + 1e-3);
            let sum: f64 = shares.iter().sum();
            shares = shares.map(|s| s / sum);
            let point = (0..3).map(|k| corners[k].coords * shares[k]).sum::<Vector3<f64>>();
            worst = worst.max(distance_by_force(&surface, &Point3::from(point), chord_mm));
        }
        prop_assert!(worst <= chord_mm, "{} mm", worst);
        let volume = volume_beneath(&surface);
        prop_assert!((mesh.volume_mm3() - volume).abs() < 600.0 * chord_mm, "{} {}", mesh.volume_mm3(), volume);
    }
}

/// A box of 30 × 20 mm whose top is a spline that is a function of x and y, 10 mm high at its sides.
fn bumpy(knots: [Knots; 2], seed: usize) -> (Brep, SplineSurface) {
    let counts = [0, 1].map(|i| knots[i].values.len() - knots[i].degree - 1);
    // Means of neighbouring knots make x and y proportional to the parameters.
    let places = [0, 1].map(|i| {
        let [from, to] = knots[i].domain();
        let degree = knots[i].degree;
        let mean = |k: usize| knots[i].values[k + 1..=k + degree].iter().sum::<f64>() / degree as f64;
        (0..counts[i]).map(|k| (mean(k) - from) / (to - from)).collect::<Vec<f64>>()
    });
    let mut poles = Vec::new();
    for (i, x) in places[0].iter().enumerate() {
        for (j, y) in places[1].iter().enumerate() {
            let is_rim = i == 0 || j == 0 || i + 1 == counts[0] || j + 1 == counts[1];
            let z = if is_rim { 10.0 } else { 10.0 + 5.0 * scatter(i * 17 + j, seed) };
            poles.push(Point3::new(30.0 * x, 20.0 * y, z));
        }
    }
    let surface = SplineSurface { knots, weights: vec![1.0; poles.len()], poles };
    assert_eq!(surface.fault(counts), None);
    let corner = |k: usize| {
        let [x, y] = [[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]][k % 4];
        Point3::new(x, y, if k < 4 { 0.0 } else { 10.0 })
    };
    let edge = |id: u64, ends: [usize; 2]| BrepEdge { id, curve: Curve::Line, ends, along: true };
    let mut edges = Vec::new();
    for k in 0..4 {
        edges.push(edge(k as u64, [k, (k + 1) % 4]));
        edges.push(edge(10 + k as u64, [4 + k, 4 + (k + 1) % 4]));
        edges.push(edge(20 + k as u64, [k, 4 + k]));
    }
    let around = |which: usize, forward: bool| {
        let mut line: Vec<(usize, bool)> = (0..4).map(|k| (3 * k + which, forward)).collect();
        if !forward {
            line.reverse();
        }
        vec![Bound::Loop(line)]
    };
    let free = Surface::Free(Box::new(Freeform::Spline(surface.clone())));
    let mut faces = vec![
        BrepFace { id: 1, name: String::new(), surface: free, outward: true, bounds: around(1, true) },
        face(2, level(0.0), false, around(0, false)),
    ];
    for k in 0..4 {
        let [a, b] = [corner(k), corner(k + 1)];
        let normal =
            (Point3::new(b.x, b.y, 0.0) - Point3::new(a.x, a.y, 0.0)).cross(&Vector3::z()).normalize();
        let shape = CadShape::Plane { point_mm: a, normal };
        let side = vec![(3 * k, true), (3 * ((k + 1) % 4) + 2, true), (3 * k + 1, false), (3 * k + 2, false)];
        faces.push(face(3 + k as u64, shape, true, vec![Bound::Loop(side)]));
    }
    (Brep { vertices: (0..8).map(corner).collect(), edges, faces }, surface)
}

/// The least distance of a point from a surface over x and y: every place of ever finer grids about it.
fn distance_by_force(surface: &SplineSurface, point: &Point3<f64>, reach_mm: f64) -> f64 {
    let domains = [surface.knots[0].domain(), surface.knots[1].domain()];
    let sizes = [30.0, 20.0];
    let mut middle = [point.x / sizes[0], point.y / sizes[1]];
    let (mut reach, mut best) = (4.0 * reach_mm, f64::INFINITY);
    for _ in 0..6 {
        let from = middle;
        for (i, j) in (-4..=4).flat_map(|i| (-4..=4).map(move |j| (i, j))) {
            let share = [
                from[0] + 0.25 * f64::from(i) * reach / sizes[0],
                from[1] + 0.25 * f64::from(j) * reach / sizes[1],
            ]
            .map(|s| s.clamp(0.0, 1.0));
            let at = [0, 1].map(|k| domains[k][0] + share[k] * (domains[k][1] - domains[k][0]));
            let distance = (surface.with_tangents(at).0 - point).norm();
            if distance < best {
                (best, middle) = (distance, share);
            }
        }
        reach *= 0.5;
    }
    best
}

/// Volume between a surface over x and y and the ground, by many columns.
fn volume_beneath(surface: &SplineSurface) -> f64 {
    let [us, vs] = [0, 1].map(|i| surface.knots[i].domain());
    let count = 200;
    let mut sum = 0.0;
    for (i, j) in (0..count).flat_map(|i| (0..count).map(move |j| (i, j))) {
        let share = |k: i32| (f64::from(k) + 0.5) / f64::from(count);
        let at = [us[0] + share(i) * (us[1] - us[0]), vs[0] + share(j) * (vs[1] - vs[0])];
        sum += surface.with_tangents(at).0.z;
    }
    sum * 600.0 / f64::from(count * count)
}

/// A circle as a rational spline of four arcs.
fn round(center: Point3<f64>, x: Vector3<f64>, y: Vector3<f64>) -> Spline {
    let half = 0.5_f64.sqrt();
    let poles = [[1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0]]
        .map(|[a, b]| center + x * f64::from(a) + y * f64::from(b));
    Spline {
        knots: Knots { degree: 2, values: vec![0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0] },
        poles: poles.to_vec(),
        weights: vec![1.0, half, 1.0, half, 1.0, half, 1.0, half, 1.0],
    }
}

/// Lines of splines of one kind, one for each control point across.
fn lofted(lines: &[Spline], across: Knots, weights: &[f64]) -> Freeform {
    let count = lines[0].poles.len();
    let (mut poles, mut all) = (Vec::new(), Vec::new());
    for k in 0..count {
        for (line, weight) in lines.iter().zip(weights) {
            poles.push(line.poles[k]);
            all.push(line.weights[k] * weight);
        }
    }
    Freeform::Spline(SplineSurface { knots: [lines[0].knots.clone(), across], poles, weights: all })
}

fn free(id: u64, surface: Freeform, outward: bool, bounds: Vec<Bound>) -> BrepFace {
    BrepFace { id, name: String::new(), surface: Surface::Free(Box::new(surface)), outward, bounds }
}

fn straight() -> Knots {
    Knots { degree: 1, values: vec![0.0, 0.0, 1.0, 1.0] }
}

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
        vertices: vec![Point3::new(8.0, 0.0, -2.0), Point3::new(8.0, 0.0, 2.0)],
        edges: vec![
            BrepEdge { id: 1, curve: circle(-2.0, 8.0), ends: [0; 2], along: true },
            BrepEdge { id: 2, curve: circle(2.0, 8.0), ends: [1; 2], along: true },
        ],
        faces: vec![
            face(1, level(-2.0), false, vec![Bound::Loop(vec![(0, false)])]),
            face(2, level(2.0), true, vec![Bound::Loop(vec![(1, true)])]),
            free(3, torus(), outer, vec![Bound::Loop(vec![(0, true)]), Bound::Loop(vec![(1, false)])]),
        ],
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

/// Charts lead back to where points came from, and show their side.
#[test]
fn charts_of_two_parameters_lead_back_and_know_their_side() {
    let (_, surface) = bumpy([knots(3, &[1, 1]), knots(2, &[1])], 5);
    let wall = {
        let line = |z: f64| round(Point3::new(0.0, 0.0, z), Vector3::x() * 6.0, Vector3::y() * 6.0);
        lofted(&[line(0.0), line(10.0)], straight(), &[1.0; 2])
    };
    for surface in [Freeform::Spline(surface), wall] {
        let places = (0..12).map(|k| [0.2 + 0.2 * f64::from(k % 4), 0.3 + 0.15 * f64::from(k / 4)]);
        let domain = surface.domain();
        let at = |[s, t]: [f64; 2]| {
            [s, t].iter().zip(domain).map(|(s, [a, b])| a + s * (b - a)).collect::<Vec<f64>>()
        };
        let border: Vec<Point3<f64>> =
            places.map(at).map(|p| surface.with_tangents([p[0], p[1]]).0).collect();
        for chart in chart::Chart::candidates(&Surface::Free(Box::new(surface.clone())), &border) {
            let part = inverse::Part::new(&surface, &border);
            for (p, own) in border.iter().zip(chart.border(&border)) {
                let [x, y] = chart.place(p);
                assert!((x - own[0]).abs() + (y - own[1]).abs() < 1e-6);
                assert!((chart.lift([x, y]) - p).norm() < 1e-8, "{p}");
                let (place, distance) = part.nearest(&part.places(), p);
                assert!(distance < 1e-9, "{distance}");
                let step = 1e-6 * (x * x + y * y).sqrt().max(1e-3);
                let [a, b] = [[x + step, y], [x, y + step]].map(|place| chart.lift(place) - p);
                let normal = freeform::normal_of(&surface.with_tangents(place).1);
                assert_eq!(a.cross(&b).dot(&normal) > 0.0, chart.positive);
            }
        }
    }
}

/// Numbers that make no spline are refused with value and limit; the right ones beside them are taken.
#[test]
fn numbers_that_fit_no_spline_are_told() {
    let good = knots(2, &[1, 1]);
    assert_eq!(good.fault(5), None);
    let with = |values: Vec<f64>, degree: usize, count: usize| Knots { degree, values }.fault(count).unwrap();
    for (fault, words) in [
        (good.fault(6).unwrap(), "8 knots"),
        (good.fault(2).unwrap(), "needs 3 control points"),
        (with(vec![0.0; 4], 0, 3), "degree 0"),
        (with(vec![0.0; 60], 26, 33), "degree 26"),
        (with(vec![0.0, 0.0, 0.0, 2.0, 1.0, 3.0, 3.0, 3.0], 2, 5), "knot 1 stands after knot 2"),
        (with(vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0], 2, 6), "knot 1 counts 3 times, at most 2"),
        (with(vec![1.0; 8], 2, 5), "nothing is between"),
        (with(vec![0.0, 0.0, f64::NAN, 1.0, 2.0, 3.0, 3.0, 3.0], 2, 5), "must not fall"),
    ] {
        assert!(fault.contains(words), "{words}: {fault}");
    }
    let poles = vec![Point3::origin(); 5];
    for weight in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let weights = vec![1.0, 1.0, weight, 1.0, 1.0];
        let spline = Spline { knots: good.clone(), poles: poles.clone(), weights };
        assert!(spline.fault().unwrap().starts_with("weight 3 is"), "{weight}");
    }
    let short = Spline { knots: good, poles, weights: vec![1.0; 4] };
    assert_eq!(short.fault().unwrap(), "4 weights for 5 control points");
    let moved = Isometry3::<f64>::identity();
    assert!(features(&Brep::default(), &moved, &CadMesh::default()).is_empty());
}
