//! Elements fitted to points by least squares of the orthogonal distance, with covariance.
//!
//! Each function takes points in mm and gives a result that explains itself: the parameters, how many points were
//! used and rejected, the form deviation under three names with three definitions ([`Form`]), and standard
//! uncertainties. All points weigh the same, which is the definition of the Gaussian associated element (ISO 14405,
//! VDI/VDE 2634); a weighted mean would move with the camera's exposure.
//!
//! Points of cameras err along their lines of sight, not along the surface's normal, which moves the least-squares element by the second order. Where
//! their noise is given ([`PointNoise`]), the element is freed of that.
//!
//! Method: data about their centroid, an algebraic start, Gauss–Newton steps that fall back to Levenberg–Marquardt
//! when the sum of squares grows, run until the step stops shrinking. Sums run over a fixed binary tree of points, so
//! the bits depend on the order of the points alone.

mod adjust;
mod axis;
mod border;
mod cells;
mod centred;
mod chart;
mod circle;
mod cluster;
mod cone;
mod contour;
mod correlation;
mod correlogram;
mod cut;
mod cylinder;
mod derived;
mod elimination;
mod error;
mod exchange;
mod extremal;
mod form;
mod line;
mod normal;
mod outline;
mod plane;
mod point_noise;
mod replaced;
mod search;
mod settings;
mod shared;
mod solve;
mod sphere;
mod surface_point;
#[cfg(test)]
pub(crate) mod tests;
mod torus;
mod zone;

pub use border::{Border, border};
pub use chart::{CHART, ChartCovariance};
pub use circle::{CircleFit, circle};
pub(crate) use cluster::FEWEST_CELLS;
pub use cluster::Support;
pub use cone::{ConeFit, cone};
pub use contour::{ContourFit, Sheet, contour, strip_minimum_zone_mm};
pub(crate) use correlation::{Rows, estimate_rows};
pub use cylinder::{CylinderFit, cylinder};
pub use derived::{
    Derived, DirectionAngles, centre_distance_mm, direction_angles, height_mm, plane_angle_rad,
    plane_distance_mm, share_across, sphere_height_mm,
};
pub(crate) use elimination::solve_square;
pub use error::{COORDINATE_LIMIT_MM, FitError};
pub use extremal::{Side, Touching, touching_circle, touching_cylinder, touching_sphere};
pub use form::{Form, Residuals};
pub(crate) use fringe::math::linear::eigen_fixed as eigen;
pub use line::{LineFit, line};
pub(crate) use normal::Normal;
pub use normal::tangents;
pub use outline::{Outline, Placed};
pub use plane::{PlaneFit, plane};
pub use point_noise::PointNoise;
pub use search::{find_plane, find_sphere};
pub use settings::{Correlation, FitSettings, LeftOut};
pub(crate) use shared::beyond_noise;
pub(crate) use sphere::sphere_centre_near;
pub use sphere::{SphereFit, sphere, sphere_of_diameter};
pub use surface_point::{PointFit, surface_point};
pub use torus::{TorusFit, torus};
pub use zone::{
    CircleZone, CylinderZone, PlaneZone, SphereZone, circle_minimum_zone, cylinder_minimum_zone,
    plane_minimum_zone, sphere_minimum_zone,
};
