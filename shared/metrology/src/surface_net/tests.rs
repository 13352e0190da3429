//! Meshes of known surfaces.

use super::*;
use bytemuck::Zeroable;
use fringe::math;

fn point(position_mm: [f64; 3], normal: Vector3<f64>) -> Point {
    Point { position_mm, normal: [normal.x as f32, normal.y as f32, normal.z as f32], ..Point::zeroed() }
}

/// Points of a sphere about the origin, by the golden angle.
fn sphere(radius_mm: f64, count: usize) -> Vec<Point> {
    (0..count)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / count as f64;
            let turn = i as f64 * 2.399_963_229_728_653;
            let (sin, cos) = (math::sin(turn), math::cos(turn));
            let n = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            point((n * radius_mm).into(), n)
        })
        .collect()
}

/// A flat plate of points 0.2 mm apart, without those in a hole.
fn plate(hole: impl Fn(f64, f64) -> bool) -> Vec<Point> {
    let grid = (0..151).flat_map(|i| (0..101).map(move |j| (0.2 * f64::from(i), 0.2 * f64::from(j))));
    grid.filter(|(x, y)| !hole(*x, *y)).map(|(x, y)| point([x, y, 0.0], Vector3::z())).collect()
}

#[test]
fn a_sphere_becomes_a_closed_mesh_of_its_area() {
    let points = sphere(10.0, 40_000);
    let net = SurfaceNet::new(&points, None).unwrap();
    assert_eq!(net.openings(), [], "closed");
    let area = 4.0 * std::f64::consts::PI * 100.0;
    assert!((net.area_mm2() / area - 1.0).abs() < 1e-3, "{} of {area}", net.area_mm2());
    // Euler: a surface without handles.
    let edges = net.triangles.len() * 3 / 2;
    assert_eq!(net.corners.len() + net.triangles.len() - edges, 2);
    let volume: f64 =
        net.positions().iter().map(|[a, b, c]| a.coords.dot(&b.coords.cross(&c.coords)) / 6.0).sum();
    assert!((volume / 4188.79 - 1.0).abs() < 2e-3, "corners run counter-clockwise: {volume}");
    for corner in &net.corners {
        assert!((corner.coords.norm() - 10.0).abs() < 2e-4, "{}", corner.coords.norm());
    }
    let check = NetCheck::of(&net, &points).unwrap();
    assert!(check.without == 0 && check.rms_mm < 0.003 && check.largest_mm < 0.01, "{check:?}");
}

#[test]
fn the_same_cloud_gives_the_same_mesh() {
    let points = sphere(5.0, 5000);
    assert_eq!(SurfaceNet::new(&points, None).unwrap(), SurfaceNet::new(&points, None).unwrap());
}

#[test]
fn two_skins_become_one() {
    let mut points = plate(|_, _| false);
    let second: Vec<Point> = points
        .iter()
        .map(|p| point([p.position_mm[0] + 0.1, p.position_mm[1] + 0.07, 0.02], Vector3::z()))
        .collect();
    points.extend(second);
    let net = SurfaceNet::new(&points, Some(0.4)).unwrap();
    let within = |c: &Point3<f64>| (1.0..29.0).contains(&c.x) && (1.0..19.0).contains(&c.y);
    let heights = net.corners.iter().filter(|c| within(c)).map(|c| c.z);
    let (low, high) = heights.fold((1.0_f64, -1.0_f64), |(low, high), z| (low.min(z), high.max(z)));
    assert!(low > -0.002 && high < 0.022, "{low} {high}");
    assert_eq!(net.openings().len(), 1, "one border");
    assert!((net.area_mm2() / 600.0 - 1.0).abs() < 0.05, "{}", net.area_mm2());
}

#[test]
fn a_hole_is_left_open_and_reported_with_its_area() {
    let net = SurfaceNet::new(&plate(|x, y| math::hypot(x - 15.0, y - 10.0) < 4.0), Some(0.4)).unwrap();
    let openings = net.openings();
    assert_eq!(openings.len(), 2, "{openings:?}");
    assert!((openings[0].area_mm2 / 600.0 - 1.0).abs() < 0.06, "the outer border: {openings:?}");
    let hole = openings[1];
    assert!((hole.area_mm2 / (std::f64::consts::PI * 16.0) - 1.0).abs() < 0.15, "{hole:?}");
    assert!((hole.middle_mm[0] - 15.0).abs() < 0.2 && (hole.middle_mm[1] - 10.0).abs() < 0.2, "{hole:?}");
}

/// The two sides of a sheet thinner than a cell do not grow together away from their points.
#[test]
fn a_gap_of_two_cells_stays_open() {
    let mut points = plate(|_, _| false);
    let upper: Vec<Point> =
        points.iter().map(|p| point([p.position_mm[0], p.position_mm[1], 1.0], -Vector3::z())).collect();
    points.extend(upper);
    let net = SurfaceNet::new(&points, Some(0.4)).unwrap();
    assert!(net.corners.iter().all(|c| c.z.abs() < 1e-6 || (c.z - 1.0).abs() < 1e-6));
    assert_eq!(net.openings().len(), 2);
}

#[test]
fn what_is_no_surface_is_refused() {
    let without: Vec<Point> = sphere(5.0, 500).iter().map(|p| Point { normal: [0.0; 3], ..*p }).collect();
    assert!(matches!(SurfaceNet::new(&without, None), Err(NetError::NoNormals { without: 500, given: 500 })));
    assert!(matches!(SurfaceNet::new(&[], None), Err(NetError::NoNormals { .. })));
    let points = sphere(5.0, 500);
    assert!(matches!(SurfaceNet::new(&points, Some(1e-9)), Err(NetError::Sparse { .. })));
    assert!(matches!(SurfaceNet::new(&points, Some(0.01)), Err(NetError::Sparse { .. })));
    let twins = vec![points[0]; 100];
    assert!(SurfaceNet::new(&twins, None).is_err(), "all points in one place");
}

/// Two plates that cross, and noise: the surface passes corners of the grid in every way; still no edge has more than two triangles.
#[test]
fn no_edge_has_more_than_two_triangles() {
    let mut points = plate(|_, _| false);
    for (index, p) in points.iter_mut().enumerate() {
        p.position_mm[2] += 0.15 * math::sin(index as f64 * 12.9898 * 37.0) + 0.05 * p.position_mm[0];
    }
    let raw = {
        let crossings = Field::new(&points, 0.3).unwrap().crossings();
        let cells = vertices(&crossings);
        let numbers = cells.iter().zip(0..).map(|((cell, _), number)| (*cell, number)).collect();
        let corners: Vec<Point3<f64>> = cells.iter().map(|(_, at)| *at).collect();
        triangles(&crossings, &numbers, &corners)
    };
    assert!(!manifold::crowded_edges(&raw).is_empty(), "the case is there");
    let net = SurfaceNet::new(&points, Some(0.3)).unwrap();
    assert!(manifold::crowded_edges(&net.triangles).is_empty());
    let mut sides: Vec<[u32; 2]> =
        net.triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect();
    sides.sort_unstable();
    assert!(sides.windows(2).all(|pair| pair[0] != pair[1]), "neighbours face the same way");
    let check = NetCheck::of(&net, &points).unwrap();
    assert!(check.within_95_mm < 0.2, "{check:?}");
}

#[test]
fn points_in_one_place_are_refused() {
    let one = point([1.0, 2.0, 3.0], Vector3::z());
    for points in [vec![one], vec![one; 5]] {
        let error = SurfaceNet::new(&points, None).unwrap_err();
        assert_eq!(error, NetError::OnePlace { given: points.len() });
    }
}
