//! What is adjusted: the options that choose between models.

use anyhow::{Context, Result};
use characterise::calibration::{
    Calibration, CalibrationSettings, DeviceKind, LensChoice, LensFamily, LensModel, Observations,
    TargetShape, choose_lens,
};

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
    /// Lens model of the cameras: `brown-conrady`, `rational` (k4, k5 besides), `thin-prism` (with s1 to s4), `fisheye` (Kannala and
    /// Brandt), or `auto`: the one that predicts held-out poses best, and of those that differ by chance the simplest.
    #[arg(long = "model", value_name = "NAME|auto", default_value = "brown-conrady", value_parser = lens)]
    lens: Lens,
    /// Number of radial lens terms of the cameras (k1, k2, k3; of a quotient as many of k4, k5, k6). Three are for wide-angle lenses.
    #[arg(long, value_name = "0..3", default_value_t = 2, value_parser = clap::value_parser!(u8).range(0..=3))]
    radial_terms: u8,
}

impl Model {
    /// As the adjustment takes it; `auto` as the poorest model.
    pub fn settings(&self) -> CalibrationSettings {
        let own = match self.lens {
            Lens::Auto => LensModel::default(),
            Lens::Of(LensFamily::Fisheye) => LensModel::of(LensFamily::Fisheye),
            Lens::Of(family) => LensModel { radial_terms: self.radial_terms.into(), ..LensModel::of(family) },
        };
        let camera = LensModel { skew: self.skew, ..own };
        CalibrationSettings { camera, target: self.board, ..CalibrationSettings::default() }
    }

    /// The settings with the lens model that predicts the poses best, where it is asked for.
    pub fn chosen(&self, observations: &Observations) -> Result<(CalibrationSettings, Option<LensChoice>)> {
        let settings = self.settings();
        if self.lens != Lens::Auto {
            return Ok((settings, None));
        }
        let choice = choose_lens(observations, &settings).context("--model auto")?;
        let camera = choice.tried[choice.chosen].model;
        Ok((CalibrationSettings { camera, ..settings }, Some(choice)))
    }
}

/// What `--model` asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lens {
    /// The model that predicts held-out poses best.
    Auto,
    /// This model of the lens.
    Of(LensFamily),
}

/// `auto`, or the name of a lens model as in a rig file.
pub fn lens(text: &str) -> Result<Lens, String> {
    match text {
        "auto" => Ok(Lens::Auto),
        "brown-conrady" => Ok(Lens::Of(LensFamily::BrownConrady)),
        "rational" => Ok(Lens::Of(LensFamily::Rational)),
        "thin-prism" => Ok(Lens::Of(LensFamily::ThinPrism)),
        "fisheye" => Ok(Lens::Of(LensFamily::Fisheye)),
        _ => Err("write brown-conrady, rational, thin-prism, fisheye or auto".into()),
    }
}

/// The lens model of a calibration, and what the others predicted.
pub fn lenses_line(calibration: &Calibration, lenses: Option<&LensChoice>) -> String {
    let Some(choice) = lenses else {
        let cameras = calibration.devices.iter().filter(|d| d.kind == DeviceKind::Camera);
        return cameras.map(|d| d.camera.distortion.kind.name()).next().unwrap_or("none").to_owned();
    };
    let tried = choice.tried.iter().map(|t| match &t.held_out_px {
        Ok(px) => format!("{} {px:.4} px", t.name),
        Err(_) => format!("{} refused", t.name),
    });
    format!(
        "{}; rms in held-out poses: {}",
        choice.tried[choice.chosen].name,
        tried.collect::<Vec<_>>().join(", ")
    )
}

/// The comparison for programs.
pub fn lenses_json(choice: &LensChoice) -> serde_json::Value {
    let tried = choice.tried.iter().map(|t| {
        let (px, why) = match &t.held_out_px {
            Ok(px) => (Some(*px), None),
            Err(why) => (None, Some(why.to_string())),
        };
        serde_json::json!({ "name": t.name, "held_out_px": px, "refused": why })
    });
    serde_json::json!({ "chosen": choice.tried[choice.chosen].name, "tried": tried.collect::<Vec<_>>() })
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
