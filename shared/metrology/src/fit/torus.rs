//! The torus.

use nalgebra::{Point3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use super::adjust::Model;
use super::axis::{Axis, best_of, directions, thinned, u_point_mm, worst_tilt_rad};
use super::centred::Principal;
use super::chart::{ChartCovariance, Effect, charted};
use super::circle::algebraic_circle;
use super::form::{Form, Residuals};
use super::plane::refuse_flat;
use super::solve::solve;
use super::sphere::LARGEST_RADIUS_RATIO;
use super::{FitError, FitSettings, Support};

const ELEMENT: &str = "torus";

/// A torus fitted to points, with uncertainties.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TorusFit {
    /// Centre of the torus, mm.
    pub center_mm: [f64; 3],
    /// Unit direction of the axis of rotation; its largest component is positive.
    pub axis_direction: [f64; 3],
    /// Diameter of the circle of the tube's middle, mm.
    pub ring_diameter_mm: f64,
    /// Diameter of the tube, mm.
    pub tube_diameter_mm: f64,
    /// Points used and form deviation.
    #[serde(flatten)]
    pub form: Form,
    /// Standard uncertainties of the centre along x, y and z, mm.
    pub u_center_mm: [f64; 3],
    /// Standard uncertainty of the direction about its worst axis, rad.
    pub u_axis_direction_rad: f64,
    /// Standard uncertainty of `ring_diameter_mm`, mm.
    pub u_ring_diameter_mm: f64,
    /// Standard uncertainty of `tube_diameter_mm`, mm.
    pub u_tube_diameter_mm: f64,
    /// What the uncertainties rest on.
    #[serde(flatten)]
    pub support: Support,
    /// Covariance of point, direction and sizes in the common chart.
    #[serde(skip)]
    pub chart: ChartCovariance,
    /// Residual of each point given.
    #[serde(skip)]
    pub residuals: Residuals,
}

/// Fits a torus. The start needs points from more than a stub of it: a quarter of the ring, as seen from one side, does.
///
/// # Errors
/// Fewer than 8 points, points in one plane, no convergence, a tube wider than its ring; see [`FitError`].
pub fn torus(points: &[Point3<f64>], settings: &FitSettings) -> Result<TorusFit, FitError> {
    let solution = solve(ELEMENT, 8, points, settings, start)?;
    refuse_flat(ELEMENT, points, &solution.form, settings)?;
    let (model, covariance) = (solution.model, solution.covariance);
    if !(model.tube > 0.0 && model.tube < model.ring) {
        let why = "the tube would be wider than its ring; are they points of a sphere?";
        return Err(FitError::Degenerate { element: ELEMENT, why });
    }
    let direction = model.axis.direction;
    let sign = if direction[direction.iamax()] < 0.0 { -1.0 } else { 1.0 };
    Ok(TorusFit {
        center_mm: (solution.centroid + model.axis.point + direction * model.along).into(),
        axis_direction: (direction * sign).into(),
        ring_diameter_mm: 2.0 * model.ring,
        tube_diameter_mm: 2.0 * model.tube,
        form: solution.form,
        u_center_mm: u_point_mm(&model.center_by_parameters(), &covariance),
        u_axis_direction_rad: worst_tilt_rad(covariance.fixed_view::<2, 2>(0, 0).into_owned()),
        u_ring_diameter_mm: 2.0 * covariance[(5, 5)].max(0.0).sqrt(),
        u_tube_diameter_mm: 2.0 * covariance[(6, 6)].max(0.0).sqrt(),
        support: solution.support,
        chart: charted(&model.effects(), &covariance),
        residuals: solution.residuals,
    })
}

/// Parameters: two tilts, two shifts across, place along the axis, radius of the ring, radius of the tube.
///
/// With a point at the distance ρ from the axis and z from the plane of the ring, the distance is
/// √((ρ − R)² + z²) − r.
#[derive(Debug, Clone)]
struct Torus {
    axis: Axis,
    along: f64,
    ring: f64,
    tube: f64,
}

impl Torus {
    /// Change of the centre by each parameter: a tilt turns about the axis' point, which lies `along` away from the centre.
    fn center_by_parameters(&self) -> SMatrix<f64, 3, 7> {
        let ([e1, e2], direction, none) = (self.axis.tangents, self.axis.direction, Vector3::zeros());
        SMatrix::from_columns(&[e1 * self.along, e2 * self.along, e1, e2, direction, none, none])
    }

    /// What the parameters do in the common chart; its sizes are the diameters of ring and tube.
    fn effects(&self) -> [Effect; 7] {
        let ([e1, e2], direction) = (self.axis.tangents, self.axis.direction);
        let tilt = |shift: Vector3<f64>, turn: Vector3<f64>| Effect { shift, turn, sizes: [0.0; 2] };
        [
            tilt(e1 * self.along, e2),
            tilt(e2 * self.along, -e1),
            Effect::shift(e1),
            Effect::shift(e2),
            Effect::shift(direction),
            Effect::sizes([2.0, 0.0]),
            Effect::sizes([0.0, 2.0]),
        ]
    }

    /// Distance from the middle of the tube, and the unit vector from there in (ρ, z).
    fn section(&self, radius: f64, height: f64) -> (f64, [f64; 2]) {
        let (across, up) = (radius - self.ring, height - self.along);
        let distance = (across * across + up * up).sqrt();
        if distance > 0.0 { (distance, [across / distance, up / distance]) } else { (0.0, [0.0, 0.0]) }
    }
}

impl Model<7> for Torus {
    fn deviation(&self, point: &Vector3<f64>) -> f64 {
        let seen = self.axis.see(point);
        self.section(seen.radius, seen.height).0 - self.tube
    }

    #[inline(always)]
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 7>)) {
        let seen = self.axis.see(point);
        let (distance, [c, s]) = self.section(seen.radius, seen.height);
        // A tilt towards the point by 1 rad: ρ falls by h, h rises by ρ.
        let tilt = s * seen.radius - c * seen.height;
        let [a, b] = seen.out;
        let derivatives = [tilt * a, tilt * b, -c * a, -c * b, -s, -c, -1.0];
        add(distance - self.tube, &SVector::from(derivatives));
    }

    fn moved(&self, step: &SVector<f64, 7>) -> Self {
        let (axis, slid) = self.axis.moved([step[0], step[1]], [step[2], step[3]]);
        let along = self.along + step[4] - slid;
        Self { axis, along, ring: self.ring + step[5], tube: self.tube + step[6] }
    }
}

/// Start: for many directions the algebraic circle of the points seen along them; the best few adjusted.
fn start(points: &[Vector3<f64>]) -> Result<Torus, FitError> {
    let principal = Principal::new(points);
    principal.check_spatial(ELEMENT)?;
    let thin = thinned(points);
    let candidates = directions(points).into_iter().filter_map(|direction| {
        let (point, ring) = algebraic_circle(&thin, &direction)?;
        let mut torus = Torus { axis: Axis::new(point, direction), along: 0.0, ring, tube: 0.0 };
        torus.tube = thin.iter().map(|p| torus.deviation(p)).sum::<f64>() / thin.len().max(1) as f64;
        Some(torus)
    });
    let best = best_of(ELEMENT, candidates, &thin);
    best.filter(|m| m.ring.abs() < LARGEST_RADIUS_RATIO * principal.extents_mm[2])
        .ok_or(FitError::NoConvergence { element: ELEMENT, iterations: 0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::adjust::tests::derivatives_agree;
    use crate::fit::tests::Noise;
    use fringe::math;
    use std::f64::consts::{PI, TAU};

    #[test]
    fn derivatives_agree_with_differences() {
        let axis = Axis::new(Vector3::new(0.2, -0.3, 0.5), Vector3::new(0.6, 0.0, -0.8));
        derivatives_agree(&Torus { axis, along: 0.4, ring: 3.0, tube: 1.0 });
    }

    /// Tori of ring 30 mm and tube 8 mm in any pose: whole, the half that one side sees, and a third of the ring.
    #[test]
    fn tori_are_found_in_any_pose() {
        for seed in 0..30 {
            let mut noise = Noise(seed);
            let direction = noise.direction();
            let [e1, e2] = super::super::normal::tangents(&direction);
            let center = Vector3::new(200.0, -100.0, 500.0);
            for (turn, lowest) in [(TAU, -PI), (TAU, 0.0), (2.1, 0.0)] {
                let points: Vec<Point3<f64>> = (0..600)
                    .map(|_| {
                        let (sin, cos) = math::sincos(turn * noise.uniform());
                        let (up, across) = math::sincos(lowest + (PI - lowest) * noise.uniform());
                        let out = e1 * cos + e2 * sin;
                        let tube = 4.0 + 0.001 * noise.normal();
                        Point3::from(center + out * (15.0 + tube * across) + direction * (tube * up))
                    })
                    .collect();
                let fit = torus(&points, &FitSettings::default()).unwrap();
                let off = (Vector3::from(fit.center_mm) - center).norm();
                assert!(off < 0.01, "{seed}, {turn}: centre off by {off}");
                assert!((fit.ring_diameter_mm - 30.0).abs() < 6.0 * fit.u_ring_diameter_mm + 1e-6);
                assert!((fit.tube_diameter_mm - 8.0).abs() < 6.0 * fit.u_tube_diameter_mm + 1e-6);
                assert!(Vector3::from(fit.axis_direction).cross(&direction).norm() < 1e-3);
            }
        }
    }

    #[test]
    fn what_is_no_torus_is_refused() {
        let mut noise = Noise(1);
        let ball: Vec<Point3<f64>> = (0..300).map(|_| Point3::from(noise.direction() * 10.0)).collect();
        assert!(torus(&ball, &FitSettings::default()).is_err());
        let flat: Vec<Point3<f64>> =
            (0..100).map(|i| Point3::new(f64::from(i % 10), f64::from(i / 10), 0.0)).collect();
        let error = torus(&flat, &FitSettings::default()).unwrap_err().to_string();
        assert!(error.contains("in one plane"), "{error}");
        assert!(
            torus(&flat[..6], &FitSettings::default()).unwrap_err().to_string().contains("needs at least 8")
        );
    }
}
