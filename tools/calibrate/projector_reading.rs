//! Coordinates of a projector's light at the points of the target.

use crate::pipeline::RecordedView;
use anyhow::Result;
use cell::executor::PhaseMethod;
use characterise::calibration::{ImagePoint, projector_pixel};
use characterise::target::{DetectedPoint, Detection, FaceSighting};
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::decode::DecodeSettings;
use fringe::pattern::{Axis, PatternSet};
use std::collections::BTreeMap;

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
    /// Number of the first point of the face among those of all faces.
    pub first: usize,
    /// The face as that camera sees it.
    pub detection: Detection,
}

impl<'a> ProjectorReading<'a> {
    /// One for each face. One camera is enough, two would count the same information twice: the one that found most points; else why
    /// there is none.
    pub fn of_faces(
        recording: &'a Recording,
        projector: &'a RecordedProjector,
        pose: usize,
        seen: &[(usize, String, Vec<FaceSighting>)],
    ) -> Result<Vec<Self>, String> {
        if let Some(axis) = axis_without_coordinates(&projector.sequence) {
            return Err(format!("its sequence shows neither sine nor gray sets with axis = \"{axis}\""));
        }
        let cameras = projector
            .cameras
            .iter()
            .filter_map(|c| Some((c, seen.iter().find(|(_, name, _)| *name == c.name)?)));
        // By face: the camera, its number, and the face.
        let mut best: BTreeMap<usize, (&RecordedCamera, usize, &FaceSighting)> = BTreeMap::new();
        for (camera, (device, _, faces)) in cameras {
            for face in faces {
                let known = best.get(&face.face).map_or(0, |(_, _, known)| known.detection.points.len());
                if face.detection.points.len() >= known {
                    best.insert(face.face, (camera, *device, face));
                }
            }
        }
        if best.is_empty() {
            return Err("no camera shows the target in its light".to_owned());
        }
        let reading = |(camera, device, face): (&'a RecordedCamera, usize, &FaceSighting)| {
            let (first, detection) = (face.first, face.detection.clone());
            Self { recording, projector, pose, camera, device, first, detection }
        };
        Ok(best.into_values().map(reading).collect())
    }

    /// Whether both are of the same projector in the same pose.
    pub fn is_beside(&self, other: &Self) -> bool {
        self.pose == other.pose && self.projector.name == other.projector.name
    }

    /// Its pixels at the target's points; `None` where the sequence has no phase along both axes.
    pub fn read(&self) -> Result<Option<Vec<ImagePoint>>> {
        let view = RecordedView { recording: self.recording, projector: self.projector, camera: self.camera };
        let maps = view.decode(&decoding(), PhaseMethod::default(), &mut || {})?;
        let along = |axis| maps.iter().map(|decoded| &decoded.map).find(|map| map.info.axis == axis);
        let Some((x, y)) = along(Axis::X).zip(along(Axis::Y)) else { return Ok(None) };
        let detection = &self.detection;
        let image_point = |point: &DetectedPoint| {
            let radius_px = pitch_px(detection, point.index)?;
            let read = projector_pixel(&x.view(), &y.view(), point.pixel, radius_px, point.blur_px)?;
            let number = self.first + index(detection, point.index);
            Some(read.image_point(number, self.device, &point.covariance_px2))
        };
        Ok(Some(detection.points.iter().filter_map(image_point).collect()))
    }
}

/// Settings of the decoder for the light on a target: its edges are contradictions, however many they are; and what the footprint does is
/// taken off where the light is read, by the blur of the corner itself. A flat target, all of one slope, does not tell the decoder how large
/// it is, and beside edges it corrects nothing.
pub fn decoding() -> DecodeSettings {
    DecodeSettings { max_contradiction: 1e6, footprint_px: Some(0.0), ..DecodeSettings::default() }
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
