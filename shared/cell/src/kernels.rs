//! From the settings of a cell to its kernels: decoders and matchers.

use crate::cell::Cell;
use crate::error::CellError;
use crate::graph::Right;
use fringe::cloud::Point;
use fringe::decode::Decoder;
use fringe::matching::{MatchError, MatchReport, Matcher};
use fringe::pattern::Axis;
use fringe::phase::PhaseView;
use fringe::projector::{ProjectorMatcher, ProjectorReport, ProjectorSettings};

/// The decoder of a camera under a projector.
///
/// # Errors
/// A sequence that tells no absolute phase, or settings out of range.
pub fn decoder(cell: &Cell, projector: usize, camera: usize) -> Result<Decoder, CellError> {
    let (light, node) = (&cell.config.projectors[projector], &cell.graph.cameras[camera]);
    let full_scale_dn = cell.format(projector, camera)?.full_scale_dn;
    let extent_px = [light.width_px, light.height_px];
    Decoder::new(&light.sequence, node.width_px, node.height_px, full_scale_dn, extent_px, &cell.decode)
        .map_err(|source| CellError::Decode { projector: light.name.clone(), source })
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
pub fn matcher(cell: &Cell, pair: usize) -> Result<(Method, usize), CellError> {
    let (names, node) = (&cell.config.rig.pairs[pair], &cell.graph.pairs[pair]);
    let rig = &cell.config.rig;
    let unknown = |kind: &str, name: &str| {
        CellError::Unknown(format!("pair \"{}\": {kind} \"{name}\" is not in the rig file", names.name))
    };
    let refused = |source: MatchError| CellError::Match { pair: names.name.clone(), source };
    let left = rig.camera(&names.left).ok_or_else(|| unknown("camera", &names.left))?;
    match node.right {
        Right::Camera(_) => {
            let right = rig.camera(&names.right).ok_or_else(|| unknown("camera", &names.right))?;
            let matcher = Matcher::new(left, right, &cell.matching).map_err(refused)?;
            let capacity = matcher.capacity();
            Ok((Method::Stereo(Box::new(matcher)), capacity))
        }
        Right::Projector => {
            let projector = rig.projector(&names.right).ok_or_else(|| unknown("projector", &names.right))?;
            let settings = ProjectorSettings {
                depth_mm: cell.matching.depth_mm,
                surface: cell.matching.surface,
                ..ProjectorSettings::default()
            };
            let matcher = ProjectorMatcher::new(left, projector, &settings).map_err(refused)?;
            let capacity = matcher.capacity();
            Ok((Method::Projector(Box::new(matcher)), capacity))
        }
    }
}

/// Builds what the stages will build, to find out before a process starts whether it can be built.
///
/// # Errors
/// Settings that a kernel refuses, cameras that make no pair.
pub fn check(cell: &Cell) -> Result<(), CellError> {
    let at = |error: CellError| error.at(cell.config.document.path.as_path());
    for (number, projector) in cell.graph.projectors.iter().enumerate() {
        for &camera in &projector.cameras {
            decoder(cell, number, camera).map_err(at)?;
        }
    }
    for pair in 0..cell.graph.pairs.len() {
        matcher(cell, pair).map_err(at)?;
    }
    Ok(())
}
