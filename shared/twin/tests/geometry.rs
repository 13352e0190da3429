use crate::common::{artefact, body, box_triangles, parse_text, points, scene, stl};
use fringe::math::random::Key;
use nalgebra::{Point3, Vector3};
use twin::Scene;
use twin::mesh::{Mesh, MeshError};

/// Each shape alone, turned and shifted.
fn shapes() -> Vec<(&'static str, Scene)> {
    [
        ("sphere", r#"{ shape = "sphere", diameter_mm = 22.462 }"#),
        ("hemisphere", r#"{ shape = "hemisphere", diameter_mm = 60.194 }"#),
        ("cylinder", r#"{ shape = "cylinder", diameter_mm = 18.0, height_mm = 31.0 }"#),
        ("box", r#"{ shape = "box", size_mm = [20.0, 31.0, 12.0] }"#),
        ("plane", r#"{ shape = "plane", size_mm = [40.0, 30.0], thickness_mm = 3.0 }"#),
        (
            "wedge",
            r#"{ shape = "wedge", footprint_mm = [24.0, 20.0], height_mm = 12.0, inclination_deg = 44.9 }"#,
        ),
    ]
    .map(|(name, geometry)| {
        let table = body(name, [3.0, -5.0, 7.0], geometry) + "rotation_deg = [20.0, -35.0, 110.0]\n";
        (name, scene(&table))
    })
    .into()
}

/// Rays from outside towards the neighbourhood of the body.
fn rays(seed: u64, count: u64) -> impl Iterator<Item = (Point3<f64>, Vector3<f64>)> {
    let from = points(seed, count, [0.0; 3], 1.0);
    let to = points(seed + 1, count, [3.0, -5.0, 7.0], 25.0);
    from.into_iter().zip(to).map(|(from, to)| {
        let origin = Point3::from(from.coords.normalize() * 500.0);
        (origin, (to - origin).normalize())
    })
}

/// Steps along a ray by the distance to the surface: slow, and free of any intersection formula.
fn march(scene: &Scene, origin: &Point3<f64>, d: &Vector3<f64>, limit: f64) -> Option<f64> {
    let mut t = 0.0;
    for _ in 0..100_000 {
        let step = scene.surface_distance(&(origin + d * t)).signed_mm;
        if step < 1e-10 {
            return Some(t);
        }
        t += step;
        if t > limit {
            return None;
        }
    }
    Some(t)
}

#[test]
fn every_shape_is_hit_where_marching_by_its_distance_arrives() {
    for (name, scene) in shapes() {
        let mut hits = 0;
        for (origin, d) in rays(11, 2000) {
            let hit = scene.first_hit(&origin, &d);
            let marched = march(&scene, &origin, &d, 1000.0);
            match (hit, marched) {
                (Some(hit), Some(t)) => {
                    hits += 1;
                    // A grazing march stops early by 1e-10 over the cosine.
                    let slack = 1e-9 / hit.normal.dot(&d).abs().max(1e-6);
                    assert!((hit.t_mm - t).abs() < 1e-8 + slack, "{name}: {} and {t}", hit.t_mm);
                }
                (None, None) => {}
                // At the limb the march may stop within 1e-10 of a surface that the ray just misses.
                (hit, marched) => {
                    let t = marched.or(hit.map(|h| h.t_mm)).unwrap();
                    let gap = scene.surface_distance(&(origin + d * t)).signed_mm;
                    assert!(hit.is_none() && gap < 1e-10, "{name}: {hit:?} but {marched:?}");
                }
            }
        }
        assert!(hits > 200, "{name} was hit {hits} times");
    }
}

#[test]
fn no_hit_is_nearer_than_the_nearest_point_and_the_foot_lies_on_the_surface() {
    for (name, scene) in shapes() {
        let hits: Vec<_> = rays(5, 3000).filter_map(|(o, d)| scene.first_hit(&o, &d)).collect();
        for p in points(3, 400, [3.0, -5.0, 7.0], 30.0) {
            let near = scene.surface_distance(&p);
            let foot = scene.surface_distance(&near.foot_mm);
            assert!(foot.signed_mm.abs() < 1e-11, "{name}: foot is off by {}", foot.signed_mm);
            assert!(((p - near.foot_mm).norm() - near.signed_mm.abs()).abs() < 1e-11, "{name}");
            let nearest_hit = hits.iter().map(|h| (h.point_mm - p).norm()).fold(f64::INFINITY, f64::min);
            assert!(
                nearest_hit >= near.signed_mm.abs() - 1e-10,
                "{name}: {nearest_hit} < {}",
                near.signed_mm
            );
            // 3000 hits leave gaps of a few mm, no more.
            assert!(
                nearest_hit <= near.signed_mm.abs() + 15.0,
                "{name}: {nearest_hit} and {}",
                near.signed_mm
            );
        }
    }
}

#[test]
fn the_face_and_its_normal_agree_with_the_slope_of_the_distance() {
    for (name, scene) in shapes() {
        for hit in rays(21, 500).filter_map(|(o, d)| scene.first_hit(&o, &d)) {
            let near = scene.surface_distance(&hit.point_mm);
            if near.is_near_edge(0.01) {
                continue;
            }
            assert_eq!(near.face, hit.face, "{name}");
            let h = 1e-5;
            let slope = |axis: Vector3<f64>| {
                let at = |s: f64| scene.surface_distance(&(hit.point_mm + axis * s)).signed_mm;
                (at(h) - at(-h)) / (2.0 * h)
            };
            let gradient = Vector3::new(slope(Vector3::x()), slope(Vector3::y()), slope(Vector3::z()));
            assert!((gradient - hit.normal).norm() < 1e-5, "{name}: {gradient} and {}", hit.normal);
        }
    }
}

#[test]
fn a_sphere_is_hit_exactly_up_to_its_limb() {
    let (radius, centre) = (11.231, Point3::new(3.0, -5.0, 7.0));
    let scene = scene(&body("ball", [3.0, -5.0, 7.0], r#"{ shape = "sphere", diameter_mm = 22.462 }"#));
    let origin = Point3::new(500.0, 0.0, 0.0);
    let axis = (centre - origin).normalize();
    let across = axis.cross(&Vector3::z()).normalize();
    for gap in [1e-3, 1e-6, 1e-9] {
        for (miss, seen) in [(radius - gap, true), (radius + gap, false)] {
            // The ray that passes the centre at a distance of `miss`.
            let sine: f64 = miss / (centre - origin).norm();
            let d = axis * (1.0 - sine * sine).sqrt() + across * sine;
            let hit = scene.first_hit(&origin, &d);
            assert_eq!(hit.is_some(), seen, "distance {miss} from the centre of radius {radius}");
            if let Some(hit) = hit {
                assert!(((hit.point_mm - centre).norm() - radius).abs() < 1e-12);
            }
        }
    }
}

fn random_mesh(seed: u64, count: u64) -> Vec<[Point3<f64>; 3]> {
    let centres = points(seed, count, [0.0; 3], 20.0);
    let offsets = points(seed + 1, 3 * count, [0.0; 3], 4.0);
    centres.iter().enumerate().map(|(i, c)| [0, 1, 2].map(|k| c + offsets[3 * i + k].coords)).collect()
}

#[test]
fn the_tree_finds_what_a_loop_over_all_triangles_finds() {
    for count in [1, 2, 5, 37, 600] {
        let corners = random_mesh(count, count);
        let mesh = Mesh::from_corners(&corners).unwrap();
        let alone: Vec<_> = corners.iter().map(|c| Mesh::from_corners(&[*c]).unwrap()).collect();
        let mut hits = 0;
        for (from, to) in points(77, 400, [0.0; 3], 60.0).iter().zip(points(78, 400, [0.0; 3], 20.0)) {
            let d = (to - from).normalize();
            let expected = alone
                .iter()
                .filter_map(|m| m.enter(from, &d, 0.0))
                .map(|c| c.t_mm)
                .fold(f64::INFINITY, f64::min);
            let found = mesh.enter(from, &d, 0.0);
            assert_eq!(found.map_or(f64::INFINITY, |c| c.t_mm), expected);
            hits += u32::from(found.is_some());
            assert_eq!(mesh.blocks(from, &d, 0.0, 50.0), expected < 50.0);
            let nearest = alone.iter().map(|m| m.nearest(from).signed_mm.abs()).fold(f64::INFINITY, f64::min);
            assert_eq!(mesh.nearest(from).signed_mm.abs(), nearest);
        }
        assert!(hits > 0 || count < 5, "{count} triangles were never hit");
    }
}

#[test]
fn axis_parallel_rays_in_the_plane_of_a_box_are_not_lost() {
    // The first triangle spans the tree's lower face z = 0; the rays run within x = 0 and y = 0 planes of the boxes.
    let corners = [0.0, 5.0, 10.0]
        .map(|z| [Point3::new(0.0, 0.0, z), Point3::new(4.0, 0.0, z), Point3::new(0.0, 4.0, z)]);
    let mesh = Mesh::from_corners(&corners).unwrap();
    let down = Vector3::new(0.0, 0.0, -1.0);
    let hit = mesh.enter(&Point3::new(0.0, 1.0, 20.0), &down, 0.0).unwrap();
    assert_eq!(hit.t_mm, 10.0);
}

fn mesh_scene(bytes: &[u8]) -> Result<Scene, String> {
    let text = "format = \"fringecell-scene/1\"\n[[material]]\nname = \"white\"\nalbedo = 0.7\n".to_string()
        + &body("part", [1.0, 2.0, 3.0], r#"{ shape = "mesh", file = "part.stl" }"#);
    parse_text(&text, &mut |file| {
        assert_eq!(file, "part.stl");
        Ok(bytes.to_vec())
    })
}

#[test]
fn a_box_from_an_stl_equals_the_analytic_box() {
    let mesh = mesh_scene(&stl(&box_triangles([10.0, 6.0, 4.0]))).unwrap();
    let solid = scene(&body("part", [1.0, 2.0, 3.0], r#"{ shape = "box", size_mm = [20.0, 12.0, 8.0] }"#));
    for (p, to) in points(1, 500, [1.0, 2.0, 3.0], 25.0).iter().zip(points(2, 500, [1.0, 2.0, 3.0], 8.0)) {
        let (a, b) = (mesh.surface_distance(p), solid.surface_distance(p));
        assert!(
            (a.foot_mm - b.foot_mm).norm() < 1e-12 || (a.signed_mm.abs() - b.signed_mm.abs()).abs() < 1e-12
        );
        if !b.is_near_edge(1e-6) {
            assert!((a.signed_mm - b.signed_mm).abs() < 1e-12, "{} and {}", a.signed_mm, b.signed_mm);
            assert!((a.edge_mm - b.edge_mm).abs() < 1e-9, "{} and {}", a.edge_mm, b.edge_mm);
        }
        let d = (to - p).normalize();
        if b.signed_mm > 0.0 {
            let t = |s: &Scene| s.first_hit(p, &d).map(|h| h.t_mm);
            match (t(&mesh), t(&solid)) {
                (Some(a), Some(b)) => assert!((a - b).abs() < 1e-11),
                (a, b) => assert_eq!(a, b),
            }
        }
    }
}

#[test]
fn meshes_that_are_none_are_refused() {
    let triangles = box_triangles([1.0, 1.0, 1.0]);
    let whole = stl(&triangles);
    for cut in [0, 5, 79, 83, 84, 100, whole.len() - 1] {
        let result = mesh_scene(&whole[..cut]);
        let refused = "[[body]] \"part\": file = \"part.stl\"";
        assert!(result.as_ref().is_err_and(|error| error == refused), "{cut} bytes: {result:?}");
    }
    assert_eq!(Mesh::from_stl(&stl(&[]), 1.0), Err(MeshError::Empty { given: 0 }));
    let line = [[0.0; 3], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]];
    assert_eq!(Mesh::from_stl(&stl(&[line]), 1.0), Err(MeshError::Empty { given: 1 }));
    let mut broken = triangles.clone();
    broken[7][1][2] = f32::NAN;
    assert_eq!(Mesh::from_stl(&stl(&broken), 1.0), Err(MeshError::NotFinite { triangle: 7 }));
    // A count that promises more than there is must neither be accepted nor allocated.
    let mut boast = whole.clone();
    boast[80..84].copy_from_slice(&u32::MAX.to_le_bytes());
    assert!(matches!(Mesh::from_stl(&boast, 1.0), Err(MeshError::Unreadable(_))));
    let ascii = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
                 endsolid a\n";
    assert_eq!(Mesh::from_stl(ascii.as_bytes(), 1.0).unwrap().triangles(), 1);
    assert!(Mesh::from_stl(&ascii.as_bytes()[..60], 1.0).is_err());
    // Any damage gives a mesh or an error, never a panic.
    let key = Key::new(4);
    for trial in 0..2000_u64 {
        let mut bytes = whole.clone();
        for i in 0..4 {
            let draw = key.with(trial).bits(i);
            let at = (draw % bytes.len() as u64) as usize;
            bytes[at] = (draw >> 56) as u8;
        }
        let _ = Mesh::from_stl(&bytes, 1.0);
    }
}

#[test]
fn on_the_artefact_edges_and_junctions_are_told_from_faces() {
    let scene = artefact();
    let at = |x: f64, y: f64, z: f64| scene.surface_distance(&Point3::new(x, y, z));
    let name = |index: usize| scene.body_names().nth(index).unwrap().to_string();
    let plate = at(45.0, 0.0, 0.002);
    assert_eq!((name(plate.body).as_str(), plate.face), ("base", 2));
    assert!((plate.signed_mm - 0.002).abs() < 1e-12);
    assert!((plate.edge_mm - 10.0).abs() < 1e-9, "the plate ends at x = 55: {}", plate.edge_mm);
    // The hemisphere begins at a radius of 30.097 mm.
    assert!((at(31.097, 0.0, 0.0).edge_mm - 1.0).abs() < 1e-9);
    let top = at(0.0, 0.0, 30.098);
    assert_eq!(name(top.body), "hemisphere");
    assert!((top.signed_mm - 0.001).abs() < 1e-12 && top.edge_mm > 20.0);
    // The slope of wedge 1 falls towards +x from (37.985, 12) to (50, 0).
    let slope = at(44.0, -38.0, 6.0);
    assert_eq!((name(slope.body).as_str(), slope.face), ("wedge1", 1));
    let step = at(3.0, -44.0, 7.9);
    assert_eq!(name(step.body), "step");
    assert!((step.signed_mm + 0.1).abs() < 1e-12);
    // Buried in the hemisphere, the plate's face is no surface.
    assert_eq!(at(0.0, 0.0, 1e-9).edge_mm, 0.0);
}
