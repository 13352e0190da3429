//! The parameters of both views of a pair, and how an epipolar residual answers to them.

use super::HealthError;
use crate::calibration::{PARAMETERS, StereoGeometry, moved};
use fringe::geometry::camera::Camera;
use nalgebra::{Point2, Vector2};

/// Parameters of a view.
pub(super) const COUNT: usize = PARAMETERS.len();

/// Covariance of the parameters of both views of a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct PairCovariance {
    /// Names of the parameters of the left view, then of the right one, as in [`PARAMETERS`]; any subset in any order.
    pub names: [Vec<String>; 2],
    /// Square, row by row, in the order of the names.
    pub matrix: Vec<f64>,
}

impl PairCovariance {
    /// Places of the parameters among those of the left view, then of the right one.
    pub(super) fn places(&self) -> Result<Vec<usize>, HealthError> {
        let mut places = Vec::new();
        for (side, names) in self.names.iter().enumerate() {
            for name in names {
                let place = PARAMETERS.iter().position(|known| known == name);
                places.push(side * COUNT + place.ok_or_else(|| HealthError::Parameter(name.clone()))?);
            }
        }
        let (found, needed) = (self.matrix.len(), places.len() * places.len());
        if found == needed { Ok(places) } else { Err(HealthError::Covariance { found, needed }) }
    }
}

/// Step for the numeric derivative: small against what bends the residual, large against rounding.
pub(super) fn step(name: &str) -> f64 {
    match name.rsplit('_').next() {
        Some("px") => 0.1,
        Some("rad") => 1e-5,
        Some("mm") => 1e-2,
        _ => 1e-4,
    }
}

/// How far a pixel is moved for the residual's slope, px.
const PIXEL_STEP: f64 = 0.05;

/// A residual and how it answers.
pub(super) struct Answer {
    /// Seen less modelled, px.
    pub error_px: f64,
    /// By the right pixel.
    pub slope: [f64; 2],
    /// By the parameters of the *rig file*, left view before right. Where the true parameter is larger than the file's by δ,
    /// the residual is −δ times this.
    pub by: [f64; 2 * COUNT],
}

/// The epipolar residual of a pair with its derivatives.
pub(super) struct Sensitivity {
    middle: StereoGeometry,
    /// One for each parameter of the left view, then of the right one.
    sides: Vec<Sides>,
}

/// The pair with a parameter of one view lower and higher.
struct Sides {
    low: StereoGeometry,
    high: StereoGeometry,
    /// The higher value less the lower one.
    width: f64,
}

impl Sensitivity {
    /// For two checked cameras.
    pub fn new(left: &Camera, right: &Camera) -> Self {
        let geometry = |place: usize, by: f64| {
            let mut steps = [0.0; COUNT];
            steps[place % COUNT] = by;
            if place < COUNT {
                StereoGeometry::new(&moved(left, &steps), right)
            } else {
                StereoGeometry::new(left, &moved(right, &steps))
            }
        };
        let side = |place: usize| {
            let step = step(PARAMETERS[place % COUNT]);
            Sides { low: geometry(place, -step), high: geometry(place, step), width: 2.0 * step }
        };
        Self { middle: StereoGeometry::new(left, right), sides: (0..2 * COUNT).map(side).collect() }
    }

    /// Direction of the baseline in the frame of the right view.
    pub fn baseline(&self) -> nalgebra::Vector3<f64> {
        self.middle.right_from_left.translation.vector
    }

    /// `None` where a lens model folds over.
    pub fn at(&self, left: Point2<f64>, right: Point2<f64>) -> Option<Answer> {
        let ideal = self.middle.ideal(left, right)?;
        let [l, r] = [ideal[0].at, ideal[1].at];
        let error_px = self.middle.ideal_error_px(l, r)?;
        let mut slope = [0.0; 2];
        for (axis, slope) in slope.iter_mut().enumerate() {
            let beside = ideal[1].by_pixel.column(axis) * PIXEL_STEP;
            let error = |ideal: Vector2<f64>| self.middle.ideal_error_px(l, ideal);
            *slope = (error(r + beside)? - error(r - beside)?) / (2.0 * PIXEL_STEP);
        }
        let mut by = [0.0; 2 * COUNT];
        for (place, (by, sides)) in by.iter_mut().zip(&self.sides).enumerate() {
            // Another lens shows another ideal point at this pixel. To invert it for each parameter took most of the time.
            let beside = ideal[place / COUNT].by[place % COUNT] * (0.5 * sides.width);
            let (of_left, of_right) =
                if place < COUNT { (beside, Vector2::zeros()) } else { (Vector2::zeros(), beside) };
            let (low, high) = (
                sides.low.ideal_error_px(l - of_left, r - of_right)?,
                sides.high.ideal_error_px(l + of_left, r + of_right)?,
            );
            *by = (high - low) / sides.width;
        }
        Some(Answer { error_px, slope, by })
    }
}
