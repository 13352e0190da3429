//! From the phases of a pair to its cloud.

use crate::error::CellError;
use fringe::cloud::Point;
use fringe::geometry::rig::{Pair, Rig};
use fringe::matching::{MatchError, MatchReport, MatchSettings, Matcher};
use fringe::pattern::Axis;
use fringe::phase::PhaseView;
use fringe::projector::{ProjectorMatcher, ProjectorReport, ProjectorSettings};
use fringe::surface::Cause;

/// The phases of one camera under one projector, by their projector axis.
#[derive(Debug, Clone, Copy, Default)]
pub struct Views<'a> {
    /// Phase along projector columns, axis "x".
    pub x: Option<PhaseView<'a>>,
    /// Phase along projector rows, axis "y".
    pub y: Option<PhaseView<'a>>,
}

impl<'a> Views<'a> {
    /// The phases of a camera in any order.
    pub fn of(views: impl IntoIterator<Item = PhaseView<'a>>) -> Self {
        let mut all = Self::default();
        views.into_iter().for_each(|view| all.set(view));
        all
    }

    /// Adds the phase of one axis.
    pub fn set(&mut self, view: PhaseView<'a>) {
        match view.info.axis {
            Axis::X => self.x = Some(view),
            Axis::Y => self.y = Some(view),
        }
    }

    /// The phase along an axis.
    pub fn along(&self, axis: Axis) -> Option<&PhaseView<'a>> {
        match axis {
            Axis::X => self.x.as_ref(),
            Axis::Y => self.y.as_ref(),
        }
    }
}

/// Either approach of the thesis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// Approach 2: two cameras see the same phase.
    Phase,
    /// The conventional one: a camera and the calibrated projector.
    Projector,
}

impl Method {
    /// The method of a pair: its right view is a camera or the projector.
    pub fn of(rig: &Rig, pair: &Pair) -> Self {
        if rig.camera(&pair.right).is_some() { Self::Phase } else { Self::Projector }
    }

    /// As in point clouds and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Phase => "phase",
            Self::Projector => "projector",
        }
    }
}

/// The methods of all pairs of a rig, as point clouds name them: `phase`, `projector`, or `phase and projector`.
pub fn method_name(rig: &Rig) -> &'static str {
    let has = |method| rig.pairs.iter().any(|pair| Method::of(rig, pair) == method);
    match (has(Method::Phase), has(Method::Projector)) {
        (true, true) => "phase and projector",
        (false, true) => Method::Projector.name(),
        _ => Method::Phase.name(),
    }
}

/// Matches one pair of views, again and again.
pub struct PairMatcher {
    kernel: Kernel,
    pair: u32,
}

enum Kernel {
    Phase(Box<Matcher>),
    Projector(Box<ProjectorMatcher>),
}

/// What became of the pixels of a pair.
#[derive(Debug, serde::Serialize)]
#[serde(untagged)]
pub enum Matched {
    /// Report of a pair of two cameras.
    Phase(MatchReport),
    /// Of a camera and the projector.
    Projector(ProjectorReport),
}

impl Matched {
    /// Number of points found.
    pub fn points(&self) -> u32 {
        match self {
            Self::Phase(report) => report.points,
            Self::Projector(report) => report.points,
        }
    }
}

impl PairMatcher {
    /// The matcher of a pair; its points carry `number`. Depth and surface of the settings hold for both methods.
    ///
    /// # Errors
    /// Views that are unknown or make no pair, settings out of their limits.
    pub fn new(rig: &Rig, pair: &Pair, number: usize, settings: &MatchSettings) -> Result<Self, CellError> {
        let no_view = |view: &str| CellError::NoView { pair: pair.name.clone(), view: view.to_owned() };
        let refused = |source: MatchError| CellError::Match { pair: pair.name.clone(), source };
        let left = rig.camera(&pair.left).ok_or_else(|| no_view(&pair.left))?;
        let kernel = if let Some(right) = rig.camera(&pair.right) {
            let footprints = [&pair.left, &pair.right].map(|camera| rig.sensor(camera).footprint);
            let matcher = Matcher::new(left, right, settings).map_err(refused)?;
            Kernel::Phase(Box::new(matcher.with_footprints(footprints)))
        } else {
            let projector = rig.projector(&pair.right).ok_or_else(|| no_view(&pair.right))?;
            let settings = ProjectorSettings {
                depth_mm: settings.depth_mm,
                surface: settings.surface,
                ..ProjectorSettings::default()
            };
            let matcher = ProjectorMatcher::new(left, projector, &settings).map_err(refused)?;
            Kernel::Projector(Box::new(matcher.with_footprint(rig.sensor(&pair.left).footprint)))
        };
        Ok(Self { kernel, pair: number as u32 })
    }

    /// What became of each pixel of the left camera in the last run.
    pub fn causes(&self) -> &[Cause] {
        match &self.kernel {
            Kernel::Phase(matcher) => matcher.causes(),
            Kernel::Projector(matcher) => matcher.causes(),
        }
    }

    /// Most points that it may give.
    pub fn capacity(&self) -> usize {
        match &self.kernel {
            Kernel::Phase(matcher) => matcher.capacity(),
            Kernel::Projector(matcher) => matcher.capacity(),
        }
    }

    /// Matches; the points go to `points`, in the order of the left pixels. With the projector there is no right view.
    ///
    /// Of two cameras that have the phases of both projector axes, that axis is matched whose projector coordinate
    /// changes most along the epipolar lines of the left camera ([`Matcher::best_axis`]): it determines the disparity with the
    /// least uncertainty, whether the baseline is horizontal or vertical and however the projector is turned. Where
    /// both change alike, or no pixel is valid, it is x.
    ///
    /// # Errors
    /// Views that are not those of this pair.
    pub fn run(
        &mut self,
        left: &Views<'_>,
        right: &Views<'_>,
        points: &mut [Point],
    ) -> Result<Matched, MatchError> {
        match &mut self.kernel {
            Kernel::Phase(matcher) => {
                let axis = match (&left.x, &left.y) {
                    (Some(x), Some(y)) => matcher.best_axis(&[*x, *y]).unwrap_or(Axis::X),
                    (None, Some(_)) => Axis::Y,
                    _ => Axis::X,
                };
                let (left, right) = (left.along(axis), right.along(axis));
                let (left, right) = left.zip(right).ok_or(MatchError::NoPhase)?;
                Ok(Matched::Phase(matcher.run(left, right, self.pair, points)?))
            }
            Kernel::Projector(matcher) => {
                Ok(Matched::Projector(matcher.run(left.x.as_ref(), left.y.as_ref(), self.pair, points)?))
            }
        }
    }

    /// The points of a pair in memory of their own.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn cloud(
        &mut self,
        left: &Views<'_>,
        right: &Views<'_>,
    ) -> Result<(Vec<Point>, Matched), MatchError> {
        let mut points = vec![bytemuck::Zeroable::zeroed(); self.capacity()];
        let matched = self.run(left, right, &mut points)?;
        points.truncate(matched.points() as usize);
        Ok((points, matched))
    }
}
