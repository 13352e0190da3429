//! Decoding, matching, and both: 10 steps over fringes of 20 px, 6 bits of half fringes, black, white.

use super::Bench;
use anyhow::{Result, ensure};
use bytemuck::Zeroable;
use fringe::cloud::Point;
use fringe::decode::{DecodeSettings, Decoder};
use fringe::frame::{SharedFrame, SharedPixels};
use fringe::geometry::camera::Camera;
use fringe::matching::{MatchSettings, Matcher};
use fringe::pattern::{Axis, Direction, PatternSet};
use fringe::phase::{PhaseInfo, PhaseMap};
use nalgebra::{Matrix3, Point2, Vector3};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::sync::Arc;

/// Projector pixels per fringe.
const PERIOD_PX: f64 = 20.0;

/// Columns and rows of the projector.
const PROJECTOR_PX: [u32; 2] = [608, 684];

const FRAMES: usize = 18;

/// Phases that are wrong by more than this have a wrong fringe order, rad.
const ORDER_ERROR_RAD: f64 = 3.0;

/// Depths that are wrong by more than this are outliers, mm.
const OUTLIER_MM: f64 = 2.0;

/// Noise of these frames, rad, for a match without decoding: 9.5 mrad.
const SIGMA_RAD: f32 = 0.0095;

fn sequence() -> Vec<PatternSet> {
    let mut sine = PatternSet::sine(Axis::X, PERIOD_PX, 10);
    if let PatternSet::Sine { direction, .. } = &mut sine {
        *direction = Direction::Backward;
    }
    // The code of the inputs begins half a pixel later than ours: a twentieth of a stripe, which half fringes allow for.
    let gray = PatternSet::gray(Axis::X, 6, PERIOD_PX / 2.0);
    vec![sine, gray, PatternSet::Black {}, PatternSet::White {}]
}

/// Eighteen frames of a camera and what decodes them.
pub(super) struct Camera18 {
    frames: Vec<SharedFrame>,
    decoder: Decoder,
    pub(super) map: PhaseMap,
}

impl Camera18 {
    pub(super) fn read(bench: &Bench, number: usize) -> Result<Self> {
        let (width_px, height_px) = bench.image_size()?;
        let (shape, frames) = bench.bytes(&format!("frames{number}"))?;
        ensure!(
            shape == [FRAMES, height_px as usize, width_px as usize],
            "frames{number}.npy has shape {shape:?} where {FRAMES} x {height_px} x {width_px}, the frames with the rows and columns of \
             --size, is needed"
        );
        let decoder =
            Decoder::new(&sequence(), width_px, height_px, 255, PROJECTOR_PX, &DecodeSettings::default())?;
        let map = PhaseMap::new(decoder.info(Axis::X)?);
        let shared = |frame: &[u8]| {
            let pixels = SharedPixels::Mono8(Arc::new(frame.to_vec()));
            SharedFrame { width_px, height_px, full_scale_dn: 255, pixels }
        };
        let frames = frames.chunks_exact(map.info.len()).map(shared).collect();
        Ok(Self { frames, decoder, map })
    }

    pub(super) fn decode(&mut self) -> Result<()> {
        self.decoder.begin();
        for (number, frame) in self.frames.iter().enumerate() {
            self.decoder.push_shared(number, frame)?;
        }
        self.decoder.finish(Axis::X, &mut self.map.view_mut())?;
        Ok(())
    }

    fn accuracy(&self, truth: &[f32]) -> Value {
        let valid: usize = self.map.valid.iter().map(|v| usize::from(*v)).sum();
        let planes = self.map.phase_rad.iter().zip(truth).zip(&self.map.valid);
        // Where there is no truth, there is nothing to compare with.
        let known = planes.filter(|((_, truth), valid)| **valid == 1 && truth.is_finite());
        let errors: Vec<f64> = known.map(|((p, t), _)| f64::from(p - t).abs()).collect();
        let good: Vec<f64> = errors.iter().copied().filter(|e| *e < ORDER_ERROR_RAD).collect();
        let squares: f64 = good.iter().map(|e| e * e).sum();
        json!({
            "rms_mrad": root_mean(squares, good.len()).map(|rms| rms * 1e3),
            "order_errors": (!errors.is_empty()).then(|| errors.len() - good.len()),
            "valid": valid as f64 / truth.len().max(1) as f64,
        })
    }
}

/// Root of a mean of squares; `None` of none: nothing was compared.
fn root_mean(squares: f64, count: usize) -> Option<f64> {
    (count > 0).then(|| (squares / count as f64).sqrt())
}

/// Decodes the frames of the first camera.
pub(super) fn decode(bench: &mut Bench) -> Result<()> {
    let mut camera = Camera18::read(bench, 0)?;
    let truth = bench.picture("truth_phase0")?;
    let bytes = truth.len() * (FRAMES + 4 + 1);
    for threads in [1, 2] {
        bench.time("decode", threads, || camera.decode())?;
        let accuracy = camera.accuracy(&truth);
        let Some(row) = bench.rows.last_mut() else { continue };
        row.with(json!({ "bytes": bytes }));
        row.with(accuracy);
    }
    Ok(())
}

/// Matches two decoded maps: points with normals and uncertainties, smoothed.
pub(super) fn matching(bench: &mut Bench) -> Result<()> {
    let (width_px, height_px) = bench.image_size()?;
    let info = PhaseInfo { width_px, height_px, axis: Axis::X, period_px: PERIOD_PX };
    let mut maps = Vec::new();
    for number in [0, 1] {
        let phase_rad = bench.picture(&format!("phase{number}"))?;
        let valid: Vec<u8> = phase_rad.iter().map(|p| u8::from(p.is_finite())).collect();
        let sigma_rad = phase_rad.iter().map(|p| if p.is_finite() { SIGMA_RAD } else { f32::NAN }).collect();
        maps.push(PhaseMap { info, phase_rad, sigma_rad, modulation: vec![70.0; info.len()], valid });
    }
    let mut stereo = Stereo::new(bench)?;
    for threads in [1, 2] {
        bench.time("match rows", threads, || stereo.run(&maps[0], &maps[1]))?;
        let accuracy = stereo.accuracy(&maps[0]);
        let Some(row) = bench.rows.last_mut() else { continue };
        row.with(accuracy);
        row.with(json!({ "note": "remap, match, triangulation, normals, sigma and smoothing in one" }));
    }
    Ok(())
}

/// From the frames of two cameras to points.
pub(super) fn pipeline(bench: &mut Bench) -> Result<()> {
    let mut cameras = [Camera18::read(bench, 0)?, Camera18::read(bench, 1)?];
    let mut stereo = Stereo::new(bench)?;
    for threads in [1, 2] {
        let mut stages = [Vec::new(), Vec::new()];
        bench.time("pipeline", threads, || {
            let start = std::time::Instant::now();
            // As in a cell, where each camera has a process of its own.
            cameras.par_iter_mut().try_for_each(Camera18::decode)?;
            stages[0].push(start.elapsed().as_secs_f64() * 1e3);
            let start = std::time::Instant::now();
            stereo.run(&cameras[0].map, &cameras[1].map)?;
            stages[1].push(start.elapsed().as_secs_f64() * 1e3);
            Ok(())
        })?;
        let accuracy = stereo.accuracy(&cameras[0].map);
        let [decode_ms, match_ms] = stages.map(|mut ms| fringe::math::statistics::median(&mut ms));
        let Some(row) = bench.rows.last_mut() else { continue };
        row.with(json!({ "decode_ms": decode_ms, "match_ms": match_ms, "points": stereo.count }));
        row.with(accuracy);
    }
    Ok(())
}

/// A matcher with its output and what its points are compared with.
struct Stereo {
    matcher: Matcher,
    points: Vec<Point>,
    count: usize,
    left: Camera,
    /// Rotation of the left camera onto the rectified one, and that one's projection.
    rotation: Matrix3<f64>,
    projection: Vec<f64>,
    depth_mm: Vec<f32>,
    valid: Vec<u8>,
}

impl Stereo {
    fn new(bench: &Bench) -> Result<Self> {
        let [left, right] = bench.cameras()?;
        let matcher = Matcher::new(&left, &right, &MatchSettings::default())?;
        let points = vec![Point::zeroed(); matcher.capacity()];
        Ok(Self {
            matcher,
            points,
            count: 0,
            left,
            rotation: Matrix3::from_row_slice(&bench.matrix("R1", 3, 3)?),
            projection: bench.matrix("P1", 3, 4)?,
            depth_mm: bench.picture("truth_rect_depth")?,
            valid: bench.marks("truth_rect_valid")?,
        })
    }

    fn run(&mut self, left: &PhaseMap, right: &PhaseMap) -> Result<()> {
        self.count = self.matcher.run(&left.view(), &right.view(), 0, &mut self.points)?.points as usize;
        Ok(())
    }

    /// Where a direction from the left camera falls in its rectified picture: the four pixels around it, and the way into them;
    /// `None` outside the picture, and where the truth has no depth at any of them.
    fn rectified(&self, direction: Vector3<f64>) -> Option<([usize; 4], [f64; 2])> {
        let at = self.rotation * direction;
        let u = self.projection[0] * at.x / at.z + self.projection[2];
        let v = self.projection[5] * at.y / at.z + self.projection[6];
        let (c, r) = (u.floor(), v.floor());
        let (width, height) = (self.left.width_px as usize, self.left.height_px as usize);
        if !(c >= 0.0 && r >= 0.0 && c + 1.0 < width as f64 && r + 1.0 < height as f64) {
            return None;
        }
        let corner = r as usize * width + c as usize;
        let four = [corner, corner + 1, corner + width, corner + width + 1];
        four.iter().any(|i| self.valid[*i] == 1).then_some((four, [u - c, v - r]))
    }

    /// Number of valid pixels of the left picture of which the truth has a depth.
    fn lit(&self, left: &PhaseMap) -> usize {
        let width = self.left.width_px as usize;
        let lit = |pixel: &usize| {
            let at = Point2::new((pixel % width) as f64, (pixel / width) as f64);
            let direction = self.left.normalised_from_pixel(at).map(|at| at.push(1.0));
            left.valid[*pixel] == 1 && direction.and_then(|d| self.rectified(d)).is_some()
        };
        (0..left.valid.len()).filter(lit).count()
    }

    /// Depth errors against the truth, which is given at the pixels of the rectified left camera, and the share of the lit pixels
    /// that have a point.
    fn accuracy(&self, left: &PhaseMap) -> Value {
        let (mut squares, mut good, mut outliers, mut hits) = (0.0, 0_usize, 0_usize, 0_usize);
        for point in &self.points[..self.count] {
            let at = (self.left.camera_from_world * point.position()).coords;
            let Some((four, [a, b])) = self.rectified(at) else { continue };
            hits += 1;
            if four.iter().any(|i| self.valid[*i] == 0) {
                continue;
            }
            let z = four.map(|i| f64::from(self.depth_mm[i]));
            let truth = (1.0 - b) * ((1.0 - a) * z[0] + a * z[1]) + b * ((1.0 - a) * z[2] + a * z[3]);
            let error = (self.rotation * at).z - truth;
            if error.is_nan() {
                continue;
            }
            if error.abs() > OUTLIER_MM {
                outliers += 1;
            } else {
                good += 1;
                squares += error * error;
            }
        }
        let lit = self.lit(left);
        json!({
            "rms_um": root_mean(squares, good).map(|rms| rms * 1e3),
            "matched": (lit > 0).then(|| hits as f64 / lit as f64),
            "outliers": (good + outliers > 0).then_some(outliers),
        })
    }
}
