//! Fits whose element is replaced by one of another association criterion: the points used stay the same.

use nalgebra::{Matrix4, Point3, Vector3};

use super::axis::worst_tilt_rad;
use super::chart::ChartCovariance;
use super::extremal::{Side, Touching, touching_circle, touching_cylinder, touching_plane, touching_sphere};
use super::normal::tangents;
use super::{ContourFit, CylinderFit, FitError, PlaneFit, SphereFit};

/// The points of a fit that were used.
fn used(points: &[Point3<f64>], marks: &[bool]) -> Vec<Point3<f64>> {
    points.iter().zip(marks).filter(|(_, used)| **used).map(|(point, _)| *point).collect()
}

/// Standard uncertainty of an axis' place across and of its direction, in the worst direction each.
fn axis_u(chart: &ChartCovariance, direction: &Vector3<f64>) -> [f64; 2] {
    let [e1, e2] = tangents(direction);
    let worst = |from: usize| {
        let block = chart.fixed_view::<3, 3>(from, from).into_owned();
        let across = |a: &Vector3<f64>, b: &Vector3<f64>| (block * a).dot(b);
        worst_tilt_rad(nalgebra::Matrix2::new(
            across(&e1, &e1),
            across(&e1, &e2),
            across(&e1, &e2),
            across(&e2, &e2),
        ))
    };
    [worst(0), worst(3)]
}

fn root(chart: &ChartCovariance, index: usize) -> f64 {
    chart[(index, index)].max(0.0).sqrt()
}

impl SphereFit {
    /// The same points with the sphere of another criterion; each touching point scatters by `u_touching_mm`.
    ///
    /// # Errors
    /// See [`touching_sphere`].
    pub fn replaced(
        mut self,
        points: &[Point3<f64>],
        side: Side,
        u_touching_mm: f64,
    ) -> Result<Self, FitError> {
        let found = touching_sphere(&used(points, &self.residuals.used), side)?;
        let chart = found.unit_covariance * (u_touching_mm * u_touching_mm);
        // The chart has the diameter, the covariance the radius.
        let place = |i: usize| if i < 3 { i } else { 6 };
        let scale = |i: usize| if i < 3 { 1.0 } else { 0.5 };
        self.covariance_mm2 = Matrix4::from_fn(|r, c| chart[(place(r), place(c))] * scale(r) * scale(c));
        (self.center_mm, self.diameter_mm) = (found.point_mm, found.diameter_mm);
        (self.u_center_mm, self.u_diameter_mm) = ([0, 1, 2].map(|i| root(&chart, i)), root(&chart, 6));
        let (center, radius) = (self.center(), 0.5 * self.diameter_mm);
        self.residuals.deviation_mm = points.iter().map(|p| (p - center).norm() - radius).collect();
        self.form = self.residuals.form();
        Ok(self)
    }
}

impl CylinderFit {
    /// The same points with the cylinder of another criterion; each touching point scatters by `u_touching_mm`.
    ///
    /// # Errors
    /// See [`touching_cylinder`].
    pub fn replaced(
        mut self,
        points: &[Point3<f64>],
        side: Side,
        u_touching_mm: f64,
    ) -> Result<Self, FitError> {
        let Touching { point_mm, direction, diameter_mm, unit_covariance } =
            touching_cylinder(&used(points, &self.residuals.used), side)?;
        self.chart = unit_covariance * (u_touching_mm * u_touching_mm);
        let axis = Vector3::from(direction);
        let sign = if axis.dot(&Vector3::from(self.axis_direction)) < 0.0 { -1.0 } else { 1.0 };
        (self.axis_point_mm, self.axis_direction) = (point_mm, (axis * sign).into());
        self.diameter_mm = diameter_mm;
        [self.u_axis_point_mm, self.u_axis_direction_rad] = axis_u(&self.chart, &axis);
        self.u_diameter_mm = root(&self.chart, 6);
        let (point, radius) = (Point3::from(point_mm), 0.5 * diameter_mm);
        self.residuals.deviation_mm =
            points.iter().map(|p| (p - point).cross(&axis).norm() - radius).collect();
        self.form = self.residuals.form();
        Ok(self)
    }
}

impl ContourFit {
    /// The same border points with the circle of another criterion; each touching point scatters by `u_touching_mm`. The
    /// uncertainty of the plane stays.
    ///
    /// # Errors
    /// See [`touching_circle`].
    pub fn circle_replaced(
        mut self,
        points: &[Point3<f64>],
        plane: &ChartCovariance,
        side: Side,
        u_touching_mm: f64,
    ) -> Result<Self, FitError> {
        let found = touching_circle(&used(points, &self.residuals.used), side)?;
        self.chart = plane + found.unit_covariance * (u_touching_mm * u_touching_mm);
        (self.center_mm, self.size_mm[0]) = (found.point_mm, found.diameter_mm);
        self.u_center_mm = [0, 1, 2].map(|i| root(&self.chart, i));
        self.u_size_mm[0] = root(&self.chart, 6);
        let (center, radius) = (Point3::from(self.center_mm), 0.5 * self.size_mm[0]);
        self.residuals.deviation_mm = points.iter().map(|p| (p - center).norm() - radius).collect();
        self.form = self.residuals.form();
        Ok(self)
    }
}

impl PlaneFit {
    /// The same points with the minimum-zone plane; each touching point scatters by `u_touching_mm`.
    ///
    /// # Errors
    /// See [`touching_plane`].
    pub fn replaced(mut self, points: &[Point3<f64>], u_touching_mm: f64) -> Result<Self, FitError> {
        let side = self.normal_vector();
        let (found, tangents, covariance) = touching_plane(&used(points, &self.residuals.used))?;
        let (point, normal) = (Vector3::from(found.point_mm), Vector3::from(found.direction));
        self.take(point, normal, tangents, covariance * (u_touching_mm * u_touching_mm));
        self.residuals.deviation_mm = points.iter().map(|p| normal.dot(&(p.coords - point))).collect();
        self.form = self.residuals.form();
        Ok(self.towards(&side))
    }
}
