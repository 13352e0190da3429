//! The flow on files: from the frames of a recording to phase maps. The cell does the same from shared memory.

use crate::phase_method::PhaseMethod;
use crate::progress::Progress;
use anyhow::{Context, Result};
use files::error::FileError;
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::cloud::Point;
use fringe::decode::{DecodeReport, DecodeSettings, Decoder, Diagnosis, Exposed, merge_exposures};
use fringe::frame::Frame;
use fringe::matching::{MatchError, MatchReport, Matcher};
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::PhaseMap;
use rayon::prelude::*;
use std::ops::Range;

/// Frames that are read side by side; more only costs memory.
const READ_AHEAD: usize = 8;

/// What one camera saw of one projector, decoded: one map per axis of the sequence.
#[derive(Debug)]
pub struct DecodedView {
    /// Name of the projector that was on.
    pub projector: String,
    /// Name of the camera.
    pub camera: String,
    /// In the order of [`Decoder::axes`].
    pub maps: Vec<DecodedMap>,
}

/// One axis of a view.
#[derive(Debug)]
pub struct DecodedMap {
    /// Absolute phase of each pixel.
    pub map: PhaseMap,
    /// How it came about; of several exposures, that with the most valid pixels.
    pub report: DecodeReport,
    /// What the order of each pixel rests on; empty where it was not asked for, or several exposures made the map.
    pub diagnosis: Vec<Diagnosis>,
    /// What noise makes probable.
    pub expected: Expected,
    /// Between black and white; absent without a code, and for several exposures.
    pub threshold: Option<Threshold>,
    /// Pixels that each exposure tells best; empty for one exposure.
    pub best_of: Vec<usize>,
}

/// Numbers of errors to be expected among the valid pixels of a map, before neighbours repair them.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
#[allow(clippy::struct_field_names, reason = "keys of the machine-readable result")]
pub struct Expected {
    /// Wrong orders, from phase noise and bits together.
    pub wrong_orders_expected: f64,
    /// The part of them that comes from bits.
    pub wrong_orders_by_bits: f64,
    /// Wrong bits, most of which change no order; absent without a code.
    pub wrong_bits_expected: Option<f64>,
}

impl Expected {
    fn of(map: &PhaseMap, diagnosis: &[Diagnosis]) -> Self {
        let valid = || diagnosis.iter().zip(&map.valid).filter(|(_, valid)| **valid == 1).map(|(d, _)| d);
        let sum = |part: fn(&Diagnosis) -> f32| valid().map(|d| f64::from(part(d))).sum::<f64>();
        let coded = valid().any(|d| !d.wrong_bits.is_nan());
        Self {
            wrong_orders_expected: sum(|d| d.wrong_order),
            wrong_orders_by_bits: sum(|d| d.wrong_order_by_bits),
            wrong_bits_expected: coded.then(|| sum(|d| d.wrong_bits)),
        }
    }

    fn and(self, other: Self) -> Self {
        let bits = self.wrong_bits_expected.zip(other.wrong_bits_expected);
        Self {
            wrong_orders_expected: self.wrong_orders_expected + other.wrong_orders_expected,
            wrong_orders_by_bits: self.wrong_orders_by_bits + other.wrong_orders_by_bits,
            wrong_bits_expected: bits.map(|(a, b)| a + b),
        }
    }
}

/// Between black and white, medians over the valid pixels.
#[derive(Debug, Clone, Copy, serde::Serialize)]
#[allow(clippy::struct_field_names, reason = "keys of the machine-readable result")]
pub struct Threshold {
    /// What the bits are compared with, DN.
    pub threshold_median_dn: f32,
    /// Its standard uncertainty for one bit, DN.
    pub u_threshold_median_dn: f32,
    /// Half the difference between white and black, DN.
    pub contrast_median_dn: f32,
}

impl Threshold {
    fn of(map: &PhaseMap, diagnosis: &[Diagnosis]) -> Option<Self> {
        let median = |part: fn(&Diagnosis) -> f32| median_valid(map, diagnosis.iter().map(part));
        Some(Self {
            threshold_median_dn: median(|d| d.threshold_dn)?,
            u_threshold_median_dn: median(|d| d.u_threshold_dn)?,
            contrast_median_dn: median(|d| d.contrast_dn)?,
        })
    }
}

/// Median over the valid pixels of a map that have a value.
pub fn median_valid(map: &PhaseMap, values: impl Iterator<Item = f32>) -> Option<f32> {
    let kept = values.zip(&map.valid).filter(|(value, valid)| **valid == 1 && !value.is_nan());
    let mut kept: Vec<f32> = kept.map(|(value, _)| value).collect();
    let middle = kept.len() / 2;
    if kept.is_empty() { None } else { Some(*kept.select_nth_unstable_by(middle, f32::total_cmp).1) }
}

impl DecodedView {
    /// The map of one axis.
    pub fn map(&self, axis: Axis) -> Option<&PhaseMap> {
        self.maps.iter().map(|decoded| &decoded.map).find(|map| map.info.axis == axis)
    }
}

/// Matches the maps of a pair with a matcher made for it: its points, in the order of the left pixels.
///
/// # Errors
/// Maps that do not fit the matcher's cameras or each other.
pub fn match_maps(
    matcher: &mut Matcher,
    left: &PhaseMap,
    right: &PhaseMap,
    pair: usize,
) -> Result<(Vec<Point>, MatchReport), MatchError> {
    let mut points = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    let report = matcher.run(&left.view(), &right.view(), pair as u32, &mut points)?;
    points.truncate(report.points as usize);
    Ok((points, report))
}

/// Decodes the views of a recording that `wanted(projector, camera)` asks for, in the order of the recording.
///
/// # Errors
/// A sequence that tells no absolute phase, or a frame that does not decode.
pub fn decode_views(
    recording: &Recording,
    settings: &DecodeSettings,
    wanted: impl Fn(&str, &str) -> bool,
) -> Result<Vec<DecodedView>> {
    decode_views_by(recording, settings, &PhaseMethod::default(), wanted)
}

/// The same with a method of the user's choice for the wrapped phase.
///
/// # Errors
/// As [`decode_views`], and frames that the method does not take.
pub fn decode_views_by(
    recording: &Recording,
    settings: &DecodeSettings,
    method: &PhaseMethod,
    wanted: impl Fn(&str, &str) -> bool,
) -> Result<Vec<DecodedView>> {
    let views: Vec<(&RecordedProjector, &RecordedCamera)> = recording
        .projectors
        .iter()
        .flat_map(|projector| projector.cameras.iter().map(move |camera| (projector, camera)))
        .filter(|(projector, camera)| wanted(&projector.name, &camera.name))
        .collect();
    let frames = |camera: &RecordedCamera| camera.frames.len() * (1 + camera.longer.len());
    let mut progress = Progress::new(views.iter().map(|(_, camera)| frames(camera)).sum(), "decoding");
    views
        .iter()
        .map(|(projector, camera)| {
            decode_view(recording, projector, camera, (settings, method), &mut || progress.step())
        })
        .collect()
}

/// Decodes one view, all exposures of it; `step` is told of each frame.
///
/// # Errors
/// As [`decode_views`].
pub fn decode_view(
    recording: &Recording,
    projector: &RecordedProjector,
    camera: &RecordedCamera,
    (settings, method): (&DecodeSettings, &PhaseMethod),
    step: &mut dyn FnMut(),
) -> Result<DecodedView> {
    let mut exposures = Vec::new();
    for exposure in 0..=camera.longer.len() {
        let shot = Shot {
            recording,
            projector,
            camera,
            exposure,
            sets: &projector.sequence,
            frames: 0..camera.frames.len(),
            extent_px: [projector.width_px, projector.height_px],
        };
        exposures.push(shot.decode(settings, method, step)?);
    }
    let axes = exposures.first().map_or(0, Vec::len);
    let maps = match exposures.len() {
        1 => exposures.swap_remove(0),
        _ => (0..axes).map(|axis| merge(&exposures, axis, &projector.exposures_ms)).collect(),
    };
    Ok(DecodedView { projector: projector.name.clone(), camera: camera.name.clone(), maps })
}

/// Joins the maps of several exposures along one axis.
fn merge(exposures: &[Vec<DecodedMap>], axis: usize, exposures_ms: &[f64]) -> DecodedMap {
    let maps: Vec<&DecodedMap> = exposures.iter().map(|maps| &maps[axis]).collect();
    let exposed: Vec<Exposed> = maps
        .iter()
        .zip(exposures_ms)
        .map(|(decoded, exposure_ms)| Exposed { map: &decoded.map, exposure_ms: *exposure_ms })
        .collect();
    let (map, best_of) = merge_exposures(&exposed);
    let best = maps.iter().enumerate().max_by_key(|(index, m)| (m.report.valid, usize::MAX - index));
    let mut report = best.map_or_else(|| maps[0].report.clone(), |(_, m)| m.report.clone());
    report.valid = map.valid.iter().map(|v| usize::from(*v)).sum();
    // What the shortest exposure clips and the longest leaves dark no exposure tells.
    report.saturated = maps.iter().map(|m| m.report.saturated).min().unwrap_or(0);
    report.dark = maps.iter().map(|m| m.report.dark).min().unwrap_or(0);
    let expected = maps.iter().map(|m| m.expected).reduce(Expected::and).unwrap_or_default();
    DecodedMap { map, report, diagnosis: Vec::new(), expected, threshold: None, best_of }
}

/// Decodes consecutive sets of a recording, which take these frames, as if the projector had `extent_px` columns and rows.
///
/// # Errors
/// Sets that tell no absolute phase over the extent, or a frame that does not decode.
pub fn decode_sets(
    recording: &Recording,
    projector: &RecordedProjector,
    camera: &RecordedCamera,
    (sets, frames): (&[PatternSet], Range<usize>),
    extent_px: [u32; 2],
    settings: &DecodeSettings,
    step: &mut dyn FnMut(),
) -> Result<Vec<(PhaseMap, DecodeReport)>> {
    let shot = Shot { recording, projector, camera, exposure: 0, sets, frames, extent_px };
    let maps = shot.decode(settings, &PhaseMethod::default(), step)?;
    Ok(maps.into_iter().map(|decoded| (decoded.map, decoded.report)).collect())
}

/// Consecutive sets of what one camera saw of one projector, at one exposure.
struct Shot<'a> {
    recording: &'a Recording,
    projector: &'a RecordedProjector,
    camera: &'a RecordedCamera,
    exposure: usize,
    sets: &'a [PatternSet],
    frames: Range<usize>,
    extent_px: [u32; 2],
}

impl Shot<'_> {
    fn decode(
        &self,
        settings: &DecodeSettings,
        method: &PhaseMethod,
        step: &mut dyn FnMut(),
    ) -> Result<Vec<DecodedMap>> {
        let camera = self.camera;
        let size = (camera.width_px, camera.height_px, camera.full_scale_dn);
        let mut decoder = Decoder::new(self.sets, size.0, size.1, size.2, self.extent_px, settings)
            .with_context(|| self.place())?;
        let mut kept = method.keeper(&decoder);
        let first = self.frames.start;
        let numbers: Vec<usize> = self.frames.clone().collect();
        for batch in numbers.chunks(READ_AHEAD) {
            let load = |number: &usize| {
                self.recording.load_exposed(&self.projector.name, &camera.name, self.exposure, *number)
            };
            let frames: Vec<Result<Frame, FileError>> = batch.par_iter().map(load).collect();
            for (number, frame) in batch.iter().zip(frames) {
                let (frame, index) = (frame?, *number - first);
                decoder.push(index, &frame.view()).with_context(|| frame_place(camera, *number))?;
                kept.keep(index, frame);
                step();
            }
        }
        method.apply(&mut decoder, &kept).with_context(|| self.place())?;
        let axes = decoder.axes();
        let finish = |axis| {
            let mut map = PhaseMap::new(decoder.info(axis)?);
            let report = decoder.finish(axis, &mut map.view_mut())?;
            let diagnosis = decoder.diagnose(axis)?;
            let (expected, threshold) = (Expected::of(&map, &diagnosis), Threshold::of(&map, &diagnosis));
            let diagnosis = if method.keep_diagnosis { diagnosis } else { Vec::new() };
            Ok(DecodedMap { map, report, diagnosis, expected, threshold, best_of: Vec::new() })
        };
        let maps: Result<Vec<_>> = axes.into_iter().map(finish).collect();
        maps.with_context(|| self.place())
    }

    fn place(&self) -> String {
        let file = self.recording.document.path.display();
        let exposure = match self.projector.exposures_ms.get(self.exposure) {
            Some(ms) => format!(", exposure of {ms} ms"),
            None => String::new(),
        };
        format!("{file}: projector \"{}\", camera \"{}\"{exposure}", self.projector.name, self.camera.name)
    }
}

fn frame_place(camera: &RecordedCamera, number: usize) -> String {
    camera.frames.get(number).map_or_else(|| format!("frame {number}"), |path| path.display().to_string())
}
