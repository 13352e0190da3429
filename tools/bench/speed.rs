//! Speed of the kernels on this machine: decoding, matching, fusion and inspection of the demo's part, beside the memory bandwidth that
//! bounds them.

use super::scan::{PairMaps, decoded, seen, views};
use crate::Outcome;
use crate::bundled;
use crate::report::{check_outputs, emit};
use crate::simulate::{Buffer, load_scene};
use anyhow::{Context, Result};
use cell::executor::{PairMatcher, PhaseMethod, ViewDecoder};
use fringe::cloud::Point;
use fringe::decode::DecodeSettings;
use fringe::fusion::{Fuser, FusionSettings};
use fringe::geometry::rig::{Rig, pictures};
use fringe::matching::MatchSettings;
use fringe::pattern::{Axis, PatternSet, frame_count};
use fringe::phase::{PhaseInfo, PhaseMap};
use metrology::inspection::{Plan, evaluate};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;
use twin::{Twin, TwinSettings, View};

#[derive(clap::Args)]
pub struct Args {
    /// Number of repeats of each measurement; the median is reported.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1..=1000))]
    repeats: usize,
    /// Also measure cameras of 4496 × 3000 px (two minutes more, 5 GiB).
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
    /// Points of the pair.
    points: usize,
    push_ms: f64,
    finish_ms: f64,
    match_ms: f64,
    /// Both cameras decoded one after the other, then matched.
    pair_ms: f64,
    decode_ns_per_px: f64,
    match_ns_per_px: f64,
    /// What every decoder moves: the frames in, phase, uncertainty, modulation and mask out.
    decode_bytes: usize,
    decode_bandwidth_share: f64,
    /// Points of the clouds of all pairs.
    cloud_points: usize,
    fuse_ms: f64,
    inspect_ms: f64,
    fuse_ns_per_point: f64,
    inspect_ns_per_point: f64,
}

/// What is measured: drawn and decoded before any clock runs.
struct Inputs {
    rig: Rig,
    sequence: Vec<PatternSet>,
    plan: Plan,
    /// What the left camera of the first pair sees, and its frames.
    view: View,
    frames: Vec<Buffer>,
    maps: Vec<PairMaps>,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], None)?;
    // As every stage of a cell does: what is measured uses the same memory again.
    ipc::os::keep_freed_memory();
    let bandwidth = memory_bandwidth();
    println!("memory bandwidth (read one buffer, write another, one thread): {:.1} GB/s", bandwidth / 1e9);
    let mut all = Vec::new();
    let mut sizes = vec![(1124, 750)];
    if args.large {
        sizes.push((4496, 3000));
    }
    for (width, height) in sizes {
        let inputs = Inputs::draw(width, height)?;
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let times = pool.install(|| inputs.measure(threads, args.repeats.max(1), bandwidth))?;
            print(&times);
            all.push(times);
        }
    }
    emit(args.json.as_deref(), &serde_json::json!({ "bandwidth_bytes_per_s": bandwidth, "times": all }))?;
    Ok(Outcome::Done)
}

impl Inputs {
    fn draw(width_px: u32, height_px: u32) -> Result<Self> {
        let config = bundled::load("configs/demo.toml")?;
        let plan = config.cell.recipes.into_iter().find_map(|recipe| recipe.plan);
        let plan = plan.context("configs/demo.toml: has no plan")?;
        let scene = load_scene(None, config.twin.as_ref().context("configs/demo.toml: has no [twin]")?)?;
        let rig = twin::thesis::rig(width_px, height_px);
        let sequence = twin::thesis::sequence();
        let twin = Twin::new(&scene, TwinSettings::default(), &rig)?;
        let pair = &rig.pairs[0];
        let view = twin.view_lit_by(&pair.left, &[pair.projector.as_str()], 0)?;
        let frames = render(&twin, &view, &pair.projector, &sequence)?;
        let maps = decoded(&twin, &rig, &sequence, 0, &|_| DecodeSettings::default())?;
        Ok(Self { rig, sequence, plan, view, frames, maps })
    }

    fn measure(&self, threads: usize, repeats: usize, bandwidth: f64) -> Result<Times> {
        let [push_ms, finish_ms] = self.decoding(repeats)?;
        let (clouds, match_ms) = self.matching(repeats)?;
        let ([fuse_ms, inspect_ms], cloud_points) = self.inspection(&clouds, repeats);
        let PhaseInfo { width_px, height_px, .. } = self.maps[0][0][0].info;
        let pixels = width_px as usize * height_px as usize;
        let decode_bytes = pixels * (self.frames.len() + size_of::<[f32; 3]>() + 1);
        let decode_s = (push_ms + finish_ms) * 1e-3;
        Ok(Times {
            width_px,
            height_px,
            threads,
            points: clouds[0].len(),
            push_ms,
            finish_ms,
            match_ms,
            pair_ms: 2.0 * (push_ms + finish_ms) + match_ms,
            decode_ns_per_px: decode_s * 1e9 / pixels as f64,
            match_ns_per_px: match_ms * 1e6 / pixels as f64,
            decode_bytes,
            decode_bandwidth_share: decode_bytes as f64 / decode_s / bandwidth,
            cloud_points,
            fuse_ms,
            inspect_ms,
            fuse_ns_per_point: fuse_ms * 1e6 / cloud_points as f64,
            inspect_ns_per_point: inspect_ms * 1e6 / cloud_points as f64,
        })
    }

    /// The frames as they land, and what is left after the last one.
    fn decoding(&self, repeats: usize) -> Result<[f64; 2]> {
        let (projector, settings) = (&self.rig.pairs[0].projector, DecodeSettings::default());
        let view = seen(&self.view, projector, &self.rig, &self.sequence)?;
        let mut decoder = ViewDecoder::new(&view, &settings, PhaseMethod::default())?;
        let mut map = PhaseMap::new(decoder.info(Axis::X)?);
        let (mut push, mut finish) = (Vec::new(), Vec::new());
        for _ in 0..repeats {
            let start = Instant::now();
            decoder.begin();
            for (number, frame) in self.frames.iter().enumerate() {
                decoder.push(number, &frame.frame(&self.view))?;
            }
            push.push(elapsed_ms(start));
            let start = Instant::now();
            decoder.finish(Axis::X, &mut map.view_mut())?;
            finish.push(elapsed_ms(start));
        }
        Ok([median(push), median(finish)])
    }

    /// The clouds of all pairs, and the time of the first.
    fn matching(&self, repeats: usize) -> Result<(Vec<Vec<Point>>, f64)> {
        let (mut clouds, mut match_ms) = (Vec::new(), Vec::new());
        for (number, (pair, [left, right])) in self.rig.pairs.iter().zip(&self.maps).enumerate() {
            let mut matcher = PairMatcher::new(&self.rig, pair, number, &MatchSettings::default())?;
            let mut points: Vec<Point> = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
            let runs = if number == 0 { repeats } else { 1 };
            let (mut count, mut times) = (0, Vec::new());
            for _ in 0..runs {
                let start = Instant::now();
                count = matcher.run(&views(left), &views(right), &mut points)?.points();
                times.push(elapsed_ms(start));
            }
            points.truncate(count as usize);
            clouds.push(points);
            match_ms.push(median(times));
        }
        Ok((clouds, match_ms[0]))
    }

    /// Fusion of all clouds, and inspection of what it gives; the number of points of all clouds.
    fn inspection(&self, clouds: &[Vec<Point>], repeats: usize) -> ([f64; 2], usize) {
        let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
        let mut fuser = Fuser::of_pictures(pictures(&self.rig.pairs));
        let (mut fused, mut fusing, mut inspecting) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..repeats {
            let start = Instant::now();
            fuser.fuse(&slices, &FusionSettings::default(), &mut fused);
            fusing.push(elapsed_ms(start));
            let start = Instant::now();
            std::hint::black_box(evaluate(&self.plan, &fused));
            inspecting.push(elapsed_ms(start));
        }
        ([median(fusing), median(inspecting)], clouds.iter().map(Vec::len).sum())
    }
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

fn elapsed_ms(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

fn median(mut values: Vec<f64>) -> f64 {
    fringe::math::statistics::median(&mut values).unwrap_or(f64::NAN)
}

fn print(t: &Times) {
    println!(
        "{} × {}, {} thread(s): push {:.1} ms, finish {:.1} ms (decode {:.1} ns/px, {:.0} % of the bandwidth); match {:.1} ms \
         ({:.1} ns/px), {} points; pair {:.1} ms; all {} points: fusion {:.1} ms ({:.0} ns/point), inspection {:.1} ms ({:.0} ns/point)",
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
        t.pair_ms,
        t.cloud_points,
        t.fuse_ms,
        t.fuse_ns_per_point,
        t.inspect_ms,
        t.inspect_ns_per_point
    );
}
