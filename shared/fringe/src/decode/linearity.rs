//! Whether three steps saw a sine. More steps keep what a projector's response adds to a sine (its gamma) out of the phase; three let the second
//! harmonic through, and leave no residual that would show it.
//!
//! White and black show it: a sine has the mean of both, ((1 + cos φ)/2)^γ a lower one where γ is above 1. Its harmonics are known with γ: the second
//! over the first is (γ − 1) / (γ + 2), by which three steps move the phase at most.

use super::Decoder;
use super::roles::SineKind;
use crate::math::{cos, pow};
use crate::phase::PhaseViewMut;
use std::f64::consts::TAU;

/// Steps that let the second harmonic through.
const STEPS: u32 = 3;
/// Pixels that are asked, about.
const ASKED: usize = 4096;
/// Fewest of them that tell the mean.
const LEAST: usize = 100;
/// Beyond this part of white less black the mean is none of a sine: frames of several levels differ by some per cent for other reasons.
const ODD: f64 = 0.05;
/// Exponents among which the response is sought.
const EXPONENTS: [f64; 2] = [0.25, 6.0];
/// Samples of a period, and halvings of the interval of the exponents.
const SAMPLES: u32 = 64;
const HALVINGS: u32 = 30;

/// What the mean of three steps says of the projector's response.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearity {
    /// Mean of the steps over white less black, from black.
    pub mean: f64,
    /// Exponent of the response with that mean.
    pub gamma: f64,
    /// By how much three steps move the phase at most, rad.
    pub most_rad: f64,
}

impl Linearity {
    /// From the mean of the steps over white less black.
    fn of(mean: f64) -> Self {
        let [mut low, mut high] = EXPONENTS;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if mean_of(middle) > mean { low = middle } else { high = middle }
        }
        let gamma = 0.5 * (low + high);
        Self { mean, gamma, most_rad: ((gamma - 1.0) / (gamma + 2.0)).abs() }
    }

    /// What a person should know, where the fringes are no sines; `camera` is named.
    pub(super) fn warning(&self, camera: &str) -> Option<String> {
        let Self { mean, gamma, most_rad } = self;
        let [least, most] = EXPONENTS;
        let within = *gamma > 1.01 * least && *gamma < 0.99 * most;
        let how = if within { format!("of some {gamma:.1}") } else { format!("beyond {least} to {most}") };
        ((mean - 0.5).abs() > ODD).then(|| {
            format!(
                "camera \"{camera}\": the mean of the {STEPS} steps stands at {:.0} % of white less black, that of a sine at 50 %: a gamma of the projector \
                 {how} moves the phase by up to {most_rad:.2} rad, which its uncertainty does not hold; take four steps or more, linearise the projector \
                 (`fringetool gamma`), or remove its harmonics (--remove-harmonics); if white and black alone had another light, record them anew",
                100.0 * mean
            )
        })
    }
}

/// Mean of ((1 + cos φ)/2)^γ.
fn mean_of(gamma: f64) -> f64 {
    let of = |i: u32| pow(0.5 + 0.5 * cos(TAU * (f64::from(i) + 0.5) / f64::from(SAMPLES)), gamma);
    (0..SAMPLES).map(of).sum::<f64>() / f64::from(SAMPLES)
}

impl Decoder {
    /// What white and black say of a sine of three steps.
    pub(super) fn linearity(&self, home: usize, out: &PhaseViewMut) -> Option<Linearity> {
        let (plan, levels) = (&self.plan.axes[home], self.plan.axes[home].levels?);
        let slot = *plan.sines.first()?;
        let sine = &self.plan.sines[slot];
        let plain = sine.even && sine.steps == STEPS && sine.kind == SineKind::Plain;
        if !plain || self.sums[slot].replaced.is_some() || !self.findings[slot].is_empty() {
            return None;
        }
        let every = (self.pixels / ASKED).max(1) | 1;
        let grey = |raster, index| f64::from(self.rasters.value(raster, index));
        let (mut above, mut range, mut asked) = (0.0, 0.0, 0);
        for index in (0..self.pixels).step_by(every).filter(|index| out.valid[*index] == 1) {
            let [white, black] = [levels.white, levels.black].map(|raster| grey(raster, index));
            if white >= f64::from(self.clipped_dn) {
                continue;
            }
            let mean = sine.rasters().map(|raster| grey(raster, index)).sum::<f64>() / f64::from(STEPS);
            (above, range, asked) = (above + mean - black, range + white - black, asked + 1);
        }
        (asked >= LEAST && range > 0.0).then(|| Linearity::of(above / range))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Γ(γ + ½) / (√π Γ(γ + 1)) is 3/8 for 2 and 5/16 for 3 (Abramowitz and Stegun 6.1).
    #[test]
    fn the_mean_of_a_power_is_that_of_the_gamma_function() {
        for (gamma, mean) in [(1.0, 0.5), (2.0, 0.375), (3.0, 0.3125)] {
            assert!((mean_of(gamma) - mean).abs() < 1e-12, "{gamma}");
            let found = Linearity::of(mean);
            assert!((found.gamma - gamma).abs() < 1e-6, "{found:?}");
            assert!((found.most_rad - (gamma - 1.0) / (gamma + 2.0)).abs() < 1e-6, "{found:?}");
            assert_eq!(found.warning("cam1").is_some(), gamma > 1.0);
        }
        // Means that no exponent gives end at the first or the last one.
        for mean in [-1.0, 0.0, 0.9, 2.0, f64::NAN] {
            assert!(Linearity::of(mean).gamma.is_finite());
        }
    }
}
