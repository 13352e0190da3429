//! Figures for the notes: `cargo test --release -p fringe figures -- --ignored --nocapture --test-threads 1`.

#![allow(
    clippy::disallowed_macros,
    clippy::disallowed_types,
    reason = "prints figures and times, run by hand"
)]

use super::*;
use crate::testing::{Scene, Surface, rig};
use nalgebra::Point3;
use std::time::Instant;

const WAYS: [Interpolation; 3] = [Interpolation::Quadratic, Interpolation::Cubic, Interpolation::Bilinear];

#[test]
#[ignore = "prints figures"]
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
#[ignore = "prints times"]
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
            let mut best = f64::INFINITY;
            for _ in 0..5 {
                let start = Instant::now();
                pool.install(|| matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap());
                best = best.min(start.elapsed().as_secs_f64());
            }
            let pixel = best * 1e9 / matcher.capacity() as f64;
            let report = matcher.run(&maps[0].view(), &maps[1].view(), 0, &mut points).unwrap();
            println!(
                "  {threads} threads: {:.1} ms, {pixel:.1} ns per pixel, {} points",
                best * 1e3,
                report.points
            );
        }
    }
}
