//! A recording that is decoded once, for commands that measure on its clouds.

use super::pairs::{camera_pairs, projector_pairs_or_fault};
use super::task::Task;
use super::{Method, decode, join, match_pairs};
use crate::pipeline::DecodedView;
use anyhow::Result;
use cell::Settings;
use cell::executor::PhaseMethod;
use files::recording::Recording;
use files::rig_file::RigFile;
use fringe::cloud::Point;
use fringe::matching::MatchSettings;
use fringe::surface::SurfaceSettings;

/// The fused cloud of a recording from all its pairs, for commands that measure on it.
pub fn fused_cloud(
    recording: &Recording,
    rig_file: &RigFile,
    method: Method,
    surface: &SurfaceSettings,
) -> Result<Vec<Point>> {
    DecodedRecording::new(recording, rig_file, method, surface)?.cloud(rig_file)
}

/// A recording that was decoded once, for clouds with more than one state of its rig.
pub struct DecodedRecording {
    task: Task,
    views: Vec<DecodedView>,
}

impl DecodedRecording {
    /// Decodes what all pairs of the recording need.
    pub fn new(
        recording: &Recording,
        rig_file: &RigFile,
        method: Method,
        surface: &SurfaceSettings,
    ) -> Result<Self> {
        let pairs = match method {
            Method::Phase => camera_pairs(recording, rig_file)?,
            Method::Projector => projector_pairs_or_fault(recording, rig_file)?,
        };
        let matching = MatchSettings { surface: *surface, ..MatchSettings::default() };
        let task = Task {
            rig: rig_file.clone(),
            pairs,
            settings: Settings { matching, ..Settings::default() },
            phase: PhaseMethod::default(),
            method: method.name(),
            config_sha256: None,
        };
        let views = decode(recording, &task)?;
        Ok(Self { task, views })
    }

    /// The fused cloud of all pairs with the rig in a state.
    pub fn cloud(&self, rig_file: &RigFile) -> Result<Vec<Point>> {
        Ok(self.clouds(rig_file)?.fused)
    }

    /// The same, and the cloud of each pair by itself with its name.
    pub fn clouds(&self, rig_file: &RigFile) -> Result<Clouds> {
        let pairs = match_pairs(&self.task, rig_file, &self.views)?;
        let fused = join(&pairs, &self.task.settings).0;
        Ok(Clouds { fused, pairs: pairs.into_iter().map(|cloud| (cloud.pair.name, cloud.points)).collect() })
    }
}

/// The clouds of a recording.
pub struct Clouds {
    /// That of all pairs.
    pub fused: Vec<Point>,
    /// The cloud of each pair with its name.
    pub pairs: Vec<(String, Vec<Point>)>,
}
