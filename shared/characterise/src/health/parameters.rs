//! The parameters of both views of a pair, and how an epipolar residual answers to them.

use super::HealthError;
use super::state::POSE;
use crate::calibration::{PARAMETERS, StereoGeometry, moved};
use fringe::geometry::camera::Camera;
use nalgebra::Point2;

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
    moves: Moves,
}

/// Whose pixels without distortion a parameter moves: most of the time goes into finding these.
enum Moves {
    Left,
    Right,
    /// A pose moves none.
    Neither,
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
            let name = PARAMETERS[place % COUNT];
            let step = step(name);
            let moves = match (POSE.contains(&name), place < COUNT) {
                (true, _) => Moves::Neither,
                (false, true) => Moves::Left,
                (false, false) => Moves::Right,
            };
            Sides { low: geometry(place, -step), high: geometry(place, step), width: 2.0 * step, moves }
        };
        Self { middle: StereoGeometry::new(left, right), sides: (0..2 * COUNT).map(side).collect() }
    }

    /// Direction of the baseline in the frame of the right view.
    pub fn baseline(&self) -> nalgebra::Vector3<f64> {
        self.middle.right_from_left.translation.vector
    }

    /// `None` where a lens model folds over.
    pub fn at(&self, left: Point2<f64>, right: Point2<f64>) -> Option<Answer> {
        let straight = (self.middle.straight_left(left)?, self.middle.straight_right(right)?);
        let error_px = self.middle.straight_error_px(&straight.0, &straight.1)?;
        let mut slope = [0.0; 2];
        for (axis, slope) in slope.iter_mut().enumerate() {
            let beside = |by: f64| {
                let mut moved = right;
                moved[axis] += by;
                self.middle.straight_error_px(&straight.0, &self.middle.straight_right(moved)?)
            };
            *slope = (beside(PIXEL_STEP)? - beside(-PIXEL_STEP)?) / (2.0 * PIXEL_STEP);
        }
        let mut by = [0.0; 2 * COUNT];
        for (by, sides) in by.iter_mut().zip(&self.sides) {
            let error = |geometry: &StereoGeometry| match sides.moves {
                Moves::Left => geometry.straight_error_px(&geometry.straight_left(left)?, &straight.1),
                Moves::Right => geometry.straight_error_px(&straight.0, &geometry.straight_right(right)?),
                Moves::Neither => geometry.straight_error_px(&straight.0, &straight.1),
            };
            *by = (error(&sides.high)? - error(&sides.low)?) / sides.width;
        }
        Some(Answer { error_px, slope, by })
    }
}
