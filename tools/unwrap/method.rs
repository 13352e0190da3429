//! The unwrapping method and its options on the command line.

use anyhow::Result;
use fringe::unwrap::{Method, QualityMap, UnwrapSettings};

/// The method and its settings.
#[derive(Debug, Clone, clap::Args)]
pub struct Choice {
    /// Method of spatial unwrapping.
    #[arg(long, value_enum, default_value_t = Name::Reliability)]
    method: Name,
    /// Quality map of `quality` and `weighted-least-squares`.
    #[arg(long, value_enum, default_value_t = Quality::DerivativeVariance)]
    quality: Quality,
    /// Branch cuts: largest distance between paired residues, px.
    #[arg(long, value_name = "PX", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    reach_px: u32,
    /// Least squares: stop at this residual, as a fraction of the first.
    #[arg(long, value_name = "F", default_value_t = 1e-4)]
    tolerance: f64,
    /// Least squares: largest number of steps.
    #[arg(long, value_name = "N", default_value_t = 200)]
    max_iterations: u32,
    /// Least squares: write the smooth solution instead of the measured phase plus whole periods nearest to it.
    #[arg(long)]
    smooth: bool,
}

/// Unwrapping methods, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Name {
    /// Rows, then columns: the baseline.
    Itoh,
    /// Branch cuts by Goldstein's algorithm.
    Goldstein,
    /// Flood fill in the order of quality.
    Quality,
    /// Best edges first, by second differences (Herráez).
    Reliability,
    /// Least squares without weights.
    LeastSquares,
    /// Least squares weighted by the quality.
    WeightedLeastSquares,
}

/// Quality maps, as typed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Quality {
    /// As measured (recordings only).
    Modulation,
    /// Spread of the derivatives over 3 × 3 pixels.
    DerivativeVariance,
    /// Mean vector over 3 × 3 pixels.
    PseudoCorrelation,
    /// Largest difference to a neighbour.
    Gradient,
}

impl Name {
    /// Every method, for benchmarks.
    pub const ALL: [Self; 6] = [
        Self::Itoh,
        Self::Goldstein,
        Self::Quality,
        Self::Reliability,
        Self::LeastSquares,
        Self::WeightedLeastSquares,
    ];

    /// The name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Itoh => "itoh",
            Self::Goldstein => "goldstein",
            Self::Quality => "quality",
            Self::Reliability => "reliability",
            Self::LeastSquares => "least-squares",
            Self::WeightedLeastSquares => "weighted-least-squares",
        }
    }

    /// With a quality map where it takes one.
    pub fn method(self, map: QualityMap) -> Method {
        match self {
            Self::Itoh => Method::Itoh,
            Self::Goldstein => Method::Goldstein,
            Self::Quality => Method::Quality(map),
            Self::Reliability => Method::Reliability,
            Self::LeastSquares => Method::LeastSquares,
            Self::WeightedLeastSquares => Method::WeightedLeastSquares(map),
        }
    }
}

impl Choice {
    /// The name on the command line.
    pub fn name(&self) -> &'static str {
        self.method.name()
    }

    /// For the kernel, which checks the numbers.
    pub fn settings(&self) -> Result<UnwrapSettings> {
        let map = match self.quality {
            Quality::Modulation => QualityMap::Modulation,
            Quality::DerivativeVariance => QualityMap::PhaseDerivativeVariance,
            Quality::PseudoCorrelation => QualityMap::PseudoCorrelation,
            Quality::Gradient => QualityMap::MaximumGradient,
        };
        let least = matches!(self.method, Name::LeastSquares | Name::WeightedLeastSquares);
        if self.smooth && !least {
            anyhow::bail!(
                "--smooth: only least squares have a smooth solution, not --method {}",
                self.name()
            );
        }
        Ok(UnwrapSettings {
            method: self.method.method(map),
            reach_px: self.reach_px,
            tolerance: self.tolerance,
            max_iterations: self.max_iterations,
            congruent: !self.smooth,
        })
    }
}
