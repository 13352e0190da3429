//! Why a cell cannot be built from its configuration.

use crate::schedule::ScheduleError;
use files::error::FileError;
use fringe::decode::DecodeError;
use fringe::matching::MatchError;
use metrology::inspection::PlanError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a cell cannot be built from its configuration.
#[derive(Debug, Error)]
pub enum CellError {
    /// A setting of the configuration.
    #[error(transparent)]
    File(#[from] FileError),
    /// A name in the rig file or in `cameras` that the configuration lacks.
    #[error("{0}")]
    Unknown(String),
    /// A graph that cannot be run.
    #[error(transparent)]
    Schedule(#[from] ScheduleError),
    /// An inspection plan that cannot be used.
    #[error(transparent)]
    Plan(#[from] PlanError),
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
    /// Any of these, with its file.
    #[error("{}", path.display())]
    In {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<CellError>,
    },
}

impl CellError {
    /// The same fault with its file.
    #[must_use]
    pub fn at(self, path: impl Into<PathBuf>) -> Self {
        Self::In { path: path.into(), source: Box::new(self) }
    }
}
