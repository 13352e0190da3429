//! Surfaces of two parameters against recursion, closed forms and dense sampling; seams, poles, degenerate knots.

use super::tests::{LIMIT, face, level};
use super::*;
use fringe::math;
use nalgebra::{Isometry3, Point3, Vector3};
use proptest::prelude::*;

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
pub(super) fn round(center: Point3<f64>, x: Vector3<f64>, y: Vector3<f64>) -> Spline {
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
pub(super) fn lofted(lines: &[Spline], across: Knots, weights: &[f64]) -> Freeform {
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

pub(super) fn free(id: u64, surface: Freeform, outward: bool, bounds: Vec<Bound>) -> BrepFace {
    BrepFace { id, name: String::new(), surface: Surface::Free(Box::new(surface)), outward, bounds }
}

pub(super) fn straight() -> Knots {
    Knots { degree: 1, values: vec![0.0, 0.0, 1.0, 1.0] }
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
