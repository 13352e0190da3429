//! Finds the points of an element among those of others: consensus of minimal samples, with a fixed seed.
//!
//! A region cut out by hand holds posts, edges and neighbours beside the surface that is meant. Minimal samples (three
//! points for a plane, four for a sphere) are drawn by a counter, so the same cloud gives the same points; the element
//! that most points agree on is fitted to those points until the choice stands still (Fischler & Bolles 1981).

use nalgebra::{Matrix3, Point3, Vector3};

use super::{FitError, FitSettings, plane, sphere, sphere_of_diameter};
use crate::spread::Spread;
use fringe::math::random::Key;

/// Samples drawn. With a third of the points on a sphere, one sample in 81 is clean: some fifty are.
const SAMPLES: u64 = 4000;

/// Points used by the search: it needs the approximate place of an element only.
const VOTERS: usize = 1500;

/// Rounds of fit and choice; each takes points within the margin, so the choice settles within a few.
const ROUNDS: usize = 30;

/// An approximate element through a few points.
#[derive(Debug, Clone, Copy)]
enum Rough {
    Plane { normal: Vector3<f64>, offset: f64 },
    Sphere { center: Vector3<f64>, radius: f64 },
}

impl Rough {
    fn holds(&self, point: &Vector3<f64>, margin_mm: f64) -> bool {
        let distance = match self {
            Self::Plane { normal, offset } => normal.dot(point) - offset,
            Self::Sphere { center, radius } => (point - center).norm() - radius,
        };
        distance.abs() <= margin_mm
    }
}

/// Marks the points within `margin_mm` of the plane that most points agree on.
///
/// # Errors
/// A margin that is not positive, fewer than 4 points, no plane through them; see [`FitError`].
pub fn find_plane(points: &[Point3<f64>], margin_mm: f64) -> Result<Vec<bool>, FitError> {
    find("plane", points, margin_mm, &through_three, &|chosen| {
        let fit = plane(chosen, &FitSettings::default())?;
        Ok(Rough::Plane { normal: fit.normal_vector(), offset: fit.offset_mm })
    })
}

/// Marks the points within `margin_mm` of the sphere, of the given diameter or of a radius up to the extent of the
/// points, that most points agree on.
///
/// # Errors
/// A margin that is not positive, fewer than 5 points, no sphere through them; see [`FitError`].
pub fn find_sphere(
    points: &[Point3<f64>],
    diameter_mm: Option<f64>,
    margin_mm: f64,
) -> Result<Vec<bool>, FitError> {
    // A sphere much larger than the region would pass for any flat patch in it.
    let extent_mm = extent_mm(points);
    let sized = |rough: &Rough| match (rough, diameter_mm) {
        (Rough::Sphere { radius, .. }, Some(diameter)) => (radius - 0.5 * diameter).abs() <= margin_mm,
        (Rough::Sphere { radius, .. }, None) => *radius <= extent_mm,
        _ => true,
    };
    find("sphere", points, margin_mm, &|four| through_four(four).filter(sized), &|chosen| {
        let settings = FitSettings::default();
        let fit = match diameter_mm {
            Some(diameter) => sphere_of_diameter(chosen, diameter, &settings)?,
            None => sphere(chosen, &settings)?,
        };
        Ok(Rough::Sphere { center: fit.center().coords, radius: 0.5 * fit.diameter_mm })
    })
}

fn find(
    element: &'static str,
    points: &[Point3<f64>],
    margin_mm: f64,
    through: &impl Fn([Vector3<f64>; 4]) -> Option<Rough>,
    refit: &impl Fn(&[Point3<f64>]) -> Result<Rough, FitError>,
) -> Result<Vec<bool>, FitError> {
    if !(margin_mm > 0.0 && margin_mm.is_finite()) {
        return Err(FitError::Setting {
            key: "margin_mm", value: margin_mm, limits: "0 … ∞, zero excluded"
        });
    }
    if points.len() < 5 {
        return Err(FitError::TooFewPoints { element, points: points.len(), needs: 5 });
    }
    let spread = Spread::of(points.len(), VOTERS);
    let voters: Vec<Vector3<f64>> = spread.indices().map(|i| points[i].coords).collect();
    let key = Key::new(0);
    let mut best: Option<(usize, Rough)> = None;
    for sample in 0..SAMPLES {
        let pick = |k: u64| voters[(key.bits(4 * sample + k) % voters.len() as u64) as usize];
        let Some(rough) = through([pick(0), pick(1), pick(2), pick(3)]) else { continue };
        let votes = voters.iter().filter(|p| rough.holds(p, margin_mm)).count();
        if best.is_none_or(|(most, _)| votes > most) {
            best = Some((votes, rough));
        }
    }
    let nothing = FitError::Degenerate { element, why: "no sample of them gives one of that size" };
    let mut rough = best.ok_or(nothing)?.1;
    let mut chosen = Vec::new();
    for _ in 0..ROUNDS {
        let next: Vec<bool> = points.iter().map(|p| rough.holds(&p.coords, margin_mm)).collect();
        if next == chosen {
            break;
        }
        chosen = next;
        let held = points.iter().zip(&chosen).filter(|(_, held)| **held).map(|(p, _)| *p);
        rough = refit(&held.collect::<Vec<_>>())?;
    }
    Ok(chosen)
}

/// Largest edge of the bounding box, mm.
fn extent_mm(points: &[Point3<f64>]) -> f64 {
    let low = points.iter().fold(Vector3::repeat(f64::INFINITY), |low, p| low.inf(&p.coords));
    let high = points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), |high, p| high.sup(&p.coords));
    (high - low).max()
}

/// The plane through the first three points.
fn through_three([a, b, c, _]: [Vector3<f64>; 4]) -> Option<Rough> {
    let normal = (b - a).cross(&(c - a));
    let length = normal.norm();
    let unit = normal / length;
    unit.iter().all(|v| v.is_finite()).then(|| Rough::Plane { normal: unit, offset: unit.dot(&a) })
}

/// The sphere through four points: 2 (pᵢ − p₀) · (c − p₀) = |pᵢ − p₀|².
fn through_four([a, b, c, d]: [Vector3<f64>; 4]) -> Option<Rough> {
    let arms = [b - a, c - a, d - a];
    let matrix = Matrix3::from_rows(&arms.map(|arm| arm.transpose()));
    let half_squares = Vector3::from(arms.map(|arm| 0.5 * arm.norm_squared()));
    let to_center = matrix.try_inverse()? * half_squares;
    let radius = to_center.norm();
    radius.is_finite().then(|| Rough::Sphere { center: a + to_center, radius })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Noise;

    /// A ball of 22 mm (a third of the points) on a post over a plate: what a --near ball cuts out.
    fn ball_on_post() -> (Vec<Point3<f64>>, usize) {
        let mut noise = Noise(5);
        let mut points = Vec::new();
        while points.len() < 3000 {
            let direction = noise.direction();
            if direction.z > -0.3 {
                points.push(Point3::from(direction * (11.0 + 0.02 * noise.normal())));
            }
        }
        let ball = points.len();
        for _ in 0..2000 {
            let (sin, cos) = fringe::math::sincos(6.3 * noise.uniform());
            points.push(Point3::new(4.0 * cos, 4.0 * sin, -10.5 - 8.0 * noise.uniform()));
        }
        for _ in 0..4000 {
            let place = [30.0 * noise.uniform() - 15.0, 30.0 * noise.uniform() - 15.0];
            points.push(Point3::new(place[0], place[1], -19.0 + 0.02 * noise.normal()));
        }
        (points, ball)
    }

    #[test]
    fn a_ball_and_a_plate_are_told_from_what_stands_beside_them() {
        let (points, ball) = ball_on_post();
        let kept = |held: &[bool]| -> Vec<Point3<f64>> {
            points.iter().zip(held).filter(|(_, h)| **h).map(|(p, _)| *p).collect()
        };
        for diameter in [None, Some(22.0)] {
            let held = find_sphere(&points, diameter, 0.15).unwrap();
            assert!(held[..ball].iter().all(|h| *h), "a point of the ball was left out");
            assert!(held[ball..].iter().filter(|h| **h).count() < 30);
            let fit = sphere(&kept(&held), &FitSettings::default()).unwrap();
            assert!((fit.diameter_mm - 22.0).abs() < 0.01 && fit.center().coords.amax() < 0.01);
        }
        let held = find_plane(&points, 0.15).unwrap();
        assert!(held[5000..].iter().all(|h| *h) && held[..ball].iter().all(|h| !*h));
        let fit = plane(&kept(&held), &FitSettings::default()).unwrap();
        assert!((fit.offset_mm + 19.0).abs() < 0.01, "{}", fit.offset_mm);
    }

    /// Every 20th point of such a grid stands in one column: planes through it hold as well as the right one.
    #[test]
    fn the_rows_of_a_grid_do_not_mislead_the_search() {
        let place = |i: i32| [0.02 * f64::from(i % 20), 0.02 * f64::from(i / 20)];
        let plate = (0..30_000).map(place).map(|[x, y]| Point3::new(x, y, 0.0));
        assert!(find_plane(&plate.collect::<Vec<_>>(), 0.1).unwrap().iter().all(|held| *held));
        let ball = (0..30_000).map(place).map(|[x, y]| {
            let (across, along) = (fringe::math::sincos(2.0 * x), fringe::math::sincos(0.1 * y - 1.5));
            Point3::new(10.0 * across.0 * along.1, 10.0 * along.0, 10.0 * across.1 * along.1)
        });
        assert!(find_sphere(&ball.collect::<Vec<_>>(), None, 0.1).unwrap().iter().all(|held| *held));
    }

    #[test]
    fn what_cannot_be_found_is_refused() {
        let (points, _) = ball_on_post();
        assert!(find_sphere(&points, Some(500.0), 0.1).unwrap_err().to_string().contains("of that size"));
        assert!(find_plane(&points, 0.0).unwrap_err().to_string().contains("margin_mm = 0"));
        assert!(find_plane(&points[..3], 0.1).unwrap_err().to_string().contains("3 points"));
        let line: Vec<Point3<f64>> = (0..50).map(|i| Point3::new(f64::from(i), 0.0, 0.0)).collect();
        assert!(find_plane(&line, 0.1).is_err() && find_sphere(&line, None, 0.1).is_err());
    }
}
