//! Drafts of plans from the synthetic part: what is there is found, where it is, and always the same.

use super::part::Real;
use crate::inspection::{DraftSettings, Geometry, draft};

const SETTINGS: DraftSettings =
    DraftSettings { within_mm: 0.05, normal_rad: 0.26, min_points: 120, most: 12 };

#[test]
fn planes_cylinders_cone_and_ball_are_found_where_they_are() {
    let cloud = Real { sigma_mm: 0.005, ..Real::default() }.cloud(1);
    let found = draft(&cloud, &SETTINGS);
    let near = |what: &str, fits: &dyn Fn(&Geometry) -> bool| {
        assert!(
            found.iter().any(|f| fits(&f.geometry)),
            "{what} is missing: {:?}",
            found.iter().map(|f| &f.geometry).collect::<Vec<_>>()
        );
    };
    near("top", &|g| {
        matches!(g, Geometry::Plane { point_mm, normal, half_size_mm, .. }
        if normal.z > 0.999 && point_mm.z.abs() < 0.01 && half_size_mm.iter().all(|h| *h > 25.0))
    });
    near("front", &|g| matches!(g, Geometry::Plane { normal, .. } if normal.y < -0.999));
    near(
        "bore",
        &|g| matches!(g, Geometry::Cylinder { radius_mm, internal: true, .. } if (radius_mm - 6.0).abs() < 0.01),
    );
    near(
        "boss",
        &|g| matches!(g, Geometry::Cylinder { radius_mm, internal: false, .. } if (radius_mm - 8.0).abs() < 0.01),
    );
    near("ball", &|g| {
        matches!(g, Geometry::Sphere { radius_mm, center_mm, .. }
        if (radius_mm - 5.0).abs() < 0.02 && (center_mm.x - 40.0).abs() < 0.02)
    });
    near(
        "cone",
        &|g| matches!(g, Geometry::Cone { half_angle_rad, .. } if (half_angle_rad.to_degrees() - 30.0).abs() < 0.2),
    );
    assert_eq!(draft(&cloud, &SETTINGS), found);
}

#[test]
fn nothing_is_found_in_nothing() {
    assert!(draft(&[], &SETTINGS).is_empty());
    let mut cloud = Real::default().cloud(1);
    for point in &mut cloud {
        point.normal = [0.0; 3];
    }
    assert!(draft(&cloud, &SETTINGS).is_empty());
}
