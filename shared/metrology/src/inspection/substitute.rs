//! Elements reduced to point, directions and sizes: what constructions, datums and characteristics work on.

use nalgebra::{SMatrix, SVector, Vector3};

use super::fitted_element::FittedElement;
use super::geometry::Geometry;
use crate::fit::{CHART, ChartCovariance, ContourFit, Outline, tangents};
use fringe::math;

/// What an element counts as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A point in space: centre of a sphere, intersection.
    Point,
    /// A point that is known along its normal alone.
    SurfacePoint,
    /// A straight line or axis.
    Line,
    /// A plane; its normal is the direction.
    Plane,
    /// A circle in the plane of its normal; its size is the diameter.
    Circle,
    /// A slot or rectangle in the plane of its normal; sizes are length and width.
    Oblong,
    /// A sphere; its size is the diameter.
    Sphere,
    /// A cylinder; its size is the diameter.
    Cylinder,
    /// A cone; sizes are the diameter at its point and the half angle, rad.
    Cone,
    /// A torus; sizes are the diameters of ring and tube.
    Torus,
    /// A freeform surface: it has a profile and nothing else.
    Surface,
}

impl Shape {
    /// In the words of a message.
    pub fn words(self) -> &'static str {
        match self {
            Self::Point => "point",
            Self::SurfacePoint => "surface point",
            Self::Line => "line",
            Self::Plane => "plane",
            Self::Circle => "circle",
            Self::Oblong => "slot or rectangle",
            Self::Sphere => "sphere",
            Self::Cylinder => "cylinder",
            Self::Cone => "cone",
            Self::Torus => "torus",
            Self::Surface => "freeform surface",
        }
    }

    /// Whether it has a straight axis that is meant by its position.
    pub fn is_axis(self) -> bool {
        matches!(self, Self::Line | Self::Cylinder | Self::Cone)
    }

    /// Whether it has a point that is meant by its position.
    pub fn is_point(self) -> bool {
        matches!(
            self,
            Self::Point | Self::SurfacePoint | Self::Sphere | Self::Torus | Self::Circle | Self::Oblong
        )
    }
}

/// An element as point, directions, sizes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Substitute {
    /// What it counts as.
    pub shape: Shape,
    /// Point of the element, mm.
    pub point: Vector3<f64>,
    /// Unit direction: axis, normal; zero of points and spheres.
    pub direction: Vector3<f64>,
    /// Unit direction across: length of an oblong, first edge of a plane; zero where there is none.
    pub across: Vector3<f64>,
    /// Sizes in the order of its [`Shape`].
    pub sizes: [f64; 2],
    /// Half extents along the axis, or along both edges of a plane, mm.
    pub half_mm: [f64; 2],
}

impl Substitute {
    /// A point in space.
    pub fn point(point: Vector3<f64>) -> Self {
        let zero = Vector3::zeros();
        Self { shape: Shape::Point, point, direction: zero, across: zero, sizes: [0.0; 2], half_mm: [0.0; 2] }
    }

    /// A line through a point along a unit direction.
    pub fn line(point: Vector3<f64>, direction: Vector3<f64>, half_mm: f64) -> Self {
        Self { shape: Shape::Line, direction, half_mm: [half_mm, 0.0], ..Self::point(point) }
    }

    /// A plane through a point with a unit normal.
    pub fn plane(point: Vector3<f64>, normal: Vector3<f64>, half_mm: [f64; 2]) -> Self {
        let [across, _] = tangents(&normal);
        Self { shape: Shape::Plane, direction: normal, across, half_mm, ..Self::point(point) }
    }

    /// A circle in the plane of its normal.
    pub fn circle(point: Vector3<f64>, normal: Vector3<f64>, diameter: f64) -> Self {
        Self { shape: Shape::Circle, direction: normal, sizes: [diameter, 0.0], ..Self::point(point) }
    }

    /// The nominal element of a plan.
    pub fn nominal(geometry: &Geometry) -> Self {
        let base = Self::point(geometry.place().coords);
        match geometry {
            Geometry::Sphere { radius_mm, .. } => {
                Self { shape: Shape::Sphere, sizes: [2.0 * radius_mm, 0.0], ..base }
            }
            Geometry::Plane { normal, edges, half_size_mm, .. } => Self {
                shape: Shape::Plane,
                direction: *normal,
                across: edges[0],
                half_mm: *half_size_mm,
                ..base
            },
            Geometry::Cylinder { axis, radius_mm, half_length_mm, .. } => Self {
                shape: Shape::Cylinder,
                direction: *axis,
                sizes: [2.0 * radius_mm, 0.0],
                half_mm: [*half_length_mm, 0.0],
                ..base
            },
            Geometry::Cone { axis, radius_mm, half_angle_rad, half_length_mm, .. } => Self {
                shape: Shape::Cone,
                direction: *axis,
                sizes: [2.0 * radius_mm, *half_angle_rad],
                half_mm: [*half_length_mm, 0.0],
                ..base
            },
            Geometry::Torus { axis, ring_radius_mm, tube_radius_mm, .. } => Self {
                shape: Shape::Torus,
                direction: *axis,
                sizes: [2.0 * ring_radius_mm, 2.0 * tube_radius_mm],
                ..base
            },
            Geometry::Outline { normal, edges, outline, .. } => {
                let sizes = outline.sizes_mm();
                match outline {
                    Outline::Edge(half) => Self::line(base.point, edges[0], *half),
                    Outline::Circle(_) => {
                        Self { across: edges[0], ..Self::circle(base.point, *normal, sizes[0]) }
                    }
                    _ => Self { shape: Shape::Oblong, direction: *normal, across: edges[0], sizes, ..base },
                }
            }
            Geometry::Line { direction, half_size_mm, .. } => {
                Self::line(base.point, *direction, half_size_mm[0])
            }
            Geometry::Surface(_) => Self { shape: Shape::Surface, ..base },
            Geometry::Point { normal, .. } => Self { shape: Shape::SurfacePoint, direction: *normal, ..base },
        }
    }

    /// A fitted element, its directions on the side of the nominal ones, its extents those of the nominal one.
    pub(super) fn fitted(fit: &FittedElement, nominal: &Self) -> (Self, ChartCovariance) {
        let contour = |fit: &ContourFit| {
            let sizes = fit.size_mm;
            (
                fit.center_mm,
                if nominal.shape == Shape::Line { fit.direction } else { fit.normal },
                sizes,
                fit.chart,
            )
        };
        let (point, direction, sizes, chart) = match fit {
            FittedElement::Sphere(s) => (s.center_mm, [0.0; 3], [s.diameter_mm, 0.0], s.chart()),
            FittedElement::Plane(p) => (p.centroid_mm, p.normal, [0.0; 2], p.chart()),
            FittedElement::Cylinder(c) => (c.axis_point_mm, c.axis_direction, [c.diameter_mm, 0.0], c.chart),
            FittedElement::Cone(c) => {
                let sizes = [c.diameter_mm, c.half_angle_deg.to_radians()];
                (c.axis_point_mm, c.axis_direction, sizes, c.chart)
            }
            FittedElement::Torus(t) => {
                (t.center_mm, t.axis_direction, [t.ring_diameter_mm, t.tube_diameter_mm], t.chart)
            }
            FittedElement::Circle(c)
            | FittedElement::Slot(c)
            | FittedElement::Rectangle(c)
            | FittedElement::Edge(c)
            | FittedElement::Line(c) => contour(c),
            FittedElement::Surface(s) => (s.place_mm, [0.0; 3], [0.0; 2], ChartCovariance::zeros()),
            FittedElement::Point(p) => (p.point_mm, p.normal, [0.0; 2], p.chart),
        };
        let direction = Vector3::from(direction);
        let direction = if direction.dot(&nominal.direction) < 0.0 { -direction } else { direction };
        let across = match fit {
            FittedElement::Slot(c) | FittedElement::Rectangle(c) => Vector3::from(c.direction),
            _ => nominal.across - direction * direction.dot(&nominal.across),
        };
        let across = if across.norm() > 1e-9 { across / across.norm() } else { across };
        let across = if across.dot(&nominal.across) < 0.0 { -across } else { across };
        let found = Self { point: Vector3::from(point), direction, across, sizes, ..*nominal };
        // Where the points happen to lie must not decide where a plane or axis is looked at.
        match (fit, nominal.shape) {
            (FittedElement::Plane(plane), _) => {
                let way = plane.distance_mm(&nominal.point.into()) / direction.dot(&nominal.direction);
                let point = nominal.point - nominal.direction * way;
                (Self { point, ..found }, plane.chart_at(&point.into()))
            }
            (_, Shape::Cone | Shape::Cylinder) => found.at_height_of(&nominal.point, &chart),
            _ => (found, chart),
        }
    }

    /// A cylinder or cone with its point, and the cone's diameter, at the height of another point.
    fn at_height_of(self, place: &Vector3<f64>, chart: &ChartCovariance) -> (Self, ChartCovariance) {
        let height = (place - self.point).dot(&self.direction);
        let arm = self.direction * height;
        // The second size of a cylinder is zero, so that its diameter is the same everywhere.
        let cos = math::cos(self.sizes[1]);
        let mut by = ChartCovariance::identity();
        // A turn ω about the old point moves the new one by ω × arm.
        let cross = -arm.cross_matrix();
        by.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        if self.shape == Shape::Cone {
            by[(6, 7)] = 2.0 * height / (cos * cos);
        }
        let sizes = [self.sizes[0] + 2.0 * height * math::tan(self.sizes[1]), self.sizes[1]];
        (Self { point: self.point + arm, sizes, ..self }, by * chart * by.transpose())
    }

    /// The element after a motion in its chart: shift, turn about its point, change of sizes.
    #[must_use]
    pub fn moved(&self, step: &SVector<f64, CHART>) -> Self {
        let turn = Vector3::new(step[3], step[4], step[5]);
        Self {
            point: self.point + Vector3::new(step[0], step[1], step[2]),
            direction: turned(&self.direction, &turn),
            across: turned(&self.across, &turn),
            sizes: [self.sizes[0] + step[6], self.sizes[1] + step[7]],
            ..*self
        }
    }
}

/// A vector turned by a turn vector.
pub fn turned(vector: &Vector3<f64>, turn: &Vector3<f64>) -> Vector3<f64> {
    let angle = turn.norm();
    if angle == 0.0 {
        return *vector;
    }
    let axis = turn / angle;
    let (sin, cos) = math::sincos(angle);
    vector * cos + axis.cross(vector) * sin + axis * (axis.dot(vector) * (1.0 - cos))
}

/// Columns L with L Lᵀ = C, by Cholesky's method with pivoting; as many as the covariance has rank.
pub(super) fn roots(covariance: &ChartCovariance) -> Vec<SVector<f64, CHART>> {
    let mut rest: SMatrix<f64, CHART, CHART> = *covariance;
    let mut columns = Vec::new();
    for _ in 0..CHART {
        // Relative to what the parameter began with: lengths and angles do not compare.
        let share = |i: usize| if covariance[(i, i)] > 0.0 { rest[(i, i)] / covariance[(i, i)] } else { 0.0 };
        let pivot = (0..CHART).fold(0, |best, i| if share(i) > share(best) { i } else { best });
        if share(pivot) <= 1e-12 {
            break;
        }
        let column = rest.column(pivot) / rest[(pivot, pivot)].sqrt();
        rest -= column * column.transpose();
        columns.push(column);
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_columns_rebuild_the_covariance_whatever_its_rank() {
        let a = SVector::<f64, CHART>::from([1.0, 0.5, 0.0, 1e-4, 0.0, 0.0, 2.0, 0.0]);
        let b = SVector::<f64, CHART>::from([0.0, 0.3, 0.0, -2e-4, 1e-5, 0.0, 0.1, 0.0]);
        let covariance = a * a.transpose() + b * b.transpose();
        let columns = roots(&covariance);
        assert_eq!(columns.len(), 2);
        let again: ChartCovariance = columns.iter().map(|c| c * c.transpose()).sum();
        assert!((again - covariance).amax() < 1e-12);
        assert!(roots(&ChartCovariance::zeros()).is_empty());
    }
}
