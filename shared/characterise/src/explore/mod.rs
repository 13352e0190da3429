//! Which patterns a series of frames shows, where nobody wrote it down.
//!
//! ```text
//! frames ─▶ pixels that change ([`samples`]) ─▶ phase-stepped sets ([`sines`]) ─▶ white, black, codes ([`codes`])
//!        ─▶ periods, senses and origins ([`scale`]) ─▶ proposed sequence with what is uncertain
//! ```
//!
//! Everything is decided by relations between frames that hold whatever the object and its colour: frames of a
//! phase-stepped set satisfy a fit of three numbers a pixel; frames of a code split the pixels in two, and each finer bit
//! has twice as many edges. What the frames cannot tell (the projector's size, the sense of the steps without a code) is
//! assumed and named as a doubt.

mod codes;
mod samples;
mod scale;
mod sines;
#[cfg(test)]
mod tests;

use crate::explore::codes::Coded;
use fringe::frame::FrameView;
use fringe::pattern::{Axis, PatternSet};
use samples::Samples;
use serde::Serialize;
use sines::Stepped;
use thiserror::Error;

/// Most frames of a series: as many as a sequence may have.
const MAX_FRAMES: usize = 1024;

/// Why nothing can be proposed; the message ends with the likely remedy.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ExploreError {
    /// Fewer frames than any set that gives a coordinate, or more than a sequence may have.
    #[error("{count} frames; a sequence has 3 to {MAX_FRAMES}; is this the right folder?")]
    Count {
        /// Number of frames given.
        count: usize,
    },
    /// Frames of different cameras.
    #[error(
        "frame {frame} has {width_px} × {height_px} px, the first has {first_width_px} × {first_height_px}; explore each camera alone"
    )]
    Size {
        /// Number of the frame, from 0.
        frame: usize,
        /// Columns of that frame, px.
        width_px: u32,
        /// Rows of that frame, px.
        height_px: u32,
        /// Columns of the first frame, px.
        first_width_px: u32,
        /// Rows of the first frame, px.
        first_height_px: u32,
    },
    /// All frames look alike.
    #[error(
        "no pattern: pixels change by at most {range_dn:.1} DN between the frames, at least {least_dn:.1} needed; are these \
         frames of one camera under changing patterns?"
    )]
    Unchanged {
        /// 99th percentile of the change of a pixel, DN.
        range_dn: f64,
        /// Least change that is looked at, DN.
        least_dn: f64,
    },
}

/// What one frame looks like.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameFigures {
    /// Mean over the pixels that change, DN.
    pub mean_dn: f64,
    /// Share of these pixels nearer to their brightest than to their darkest value.
    pub bright_share: f64,
    /// Share of neighbouring pixels along rows of which one is bright and one dark.
    pub edges_x: f64,
    /// The same along columns.
    pub edges_y: f64,
    /// Share of all pixels at full scale.
    pub saturated_share: f64,
}

/// A set that the frames show.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundSet {
    /// The set, as a recording describes it.
    pub set: PatternSet,
    /// Numbers of its frames, from 0, in the order of the set.
    pub frames: Vec<usize>,
    /// Residual of a phase-stepped set over its modulation, median over the pixels: noise, gamma, wrong steps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub residual: Option<f64>,
    /// Camera pixels per period or, of a code, per stripe: mean over the pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_px: Option<f64>,
    /// What the frames do not tell, in sentences.
    pub doubts: Vec<String>,
}

/// What a series of frames shows.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Exploration {
    /// Share of the pixels that change enough to be looked at.
    pub lit_share: f64,
    /// What each frame looks like, in the order in which they were taken.
    pub frames: Vec<FrameFigures>,
    /// Proposed sequence, in the order of projection.
    pub sets: Vec<FoundSet>,
    /// Numbers of the frames that belong to no set.
    pub unexplained: Vec<usize>,
    /// Columns and rows of the projector that the lengths suppose, px.
    pub projector_px: [u32; 2],
}

impl Exploration {
    /// The proposed sets without their doubts.
    pub fn sequence(&self) -> Vec<PatternSet> {
        self.sets.iter().map(|found| found.set.clone()).collect()
    }
}

/// Proposes the sequence that the frames of one camera show, in the order in which they were taken.
///
/// `projector_px` is the projector's size in columns and rows, where it is known.
///
/// # Errors
/// Too few frames, frames of different sizes, frames that are all alike.
pub fn explore(
    frames: &[FrameView<'_>],
    projector_px: Option<[u32; 2]>,
) -> Result<Exploration, ExploreError> {
    check(frames)?;
    let samples = Samples::gather(frames)?;
    let figures: Vec<FrameFigures> =
        frames.iter().enumerate().map(|(k, frame)| samples.figures(k, frame)).collect();
    let stepped = sines::find(&samples, &figures);
    let mut groups: Vec<Group> = Vec::new();
    let mut unexplained = Vec::new();
    let mut at = 0;
    for set in stepped {
        codes::find(&samples, &figures, at..set.first, &mut groups, &mut unexplained);
        at = set.first + set.steps;
        groups.push(Group::Stepped(set));
    }
    codes::find(&samples, &figures, at..frames.len(), &mut groups, &mut unexplained);
    let (sets, projector_px) = scale::sequence(&samples, &groups, projector_px);
    Ok(Exploration { lit_share: samples.lit_share, frames: figures, sets, unexplained, projector_px })
}

/// Frames that belong together, without lengths on the projector.
enum Group {
    /// Fringes in phase steps.
    Stepped(Stepped),
    /// A code, or its complement.
    Coded(Coded),
    /// A frame that is all bright.
    White(usize),
    /// A frame that is all dark.
    Black(usize),
}

/// The axis along which a change per pixel (along rows, along columns) is larger, and whether it is clearly larger.
fn axis_of(along_x: f64, along_y: f64) -> (Axis, bool) {
    let (x, y) = (along_x.abs(), along_y.abs());
    let axis = if x >= y { Axis::X } else { Axis::Y };
    (axis, x.max(y) > 2.0 * x.min(y))
}

/// What to say of an axis that is not clear.
fn axis_doubt(clear: bool) -> Option<String> {
    (!clear).then(|| "axis: the pattern runs obliquely through the picture".to_owned())
}

fn check(frames: &[FrameView<'_>]) -> Result<(), ExploreError> {
    if !(3..=MAX_FRAMES).contains(&frames.len()) {
        return Err(ExploreError::Count { count: frames.len() });
    }
    let (first_width_px, first_height_px) = (frames[0].width_px, frames[0].height_px);
    let other = |f: &FrameView| (f.width_px, f.height_px) != (first_width_px, first_height_px);
    match frames.iter().position(other) {
        None => Ok(()),
        Some(frame) => Err(ExploreError::Size {
            frame,
            width_px: frames[frame].width_px,
            height_px: frames[frame].height_px,
            first_width_px,
            first_height_px,
        }),
    }
}
