//! Frames of a sine set that do not show what the others show: light that changes between frames, a frame that stayed black, that is blurred, or
//! in which part or pattern moved.
//!
//! Whatever the light does, the grey values of a pixel over N frames are A F₁ + C F₂ + S F₃ with three columns F that all pixels share: 1, cos δ,
//! sin δ when all is well. The three columns are found from the pixels themselves (`subspace`), as near to the nominal ones as they
//! span: level, contrast and step of each frame stand in its row. A frame that fits no row leaves more than the others.
//!
//! What a cos δ or sin δ in the level does cannot be seen in one pixel: it looks like a fringe. But it is one that stands still while the phase runs
//! on: the modulation then varies once with the phase. Where there are too few fringes to see that, it is left alone.
//!
//! A changing light is normalised: the columns found replace the nominal ones, without a word where it changes by little (`slight`); so are the steps where the fringes moved (`moved_steps`). A bad frame is left out where three remain; with more than one in
//! eight the frames do not follow the sequence, and nothing is changed. Of three or four frames a pixel alone does not tell which one is bad;
//! there whole fringes tell it (`moments`).

pub mod code;
mod columns;
pub mod finding;
mod moments;
mod moved_steps;
mod rows;
mod samples;
mod slight;
mod steadied;
mod subspace;

use super::between_steps::between_steps;
use super::motion::StepMotion;
use crate::wrapped::LeastSquares;
use columns::{Column, nominal_columns};
pub use finding::{Fault, Finding, Remedy};
use moved_steps::MovedSteps;
use rows::fit;
pub(super) use samples::{Look, Samples};
pub(super) use steadied::Steadied;

/// One bad frame in so many is left out; one always may be.
const BAD_FRAMES: usize = 8;
/// Fringes that stand off by more, root mean square, lose a thousandth of the contrast of their frames, rad.
const MOST_SHAKEN_RAD: f64 = 0.05;

/// How a set with faults is decoded.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Repair {
    /// The faults, in the order of the frames.
    pub findings: Vec<Finding>,
    /// Weights of all frames; zero for those left out.
    pub fit: LeastSquares,
    /// What takes a slight change of the light out of the frames, which then are as good as others.
    pub steadied: Option<Steadied>,
}

/// How the fringes moved during the set, and what is done about faults in its frames; no repair where there are none, or too many to do without.
pub(super) fn inspect(samples: &Samples) -> (Option<Repair>, Option<StepMotion>) {
    let nothing = |light: &Steadied| (None, between_steps(samples, light));
    let (plan, steps) = (samples.plan(), samples.steps());
    let nominal = nominal_columns(plan);
    let found = |step: Option<usize>, fault| {
        let remedy = match (step, fault) {
            (Some(_), _) => Remedy::LeftOut,
            (None, Fault::Unsteady(_)) => Remedy::StepsAsFound,
            (None, _) => Remedy::Normalised,
        };
        Finding { set: plan.index, step, fault, remedy }
    };
    let without = |findings: Vec<Finding>| {
        let bad =
            |step: usize| findings.iter().any(|found| found.step == Some(step) && !found.is_fatal(steps));
        (fit(&nominal, steps, bad).map(|fit| Repair { findings, fit, steadied: None }), None)
    };
    let of_all = |columns: &[Column; 3], fault| {
        let findings = vec![found(None, fault)];
        fit(columns, steps, |_| false).map(|fit| Repair { findings, fit, steadied: None })
    };
    let unsteady = |moved: &MovedSteps| {
        (of_all(&moved.columns, Fault::Unsteady(moved.deviation_rad)), Some(moved.motion))
    };
    if steps <= moments::MOST_STEPS
        && let Some((step, fault)) = moments::wrong_frame(samples)
    {
        return without(vec![found(step, fault)]);
    }
    let Some(rows) = samples.rows() else { return nothing(&Steadied::NOTHING) };
    if steps > moments::MOST_STEPS {
        let faults = rows.frames().iter().enumerate().filter_map(|(step, row)| Some((step, row.fault()?)));
        let findings: Vec<Finding> = faults.map(|(step, fault)| found(Some(step), fault)).collect();
        if findings.len() > (steps / BAD_FRAMES).max(1) {
            return nothing(&Steadied::NOTHING);
        }
        if !findings.is_empty() {
            let is_left_out = |step: usize| findings.iter().any(|found| found.step == Some(step));
            return match samples.moved_instead(&rows, rows.excess_without(is_left_out)) {
                Some(moved) => unsteady(&moved),
                None => without(findings),
            };
        }
    }
    let Some(light) = samples.changing_light(&rows) else { return nothing(&Steadied::NOTHING) };
    if !light.is_fault {
        let Some(slight) = samples.slight_light(&rows) else { return nothing(&light.steadied) };
        let motion = between_steps(samples, &slight.steadied);
        // A large motion changes the contrast of frames, as if their light did.
        let shakes = motion.is_some_and(|motion| motion.is_beyond(MOST_SHAKEN_RAD));
        let repair = fit(&slight.columns, steps, |_| false).filter(|_| !shakes).map(|fit| Repair {
            findings: Vec::new(),
            fit,
            steadied: Some(slight.steadied),
        });
        return (repair, motion);
    }
    if let Some(moved) = samples.moved_instead(&rows, rows.excess(&light.columns)) {
        return unsteady(&moved);
    }
    (of_all(&light.columns, Fault::Flicker(light.deviation)), between_steps(samples, &light.steadied))
}
