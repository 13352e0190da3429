//! Why a device cannot do what it should.

use cell::{CellError, ScheduleError};
use files::error::FileError;
use fringe::text::CELL_NAME;
use std::net::SocketAddr;
use std::path::PathBuf;
use thiserror::Error;
use twin::TwinError;

/// Why a device cannot do what it should.
#[derive(Debug, Error)]
pub enum DeviceError {
    /// A file that cannot be used.
    #[error(transparent)]
    File(#[from] FileError),
    /// A cell that cannot be planned.
    #[error("{}", path.display())]
    Schedule {
        /// Path of the configuration.
        path: PathBuf,
        /// The fault of the graph.
        source: Box<ScheduleError>,
    },
    /// A cell whose kernels cannot be built.
    #[error("{}", path.display())]
    Cell {
        /// Path of the configuration.
        path: PathBuf,
        /// The fault that the kernels found.
        source: Box<CellError>,
    },
    /// A name that no cell may have.
    #[error("--cell {0:?}: {CELL_NAME}")]
    CellName(String),
    /// The twin cannot simulate this.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// The twin refuses what a configuration states.
    #[error("{}", path.display())]
    Configured {
        /// Path of the configuration.
        path: PathBuf,
        /// The fault that the twin found.
        source: TwinError,
    },
    /// A part of the configuration that a driver needs.
    #[error("the configuration has no [{0}]")]
    Missing(&'static str),
    /// A socket that cannot be used.
    #[error("{address}")]
    Network {
        /// Address of the socket.
        address: SocketAddr,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The frame or the part cannot be had.
    #[error("{0}")]
    Frame(String),
}
