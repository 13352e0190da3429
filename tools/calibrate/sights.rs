//! What the cameras saw of the target, and where the projectors' light met it.

use crate::pipeline::decode_views;
use crate::progress::Progress;
use anyhow::{Result, bail};
use fringe::calibration::{Device, DeviceKind, Observations, Sight, View, projector_pixel};
use fringe::decode::DecodeSettings;
use fringe::frame::Frame;
use fringe::pattern::{Axis, PatternSet};
use fringe::target::{Ambiguity, Detection, TargetSettings, TargetSpec, detect};
use rig::recording::{RecordedCamera, RecordedProjector, Recording};
use std::collections::BTreeSet;

/// Everything that was found.
#[derive(Default)]
pub struct Gathered {
    devices: Vec<Device>,
    poses: Vec<String>,
    views: Vec<View>,
    /// Which cameras each projector lit.
    pub lit: Vec<(String, Vec<String>)>,
    /// Pictures without target, one line each.
    pub notes: Vec<String>,
}

impl Gathered {
    /// As the adjustment takes it.
    pub fn observations(&self, target: &TargetSpec) -> Observations {
        Observations {
            devices: self.devices.clone(),
            target_mm: target.board_points_mm().into_iter().map(|(_, point)| point).collect(),
            poses: self.poses.clone(),
            views: self.views.clone(),
        }
    }

    /// A new pose; its number.
    pub fn pose(&mut self, name: String) -> usize {
        self.poses.push(name);
        self.poses.len() - 1
    }

    /// Number of a device, made when it is new; one size for all its pictures.
    pub fn device(&mut self, name: &str, kind: DeviceKind, width_px: u32, height_px: u32) -> Result<usize> {
        if let Some(index) = self.devices.iter().position(|d| d.name == name) {
            let known = &self.devices[index];
            if (known.width_px, known.height_px) != (width_px, height_px) {
                bail!(
                    "\"{name}\" has {width_px} × {height_px} px here and {} × {} px in an earlier pose: one size for all",
                    known.width_px,
                    known.height_px
                );
            }
            return Ok(index);
        }
        self.devices.push(Device { name: name.to_owned(), kind, width_px, height_px });
        Ok(self.devices.len() - 1)
    }

    /// Looks for the target in a picture; what is not found becomes a note.
    pub fn look(&mut self, frame: &Frame, target: &TargetSpec, place: &str) -> Option<Detection> {
        match detect(&frame.view(), target, &TargetSettings::default()) {
            Ok(detection) => Some(detection),
            Err(error) => {
                self.notes.push(format!("{place}: {error}; left out"));
                None
            }
        }
    }

    /// Adds a camera's view.
    pub fn add(&mut self, device: usize, pose: usize, detection: &Detection) {
        let sights = detection
            .points
            .iter()
            .map(|p| Sight {
                index: index(detection, p.index),
                pixel: p.pixel,
                covariance_px2: p.covariance_px2,
            })
            .collect();
        let may_be_turned = detection.ambiguity != Ambiguity::None;
        self.views.push(View { device, pose, sights, may_be_turned });
    }
}

fn index(detection: &Detection, (column, row): (u32, u32)) -> usize {
    row as usize * detection.columns as usize + column as usize
}

/// Finds the target in all recordings.
pub fn gather(recordings: &[Recording], target: &TargetSpec) -> Result<Gathered> {
    let mut all = Gathered::default();
    let total = recordings.iter().flat_map(|r| &r.projectors).map(|p| p.cameras.len()).sum();
    let mut progress = Progress::new(total, "finding targets");
    for recording in recordings {
        let pose = all.pose(recording.folder.display().to_string());
        let mut seen: Vec<(String, Detection)> = Vec::new();
        for projector in &recording.projectors {
            for camera in &projector.cameras {
                progress.step();
                if seen.iter().any(|(name, _)| *name == camera.name) {
                    continue;
                }
                let device =
                    all.device(&camera.name, DeviceKind::Camera, camera.width_px, camera.height_px)?;
                let place = format!("{}: camera \"{}\"", recording.folder.display(), camera.name);
                let frame = bright_frame(recording, projector, camera)?;
                let Some(detection) = all.look(&frame, target, &place) else { continue };
                all.add(device, pose, &detection);
                seen.push((camera.name.clone(), detection));
            }
            all.note_lit(projector);
        }
        read_projectors(&mut all, recording, pose, &seen)?;
    }
    Ok(all)
}

impl Gathered {
    fn note_lit(&mut self, projector: &RecordedProjector) {
        let cameras: Vec<String> = projector.cameras.iter().map(|c| c.name.clone()).collect();
        if self.lit.iter().all(|(name, _)| *name != projector.name) {
            self.lit.push((projector.name.clone(), cameras));
        }
    }
}

/// The white frame, or the mean of the sine frames where there is none.
fn bright_frame(
    recording: &Recording,
    projector: &RecordedProjector,
    camera: &RecordedCamera,
) -> Result<Frame> {
    let mut first = 0;
    let mut sines = BTreeSet::new();
    for set in &projector.sequence {
        match set {
            PatternSet::White {} => return Ok(recording.load(&projector.name, &camera.name, first)?),
            PatternSet::Sine { .. } if sines.is_empty() => sines.extend(first..first + set.frames()),
            _ => {}
        }
        first += set.frames();
    }
    let frames = sines
        .iter()
        .map(|n| Ok(recording.load(&projector.name, &camera.name, *n)?))
        .collect::<Result<Vec<_>>>()?;
    mean(&frames).ok_or_else(|| {
        anyhow::anyhow!(
            "{}: projector \"{}\" shows neither white nor sines: the target cannot be seen",
            recording.document.path.display(),
            projector.name
        )
    })
}

fn mean(frames: &[Frame]) -> Option<Frame> {
    let first = frames.first()?;
    let views: Vec<_> = frames.iter().map(Frame::view).collect();
    // Sixteen bits, so that the mean of many frames keeps what it gained.
    let scale = f32::from(u16::MAX) / f32::from(first.full_scale_dn) / frames.len() as f32;
    let pixels = (0..views[0].pixels.len())
        .map(|i| (views.iter().map(|v| v.pixels.get(i)).sum::<f32>() * scale).round() as u16)
        .collect();
    let pixels = fringe::frame::PixelBuffer::Mono16(pixels);
    Some(Frame { width_px: first.width_px, height_px: first.height_px, full_scale_dn: u16::MAX, pixels })
}

/// Projectors with both fringe directions: where their light met the target's points, as each camera tells it.
fn read_projectors(
    all: &mut Gathered,
    recording: &Recording,
    pose: usize,
    seen: &[(String, Detection)],
) -> Result<()> {
    for projector in &recording.projectors {
        let has = |axis| {
            projector.sequence.iter().any(|s| matches!(s, PatternSet::Sine { axis: a, .. } if *a == axis))
        };
        // One camera is enough, and two would tell the same light twice: the one that saw most points.
        let cameras = projector.cameras.iter().filter_map(|c| seen.iter().find(|(name, _)| *name == c.name));
        let best = cameras.max_by_key(|(_, detection)| detection.points.len());
        let (true, true, Some((camera, detection))) = (has(Axis::X), has(Axis::Y), best) else { continue };
        let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
        let views = decode_views(recording, &settings, |p, c| p == projector.name && c == camera)?;
        let Some((x, y)) = views.first().and_then(|v| v.map(Axis::X).zip(v.map(Axis::Y))) else { continue };
        let sights: Vec<Sight> = detection
            .points
            .iter()
            .filter_map(|point| {
                let radius_px = pitch_px(detection, point.index)?;
                let (pixel, covariance_px2) = projector_pixel(&x.view(), &y.view(), point.pixel, radius_px)?;
                Some(Sight { index: index(detection, point.index), pixel, covariance_px2 })
            })
            .collect();
        if sights.len() < 6 {
            all.notes.push(format!(
                "{}: projector \"{}\" lights {} points of the target; left out",
                recording.folder.display(),
                projector.name,
                sights.len()
            ));
            continue;
        }
        let (width, height) = (projector.width_px, projector.height_px);
        let device = all.device(&projector.name, DeviceKind::Projector, width, height)?;
        let may_be_turned = detection.ambiguity != Ambiguity::None;
        all.views.push(View { device, pose, sights, may_be_turned });
    }
    Ok(())
}

/// Distance to the nearest neighbour on the target, camera pixels.
fn pitch_px(detection: &Detection, (column, row): (u32, u32)) -> Option<f64> {
    let here = detection.points.iter().find(|p| p.index == (column, row))?.pixel;
    let near = detection.points.iter().filter(|p| p.index.0.abs_diff(column) + p.index.1.abs_diff(row) == 1);
    near.map(|p| (p.pixel - here).norm()).min_by(f64::total_cmp)
}
