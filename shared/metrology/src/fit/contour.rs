//! Outlines in a plane: circle, slot, rectangle and straight edge, fitted to the border of a measured surface.

use nalgebra::{Matrix3, Point3, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::Model;
use super::centred::Centred;
use super::chart::{CHART, ChartCovariance, Effect, charted};
use super::form::{Form, Residuals};
use super::outline::{Outline, Placed};
use super::solve::solve;
use super::{FitError, FitSettings, PlaneFit, Support};
use fringe::math;

/// An outline fitted in space, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ContourFit {
    /// Middle of the outline, mm; of an edge or line the middle of its points.
    pub center_mm: [f64; 3],
    /// Unit normal of its plane, out of the material.
    pub normal: [f64; 3],
    /// Unit direction of the length, or of the edge.
    pub direction: [f64; 3],
    /// Diameter of a circle; length and width of a slot or rectangle; zeros of an edge or line, mm.
    pub size_mm: [f64; 2],
    /// Points of the border and their form.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainties of the middle along x, y and z, mm.
    pub u_center_mm: [f64; 3],
    /// Standard uncertainty of the direction within the plane, rad.
    pub u_direction_rad: f64,
    /// Standard uncertainties of `size_mm`, mm.
    pub u_size_mm: [f64; 2],
    /// What the uncertainties rest on.
    #[serde(flatten)]
    pub support: Support,
    /// Covariance of point, directions and sizes in the common chart.
    #[serde(skip)]
    pub chart: ChartCovariance,
    /// Residual of each point of the border.
    #[serde(skip)]
    pub residuals: Residuals,
    /// Standard uncertainty of how far out a side of the border lies, mm, where the cloud leaves out its rims.
    #[serde(skip)]
    pub u_rim_mm: f64,
}

/// What opposite sides do not have in common of it: the middle moves by so much of the uncertainty of a side. Holes and a disc before three rigs, pictures
/// of another renderer: middles were off by 0.05 mm where that of a side is 0.16 mm.
const OF_MIDDLE: f64 = 0.35;

/// A plane with the outline's coordinates: origin and two directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// Origin of the coordinates, mm.
    pub origin: Vector3<f64>,
    /// Unit directions x and y in the plane.
    pub edges: [Vector3<f64>; 2],
}

impl Sheet {
    /// The place of a position in the plane, mm.
    pub fn place(&self, position: &Vector3<f64>) -> [f64; 2] {
        let arm = position - self.origin;
        self.edges.map(|edge| edge.dot(&arm))
    }

    /// The position of a place in the plane, mm.
    pub fn position(&self, [x, y]: [f64; 2]) -> Vector3<f64> {
        self.origin + self.edges[0] * x + self.edges[1] * y
    }
}

impl ContourFit {
    /// The same outline with a share of another covariance added, that of its form, whose points hang together.
    #[must_use]
    pub fn with_form(mut self, form: &Self, share: f64) -> Self {
        self.chart += form.chart * share;
        self.tell_chart();
        let turned =
            self.u_direction_rad * self.u_direction_rad + share * form.u_direction_rad * form.u_direction_rad;
        self.u_direction_rad = turned.sqrt();
        self.support = form.support;
        self
    }

    /// The same outline with a standard uncertainty of how far out the sides of its border lie, mm: an outline that goes round grows by it on each side, and moves a
    /// little; an edge moves.
    #[must_use]
    pub fn with_rim(mut self, u_mm: f64) -> Self {
        let mut by = SVector::<f64, CHART>::zeros();
        self.u_rim_mm = u_mm;
        if self.size_mm == [0.0; 2] {
            let across = Vector3::from(self.normal).cross(&Vector3::from(self.direction));
            by.fixed_rows_mut::<3>(0).copy_from(&across);
        } else {
            (0..2).filter(|size| self.size_mm[*size] > 0.0).for_each(|size| by[6 + size] = 2.0);
            let normal = Vector3::from(self.normal);
            let in_plane = Matrix3::identity() - normal * normal.transpose();
            let mut middle = self.chart.fixed_view_mut::<3, 3>(0, 0);
            middle += in_plane * (OF_MIDDLE * u_mm).powi(2);
        }
        self.chart += by * by.transpose() * (u_mm * u_mm);
        self.tell_chart();
        self
    }

    /// States the uncertainties that the chart has.
    fn tell_chart(&mut self) {
        let u = |index: usize| self.chart[(index, index)].max(0.0).sqrt();
        (self.u_center_mm, self.u_size_mm) = ([u(0), u(1), u(2)], [u(6), u(7)]);
    }
}

impl Placed {
    /// The outline as it was fitted, in the coordinates of its plane.
    #[must_use]
    pub fn fitted(near: &Self, fit: &ContourFit, sheet: &Sheet) -> Self {
        let [a, b] = fit.size_mm.map(|size| 0.5 * size);
        let outline = match near.outline {
            Outline::Circle(_) => Outline::Circle(a),
            Outline::Slot(_) => Outline::Slot([(a - b).max(0.0), b]),
            Outline::Rectangle(_) => Outline::Rectangle([a, b]),
            Outline::Edge(half) => Outline::Edge(half),
        };
        let along = sheet.edges.map(|edge| edge.dot(&Vector3::from(fit.direction)));
        let center = sheet.place(&Vector3::from(fit.center_mm));
        Self { outline, center, turn_rad: math::atan2(along[1], along[0]) }
    }
}

/// Fits an outline to points of its border in a plane. `plane` adds its uncertainty to that within the plane; without
/// it the plane is a section that is held.
///
/// # Errors
/// Fewer points than the outline has sizes and places, no convergence; see [`FitError`].
pub fn contour(
    points: &[[f64; 2]],
    near: &Placed,
    sheet: &Sheet,
    plane: Option<&PlaneFit>,
    settings: &FitSettings,
) -> Result<ContourFit, FitError> {
    let flat: Vec<Point3<f64>> = points.iter().map(|[x, y]| Point3::new(*x, *y, 0.0)).collect();
    let centroid = Centred::new("outline", &flat)?.centroid;
    let start = Placed { center: [near.center[0] - centroid.x, near.center[1] - centroid.y], ..*near };
    let fitted = match near.outline {
        Outline::Circle(_) => fit_flat::<3>(&flat, start, settings),
        Outline::Edge(_) => fit_flat::<2>(&flat, start, settings),
        Outline::Slot(_) | Outline::Rectangle(_) => fit_flat::<5>(&flat, start, settings),
    }?;
    let Fitted { placed, chart: within, form, support, residuals } = fitted;
    let center = [placed.center[0] + centroid.x, placed.center[1] + centroid.y];
    let [e1, e2] = sheet.edges;
    let normal = e1.cross(&e2);
    let position = sheet.position(center);
    let lift = |v: [f64; 2]| e1 * v[0] + e2 * v[1];
    let effects = [
        Effect::shift(e1),
        Effect::shift(e2),
        Effect::turn(normal),
        Effect::sizes([1.0, 0.0]),
        Effect::sizes([0.0, 1.0]),
    ];
    let mut chart = charted(&effects, &within);
    if let Some(plane) = plane {
        chart += plane.chart_at(&Point3::from(position));
    }
    let u = |index: usize| chart[(index, index)].max(0.0).sqrt();
    Ok(ContourFit {
        center_mm: position.into(),
        normal: normal.into(),
        direction: lift(placed.global([1.0, 0.0])).into(),
        size_mm: placed.outline.sizes_mm(),
        form,
        u_center_mm: [u(0), u(1), u(2)],
        u_direction_rad: within[(2, 2)].max(0.0).sqrt(),
        u_size_mm: [u(6), u(7)],
        support,
        chart,
        residuals,
        u_rim_mm: 0.0,
    })
}

/// What remains to be said of a fit in the plane.
struct Fitted {
    placed: Placed,
    /// Covariance of centre, turn and both sizes.
    chart: nalgebra::SMatrix<f64, 5, 5>,
    form: Form,
    support: Support,
    residuals: Residuals,
}

fn fit_flat<const P: usize>(
    points: &[Point3<f64>],
    start: Placed,
    settings: &FitSettings,
) -> Result<Fitted, FitError>
where
    Flat: Model<P>,
{
    let solution = solve::<Flat, P>("outline", P + 1, points, settings, |_| Ok(Flat::new(start)))?;
    let placed = solution.model.placed;
    let valid = placed.outline.sizes_mm().iter().all(|size| *size >= 0.0);
    if !valid {
        return Err(FitError::Degenerate { element: "outline", why: "a size would be negative" });
    }
    let effects = solution.model.by_parameters::<P>();
    Ok(Fitted {
        chart: effects * solution.covariance * effects.transpose(),
        placed,
        form: solution.form,
        support: solution.support,
        residuals: solution.residuals,
    })
}

/// An outline in the plane z = 0 about the centroid of its points. Parameters of a circle: centre, radius; of an edge:
/// offset, turn; of slot and rectangle: centre, turn, both half sizes.
/// Which side of a rectangle a point belongs to is decided where the search begins, so that it does not change on the way.
#[derive(Debug, Clone, Copy)]
struct Flat {
    placed: Placed,
    sides: Placed,
}

impl Flat {
    fn new(placed: Placed) -> Self {
        Self { placed, sides: placed }
    }

    /// Change of centre, turn and reported sizes by each parameter.
    fn by_parameters<const P: usize>(&self) -> nalgebra::SMatrix<f64, 5, P> {
        let mut by = nalgebra::SMatrix::<f64, 5, P>::zeros();
        match self.placed.outline {
            Outline::Edge(_) => {
                let [x, y] = self.placed.global([0.0, 1.0]);
                (by[(0, 0)], by[(1, 0)], by[(2, 1)]) = (x, y, 1.0);
            }
            Outline::Circle(_) => (by[(0, 0)], by[(1, 1)], by[(3, 2)]) = (1.0, 1.0, 2.0),
            Outline::Slot(_) | Outline::Rectangle(_) => {
                (by[(0, 0)], by[(1, 1)], by[(2, 2)]) = (1.0, 1.0, 1.0);
                (by[(3, 3)], by[(4, 4)]) = (2.0, 2.0);
                if matches!(self.placed.outline, Outline::Slot(_)) {
                    by[(3, 4)] = 2.0;
                }
            }
        }
        by
    }

    /// Distance, its gradient in the outline's directions, and its change by both half sizes.
    fn distance(&self, point: &Vector3<f64>) -> (f64, [f64; 2], [f64; 2], [f64; 2]) {
        let local = self.placed.local([point.x, point.y]);
        if let (Outline::Rectangle([a, b]), Outline::Rectangle([a0, b0])) =
            (self.placed.outline, self.sides.outline)
        {
            let [u, v] = self.sides.local([point.x, point.y]);
            if u.abs() - a0 > v.abs() - b0 {
                return (local[0] * u.signum() - a, local, [u.signum(), 0.0], [-1.0, 0.0]);
            }
            return (local[1] * v.signum() - b, local, [0.0, v.signum()], [0.0, -1.0]);
        }
        let distance = self.placed.outline.see(local).0;
        let out = self.placed.outline.out(local);
        let by_sizes = match self.placed.outline {
            Outline::Circle(_) => [-1.0, 0.0],
            Outline::Slot(_) => [-out[0] * local[0].signum(), -1.0],
            Outline::Rectangle(_) | Outline::Edge(_) => [0.0, 0.0],
        };
        (distance, local, out, by_sizes)
    }
}

impl<const P: usize> Model<P> for Flat {
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        self.distance(point).0
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, P>)) {
        let (distance, [u, v], out, by_sizes) = self.distance(point);
        let [gx, gy] = self.placed.global(out);
        // Turning the outline by dα moves the place by −dα about its middle: du = v dα, dv = −u dα.
        let by_turn = out[0] * v - out[1] * u;
        let derivatives: [f64; 5] = match self.placed.outline {
            Outline::Circle(_) => [-gx, -gy, by_sizes[0], 0.0, 0.0],
            Outline::Edge(_) => [1.0, by_turn, 0.0, 0.0, 0.0],
            _ => [-gx, -gy, by_turn, by_sizes[0], by_sizes[1]],
        };
        add(distance, &SVector::<f64, P>::from_fn(|i, _| derivatives[i]));
    }

    fn moved(&self, step: &SVector<f64, P>) -> Self {
        let Placed { outline, center: [x, y], turn_rad } = self.placed;
        let at = |index: usize| step.get(index).copied().unwrap_or(0.0);
        let placed = match outline {
            Outline::Circle(radius) => {
                Placed { outline: Outline::Circle(radius + at(2)), center: [x + at(0), y + at(1)], turn_rad }
            }
            Outline::Edge(_) => {
                let [nx, ny] = self.placed.global([0.0, 1.0]);
                let center = [x + at(0) * nx, y + at(0) * ny];
                Placed { outline, center, turn_rad: turn_rad + at(1) }
            }
            Outline::Slot([a, b]) => Placed {
                outline: Outline::Slot([a + at(3), b + at(4)]),
                center: [x + at(0), y + at(1)],
                turn_rad: turn_rad + at(2),
            },
            Outline::Rectangle([a, b]) => Placed {
                outline: Outline::Rectangle([a + at(3), b + at(4)]),
                center: [x + at(0), y + at(1)],
                turn_rad: turn_rad + at(2),
            },
        };
        Self { placed, sides: self.sides }
    }
}

/// Width of the narrowest strip that holds places in a section, mm: straightness (MZLI of ISO 12780-1).
///
/// # Errors
/// Fewer than 3 places, no convergence; see [`FitError`].
pub fn strip_minimum_zone_mm(places: &[[f64; 2]]) -> Result<f64, FitError> {
    let flat: Vec<Point3<f64>> = places.iter().map(|[x, y]| Point3::new(*x, *y, 0.0)).collect();
    let start = |points: &[Vector3<f64>]| {
        let (xx, xy) = points.iter().fold((0.0, 0.0), |(a, b), p| (a + p.x * p.x, b + p.x * p.y));
        let turn_rad = if xx > 0.0 { math::atan2(xy, xx) } else { 0.0 };
        Ok(Flat::new(Placed { outline: Outline::Edge(1.0), center: [0.0, 0.0], turn_rad }))
    };
    super::zone::minimum_zone::<Flat, 2>("line", &flat, start).map(|zone| zone.width_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;

    #[test]
    fn derivatives_agree_with_differences() {
        let placed = |outline| Flat::new(Placed { outline, center: [0.2, -0.1], turn_rad: 0.3 });
        derivatives_agree::<Flat, 3>(&placed(Outline::Circle(2.0)));
        derivatives_agree::<Flat, 2>(&placed(Outline::Edge(5.0)));
        derivatives_agree::<Flat, 5>(&placed(Outline::Slot([1.0, 0.7])));
        derivatives_agree::<Flat, 5>(&placed(Outline::Rectangle([2.0, 1.0])));
    }
}
