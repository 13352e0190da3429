//! A known length between two points of the target, as a pair of devices measures it in each pose.
//!
//! The scale of a rig is that of its target's pitch, and no residual can detect when it is wrong: only another length can.
//! Over the poses the same length is at many places and in many directions, so its scatter shows what a length measured
//! there is worth.

use super::result::{Calibration, ViewReport};
use fringe::geometry::triangulate::triangulate;
use nalgebra::{Point2, Point3, Vector3};

/// A length in one pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredLength {
    /// Distance of the two triangulated points, mm.
    pub length_mm: f64,
    /// Its predicted standard uncertainty, mm: calibration (all correlations) and noise of the pixels, without that of the
    /// target's pitch.
    pub u_mm: f64,
    /// The points, mm in the world frame.
    pub ends_mm: [Point3<f64>; 2],
}

impl Calibration {
    /// Triangulates both points from the pixels seen by both devices of one pose; `None` where one of the four was not seen
    /// or was rejected, or where the rays do not cross.
    ///
    /// `views` belong to the devices of `pair`; they may come from poses that this calibration did not use.
    pub fn measured_length(
        &self,
        pair: [usize; 2],
        views: [&ViewReport; 2],
        points: [usize; 2],
    ) -> Option<MeasuredLength> {
        let [left, right] = [self.devices.get(pair[0])?, self.devices.get(pair[1])?];
        let place = |point: usize| {
            let (a, b) = (pixel(views[0], point)?, pixel(views[1], point)?);
            Some(triangulate((&left.camera, a), (&right.camera, b))?.position_mm)
        };
        let ends_mm = [place(points[0])?, place(points[1])?];
        let between = ends_mm[1] - ends_mm[0];
        let along: Vector3<f64> = between.try_normalize(1e-9)?;
        // A distance has two coordinates. The noise is that of the two pictures: steep and dark ones have more than a device has in the mean.
        let noise_px = views.map(|view| view.rms_px * std::f64::consts::FRAC_1_SQRT_2);
        let mut variance = self.distance_u_mm([(&pair, &ends_mm[0]), (&pair, &ends_mm[1])])?.powi(2);
        for end in &ends_mm {
            variance += along.dot(&(self.point_uncertainty(pair, end, noise_px)?.noise_mm2 * along));
        }
        Some(MeasuredLength { length_mm: between.norm(), u_mm: variance.sqrt(), ends_mm })
    }
}

fn pixel(view: &ViewReport, point: usize) -> Option<Point2<f64>> {
    view.residuals.iter().find(|r| r.used && r.index == point).map(|r| r.pixel)
}
