//! Points of the target found in the images of the cameras, and the projector coordinates there.

use super::projector_reading::{ProjectorReading, index};
use super::target_images::{Source, TargetImage, bright_frame};
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use characterise::calibration::{Device, DeviceKind, Face, ImagePoint, Observations, View};
use characterise::sensor::NoiseEstimate;
use characterise::target::{
    Ambiguity, BlurredEdge, DetectedPoint, FaceSighting, TargetBody, TargetError, TargetSettings, detect_body,
};
use files::recording::{RecordedProjector, Recording};
use fringe::frame::Frame;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Mutex;

/// All detections, ready for the adjustment.
#[derive(Default)]
pub struct Gathered {
    devices: Vec<Device>,
    poses: Vec<String>,
    views: Vec<View>,
    /// Which cameras each projector lit.
    pub lit: Vec<(String, Vec<String>)>,
    /// What was left out, one line each.
    pub notes: Vec<String>,
    /// Projectors that a recording does not characterise, and why.
    missing: Vec<(String, String)>,
    /// The edges of the target that a camera saw in a pose.
    edges: Vec<(usize, Vec<BlurredEdge>)>,
    /// Noise of the cameras, one line for each recording that shows it.
    pub noise: Vec<(String, NoiseEstimate)>,
    /// Every image that was searched.
    pub target_images: Vec<TargetImage>,
    /// Number of images in which the target was found.
    found: usize,
    /// Images in which it was not found, with the reason.
    refused: Vec<(String, TargetError)>,
}

/// The result of searching one image.
pub struct SearchedImage {
    /// Where it comes from, for messages.
    pub place: String,
    /// Columns and rows of the image, px.
    pub size_px: (u32, u32),
    /// The faces of the target that were detected, one of a single board, or why there is none.
    pub found: Result<Vec<FaceSighting>, TargetError>,
    /// Where the image is read from again.
    pub source: Source,
}

/// Searches an image for the target.
pub fn search(frame: &Frame, target: &TargetBody, place: String, source: Source) -> SearchedImage {
    let settings = TargetSettings { edge_blur: true, ..TargetSettings::default() };
    let found = detect_body(&frame.view(), target, &settings);
    SearchedImage { place, size_px: (frame.width_px, frame.height_px), found, source }
}

/// Processes all items in parallel with a progress bar; the results have the order of the items.
pub fn for_all<'a, T: Sync, R: Send>(
    what: &'static str,
    items: &'a [T],
    work: impl Fn(&'a T) -> R + Sync,
) -> Vec<R> {
    let progress = Mutex::new(Progress::new(items.len(), what));
    let worked = items.par_iter().map(|item| {
        let result = work(item);
        if let Ok(mut progress) = progress.lock() {
            progress.step();
        }
        result
    });
    worked.collect()
}

/// The size that most pictures of each camera have; of equally many the one that comes first.
pub fn usual_sizes<'a>(
    pictures: impl Iterator<Item = (&'a str, (u32, u32))>,
) -> BTreeMap<&'a str, (u32, u32)> {
    let mut sizes: BTreeMap<&str, Vec<(u32, u32)>> = BTreeMap::new();
    pictures.for_each(|(camera, size_px)| sizes.entry(camera).or_default().push(size_px));
    let usual = |sizes: Vec<(u32, u32)>| {
        let count = |size: (u32, u32)| sizes.iter().filter(|other| **other == size).count();
        sizes.iter().rev().max_by_key(|size| count(**size)).copied()
    };
    sizes.into_iter().filter_map(|(camera, sizes)| Some((camera, usual(sizes)?))).collect()
}

impl Gathered {
    /// A picture that could be read and has the usual size; another becomes a note.
    pub fn usable(
        &mut self,
        camera: &str,
        sizes: &BTreeMap<&str, (u32, u32)>,
        look: Result<SearchedImage>,
    ) -> Option<SearchedImage> {
        let look = match look {
            Ok(look) => look,
            Err(error) => {
                self.notes.push(format!("{error:#}; left out"));
                return None;
            }
        };
        let usual = sizes.get(camera).copied().unwrap_or(look.size_px);
        if look.size_px != usual {
            let ((width_px, height_px), (usual_width_px, usual_height_px)) = (look.size_px, usual);
            self.notes.push(format!(
                "{}: {width_px} × {height_px} px, most pictures of \"{camera}\" have {usual_width_px} × {usual_height_px}; left out",
                look.place
            ));
            return None;
        }
        Some(look)
    }

    /// The observations for the adjustment.
    pub fn observations(&self, target: &TargetBody) -> Observations {
        let points = target.faces.iter().flat_map(|face| face.spec.board_points_mm());
        Observations {
            devices: self.devices.clone(),
            target_mm: points.map(|(_, point)| point).collect(),
            faces: if target.board().is_some() { Vec::new() } else { faces(target) },
            poses: self.poses.clone(),
            views: self.views.clone(),
        }
    }

    /// A new pose; its number.
    pub fn pose(&mut self, name: String) -> usize {
        self.poses.push(name);
        self.poses.len() - 1
    }

    /// Number of a device, made when it is new; one size for all its images.
    pub fn device(&mut self, name: &str, kind: DeviceKind, width_px: u32, height_px: u32) -> Result<usize> {
        if let Some(index) = self.devices.iter().position(|d| d.name == name) {
            let known = &self.devices[index];
            if (known.width_px, known.height_px) != (width_px, height_px) {
                bail!(
                    "\"{name}\" has {width_px} × {height_px} px here and {} × {} px in an earlier pose; use one size for all",
                    known.width_px,
                    known.height_px
                );
            }
            return Ok(index);
        }
        self.devices.push(Device { name: name.to_owned(), kind, width_px, height_px });
        Ok(self.devices.len() - 1)
    }

    /// Takes what a look found; a refusal becomes a note.
    pub fn take(&mut self, look: SearchedImage, device: usize, pose: usize) -> Option<Vec<FaceSighting>> {
        // A camera that found nothing under one projector is searched again under the next.
        self.target_images.retain(|s| (s.device, s.pose) != (device, pose));
        let why = look.found.as_ref().err().map(ToString::to_string);
        self.target_images.push(TargetImage {
            place: look.place.clone(),
            device,
            pose,
            why,
            source: look.source,
        });
        match look.found {
            Ok(faces) => {
                self.found += 1;
                Some(faces)
            }
            Err(error) => {
                self.notes.push(format!("{}: {error}; left out", look.place));
                self.refused.push((look.place, error));
                None
            }
        }
    }

    /// Refuses what no adjustment can mend: the target in no image, or a larger one than declared in most.
    pub fn check(&self, target: &TargetBody) -> Result<()> {
        let total = self.found + self.refused.len();
        let count = |(columns, rows): (u32, u32)| u64::from(columns) * u64::from(rows);
        // Beside one of several faces others are seen, which are no larger one.
        let declared = target.board().map_or(u64::MAX, |board| count((board.columns, board.rows)));
        let seen = |error: &TargetError| match error {
            TargetError::OtherSize { found, .. } => found.iter().copied().map(count).max(),
            _ => None,
        };
        let larger = self.refused.iter().filter(|(_, error)| seen(error) > Some(declared)).count();
        // The first of those that show most. Smaller ones may be partly hidden, as long as some are seen whole.
        let telling = self.refused.iter().rev().max_by_key(|(_, error)| seen(error));
        match telling {
            Some((place, error)) if self.found == 0 => {
                bail!("none of {total} images can be used; {place}: {error}")
            }
            Some((place, error)) if larger > self.found => {
                bail!("{larger} of {total} images show a larger target; {place}: {error}")
            }
            _ => Ok(()),
        }
    }

    /// Refuses a picture that counts twice, in two poses of a camera or for two cameras in a pose: the places of its points are those of another one, bit
    /// by bit, but noise never repeats. Two views of one camera in one pose are refused elsewhere.
    pub fn refuse_copies(&self) -> Result<()> {
        let is_camera =
            |view: &&View| self.devices.get(view.device).is_some_and(|d| d.kind == DeviceKind::Camera);
        let mut seen: BTreeMap<Vec<[u64; 2]>, Vec<&View>> = BTreeMap::new();
        for view in self.views.iter().filter(is_camera) {
            let places = view.image_points.iter().map(|p| [p.pixel.x.to_bits(), p.pixel.y.to_bits()]);
            let alike = seen.entry(places.collect()).or_default();
            if let Some(first) = alike.iter().find(|v| (v.device == view.device) != (v.pose == view.pose)) {
                bail!(
                    "{}: shows all points at the places of {}, bit by bit, but noise never repeats: one is a copy of the other; a picture counts \
                     once, remove one of them",
                    self.place(view.device, view.pose),
                    self.place(first.device, first.pose)
                );
            }
            alike.push(view);
        }
        Ok(())
    }

    /// Where a camera's view of a pose comes from, or the camera and the pose.
    pub fn place(&self, device: usize, pose: usize) -> String {
        let image = self.target_images.iter().find(|image| (image.device, image.pose) == (device, pose));
        let named = || {
            let device = self.devices.get(device).map_or("", |device| device.name.as_str());
            format!("{device} in {}", self.poses.get(pose).map_or("", String::as_str))
        };
        image.map_or_else(named, |image| image.place.clone())
    }

    /// Projectors that no recording characterises, each with the reasons, and cameras without a view.
    pub fn not_characterised(&self) -> Vec<(String, String)> {
        let viewed = |name: &str| {
            self.views.iter().any(|view| self.devices.get(view.device).is_some_and(|d| d.name == name))
        };
        let mut all: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
        for (name, why) in self.missing.iter().filter(|(name, _)| !viewed(name)) {
            all.entry(name.clone()).or_default().insert(why);
        }
        for device in self.devices.iter().filter(|d| !viewed(&d.name)) {
            all.entry(device.name.clone())
                .or_default()
                .insert("the target was found in none of its pictures");
        }
        let joined = |why: BTreeSet<&str>| why.into_iter().collect::<Vec<_>>().join("; ");
        all.into_iter().map(|(name, why)| (name, joined(why))).collect()
    }

    /// What there is, for messages.
    pub fn summary(&self) -> String {
        let (poses, views) = (self.poses.len(), self.views.len());
        match self.notes.as_slice() {
            [] => format!("{poses} poses, {views} views"),
            [first, ..] => {
                format!("{poses} poses, {views} views, {} left out, the first: {first}", self.notes.len())
            }
        }
    }

    /// Adds a camera's view.
    pub fn add(&mut self, device: usize, pose: usize, faces: &[FaceSighting]) {
        let image_point = |first: usize, number: usize, p: &DetectedPoint| ImagePoint {
            index: first + number,
            pixel: p.pixel,
            covariance_px2: p.covariance_px2,
            link: None,
        };
        let of_face = |FaceSighting { first, detection, .. }: &FaceSighting| -> Vec<ImagePoint> {
            detection.points.iter().map(|p| image_point(*first, index(detection, p.index), p)).collect()
        };
        let image_points = faces.iter().flat_map(of_face).collect();
        let may_be_turned = faces.iter().any(|face| face.detection.ambiguity != Ambiguity::None);
        self.views.push(View { device, pose, image_points, may_be_turned });
        let points = faces.iter().flat_map(|face| &face.detection.points);
        self.edges.push((device, points.filter_map(|p| p.edges).flatten().collect()));
    }

    /// The edges that a camera saw, pose by pose.
    pub fn edges_of(&self, camera: &str) -> Vec<Vec<BlurredEdge>> {
        let named = |device: usize| self.devices.get(device).is_some_and(|d| d.name == camera);
        self.edges.iter().filter(|(device, _)| named(*device)).map(|(_, edges)| edges.clone()).collect()
    }
}

/// Finds the target in all recordings.
pub fn gather(recordings: &[Recording], target: &TargetBody) -> Result<Gathered> {
    let mut all = Gathered::default();
    let looks = for_all("finding targets", recordings, |recording| look_around(recording, target));
    let mut readings = Vec::new();
    let sizes = usual_sizes(
        looks.iter().flatten().filter_map(|(camera, look)| Some((*camera, look.as_ref().ok()?.size_px))),
    );
    for (recording, looks) in recordings.iter().zip(looks) {
        let pose = all.pose(recording.folder.display().to_string());
        let mut seen: Vec<(usize, String, Vec<FaceSighting>)> = Vec::new();
        for (camera, look) in looks {
            let Some(look) = all.usable(camera, &sizes, look) else { continue };
            let (width_px, height_px) = look.size_px;
            let device = all.device(camera, DeviceKind::Camera, width_px, height_px)?;
            let Some(faces) = all.take(look, device, pose) else { continue };
            all.add(device, pose, &faces);
            seen.push((device, camera.to_owned(), faces));
        }
        for projector in &recording.projectors {
            all.note_lit(projector);
            match ProjectorReading::of_faces(recording, projector, pose, &seen) {
                Ok(faces) => readings.extend(faces),
                Err(why) => all.missing.push((projector.name.clone(), why)),
            }
        }
    }
    let read = for_all("reading projectors", &readings, ProjectorReading::read);
    let mut read = read.into_iter();
    for faces in readings.chunk_by(ProjectorReading::is_beside) {
        let points = read.by_ref().take(faces.len()).collect::<Result<Option<Vec<_>>>>()?;
        all.add_projector(&faces[0], points.map(|points| points.concat()))?;
    }
    Ok(all)
}

/// The faces of a target, with their points about point (0, 0) of each.
fn faces(target: &TargetBody) -> Vec<Face> {
    let face = |(number, face): (usize, &characterise::target::TargetFace)| Face {
        name: face.name.clone(),
        first: target.first(number),
        target_from_face: face.target_from_middle * face.spec.middle_mm().inverse(),
        fixed: face.fixed,
    };
    target.faces.iter().enumerate().map(face).collect()
}

/// Each camera in the light of the first projector that shows it the target.
fn look_around<'a>(recording: &'a Recording, target: &TargetBody) -> Vec<(&'a str, Result<SearchedImage>)> {
    let mut looks: Vec<(&str, Result<SearchedImage>)> = Vec::new();
    for projector in &recording.projectors {
        for camera in &projector.cameras {
            let name = camera.name.as_str();
            let found = |look: &Result<SearchedImage>| look.as_ref().is_ok_and(|look| look.found.is_ok());
            if looks.iter().any(|(other, look)| *other == name && found(look)) {
                continue;
            }
            let place = format!("{}: camera \"{name}\"", recording.folder.display());
            let source = Source::Recorded(Box::new((recording.clone(), projector.clone(), camera.clone())));
            let look = bright_frame(recording, projector, camera)
                .with_context(|| place.clone())
                .map(|frame| search(&frame, target, place, source));
            looks.push((name, look));
        }
    }
    looks
}

impl Gathered {
    fn note_lit(&mut self, projector: &RecordedProjector) {
        let cameras: Vec<String> = projector.cameras.iter().map(|c| c.name.clone()).collect();
        if self.lit.iter().all(|(name, _)| *name != projector.name) {
            self.lit.push((projector.name.clone(), cameras));
        }
    }
}

impl Gathered {
    fn add_projector(
        &mut self,
        reading: &ProjectorReading,
        image_points: Option<Vec<ImagePoint>>,
    ) -> Result<()> {
        let Some(image_points) = image_points else { return Ok(()) };
        let (projector, place) = (reading.projector, reading.recording.folder.display());
        if image_points.len() < 6 {
            let (name, count) = (&projector.name, image_points.len());
            self.notes
                .push(format!("{place}: projector \"{name}\" lights {count} points of the target; left out"));
            self.missing.push((name.clone(), "it lights too few points of the target".to_owned()));
            return Ok(());
        }
        let (width, height) = (projector.width_px, projector.height_px);
        let device = self.device(&projector.name, DeviceKind::Projector, width, height)?;
        let may_be_turned = reading.detection.ambiguity != Ambiguity::None;
        self.views.push(View { device, pose: reading.pose, image_points, may_be_turned });
        Ok(())
    }
}
