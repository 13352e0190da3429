//! Speed of the kernels on this machine: decode and matching, beside the memory bandwidth that bounds them.

use super::scan::{decode as decode_scan, seen, views};
use crate::Outcome;
use crate::bundled;
use crate::report::{check_outputs, emit};
use crate::simulate::{Buffer, load_scene};
use anyhow::{Context, Result};
use cell::executor::{PairMatcher, PhaseMethod, ViewDecoder, Views};
use fringe::cloud::Point;
use fringe::decode::DecodeSettings;
use fringe::matching::MatchSettings;
use fringe::pattern::{Axis, PatternSet, frame_count};
use fringe::phase::PhaseMap;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;
use twin::{Twin, TwinSettings, View};

#[derive(clap::Args)]
pub struct Args {
    /// Number of repeats of each measurement; the median is reported.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1000))]
    repeats: usize,
    /// Also measure a pair of 4496 × 3000 px (about two minutes, 3 GiB).
    #[arg(long)]
    large: bool,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Times of one image size, median, ms unless stated otherwise.
#[derive(Debug, Serialize)]
struct Times {
    width_px: u32,
    height_px: u32,
    threads: usize,
    points: usize,
    push_ms: f64,
    finish_ms: f64,
    match_ms: f64,
    /// Both cameras decoded one after the other, then matched.
    pair_ms: f64,
    decode_ns_per_px: f64,
    match_ns_per_px: f64,
    /// What decoding moves at least: frames in, sums in and out, planes out.
    decode_bytes: usize,
    decode_bandwidth_share: f64,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    let bandwidth = memory_bandwidth();
    println!("memory bandwidth (read one buffer, write another, one thread): {:.1} GB/s", bandwidth / 1e9);
    let mut all = Vec::new();
    let mut sizes = vec![(1124, 750)];
    if args.large {
        sizes.push((4496, 3000));
    }
    for (width, height) in sizes {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let times = pool.install(|| measure(width, height, threads, args.repeats.max(1), bandwidth))?;
            print(&times);
            all.push(times);
        }
    }
    emit(args.json.as_deref(), &serde_json::json!({ "bandwidth_bytes_per_s": bandwidth, "times": all }))?;
    Ok(Outcome::Done)
}

fn measure(width_px: u32, height_px: u32, threads: usize, repeats: usize, bandwidth: f64) -> Result<Times> {
    let config = bundled::load("configs/demo.toml")?;
    let scene = load_scene(None, config.twin.as_ref().context("configs/demo.toml: has no [twin]")?)?;
    let rig = twin::thesis::rig(width_px, height_px);
    let sequence = twin::thesis::sequence();
    let twin = Twin::new(&scene, TwinSettings::default(), &rig)?;
    let pair = &rig.pairs[0];

    let view = twin.view_lit_by(&pair.left, &[pair.projector.as_str()], 0)?;
    let frames = render(&twin, &view, &pair.projector, &sequence)?;
    let settings = DecodeSettings::default();
    let mut decoder =
        ViewDecoder::new(&seen(&view, &pair.projector, &rig, &sequence)?, &settings, PhaseMethod::default())?;
    let mut map = PhaseMap::new(decoder.info(Axis::X)?);
    let (mut push, mut finish) = (Vec::new(), Vec::new());
    for _ in 0..repeats {
        let start = Instant::now();
        decoder.begin();
        for (number, frame) in frames.iter().enumerate() {
            decoder.push(number, &frame.frame(&view))?;
        }
        push.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        decoder.finish(Axis::X, &mut map.view_mut())?;
        finish.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let right = decode_scan(&twin, &pair.right, &pair.projector, &rig, &sequence, 0)?;
    let mut matcher = PairMatcher::new(&rig, pair, 0, &MatchSettings::default())?;
    let mut points: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    let mut matching = Vec::new();
    let mut count = 0;
    for _ in 0..repeats {
        let start = Instant::now();
        count = matcher.run(&Views::of([map.view()]), &views(&right), &mut points)?.points();
        matching.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let (push_ms, finish_ms, match_ms) = (median(push), median(finish), median(matching));
    let pixels = width_px as usize * height_px as usize;
    // Per pixel: ten sine frames of a byte, each with three sums of four bytes in and out; nine code frames copied; at the
    // end the sums and the code in, phase, sigma, modulation and mask out.
    let decode_bytes = pixels * (10 * (1 + 24) + 9 * 2 + 12 + 9 + 13);
    let decode_s = (push_ms + finish_ms) * 1e-3;
    Ok(Times {
        width_px,
        height_px,
        threads,
        points: count as usize,
        push_ms,
        finish_ms,
        match_ms,
        pair_ms: 2.0 * (push_ms + finish_ms) + match_ms,
        decode_ns_per_px: decode_s * 1e9 / pixels as f64,
        match_ns_per_px: match_ms * 1e6 / pixels as f64,
        decode_bytes,
        decode_bandwidth_share: decode_bytes as f64 / decode_s / bandwidth,
    })
}

/// All frames of a view, before any clock runs.
fn render(twin: &Twin, view: &View, projector: &str, sequence: &[PatternSet]) -> Result<Vec<Buffer>> {
    let mut renderer = twin.renderer(projector, sequence)?;
    (0..frame_count(sequence))
        .map(|frame| {
            let mut buffer = Buffer::new(view);
            renderer.render(view, frame, buffer.pixels_mut())?;
            Ok(buffer)
        })
        .collect()
}

/// Bytes moved per second by a copy between buffers far larger than any cache, read and write counted.
fn memory_bandwidth() -> f64 {
    const BYTES: usize = 256 << 20;
    let source = vec![1_u8; BYTES];
    let mut target = vec![2_u8; BYTES];
    let times = (0..7)
        .map(|_| {
            let start = Instant::now();
            target.copy_from_slice(std::hint::black_box(&source));
            std::hint::black_box(&mut target);
            start.elapsed().as_secs_f64()
        })
        .collect();
    2.0 * BYTES as f64 / median(times)
}

fn median(mut values: Vec<f64>) -> f64 {
    fringe::math::statistics::median(&mut values).unwrap_or(f64::NAN)
}

fn print(t: &Times) {
    println!(
        "{} × {}, {} thread(s): push {:.1} ms, finish {:.1} ms (decode {:.1} ns/px, {:.0} % of the bandwidth); match {:.1} ms \
         ({:.1} ns/px), {} points; pair {:.1} ms",
        t.width_px,
        t.height_px,
        t.threads,
        t.push_ms,
        t.finish_ms,
        t.decode_ns_per_px,
        t.decode_bandwidth_share * 1e2,
        t.match_ms,
        t.match_ns_per_px,
        t.points,
        t.pair_ms
    );
}
