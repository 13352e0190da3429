//! Digital twin of the cell: what its cameras would see, computed.
//!
//! A [`scene::Scene`] (bodies in the part frame, from a scene file) is placed by [`cell::Twin`] into a rig; tracing one
//! camera for one cycle gives a [`cell::View`], and a [`render::Renderer`] turns it into frames. The crate is pure:
//! meshes come in as bytes, scenes as text, and the same seed gives the same bytes on any number of threads.
//!
//! # The model
//! * Rays of sight and of light are exact: closed-form intersections in double precision through the distorted lenses;
//!   occlusion is the nearest hit, shadow a second ray to the projector's optical centre.
//! * Reflection: Lambert with a solid albedo texture, plus a Blinn–Phong lobe; light falls off with the square of the
//!   distance and counts as 1 at the projector's distance from the middle of the part. Exposure 1 maps a reflectance
//!   of 1 to 85 % of full scale, so white Nylon (0.7) reaches 60 %, and up to 80 % with its gloss on raised places.
//! * Projector: 8-bit columns, light = leak + (1 − leak)·level^gamma, constant over a chip pixel, blurred by a Gaussian.
//! * Camera: the pixel's footprint and the lens blur together are a discrete Gaussian of variance σ² + 1/12 px² on
//!   the irradiance image. This takes the image as straight between pixels; `subsamples` = n traces n × n true rays
//!   instead, edges and curvature included, blurs them by the lens alone on their own finer grid, and averages them over the pixel, as
//!   light goes: a lens that blurred whole pixels would spread an edge in steps.
//! * Vibration: a random rigid shift of the part per frame, the same for all cameras, to first order: each ray meets
//!   its displaced face; silhouettes and texture stay (a shift of 1 µm moves them by 0.005 px).
//! * Defocus: `defocus_px_per_mm` blurs the projector with the distance from the middle of the part. The first bounce of light between
//!   surfaces: `bounce_rays` rays per pixel, cosine-weighted, from matt to matt. Both are off unless asked for.
//! * Not modelled: further bounces, depth of field of the camera, vignetting, rolling shutters.
//!
//! # Truth
//! [`scene::Scene::truth`], [`cell::Twin::pose`] and the functions named `truth_…` return what no camera can measure; only the
//! evaluation of a measurement may call them. Frames contain nothing but grey values.

mod assemble;
mod blur;
pub mod body;
pub mod cell;
pub mod checkerboard;
pub mod error;
mod light;
pub mod mesh;
pub mod pose;
pub mod render;
pub mod scene;
pub mod scene_file;
pub mod settings;
pub mod solid;
pub mod surface;
pub mod thesis;
mod trace;
mod triangles;

pub use cell::{Twin, TwinError, View};
pub use error::SceneError;
pub use render::{PixelsMut, Renderer};
pub use scene::{Scene, Truth};
pub use settings::TwinSettings;
