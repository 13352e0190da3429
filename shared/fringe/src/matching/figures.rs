//! Figures for the notes: `cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1`.

#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "prints figures and times, run by hand"
)]

use super::*;
use crate::pattern::Axis;
use crate::synthetic::{Scene, Surface, rig};
use nalgebra::Point3;
use std::time::Instant;

/// Processor time of this process, s (in ticks of 10 ms): unlike the wall's, it does not suffer from other work.
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

const WAYS: [Interpolation; 3] = [Interpolation::Quadratic, Interpolation::Cubic, Interpolation::Bilinear];

#[test]
#[ignore = "prints figures: cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1"]
fn figures_of_accuracy() {
    let [left, right, projector] = rig(1124, 750);
    let ball = |radius_mm| Surface::Sphere { centre: Point3::new(5.0, 2.0, 0.0), radius_mm };
    let plane = Surface::plane([0.3, 0.2, 1.0], 0.0);
    for (name, surface) in [("plane", plane), ("ball 22.4 mm", ball(11.2)), ("ball 60 mm", ball(30.0))] {
        let scene = Scene { surfaces: vec![surface], projector: projector.clone(), period_px: 16.0 };
        for sigma in [0.0, 0.02] {
            let maps = [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, sigma, seed));
            for interpolation in WAYS {
                let settings = MatchSettings { interpolation, ..MatchSettings::default() };
                let mut matcher = Matcher::new(&left, &right, &settings).unwrap();
                let mut points = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
                let report = matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap();
                points.truncate(report.points as usize);
                let off: Vec<f64> = points.iter().map(|p: &Point| surface.distance(&p.position())).collect();
                let n = off.len() as f64;
                let mean = off.iter().sum::<f64>() / n * 1e3;
                let rms = (off.iter().map(|v| v * v).sum::<f64>() / n).sqrt() * 1e3;
                let ratio =
                    points.iter().zip(&off).map(|(p, v)| (v / f64::from(p.sigma_mm)).powi(2)).sum::<f64>();
                let ratio = (ratio / n).sqrt();
                println!(
                    "{name}, {sigma} rad, {interpolation:?}: mean {mean:.3} um, rms {rms:.3} um, ratio {ratio:.3}, {n} points"
                );
            }
        }
    }
}

#[test]
#[ignore = "prints times: cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1"]
fn figures_of_speed() {
    for (width, height) in [(1124, 750), (4496, 3000)] {
        let [left, right, projector] = rig(width, height);
        let surface = Surface::plane([0.3, 0.2, 1.0], 0.0);
        let scene = Scene { surfaces: vec![surface], projector, period_px: 16.0 };
        let maps = [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, 0.01, seed));
        let start = Instant::now();
        let mut matcher = Matcher::new(&left, &right, &MatchSettings::default()).unwrap();
        println!("{width} x {height}: tables {:?}", start.elapsed());
        let mut points = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let runs = if width > 2000 { 3 } else { 20 };
            let (wall, busy) = (Instant::now(), processor_seconds());
            let mut count = 0;
            for _ in 0..runs {
                count = pool
                    .install(|| matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap())
                    .points;
            }
            let (wall, busy) = (wall.elapsed().as_secs_f64(), processor_seconds() - busy);
            let per_run = 1e3 / f64::from(runs);
            let pixel = busy * 1e9 / f64::from(runs) / matcher.capacity() as f64;
            println!(
                "  {threads} threads: wall {:.1} ms, processor {:.1} ms, {pixel:.1} ns per pixel, {count} points",
                wall * per_run,
                busy * per_run
            );
        }
    }
}

/// Error of exact phase against the steepest incidence on any of the three devices.
#[test]
#[ignore = "prints figures: cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1"]
fn figures_of_incidence() {
    let [left, right, projector] = rig(1124, 750);
    let surface = Surface::Sphere { centre: Point3::new(5.0, 2.0, 0.0), radius_mm: 11.2 };
    let scene = Scene { surfaces: vec![surface], projector: projector.clone(), period_px: 16.0 };
    let maps = [&left, &right].map(|c| scene.phase_map(c, Axis::X, 0.0, 1));
    let mut settings = MatchSettings::default();
    settings.surface.max_incidence_deg = 90.0;
    let mut matcher = Matcher::new(&left, &right, &settings).unwrap();
    let mut points: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    let report = matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap();
    let mut bins = [(0.0, 0.0, 0.0); 18];
    for point in &points[..report.points as usize] {
        let at = point.position();
        let normal = surface.normal(&at);
        let cosine = |camera: &Camera| normal.dot(&(camera.centre_mm() - at).normalize());
        let steepest = [&left, &right, &projector].map(cosine).into_iter().fold(1.0, f64::min);
        let (n, sum, squares) = &mut bins[(crate::math::acos(steepest).to_degrees() / 5.0) as usize];
        let off = surface.distance(&at) * 1e3;
        (*n, *sum, *squares) = (*n + 1.0, *sum + off, *squares + off * off);
    }
    for (bin, (n, sum, squares)) in bins.iter().enumerate().filter(|(_, b)| b.0 > 0.0) {
        println!(
            "from {} deg: {n} points, mean {:.3} um, rms {:.3} um",
            bin * 5,
            sum / n,
            f64::sqrt(squares / n)
        );
    }
}

#[test]
#[ignore = "prints times: cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1"]
fn figures_of_fusion() {
    let [left, right, projector] = rig(900, 600);
    let scene = Scene { surfaces: vec![Surface::plane([0.3, 0.2, 1.0], 0.0)], projector, period_px: 16.0 };
    let clouds = [1, 2].map(|seed| {
        let maps = [(&left, seed), (&right, 9 * seed)].map(|(c, s)| scene.phase_map(c, Axis::X, 0.01, s));
        let mut matcher = Matcher::new(&left, &right, &MatchSettings::default()).unwrap();
        let mut points: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
        let report = matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap();
        points.truncate(report.points.min(300_000) as usize);
        points
    });
    let (mut fuser, mut out) = (crate::fusion::Fuser::default(), Vec::new());
    let views: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let settings = crate::fusion::FusionSettings::default();
    let report = fuser.fuse(&views, &settings, &mut out).clone();
    let busy = processor_seconds();
    for _ in 0..10 {
        fuser.fuse(&views, &settings, &mut out);
    }
    println!("fusion: processor {:.1} ms, {report:?}", (processor_seconds() - busy) * 100.0);
}

/// A phase map read bilinearly on a rectified grid; NaN where a pixel is missing.
fn resampled(
    view: &crate::rectify::RectifiedCamera,
    grid: &RectifiedGrid,
    map: &crate::phase::PhaseMap,
) -> Vec<f32> {
    let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
    let mut out = vec![f32::NAN; grid.width * grid.height];
    for (cell, out) in out.iter_mut().enumerate() {
        let y = grid.y0 + (cell / grid.width) as f64 / grid.focal_px;
        let [u, v] = view.curve(y).at(grid.abscissa((cell % grid.width) as f64)).pixel;
        if u >= 0.0 && v >= 0.0 && u < (width - 1) as f64 && v < (height - 1) as f64 {
            let (i, s, t) = (v as usize * width + u as usize, u.fract(), v.fract());
            let p = |k: usize| f64::from(map.phase_rad[k]);
            let top = p(i) * (1.0 - s) + p(i + 1) * s;
            let bottom = p(i + width) * (1.0 - s) + p(i + width + 1) * s;
            *out = (top * (1.0 - t) + bottom * t) as f32;
        }
    }
    out
}

/// What the usual way would give: both phase maps resampled bilinearly onto the rectified grid, matched there by linear
/// inverse interpolation along the row, triangulated from the grid's own coordinates.
#[test]
#[ignore = "prints figures: cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1"]
fn figures_of_resampling() {
    let [left, right, projector] = rig(1124, 750);
    let ball = |radius_mm| Surface::Sphere { centre: Point3::new(5.0, 2.0, 0.0), radius_mm };
    let plane = Surface::plane([0.3, 0.2, 1.0], 0.0);
    for (name, surface) in [("plane", plane), ("ball 22.4 mm", ball(11.2)), ("ball 60 mm", ball(30.0))] {
        let scene = Scene { surfaces: vec![surface], projector: projector.clone(), period_px: 16.0 };
        for sigma in [0.0, 0.02] {
            let maps = [(&left, 1), (&right, 2)].map(|(c, seed)| scene.phase_map(c, Axis::X, sigma, seed));
            let matcher = Matcher::new(&left, &right, &MatchSettings::default()).unwrap();
            let pair = &matcher.pair;
            let a = resampled(&pair.left, &matcher.left_grid, &maps[0]);
            let b = resampled(&pair.right, &matcher.right_grid, &maps[1]);
            let (mut n, mut sum, mut squares) = (0.0, 0.0, 0.0);
            let (mut row, limits) =
                (epipolar_rows::Row::default(), matcher.settings.step_limits(16.0, 0.0, 0.0));
            for line in 0..matcher.left_grid.height {
                let cells = |grid: &RectifiedGrid| line * grid.width..(line + 1) * grid.width;
                row.fill(b[cells(&matcher.right_grid)].iter().copied(), limits, matcher.level);
                for (column, phase) in
                    a[cells(&matcher.left_grid)].iter().enumerate().filter(|(_, p)| p.is_finite())
                {
                    let x = matcher.left_grid.abscissa(column as f64);
                    let y = matcher.left_grid.y0 + line as f64 / pair.focal_px;
                    row.find(*phase, None, |place, _| {
                        let depth = pair.baseline_mm / (x - matcher.right_grid.abscissa(place));
                        let at =
                            pair.origin_mm + pair.world_from_rectified * (Vector3::new(x, y, 1.0) * depth);
                        let normal = surface.normal(&at);
                        let steep = [&left, &right].iter().any(|c| {
                            normal.dot(&(c.centre_mm() - at).normalize()) < 0.342 // cos 70°
                        });
                        if !steep {
                            let off = surface.distance(&at) * 1e3;
                            (n, sum, squares) = (n + 1.0, sum + off, squares + off * off);
                        }
                    });
                }
            }
            println!(
                "{name}, {sigma} rad, resampled: mean {:.3} um, rms {:.3} um, {n} points",
                sum / n,
                f64::sqrt(squares / n)
            );
        }
    }
}
