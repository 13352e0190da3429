//! Balls before the dark and before a lit wall, and flat faces that end.

use super::super::marks::{RIM, ends_here};
use super::super::normals::Link;
use super::super::point::View;
use super::super::raster::Raster;
use super::super::rim::mark_missing;
use super::super::{Cause, SurfaceBuilder, SurfaceSettings};
use super::*;
use crate::math::random::{Key, normal_quantile};
use crate::rectify::Directions;
use bytemuck::Zeroable;

const SIDE: usize = 120;
const PITCH: f64 = 1.0 / 2330.0;
const AWAY_MM: f64 = 500.0;
const RADIUS_MM: f64 = 10.0;
/// The other view, as [`View::other_mm`].
const EYE_MM: [f64; 3] = [170.0, 0.0, 15.0];

fn directions() -> Directions {
    let at = |i: usize| [(i % SIDE) as f64, (i / SIDE) as f64].map(|v| (v - 60.3) * PITCH);
    Directions::kept(SIDE, (0..SIDE * SIDE).map(at).collect())
}

/// Depth where the line of sight (x, y, 1) meets the ball; `None` beside it.
fn ball(x: f64, y: f64) -> Option<f64> {
    let (square, to) = (x * x + y * y + 1.0, AWAY_MM);
    let root = to * to - square * (AWAY_MM * AWAY_MM - RADIUS_MM * RADIUS_MM);
    (root > 0.0).then(|| (to - root.sqrt()) / square)
}

/// A face through the middle of the picture, seen under this angle from its normal; `None` beside its borders.
fn face(degrees: f64, x: f64, y: f64) -> Option<f64> {
    let tangent = crate::math::tan(degrees.to_radians());
    // Z = away + x Z tan.
    (x.abs() < 35.0 * PITCH && y.abs() < 40.0 * PITCH).then(|| AWAY_MM / (1.0 - x * tangent))
}

/// A half pipe along y in a plate, whose normal leans towards +x by so many degrees: the near edge hides a part of the wall beneath it. Depth, and
/// the sine of the incidence on the wall, `None` on the plate.
fn half_pipe(degrees: f64, x: f64, y: f64) -> (f64, Option<f64>) {
    let (sin, cos) = (crate::math::sin(degrees.to_radians()), crate::math::cos(degrees.to_radians()));
    // In the plate: u across the pipe, w towards the camera; the eye, and a step of the line of sight.
    let turned = |x: f64, z: f64| [x * cos + z * sin, x * sin - z * cos];
    let ([eye_u, eye_w], [u, w]) = (turned(0.0, -AWAY_MM), turned(x, 1.0));
    let (to_plate, square) = (-eye_w / w, u * u + w * w);
    let inside = (eye_u + to_plate * u).abs() < RADIUS_MM && y.abs() < 40.0 * PITCH;
    if !inside {
        return (to_plate, None);
    }
    let along = eye_u * u + eye_w * w;
    let root = along * along - square * (eye_u * eye_u + eye_w * eye_w - RADIUS_MM * RADIUS_MM);
    let depth = (root.sqrt() - along) / square;
    let [on_u, on_w] = [eye_u + depth * u, eye_w + depth * w];
    let cosine = (on_u * u + on_w * w) / (RADIUS_MM * (square + y * y).sqrt());
    (depth, Some((1.0 - cosine * cosine).sqrt()))
}

/// Samples of what is seen, with noise of some hundredths of a pixel; phases end where there is nothing, and jump with the depth.
fn samples(directions: &Directions, depth: impl Fn(f64, f64) -> Option<f64>, reach: f64) -> Vec<Sample> {
    let depths: Vec<Option<f64>> =
        (0..SIDE * SIDE).map(|i| directions.at(i)).map(|[x, y]| depth(x, y)).collect();
    let phases: Vec<f32> = depths.iter().map(|depth| depth.map_or(f32::NAN, |z| z as f32)).collect();
    let [mut missing, mut borders, mut limbs] = [0; 3].map(|_| vec![0; phases.len()]);
    mark_missing((SIDE, &phases), 3.0, &mut missing);
    let (certain, reach) = (vec![0.0; phases.len()], Reach { limb: reach, rim: 0 });
    mark_limbs((SIDE, &phases, &certain), (reach, 3.0), &missing, &mut borders, (OWN, &mut limbs));
    let sample = |i: usize| {
        let Some(depth) = depths[i] else { return Sample::NONE };
        let noise = 2e-8 * normal_quantile(Key::new(5).open(i as u64));
        let inverse_depth = 1.0 / depth + noise;
        Sample {
            inverse_depth,
            sigma: 2e-8,
            own_share: 0.7,
            modulation: 1.0,
            limbs: limbs[i],
            cause: Cause::Point,
        }
    };
    (0..depths.len()).map(sample).collect()
}

fn view(directions: &Directions) -> View<'_> {
    View { other_mm: Vector3::from(EYE_MM), ..View::along_the_axes([SIDE, SIDE], directions, PITCH) }
}

/// What becomes of each pixel.
fn causes(directions: &Directions, samples: &[Sample]) -> Vec<Cause> {
    let mut builder = SurfaceBuilder::new(SIDE, SIDE, SurfaceSettings::default());
    builder.load(samples);
    let report = builder.build(&view(directions), 0, &mut vec![Zeroable::zeroed(); samples.len()]);
    let causes = builder.causes().to_vec();
    let steep = causes.iter().filter(|cause| **cause == Cause::Steep).count();
    assert_eq!(report.steep as usize, steep);
    causes
}

/// Distance of a place on the ball from the limb in the picture of a camera, px.
fn to_limb_px(place: Vector3<f64>, eye: Vector3<f64>) -> f64 {
    let (to, middle) = (place - eye, Vector3::new(0.0, 0.0, AWAY_MM) - eye);
    let off = to.cross(&middle).norm() / (to.norm() * middle.norm());
    (RADIUS_MM / middle.norm() - off) / PITCH
}

#[test]
fn marks_are_those_of_all_pixels_compared() {
    let mut found = Vec::new();
    let sizes = [(23, 17, 2.5), (75, 40, 4.3), (64, 33, 5.5), (41, 5, 8.0), (3, 9, 7.9), (5 * TILE, 9, 4.3)];
    for (width, height, reach) in sizes {
        let draw = |i: usize| (400.0 * Key::new(3).open(i as u64)) as usize;
        // Of the widest one, one tile is dark, and one is far from a border.
        let value = |i: usize| match (draw(i), i % width) {
            (0, 0..TILE) | (_, TILE..=270) => f32::NAN,
            (1, 0..TILE) => 50.0,
            (2, 0..TILE) => i as f32 * 1e-3 + 0.4,
            _ => i as f32 * 1e-3,
        };
        let values: Vec<f32> = (0..width * height).map(value).collect();
        let missing: Vec<u8> = values.iter().map(|value| u8::from(value.is_nan())).collect();
        // With the noise of every third pixel its small bends are none.
        let sigmas: Vec<f32> = (0..values.len()).map(|i| if i % 3 == 0 { 0.01 } else { 0.0 }).collect();
        let at = |i: usize| [(i % width) as i64, (i / width) as i64];
        let apart = |a: usize, b: usize| {
            let ([ax, ay], [bx, by]) = (at(a), at(b));
            (ax - bx) * (ax - bx) + (ay - by) * (ay - by)
        };
        let all = || 0..width * height;
        let jumps = |a: usize| all().any(|b| apart(a, b) == 1 && (values[a] - values[b]).abs() > 5.0);
        let bends = |i: usize| {
            let [x, y] = at(i);
            if x == 0 || y == 0 || x as usize == width - 1 || y as usize == height - 1 {
                return false;
            }
            let [[left, right], [up, down]] =
                [[i - 1, i + 1], [i - width, i + width]].map(|pair| pair.map(|j| f64::from(values[j])));
            let second = |a: f64, b: f64| (a + b - 2.0 * f64::from(values[i])).abs();
            second(left, right).max(second(up, down))
                > f64::from(BEND) * ((right - left).abs() + (down - up).abs())
                    + f64::from(BEND_SIGMAS * sigmas[i])
        };
        let ends: Vec<usize> = all().filter(|i| missing[*i] != 0 || jumps(*i)).collect();
        let bends: Vec<usize> = all().filter(|i| bends(*i)).collect();
        let (mut borders, mut marks) = (vec![7; width * height], vec![RIM; width * height]);
        let seen = (width, &values[..], &sigmas[..]);
        mark_limbs(seen, (Reach { limb: reach, rim: 2 }, 5.0), &missing, &mut borders, (OTHER, &mut marks));
        for i in all() {
            let near = |border: &[usize], reach: f64| {
                border.iter().any(|end| (apart(i, *end) as f64) < reach * reach)
            };
            let mark = |near: bool, mark: u8| if near { mark } else { 0 };
            let wanted = RIM
                | mark(near(&ends, reach), OTHER)
                | mark(near(&bends, reach), OTHER << BENT)
                | mark(near(&bends, 1.5), OTHER << SPLIT);
            assert_eq!(marks[i], wanted, "pixel {i} of {width} columns");
        }
        found.extend(marks);
    }
    for marks in [0, OTHER, OTHER << BENT, OTHER | OTHER << BENT, OTHER << BENT | OTHER << SPLIT] {
        assert!(found.contains(&(RIM | marks)), "{marks}");
    }
}

#[test]
fn the_reach_grows_with_the_blur() {
    let footprint = |sigma, field_px2| Footprint { sigma_px: [sigma, 0.4], u_px: None, field_px2 };
    assert!((reach_px(Some(footprint(0.5, 0.0))) - 4.5).abs() < 1e-12);
    // In the corner 0.25 + 0.12 · 2/3.
    assert!((reach_px(Some(footprint(0.5, 0.12))) - 2.5 - 4.0 * 0.33_f64.sqrt()).abs() < 1e-12);
    assert!(reach_px(None) > 5.0 && reach_px(Some(footprint(3.0, 0.0))) <= MOST_PX as f64);
}

/// The turn of the normal tells the distance of the limb of a ball in either picture, and that a face has none.
#[test]
fn the_limb_is_where_the_turn_of_the_normal_leads() {
    let directions = directions();
    let (settings, gaps) = (SurfaceSettings::default(), vec![0; SIDE * SIDE]);
    let distances = |samples: &[Sample], eye: Vector3<f64>| -> Vec<Option<(usize, Option<f64>)>> {
        let (view, raster) = (view(&directions), Raster::from(samples));
        let link = Link { max_step: 5.67 * PITCH };
        let selector = Selector {
            view: &view,
            samples: &raster,
            link,
            excess: 1.0,
            settings: &settings,
            min_cosine: 0.34,
            gaps: &gaps,
        };
        let pixels = (0..SIDE * SIDE).filter(|i| samples[*i].inverse_depth.is_finite());
        pixels
            .map(|i| {
                Some((
                    i,
                    selector.limb_px(
                        (i, &samples[i]),
                        &normal(&view, &raster, i, link, (2, false))?,
                        BALL,
                        eye,
                    ),
                ))
            })
            .collect()
    };
    let seen = samples(&directions, ball, 5.0);
    for eye in [Vector3::zeros(), Vector3::from(EYE_MM)] {
        let mut asked = 0;
        for (pixel, found) in distances(&seen, eye).into_iter().flatten() {
            let [x, y] = directions.at(pixel);
            let place = Vector3::new(x, y, 1.0) / seen[pixel].inverse_depth;
            let (own, truth) = (to_limb_px(place, Vector3::zeros()), to_limb_px(place, eye));
            if own > 3.5 && (2.0..12.0).contains(&truth) {
                let found = found.unwrap();
                assert!((found - truth).abs() < 0.25 * truth + 0.5, "{found} instead of {truth} px");
                asked += 1;
            }
        }
        assert!(asked > 300, "{asked}");
    }
    for degrees in [30.0, 55.0, 67.0] {
        let seen = samples(&directions, |x, y| face(degrees, x, y), 5.0);
        let nearest = |eye| {
            let found = distances(&seen, eye).into_iter().flatten().filter_map(|(_, found)| found);
            found.fold(f64::INFINITY, f64::min)
        };
        let nearest = nearest(Vector3::zeros()).min(nearest(Vector3::from(EYE_MM)));
        assert!(nearest > 2.0 * LIMB_PX, "{degrees}°: {nearest} px");
    }
}

#[test]
fn a_ball_loses_its_limb_before_the_dark_and_before_a_wall() {
    let directions = directions();
    let wall = |x: f64, y: f64| ball(x, y).or(Some(AWAY_MM + 30.0));
    for (reach, before_dark) in [(4.3, true), (5.5, true), (4.3, false), (5.5, false)] {
        let seen =
            if before_dark { samples(&directions, ball, reach) } else { samples(&directions, wall, reach) };
        let causes = causes(&directions, &seen);
        let (mut near, mut inside) = (0, 0);
        for (pixel, cause) in causes.iter().enumerate() {
            let [x, y] = directions.at(pixel);
            let Some(depth) = ball(x, y) else { continue };
            let place = Vector3::new(x, y, 1.0) * depth;
            let (own, other) =
                (to_limb_px(place, Vector3::zeros()), to_limb_px(place, Vector3::from(EYE_MM)));
            // A border is where a pixel's middle is beyond it; beside a jump, the last pixel of the ball.
            if own < reach - 1.0 {
                near += 1;
                assert_ne!(*cause, Cause::Point, "{own} px from the limb");
            } else if own > reach + 1.0 && other > 2.0 * LIMB_PX {
                inside += 1;
                assert_eq!(*cause, Cause::Point, "{own} px from the limb");
            }
        }
        assert!(near > 500 && inside > 1500, "{near} {inside}");
    }
}

/// A bowl turns away towards the edge that hides the rest of its wall, as a ball does towards its limb; its other end is seen nearly frontally.
#[test]
fn the_wall_of_a_bowl_ends_at_the_edge_that_hides_it() {
    let directions = directions();
    for degrees in [14.0, 20.0] {
        let depth = |x, y| Some(half_pipe(degrees, x, y).0);
        let seen = samples(&directions, depth, 5.0);
        let causes = causes(&directions, &seen);
        let wall = |pixel: usize| {
            let [x, y] = directions.at(pixel);
            half_pipe(degrees, x, y).1.filter(|_| y.abs() < 30.0 * PITCH)
        };
        let (mut hidden, mut open) = (0, 0);
        for (pixel, cause) in causes.iter().enumerate() {
            let Some(sine) = wall(pixel) else { continue };
            // The edge in the same row: the first pixel of the plate beside the steep end of the wall.
            let edge = (1..8).find(|away| wall(pixel - away).is_none() || wall(pixel + away).is_none());
            match edge {
                Some(away) if sine > 0.9 && away < 4 => {
                    hidden += 1;
                    assert_ne!(*cause, Cause::Point, "{away} px from the edge, sine {sine}");
                }
                None if sine < 0.6 => {
                    open += 1;
                    assert_eq!(*cause, Cause::Point, "sine {sine}");
                }
                _ => {}
            }
        }
        assert!(hidden > 100 && open > 800, "{degrees}°: {hidden} {open}");
    }
}

/// Marks that came with the match say that the limb of the other camera is near.
#[test]
fn the_limb_of_the_other_camera_counts_too() {
    let directions = directions();
    let mut seen = samples(&directions, ball, 0.5);
    let eye = Vector3::from(EYE_MM);
    let mut wanted = Vec::new();
    for (pixel, sample) in seen.iter_mut().enumerate().filter(|(_, sample)| sample.cause == Cause::Point) {
        let [x, y] = directions.at(pixel);
        let place = Vector3::new(x, y, 1.0) / sample.inverse_depth;
        let (own, other) = (to_limb_px(place, Vector3::zeros()), to_limb_px(place, eye));
        sample.limbs = if other < 5.0 { OTHER } else { 0 };
        if own > 6.0 && other > 0.0 {
            wanted.push((pixel, other < 5.0));
        }
    }
    let causes = causes(&directions, &seen);
    assert!(wanted.iter().filter(|(_, dropped)| *dropped).count() > 100);
    for (pixel, dropped) in wanted {
        assert_eq!(causes[pixel] == Cause::Steep, dropped, "pixel {pixel}");
    }
}

/// Proves: what bends in one picture alone ends there, within the reach of a rim; a crease, which both show, does not.
#[test]
fn a_bend_that_one_picture_alone_shows_is_a_rim() {
    let both = OWN << BENT | OTHER << BENT;
    for (marks, ends) in [
        (0, false),
        (OWN | OTHER, false),
        (RIM | both, false),
        (OTHER << BENT, false),
        (OTHER << BENT | OTHER << SPLIT, true),
        (OWN << BENT | OWN << SPLIT, true),
        (both | OTHER << SPLIT, false),
        (both | OWN << SPLIT | OTHER << SPLIT, false),
    ] {
        assert_eq!(ends_here(marks), ends, "{marks:b}");
    }
}

/// Steep faces that end lose what `edge_px` takes, and balls far away in noise lose nothing more either.
#[test]
fn flat_faces_and_noisy_balls_keep_their_points() {
    let directions = directions();
    for degrees in [0.0, 50.0, 60.0, 67.0] {
        let seen = samples(&directions, |x, y| face(degrees, x, y), 6.5);
        let causes = causes(&directions, &seen);
        assert!(seen.iter().filter(|sample| sample.limbs != 0).count() > 1000);
        assert!(!causes.contains(&Cause::Steep), "{degrees}°");
        let points = causes.iter().filter(|cause| **cause == Cause::Point).count();
        assert!(points > 60 * 70, "{degrees}°: {points}");
    }
    let mut noisy = samples(&directions, ball, 5.5);
    for sample in &mut noisy {
        sample.sigma = 3e-6;
    }
    let count =
        |samples: &[Sample]| causes(&directions, samples).iter().filter(|c| **c == Cause::Point).count();
    let unmarked: Vec<Sample> = noisy.iter().map(|sample| Sample { limbs: 0, ..*sample }).collect();
    assert_eq!(count(&noisy), count(&unmarked));
}
