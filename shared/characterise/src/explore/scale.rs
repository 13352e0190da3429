//! From groups of frames to a sequence with lengths on the projector.
//!
//! Frames show ratios only: stripes per period from the mean change of both per camera pixel, and the longer period over the
//! shorter. What one of them measures on the projector follows from its size, if a code or a longest period covers it.

use super::codes::Coded;
use super::sines::{Stepped, mean_angle, unit};
use super::{FoundSet, Group, Samples, axis_doubt};
use fringe::pattern::{Axis, Direction, PatternSet};
use nalgebra::Complex;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Projector that is supposed where none is given, px.
const SUPPOSED_PX: [u32; 2] = [1920, 1080];

/// The coarsest of several sets is taken to show one period on the whole projector where it is longer than the finest by this.
const ONE_PERIOD: f64 = 6.0;

/// A set whose phase changes by less than this over the whole picture is taken for one period on the whole projector, rad.
const ONE_PICTURE_RAD: f64 = 1.5 * TAU;

/// Stripes of both axes are drawn alike where they seem so within this factor: an oblique view scales them unequally.
const ALIKE: f64 = 1.25;

/// Period that is supposed where nothing tells one, projector pixels.
const SUPPOSED_PERIOD_PX: f64 = 20.0;

/// An origin this near to a quarter of a period is that quarter, rad.
const QUARTER_RAD: f64 = 0.35;

/// Mean changes of two phases give their ratio within this factor: noise, gamma and a slanting object move it.
const RATIO: f64 = 1.3;

/// Most periods on a projector.
const MOST_PERIODS: f64 = 4096.0;

/// Least concentration of the phases at the edges of the code, 0 … 1.
const LEAST_CONCENTRATION: f64 = 0.5;

/// The sets with lengths, and the projector they suppose.
pub(super) fn sequence(
    samples: &Samples,
    groups: &[Group],
    projector_px: Option<[u32; 2]>,
) -> (Vec<FoundSet>, [u32; 2]) {
    let supposed = if projector_px.is_some() { "" } else { ", and the projector's size is not known" };
    let size_px = projector_px.unwrap_or(SUPPOSED_PX);
    let size = |axis: usize| (f64::from(samples.picture_px[axis]), f64::from(size_px[axis]));
    let x = Scale::new(Axis::X, groups, size(0), supposed);
    let y = Scale::new(Axis::Y, groups, size(1), supposed);
    let (x, y) = if size_px[0] >= size_px[1] {
        let y = y.square(&x);
        (x, y)
    } else {
        (x.square(&y), y)
    };
    let of = |axis: Axis| if axis == Axis::X { &x } else { &y };
    let constant =
        |set, frame, doubts| FoundSet { set, frames: vec![frame], residual: None, camera_px: None, doubts };
    // A frame that is all bright before a code may be its first bit, unless white and black are there already.
    let both = groups.iter().any(|g| matches!(g, Group::White(_)))
        && groups.iter().any(|g| matches!(g, Group::Black(_)));
    let first_bit = |frame: usize, at: usize, groups: &[Group]| {
        let next =
            groups.get(at + 1).is_some_and(|g| matches!(g, Group::Coded(c) if c.frames[0] == frame + 1));
        if next && !both {
            vec![
                "could be the first bit of the code, if all of the object lies in one half of the projector"
                    .to_owned(),
            ]
        } else {
            Vec::new()
        }
    };
    let sets = groups.iter().enumerate().map(|(at, group)| match group {
        Group::White(frame) => constant(PatternSet::White {}, *frame, first_bit(*frame, at, groups)),
        Group::Black(frame) => constant(PatternSet::Black {}, *frame, first_bit(*frame, at, groups)),
        Group::Coded(code) => of(code.axis).coded(code),
        Group::Stepped(set) => of(set.axis).stepped(set, samples),
    });
    (sets.collect(), size_px)
}

/// What lengths of one axis rest on.
struct Scale<'a> {
    /// Projector pixels per stripe of the first code of the axis.
    stripe_px: f64,
    /// The first code of the axis.
    code: Option<&'a Coded>,
    /// A set that shows one period on the whole projector.
    longest: Option<&'a Stepped>,
    /// Projector pixels that one camera pixel sees, mean over the pixels.
    projector_per_camera: f64,
    /// Size of the projector along the axis, px.
    extent_px: f64,
    /// What is uncertain of all lengths.
    doubt: String,
}

impl<'a> Scale<'a> {
    /// `picture_px` and `extent_px` are the sizes of the camera's picture and of the projector along the axis.
    fn new(axis: Axis, groups: &'a [Group], (picture_px, extent_px): (f64, f64), supposed: &str) -> Self {
        if let Some(code) = first_code(groups, axis) {
            let bits = code.frames.len();
            let stripe_px = (extent_px / f64::from(1_u32 << bits)).ceil().max(1.0);
            let doubt =
                format!("lengths suppose that the code's {bits} bits just cover the projector{supposed}");
            return Self {
                stripe_px,
                code: Some(code),
                longest: None,
                projector_per_camera: 0.0,
                extent_px,
                doubt,
            }
            .adjusted();
        }
        let mut sets: Vec<&Stepped> = groups
            .iter()
            .filter_map(|group| match group {
                Group::Stepped(set) if set.axis == axis => Some(set),
                _ => None,
            })
            .collect();
        sets.sort_by(|a, b| a.per_px_rad.abs().total_cmp(&b.per_px_rad.abs()));
        let rate = |set: Option<&&Stepped>| set.map_or(0.0, |set| set.per_px_rad.abs());
        let (least, most) = (rate(sets.first()), rate(sets.last()));
        let one = most > ONE_PERIOD * least || least * picture_px < ONE_PICTURE_RAD;
        let (per_px_rad, period_px, doubt) = if one {
            let doubt =
                format!("lengths suppose that the longest period just covers the projector{supposed}");
            (least, extent_px, doubt)
        } else {
            (
                most,
                SUPPOSED_PERIOD_PX,
                "only ratios of the periods are known: give the finest its length".to_owned(),
            )
        };
        let projector_per_camera = period_px * per_px_rad / TAU;
        let longest = sets.first().copied().filter(|_| one);
        Self { stripe_px: 1.0, code: None, longest, projector_per_camera, extent_px, doubt }
    }

    /// What a camera pixel sees, after the length of a stripe was set.
    fn adjusted(mut self) -> Self {
        if let Some(code) = self.code {
            self.projector_per_camera = code.per_px.abs() * self.stripe_px;
        }
        self
    }

    /// Projector pixels are square: the stripes of the shorter side follow from those of the longer one.
    fn square(mut self, longer: &Self) -> Self {
        if let (Some(code), Some(of_longer)) = (self.code, longer.code)
            && code.per_px != 0.0
        {
            let ratio = of_longer.per_px.abs() / code.per_px.abs();
            let ratio = if (1.0 / ALIKE..ALIKE).contains(&ratio) { 1.0 } else { ratio };
            self.stripe_px = self.stripe_px.max((longer.stripe_px * ratio).round());
        }
        self.adjusted()
    }

    fn coded(&self, code: &Coded) -> FoundSet {
        let set = PatternSet::Gray {
            axis: code.axis,
            bits: code.frames.len() as u32,
            stripe_px: self.stripe_px,
            shift_px: 0.0,
            invert: code.inverse,
            code: code.code,
            threshold: None,
        };
        let camera_px = (code.per_px != 0.0).then(|| 1.0 / code.per_px.abs());
        let doubts = std::iter::once(self.doubt.clone()).chain(axis_doubt(code.clear)).collect();
        FoundSet { set, frames: code.frames.clone(), residual: None, camera_px, doubts }
    }

    fn stepped(&self, set: &Stepped, samples: &Samples) -> FoundSet {
        let mut doubts: Vec<String> =
            std::iter::once(self.doubt.clone()).chain(axis_doubt(set.clear)).collect();
        let mut period_px = self.projector_per_camera * TAU / set.per_px_rad.abs();
        let (mut rising, mut first_step_rad) = (set.per_px_rad >= 0.0, 0.0);
        if let Some(code) = self.code {
            // Edges of a code are drawn at whole numbers of stripes, and periods are multiples of half a stripe.
            period_px = (2.0 * period_px / self.stripe_px).round().max(1.0) / 2.0 * self.stripe_px;
            rising = rising == (code.per_px >= 0.0);
            match origin(set, code, period_px / self.stripe_px, rising, samples) {
                Some(origin_rad) => first_step_rad = origin_rad,
                None => {
                    doubts
                        .push("first_step_rad: the phases at the edges of the code do not agree".to_owned());
                }
            }
        } else {
            doubts.push(
                "direction: without a code it supposes that the phase grows to the right and downwards"
                    .to_owned(),
            );
            period_px = match self.longest.and_then(|longest| whole_ratio(set, longest)) {
                Some(periods) => self.extent_px / periods,
                None => (period_px * 100.0).round() / 100.0,
            };
        }
        let direction = if rising { Direction::Forward } else { Direction::Backward };
        let set_of = PatternSet::Sine {
            axis: set.axis,
            period_px: period_px.max(2.0),
            steps: set.steps as u32,
            first_step_rad,
            direction,
            shifts_rad: Vec::new(),
        };
        if set.steps == 3 {
            doubts.push("steps: three frames leave no residual to test their steps by".to_owned());
        }
        let frames = (set.first..set.first + set.steps).collect();
        let camera_px = (set.per_px_rad != 0.0).then(|| TAU / set.per_px_rad.abs());
        FoundSet { set: set_of, frames, residual: set.residual, camera_px, doubts }
    }
}

/// The first code of an axis that is no complement.
fn first_code(groups: &[Group], axis: Axis) -> Option<&Coded> {
    groups.iter().find_map(|group| match group {
        Group::Coded(code) if code.axis == axis && !code.inverse => Some(code),
        _ => None,
    })
}

/// Whole number of periods on the length of one of another set, where the phases agree with one.
fn whole_ratio(set: &Stepped, longest: &Stepped) -> Option<f64> {
    let about = (set.per_px_rad / longest.per_px_rad).abs();
    let sign = (set.per_px_rad * longest.per_px_rad).signum();
    let concentration = |ratio: f64| {
        let pairs = set.phases_rad[0].iter().zip(&longest.phases_rad[0]);
        let sum: Complex<f64> = pairs.map(|(fine, long)| unit(fine - sign * ratio * long)).sum();
        sum.norm() / set.phases_rad[0].len() as f64
    };
    let (low, high) = ((about / RATIO).floor().max(1.0), (about * RATIO).ceil().min(MOST_PERIODS));
    let whole = (low as i32..=high as i32).map(f64::from);
    let best = whole.max_by(|a, b| concentration(*a).total_cmp(&concentration(*b)))?;
    (concentration(best) > LEAST_CONCENTRATION).then_some(best)
}

/// Phase step of the first frame, rad, from the phases where the stripes of a code meet; there the coordinate is known.
fn origin(
    set: &Stepped,
    code: &Coded,
    stripes_per_period: f64,
    rising: bool,
    samples: &Samples,
) -> Option<f64> {
    let sign = if rising { 1.0 } else { -1.0 };
    let edges = (0..samples.len()).filter(|p| (code.stripes[1][*p] - code.stripes[0][*p]).abs() == 1);
    // Between the two pixels lies the edge: the mean direction of both phases.
    let offsets: Vec<f64> = edges
        .map(|pixel| {
            let stripe = f64::from(code.stripes[0][pixel].max(code.stripes[1][pixel]));
            let [here, there] = [0, 1].map(|place: usize| set.phases_rad[place][pixel]);
            sign * (TAU * stripe / stripes_per_period) - mean_angle([here, there].into_iter())
        })
        .collect();
    if offsets.is_empty() {
        return None;
    }
    let mean: Complex<f64> = offsets.iter().map(|o| unit(*o)).sum::<Complex<f64>>() / offsets.len() as f64;
    if mean.norm() < LEAST_CONCENTRATION {
        return None;
    }
    let shift = mean_angle(offsets.into_iter());
    let quarter = (shift / FRAC_PI_2).round() * FRAC_PI_2;
    let near = if (shift - quarter).abs() < QUARTER_RAD { quarter } else { (shift * 100.0).round() / 100.0 };
    Some(near.rem_euclid(TAU))
}
