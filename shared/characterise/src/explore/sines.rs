//! Phase-stepped sets: as many frames as possible that one sinusoid a pixel explains.

use super::samples::Samples;
use super::{FrameFigures, axis_of};
use fringe::pattern::Axis;
use nalgebra::Complex;
use std::f64::consts::TAU;

/// Most steps of a set.
const MAX_STEPS: usize = 64;

/// Largest residual over modulation of a set, median over the pixels.
const MAX_RESIDUAL: f64 = 0.25;

/// A number of steps that is wrong by one leaves this much more residual than the right one, and more.
const SAME_RESIDUAL: f64 = 1.3;

/// The tenth of the pixels with the least modulation has at least this part of the usual one. Where frames are bits of a
/// code, a quarter of the pixels is bright, or dark, in three of them, and modulates by nothing.
const LEAST_MODULATION: f64 = 0.5;

/// Phases from bits lie at multiples of 60°: mean of exp(6iφ) above this is a code.
const MAX_CLUSTER: f64 = 0.5;

/// Frames of one set have as many edges, within this share and this part of the largest.
const EDGES: (f64, f64) = (0.04, 0.35);

/// Three frames leave no residual; their phases then change alike from neighbour to neighbour: length of the mean direction.
const LEAST_SMOOTHNESS: f64 = 0.9;

/// Frames of one sinusoid in phase steps.
pub(super) struct Stepped {
    /// Number of its first frame.
    pub first: usize,
    /// Number of its frames.
    pub steps: usize,
    /// Residual over modulation, median over the pixels; none of three steps, which leave no residual.
    pub residual: Option<f64>,
    /// Axis along which the phase changes most in the picture.
    pub axis: Axis,
    /// Whether it changes at least twice as much as along the other one.
    pub clear: bool,
    /// Change of the phase per camera pixel along the axis, rad; its sign is that of the steps.
    pub per_px_rad: f64,
    /// Phase at each pixel and, along the axis, at its neighbour, rad.
    pub phases_rad: [Vec<f64>; 2],
}

/// Finds the sets, first frames first.
pub(super) fn find(samples: &Samples, figures: &[FrameFigures]) -> Vec<Stepped> {
    let mut found = Vec::new();
    let mut first = 0;
    while first + 3 <= samples.frames() {
        match steps_from(samples, figures, first) {
            Some((steps, residual)) => {
                found.push(Stepped::new(samples, first, steps, residual));
                first += steps;
            }
            None => first += 1,
        }
    }
    found
}

/// The number of steps of a set that begins with a frame, and its residual.
fn steps_from(samples: &Samples, figures: &[FrameFigures], first: usize) -> Option<(usize, Option<f64>)> {
    let most = MAX_STEPS.min(samples.frames() - first);
    let fitting: Vec<(usize, f64)> = (3..=most)
        .filter(|steps| alike(&figures[first..first + steps]))
        .filter_map(|steps| Some((steps, Fit::new(samples, first, steps).residual()?)))
        .collect();
    let best = fitting.iter().filter(|(steps, _)| *steps > 3).map(|(_, r)| *r).min_by(f64::total_cmp);
    match best {
        Some(best) => {
            let (steps, residual) = *fitting.iter().rev().find(|(_, r)| *r <= SAME_RESIDUAL * best)?;
            Some((steps, Some(residual)))
        }
        None => fitting.first().filter(|_| smooth(samples, first)).map(|(steps, _)| (*steps, None)),
    }
}

/// Whether the phase of three frames runs smoothly over the picture.
fn smooth(samples: &Samples, first: usize) -> bool {
    let phases = [0, 1, 2].map(|place| wave(samples, first, 3, place));
    [1, 2].into_iter().all(|place| {
        let turns = phases[place].iter().zip(&phases[0]).map(|((_, there), (_, here))| {
            (there * here.conj()).unscale((there.norm() * here.norm()).max(f64::MIN_POSITIVE))
        });
        turns.sum::<Complex<f64>>().norm() > LEAST_SMOOTHNESS * samples.len() as f64
    })
}

/// Whether frames have about as many edges.
fn alike(figures: &[FrameFigures]) -> bool {
    let edges = figures.iter().map(|f| f.edges_x.max(f.edges_y));
    let (least, most) = edges.fold((f64::INFINITY, 0.0_f64), |(l, m), e| (l.min(e), m.max(e)));
    most - least <= EDGES.0 + EDGES.1 * most
}

/// The sinusoid of even steps through some frames, by pixel.
struct Fit {
    modulation: Vec<f64>,
    residual_dn: Vec<f64>,
    range_dn: Vec<f64>,
    phase_rad: Vec<f64>,
}

impl Fit {
    fn new(samples: &Samples, first: usize, steps: usize) -> Self {
        let values = wave(samples, first, steps, 0);
        let mut squares = vec![0.0; samples.len()];
        for (step, turn) in turns(steps).into_iter().enumerate() {
            let dn = samples.values_dn(first + step, 0);
            for ((square, (mean, wave)), dn) in squares.iter_mut().zip(&values).zip(dn) {
                let off = f64::from(*dn) - mean - wave.re * turn.re - wave.im * turn.im;
                *square += off * off;
            }
        }
        let freedom = (steps as f64 - 3.0).max(1.0);
        Self {
            modulation: values.iter().map(|(_, wave)| wave.norm()).collect(),
            residual_dn: squares.into_iter().map(|sum: f64| (sum / freedom).sqrt()).collect(),
            range_dn: samples.range_dn.iter().map(|r| f64::from(*r)).collect(),
            phase_rad: values.iter().map(|(_, wave)| angle(*wave)).collect(),
        }
    }

    /// Median residual over median modulation where the frames are a set.
    fn residual(&self) -> Option<f64> {
        let residual =
            quantile(self.residual_dn.clone(), 0.5) / quantile(self.modulation.clone(), 0.5).max(1e-3);
        let relative: Vec<f64> = self.modulation.iter().zip(&self.range_dn).map(|(m, r)| m / r).collect();
        let even = quantile(relative.clone(), 0.1) > LEAST_MODULATION * quantile(relative, 0.5);
        let cluster: Complex<f64> =
            self.phase_rad.iter().map(|phase| unit(6.0 * phase)).sum::<Complex<f64>>()
                / self.phase_rad.len() as f64;
        (residual < MAX_RESIDUAL && even && cluster.norm() < MAX_CLUSTER).then_some(residual)
    }
}

impl Stepped {
    fn new(samples: &Samples, first: usize, steps: usize, residual: Option<f64>) -> Self {
        let phases = [0, 1, 2].map(|place| {
            wave(samples, first, steps, place).iter().map(|(_, wave)| angle(*wave)).collect::<Vec<f64>>()
        });
        let change = |place: usize| mean_angle(phases[place].iter().zip(&phases[0]).map(|(b, a)| b - a));
        let (along_x, along_y) = (change(1), change(2));
        let (axis, clear) = axis_of(along_x, along_y);
        let per_px_rad = if axis == Axis::X { along_x } else { along_y };
        let [here, right, below] = phases;
        let next = if axis == Axis::X { right } else { below };
        Self { first, steps, residual, axis, clear, per_px_rad, phases_rad: [here, next] }
    }
}

/// Mean and complex amplitude of each pixel: I = mean + Re(amplitude · exp(−2πi k / N)).
fn wave(samples: &Samples, first: usize, steps: usize, place: usize) -> Vec<(f64, Complex<f64>)> {
    let count = steps as f64;
    let mut sums = vec![(0.0, Complex::new(0.0, 0.0)); samples.len()];
    for (step, turn) in turns(steps).into_iter().enumerate() {
        for (sum, value) in sums.iter_mut().zip(samples.values_dn(first + step, place)) {
            sum.0 += f64::from(*value) / count;
            sum.1 += turn * (2.0 * f64::from(*value) / count);
        }
    }
    sums
}

/// Directions of the even steps.
fn turns(steps: usize) -> Vec<Complex<f64>> {
    (0..steps).map(|step| unit(TAU * step as f64 / steps as f64)).collect()
}

/// Angle of a complex number, rad.
fn angle(value: Complex<f64>) -> f64 {
    fringe::math::atan2(value.im, value.re)
}

/// The complex number of an angle, rad.
pub(super) fn unit(angle_rad: f64) -> Complex<f64> {
    Complex::new(fringe::math::cos(angle_rad), fringe::math::sin(angle_rad))
}

/// Mean direction of angles, rad.
pub(super) fn mean_angle(angles_rad: impl Iterator<Item = f64>) -> f64 {
    angle(angles_rad.map(unit).sum())
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    let place = ((values.len() - 1) as f64 * share) as usize;
    *values.select_nth_unstable_by(place, f64::total_cmp).1
}
