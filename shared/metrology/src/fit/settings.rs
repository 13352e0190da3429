//! What may be set about a fit.

use super::PointNoise;

/// How the noise of neighbouring points hangs together. It moves the stated uncertainties, never the element.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Correlation {
    /// Not at all: points count as independent.
    #[default]
    Independent,
    /// Within cells of this edge, mm, and not beyond: cluster-robust covariance.
    Cells(f64),
    /// As the residuals show: the covariance follows the correlation as far as it reaches. Costs half a million
    /// pairs of cells, some four milliseconds.
    Estimated,
    /// Points are independent, each with this standard deviation, mm: known from elsewhere, not from the residuals.
    Known(f64),
}

/// How a fit treats its points.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FitSettings<'a> {
    /// Fraction of the points that is left out, 0 … 0.5: ⌊fraction · n⌋ points, those of largest |residual|, chosen
    /// anew after each refit until the choice is stable. VDI/VDE 2634 part 3 allows 0.03.
    pub max_reject_fraction: f64,
    /// The points are those within this distance from the element itself, mm, as [`super::find_plane`] and [`super::find_sphere`] choose them;
    /// `None` where they were chosen by something else. What it cuts off their noise enters the uncertainty.
    pub within_mm: Option<f64>,
    /// How noise is correlated.
    pub correlation: Correlation,
    /// Standard deviation of the error of each point that others may have in common, mm ([`fringe::cloud::Point::shared_mm`]); empty
    /// where there is none. It moves the stated uncertainties, never the element.
    pub shared_mm: &'a [f32],
    /// Noise of some points, spread evenly over all: the element is freed of what it does to it (see [`PointNoise`]). Empty where it is not known, and
    /// for elements as the standards define them.
    pub noise: &'a [PointNoise],
    /// What the cloud leaves out at the rims of faces, for outlines; `None` where nothing is known of it.
    pub left_out: Option<LeftOut>,
}

/// What a cloud of cameras leaves out at the rims of faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LeftOut {
    /// Pixels from the rim.
    pub pixels: u32,
    /// Points that lie on a pixel: those of all pairs that see the same surface.
    pub layers: f64,
}
