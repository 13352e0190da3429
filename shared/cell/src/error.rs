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
        /// Camera.
        camera: String,
        /// Projector.
        projector: String,
    },
    /// A view of a pair that the rig lacks.
    #[error("pair \"{pair}\": \"{view}\" is neither a camera nor a projector of the rig file")]
    NoView {
        /// Pair.
        pair: String,
        /// As in the pair.
        view: String,
    },
    /// A sequence or settings that the decoder refuses.
    #[error("sequence of projector \"{projector}\"")]
    Decode {
        /// Projector.
        projector: String,
        /// Why.
        source: DecodeError,
    },
    /// Views or settings that the matcher refuses.
    #[error("pair \"{pair}\"")]
    Match {
        /// Pair.
        pair: String,
        /// Why.
        source: MatchError,
    },
}
