//! Place, direction and sizes of a fitted element in one chart for all kinds, with their covariance.
//!
//! Eight parameters: three shifts of the element's point (mm), a turn vector of its directions about that point (rad),
//! two sizes (mm, or rad for an angle). Motions that an element does not know (along a cylinder's axis, about a
//! plane's normal) have no variance. What is derived from several elements moves each in its chart.

use nalgebra::{SMatrix, SVector, Vector3};

/// Number of parameters of the chart.
pub const CHART: usize = 8;

/// Covariance of an element in the chart: mm², mm·rad, rad².
pub type ChartCovariance = SMatrix<f64, CHART, CHART>;

/// What one parameter of a fit does in the chart.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Effect {
    /// Motion of the element's point, mm per unit of the parameter.
    pub shift: Vector3<f64>,
    /// Turn vector of the directions, rad per unit of the parameter.
    pub turn: Vector3<f64>,
    /// Change of both sizes per unit of the parameter.
    pub sizes: [f64; 2],
}

impl Effect {
    /// A parameter that moves the point.
    pub fn shift(shift: Vector3<f64>) -> Self {
        Self { shift, ..Self::default() }
    }

    /// A parameter that turns the directions.
    pub fn turn(turn: Vector3<f64>) -> Self {
        Self { turn, ..Self::default() }
    }

    /// A parameter that changes the sizes.
    pub fn sizes(sizes: [f64; 2]) -> Self {
        Self { sizes, ..Self::default() }
    }

    fn column(&self) -> SVector<f64, CHART> {
        let ([x, y, z], [a, b, c]): ([f64; 3], [f64; 3]) = (self.shift.into(), self.turn.into());
        SVector::from([x, y, z, a, b, c, self.sizes[0], self.sizes[1]])
    }
}

/// The two tilts of a direction with its tangents (e1, e2, direction right-handed) as turns.
pub(super) fn tilts([e1, e2]: &[Vector3<f64>; 2]) -> [Effect; 2] {
    // The direction moves by e1 where it turns about direction × e1 = e2.
    [Effect::turn(*e2), Effect::turn(-e1)]
}

/// Covariance of a fit's parameters in the chart.
pub(super) fn charted<const P: usize>(
    effects: &[Effect; P],
    covariance: &SMatrix<f64, P, P>,
) -> ChartCovariance {
    let mut by = SMatrix::<f64, CHART, P>::zeros();
    for (index, effect) in effects.iter().enumerate() {
        by.set_column(index, &effect.column());
    }
    by * covariance * by.transpose()
}
