//! The adjustment: Gauss–Newton with Levenberg–Marquardt as its safety net.

use fearless_simd::{Level, dispatch};
use nalgebra::{SVector, Vector3};

use super::FitError;
use super::centred::{extent_mm, tree};
use super::normal::{LANES, Lanes, Normal};

/// Most iterations. Good starts need five to ten; a cap of a few degrees some thirty.
const MAX_ITERATIONS: usize = 200;

/// Damping after the first step that made things worse, relative to the unit diagonal.
const FIRST_DAMPING: f64 = 1e-3;

/// A step that moves the surface by less than this part of the extent is in the terminal phase: the sum of squares no
/// longer distinguishes better from worse (its relative resolution is 1e-16), the step itself does.
const TERMINAL: f64 = 1e-9;

/// Steps that no longer shrink by this factor are rounding. Surfaces shrink theirs a hundredfold each time, models that
/// fit badly by a third.
const SETTLED: f64 = 0.9;

/// Largest last step, and largest one that would follow it, as parts of the uncertainty of a mean of all points: the points are not
/// looked at again.
const RESOLVED: [f64; 2] = [1e-3, 1e-9];

/// The step that follows the first one is taken to be this part of it: nothing shows yet how fast steps shrink.
const SECOND_STEP: f64 = 1e-3;

/// In the terminal phase too is a step below this part of the residuals: it lowers the sum of squares by less than 1e-14 of itself. Surfaces
/// never get here, their residuals are small against their extent; a model that fits badly does.
const TERMINAL_RESIDUAL: f64 = 1e-7;

/// A sum of squares that grows by less than this part of itself has not grown: that is its rounding. Without it a step just above
/// the terminal phase would pass for a bad one, and be damped for ever.
const SUM_ROUNDING: f64 = 1e-14;

/// How far an adjustment goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Until {
    /// To the minimum, as far as numbers tell it.
    Settled,
    /// Until a step moves the surface by no more than [`NEAR_RESIDUAL`] of the residuals: enough to say which of them are the largest.
    Near,
}

/// Largest last step of an adjustment that ends near the minimum, as a part of the residuals.
const NEAR_RESIDUAL: f64 = 1e-3;

/// A surface or curve with P free parameters, given in a chart about its present state.
pub(super) trait Model<const P: usize>: Clone + Sync {
    /// Residuals of a point.
    const ROWS: usize = 1;
    /// Signed distance of a point, mm.
    fn deviation(&self, point: &Vector3<f64>) -> f64;
    /// Residuals of a point with their derivatives by the chart's parameters; their squares are what is minimised. To be inlined: what is
    /// not, is compiled for the plainest processor.
    fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, P>));
    /// The model after a step in the chart.
    fn moved(&self, step: &SVector<f64, P>) -> Self;
}

/// Normal equations of a model.
pub(super) fn normal<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>]) -> Normal<P> {
    let level = Level::new();
    tree(points, &|leaf| sums_with(level, model, leaf), &|a: Normal<P>, b: Normal<P>| a.join(&b))
}

/// As [`leaf_sums`] with given instructions, which change no bit.
fn sums_with<M: Model<P>, const P: usize>(level: Level, model: &M, leaf: &[Vector3<f64>]) -> Normal<P> {
    dispatch!(level, _simd => leaf_sums(model, leaf))
}

/// Normal equations of few points; those of models with one residual a point in lanes.
#[inline(always)]
fn leaf_sums<M: Model<P>, const P: usize>(model: &M, leaf: &[Vector3<f64>]) -> Normal<P> {
    let (groups, rest) = if M::ROWS == 1 { leaf.as_chunks::<LANES>() } else { (&[][..], leaf) };
    let mut lanes = Lanes::zero();
    for group in groups {
        let mut residuals = [0.0; LANES];
        let mut derivatives = [[0.0; LANES]; P];
        for (lane, point) in group.iter().enumerate() {
            model.rows(point, &mut |residual, row| {
                residuals[lane] = residual;
                for (all, derivative) in derivatives.iter_mut().zip(row) {
                    all[lane] = *derivative;
                }
            });
        }
        lanes.add(&residuals, &derivatives);
    }
    let mut sums = lanes.joined();
    for point in rest {
        model.rows(point, &mut |residual, derivatives| sums.add(residual, derivatives));
    }
    sums
}

/// Where the adjustment ended.
pub(super) struct Adjusted<M, const P: usize> {
    /// The model at the minimum.
    pub model: M,
    /// Normal equations of the model there, or before a last step that hardly changes them.
    pub normal: Normal<P>,
}

/// Minimises the sum of squares from a start.
///
/// # Errors
/// Singular normal equations at the end, or no convergence.
pub(super) fn adjust<M: Model<P>, const P: usize>(
    element: &'static str,
    start: M,
    points: &[Vector3<f64>],
    until: Until,
) -> Result<Adjusted<M, P>, FitError> {
    let extent_mm = extent_mm(points.iter(), &Vector3::zeros());
    let mut state = Adjusted { normal: normal(&start, points), model: start };
    let mut damping = 0.0;
    let mut last_mm = f64::INFINITY;
    for _ in 0..MAX_ITERATIONS {
        let Some(step) = state.normal.step(damping) else {
            damping = raise(damping);
            if damping > 1e6 {
                return Err(singular(element));
            }
            continue;
        };
        let model = state.model.moved(&step);
        let moved_mm = surface_step(&state.normal, &step);
        let residual_mm = (state.normal.sum / state.normal.rows.max(1) as f64).sqrt();
        if until == Until::Near && damping == 0.0 && moved_mm <= NEAR_RESIDUAL * residual_mm {
            return Ok(Adjusted { normal: state.normal, model });
        }
        let terminal_mm = (TERMINAL * extent_mm).max(TERMINAL_RESIDUAL * residual_mm);
        let terminal = moved_mm <= terminal_mm && damping == 0.0;
        let u_mean_mm = residual_mm / (state.normal.rows.max(1) as f64).sqrt();
        // The next step is taken to be to this one as this one is to the last.
        let shrinks = if last_mm.is_finite() { moved_mm / last_mm } else { SECOND_STEP };
        let small = RESOLVED.map(|part| part * u_mean_mm);
        if terminal && moved_mm <= small[0] && moved_mm * shrinks <= small[1] {
            return Ok(Adjusted { normal: state.normal, model });
        }
        let next = Adjusted { normal: normal(&model, points), model };
        if terminal {
            let settled = moved_mm <= 1e-16 * extent_mm || moved_mm >= SETTLED * last_mm;
            last_mm = moved_mm;
            state = next;
            if settled {
                return Ok(state);
            }
        } else if next.normal.sum <= state.normal.sum * (1.0 + SUM_ROUNDING) {
            last_mm = moved_mm;
            state = next;
            damping = if damping < 1e-6 { 0.0 } else { damping * 0.1 };
        } else {
            // A sum of squares that is NaN also ends here: the comparison above is then false.
            damping = raise(damping);
        }
        if damping > 1e12 {
            break;
        }
    }
    Err(FitError::NoConvergence { element, iterations: MAX_ITERATIONS })
}

/// The next larger damping.
fn raise(damping: f64) -> f64 {
    if damping == 0.0 { FIRST_DAMPING } else { damping * 10.0 }
}

/// Root mean square motion of the surface under the points by a step, mm.
pub(super) fn surface_step<const P: usize>(normal: &Normal<P>, step: &SVector<f64, P>) -> f64 {
    let matrix = normal.symmetric();
    let square: f64 = (0..P).map(|i| step[i] * (0..P).map(|j| matrix[(i, j)] * step[j]).sum::<f64>()).sum();
    (square.max(0.0) / normal.rows.max(1) as f64).sqrt()
}

/// The error of singular normal equations.
pub(super) fn singular(element: &'static str) -> FitError {
    FitError::Degenerate { element, why: "a direction in which it can move changes no distance" }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use fearless_simd::Simd;

    /// Central differences of the rows beside the derivatives that the model states, at points off its surface.
    pub fn derivatives_agree<M: Model<P>, const P: usize>(model: &M) {
        let h = 1e-6;
        let rows = |m: &M, p: &Vector3<f64>| {
            let mut rows = Vec::new();
            m.rows(p, &mut |residual, derivatives| rows.push((residual, *derivatives)));
            rows
        };
        for point in
            [Vector3::new(3.0, -1.5, 4.0), Vector3::new(-2.0, 5.0, 0.7), Vector3::new(0.4, 0.9, -6.0)]
        {
            let stated = rows(model, &point);
            for k in 0..P {
                let mut step = SVector::<f64, P>::zeros();
                step[k] = h;
                let (ahead, behind) = (rows(&model.moved(&step), &point), rows(&model.moved(&-step), &point));
                for (row, (residual, derivatives)) in stated.iter().enumerate() {
                    let numeric = (ahead[row].0 - behind[row].0) / (2.0 * h);
                    assert!(residual.is_finite());
                    let error = (derivatives[k] - numeric).abs();
                    assert!(error < 1e-7, "parameter {k}, row {row}: {} for {numeric}", derivatives[k]);
                }
            }
        }
    }

    /// A vertical line: each point has two residuals.
    #[derive(Clone)]
    struct Upright(Vector3<f64>);

    impl Model<2> for Upright {
        const ROWS: usize = 2;

        fn deviation(&self, point: &Vector3<f64>) -> f64 {
            (point - self.0).xy().norm()
        }

        fn rows(&self, point: &Vector3<f64>, add: &mut impl FnMut(f64, &SVector<f64, 2>)) {
            add(point.x - self.0.x, &SVector::from([-1.0, 0.0]));
            add(point.y - self.0.y, &SVector::from([0.0, -1.0]));
        }

        fn moved(&self, step: &SVector<f64, 2>) -> Self {
            Self(self.0 + Vector3::new(step[0], step[1], 0.0))
        }
    }

    /// Sums in lanes are those of one row after another, for any number of points, and the same bits with all instructions.
    fn lanes_agree<M: Model<P>, const P: usize>(model: &M, points: &[Vector3<f64>]) {
        let mut single = Normal::<P>::zero();
        for point in points {
            model.rows(point, &mut |residual, derivatives| single.add(residual, derivatives));
        }
        let lanes = leaf_sums(model, points);
        let rounding = 1e-13 * (1.0 + single.sum);
        assert_eq!(lanes.rows, single.rows);
        assert!((lanes.sum - single.sum).abs() <= rounding);
        assert!((lanes.gradient - single.gradient).amax() <= rounding);
        assert!((lanes.symmetric() - single.symmetric()).amax() <= rounding);
        let (best, bits) = (Level::new(), |n: &Normal<P>| (n.symmetric(), n.gradient, n.sum));
        let more = [best.as_sse4_2().map(Simd::level), best.as_avx2().map(Simd::level), Some(best)];
        for level in [Some(Level::baseline())].into_iter().chain(more).flatten() {
            assert_eq!(bits(&sums_with(level, model, points)), bits(&lanes));
        }
    }

    #[test]
    fn lanes_sum_what_single_rows_do() {
        use crate::fit::sphere::FreeSphere;
        let point = |i: usize| Vector3::new((i % 3) as f64 - 1.1, (i % 5) as f64 - 2.3, 0.7 * i as f64 - 4.0);
        let points: Vec<Vector3<f64>> = (0..23).map(point).collect();
        let center = Vector3::new(0.2, -0.3, 0.5);
        for count in 0..points.len() {
            lanes_agree(&FreeSphere { center, radius: 2.0 }, &points[..count]);
            lanes_agree(&Upright(center), &points[..count]);
        }
    }
}
