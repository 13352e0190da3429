//! Association criteria of elements.

use serde::{Deserialize, Serialize};

/// How an element is associated with the points used (ISO 14405-1, ISO 1101).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Criterion {
    /// Sum of squared distances least: GG.
    #[default]
    LeastSquares,
    /// Largest distance least (minimax, Chebyshev): GC.
    MinimumZone,
    /// Largest element inside the points: GX.
    MaximumInscribed,
    /// Smallest element around the points: GN.
    MinimumCircumscribed,
}

impl Criterion {
    /// As the plan writes it.
    pub fn key(self) -> &'static str {
        match self {
            Self::LeastSquares => "least-squares",
            Self::MinimumZone => "minimum-zone",
            Self::MaximumInscribed => "maximum-inscribed",
            Self::MinimumCircumscribed => "minimum-circumscribed",
        }
    }

    /// Symbol of the reference element of a form (ISO 1101).
    pub fn form_symbol(self) -> &'static str {
        match self {
            Self::LeastSquares => "G",
            Self::MinimumZone => "C",
            Self::MaximumInscribed => "X",
            Self::MinimumCircumscribed => "N",
        }
    }

    /// Symbol of the size so associated (ISO 14405-1).
    pub fn symbol(self) -> &'static str {
        match self {
            Self::LeastSquares => "GG",
            Self::MinimumZone => "GC",
            Self::MaximumInscribed => "GX",
            Self::MinimumCircumscribed => "GN",
        }
    }
}
