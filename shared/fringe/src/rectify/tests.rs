use super::*;
use crate::geometry::camera::Lens;
use nalgebra::{Isometry3, UnitQuaternion};

fn camera(centre: [f64; 3], roll: f64) -> Camera {
    let eye = Point3::from(centre);
    let look = Isometry3::from_parts(
        nalgebra::Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll),
    );
    // look_at_rh looks along −z with y up: half a turn about x makes it z forward, y down.
    let forward = Isometry3::rotation(Vector3::x() * std::f64::consts::PI);
    Camera {
        width_px: 320,
        height_px: 240,
        focal_px: [700.0, 702.0],
        principal_point_px: [155.0, 122.0],
        skew: 0.2,
        distortion: Lens::brown_conrady([-0.1, 0.05, 0.01], [3e-4, -2e-4]),
        camera_from_world: look * forward * Isometry3::look_at_rh(&eye, &Point3::origin(), &Vector3::y()),
    }
}

#[test]
fn both_views_agree_on_the_ordinate_and_their_disparity_is_baseline_over_depth() {
    for (offset, roll) in
        [([110.0, 6.0, 480.0], 0.1), ([5.0, 110.0, 500.0], 0.0), ([-110.0, 0.0, 490.0], -0.2)]
    {
        let (left, right) = (camera([-offset[0], 3.0, 500.0], 0.05), camera(offset, roll));
        let pair = Rectification::new(&left, &right).unwrap();
        for world in [[20.0, -10.0, 30.0], [-25.0, 30.0, -20.0], [0.0, 0.0, 0.0]] {
            let world = Point3::from(world);
            let l = pair.left.rectified_from_pixel(left.project(&world).unwrap()).unwrap();
            let r = pair.right.rectified_from_pixel(right.project(&world).unwrap()).unwrap();
            assert!((l[1] - r[1]).abs() < 1e-12, "rows differ: {l:?} {r:?}");
            let depth = pair.baseline_mm / (l[0] - r[0]);
            let again = pair.origin_mm + pair.world_from_rectified * Vector3::new(l[0], l[1], 1.0) * depth;
            assert!((again - world).norm() < 1e-8, "{world} came back as {again}");
        }
    }
}

#[test]
fn a_curve_is_the_forward_model_and_its_tangent_the_derivative() {
    let (left, right) = (camera([-100.0, 0.0, 500.0], 0.1), camera([100.0, 20.0, 480.0], -0.1));
    let pair = Rectification::new(&left, &right).unwrap();
    let pixel = Point2::new(201.5, 33.25);
    let [x, y] = pair.right.rectified_from_pixel(pixel).unwrap();
    let here = pair.right.curve(y).at(x);
    assert!((here.pixel[0] - pixel.x).abs() < 1e-9 && (here.pixel[1] - pixel.y).abs() < 1e-9);
    let h = 1e-6;
    let (low, high) = (pair.right.curve(y).at(x - h), pair.right.curve(y).at(x + h));
    for axis in 0..2 {
        let numeric = (high.pixel[axis] - low.pixel[axis]) / (2.0 * h);
        assert!((numeric - here.tangent[axis]).abs() < 1e-5 * numeric.abs().max(1.0));
    }
}

#[test]
fn a_grid_cell_names_the_nearest_pixel() {
    let (left, right) = (camera([-100.0, 0.0, 500.0], 0.0), camera([100.0, 0.0, 500.0], 0.0));
    let pair = Rectification::new(&left, &right).unwrap();
    let table = pair.right.table();
    let (low, high) = range(&table, 1).unwrap();
    let height = ((high - low) * pair.focal_px) as usize + 1;
    let grid = RectifiedGrid::new(&pair.right, &table, pair.focal_px, low, height).unwrap();
    let mut seen = 0;
    for row in (0..height).step_by(7) {
        for column in (0..grid.width).step_by(5) {
            let index = grid.index[row * grid.width + column];
            if index == NO_PIXEL {
                continue;
            }
            seen += 1;
            let cell = [grid.abscissa(column as f64), grid.y0 + row as f64 / grid.focal_px];
            let [x, y] = table[index as usize];
            let distance = (x - cell[0]).hypot_px(y - cell[1]) * pair.focal_px;
            assert!(distance < 0.85, "cell ({column}, {row}) is {distance} px from its pixel");
        }
    }
    assert!(seen > 1000, "only {seen} cells");
}

trait HypotPx {
    fn hypot_px(self, other: f64) -> f64;
}
impl HypotPx for f64 {
    fn hypot_px(self, other: f64) -> f64 {
        (self * self + other * other).sqrt()
    }
}

#[test]
fn impossible_pairs_are_refused() {
    let left = camera([0.0, 0.0, 500.0], 0.0);
    assert!(matches!(Rectification::new(&left, &left), Err(RectifyError::NoBaseline { .. })));
    let ahead = camera([0.0, 0.0, 400.0], 0.0);
    assert!(matches!(Rectification::new(&left, &ahead), Err(RectifyError::EpipoleInView { .. })));
    let behind = camera([10.0, 0.0, -500.0], 0.0);
    assert!(matches!(Rectification::new(&left, &behind), Err(RectifyError::Opposed { .. })));
}
