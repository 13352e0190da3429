//! Frames of a sine set that do not show what the others show: light that changes between frames, a frame that stayed black, that is blurred, or
//! in which part or pattern moved.
//!
//! Whatever the light does, the grey values of a pixel over N frames are A F₁ + C F₂ + S F₃ with three columns F that all pixels share: 1, cos δ,
//! sin δ when all is well. The three columns are found from the pixels themselves (`subspace`), as near to the nominal ones as they
//! span: level, contrast and step of each frame stand in its row. A frame that fits no row leaves more than the others.
//!
//! What a cos δ or sin δ in the level does cannot be seen in one pixel: it looks like a fringe. But it is one that stands still while the phase runs
//! on: the modulation then varies once with the phase. Where there are too few fringes to see that, it is left alone.
//!
//! A changing light is normalised: the columns found replace the nominal ones. A bad frame is left out where three remain; with more than one in
//! eight the frames do not follow the sequence, and nothing is changed. Of three or four frames a pixel alone does not tell which one is bad;
//! there whole fringes tell it (`moments`).

pub mod code;
mod columns;
mod moments;
mod rows;
mod samples;
mod subspace;

use crate::wrapped::LeastSquares;
use columns::nominal_columns;
use rows::fit;
pub(super) use samples::Samples;
use std::fmt;

/// Fewest steps of which a frame may be left out: three must remain.
const LEAST_STEPS: usize = 4;
/// One bad frame in so many is left out; one always may be.
const BAD_FRAMES: usize = 8;
/// Levels of the frames that differ by more are a changing light.
const FLICKER: f64 = 0.05;
/// A fringe that stands still in the level is a changing light by itself from this size on.
const STANDING_FLICKER: f64 = 0.03;
/// Levels that differ by more are no changing light.
const MOST_FLICKER: f64 = 0.5;
/// A frame with less than this level and contrast is black.
const BLACK: f64 = 0.1;
/// A frame with less contrast than this is blurred.
const BLURRED: f64 = 0.75;
/// A frame whose step is off by more has moved, rad.
const MOVED_RAD: f64 = 0.3;
/// A frame that leaves so many times what the others leave …
const STRANGE: f64 = 4.0;
/// … and this share of the level shows something else.
const STRANGE_LEVEL: f64 = 0.03;

/// What is wrong with frames of a sine set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// The light of the frames differs: standard deviation of their levels over the mean.
    Flicker(f64),
    /// One frame stayed black.
    Black,
    /// One frame has this share of the others' contrast.
    Blurred(f64),
    /// The fringes of one frame stand beside where they should, rad.
    Moved(f64),
    /// One frame shows something else in places.
    Strange,
    /// A frame of a code is brighter (or darker) as a whole, by this share of the step from dark to light.
    Level(f64),
    /// The stripes of a frame stand beside where they should, projector pixels.
    Shifted(f64),
    /// A frame stands so many pixels to the right of the others, and so many below.
    Displaced(i16, i16),
    /// Light and dark of a frame are exchanged.
    Inverse,
    /// A frame shows what that of another set and step should, both from 0.
    Shows(usize, usize),
}

/// What was done about a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remedy {
    /// The frame is not used.
    LeftOut,
    /// Level and contrast are those of the other frames.
    Normalised,
    /// The inverse frame stands for it.
    Inverse,
    /// Another frame shows what it should, and was taken.
    OtherFrame,
    /// Moved to where the other frames demand it.
    MovedBack,
    /// Written as the phase and the other frames demand.
    Phase,
    /// Used as it is: a part of many faces has such edges too.
    Doubted,
    /// Nothing that is left determines what it should show.
    None,
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::LeftOut => "left out",
            Self::Normalised => "normalised",
            Self::Inverse => "its inverse is used",
            Self::OtherFrame => "taken from where it is",
            Self::MovedBack => "moved back",
            Self::Phase => "made up for by phase and other frames",
            Self::Doubted => "used as it is; look at the picture",
            Self::None => "nothing makes up for it",
        })
    }
}

/// A fault, and where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finding {
    /// Position of the set in the sequence, from 0.
    pub set: usize,
    /// Number of the frame in its set, from 0; none for all.
    pub step: Option<usize>,
    /// What is wrong with it.
    pub fault: Fault,
    /// What was done about it.
    pub remedy: Remedy,
}

impl Finding {
    /// The fault in one word, for programs.
    pub fn kind(&self) -> &'static str {
        match self.fault {
            Fault::Flicker(_) => "flicker",
            Fault::Black => "black",
            Fault::Blurred(_) => "blurred",
            Fault::Moved(_) => "moved",
            Fault::Strange => "strange",
            Fault::Level(_) => "level",
            Fault::Shifted(_) | Fault::Displaced(..) => "shifted",
            Fault::Inverse => "inverse",
            Fault::Shows(..) => "exchanged",
        }
    }
}

impl Fault {
    /// One number to sort faults by.
    fn size(&self) -> f64 {
        match self {
            Self::Flicker(size)
            | Self::Blurred(size)
            | Self::Moved(size)
            | Self::Level(size)
            | Self::Shifted(size) => *size,
            Self::Displaced(right, down) => f64::from(right.unsigned_abs().max(down.unsigned_abs())),
            Self::Black | Self::Strange | Self::Inverse | Self::Shows(..) => 0.0,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Flicker(share) => {
                write!(f, "the light changes between frames by {:.1} % (standard deviation)", share * 100.0)
            }
            Self::Black => f.write_str("is black"),
            Self::Blurred(share) => {
                write!(f, "has {:.0} % of the others' contrast (exposure, blurred, moving)", share * 100.0)
            }
            Self::Moved(rad) => write!(
                f,
                "stands {:.0} degrees beside its step (shifted, or another pattern)",
                rad.to_degrees()
            ),
            Self::Strange => f.write_str("shows something else than the others in places"),
            Self::Level(share) => {
                let sense = if *share > 0.0 { "brighter" } else { "darker" };
                write!(
                    f,
                    "is {sense} as a whole, by {:.0} % of the step from dark to light",
                    share.abs() * 100.0
                )
            }
            Self::Shifted(px) => write!(f, "stands {px:+.1} projector pixels beside its stripes"),
            Self::Displaced(right, down) => {
                let [across, along] =
                    [if *right < 0 { "left" } else { "right" }, if *down < 0 { "above" } else { "below" }];
                write!(
                    f,
                    "stands {} px to the {across} and {} px {along} the others",
                    right.abs(),
                    down.abs()
                )
            }
            Self::Inverse => f.write_str("shows light where it should be dark"),
            Self::Shows(set, step) => write!(f, "shows what frame {} of set {} should", step + 1, set + 1),
        }
    }
}

impl Finding {
    /// Whether the other frames of a set of so many do not determine the phase.
    pub fn is_fatal(&self, steps: usize) -> bool {
        !matches!(self.fault, Fault::Flicker(_)) && (steps < LEAST_STEPS || self.step.is_none())
    }

    /// The frame or frames in words, counted from 1.
    pub fn place(&self) -> String {
        match (self.step, self.fault) {
            (Some(step), _) => format!("frame {} of set {}", step + 1, self.set + 1),
            (None, Fault::Flicker(_)) => format!("set {}:", self.set + 1),
            (None, _) => format!("a frame of set {}", self.set + 1),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}; {}", self.place(), self.fault, self.remedy)
    }
}

/// How a set with faults is decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Repair {
    /// The faults, in the order of the frames.
    pub findings: Vec<Finding>,
    /// Weights of all frames; zero for those left out.
    pub fit: LeastSquares,
}

/// What the inspection needs to know of the pixels.
#[derive(Debug, Clone, Copy)]
pub struct Look<'a> {
    /// Pixels that are asked.
    pub positions: &'a [usize],
    /// Columns of the image, px.
    pub width: usize,
    /// Pixels of the image.
    pub pixels: usize,
    /// Their grey values in the frames of the set, step after step, DN.
    pub values: &'a [u16],
    /// Pixels with less modulation are dark, DN.
    pub least_modulation_dn: f64,
    /// Grey value from which a pixel is clipped, DN.
    pub clipped_dn: u16,
}

/// Looks for faults in the frames of a complete set; `None` where there are none, or too many to do without.
pub(super) fn inspect(samples: &Samples) -> Option<Repair> {
    let (plan, steps) = (samples.plan(), samples.steps());
    let nominal = nominal_columns(plan);
    let found = |step: Option<usize>, fault| {
        let remedy = if step.is_some() { Remedy::LeftOut } else { Remedy::Normalised };
        Finding { set: plan.index, step, fault, remedy }
    };
    let without = |findings: Vec<Finding>| {
        let bad =
            |step: usize| findings.iter().any(|found| found.step == Some(step) && !found.is_fatal(steps));
        Some(Repair { fit: fit(&nominal, steps, bad)?, findings })
    };
    if steps <= moments::MOST_STEPS
        && let Some((step, fault)) = moments::wrong_frame(samples)
    {
        return without(vec![found(step, fault)]);
    }
    let mut rows = samples.rows()?;
    if steps > moments::MOST_STEPS {
        let faults = rows.frames().iter().enumerate().filter_map(|(step, row)| Some((step, row.fault()?)));
        let findings: Vec<Finding> = faults.map(|(step, fault)| found(Some(step), fault)).collect();
        if findings.len() > (steps / BAD_FRAMES).max(1) {
            return None;
        }
        if !findings.is_empty() {
            return without(findings);
        }
    }
    let fault = Fault::Flicker(samples.changing_light(&mut rows)?);
    Some(Repair { fit: fit(&rows.columns, steps, |_| false)?, findings: vec![found(None, fault)] })
}

/// What one row tells of its frame.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct FrameRow {
    /// Level over that of most frames.
    level: f64,
    /// Contrast over that of most frames.
    contrast: f64,
    /// Step less the nominal one, rad.
    off_rad: f64,
    /// Residual over the level that three quarters of the pixels stay below.
    left: f64,
    /// The same of most frames.
    usual: f64,
}

impl FrameRow {
    fn fault(&self) -> Option<Fault> {
        if self.level < BLACK && self.contrast < BLACK {
            Some(Fault::Black)
        } else if self.contrast < BLURRED * self.level.max(BLACK) {
            Some(Fault::Blurred(self.contrast))
        } else if self.off_rad.abs() > MOVED_RAD {
            Some(Fault::Moved(self.off_rad))
        } else if self.left > STRANGE * self.usual && self.left > STRANGE_LEVEL {
            Some(Fault::Strange)
        } else {
            None
        }
    }
}
