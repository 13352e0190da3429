//! The flow on files: from the frames of a recording to phase maps. The cell does the same from shared memory.

use crate::progress::Progress;
use anyhow::{Context, Result};
use cell::executor::{Decoded, PhaseMethod, View, ViewDecoder};
use files::error::FileError;
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::decode::DecodeSettings;
use fringe::frame::{Frame, SharedFrame};
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::PhaseMap;
use fringe::sensor::Sensor;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;

/// Fewer lit pixels may have the same phase by chance.
const LEAST_LIT: usize = 100;

/// Frames that are read side by side; more only costs memory.
const READ_AHEAD: usize = 8;

/// What one camera saw of one projector, decoded: one map per axis of the sequence.
#[derive(Debug)]
pub struct DecodedView {
    /// Name of the projector that was on.
    pub projector: String,
    /// Name of the camera.
    pub camera: String,
    /// In the order of [`ViewDecoder::axes`].
    pub maps: Vec<Decoded>,
}

impl DecodedView {
    /// The map of one axis.
    pub fn map(&self, axis: Axis) -> Option<&PhaseMap> {
        self.maps.iter().map(|decoded| &decoded.map).find(|map| map.info.axis == axis)
    }
}

/// How views are decoded.
pub struct Decoding<'a> {
    /// Limits and assumptions, the same for all cameras.
    pub settings: &'a DecodeSettings,
    /// What the rig file states of the sensors, by camera.
    pub sensors: &'a BTreeMap<String, Sensor>,
    /// Where the wrapped phase comes from.
    pub method: PhaseMethod,
    /// Whether what each pixel's order rests on is kept; it takes twice the memory of a map.
    pub keep_diagnosis: bool,
}

/// Decodes the views of a recording that `wanted(projector, camera)` asks for, in the order of the recording, with sensors as a
/// rig file states them.
///
/// # Errors
/// A sequence that gives no absolute phase, or a frame that does not decode.
pub fn decode_views(
    recording: &Recording,
    settings: &DecodeSettings,
    sensors: &BTreeMap<String, Sensor>,
    wanted: impl Fn(&str, &str) -> bool,
) -> Result<Vec<DecodedView>> {
    let method = PhaseMethod::default();
    decode_views_by(recording, &Decoding { settings, sensors, method, keep_diagnosis: false }, wanted)
}

/// The same in a way of the user's choice.
///
/// # Errors
/// As [`decode_views`], and frames that the method does not take.
pub fn decode_views_by(
    recording: &Recording,
    how: &Decoding,
    wanted: impl Fn(&str, &str) -> bool,
) -> Result<Vec<DecodedView>> {
    let views: Vec<(&RecordedProjector, &RecordedCamera)> = recording
        .projectors
        .iter()
        .flat_map(|projector| projector.cameras.iter().map(move |camera| (projector, camera)))
        .filter(|(projector, camera)| wanted(&projector.name, &camera.name))
        .collect();
    let frames = views.iter().map(|(_, camera)| camera.shown().count()).sum();
    let mut progress = Progress::new(frames, "decoding");
    let decode = |(projector, camera): &(&RecordedProjector, &RecordedCamera)| {
        let view = RecordedView { recording, projector, camera };
        let sensor = how.sensors.get(&camera.name).copied().unwrap_or_default();
        let mut maps = view.decode(&how.settings.of_camera(sensor), how.method, &mut || progress.step())?;
        if !how.keep_diagnosis {
            for decoded in &mut maps {
                decoded.diagnosis = Vec::new();
            }
        }
        Ok(DecodedView { projector: projector.name.clone(), camera: camera.name.clone(), maps })
    };
    let decoded = views.iter().map(decode).collect::<Result<Vec<DecodedView>>>()?;
    refuse_copies(recording, &decoded)?;
    Ok(decoded)
}

/// Refuses two cameras with the same phases, bit by bit: noise never repeats, so that one has the frames of the other.
fn refuse_copies(recording: &Recording, views: &[DecodedView]) -> Result<()> {
    let same = |a: &Decoded, b: &Decoded| {
        let lit: usize = a.map.valid.iter().map(|valid| usize::from(*valid)).sum();
        lit >= LEAST_LIT
            && a.map.valid == b.map.valid
            && bytemuck::cast_slice::<f32, u32>(&a.map.phase_rad)
                == bytemuck::cast_slice::<f32, u32>(&b.map.phase_rad)
    };
    for (number, view) in views.iter().enumerate() {
        let copied = |other: &&DecodedView| {
            other.projector == view.projector
                && !view.maps.is_empty()
                && view.maps.len() == other.maps.len()
                && view.maps.iter().zip(&other.maps).all(|(a, b)| same(a, b))
        };
        if let Some(other) = views[..number].iter().find(copied) {
            anyhow::bail!(
                "{}: under projector \"{}\" the cameras \"{}\" and \"{}\" have the same frames, but noise never repeats: one folder is a copy of \
                 the other; copy the frames of each camera anew, or record again",
                recording.folder.display(),
                view.projector,
                other.camera,
                view.camera
            );
        }
    }
    Ok(())
}

/// What one camera saw of one projector, as it was recorded.
#[derive(Clone, Copy)]
pub struct RecordedView<'a> {
    /// Where the frames are.
    pub recording: &'a Recording,
    /// The projector that was on.
    pub projector: &'a RecordedProjector,
    /// The camera that took the frames.
    pub camera: &'a RecordedCamera,
}

impl RecordedView<'_> {
    /// Decodes all exposures; `step` is called for each frame.
    ///
    /// # Errors
    /// As [`decode_views_by`].
    pub fn decode(
        self,
        settings: &DecodeSettings,
        method: PhaseMethod,
        step: &mut dyn FnMut(),
    ) -> Result<Vec<Decoded>> {
        let view = View { exposures_ms: &self.projector.exposures_ms, ..self.view() };
        let decoder = ViewDecoder::new(&view, settings, method).with_context(|| self.place())?;
        self.push_all(decoder.with_evidence(), 0..self.camera.shown().count(), step)
    }

    /// Decodes consecutive sets, which take these frames of the first exposure, as if the projector had `extent_px` columns
    /// and rows.
    ///
    /// # Errors
    /// Sets that give no absolute phase over the extent, or a frame that does not decode.
    pub fn decode_sets(
        self,
        (sequence, frames): (&[PatternSet], Range<usize>),
        extent_px: [u32; 2],
        settings: &DecodeSettings,
        step: &mut dyn FnMut(),
    ) -> Result<Vec<Decoded>> {
        let view = View { sequence, extent_px, ..self.view() };
        let decoder =
            ViewDecoder::new(&view, settings, PhaseMethod::default()).with_context(|| self.place())?;
        self.push_all(decoder, frames, step)
    }

    fn view(&self) -> View<'_> {
        View {
            sequence: &self.projector.sequence,
            extent_px: [self.projector.width_px, self.projector.height_px],
            size_px: [self.camera.width_px, self.camera.height_px],
            full_scale_dn: self.camera.full_scale_dn,
            exposures_ms: &[],
        }
    }

    fn push_all(
        self,
        mut decoder: ViewDecoder,
        frames: Range<usize>,
        step: &mut dyn FnMut(),
    ) -> Result<Vec<Decoded>> {
        let first = frames.start;
        let numbers: Vec<usize> = frames.collect();
        for batch in numbers.chunks(READ_AHEAD) {
            let load = |number: &usize| self.recording.load(&self.projector.name, &self.camera.name, *number);
            let frames: Vec<Result<Frame, FileError>> = batch.par_iter().map(load).collect();
            for (number, frame) in batch.iter().zip(frames) {
                let pushed = decoder.push_shared(number - first, &SharedFrame::from(frame?));
                pushed.with_context(|| self.frame_place(*number))?;
                step();
            }
        }
        let maps: Result<Vec<_>, _> = decoder.axes().into_iter().map(|axis| decoder.decoded(axis)).collect();
        maps.with_context(|| self.place())
    }

    fn place(&self) -> String {
        let file = self.recording.document.path.display();
        format!("{file}: projector \"{}\", camera \"{}\"", self.projector.name, self.camera.name)
    }

    fn frame_place(&self, number: usize) -> String {
        let path = self.camera.shown().nth(number);
        path.map_or_else(|| format!("frame {number}"), |path| path.display().to_string())
    }
}
