//! Gauss–Newton on direction and place of the axis: residual = R(a, θ)(x − c) + c − y.

use super::{StageAxis, StageCalibration, StageError, rotation};
use fringe::math;
use nalgebra::{DMatrix, DVector, Matrix3, Point3, Vector3};

/// Steps at most; from a start within some degrees five suffice.
const MOST_STEPS: usize = 50;

/// Ratio of the smallest to the largest pivot below which the axis counts as open.
const LEAST_CONDITION: f64 = 1e-10;

/// A point before and after a turn.
#[derive(Debug, Clone, Copy)]
pub struct Observation {
    /// By which the stage turned, rad.
    pub angle_rad: f64,
    /// Position before the turn, mm.
    pub from: Vector3<f64>,
    /// Position after the turn, mm.
    pub to: Vector3<f64>,
    /// Number of the unknown correction of `from`, where that is a measured place itself.
    pub point: Option<usize>,
}

/// What makes the residuals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freedom {
    /// Each coordinate by itself.
    Places,
    /// Motions: each has six degrees of freedom, however many points it is compared at.
    Motions,
}

/// Two unit vectors across a direction.
fn across(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let least = direction.iamin();
    let first = direction.cross(&Vector3::ith(least, 1.0)).normalize();
    [first, direction.cross(&first)]
}

/// Unknowns: two tilts, two shifts, then three coordinates of the first place where that is unknown.
pub fn adjust(
    observations: &[Observation],
    direction: Vector3<f64>,
    views: usize,
    middle: Vector3<f64>,
    freedom: Freedom,
) -> Result<StageCalibration, StageError> {
    let free = if observations.iter().any(|o| o.point.is_some()) { 7 } else { 4 };
    let mut state =
        State { direction, centre: centre(observations, &direction, &middle)?, shift: Vector3::zeros() };
    let scale = observations.iter().map(|o| (o.from - middle).norm()).fold(1.0, f64::max);
    let mut last = f64::INFINITY;
    for _ in 0..MOST_STEPS {
        let (normal, right, squares) = state.equations(observations, free, scale);
        let step = solve(&normal, &right)?;
        let before = state;
        state.step(&step, scale);
        let (_, _, after) = state.equations(observations, free, scale);
        if after >= squares {
            state = before;
        }
        if after >= last.min(squares) * (1.0 - 1e-12) {
            break;
        }
        last = after;
    }
    state.conclude(observations, free, scale, views, &middle, freedom)
}

/// The place of the axis when its direction is known: Σ (I − R)ᵀ (I − R) c = Σ (I − R)ᵀ (y − R x), its foot fixed at the middle.
fn centre(
    observations: &[Observation],
    direction: &Vector3<f64>,
    middle: &Vector3<f64>,
) -> Result<Vector3<f64>, StageError> {
    let along = direction * direction.transpose();
    let (mut normal, mut right) = (along, along * middle);
    let mut seen = 0.0;
    for o in observations {
        let turned = rotation(direction, o.angle_rad);
        let lever = Matrix3::identity() - turned;
        normal += lever.transpose() * lever;
        right += lever.transpose() * (o.to - turned * o.from);
        seen += lever.norm_squared();
    }
    // Turns by a tenth of a degree altogether move a point by less than any scanner sees.
    if seen < 1e-5 {
        return Err(StageError::Open { why: "all views have the same angle" });
    }
    normal
        .cholesky()
        .map(|c| c.solve(&right))
        .ok_or(StageError::Open { why: "all views have the same angle" })
}

#[derive(Debug, Clone, Copy)]
struct State {
    direction: Vector3<f64>,
    centre: Vector3<f64>,
    /// Correction of the first place.
    shift: Vector3<f64>,
}

impl State {
    /// Normal equations, right side and sum of squares. Tilts count in units of `scale`, so that all unknowns are lengths.
    fn equations(
        &self,
        observations: &[Observation],
        free: usize,
        scale: f64,
    ) -> (DMatrix<f64>, DVector<f64>, f64) {
        let (mut normal, mut right, mut squares) = (DMatrix::zeros(free, free), DVector::zeros(free), 0.0);
        let [e, f] = across(&self.direction);
        let mut row = |jacobian: &DMatrix<f64>, residual: &Vector3<f64>| {
            normal += jacobian.transpose() * jacobian;
            right -= jacobian.transpose() * residual;
            squares += residual.norm_squared();
        };
        for o in observations {
            let start = if o.point.is_some() { o.from + self.shift } else { o.from };
            let turned = rotation(&self.direction, o.angle_rad);
            let arm = start - self.centre;
            let residual = turned * arm + self.centre - o.to;
            let mut jacobian = DMatrix::zeros(3, free);
            for (column, tilt) in [e, f].iter().enumerate() {
                jacobian.set_column(column, &(self.by_direction(&arm, tilt, o.angle_rad) / scale));
                jacobian.set_column(2 + column, &(tilt - turned * tilt));
            }
            if free > 4 {
                jacobian.view_mut((0, 4), (3, 3)).copy_from(&turned);
            }
            row(&jacobian, &residual);
        }
        if free > 4 {
            // The first place was measured, too.
            let mut jacobian = DMatrix::zeros(3, free);
            jacobian.view_mut((0, 4), (3, 3)).copy_from(&Matrix3::identity());
            row(&jacobian, &self.shift);
        }
        (normal, right, squares)
    }

    /// d/da of R(a, θ) v = v cos θ + (a × v) sin θ + a (a·v)(1 − cos θ) along a tilt.
    fn by_direction(&self, arm: &Vector3<f64>, tilt: &Vector3<f64>, angle_rad: f64) -> Vector3<f64> {
        let (sine, cosine) = math::sincos(angle_rad);
        let a = &self.direction;
        tilt.cross(arm) * sine + (tilt * a.dot(arm) + a * tilt.dot(arm)) * (1.0 - cosine)
    }

    fn step(&mut self, step: &DVector<f64>, scale: f64) {
        let [e, f] = across(&self.direction);
        self.centre += e * step[2] + f * step[3];
        self.direction = (self.direction + (e * step[0] + f * step[1]) / scale).normalize();
        if step.len() > 4 {
            self.shift += Vector3::new(step[4], step[5], step[6]);
        }
    }

    fn conclude(
        &self,
        observations: &[Observation],
        free: usize,
        scale: f64,
        views: usize,
        middle: &Vector3<f64>,
        freedom: Freedom,
    ) -> Result<StageCalibration, StageError> {
        let (normal, right, squares) = self.equations(observations, free, scale);
        // As for the equations, so that an open axis is not reported as a good one.
        solve(&normal, &right)?;
        let covariance = normal.cholesky().map(|c| c.inverse()).ok_or(OPEN)?;
        let equations = 3 * (observations.len() + usize::from(free > 4));
        let independent = match freedom {
            Freedom::Places => equations,
            Freedom::Motions => 6 * (views - 1),
        };
        let variance = squares / independent.saturating_sub(free).max(1) as f64;
        let worst = |a: usize| {
            let block = covariance.fixed_view::<2, 2>(a, a);
            let (trace, determinant) = (block.trace(), block.determinant());
            (variance * 0.5 * (trace + (trace * trace - 4.0 * determinant).max(0.0).sqrt())).max(0.0).sqrt()
        };
        let axis = StageAxis { point_mm: Point3::from(self.centre), direction: self.direction };
        let foot = axis.foot(middle);
        let arms = observations.iter().map(|o| (o.from - axis.foot(&o.from)).norm());
        Ok(StageCalibration {
            point_mm: foot.into(),
            direction: self.direction.into(),
            u_point_mm: worst(2),
            u_direction_rad: worst(0) / scale,
            rms_mm: (squares / equations as f64).sqrt(),
            views,
            arm_mm: arms.fold(0.0, f64::max),
        })
    }
}

const OPEN: StageError = StageError::Open { why: "their equations are singular" };

fn solve(normal: &DMatrix<f64>, right: &DVector<f64>) -> Result<DVector<f64>, StageError> {
    let decomposed = normal.clone().cholesky().ok_or(OPEN)?;
    let pivots = decomposed.l_dirty().diagonal();
    if pivots.min() < LEAST_CONDITION.sqrt() * pivots.max() {
        return Err(OPEN);
    }
    Ok(decomposed.solve(right))
}
