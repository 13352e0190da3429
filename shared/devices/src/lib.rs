//! What stands between the cell and its hardware: cameras and projectors, real or not.
//!
//! Everything behind a driver does not depend on which driver it is.

#![forbid(unsafe_code)]

mod background;
mod camera_probe;
pub mod conformance;
mod device;
mod driven;
mod drivers;
mod error;
mod genicam;
pub mod gige_simulator;
mod light;
mod lightcrafter;
pub mod lightcrafter_emulator;
mod load;
mod local_projectors;
mod network_projector;
mod reconnecting;
mod recording;
mod screen;
mod served_twin;
mod storm;
mod twin_camera;
mod twin_source;

pub use camera_probe::{ProbedCamera, probe_camera};
pub use device::{Camera, CameraState, LinkCounts, Projector};
pub use driven::Driven;
pub use drivers::{camera, camera_of, played_files, projector};
pub use error::DeviceError;
pub use genicam::{FoundCamera, Place, find_cameras, missing_feature, place_of};
pub use light::Light;
pub use load::{LoadedCell, check, load};
pub use network_projector::{ProjectorCommand, ProjectorServer};
pub use served_twin::ServedTwin;
