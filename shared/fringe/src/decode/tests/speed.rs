//! Nanoseconds per pixel; run it with `cargo test --release -p fringe decode_speed -- --ignored --nocapture`.

use super::*;

#[test]
#[ignore = "a measurement, not a test: cargo test --release -p fringe decode_speed -- --ignored --nocapture"]
#[allow(clippy::disallowed_types, clippy::disallowed_macros)] // a clock and a line of text are what a measurement needs
fn decode_speed() {
    use std::time::Instant;
    let mut scene = Scene::ramp(1124, 750, 0.5, 0.01, 608).eight_bits();
    scene.noise = (1.0, 0.02);
    for (name, sequence) in [("stripe = p/2", demo(8.0, 7)), ("stripe = p", demo(16.0, 6))] {
        let frames = scene.frames(&sequence);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| {
            let mut decoder = scene.decoder(&sequence, &DecodeSettings::default()).unwrap();
            let mut map = PhaseMap::new(decoder.info(Axis::X).unwrap());
            let scale = 1.0 / (1124.0 * 750.0);
            let (mut push_ns, mut finish_ns) = (f64::INFINITY, f64::INFINITY);
            for _ in 0..60 {
                decoder.begin();
                let start = Instant::now();
                frames.iter().enumerate().for_each(|(i, f)| decoder.push(i, &f.view()).unwrap());
                push_ns = push_ns.min(start.elapsed().as_nanos() as f64 * scale);
                let start = Instant::now();
                decoder.finish(Axis::X, &mut map.view_mut()).unwrap();
                finish_ns = finish_ns.min(start.elapsed().as_nanos() as f64 * scale);
            }
            println!("{name}: push {push_ns:.2} ns/pixel, finish {finish_ns:.2} ns/pixel, one thread");
        });
    }
}
