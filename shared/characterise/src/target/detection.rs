//! Detects a target in an image, and the result of the detection.

use super::edge_blur::BlurredEdge;
use super::error::TargetError;
use super::raster::Image;
use super::settings::TargetSettings;
use super::spec::{TargetKind, TargetSpec};
use super::{aprilgrid, charuco, checkerboard, circles};
use fringe::frame::FrameView;
use nalgebra::{Matrix2, Point2};

/// Finds the points of a target in a frame, each with its covariance.
///
/// Deterministic: the same frame gives the same bits. One thread; different frames may be given to different threads.
///
/// # Errors
/// The target or the settings are impossible, the frame's size does not fit its values, or no target, another one, a hidden one,
/// several, or one that may be a part of a larger one are seen.
pub fn detect(
    frame: &FrameView,
    spec: &TargetSpec,
    settings: &TargetSettings,
) -> Result<Detection, TargetError> {
    spec.check()?;
    settings.check()?;
    let image = Image::of_frame(frame)?;
    let full_scale_dn = f64::from(frame.full_scale_dn.max(1));
    match spec.kind {
        TargetKind::Checkerboard => checkerboard::detect(&image, full_scale_dn, spec, settings),
        TargetKind::Charuco => charuco::detect(&image, full_scale_dn, spec, settings),
        TargetKind::Aprilgrid => aprilgrid::detect(&image, full_scale_dn, spec, settings),
        TargetKind::Circles | TargetKind::AsymmetricCircles => {
            circles::detect(&image, full_scale_dn, spec, settings)
        }
    }
}

/// One point of the target in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectedPoint {
    /// Column and row on the target.
    pub index: (u32, u32),
    /// Position in the image, px. Of a circle: the centre of its image, which is an ellipse; see
    /// [`super::projected_circle_center_bias`].
    pub pixel: Point2<f64>,
    /// Covariance of the position from the noise left by the fit, px².
    pub covariance_px2: Matrix2<f64>,
    /// Standard deviation of the blur across the edges, px.
    pub blur_px: f64,
    /// Both edges through a corner, each with its own blur; none of circles, where they do not show it, and where the settings
    /// do not ask for it.
    pub edges: Option<[BlurredEdge; 2]>,
    /// Half difference of light and dark, DN.
    pub contrast_dn: f64,
    /// Standard deviation of the grey values about the model, DN.
    pub residual_dn: f64,
}

/// Whether the numbering of the points is the only one that the image allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ambiguity {
    /// The numbering is unique.
    None,
    /// The target looks the same after half a turn: the true numbering is this one or [`Detection::half_turned`].
    HalfTurn,
    /// The target looks the same after a quarter turn (as many rows as columns): one of four, see
    /// [`Detection::quarter_turned`].
    QuarterTurn,
}

/// A target found in an image.
///
/// Rows run along the first index. The numbering never mirrors: columns to rows turns as x to y of the image, since a
/// target is seen from its front. Where colours decide (an odd sum of columns and rows, or an odd square), the outer square
/// beside point (0, 0) is dark; where they do not, the columns run as nearly as possible with the image's x, and
/// [`Self::ambiguity`] reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct Detection {
    /// Points, row by row; hidden ones are left out.
    pub points: Vec<DetectedPoint>,
    /// Columns declared in the target file.
    pub columns: u32,
    /// Rows declared in the target file.
    pub rows: u32,
    /// Other numberings that fit as well.
    pub ambiguity: Ambiguity,
    /// Radius of the circles over the pitch, from the areas of circles and cells; none for squares.
    pub radius_per_pitch: Option<f64>,
    kind: TargetKind,
}

impl Detection {
    pub(crate) fn new(spec: &TargetSpec, mut points: Vec<DetectedPoint>, ambiguity: Ambiguity) -> Self {
        points.sort_by_key(|p| (p.index.1, p.index.0));
        let (columns, rows, kind) = (spec.columns, spec.rows, spec.kind);
        Self { points, columns, rows, ambiguity, radius_per_pitch: None, kind }
    }

    pub(crate) fn with_radius(self, radius_per_pitch: f64) -> Self {
        Self { radius_per_pitch: Some(radius_per_pitch), ..self }
    }

    /// The same points, numbered from the opposite end; `None` when [`Self::ambiguity`] excludes it.
    #[must_use]
    pub fn half_turned(&self) -> Option<Self> {
        (self.ambiguity != Ambiguity::None)
            .then(|| self.renumbered(|(c, r)| (self.columns - 1 - c, self.rows - 1 - r)))
    }

    /// The same points, numbered a quarter turn on; `None` when [`Self::ambiguity`] excludes it.
    #[must_use]
    pub fn quarter_turned(&self) -> Option<Self> {
        (self.ambiguity == Ambiguity::QuarterTurn)
            .then(|| self.renumbered(|(c, r)| (r, self.columns - 1 - c)))
    }

    /// What is printed on the target.
    pub fn kind(&self) -> TargetKind {
        self.kind
    }

    fn renumbered(&self, index: impl Fn((u32, u32)) -> (u32, u32)) -> Self {
        let mut turned = self.clone();
        for point in &mut turned.points {
            point.index = index(point.index);
        }
        turned.points.sort_by_key(|p| (p.index.1, p.index.0));
        turned
    }
}
