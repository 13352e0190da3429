//! The flow on files: from the frames of a recording to phase maps. The cell does the same from shared memory.

use crate::progress::Progress;
use anyhow::{Context, Result};
use fringe::cloud::Point;
use fringe::decode::{DecodeReport, DecodeSettings, Decoder};
use fringe::frame::Frame;
use fringe::matching::{MatchError, MatchReport, Matcher};
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::PhaseMap;
use rayon::prelude::*;
use rig::error::FileError;
use rig::recording::{RecordedCamera, RecordedProjector, Recording};
use std::ops::Range;

/// Frames that are read side by side; more only costs memory.
const READ_AHEAD: usize = 8;

/// What one camera saw of one projector, decoded: one map per axis of the sequence.
#[derive(Debug)]
pub struct DecodedView {
    /// Which projector lit.
    pub projector: String,
    /// Which camera looked.
    pub camera: String,
    /// In the order of [`Decoder::axes`].
    pub maps: Vec<(PhaseMap, DecodeReport)>,
}

impl DecodedView {
    /// The map of one axis.
    pub fn map(&self, axis: Axis) -> Option<&PhaseMap> {
        self.maps.iter().map(|(map, _)| map).find(|map| map.info.axis == axis)
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
    let views: Vec<(&RecordedProjector, &RecordedCamera)> = recording
        .projectors
        .iter()
        .flat_map(|projector| projector.cameras.iter().map(move |camera| (projector, camera)))
        .filter(|(projector, camera)| wanted(&projector.name, &camera.name))
        .collect();
    let mut progress = Progress::new(views.iter().map(|(_, camera)| camera.frames.len()).sum(), "decoding");
    views
        .iter()
        .map(|(projector, camera)| {
            decode_view(recording, projector, camera, settings, &mut || progress.step())
        })
        .collect()
}

/// Decodes one view; `step` is told of each frame.
///
/// # Errors
/// As [`decode_views`].
pub fn decode_view(
    recording: &Recording,
    projector: &RecordedProjector,
    camera: &RecordedCamera,
    settings: &DecodeSettings,
    step: &mut dyn FnMut(),
) -> Result<DecodedView> {
    let all = (projector.sequence.as_slice(), 0..camera.frames.len());
    let extent_px = [projector.width_px, projector.height_px];
    let maps = decode_sets(recording, projector, camera, all, extent_px, settings, step)?;
    Ok(DecodedView { projector: projector.name.clone(), camera: camera.name.clone(), maps })
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
    let place = || {
        format!(
            "{}: projector \"{}\", camera \"{}\"",
            recording.document.path.display(),
            projector.name,
            camera.name
        )
    };
    let (width_px, height_px) = (camera.width_px, camera.height_px);
    let mut decoder = Decoder::new(sets, width_px, height_px, camera.full_scale_dn, extent_px, settings)
        .with_context(place)?;
    let first = frames.start;
    let numbers: Vec<usize> = frames.collect();
    for batch in numbers.chunks(READ_AHEAD) {
        let frames: Vec<Result<Frame, FileError>> =
            batch.par_iter().map(|number| recording.load(&projector.name, &camera.name, *number)).collect();
        for (number, frame) in batch.iter().zip(frames) {
            decoder.push(*number - first, &frame?.view()).with_context(|| frame_place(camera, *number))?;
            step();
        }
    }
    let maps = decoder
        .axes()
        .into_iter()
        .map(|axis| {
            let mut map = PhaseMap::new(decoder.info(axis)?);
            let report = decoder.finish(axis, &mut map.view_mut())?;
            Ok((map, report))
        })
        .collect::<Result<Vec<_>>>();
    maps.with_context(place)
}

fn frame_place(camera: &RecordedCamera, number: usize) -> String {
    camera.frames.get(number).map_or_else(|| format!("frame {number}"), |path| path.display().to_string())
}
