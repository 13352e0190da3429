//! Elements fitted to points by least squares of the orthogonal distance, with covariance.
//!
//! Each function takes points in mm and gives a result that explains itself: the parameters, how many points were
//! used and rejected, the form deviation under three names with three definitions ([`Form`]), and standard
//! uncertainties. All points weigh the same, which is the definition of the Gaussian associated element (ISO 14405,
//! VDI/VDE 2634); a weighted mean would move with the camera's exposure.
//!
//! Method: data about their centroid, an algebraic start, Gauss–Newton steps that fall back to Levenberg–Marquardt
//! when the sum of squares grows, run until the step stops shrinking. Sums run over a fixed binary tree of points, so
//! the bits depend on the order of the points alone.

mod adjust;
mod axis;
mod centred;
mod circle;
mod cluster;
mod cone;
mod cylinder;
mod error;
mod form;
mod line;
mod linear;
mod plane;
mod settings;
mod solve;
mod sphere;
#[cfg(test)]
pub(crate) mod tests;

pub use circle::{CircleFit, circle};
pub use cone::{ConeFit, cone};
pub use cylinder::{CylinderFit, cylinder};
pub use error::{COORDINATE_LIMIT_MM, FitError};
pub use form::{Form, Residuals};
pub use line::{LineFit, line};
pub(crate) use linear::{Normal, eigen, tangents};
pub use plane::{PlaneFit, plane};
pub use settings::FitSettings;
pub(crate) use sphere::sphere_centre_near;
pub use sphere::{SphereFit, sphere, sphere_of_diameter};
