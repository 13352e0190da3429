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
//! A changing light is normalised: the columns found replace the nominal ones. A bad frame is left out where three remain; with more than one in
//! eight the frames do not follow the sequence, and nothing is changed. Of three or four frames a pixel alone does not tell which one is bad;
//! there whole fringes tell it (`moments`).

pub mod code;
mod columns;
pub mod finding;
mod moments;
mod rows;
mod samples;
mod subspace;

use crate::wrapped::LeastSquares;
use columns::nominal_columns;
pub use finding::{Fault, Finding, Remedy};
use rows::fit;
pub(super) use samples::{Look, Samples};

/// One bad frame in so many is left out; one always may be.
const BAD_FRAMES: usize = 8;
/// How a set with faults is decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Repair {
    /// The faults, in the order of the frames.
    pub findings: Vec<Finding>,
    /// Weights of all frames; zero for those left out.
    pub fit: LeastSquares,
}

/// Looks for faults in the frames of a complete set; `None` where there are none, or too many to do without.
pub(super) fn inspect(samples: &Samples) -> Option<Repair> {
    let (plan, steps) = (samples.plan(), samples.steps());
    let nominal = nominal_columns(plan);
    let found = |step: Option<usize>, fault| {
        let remedy = if step.is_some() { Remedy::LeftOut } else { Remedy::Normalised };
        Finding { set: plan.index, step, fault, remedy }
    };
    let without = |findings: Vec<Finding>| {
        let bad =
            |step: usize| findings.iter().any(|found| found.step == Some(step) && !found.is_fatal(steps));
        Some(Repair { fit: fit(&nominal, steps, bad)?, findings })
    };
    if steps <= moments::MOST_STEPS
        && let Some((step, fault)) = moments::wrong_frame(samples)
    {
        return without(vec![found(step, fault)]);
    }
    let mut rows = samples.rows()?;
    if steps > moments::MOST_STEPS {
        let faults = rows.frames().iter().enumerate().filter_map(|(step, row)| Some((step, row.fault()?)));
        let findings: Vec<Finding> = faults.map(|(step, fault)| found(Some(step), fault)).collect();
        if findings.len() > (steps / BAD_FRAMES).max(1) {
            return None;
        }
        if !findings.is_empty() {
            return without(findings);
        }
    }
    let fault = Fault::Flicker(samples.changing_light(&mut rows)?);
    Some(Repair { fit: fit(&rows.columns, steps, |_| false)?, findings: vec![found(None, fault)] })
}
