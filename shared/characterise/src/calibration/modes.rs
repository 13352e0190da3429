//! What a calibration leaves open, as motions of points.
//!
//! The covariance of the parameters of all devices is taken apart into independent modes, each of one standard uncertainty. A mode
//! moves both views of a pair; the same pixels then meet in another point. What a mode does to a feature is found by fitting the moved
//! points again, and the squares of all modes add up: this is the linear propagation, with correlations of parameters and points.

use super::covariance::PARAMETERS;
use super::model::moved;
use fringe::cloud::Point;
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use fringe::geometry::triangulate::point_by_pixels;
use fringe::math::linear::{Dense, pivoted_root};
use nalgebra::{Matrix3x4, Point2, Vector4};
use rayon::prelude::*;

/// What is left of a variance after the modes before it, as a part of it, below which it is rounding.
const ROUNDING: f64 = 1e-10;

/// A mode of the calibration's covariance: what it makes of both views of each pair, in the order of the rig's pairs.
pub struct Mode(Vec<[Camera; 2]>);

/// Points and how they follow what both cameras of their pair see, by the rig file: the same for all modes.
pub struct Followed<'a> {
    points: &'a [Point],
    /// Absent where the rig has no such pair, or a camera does not see the point.
    views: Vec<Option<Views>>,
}

/// What both cameras see of a point.
struct Views {
    pixels: [Point2<f64>; 2],
    /// How the point follows them.
    mm_per_px: Matrix3x4<f64>,
}

impl<'a> Followed<'a> {
    /// Points of a cloud of this rig.
    pub fn new(rig: &Rig, points: &'a [Point]) -> Self {
        let views = |pair: &Pair| Some([rig.device(&pair.left)?, rig.device(&pair.right)?]);
        let pairs: Vec<Option<[&Camera; 2]>> = rig.pairs.iter().map(views).collect();
        let view = |point: &Point| {
            let cameras = (*pairs.get(point.pair as usize)?)?;
            let (pixels, mm_per_px) = point_by_pixels(cameras, &point.position())?;
            Some(Views { pixels, mm_per_px })
        };
        Self { points, views: points.par_iter().map(view).collect() }
    }

    /// The points as they are.
    pub fn points(&self) -> &'a [Point] {
        self.points
    }
}

/// The modes of a covariance of these devices, which lie as `devices` names them with the first `count` of [`PARAMETERS`] each, row by
/// row; `None` where a pair has a view that is not among them, or the matrix has another size.
pub fn modes(rig: &Rig, devices: &[String], count: usize, matrix: &[f64]) -> Option<Vec<Mode>> {
    let size = devices.len() * count;
    if matrix.len() != size * size || count > PARAMETERS.len() {
        return None;
    }
    let place = |name: &str| devices.iter().position(|device| device == name);
    let pairs = rig.pairs.iter().map(|pair| {
        let view = |name: &str| Some((rig.device(name)?, place(name)?));
        Some([view(&pair.left)?, view(&pair.right)?])
    });
    let pairs: Vec<_> = pairs.collect::<Option<_>>()?;
    let mode = |step: Vec<f64>| {
        let state = |(camera, place): (&Camera, usize)| {
            let mut whole = [0.0; PARAMETERS.len()];
            whole[..count].copy_from_slice(&step[place * count..][..count]);
            moved(camera, &whole)
        };
        Mode(pairs.iter().map(|views| views.map(state)).collect())
    };
    let whole = Dense::from_fn(size, size, |i, j| matrix[i * size + j]);
    Some(pivoted_root(&whole, ROUNDING).0.into_iter().map(mode).collect())
}

impl Mode {
    /// The points as this mode moves them; a point without a pair of the rig, or that a camera no longer sees, stays. One step of the
    /// triangulation from where the points are: a mode is small beside the distance of the cameras.
    pub fn moved(&self, followed: &Followed<'_>) -> Vec<Point> {
        let at = |point: &Point, views: &Views| {
            let here = point.position();
            let [left, right] = self.0.get(point.pair as usize)?;
            let off = [views.pixels[0] - left.project(&here)?, views.pixels[1] - right.project(&here)?];
            Some(here + views.mm_per_px * Vector4::new(off[0].x, off[0].y, off[1].x, off[1].y))
        };
        let one = |(point, views): (&Point, &Option<Views>)| {
            let moved = views.as_ref().and_then(|views| at(point, views));
            Point { position_mm: moved.unwrap_or_else(|| point.position()).into(), ..*point }
        };
        followed.points.iter().zip(&followed.views).map(one).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fringe::geometry::camera::{Lens, pose};
    use fringe::geometry::rig::Named;
    use fringe::geometry::triangulate::triangulate;
    use fringe::math::random::{Key, normal_quantile};

    /// All parameters, whether a lens has them or not.
    const COUNT: usize = PARAMETERS.len();

    fn rig() -> Rig {
        let camera = |name: &str, x: f64, turn: f64| {
            let (sin, cos) = fringe::math::sincos(turn);
            let rotation = [[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]];
            let camera = Camera {
                width_px: 1000,
                height_px: 800,
                focal_px: [2000.0; 2],
                principal_point_px: [500.0, 400.0],
                skew: 0.0,
                distortion: Lens::default(),
                camera_from_world: pose(rotation, [-x, 0.0, 500.0]).unwrap(),
            };
            Named { name: name.into(), camera }
        };
        let pair =
            Pair { name: "pair1".into(), left: "a".into(), right: "b".into(), projector: String::new() };
        Rig {
            cameras: vec![camera("a", -80.0, 0.15), camera("b", 80.0, -0.15)],
            pairs: vec![pair],
            ..Rig::default()
        }
    }

    fn at(position_mm: [f64; 3], pair: u32) -> Point {
        Point {
            position_mm,
            normal: [0.0; 3],
            sigma_mm: 0.0,
            modulation: 0.0,
            pair,
            pixel: 0,
            shared_mm: 0.0,
        }
    }

    fn length(points: &[Point]) -> f64 {
        (points[1].position() - points[0].position()).norm()
    }

    /// The modes predict what a thousand drawn calibrations do to a length.
    #[test]
    fn the_modes_predict_the_scatter_of_a_length() {
        let (rig, names) = (rig(), ["a".to_owned(), "b".to_owned()]);
        // Focal lengths and principal points with a correlation of 0.8 between both cameras, and a turn of the second.
        let size = 2 * COUNT;
        let sigmas: Vec<f64> = (0..size)
            .map(|i| {
                if i % COUNT < 4 {
                    0.3
                } else if i == COUNT + 11 {
                    2e-5
                } else {
                    0.0
                }
            })
            .collect();
        let correlation = |i: usize, j: usize| {
            if i == j {
                1.0
            } else if i % COUNT == j % COUNT {
                0.8
            } else {
                0.0
            }
        };
        let matrix: Vec<f64> = (0..size * size)
            .map(|k| correlation(k / size, k % size) * sigmas[k / size] * sigmas[k % size])
            .collect();
        let points = [at([-50.0, -20.0, 5.0], 0), at([40.0, 30.0, -10.0], 0)];
        let modes = modes(&rig, &names, COUNT, &matrix).unwrap();
        assert_eq!(modes.len(), 9, "the parameters that are not certain");
        let followed = Followed::new(&rig, &points);
        let by_mode = |mode: &Mode| length(&mode.moved(&followed)) - length(&points);
        let predicted = modes.iter().map(|mode| by_mode(mode).powi(2)).sum::<f64>().sqrt();

        let whole = Dense::from_fn(size, size, |i, j| matrix[i * size + j]);
        let (columns, key) = (pivoted_root(&whole, ROUNDING).0, Key::new(3));
        let mut squares = 0.0;
        let trials = 1000;
        for trial in 0..trials {
            let draw = |k: usize| normal_quantile(key.open((trial * columns.len() + k) as u64));
            let step: Vec<f64> =
                (0..size).map(|i| columns.iter().enumerate().map(|(k, c)| c[i] * draw(k)).sum()).collect();
            let views = [
                moved(&rig.cameras[0].camera, &step[..COUNT]),
                moved(&rig.cameras[1].camera, &step[COUNT..]),
            ];
            let both = |p: &Point| {
                let pixels = [0, 1].map(|i| rig.cameras[i].camera.project(&p.position()).unwrap());
                let found = triangulate((&views[0], pixels[0]), (&views[1], pixels[1])).unwrap();
                Point { position_mm: found.position_mm.into(), ..*p }
            };
            squares += (length(&points.map(|p| both(&p))) - length(&points)).powi(2);
        }
        let scatter = (squares / trials as f64).sqrt();
        assert!((predicted / scatter - 1.0).abs() < 0.07, "predicted {predicted}, scatter {scatter}");
    }

    /// A point that no pair of the rig saw, or that lies behind a camera, stays where it is.
    #[test]
    fn what_no_pair_sees_stays() {
        let (rig, names) = (rig(), ["a".to_owned(), "b".to_owned()]);
        let size = 2 * COUNT;
        let matrix: Vec<f64> =
            (0..size * size).map(|k| if k / size == k % size { 1e-4 } else { 0.0 }).collect();
        let modes = modes(&rig, &names, COUNT, &matrix).unwrap();
        let points = [at([1.0, 2.0, 0.0], 0), at([1.0, 2.0, 0.0], 1), at([1.0, 2.0, -1e4], 0)];
        let followed = Followed::new(&rig, &points);
        let moved: Vec<Vec<Point>> = modes.iter().map(|mode| mode.moved(&followed)).collect();
        assert!(moved.iter().all(|moved| moved[1..] == points[1..]));
        let moving = moved.iter().filter(|moved| moved[0] != points[0]).count();
        assert!(
            moving >= 8,
            "focal lengths and principal points of both cameras move what they see: {moving}"
        );
    }

    #[test]
    fn a_device_that_is_missing_is_told() {
        let names = ["a".to_owned()];
        assert!(modes(&rig(), &names, COUNT, &vec![0.0; COUNT * COUNT]).is_none());
        assert!(modes(&rig(), &names, COUNT, &[1.0]).is_none());
    }
}
