//! Calibration targets: what they are, and their points in an image to the noise limit.
//!
//! A checkerboard is found in four steps: saddles of the grey values confirmed by a ring (`saddle`), links along edges
//! that both ends agree on (`links`), a least-squares model of each corner (`corner`), growth into holes and margins where
//! the model holds (`board`). The numbering follows from extent and colours (`checkerboard`).
//!
//! On a ChArUco board the markers in the light squares identify the corners (`markers`, `charuco`), so a part of it is enough; so do the tags of
//! an AprilGrid (`aprilgrid`).
//!
//! Circles are areas that fill their ellipse (`blobs`), put on a lattice by local steps and numbered by the one change
//! of basis that gives the declared pattern (`circles`), each fitted as a blurred ellipse (`disc`).
//!
//! A target may have several such faces ([`TargetBody`]), which differ in their prints.
//!
//! No point is better than a wrong one: each corner has passed the colour of its squares, the direction of its edges, its
//! contrast, the residual of its model and its neighbours' opinion.

mod aprilgrid;
mod attempts;
mod bias;
mod blobs;
mod board;
mod body;
mod charuco;
mod checkerboard;
mod circles;
mod corner;
mod crossing;
mod detection;
mod dictionaries;
mod disc;
mod edge_blur;
mod error;
mod lattice;
mod lay;
mod links;
mod markers;
mod normal;
mod profile;
mod raster;
mod saddle;
mod settings;
mod solve;
mod spec;
#[cfg(test)]
mod tests;
mod window;

pub use bias::projected_circle_center_bias;
pub use body::{FaceSighting, MAX_FACES, TargetBody, TargetFace, detect_body};
pub use detection::{Ambiguity, DetectedPoint, Detection, detect};
pub use edge_blur::BlurredEdge;
pub use error::TargetError;
pub use markers::MarkerDictionary;
pub use settings::TargetSettings;
pub use spec::{TARGET_FORMAT, TargetKind, TargetSpec};
