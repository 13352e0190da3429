//! What can happen to the order of frames: one is lost, taken twice, repeated, or exchanged with another.

use std::fmt;

/// One thing that happened to the order of the frames of a sequence; frames count from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrderEvent {
    /// The frame was lost: from here on each shows the next pattern.
    Lost(usize),
    /// The pattern before was taken twice: from here on each frame shows the pattern before its own.
    Twice(usize),
    /// This frame alone shows the pattern before its own; the frames after it are right.
    Repeated(usize),
    /// Two frames show the pattern of each other.
    Exchanged(usize, usize),
    /// The frame shows nothing that one of the others explains.
    Foreign(usize),
}

impl OrderEvent {
    /// All events of a sequence of so many frames that leave more than one frame to tell them by.
    pub fn all(frames: usize) -> impl Iterator<Item = Self> {
        let slips = (0..frames).flat_map(move |k| {
            let lost = (k + 1 < frames).then_some(Self::Lost(k));
            let twice = Some(Self::Twice(k));
            let repeated = (k > 0).then_some(Self::Repeated(k));
            lost.into_iter().chain(twice).chain(repeated)
        });
        let exchanged = (0..frames).flat_map(move |i| (i + 1..frames).map(move |j| Self::Exchanged(i, j)));
        slips.chain(exchanged)
    }

    /// Number of the pattern that a frame shows after the event; `None` where the sequence does not say.
    pub fn shown(self, frame: usize) -> Option<usize> {
        match self {
            Self::Lost(k) if frame >= k => Some(frame + 1),
            Self::Twice(k) if frame >= k => frame.checked_sub(1),
            Self::Repeated(k) if frame == k => frame.checked_sub(1),
            Self::Exchanged(i, j) if frame == i => Some(j),
            Self::Exchanged(i, j) if frame == j => Some(i),
            Self::Foreign(k) if frame == k => None,
            _ => Some(frame),
        }
    }
}

impl fmt::Display for OrderEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lost(0) => {
                f.write_str("every frame shows the pattern after its own: one was missed at the start")
            }
            Self::Lost(k) => {
                write!(f, "frame {} was lost: from there on each shows the next pattern", k + 1)
            }
            Self::Twice(0) => {
                f.write_str("every frame shows the pattern before its own: the first one came too early")
            }
            Self::Twice(k) => write!(
                f,
                "pattern {k} was taken twice: from frame {} on each shows the pattern before its own",
                k + 1
            ),
            Self::Repeated(k) => write!(f, "frame {} shows pattern {k} once more", k + 1),
            Self::Exchanged(i, j) => write!(f, "frames {} and {} are exchanged", i + 1, j + 1),
            Self::Foreign(k) => write!(f, "frame {} does not show its pattern", k + 1),
        }
    }
}
