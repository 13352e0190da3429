//! What is wrong with a frame, and what was done about it.

use std::fmt;

/// Fewest steps of which a frame may be left out: three must remain.
const LEAST_STEPS: usize = 4;

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
    /// The fringes of all frames stand beside where they should: standard deviation, rad.
    Unsteady(f64),
    /// One frame shows something else in places.
    Strange,
    /// A frame of a code shows something else at this share of the pixels, and what it should at the others.
    Covered(f64),
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
    /// Decoded by the steps that the fringes had.
    StepsAsFound,
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
            Self::StepsAsFound => "decoded where they stood",
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
            Fault::Moved(_) | Fault::Unsteady(_) => "moved",
            Fault::Strange | Fault::Covered(_) => "strange",
            Fault::Level(_) => "level",
            Fault::Shifted(_) | Fault::Displaced(..) => "shifted",
            Fault::Inverse => "inverse",
            Fault::Shows(..) => "exchanged",
        }
    }
}

impl Fault {
    /// One number to sort faults by.
    pub(super) fn size(&self) -> f64 {
        match self {
            Self::Flicker(size)
            | Self::Blurred(size)
            | Self::Moved(size)
            | Self::Unsteady(size)
            | Self::Level(size)
            | Self::Shifted(size)
            | Self::Covered(size) => *size,
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
            Self::Unsteady(rad) => write!(
                f,
                "the fringes move between frames by {:.0} degrees (standard deviation; part, camera or projector)",
                rad.to_degrees()
            ),
            Self::Strange => f.write_str("shows something else than the others in places"),
            Self::Covered(share) => {
                write!(f, "shows something else than the others at {:.0} % of the pixels", share * 100.0)
            }
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
        !matches!(self.fault, Fault::Flicker(_) | Fault::Unsteady(_))
            && (steps < LEAST_STEPS || self.step.is_none())
    }

    /// The frame or frames in words, counted from 1.
    pub fn place(&self) -> String {
        match (self.step, self.fault) {
            (Some(step), _) => format!("frame {} of set {}", step + 1, self.set + 1),
            (None, Fault::Flicker(_) | Fault::Unsteady(_)) => format!("set {}:", self.set + 1),
            (None, _) => format!("a frame of set {}", self.set + 1),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}; {}", self.place(), self.fault, self.remedy)
    }
}
