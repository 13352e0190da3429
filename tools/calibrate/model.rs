//! What is adjusted: the options that choose between models.

use characterise::calibration::{Calibration, CalibrationSettings, LensModel, TargetShape};

/// Root mean square of the estimated corner shifts, in standard deviations, above which they are significant.
const MISFIT: f64 = 2.0;

/// Options of the model.
#[derive(clap::Args)]
pub struct Model {
    /// What is adjusted of the target: nothing (`flat`), its bend (`bent`), or each of its points (`free`). A printed board is accurate to tenths of a
    /// millimetre only; `free` estimates its points together with the cameras and keeps the mean scale (needs five poses).
    #[arg(long, value_name = "flat|bent|free", default_value = "bent", value_parser = target_shape)]
    board: TargetShape,
    /// Adjust the skew of the cameras (sensors have none).
    #[arg(long)]
    skew: bool,
    /// Number of radial lens terms of the cameras (k1, k2, k3). Three are for wide-angle lenses.
    #[arg(long, value_name = "0..3", default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=3))]
    radial_terms: u8,
}

impl Model {
    /// As the adjustment takes it.
    pub fn settings(&self) -> CalibrationSettings {
        let camera =
            LensModel { radial_terms: self.radial_terms.into(), skew: self.skew, ..LensModel::default() };
        CalibrationSettings { camera, target: self.board, ..CalibrationSettings::default() }
    }
}

/// `flat`, `bent` or `free`.
pub fn target_shape(text: &str) -> Result<TargetShape, String> {
    match text {
        "flat" => Ok(TargetShape::Flat),
        "bent" => Ok(TargetShape::Bent),
        "free" => Ok(TargetShape::Free),
        _ => Err("write flat, bent or free".into()),
    }
}

/// What to do about a target that is not the declared one.
pub fn note(calibration: &Calibration) -> Option<String> {
    let misfit = calibration.target_misfit;
    (misfit > MISFIT).then(|| {
        format!(
            "the target's points are not at their declared places: their shifts are {misfit:.1} times their uncertainty, limit \
             {MISFIT}; measure them along with --board free"
        )
    })
}
