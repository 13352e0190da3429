//! Views in space: cameras (and projectors as inverse cameras), rigid motions, rigs, triangulation.

pub mod camera;
pub mod lens;
pub mod pose;
pub mod rig;
pub mod triangulate;
pub mod viewpoint;
