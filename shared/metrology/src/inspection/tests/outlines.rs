//! Outlines of clouds of cameras, which end before the surface does.

use bytemuck::Zeroable;
use fringe::cloud::Point;
use fringe::math::{cos, hypot, sin};

use crate::inspection::{Plan, evaluate};

const HOLE: &str = r#"
format = "fringecell-plan/1"
name = "plate"

[[element]]
kind = "circle"
name = "hole"
center_mm = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]
diameter_mm = 20.0
band_mm = 4.0
margin_mm = 1.0
min_points = 500

[[feature]]
kind = "size"
name = "diameter"
element = "hole"
tolerance_mm = [-0.5, 0.5]
"#;

/// What pairs see of a plate with a hole of 20 mm, `pixel_mm` apart; each leaves out what lies within two pixels of the hole.
fn seen(pairs: u32, pixel_mm: f64) -> Vec<Point> {
    let half = (16.0 / pixel_mm) as i32;
    let mut points = Vec::new();
    for pair in 0..pairs {
        let (turn, shift) = (0.3 + f64::from(pair), 0.4 * f64::from(pair));
        let at = |u: i32, v: i32| {
            let (u, v) = (pixel_mm * (f64::from(u) + shift), pixel_mm * f64::from(v));
            [u * cos(turn) - v * sin(turn), u * sin(turn) + v * cos(turn), 0.0]
        };
        let is_hole = |u: i32, v: i32| {
            let [x, y, _] = at(u, v);
            hypot(x, y) < 10.0
        };
        for (u, v) in (-half..=half).flat_map(|v| (-half..=half).map(move |u| (u, v))) {
            if !(-2..=2).any(|a| (-2..=2).any(|b| is_hole(u + a, v + b))) {
                let (normal, sigma_mm) = ([0.0, 0.0, 1.0], 0.01);
                points.push(Point { position_mm: at(u, v), normal, sigma_mm, pair, ..Point::zeroed() });
            }
        }
    }
    points
}

/// Few and many points, which are thinned until the element is placed, of one pair and of two that see the same.
#[test]
fn a_hole_has_its_size_however_many_pixels_and_pairs_see_it() {
    let plan = Plan::from_toml(HOLE).unwrap().with_rims_left_out(2);
    for (pairs, pixel_mm) in [(1, 0.25), (2, 0.25), (1, 0.08), (2, 0.08)] {
        let result = evaluate(&plan, &seen(pairs, pixel_mm));
        let feature = &result.features[0];
        let off = feature.value.unwrap_or_else(|| panic!("{pairs}, {pixel_mm}: {feature:?}")) - 20.0;
        let u = feature.u.unwrap();
        assert!(off.abs() < u, "{pairs} pairs, {pixel_mm} mm a pixel: off by {off}, u {u}");
        // Twice 0.58 pixels of a side.
        assert!((1.1..1.5).contains(&(u / pixel_mm)), "{pairs} pairs, {pixel_mm} mm a pixel: u {u}");
    }
}

/// Nothing is known of what a cloud of another program leaves out.
#[test]
fn a_cloud_that_says_nothing_is_taken_as_it_is() {
    let result = evaluate(&Plan::from_toml(HOLE).unwrap(), &seen(1, 0.25));
    assert!(result.features[0].value.unwrap() > 20.0 + 2.0 * 2.0 * 0.25, "{:?}", result.features[0]);
}
