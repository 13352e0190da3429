//! Settings of the adjustment.

use super::CalibrationError;
use fringe::geometry::lens::LensKind;
use serde::{Deserialize, Serialize};

/// Which formula the lens of a device follows, as [`LensKind`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LensFamily {
    /// Radial polynomial and decentring.
    #[default]
    BrownConrady,
    /// With k4, k5 (k6) in the denominator.
    Rational,
    /// With s1 … s4 besides.
    ThinPrism,
    /// Kannala and Brandt's fisheye k1 … k4.
    Fisheye,
}

impl LensFamily {
    /// The formula in the geometry.
    pub fn kind(self) -> LensKind {
        match self {
            Self::BrownConrady => LensKind::BrownConrady,
            Self::Rational => LensKind::Rational,
            Self::ThinPrism => LensKind::ThinPrism,
            Self::Fisheye => LensKind::Fisheye,
        }
    }
}

/// Which lens parameters of a device are adjusted; the others stay 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LensModel {
    /// The formula of the lens.
    pub family: LensFamily,
    /// How many of k1, k2, k3, and of a quotient as many of k4, k5, k6: 0 … 3. k3 needs a wide lens; in a narrow field it only
    /// follows k2.
    pub radial_terms: usize,
    /// Whether p1 and p2 are adjusted.
    pub tangential: bool,
    /// The skew of K; real sensors have none.
    pub skew: bool,
}

impl Default for LensModel {
    fn default() -> Self {
        Self { family: LensFamily::BrownConrady, radial_terms: 2, tangential: true, skew: false }
    }
}

impl LensModel {
    /// The usual parameters of a family: k1, k2 and, of a quotient, k4, k5; k1 to k4 of a fisheye, without decentring.
    pub fn of(family: LensFamily) -> Self {
        let fisheye = family == LensFamily::Fisheye;
        Self { family, radial_terms: if fisheye { 3 } else { 2 }, tangential: !fisheye, skew: false }
    }

    /// The model of a device's first adjustment by itself: the terms of a quotient, which follow each other where nothing is
    /// distorted, come last.
    pub(super) fn to_begin_with(self) -> Self {
        match self.family {
            LensFamily::BrownConrady | LensFamily::Fisheye => self,
            LensFamily::Rational | LensFamily::ThinPrism => Self { family: LensFamily::BrownConrady, ..self },
        }
    }

    /// Whether one of k4, k5, k6, s1 … s4 is adjusted.
    pub(super) fn further(&self, index: usize) -> bool {
        match self.family {
            LensFamily::BrownConrady => false,
            LensFamily::Rational => index < self.radial_terms,
            LensFamily::ThinPrism => index < self.radial_terms || index >= 3,
            LensFamily::Fisheye => index == 0,
        }
    }
}

/// What is adjusted of the target itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TargetShape {
    /// Nothing: it is as declared.
    Flat,
    /// Its bend (two parameters, see [`super::Warp`]).
    #[default]
    Bent,
    /// Each of its points. Only position, orientation and mean scale are held to the declared ones: for printed boards,
    /// which are good to tenths of a millimetre while their corners are seen to micrometres.
    Free,
}

/// Choice of the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum WorldFrame {
    /// The target in its first pose (as in the thesis, section 5.3.1): z is 0 on the target.
    #[default]
    FirstBoard,
    /// The frame of the first device.
    FirstDevice,
}

/// Settings of the adjustment.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationSettings {
    /// Lens model of cameras.
    pub camera: LensModel,
    /// Lens model of projectors.
    pub projector: LensModel,
    /// What is adjusted of the target.
    pub target: TargetShape,
    /// A point farther off than this many standard deviations of its device is an outlier. Of 10⁴ good points 0.04 lie
    /// beyond the default of 5.
    pub outlier_limit: f64,
    /// More outliers than this fraction of a device's points mean that something else is wrong.
    pub max_outlier_fraction: f64,
    /// Whether each device's noise is estimated from its residuals (variance components); otherwise the given
    /// covariances are taken in their ratio, with one common factor.
    pub estimate_noise: bool,
    /// Choice of the world frame.
    pub world: WorldFrame,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self {
            camera: LensModel::default(),
            projector: LensModel::default(),
            target: TargetShape::default(),
            outlier_limit: 5.0,
            max_outlier_fraction: 0.25,
            estimate_noise: true,
            world: WorldFrame::default(),
        }
    }
}

impl CalibrationSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Names key, value and limits.
    pub fn check(&self) -> Result<(), CalibrationError> {
        let refuse = |key, value, limits| Err(CalibrationError::Setting { key, value, limits });
        if self.camera.radial_terms > 3 {
            return refuse("camera.radial_terms", self.camera.radial_terms as f64, "0 … 3");
        }
        if self.projector.radial_terms > 3 {
            return refuse("projector.radial_terms", self.projector.radial_terms as f64, "0 … 3");
        }
        if !(3.0..=1e6).contains(&self.outlier_limit) {
            return refuse("outlier_limit", self.outlier_limit, "3 … 1e6");
        }
        if !(0.0..=0.5).contains(&self.max_outlier_fraction) {
            return refuse("max_outlier_fraction", self.max_outlier_fraction, "0 … 0.5");
        }
        Ok(())
    }
}
