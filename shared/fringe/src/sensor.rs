//! What is known of a camera beside its geometry: what a pixel averages, and how its grey values scatter.
//!
//! Both are constants of the camera with its lens, aperture and gain. A calibration finds them once; a recording tests them.

use serde::{Deserialize, Serialize};

/// Noise of a camera: the variance of a grey value is read² + gain · value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraNoise {
    /// Standard deviation in the dark, quantisation included, DN.
    pub read_noise_dn: f64,
    /// DN per photo-electron: variance of the shot noise per DN of signal.
    pub gain_dn: f64,
}

impl CameraNoise {
    /// Variance of a grey value, DN².
    pub fn variance_dn2(&self, value_dn: f64) -> f64 {
        self.read_noise_dn * self.read_noise_dn + self.gain_dn * value_dn
    }
}

/// What a pixel averages: its area and the point spread together, along columns and rows of the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Standard deviations along x and y, px.
    pub sigma_px: [f64; 2],
    /// Their standard uncertainties, where they are known, px.
    pub u_px: Option<[f64; 2]>,
    /// Growth of both variances from the middle of the picture to its corner, with the square of the distance, px²; `sigma_px` is that of
    /// the mean over the picture.
    pub field_px2: f64,
}

/// Mean over a picture of the squared distance from its middle over that of its corner, whatever its sides.
pub const MEAN_FIELD: f64 = 1.0 / 3.0;

/// What is known of a lens in focus before any frame is asked: variance of its footprint (the area of a pixel and 0.2 to 0.5 px), px².
pub(crate) const USUAL_LENS_PX2: f64 = 0.2;

/// Its standard uncertainty, px². The frames outweigh it where they show slopes and little noise; it holds the estimate
/// where light between surfaces, which steep places get more of, bends the line.
pub(crate) const USUAL_LENS_U_PX2: f64 = 0.12;

/// Standard uncertainty of a footprint that comes without one, px: what a lens differs by over its field and depth.
const USUAL_U_PX: f64 = 0.02;

impl Footprint {
    /// Variance as the mean of both directions, px², and its standard uncertainty.
    pub fn variance_px2(&self) -> (f64, f64) {
        let [x, y] = self.sigma_px;
        let [ux, uy] = self.u_px.unwrap_or([USUAL_U_PX; 2]);
        // What both directions share (the shape of the edges, the field) does not average out between them.
        (0.5 * (x * x + y * y), x * ux + y * uy)
    }

    /// Variance that the decoder takes off the phases of a camera, mean over the picture, px²: that of its footprint, or of a usual lens where it is not
    /// known.
    pub(crate) fn taken_px2(footprint: Option<Self>) -> f64 {
        footprint.map_or(USUAL_LENS_PX2, |footprint| footprint.variance_px2().0)
    }

    /// Variances along x and y at a place of the picture, px²: `field` is its squared distance from the middle over that of the corner.
    pub fn variances_at_px2(&self, field: f64) -> [f64; 2] {
        self.sigma_px.map(|sigma| sigma * sigma + self.field_px2 * (field - MEAN_FIELD))
    }

    /// Variances along x and y over their mean; [1, 1] where there is no footprint at all.
    pub fn shape(&self) -> [f64; 2] {
        let mean = self.variance_px2().0;
        if mean > 0.0 { self.sigma_px.map(|sigma| sigma * sigma / mean) } else { [1.0; 2] }
    }
}

/// What a calibration found of a camera's sensor and lens.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sensor {
    /// What a pixel averages.
    pub footprint: Option<Footprint>,
    /// How grey values scatter.
    pub noise: Option<CameraNoise>,
    /// Standard uncertainties of read noise and gain, DN, where they are known.
    pub noise_u_dn: Option<[f64; 2]>,
}

impl Sensor {
    /// Standard uncertainty of the variance of the footprint that the decoder takes off, px². Of a camera without one it is that of any lens in
    /// focus; where a recording with white and black finds its own, at most that.
    pub fn footprint_u_px2(&self) -> f64 {
        self.footprint.map_or(USUAL_LENS_U_PX2, |footprint| footprint.variance_px2().1)
    }

    /// What is left of the variance of the footprint where settings state what is taken off, or nothing is, px²; `None` where they state one
    /// of a camera of which nothing is known, so that nothing speaks against it.
    pub fn footprint_left_px2(&self, taken_px: f64) -> Option<f64> {
        let taken_px2 = taken_px * taken_px;
        match self.footprint {
            Some(footprint) => Some(footprint.variance_px2().0 - taken_px2),
            None => (taken_px == 0.0).then_some(USUAL_LENS_PX2),
        }
    }

    /// Whether nothing is known.
    pub fn is_unknown(&self) -> bool {
        self.footprint.is_none() && self.noise.is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_footprint_has_the_variance_of_either_direction() {
        let round = Footprint { sigma_px: [0.5; 2], u_px: Some([0.01; 2]), field_px2: 0.0 };
        let (variance, u) = round.variance_px2();
        assert!((variance - 0.25).abs() < 1e-12);
        // d(σ²) = 2 σ dσ, shared by both directions.
        assert!((u - 2.0 * 0.5 * 0.01).abs() < 1e-12);
        let unknown = Footprint { u_px: None, ..round };
        assert!(unknown.variance_px2().1 > u);
    }

    #[test]
    fn what_is_not_taken_off_is_left() {
        let unknown = Sensor::default();
        assert_eq!([0.0, 0.5].map(|px| unknown.footprint_left_px2(px)), [Some(0.2), None]);
        let footprint = Footprint { sigma_px: [0.5; 2], u_px: Some([0.0; 2]), field_px2: 0.0 };
        let known = Sensor { footprint: Some(footprint), ..Sensor::default() };
        for (taken_px, left_px2) in [(0.0, 0.25), (0.5, 0.0), (0.6, -0.11)] {
            assert!((known.footprint_left_px2(taken_px).unwrap() - left_px2).abs() < 1e-12, "{taken_px}");
        }
    }

    #[test]
    fn the_mean_over_the_picture_is_that_of_the_file() {
        let footprint = Footprint { sigma_px: [0.5, 0.6], u_px: None, field_px2: 0.15 };
        let (columns, rows) = (40, 30);
        let mut sums = [0.0; 2];
        for i in 0..columns * rows {
            let at = |index: i32, count: i32| (f64::from(index) + 0.5) / f64::from(count) - 0.5;
            let (x, y) =
                (f64::from(columns) * at(i % columns, columns), f64::from(rows) * at(i / columns, rows));
            let field = 4.0 * (x * x + y * y) / f64::from(columns * columns + rows * rows);
            let variances = footprint.variances_at_px2(field);
            sums = [0, 1].map(|axis| sums[axis] + variances[axis] / f64::from(columns * rows));
        }
        assert!((sums[0] - 0.25).abs() < 1e-4 && (sums[1] - 0.36).abs() < 1e-4, "{sums:?}");
        let grown = footprint.variances_at_px2(1.0)[0] - footprint.variances_at_px2(0.0)[0];
        assert!((grown - 0.15).abs() < 1e-12);
    }

    #[test]
    fn the_variance_of_a_grey_value_grows_with_the_light() {
        let noise = CameraNoise { read_noise_dn: 2.0, gain_dn: 0.5 };
        assert!((noise.variance_dn2(0.0) - 4.0).abs() < 1e-12);
        assert!((noise.variance_dn2(10.0) - 9.0).abs() < 1e-12);
    }
}
