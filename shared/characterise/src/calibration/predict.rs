//! Uncertainties of projections and points from the covariance.

use super::covariance::Gauge;
use super::model::{DEVICE, world_rows};
use super::result::Calibration;
use fringe::math::linear::{Dense, dot};
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point3, Vector3};

/// Uncertainty of a triangulated point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointUncertainty {
    /// Covariance by the calibration, mm² in the world frame: the same for each measurement (systematic). The world is
    /// held by the mean of the boards.
    pub systematic_mm2: Matrix3<f64>,
    /// Covariance by the noise of the pixels, mm².
    pub noise_mm2: Matrix3<f64>,
}

/// How a triangulated point answers to the parameters of its two devices.
pub(super) struct Sensitivity {
    /// Places of the parameters in the covariance.
    pub places: Vec<usize>,
    /// 3 × 32: mm by parameter.
    pub rows: Dense,
}

impl Calibration {
    /// Covariance of the projection of a world point that is fixed to the mean of the boards, px²; `None` for a device
    /// that does not exist or a point behind it.
    ///
    /// This is the uncertainty of the model, without the noise of a detection (mrcal's projection uncertainty).
    pub fn projection_covariance_px2(&self, device: usize, world_mm: &Point3<f64>) -> Option<Matrix2<f64>> {
        let camera = &self.devices.get(device)?.camera;
        let (own, _) = world_rows(camera, &world_mm.coords)?;
        let matrix = self.covariance.matrix(Gauge::Boards);
        let first = DEVICE * device;
        let entry = |i: usize, j: usize| {
            let left = own[i].iter().enumerate();
            left.map(|(a, l)| l * dot(&matrix.row(first + a)[first..first + DEVICE], &own[j])).sum::<f64>()
        };
        Some(Matrix2::from_fn(entry))
    }

    /// Standard uncertainty of a projection: root of the sum of the variances of x and y, px.
    pub fn projection_u_px(&self, device: usize, world_mm: &Point3<f64>) -> Option<f64> {
        Some(self.projection_covariance_px2(device, world_mm)?.trace().max(0.0).sqrt())
    }

    /// Uncertainty of a point triangulated from two devices whose pixels have the standard deviation `noise_px` in each
    /// coordinate; `None` for devices that do not exist, points behind them, or rays that do not cross.
    pub fn point_uncertainty(
        &self,
        pair: [usize; 2],
        world_mm: &Point3<f64>,
        noise_px: [f64; 2],
    ) -> Option<PointUncertainty> {
        let sensitivity = self.sensitivity(pair, world_mm)?;
        let inner = self.part(&sensitivity.places, &sensitivity.places);
        let covariance = sensitivity.rows.sandwich(&inner);
        let (_, halves, inverse) = self.image_points(pair, world_mm)?;
        let mut noise = Matrix3::zeros();
        for (half, sd) in halves.iter().zip(noise_px) {
            noise += half.transpose() * half * (sd * sd);
        }
        Some(PointUncertainty {
            systematic_mm2: Matrix3::from_fn(|i, j| covariance.at(i, j)),
            noise_mm2: inverse * noise * inverse,
        })
    }

    /// −(HᵀH)⁻¹ Hᵀ ∂q/∂θ of the pair's parameters: where the point goes when the pixels stay and the model changes.
    pub(super) fn sensitivity(&self, pair: [usize; 2], world_mm: &Point3<f64>) -> Option<Sensitivity> {
        let (rows, halves, inverse) = self.image_points(pair, world_mm)?;
        let mut sensitivity = Dense::zeros(3, 2 * DEVICE);
        for (side, (own, half)) in rows.iter().zip(&halves).enumerate() {
            let back = inverse * half.transpose();
            for (parameter, (x, y)) in own[0].iter().zip(&own[1]).enumerate() {
                for axis in 0..3 {
                    let value = -(back[(axis, 0)] * x + back[(axis, 1)] * y);
                    sensitivity.set(axis, DEVICE * side + parameter, value);
                }
            }
        }
        let places = pair.iter().flat_map(|d| DEVICE * d..DEVICE * (d + 1)).collect();
        Some(Sensitivity { places, rows: sensitivity })
    }

    /// Part of the covariance, boards held.
    pub(super) fn part(&self, rows: &[usize], columns: &[usize]) -> Dense {
        let matrix = self.covariance.matrix(Gauge::Boards);
        Dense::from_fn(rows.len(), columns.len(), |i, j| matrix.at(rows[i], columns[j]))
    }

    /// Derivatives of both projections, and (HᵀH)⁻¹.
    #[expect(clippy::type_complexity, reason = "three parts of one computation, used twice above")]
    fn image_points(
        &self,
        pair: [usize; 2],
        world_mm: &Point3<f64>,
    ) -> Option<([[[f64; DEVICE]; 2]; 2], [Matrix2x3<f64>; 2], Matrix3<f64>)> {
        let one = |device: usize| world_rows(&self.devices.get(device)?.camera, &world_mm.coords);
        let (a, half_a) = one(pair[0])?;
        let (b, half_b) = one(pair[1])?;
        let normal = half_a.transpose() * half_a + half_b.transpose() * half_b;
        // Rays that hardly cross: the depth would be noise.
        let inverse = normal.try_inverse().filter(|i| i.iter().all(|v| v.is_finite() && v.abs() < 1e6))?;
        Some(([a, b], [half_a, half_b], inverse))
    }

    /// Standard uncertainty of the distance of two points by the calibration, mm: each point has its own pair.
    pub fn distance_u_mm(&self, ends: [(&[usize; 2], &Point3<f64>); 2]) -> Option<f64> {
        let along: Vector3<f64> = (ends[1].1 - ends[0].1).try_normalize(1e-9)?;
        let (mut places, mut row) = (Vec::new(), Vec::new());
        for ((pair, point), sign) in ends.into_iter().zip([-1.0, 1.0]) {
            let own = self.sensitivity(*pair, point)?;
            for column in 0..2 * DEVICE {
                let value: f64 = (0..3).map(|axis| along[axis] * own.rows.at(axis, column)).sum();
                row.push(sign * value);
            }
            places.extend(own.places);
        }
        let inner = self.part(&places, &places);
        Some(dot(&row, &inner.apply(&row)).max(0.0).sqrt())
    }
}
