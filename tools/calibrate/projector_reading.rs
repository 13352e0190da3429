//! Coordinates of a projector's light at the points of the target.

use crate::pipeline::RecordedView;
use anyhow::Result;
use cell::executor::PhaseMethod;
use characterise::calibration::{ImagePoint, projector_pixel};
use characterise::target::{DetectedPoint, Detection};
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::decode::DecodeSettings;
use fringe::pattern::{Axis, PatternSet};

/// The first axis along which no set of a sequence gives a coordinate.
pub fn axis_without_coordinates(sequence: &[PatternSet]) -> Option<&'static str> {
    let tells = |set: &PatternSet, axis| {
        (set.period_px().is_some() || matches!(set, PatternSet::Gray { .. })) && set.axis() == Some(axis)
    };
    let axes = [(Axis::X, "x"), (Axis::Y, "y")];
    axes.into_iter().find(|(axis, _)| !sequence.iter().any(|set| tells(set, *axis))).map(|(_, name)| name)
}

/// A projector with coordinates along both axes, and the camera in which its coordinates are read at the target's points.
pub struct ProjectorReading<'a> {
    pub recording: &'a Recording,
    pub projector: &'a RecordedProjector,
    pub pose: usize,
    pub camera: &'a RecordedCamera,
    /// Number of that camera among the devices.
    pub device: usize,
    pub detection: Detection,
}

impl<'a> ProjectorReading<'a> {
    /// One camera is enough, two would count the same information twice: the one that found most points; else why there is none.
    pub fn new(
        recording: &'a Recording,
        projector: &'a RecordedProjector,
        pose: usize,
        seen: &[(usize, String, Detection)],
    ) -> Result<Self, String> {
        if let Some(axis) = axis_without_coordinates(&projector.sequence) {
            return Err(format!("its sequence shows neither sine nor gray sets with axis = \"{axis}\""));
        }
        let cameras = projector
            .cameras
            .iter()
            .filter_map(|c| Some((c, seen.iter().find(|(_, name, _)| *name == c.name)?)));
        let (camera, (device, _, detection)) = cameras
            .max_by_key(|(_, (_, _, d))| d.points.len())
            .ok_or("no camera shows the target in its light")?;
        let (device, detection) = (*device, detection.clone());
        Ok(Self { recording, projector, pose, camera, device, detection })
    }

    /// Its pixels at the target's points; `None` where the sequence has no phase along both axes.
    pub fn read(&self) -> Result<Option<Vec<ImagePoint>>> {
        let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
        let view = RecordedView { recording: self.recording, projector: self.projector, camera: self.camera };
        let maps = view.decode(&settings, PhaseMethod::default(), &mut || {})?;
        let along = |axis| maps.iter().map(|decoded| &decoded.map).find(|map| map.info.axis == axis);
        let Some((x, y)) = along(Axis::X).zip(along(Axis::Y)) else { return Ok(None) };
        let detection = &self.detection;
        let image_point = |point: &DetectedPoint| {
            let radius_px = pitch_px(detection, point.index)?;
            let read = projector_pixel(&x.view(), &y.view(), point.pixel, radius_px)?;
            Some(read.image_point(index(detection, point.index), self.device, &point.covariance_px2))
        };
        Ok(Some(detection.points.iter().filter_map(image_point).collect()))
    }
}

/// Number of a point in the order of the target's list.
pub fn index(detection: &Detection, (column, row): (u32, u32)) -> usize {
    row as usize * detection.columns as usize + column as usize
}

/// Distance to the nearest neighbour on the target, camera pixels.
pub fn pitch_px(detection: &Detection, (column, row): (u32, u32)) -> Option<f64> {
    let here = detection.points.iter().find(|p| p.index == (column, row))?.pixel;
    let near = detection.points.iter().filter(|p| p.index.0.abs_diff(column) + p.index.1.abs_diff(row) == 1);
    near.map(|p| (p.pixel - here).norm()).min_by(f64::total_cmp)
}
