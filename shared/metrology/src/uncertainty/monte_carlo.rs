//! Propagation of distributions by an adaptive Monte Carlo method (Supplement 1, 7.9) and validation of the budget by it
//! (8.1, 8.2).
//!
//! Every draw is a function of seed, quantity and trial, blocks are joined in their order, and the decision to stop
//! looks at blocks one after the other: the result has the same bytes on any number of threads.

use rayon::prelude::*;
use serde::Serialize;
use std::ops::RangeInclusive;

use super::budget::{Budget, Evaluation};
use super::error::UncertaintyError;
use super::interval::{Interval, IntervalKind, probabilistically_symmetric, shortest};
use super::sampler::Sampler;
use fringe::math::{log10, pow};

/// Fewest trials of a block (7.9.4 b).
const LEAST_BLOCK: u64 = 10_000;

/// Blocks computed at once; those behind the stopping point are dropped, so the number does not show.
const BATCH: u64 = 16;

/// Results validate the budget, so they are computed to a fifth of its tolerance (8.2).
const FRACTION: f64 = 0.2;

/// Bars of the histogram.
const BINS: usize = 80;

/// How far the histogram reaches on each side, in standard uncertainties.
const REACH: f64 = 4.0;

/// How the trials are done.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MonteCarloSettings {
    /// Seed of the random draws.
    pub seed: u64,
    /// Significant digits of u that matter, 1 or 2.
    pub digits: u8,
    /// A fixed number; otherwise as many as the tolerance needs.
    pub trials: Option<u64>,
    /// Where the adaptive method gives up, see [`MonteCarloSettings::TRIALS`].
    pub max_trials: u64,
    /// The interval that decides about convergence and validation.
    pub interval: IntervalKind,
}

impl MonteCarloSettings {
    /// Numbers of trials that are accepted: one block at least, at most 400 MB of values.
    pub const TRIALS: RangeInclusive<u64> = LEAST_BLOCK..=50_000_000;
}

impl Default for MonteCarloSettings {
    fn default() -> Self {
        Self { seed: 1, digits: 2, trials: None, max_trials: 30_000_000, interval: IntervalKind::default() }
    }
}

/// Counts of values in bars of equal width.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Histogram {
    /// Lower end of the first bar.
    pub low: f64,
    /// Width of a bar.
    pub width: f64,
    /// Number of values in each bin.
    pub counts: Vec<u64>,
    /// Values outside all bars.
    pub outside: u64,
}

/// The distribution of the measurand in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MonteCarloResult {
    /// Seed of the random draws.
    pub seed: u64,
    /// Number M of trials.
    pub trials: u64,
    /// Whether the numbers are stable to the tolerance; `None` for a fixed number of trials, which nothing checks.
    pub converged: Option<bool>,
    /// Tolerance of the adaptive method, a fifth of δ.
    pub tolerance: f64,
    /// Mean of the model's values.
    pub estimate: f64,
    /// Standard deviation of the model's values.
    pub standard_uncertainty: f64,
    /// p of the intervals.
    pub coverage_probability: f64,
    /// As much below as above.
    pub probabilistically_symmetric: Interval,
    /// Shortest coverage interval of the probability.
    pub shortest: Interval,
    /// Which of the two decided.
    pub interval: IntervalKind,
    /// Histogram of the values, for the report.
    pub histogram: Histogram,
}

impl MonteCarloResult {
    /// The interval that decides.
    pub fn decisive(&self) -> Interval {
        match self.interval {
            IntervalKind::ProbabilisticallySymmetric => self.probabilistically_symmetric,
            IntervalKind::Shortest => self.shortest,
        }
    }
}

/// Whether the budget's interval agrees with the distribution (8.1).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Validation {
    /// δ: half a unit in the last significant digit of u.
    pub tolerance: f64,
    /// |y − U − y_low|.
    pub low_difference: f64,
    /// |y + U − y_high|.
    pub high_difference: f64,
    /// Whether both ends agree with the GUM interval within δ.
    pub valid: bool,
}

/// δ = ½·10^l for u = c·10^l with c of so many digits (7.9.2).
pub fn numerical_tolerance(standard_uncertainty: f64, digits: u8) -> f64 {
    if standard_uncertainty.is_nan() || standard_uncertainty <= 0.0 {
        return 0.0;
    }
    let digits = f64::from(digits);
    let last = |u: f64| log10(u).floor() - digits + 1.0;
    // 0.0996 has the two digits 0.10, not 0.0996's 0.099.
    let unit = pow(10.0, last(standard_uncertainty));
    let rounded = (standard_uncertainty / unit).round() * unit;
    0.5 * pow(10.0, last(rounded * (1.0 + 1e-12)))
}

/// Compares the interval of the budget with that of the distribution.
pub fn validate(budget: &Evaluation, monte_carlo: &MonteCarloResult, digits: u8) -> Validation {
    let tolerance = numerical_tolerance(budget.combined_standard_uncertainty, digits);
    let interval = monte_carlo.decisive();
    let low_difference = (budget.estimate - budget.expanded_uncertainty - interval.low).abs();
    let high_difference = (budget.estimate + budget.expanded_uncertainty - interval.high).abs();
    let valid = low_difference <= tolerance && high_difference <= tolerance;
    Validation { tolerance, low_difference, high_difference, valid }
}

impl Budget {
    /// Draws until twice the standard deviations of estimate, uncertainty and interval ends, as averages of blocks, are
    /// within the tolerance; `observe` gets the trials done and, approximately, the trials needed.
    ///
    /// # Errors
    /// See [`UncertaintyError`]; also a model without a finite value at some draw.
    pub fn monte_carlo(
        &self,
        settings: &MonteCarloSettings,
        observe: &mut dyn FnMut(u64, u64),
    ) -> Result<MonteCarloResult, UncertaintyError> {
        let groups = self.check()?;
        check_settings(settings)?;
        let sampler = Sampler::new(self, &groups, settings.seed)?;
        // M = max(J, 10⁴), J the smallest whole number not below 100 / (1 − p).
        let block = LEAST_BLOCK.max((100.0 / (1.0 - self.coverage_probability) - 1e-6).ceil() as u64);
        let limit = settings.trials.unwrap_or(settings.max_trials);
        let mut trials = Trials::new(self.coverage_probability, settings);
        while trials.done() < limit && !trials.converged {
            let first = trials.done();
            let starts: Vec<u64> =
                (0..BATCH).map(|i| first + i * block).take_while(|start| *start < limit).collect();
            let blocks: Vec<Vec<f64>> = starts
                .into_par_iter()
                .map(|start| self.block(&sampler, start, block.min(limit - start)))
                .collect();
            for values in blocks {
                trials.add(values)?;
                if trials.converged {
                    break;
                }
            }
            observe(trials.done(), trials.expected.clamp(trials.done(), limit));
        }
        trials.finish()
    }

    fn block(&self, sampler: &Sampler<'_>, start: u64, count: u64) -> Vec<f64> {
        let mut values = vec![0.0; self.quantities.len()];
        let mut stack = Vec::new();
        let trial = |trial| {
            sampler.draw(trial, &mut values);
            self.model.value(&values, &mut stack)
        };
        (start..start + count).map(trial).collect()
    }
}

fn check_settings(settings: &MonteCarloSettings) -> Result<(), UncertaintyError> {
    let refuse = |key, value: f64, limit| {
        Err(UncertaintyError::Value { place: "Monte Carlo".into(), key, value, limit })
    };
    if !(1..=2).contains(&settings.digits) {
        return refuse("digits", f64::from(settings.digits), "1 or 2");
    }
    let counts = [("trials", settings.trials), ("max_trials", Some(settings.max_trials))];
    for (key, count) in counts {
        if let Some(count) = count.filter(|count| !MonteCarloSettings::TRIALS.contains(count)) {
            return refuse(key, count as f64, "10000 … 50000000");
        }
    }
    Ok(())
}

/// Mean and sum of squares of a growing set (Welford; Chan for whole blocks), stable for a large mean.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    mean: f64,
    squares: f64,
}

impl Moments {
    fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let squares = values.iter().map(|v| (v - mean) * (v - mean)).sum();
        Self { count, mean, squares }
    }

    fn join(&mut self, other: Self) {
        let count = self.count + other.count;
        let step = other.mean - self.mean;
        self.mean += step * other.count / count;
        self.squares += other.squares + step * step * self.count * other.count / count;
        self.count = count;
    }

    fn sd(&self) -> f64 {
        if self.count > 1.0 { (self.squares / (self.count - 1.0)).sqrt() } else { 0.0 }
    }
}

/// The trials so far.
struct Trials<'a> {
    probability: f64,
    settings: &'a MonteCarloSettings,
    values: Vec<f64>,
    all: Moments,
    /// Of estimate, uncertainty and interval ends of blocks.
    results: [Moments; 4],
    converged: bool,
    expected: u64,
}

impl<'a> Trials<'a> {
    fn new(probability: f64, settings: &'a MonteCarloSettings) -> Self {
        let expected = settings.trials.unwrap_or(0);
        let (values, all, results) = (Vec::new(), Moments::default(), [Moments::default(); 4]);
        Self { probability, settings, values, all, results, converged: false, expected }
    }

    fn done(&self) -> u64 {
        self.values.len() as u64
    }

    fn tolerance(&self) -> f64 {
        FRACTION * numerical_tolerance(self.all.sd(), self.settings.digits)
    }

    fn add(&mut self, mut block: Vec<f64>) -> Result<(), UncertaintyError> {
        let count = block.iter().filter(|v| !v.is_finite()).count() as u64;
        if count > 0 {
            let trials = self.done() + block.len() as u64;
            return Err(UncertaintyError::Draws { count, trials });
        }
        self.values.extend_from_slice(&block);
        let moments = Moments::of(&block);
        self.all.join(moments);
        if self.settings.trials.is_some() {
            return Ok(());
        }
        block.sort_unstable_by(f64::total_cmp);
        let Some(ends) = self.settings.interval.of(&block, self.probability) else { return Ok(()) };
        let results = [moments.mean, moments.sd(), ends.low, ends.high];
        for (all, result) in self.results.iter_mut().zip(results) {
            all.join(Moments { count: 1.0, mean: result, squares: 0.0 });
        }
        let blocks = self.results[0].count;
        let twice = |m: &Moments| 2.0 * m.sd() / blocks.sqrt();
        let worst = self.results.iter().map(twice).fold(0.0, f64::max);
        self.converged = blocks > 1.0 && worst <= self.tolerance();
        let ratio = worst / self.tolerance();
        self.expected = (self.done() as f64 * ratio * ratio) as u64;
        Ok(())
    }

    fn finish(mut self) -> Result<MonteCarloResult, UncertaintyError> {
        let tolerance = self.tolerance();
        let histogram = histogram(&self.values, &self.all);
        self.values.par_sort_unstable_by(f64::total_cmp);
        let symmetric = probabilistically_symmetric(&self.values, self.probability);
        let (Some(symmetric), Some(shortest)) = (symmetric, shortest(&self.values, self.probability)) else {
            return Err(UncertaintyError::Empty);
        };
        Ok(MonteCarloResult {
            seed: self.settings.seed,
            trials: self.done(),
            converged: self.settings.trials.is_none().then_some(self.converged),
            tolerance,
            estimate: self.all.mean,
            standard_uncertainty: self.all.sd(),
            coverage_probability: self.probability,
            probabilistically_symmetric: symmetric,
            shortest,
            interval: self.settings.interval,
            histogram,
        })
    }
}

fn histogram(values: &[f64], all: &Moments) -> Histogram {
    let (low, width) = (all.mean - REACH * all.sd(), 2.0 * REACH * all.sd() / BINS as f64);
    let mut counts = vec![0; BINS];
    let mut outside = 0;
    for value in values {
        let place = (value - low) / width;
        if (0.0..BINS as f64).contains(&place) { counts[place as usize] += 1 } else { outside += 1 }
    }
    Histogram { low, width, counts, outside }
}
