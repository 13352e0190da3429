//! Spatial queries: a tree over boxes, a tree over points, triangles, and the local shape of a sampled surface.

mod bvh;
mod creases;
mod error;
mod local;
mod mesh;
mod nearest;
mod orient;
mod points;
mod rays;
mod thin;
mod topology;
mod triangle;
mod vicinity;

pub use bvh::{Aabb, Bvh};
pub use creases::Creases;
pub use error::MeshError;
pub(crate) use local::{Moments, Patch, eigen_normal};
pub use mesh::{Foot, TriangleMesh};
pub(crate) use nearest::groups;
pub(crate) use points::{Neighbourhood, PointTree};
pub use rays::{first_met, is_blocked};
pub use thin::{extent_and_least_edge_mm, thinned_cloud};
pub(crate) use thin::{thin_to, thinned};
pub use triangle::{Triangle, nearest_on_segment};
pub(crate) use vicinity::{Place, Vicinity};

/// Points that one thread takes at a time; fixed, so that nothing depends on the number of threads.
pub(crate) const CHUNK: usize = 1024;
