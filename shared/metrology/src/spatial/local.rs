//! The local shape of a sampled surface: the plane and the paraboloid of the points around a place.

use crate::fit::{Normal, tangents};
use nalgebra::{Matrix3, Point3, Vector3};

/// Fewest points of a paraboloid: twice its six coefficients.
const PARABOLOID_POINTS: usize = 12;

/// Fewest points of a plane; three would agree with any.
const PLANE_POINTS: usize = 4;

/// A surface whose points spread less than this across its second direction, compared with the first, is a line.
const LINE_RATIO: f64 = 1e-3;

/// First and second moments of points about a place near them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Moments {
    about: Point3<f64>,
    count: usize,
    first: Vector3<f64>,
    /// xx, xy, xz, yy, yz, zz
    second: [f64; 6],
}

impl Moments {
    /// Moments of no points, about an origin.
    pub fn about(about: Point3<f64>) -> Self {
        Self { about, count: 0, first: Vector3::zeros(), second: [0.0; 6] }
    }

    /// Moments of a number of points about an origin, from the sums of their differences and of the products of these.
    pub fn of_sums(about: Point3<f64>, count: usize, first: Vector3<f64>, second: [f64; 6]) -> Self {
        Self { about, count, first, second }
    }

    /// Adds one point to the moments.
    #[inline]
    pub fn add(&mut self, p: &Point3<f64>) {
        let d = p - self.about;
        self.count += 1;
        self.first += d;
        let products = [d.x * d.x, d.x * d.y, d.x * d.z, d.y * d.y, d.y * d.z, d.z * d.z];
        for (sum, product) in self.second.iter_mut().zip(products) {
            *sum += product;
        }
    }

    /// Number of points summed so far.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Centre of gravity; the place itself without points.
    pub fn centroid(&self) -> Point3<f64> {
        self.about + self.first / self.count.max(1) as f64
    }

    /// Mean squared deviations from the centroid, mm².
    pub fn covariance(&self) -> Matrix3<f64> {
        let n = self.count.max(1) as f64;
        let mean = self.first / n;
        let [xx, xy, xz, yy, yz, zz] = self.second.map(|s| s / n);
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) - Matrix3::from_fn(|r, c| mean[r] * mean[c])
    }
}

/// The direction in which points spread least, as a unit vector of either sign, and the mean squares along it, along
/// the next direction and along the last, mm². `None` for points on a line or in one place, or spread alike all round.
///
/// The least eigenvalue by Newton's method from zero, which climbs to the least root of the characteristic polynomial
/// without passing it; the eigenvector as the longest cross product of two rows of the singular matrix.
pub(crate) fn eigen_normal(covariance: &Matrix3<f64>) -> Option<(Vector3<f64>, [f64; 3])> {
    let scale = covariance.trace();
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let a = covariance / scale;
    let minors = |m: &Matrix3<f64>| {
        [(0, 1), (0, 2), (1, 2)]
            .iter()
            .map(|&(i, j)| m[(i, i)] * m[(j, j)] - m[(i, j)] * m[(i, j)])
            .sum::<f64>()
    };
    let (minor, determinant) = (minors(&a), a.determinant());
    let mut least = 0.0_f64;
    for _ in 0..50 {
        // −p(λ) = λ³ − λ² + minor·λ − det, with trace 1.
        let value = ((least - 1.0) * least + minor) * least - determinant;
        let slope = (3.0 * least - 2.0) * least + minor;
        let step = value / slope;
        if step.is_nan() || step >= -1e-15 * (least + 1e-3) {
            break;
        }
        least -= step;
    }
    let shifted = a - Matrix3::identity() * least;
    let rows = [0, 1, 2].map(|i| shifted.row(i).transpose());
    let crosses = [rows[0].cross(&rows[1]), rows[0].cross(&rows[2]), rows[1].cross(&rows[2])];
    let longest =
        crosses.iter().copied().reduce(|a, b| if b.norm_squared() > a.norm_squared() { b } else { a })?;
    // The other two sum to 1 − least and have the product det / least, computed without that quotient.
    let sum = 1.0 - least;
    let product = minor - least * sum;
    let root = (0.25 * sum * sum - product).max(0.0).sqrt();
    let (middle, most) = (0.5 * sum - root, 0.5 * sum + root);
    // Along both directions of a surface points spread visibly; at right angles to it visibly less.
    let surface = middle > LINE_RATIO * LINE_RATIO * most && middle > least * (1.0 + 1e-6);
    let normal = longest.try_normalize(1e-12)?;
    surface.then_some((normal, [least * scale, middle * scale, most * scale]))
}

/// A surface around a place as height over a plane: a paraboloid, or the plane itself where the points are few.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Patch {
    origin: Point3<f64>,
    normal: Vector3<f64>,
    tangents: [Vector3<f64>; 2],
    /// Of 1, u, v, u², uv, v²; u and v in mm.
    height: [f64; 6],
    /// Where the points used lie on the average, in tangent coordinates, mm.
    middle: [f64; 2],
}

impl Patch {
    /// The plane through points around the place that their moments are about. The normal has either sign. `None` without enough
    /// points for a plane.
    pub fn plane(moments: &Moments) -> Option<Self> {
        if moments.count() < PLANE_POINTS {
            return None;
        }
        let (normal, _) = eigen_normal(&moments.covariance())?;
        let tangents = tangents(&normal);
        let to_centroid = moments.centroid() - moments.about;
        let middle = [tangents[0].dot(&to_centroid), tangents[1].dot(&to_centroid)];
        let height = [normal.dot(&to_centroid), 0.0, 0.0, 0.0, 0.0, 0.0];
        Some(Self { origin: moments.about, normal, tangents, height, middle })
    }

    /// Its directions: two tangents and the normal.
    pub fn frame(&self) -> [Vector3<f64>; 3] {
        [self.tangents[0], self.tangents[1], self.normal]
    }

    /// Makes a paraboloid of the plane, from the normal equations of the heights of a number of points over tangent coordinates in
    /// units of 1/`scale`. Few points carry a plane only, and so do some others (all on two lines, for instance).
    ///
    /// A plane through a curved surface lies r²/4R beside it (5.7 µm for r = 0.5 mm on a sphere of 22 mm); the paraboloid
    /// does not.
    pub fn bend(&mut self, heights: &Normal<6>, points: usize, scale: f64) {
        if points < PARABOLOID_POINTS {
            return;
        }
        let Some(solution) = heights.step(0.0) else { return };
        let square = scale * scale;
        let factors = [1.0, scale, scale, square, square, square];
        self.height = std::array::from_fn(|i| solution[i] * factors[i]);
    }

    /// Tangent coordinates and height of a point, mm.
    fn local(&self, p: &Point3<f64>) -> [f64; 3] {
        let d = p - self.origin;
        [self.tangents[0].dot(&d), self.tangents[1].dot(&d), self.normal.dot(&d)]
    }

    /// Height over its place along the normal of the fitted plane, mm.
    #[cfg(test)]
    pub(super) fn height_mm(&self) -> f64 {
        self.height[0]
    }

    /// Unit normal of the fitted plane.
    pub fn normal(&self) -> Vector3<f64> {
        self.normal
    }

    /// Signed orthogonal distance of a point along the normal, mm.
    ///
    /// The foot is where the line along the surface's normal at the place below the point would meet it; the distance is
    /// that along the normal at the foot, whose error is of second order in what the foot is off.
    pub fn distance_mm(&self, p: &Point3<f64>) -> f64 {
        let [u, v, w] = self.local(p);
        let (below, slope) = self.surface(u, v);
        let lift = (w - below) / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]);
        let shift = slope.map(|s| s * lift);
        let (height, slope) = self.surface(u + shift[0], v + shift[1]);
        // (−∂h/∂u, −∂h/∂v, 1) · (p − foot), the vector made a unit one.
        let along = shift[0] * slope[0] + shift[1] * slope[1] + (w - height);
        along / (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt()
    }

    /// Height and its derivatives at tangent coordinates.
    fn surface(&self, u: f64, v: f64) -> (f64, [f64; 2]) {
        let [a, b, c, d, e, f] = self.height;
        let height = a + b * u + c * v + d * u * u + e * u * v + f * v * v;
        (height, [b + 2.0 * d * u + e * v, c + e * u + 2.0 * f * v])
    }

    /// How far the point's foot lies from the origin, and from the middle of the points used, mm.
    pub fn offsets_mm(&self, p: &Point3<f64>) -> (f64, f64) {
        let [u, v, _] = self.local(p);
        let from = |x: f64, y: f64| ((u - x) * (u - x) + (v - y) * (v - y)).sqrt();
        (from(0.0, 0.0), from(self.middle[0], self.middle[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::eigen;
    use fringe::synthetic::Noise;

    #[test]
    fn the_fast_normal_is_that_of_the_jacobi_rotations() {
        let mut noise = Noise(1);
        for round in 0..500 {
            let flat = 10_f64.powi(-(round % 7));
            let mut moments = Moments::about(Point3::new(100.0, -50.0, 20.0));
            let [e1, e2] = tangents(&Vector3::new(noise.gauss(), noise.gauss(), noise.gauss()).normalize());
            for _ in 0..30 {
                let d = e1 * noise.gauss()
                    + e2 * (0.3 * noise.gauss())
                    + e1.cross(&e2) * (0.1 * flat * noise.gauss());
                moments.add(&(Point3::new(100.0, -50.0, 20.0) + d));
            }
            let (normal, squares) = eigen_normal(&moments.covariance()).unwrap();
            let (values, vectors) = eigen(&moments.covariance());
            assert!(normal.cross(&vectors.column(0)).norm() < 1e-9, "round {round}");
            for (a, b) in squares.iter().zip(&values) {
                assert!((a - b).abs() < 1e-13 * values[2], "{squares:?} {values}");
            }
        }
    }

    #[test]
    fn lines_balls_and_single_places_have_no_normal() {
        assert!(eigen_normal(&Matrix3::zeros()).is_none());
        assert!(eigen_normal(&Matrix3::identity()).is_none());
        assert!(eigen_normal(&Matrix3::from_diagonal(&Vector3::new(1.0, 1e-9, 0.0))).is_none());
        assert!(eigen_normal(&Matrix3::from_element(f64::NAN)).is_none());
        assert!(eigen_normal(&Matrix3::from_diagonal(&Vector3::new(1.0, 0.5, 0.0))).is_some());
    }
}
