//! How to unwrap, as the command line says it.

use anyhow::Result;
use fringe::unwrap::{Method, QualityMap, UnwrapSettings};

/// The method and its settings.
#[derive(Debug, Clone, clap::Args)]
pub struct Choice {
    /// How.
    #[arg(long, value_enum, default_value_t = Name::Reliability)]
    method: Name,
    /// What `quality` and `weighted-least-squares` go by.
    #[arg(long, value_enum, default_value_t = Quality::DerivativeVariance)]
    quality: Quality,
    /// Branch cuts: farthest partner of a residue, px.
    #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    reach_px: u32,
    /// Least squares: the residual, as a fraction of the first one, that is good enough.
    #[arg(long, default_value_t = 1e-4)]
    tolerance: f64,
    /// Least squares: steps at most.
    #[arg(long, default_value_t = 200)]
    max_iterations: u32,
    /// Least squares: give the smooth solution, not the nearest phase that keeps what was measured.
    #[arg(long)]
    smooth: bool,
}

/// The methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Name {
    /// Rows, then columns: the baseline.
    Itoh,
    /// Goldstein's branch cuts.
    Goldstein,
    /// Best pixels first.
    Quality,
    /// Best edges first, by second differences (Herráez).
    Reliability,
    /// Least squares.
    LeastSquares,
    /// Least squares weighted by the quality.
    WeightedLeastSquares,
}

/// The quality maps.
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
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Itoh,
        Self::Goldstein,
        Self::Quality,
        Self::Reliability,
        Self::LeastSquares,
        Self::WeightedLeastSquares,
    ];

    /// As typed.
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
    /// As typed.
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
