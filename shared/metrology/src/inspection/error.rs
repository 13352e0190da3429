//! Why an element or the part was not found.

use thiserror::Error;

use crate::fit::FitError;

/// Why there are too few points, and what to do: where enough of them lie in the region, their normals are at fault.
fn too_few(points: usize, without_normals: usize, needs: usize) -> &'static str {
    if without_normals >= needs && points * 10 < without_normals {
        "the cloud has no normals there, or they face another way than the element; give a cloud whose normals point out of the material, as \
         `fringetool reconstruct` writes it, or look whether another face lies there"
    } else {
        "the part is missing, hidden, or elsewhere; `fringetool place PLAN CLOUD --out PLACED` writes where it lies into the plan"
    }
}

/// Why an element or the part was not found.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum MeasureError {
    /// Not enough points in the region.
    #[error(
        "element {element}: {points} points in its region ({without_normals} before the test of normals), needs {needs}: {}",
        too_few(*points, *without_normals, *needs)
    )]
    TooFewPoints {
        /// Name of the element.
        element: String,
        /// Points that fulfil all conditions.
        points: usize,
        /// Points that fulfil all but that of the normal.
        without_normals: usize,
        /// Smallest number of points.
        needs: usize,
    },
    /// Copies of few points.
    #[error(
        "element {element}: its points lie at {places} different places, needs {needs}: a point counts once; measure the element again"
    )]
    Repeated {
        /// Name of the element.
        element: String,
        /// Number of places that differ.
        places: usize,
        /// Smallest number of points.
        needs: usize,
    },
    /// The points fill the region instead of lying on a surface.
    #[error(
        "element {element}: its points scatter by {sigma_mm:.3} mm in a region of ±{margin_mm} mm, limit \
         {limit_mm:.3} mm: not a surface of this kind, or another one cuts through"
    )]
    Scattered {
        /// Name of the element.
        element: String,
        /// Standard deviation of the residuals.
        sigma_mm: f64,
        /// Margin of the region.
        margin_mm: f64,
        /// Largest standard deviation allowed, mm.
        limit_mm: f64,
    },
    /// The fitted element lies too far from where the plan has it.
    #[error(
        "element {element}: found {shift_mm:.3} mm from its nominal place or size, limit {limit_mm} mm (twice its margin_mm)"
    )]
    Displaced {
        /// Name of the element.
        element: String,
        /// Distance between the start and the found place, mm.
        shift_mm: f64,
        /// How far it may be.
        limit_mm: f64,
    },
    /// The fit of an element failed.
    #[error("element {element}: {source}")]
    Fit {
        /// Name of the element.
        element: String,
        /// Reason given by the fit.
        source: FitError,
    },
    /// The filter of a flatness leaves too few blocks to estimate its noise.
    #[error(
        "flatness filter: filter_mm = {filter_mm} mm leaves {cells} cells of {fewest_points} or more points in each quarter and \
         {blocks} blocks of 2 × 2 of them, needs at least {needs} blocks: a larger filter_mm where cells hold too few points, a smaller one \
         where few cells fit, or a larger or more densely measured element"
    )]
    FilteredAway {
        /// Nesting index of the filter, mm.
        filter_mm: f64,
        /// Cells with enough points.
        cells: usize,
        /// Points that are enough in a quarter.
        fewest_points: usize,
        /// Blocks of 2 × 2 such cells.
        blocks: usize,
        /// Smallest number of blocks.
        needs: usize,
    },
    /// The part lies farther off than the plan allows.
    #[error(
        "the part lies {offset_mm:.2} mm and {angle_deg:.2}° from its nominal place, limits {limit_mm} mm \
         (search_mm) and {limit_deg}° (search_deg): clamp it again, widen the search, or place the plan on this cloud \
         (`fringetool place`)"
    )]
    OutOfReach {
        /// Shift of the datum surfaces.
        offset_mm: f64,
        /// Angle by which the part was turned, degrees.
        angle_deg: f64,
        /// Largest shift allowed, mm.
        limit_mm: f64,
        /// Largest angle allowed, degrees.
        limit_deg: f64,
    },
    /// The datum elements are not those of the part.
    #[error(
        "the datum spheres are {measured_mm:.3} mm apart, nominally {nominal_mm:.3} mm, limit ±{limit_mm} mm: \
         another part, or a wrong object was found in place of one of them"
    )]
    WrongPart {
        /// Measured distance of the datums, mm.
        measured_mm: f64,
        /// Distance in the plan.
        nominal_mm: f64,
        /// Largest difference allowed, mm.
        limit_mm: f64,
    },
    /// The pose does not settle.
    #[error("alignment: the pose still moves by {moved_mm:.4} mm after {rounds} rounds, limit {limit_mm} mm")]
    Unsettled {
        /// Motion in the last round, mm.
        moved_mm: f64,
        /// Number of rounds of the search.
        rounds: usize,
        /// Largest motion that counts as settled, mm.
        limit_mm: f64,
    },
    /// The cloud is too large for 32-bit indices.
    #[error("the cloud has {points} points, limit {}", u32::MAX)]
    CloudSize {
        /// Number of points found.
        points: usize,
    },
}
