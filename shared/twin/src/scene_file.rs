//! The scene file, as written: `format = "fringecell-scene/1"`.

use characterise::target::MarkerDictionary;
use serde::{Deserialize, Serialize};

/// The only format this version reads.
pub const FORMAT: &str = "fringecell-scene/1";

/// A scene as written. Unknown keys are refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFile {
    /// Format of the file, always [`FORMAT`].
    pub format: String,
    /// What the scene is.
    #[serde(default)]
    pub name: String,
    /// Surfaces that bodies refer to by name.
    #[serde(default, rename = "material")]
    pub materials: Vec<MaterialFile>,
    /// The bodies; their union is the part.
    #[serde(default, rename = "body")]
    pub bodies: Vec<BodyFile>,
    /// True feature values; nothing that renders or measures reads them.
    #[serde(default, rename = "truth")]
    pub truth: Vec<TrueValue>,
}

/// How a surface reflects.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialFile {
    /// Name of the material, unique in the file.
    pub name: String,
    /// Lambertian reflectance, 0 … 1.
    pub albedo: f64,
    /// Relative amplitude of the albedo's texture, 0 … 1.
    #[serde(default)]
    pub texture: f64,
    /// Grain of the texture, mm.
    #[serde(default = "one")]
    pub texture_mm: f64,
    /// Strength of the specular lobe (Blinn–Phong), in units of reflectance.
    #[serde(default)]
    pub specular: f64,
    /// Exponent of the specular lobe.
    #[serde(default = "twenty")]
    pub shininess: f64,
}

fn one() -> f64 {
    1.0
}

fn twenty() -> f64 {
    20.0
}

/// A body with its place in the part frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyFile {
    /// Name of the body, unique in the file.
    pub name: String,
    /// Name of a material.
    pub material: String,
    /// Origin of the body frame in the part frame, mm.
    #[serde(default)]
    pub position_mm: [f64; 3],
    /// Turns about the part's x, then y, then z axis, degrees: R = Rz·Ry·Rx.
    #[serde(default)]
    pub rotation_deg: [f64; 3],
    /// Shape of the body and its sizes.
    pub geometry: GeometryFile,
}

/// Shapes. All lie in a body frame with z up.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "shape", rename_all = "kebab-case", deny_unknown_fields)]
pub enum GeometryFile {
    /// A sphere about the origin.
    Sphere {
        /// Diameter of the sphere, mm.
        diameter_mm: f64,
    },
    /// Two spheres on the x axis, their middle in the origin, joined by a rod.
    BallBar {
        /// The sphere at −x, the sphere at +x.
        diameters_mm: [f64; 2],
        /// Distance of the sphere centres, mm.
        spacing_mm: f64,
        /// The rod; 0 for none.
        rod_diameter_mm: f64,
    },
    /// Spheres in a row along x above a rod.
    BallBeam {
        /// Diameter of each sphere, mm.
        diameters_mm: Vec<f64>,
        /// x of each centre.
        offsets_mm: Vec<f64>,
        /// Diameter of the rod, mm.
        rod_diameter_mm: f64,
        /// Length of the rod, its middle in x = 0.
        rod_length_mm: f64,
        /// Depth of the rod's axis below the line of the centres.
        drop_mm: f64,
    },
    /// Rectangle z = 0 with its solid below.
    Plane {
        /// Along x, along y.
        size_mm: [f64; 2],
        /// Thickness of the solid plate, mm.
        thickness_mm: f64,
        /// Squares on the top face.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        checkerboard: Option<CheckerboardFile>,
    },
    /// A box about the origin.
    Box {
        /// Along x, y, z.
        size_mm: [f64; 3],
    },
    /// On z = 0: a flat top and a slope that descends towards +x and meets z = 0 at the footprint's end.
    Wedge {
        /// Along x, along y, about the origin.
        footprint_mm: [f64; 2],
        /// Of the flat top.
        height_mm: f64,
        /// Between slope and base plane.
        inclination_deg: f64,
    },
    /// Half a sphere on z = 0, optionally on a base below.
    Hemisphere {
        /// Diameter of the hemisphere, mm.
        diameter_mm: f64,
        /// Base along x, y, z; its top face is z = 0.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        base_mm: Option<[f64; 3]>,
    },
    /// About the z axis from z = 0.
    Cylinder {
        /// Diameter of the cylinder, mm.
        diameter_mm: f64,
        /// Height along z, mm.
        height_mm: f64,
    },
    /// An STL file beside the scene file.
    Mesh {
        /// Path of the STL file, relative to the scene file.
        file: String,
        /// Millimetres per unit of the file.
        #[serde(default = "one")]
        scale: f64,
    },
}

/// A checkerboard about the origin of a plane's top face.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckerboardFile {
    /// Inner corners along x.
    pub columns: u32,
    /// Inner corners along y.
    pub rows: u32,
    /// Side of a square.
    pub pitch_mm: f64,
    /// Albedo of the dark squares as a fraction of the material's.
    pub dark: f64,
    /// Markers in the light squares, which then count from the top left as on a ChArUco board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dictionary: Option<MarkerDictionary>,
    /// Side of the markers with their dark rim, mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub marker_mm: Option<f64>,
    /// Number of the first marker.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_marker: Option<u32>,
}

/// A true value: what a feature measures if nothing errs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrueValue {
    /// Name of the feature, as in the inspection plan.
    pub name: String,
    /// True value in `unit`.
    pub value: f64,
    /// Unit of the value, such as mm or deg.
    pub unit: String,
}
