//! Stated uncertainties beside the scatter of repeats.

use nalgebra::{Point3, Vector3};

use super::Noise;
use crate::fit::*;

/// Points of a sphere cap of half angle 60° with independent noise of 10 µm.
pub(super) fn cap(noise: &mut Noise, count: usize) -> Vec<Point3<f64>> {
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let direction = noise.direction();
        if direction.z > 0.5 {
            points.push(Point3::new(100.0, -40.0, 500.0) + direction * (10.0 + 0.01 * noise.normal()));
        }
    }
    points
}

pub(super) fn mean_and_sd(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, (squares / (values.len() - 1) as f64).sqrt())
}

/// Ratio of the scatter of 400 diameters to the uncertainty that the fits state.
fn diameter_scatter_ratio(settings: FitSettings, points: impl Fn(u64) -> Vec<Point3<f64>>) -> f64 {
    let fits: Vec<SphereFit> = (0..400).map(|seed| sphere(&points(seed), &settings).unwrap()).collect();
    let (mean, scatter) = mean_and_sd(&fits.iter().map(|f| f.diameter_mm).collect::<Vec<_>>());
    let stated = (fits.iter().map(|f| f.u_diameter_mm.powi(2)).sum::<f64>() / fits.len() as f64).sqrt();
    assert!((mean - 20.0).abs() < 4.0 * scatter / 20.0, "biased: {mean}");
    scatter / stated
}

/// With 400 fits the scatter itself is known to 3.5 %; the limits are three of that.
#[test]
fn predicted_sigma_meets_the_scatter() {
    let independent = |count: usize| move |seed| cap(&mut Noise(seed), count);
    for (count, settings) in [
        (1000, FitSettings::default()),
        (1000, FitSettings { max_reject_fraction: 0.03, ..FitSettings::default() }),
        (1000, FitSettings { max_reject_fraction: 0.1, ..FitSettings::default() }),
        (1000, FitSettings { correlation: Correlation::Cells(2.0), ..FitSettings::default() }),
        (300, FitSettings { correlation: Correlation::Estimated, ..FitSettings::default() }),
    ] {
        let ratio = diameter_scatter_ratio(settings, independent(count));
        assert!((0.89..1.11).contains(&ratio), "{settings:?}: scatter / stated = {ratio}");
    }
}

/// A third and half of all points left out: the scatter is 1.9 and 3.5 times that of all points, and stated as such. Of fewer points it is less: the
/// same ones go once more before the fit has moved as far as it would with many.
#[test]
fn many_points_left_out_are_stated() {
    for max_reject_fraction in [0.3, 0.5] {
        let settings = FitSettings { max_reject_fraction, ..FitSettings::default() };
        let ratio = diameter_scatter_ratio(settings, |seed| cap(&mut Noise(seed), 4000));
        assert!((0.75..1.2).contains(&ratio), "{max_reject_fraction}: scatter / stated = {ratio}");
    }
}

/// A margin takes the tails of the noise away, which the uncertainty knows; one that takes more is refused.
#[test]
fn a_margin_about_the_element_enters_its_uncertainty() {
    let chosen = |seed: u64, margin_mm: f64| {
        let points = cap(&mut Noise(seed), 1000);
        let held = find_sphere(&points, None, margin_mm).unwrap();
        points.into_iter().zip(held).filter(|(_, held)| *held).map(|(point, _)| point).collect::<Vec<_>>()
    };
    for margin_mm in [0.1, 0.03, 0.023] {
        let settings = FitSettings { within_mm: Some(margin_mm), ..FitSettings::default() };
        let ratio = diameter_scatter_ratio(settings, |seed| chosen(seed, margin_mm));
        assert!((0.87..1.13).contains(&ratio), "{margin_mm} mm: scatter / stated = {ratio}");
    }
    for margin_mm in [0.015, 0.01, 0.005] {
        let settings = FitSettings { within_mm: Some(margin_mm), ..FitSettings::default() };
        let refused = sphere(&chosen(1, margin_mm), &settings).unwrap_err().to_string();
        assert!(refused.contains("cuts into the noise"), "{refused}");
    }
}

/// Of 2000 fits with six degrees of freedom 9.2 % would lie outside of twice the scatter that their points show; ± 2 u leaves 4.55 %, known to 0.5 %.
#[test]
fn twice_the_uncertainty_holds_of_few_points_too() {
    for (count, correlation) in
        [(10, Correlation::Independent), (24, Correlation::Independent), (24, Correlation::Estimated)]
    {
        let settings = FitSettings { correlation, ..FitSettings::default() };
        let is_outside = |seed: &u64| {
            let fit = sphere(&cap(&mut Noise(*seed), count), &settings).unwrap();
            (fit.diameter_mm - 20.0).abs() > 2.0 * fit.u_diameter_mm
        };
        let outside = (0..2000).filter(is_outside).count() as f64 / 2000.0;
        let most = if correlation == Correlation::Independent { 0.061 } else { 0.1 };
        assert!((0.03..most).contains(&outside), "{count} points, {correlation:?}: {outside}");
    }
}

/// Every noise value shared by five points within 0.3 mm: points taken as independent promise √5 too much, cells of
/// 2 mm do not.
#[test]
fn cells_see_correlated_noise() {
    let correlated = |seed: u64| -> Vec<Point3<f64>> {
        let mut noise = Noise(seed);
        let seeds = cap(&mut noise, 400);
        let center = Point3::new(100.0, -40.0, 500.0);
        let mut points = Vec::new();
        for seed_point in seeds {
            let (radius, direction) = crate::fit::sphere::polar(&(seed_point - center));
            for _ in 0..5 {
                let near = direction + noise.direction() * 0.01;
                points.push(center + near / near.norm() * radius);
            }
        }
        points
    };
    let naive = diameter_scatter_ratio(FitSettings::default(), correlated);
    assert!((1.9..2.6).contains(&naive), "naive: {naive}");
    let settings = FitSettings { correlation: Correlation::Cells(2.0), ..FitSettings::default() };
    let robust = diameter_scatter_ratio(settings, correlated);
    assert!((0.89..1.14).contains(&robust), "robust: {robust}");
}

/// Noise that is smooth over `reach_mm` on a cap of 22 mm diameter: a sum of `sources` Gaussian bumps of random height,
/// and a third of it independent.
fn smooth_cap(seed: u64, count: usize, reach_mm: f64) -> Vec<Point3<f64>> {
    let mut noise = Noise(seed);
    let sources: Vec<(Vector3<f64>, f64)> =
        (0..600).map(|_| (noise.direction() * 11.0, noise.normal())).collect();
    // Bumps of this many at a place: the sum then scatters by one.
    let scale = (600.0 * reach_mm * reach_mm / (2.0 * 4.0 * 121.0)).max(0.05).sqrt();
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let direction = noise.direction();
        if direction.z < 0.1 {
            continue;
        }
        let bump = |(place, height): &(Vector3<f64>, f64)| {
            let square = (place - direction * 11.0).norm_squared() / (reach_mm * reach_mm);
            if square > 9.0 { 0.0 } else { height * fringe::math::exp(-square) }
        };
        let smooth: f64 = sources.iter().map(bump).sum::<f64>() / scale;
        points.push(Point3::from(direction * (11.0 + 0.01 * smooth + 0.004 * noise.normal())));
    }
    points
}

/// Scatter over stated uncertainty of the diameter, for noise of several reaches: independent points promise 2 to 8
/// times too much, cells of 2 mm up to 4 times; the estimated correlation holds until the noise reaches over a sixth of
/// the cap. 120 fits know a scatter to 6.5 %, and the estimate itself scatters.
#[test]
fn estimated_correlation_holds_whatever_its_reach() {
    let ratio = |reach_mm: f64, correlation: Correlation| {
        let settings = FitSettings { correlation, ..FitSettings::default() };
        let fits: Vec<SphereFit> =
            (0..120).map(|seed| sphere(&smooth_cap(seed, 500, reach_mm), &settings).unwrap()).collect();
        let (_, scatter) = mean_and_sd(&fits.iter().map(|f| f.diameter_mm).collect::<Vec<_>>());
        let stated = fits.iter().map(|f| f.u_diameter_mm.powi(2)).sum::<f64>() / fits.len() as f64;
        scatter / stated.sqrt()
    };
    for reach_mm in [1.0, 2.0, 3.5] {
        let estimated = ratio(reach_mm, Correlation::Estimated);
        assert!((0.83..1.2).contains(&estimated), "reach {reach_mm} mm: {estimated}");
    }
    let (naive, cells) = (ratio(2.0, Correlation::Independent), ratio(2.0, Correlation::Cells(2.0)));
    assert!(naive > 2.5 && cells > 1.4, "independent: {naive}, cells of 2 mm: {cells}");
}

/// Too few cells fell back to independent points, with an uncertainty ten times too small.
#[test]
fn too_few_cells_widen_the_uncertainty() {
    let points = smooth_cap(3, 500, 3.5);
    let of = |correlation| sphere(&points, &FitSettings { correlation, ..FitSettings::default() }).unwrap();
    let (independent, cells) = (of(Correlation::Independent), of(Correlation::Cells(9.0)));
    assert!((1..20).contains(&cells.support.cells), "{:?}", cells.support);
    let wider = (500.0 / cells.support.cells as f64).sqrt();
    assert!((cells.u_diameter_mm / independent.u_diameter_mm / wider - 1.0).abs() < 1e-9);
    let settings = FitSettings { correlation: Correlation::Cells(9.0), ..FitSettings::default() };
    let fits: Vec<SphereFit> =
        (0..60).map(|seed| sphere(&smooth_cap(seed, 500, 3.5), &settings).unwrap()).collect();
    let (_, scatter) = mean_and_sd(&fits.iter().map(|f| f.diameter_mm).collect::<Vec<_>>());
    let stated = fits.iter().map(|f| f.u_diameter_mm.powi(2)).sum::<f64>() / fits.len() as f64;
    assert!(scatter < 1.1 * stated.sqrt(), "{scatter} against {}", stated.sqrt());
}

/// Points with two residuals each: trimming was corrected for as if they had one, which made u 1.3 times too large.
#[test]
fn trimmed_circles_and_lines_scatter_as_stated() {
    let settings = FitSettings { max_reject_fraction: 0.03, ..FitSettings::default() };
    let noise_mm = 0.01;
    let circles: Vec<CircleFit> = (0..400)
        .map(|seed| {
            let mut noise = Noise(seed);
            let point = |_| {
                let (sin, cos) = fringe::math::sincos(std::f64::consts::TAU * noise.uniform());
                let radius = 10.0 + noise_mm * noise.normal();
                Point3::new(radius * cos, radius * sin, noise_mm * noise.normal())
            };
            circle(&(0..300).map(point).collect::<Vec<_>>(), &settings).unwrap()
        })
        .collect();
    let (_, scatter) = mean_and_sd(&circles.iter().map(|f| f.diameter_mm).collect::<Vec<_>>());
    let stated = (circles.iter().map(|f| f.u_diameter_mm.powi(2)).sum::<f64>() / 400.0).sqrt();
    assert!((0.89..1.11).contains(&(scatter / stated)), "circle: {scatter} stated {stated}");

    let lines: Vec<LineFit> = (0..400)
        .map(|seed| {
            let mut noise = Noise(1000 + seed);
            let point = |i| {
                Point3::new(0.1 * f64::from(i) - 15.0, noise_mm * noise.normal(), noise_mm * noise.normal())
            };
            line(&(0..300).map(point).collect::<Vec<_>>(), &settings).unwrap()
        })
        .collect();
    let (_, scatter) = mean_and_sd(&lines.iter().map(|f| f.axis_point_mm[1]).collect::<Vec<_>>());
    let stated = (lines.iter().map(|f| f.u_axis_point_mm.powi(2)).sum::<f64>() / 400.0).sqrt();
    // The worse of two equal directions is stated, a few per cent above either.
    assert!((0.85..1.11).contains(&(scatter / stated)), "line: {scatter} stated {stated}");
}

/// Columns and rows of points, half the width of the windows of the fits that smooth their noise, and its width.
const GRID: [usize; 2] = [52, 32];
const HALF: usize = 2;
const SIDE: usize = 2 * HALF + 1;

/// Columns and rows of the draws that the windows take.
const DRAWN: [usize; 2] = [GRID[0] + 2 * HALF, GRID[1] + 2 * HALF];

/// Columns and rows of all points.
fn places() -> impl Iterator<Item = [usize; 2]> {
    (0..GRID[0] * GRID[1]).map(|k| [k % GRID[0], k / GRID[0]])
}

/// The draws in the window of a point.
fn window([x, y]: [usize; 2]) -> impl Iterator<Item = usize> {
    (0..SIDE * SIDE).map(move |k| (y + k / SIDE) * DRAWN[0] + x + k % SIDE)
}

/// Weights by which the fit of a second-order surface to a window makes the value of its middle.
fn smoothing() -> Vec<f64> {
    let place = |k: usize| (k % SIDE) as f64 - HALF as f64;
    let terms = nalgebra::DMatrix::from_fn(SIDE * SIDE, 6, |k, term| {
        let (u, v) = (place(k), place(k / SIDE));
        [1.0, u, v, u * u, u * v, v * v][term]
    });
    terms.pseudo_inverse(1e-12).unwrap().row(0).iter().copied().collect()
}

/// Heights of a plane some 0.4 mm apart, as pixels see it, with noise of 10 µm smoothed by such fits.
fn smoothed_plane(noise: &mut Noise, weights: &[f64]) -> Vec<Point3<f64>> {
    let drawn: Vec<f64> = (0..DRAWN[0] * DRAWN[1]).map(|_| 0.01 * noise.normal()).collect();
    let point = |place: [usize; 2]| {
        let [x, y] = place.map(|along| 0.4 * along as f64 + 0.2 * noise.uniform());
        Point3::new(x, y, window(place).zip(weights).map(|(draw, weight)| weight * drawn[draw]).sum())
    };
    places().map(point).collect()
}

/// Standard deviation of the mean of these heights: each draw enters it by the sum of the weights with which the points take it.
fn exact_u_mm(weights: &[f64]) -> f64 {
    let mut taken = vec![0.0; DRAWN[0] * DRAWN[1]];
    for (draw, weight) in places().flat_map(|place| window(place).zip(weights)) {
        taken[draw] += weight / (GRID[0] * GRID[1]) as f64;
    }
    0.01 * taken.iter().map(|t: &f64| t * t).sum::<f64>().sqrt()
}

/// Smoothing by fits leaves neighbours correlated and the next ones negatively so. Where the latter was left out, the height of a plane
/// was stated so large that the error over it was 0.92 (the same estimate with NumPy); a part is still missing. 200 planes know it to two hundredths.
#[test]
fn the_height_of_a_smoothed_plane_is_stated_as_it_scatters() {
    let weights = smoothing();
    let exact = exact_u_mm(&weights);
    let settings = FitSettings { correlation: Correlation::Estimated, ..FitSettings::default() };
    let squares: f64 = (0..200)
        .map(|seed| plane(&smoothed_plane(&mut Noise(7000 + seed), &weights), &settings).unwrap())
        .map(|fit| (exact / fit.u_centroid_mm).powi(2))
        .sum();
    let ratio = (squares / 200.0).sqrt();
    assert!((0.945..1.03).contains(&ratio), "error over stated: {ratio}");
}
