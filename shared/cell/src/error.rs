//! Why a cell cannot be planned, or its kernels cannot be built.

use fringe::decode::DecodeError;
use fringe::matching::MatchError;
use thiserror::Error;

/// Why the kernels of a cell cannot be built.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CellError {
    /// A camera without frames of a projector.
    #[error("camera \"{camera}\" takes no frames of projector \"{projector}\"")]
    NotSeen {
        /// Name of the camera.
        camera: String,
        /// Name of the projector.
        projector: String,
    },
    /// A view of a pair that the rig lacks.
    #[error("pair \"{pair}\": \"{view}\" is neither a camera nor a projector of the rig file")]
    NoView {
        /// Name of the pair.
        pair: String,
        /// As in the pair.
        view: String,
    },
    /// A sequence or settings that the decoder refuses.
    #[error("sequence of projector \"{projector}\"")]
    Decode {
        /// Name of the projector.
        projector: String,
        /// The fault that the decoder found.
        source: DecodeError,
    },
    /// Views or settings that the matcher refuses.
    #[error("pair \"{pair}\"")]
    Match {
        /// Name of the pair.
        pair: String,
        /// The fault that the matcher found.
        source: MatchError,
    },
}

/// Why a graph cannot be run.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ScheduleError {
    /// The cell has no camera, no projector or no pair.
    #[error("the cell has no {0}")]
    Empty(&'static str),
    /// A projector whose light nobody sees.
    #[error("projector \"{0}\" lights no camera; name some in its `cameras`, or remove it")]
    Unseen(String),
    /// A camera without light.
    #[error("camera \"{0}\" is in no projector's `cameras`; add it to one, or remove it")]
    Dark(String),
    /// A camera that a pair names and the cell lacks.
    #[error(
        "pair \"{pair}\" needs camera \"{camera}\", but this cell has no such [[camera]]; add the camera, or list pairs = […] without \"{pair}\""
    )]
    NoCamera {
        /// Name of the pair.
        pair: String,
        /// Name of the camera.
        camera: String,
    },
    /// A projector that a pair names and the cell lacks.
    #[error("pair \"{pair}\" needs projector \"{projector}\", but this cell has no such [[projector]]")]
    NoProjector {
        /// Name of the pair.
        pair: String,
        /// Name of the projector.
        projector: String,
    },
    /// A sequence without phase.
    #[error(
        "pair \"{pair}\" needs a phase, but the sequence of projector \"{projector}\" has no set that gives one; add a sine, lines, micro, modulated or gray set"
    )]
    NoPhase {
        /// Name of the pair.
        pair: String,
        /// Name of the projector.
        projector: String,
    },
    /// One end of a pair has no frames.
    #[error(
        "pair \"{pair}\" takes camera \"{camera}\", but projector \"{projector}\" lights only {lit}; add it to the projector's `cameras`"
    )]
    Gap {
        /// Name of the pair.
        pair: String,
        /// Name of the camera.
        camera: String,
        /// Name of the projector.
        projector: String,
        /// Cameras that it does light.
        lit: String,
    },
    /// A camera whose phase no pair takes, whichever projector is on.
    #[error(
        "camera \"{camera}\" looks at projector \"{projector}\", but no pair takes its phase; name a pair, or remove the camera"
    )]
    Unused {
        /// Name of the camera.
        camera: String,
        /// Name of the projector.
        projector: String,
    },
    /// The frames alone last longer than a cycle may.
    #[error(
        "{frames} frames at {rate_hz} Hz last {needed_ms} ms, the cycle must end within {deadline_ms} ms; raise limits.cycle_deadline_ms or recording.rate_hz"
    )]
    Deadline {
        /// Frames of a cycle.
        frames: usize,
        /// Frames per second of the recording.
        rate_hz: f64,
        /// Time for the frames.
        needed_ms: u64,
        /// Time of the cycle.
        deadline_ms: u64,
    },
    /// The sequences that projectors show in their own time last longer than a cycle may.
    #[error(
        "the projected sequences last {needed_ms:.1} ms, the cycle must end within {deadline_ms} ms; raise limits.cycle_deadline_ms or lower period_ms"
    )]
    Projected {
        /// Time of all patterns, ms.
        needed_ms: f64,
        /// Time of the cycle.
        deadline_ms: u64,
    },
    /// A host that the cell does not have.
    #[error("the cell has no host \"{host}\"; its [[host]] tables name: {known}")]
    NoHost {
        /// Name that was asked for.
        host: String,
        /// Names of the hosts.
        known: String,
    },
    /// Sizes that no memory holds.
    #[error("topic \"{topic}\" would need messages of {bytes} bytes, the limit is {limit}")]
    TooLarge {
        /// Name of the topic.
        topic: String,
        /// Largest message of the topic, bytes.
        bytes: u64,
        /// Largest message allowed, bytes.
        limit: u64,
    },
}
