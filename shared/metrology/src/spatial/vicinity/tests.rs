use super::*;
use fearless_simd::Simd;
use fringe::synthetic::Noise;
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

/// Points on a wavy sheet of 6 × 6 mm, and below it, facing the other way.
fn wall(count: usize, noise: &mut Noise) -> (Vec<Point3<f64>>, Vec<[f32; 3]>) {
    (0..count)
        .map(|i| {
            let (x, y) = (6.0 * noise.unit() + 50.0, 6.0 * noise.unit());
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let z = 0.05 * (x - 53.0) * (x - 53.0) - 0.02 * x * y + 0.2 * side;
            (Point3::new(x, y, z), [0.0, 0.0, side as f32])
        })
        .unzip()
}

/// The height of a least-squares paraboloid at a place, by singular values.
fn paraboloid(patch: &Patch, points: &[Point3<f64>], p: &Point3<f64>) -> f64 {
    let [e1, e2, normal] = patch.frame();
    let local = |q: &Point3<f64>| {
        let d = q - p;
        [e1.dot(&d), e2.dot(&d), normal.dot(&d)]
    };
    let rows: Vec<[f64; 3]> = points.iter().map(local).collect();
    let matrix = DMatrix::from_fn(rows.len(), TERMS, |r, c| {
        let [u, v, _] = rows[r];
        [1.0, u, v, u * u, u * v, v * v][c]
    });
    let heights = DVector::from_iterator(rows.len(), rows.iter().map(|r| r[2]));
    matrix.svd(true, true).solve(&heights, 1e-12).unwrap()[0]
}

proptest! {
    /// What places find together is what brute force finds for each: the points, their sums, and the surface through them.
    #[test]
    fn places_side_by_side_equal_brute_force(
        seed in 0_u64..1000, count in 20_usize..400, places in 1_usize..=PLACES, radius_mm in 0.3_f64..3.0,
        faced in any::<bool>(),
    ) {
        let mut noise = Noise(seed);
        let (points, facing) = wall(count, &mut noise);
        let tree = PointTree::new(&points);
        let normals: Vec<[f32; 3]> = if faced {
            tree.order().iter().map(|i| facing[*i as usize]).collect()
        } else {
            Vec::new()
        };
        let at: Vec<Place> = (0..places)
            .map(|i| (tree.sites()[i], normals.get(i).copied().unwrap_or_default()))
            .collect();
        let mut vicinity = Vicinity::new();
        vicinity.gather(&tree, &normals, &at, radius_mm);
        let patches = vicinity.patches(places);
        for (lane, (place, normal)) in at.iter().enumerate() {
            let same_side = |i: usize| !faced || facing[i] == *normal;
            let around: Vec<Point3<f64>> = (0..count)
                .filter(|i| (points[*i] - place).norm() <= radius_mm && same_side(*i))
                .map(|i| points[i])
                .collect();
            prop_assert_eq!(vicinity.count(lane), around.len());
            let mut moments = Moments::about(*place);
            for p in &around {
                moments.add(p);
            }
            let difference = vicinity.moments(lane).covariance() - moments.covariance();
            prop_assert!(difference.amax() < 1e-12 * radius_mm * radius_mm);
            if faced {
                prop_assert_eq!(vicinity.normal(lane).z.abs(), around.len() as f64);
            }
            let Some(patch) = patches[lane].filter(|_| around.len() >= 20) else { continue };
            // Seen along the patch's own normal, so that both heights are over one plane.
            let brute = paraboloid(&patch, &around, place);
            let own = patch.height_mm();
            prop_assert!((own - brute).abs() < 1e-9, "{own} {brute}");
        }
        prop_assert!(patches[places..].iter().all(Option::is_none));
    }
}

#[test]
fn all_levels_of_instructions_give_the_same_bits() {
    let mut noise = Noise(3);
    let (points, facing) = wall(300, &mut noise);
    let tree = PointTree::new(&points);
    let normals: Vec<[f32; 3]> = tree.order().iter().map(|i| facing[*i as usize]).collect();
    let at: Vec<Place> = (0..PLACES).map(|i| (tree.sites()[i], normals[i])).collect();
    let bits = |level: Level| {
        let mut vicinity = Vicinity { level, ..Vicinity::new() };
        vicinity.gather(&tree, &normals, &at, 0.8);
        let p = at[3].0 + Vector3::new(0.1, 0.1, 0.3);
        vicinity.patches(PLACES).map(|patch| patch.map(|patch| patch.distance_mm(&p).to_bits()))
    };
    let plain = bits(Level::baseline());
    assert!(plain.iter().all(Option::is_some));
    let best = Level::new();
    let more = [best.as_sse4_2().map(Simd::level), best.as_avx2().map(Simd::level), Some(best)];
    for level in more.into_iter().flatten() {
        assert_eq!(plain, bits(level));
    }
}

#[test]
fn a_paraboloid_follows_a_sphere_where_a_plane_lies_beside_it() {
    let (radius_mm, mut noise) = (11.0, Noise(4));
    let on_sphere = |u: f64, v: f64| Point3::new(u, v, (radius_mm * radius_mm - u * u - v * v).sqrt());
    let points: Vec<Point3<f64>> =
        (0..60).map(|_| on_sphere(0.6 * noise.unit() - 0.3, 0.6 * noise.unit() - 0.3)).collect();
    let patch = |points: &[Point3<f64>]| {
        let mut vicinity = Vicinity::new();
        vicinity.gather(&PointTree::new(points), &[], &[(on_sphere(0.0, 0.0), [0.0; 3])], 0.5);
        vicinity.patches(1)[0].unwrap()
    };
    let bent = patch(&points);
    let towards = bent.normal().z.signum();
    for height_mm in [-0.3, 0.0, 0.02, 0.5] {
        let p = on_sphere(0.05, -0.02);
        let lifted = p + p.coords.normalize() * height_mm;
        let error = towards * bent.distance_mm(&lifted) - height_mm;
        assert!(error.abs() < 2e-6, "{height_mm}: {error}");
    }
    assert!(
        patch(&points[..10]).distance_mm(&on_sphere(0.0, 0.0)).abs() > 5e-4,
        "ten points carry a plane only"
    );
}
