//! Why a device cannot do what it should.

use cell::CellError;
use cell::schedule::ScheduleError;
use files::error::FileError;
use fringe::text::CELL_NAME;
use std::path::PathBuf;
use thiserror::Error;
use twin::{SceneError, TwinError};

/// Why a device cannot do what it should.
#[derive(Debug, Error)]
pub enum DeviceError {
    /// A file that cannot be used.
    #[error(transparent)]
    File(#[from] FileError),
    /// A cell that cannot be planned.
    #[error("{}", path.display())]
    Schedule {
        /// The configuration.
        path: PathBuf,
        /// Why.
        source: ScheduleError,
    },
    /// A cell whose kernels cannot be built.
    #[error("{}", path.display())]
    Cell {
        /// The configuration.
        path: PathBuf,
        /// Why.
        source: CellError,
    },
    /// A name that no cell may have.
    #[error("--cell {0:?}: {CELL_NAME}")]
    CellName(String),
    /// The twin refuses.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// The twin refuses what a configuration says.
    #[error("{}", path.display())]
    Configured {
        /// The configuration.
        path: PathBuf,
        /// Why.
        source: TwinError,
    },
    /// A scene that cannot be used.
    #[error("{}", path.display())]
    Scene {
        /// The scene file.
        path: PathBuf,
        /// What is wrong.
        source: SceneError,
    },
    /// A part of the configuration that a driver needs.
    #[error("the configuration has no [{0}]")]
    Missing(&'static str),
    /// The frame or the part cannot be had.
    #[error("{0}")]
    Frame(String),
}
