//! From the settings of a cell to its kernels: decoders, matchers, the twin.

use crate::graph::Cell;
use crate::schedule::Right;
use anyhow::{Context, Result, anyhow};
use files::config::{Config, Driver};
use fringe::cloud::Point;
use fringe::decode::Decoder;
use fringe::matching::{MatchError, MatchReport, Matcher};
use fringe::pattern::Axis;
use fringe::phase::PhaseView;
use fringe::projector::{ProjectorMatcher, ProjectorReport, ProjectorSettings};
use std::path::Path;
use twin::{Scene, Twin, TwinSettings};

/// The scene of the twin, with its meshes.
///
/// # Errors
/// A scene that cannot be used; the message names the file.
pub fn scene(config: &Config) -> Result<Scene> {
    let twin = config.twin.as_ref().ok_or_else(|| anyhow!("the configuration has no [twin]"))?;
    let folder = twin.scene.path.parent().unwrap_or(Path::new("."));
    let mut load = |file: &str| std::fs::read(folder.join(file)).map_err(|e| e.to_string());
    Scene::parse(&twin.scene.text, &mut load).with_context(|| twin.scene.path.display().to_string())
}

/// Settings of the twin.
///
/// # Errors
/// Unknown keys or values out of range.
pub fn twin_settings(config: &Config) -> Result<TwinSettings> {
    let twin = config.twin.as_ref().ok_or_else(|| anyhow!("the configuration has no [twin]"))?;
    let written: TwinSettings = config.document.typed("twin.settings", twin.settings.clone())?;
    let settings = TwinSettings { seed: twin.seed, ..written };
    settings.check().with_context(|| config.document.path.display().to_string())?;
    Ok(settings)
}

/// The twin.
///
/// # Errors
/// As [`scene`] and [`twin_settings`], or a rig without projectors.
pub fn twin(config: &Config) -> Result<Twin> {
    let rig = &config.twin.as_ref().ok_or_else(|| anyhow!("the configuration has no [twin]"))?.rig;
    Ok(Twin::new(&scene(config)?, twin_settings(config)?, rig)?)
}

/// The grey value at which a camera is full while a projector is on.
///
/// # Errors
/// A recording that does not hold them.
pub fn full_scale_dn(config: &Config, projector: usize, camera: usize) -> Result<u16> {
    let (projector, camera) = (&config.projectors[projector], &config.cameras[camera]);
    match camera.driver {
        Driver::Twin => Ok(twin_settings(config)?.full_scale_dn()),
        Driver::Recording => {
            let recording =
                config.recording.as_ref().ok_or_else(|| anyhow!("the configuration has no [recording]"))?;
            let seen = recording.recording.projector(&projector.name).and_then(|p| p.camera(&camera.name));
            seen.map(|c| c.full_scale_dn).ok_or_else(|| {
                anyhow!("the recording has no frames of \"{}\" under \"{}\"", camera.name, projector.name)
            })
        }
    }
}

/// The decoder of a camera under a projector.
///
/// # Errors
/// A sequence that tells no absolute phase, or settings out of range.
pub fn decoder(cell: &Cell, projector: usize, camera: usize) -> Result<Decoder> {
    let (light, node) = (&cell.config.projectors[projector], &cell.graph.cameras[camera]);
    let full_scale_dn = full_scale_dn(&cell.config, projector, camera)?;
    let extent_px = [light.width_px, light.height_px];
    Decoder::new(&light.sequence, node.width_px, node.height_px, full_scale_dn, extent_px, &cell.decode)
        .with_context(|| format!("sequence of projector \"{}\"", light.name))
}

/// Either approach of the thesis.
pub enum Method {
    /// Approach 2: two cameras.
    Stereo(Box<Matcher>),
    /// The conventional one: a camera and the projector.
    Projector(Box<ProjectorMatcher>),
}

/// What either approach reports.
#[derive(Debug, serde::Serialize)]
#[serde(untagged)]
pub enum Matched {
    /// Of two cameras.
    Stereo(MatchReport),
    /// Of a camera and the projector.
    Projector(ProjectorReport),
}

impl Matched {
    /// Number of points.
    pub fn points(&self) -> u32 {
        match self {
            Self::Stereo(report) => report.points,
            Self::Projector(report) => report.points,
        }
    }
}

impl Method {
    /// Matches a pair; the points go to `room`.
    ///
    /// # Errors
    /// Views that are not those of this pair.
    pub fn run(
        &mut self,
        views: &[(Axis, PhaseView)],
        pair: u32,
        room: &mut [Point],
    ) -> Result<Matched, MatchError> {
        let along = |axis: Axis| views.iter().find(|(a, _)| *a == axis).map(|(_, view)| view);
        match self {
            Self::Stereo(matcher) => {
                let [(_, left), (_, right)] = views else { return Err(MatchError::NoPhase) };
                Ok(Matched::Stereo(matcher.run(left, right, pair, room)?))
            }
            Self::Projector(matcher) => {
                Ok(Matched::Projector(matcher.run(along(Axis::X), along(Axis::Y), pair, room)?))
            }
        }
    }
}

/// The matcher of a pair, and how many points it may give.
///
/// # Errors
/// Views that are unknown or make no pair.
pub fn matcher(cell: &Cell, pair: usize) -> Result<(Method, usize)> {
    let (names, node) = (&cell.config.rig.pairs[pair], &cell.graph.pairs[pair]);
    let rig = &cell.config.rig;
    let left = rig.camera(&names.left).with_context(|| format!("camera \"{}\" is unknown", names.left))?;
    match node.right {
        Right::Camera(_) => {
            let right =
                rig.camera(&names.right).with_context(|| format!("camera \"{}\" is unknown", names.right))?;
            let matcher = Matcher::new(left, right, &cell.matching)?;
            let capacity = matcher.capacity();
            Ok((Method::Stereo(Box::new(matcher)), capacity))
        }
        Right::Projector => {
            let projector = rig
                .projector(&names.right)
                .with_context(|| format!("projector \"{}\" is not in the rig file", names.right))?;
            let settings = ProjectorSettings {
                depth_mm: cell.matching.depth_mm,
                surface: cell.matching.surface,
                ..ProjectorSettings::default()
            };
            let matcher = ProjectorMatcher::new(left, projector, &settings)?;
            let capacity = matcher.capacity();
            Ok((Method::Projector(Box::new(matcher)), capacity))
        }
    }
}

/// Builds what the stages will build, to find out before a process starts whether it can be built.
///
/// # Errors
/// Settings that a kernel refuses, cameras that make no pair, a scene that cannot be traced.
pub fn rehearse(cell: &Cell) -> Result<()> {
    let at = || cell.config.document.path.display().to_string();
    for (number, projector) in cell.graph.projectors.iter().enumerate() {
        for &camera in &projector.cameras {
            decoder(cell, number, camera).with_context(at)?;
        }
    }
    for pair in 0..cell.graph.pairs.len() {
        matcher(cell, pair)
            .with_context(|| format!("pair \"{}\"", cell.graph.pairs[pair].name))
            .with_context(at)?;
    }
    if cell.config.twin.is_some() {
        twin(&cell.config).with_context(at)?;
    }
    Ok(())
}
