//! Why views cannot be planned.

use crate::spatial::MeshError;
use thiserror::Error;

/// Most elements of a part.
pub(super) const MOST_ELEMENTS: usize = 4_000_000;

/// What makes a plan of views impossible.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum ViewPlanError {
    /// The mesh of the part is none.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A condition outside its range.
    #[error("{key} = {value}: must be {limit}")]
    Condition {
        /// Name of the condition.
        key: &'static str,
        /// Value given for it.
        value: f64,
        /// What it may be.
        limit: &'static str,
    },
    /// Nothing to see with.
    #[error("the rig has no [[pair]]: add one with left, right and projector")]
    NoPair,
    /// A pair names a view that the rig does not have.
    #[error("pair \"{pair}\": no camera or projector \"{view}\" in the rig")]
    NoView {
        /// Name of the pair.
        pair: String,
        /// Name that is not known.
        view: String,
    },
    /// The patterns of a projector are not known.
    #[error("pair \"{pair}\": no fringes are known of projector \"{projector}\"")]
    NoFringes {
        /// Name of the pair.
        pair: String,
        /// Name of its projector.
        projector: String,
    },
    /// Elements that are too small for the part.
    #[error(
        "elements of {element_mm} mm make more than {MOST_ELEMENTS} of the part's {area_mm2:.0} mm²: larger elements (--element-mm)"
    )]
    TooMany {
        /// Size of the elements, mm.
        element_mm: f64,
        /// Area of the part, mm².
        area_mm2: f64,
    },
    /// The part lies where no pair looks.
    #[error(
        "the part is not in the measuring volume: its middle lies at {middle_mm:.1?} mm, and none of its surface in the pictures of both views of \
         any pair; pair \"{pair}\" looks at {looks_at_mm:.1?} mm. Is the mesh in mm and in the frame of the plan? Its place \
         (--world-from-part, or [placement] of the plan) moves it"
    )]
    Outside {
        /// Middle of the part in the world frame, mm.
        middle_mm: [f64; 3],
        /// Name of the first pair.
        pair: String,
        /// Where its views look, mm.
        looks_at_mm: [f64; 3],
    },
    /// The part is too small to be one.
    #[error(
        "the part is {size_mm:.3} mm large, and a pixel of camera \"{camera}\" covers {pixel_mm:.3} mm of it: is the mesh in metres? Convert it to mm"
    )]
    Tiny {
        /// Diagonal of the part, mm.
        size_mm: f64,
        /// Name of a camera.
        camera: String,
        /// Length of its pixel at the part, mm.
        pixel_mm: f64,
    },
}
