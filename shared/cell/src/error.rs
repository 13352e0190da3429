//! Why the kernels of a cell cannot be built, or refuse their work.

use fringe::decode::DecodeError;
use fringe::matching::MatchError;
use thiserror::Error;

/// Why the kernels of a cell cannot be built.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum CellError {
    /// A camera without frames of a projector.
    #[error("camera \"{camera}\" does not look at projector \"{projector}\"")]
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
