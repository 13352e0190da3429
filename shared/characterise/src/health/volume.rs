//! What a drift of a view does to the lengths that a pair measures, anywhere that both views see.

use super::state::{Partner, UNKNOWNS, stepped};
use fringe::geometry::camera::Camera;
use fringe::geometry::triangulate::triangulate;
use nalgebra::{Point2, Point3, Vector3};

/// Lengths that are asked for, mm; in a smaller field halves of it, until they fit.
const LENGTH_MM: f64 = 100.0;
/// The shortest of them, mm.
const LEAST_MM: f64 = 0.5;
/// Fewer bars than this are no volume.
const LEAST_BARS: usize = 30;
/// So many matches tell how far the object is.
const PLACES: usize = 300;
/// Places of the bars' middles along each side of the picture.
const GRID: u32 = 5;
/// Steps of the derivatives: rad, mm, relative.
const STEPS: [f64; UNKNOWNS] = [1e-5, 1e-5, 1e-5, 5e-3, 5e-3, 5e-3, 1e-5];

/// Derivatives of a length by the drift, over the length: of bars in thirteen directions, among them along the depth, all over the
/// picture and from the nearest to the farthest place of the object. The object's own lengths would say less: they leave out what it does
/// not fill.
pub(super) fn lengths(partner: &Partner, view: &Camera) -> Vec<[f64; UNKNOWNS]> {
    let middles = middles(partner, view);
    let states: Vec<Camera> = (0..UNKNOWNS)
        .map(|k| stepped(view, &std::array::from_fn(|i| if i == k { STEPS[k] } else { 0.0 })))
        .collect();
    let mut length_mm = LENGTH_MM;
    while length_mm > LEAST_MM {
        let arms: Vec<Vector3<f64>> = directions().map(|d| d * (0.5 * length_mm)).collect();
        let bars = middles.iter().flat_map(|middle| arms.iter().map(move |arm| [middle - arm, middle + arm]));
        let found: Vec<_> = bars.filter_map(|ends| relative(partner.fixed, view, &states, ends)).collect();
        if found.len() >= LEAST_BARS {
            return found;
        }
        length_mm *= 0.5;
    }
    Vec::new()
}

/// Thirteen directions in the frame of the view: of each and its opposite one.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    (14..27).map(|i| Vector3::new(i / 9 - 1, i / 3 % 3 - 1, i % 3 - 1).cast::<f64>().normalize())
}

/// Middles of the bars: rays of the view at the nearest, the middle and the farthest depth of the object.
fn middles(partner: &Partner, view: &Camera) -> Vec<Point3<f64>> {
    let stride = partner.matches.len().div_ceil(PLACES).max(1);
    let met = |m: &super::Match| Some(triangulate((partner.fixed, m.left), (view, m.right))?.position_mm);
    let depth = |p: Point3<f64>| (view.camera_from_world * p).z;
    let mut depths: Vec<f64> =
        partner.matches.iter().step_by(stride).filter_map(met).map(depth).filter(|z| z.is_finite()).collect();
    depths.sort_by(f64::total_cmp);
    let Some(last) = depths.len().checked_sub(1) else { return Vec::new() };
    // The outermost places may be wrong matches.
    let layers = [last / 50, last / 2, last - last / 50].map(|at| depths[at]);
    let size = [view.width_px, view.height_px].map(f64::from);
    let along = |k: u32, side: f64| (f64::from(k) + 0.5) / f64::from(GRID) * side - 0.5;
    let pixels = (0..GRID * GRID).map(|k| Point2::new(along(k % GRID, size[0]), along(k / GRID, size[1])));
    let rays = pixels.filter_map(|pixel| view.ray(pixel)).collect::<Vec<_>>();
    let at = |z: f64, ray: &fringe::geometry::camera::Ray| {
        let slant = (view.camera_from_world.rotation * ray.direction).z;
        ray.origin_mm + ray.direction * (z / slant)
    };
    layers.iter().flat_map(|z| rays.iter().map(|ray| at(*z, ray)).collect::<Vec<_>>()).collect()
}

/// Derivatives of a length over the length; `None` where a view does not see both ends.
fn relative(
    fixed: &Camera,
    view: &Camera,
    states: &[Camera],
    ends: [Point3<f64>; 2],
) -> Option<[f64; UNKNOWNS]> {
    let seen = |camera: &Camera, p: &Point3<f64>| camera.project(p).filter(|at| camera.contains(*at));
    let pixels =
        [(seen(fixed, &ends[0])?, seen(view, &ends[0])?), (seen(fixed, &ends[1])?, seen(view, &ends[1])?)];
    let length = |camera: &Camera| {
        let at = |k: usize| Some(triangulate((fixed, pixels[k].0), (camera, pixels[k].1))?.position_mm);
        Some((at(0)? - at(1)?).norm())
    };
    let from = length(view)?;
    let mut by = [0.0; UNKNOWNS];
    for ((by, state), step) in by.iter_mut().zip(states).zip(STEPS) {
        *by = (length(state)? / from - 1.0) / step;
    }
    by.iter().all(|by| by.is_finite()).then_some(by)
}
