//! The exponent from fringes, white and black, where no grey levels were recorded.

use super::input::ResponseFrames;
use super::{Args, Waveform, correction, percent};
use anyhow::{Context, Result};
use characterise::response::fringes::{FringeResponse, Fringes};
use files::correction::{PatternCorrection, TableSource};
use fringe::frame::Frame;
use fringe::math::pow;
use fringe::pattern::LevelTable;
use serde::Serialize;

/// The result; the keys are those of the JSON file.
#[derive(Debug, Serialize)]
pub struct FringeResult {
    /// How it was measured.
    pub method: &'static str,
    /// Which projector, if it has a name.
    pub projector: Option<String>,
    /// Which camera, if it has a name.
    pub camera: Option<String>,
    /// Whether the patterns were drawn corrected.
    pub corrected: bool,
    /// γ of the projector: that of the fringes times that of their encoding.
    pub gamma: f64,
    /// Standard uncertainty of the exponent.
    pub u_gamma: f64,
    /// Exponent with which the fringes were drawn, as level^(1/P).
    pub encoded_gamma: f64,
    /// The fringes as they arrived.
    pub fringes: FringeResponse,
    /// Level to project, 0 … 1; entry i of n belongs to the wanted level i / (n − 1).
    pub lut: LevelTable,
    /// Waveform of the recorded fringes by the fitted response.
    pub before: Waveform,
    /// The same with patterns drawn by the table.
    pub after: Waveform,
}

/// Evaluates and prints fringes.
pub fn run(args: &Args, seen: &ResponseFrames) -> Result<(FringeResult, PatternCorrection)> {
    let result = evaluate(args, seen).with_context(|| seen.source.clone())?;
    println!(
        "gamma {:.4}, u {:.4} (from fringes of {} px: {:.4} as drawn, offset {:.4}, gain {:.4}, residuals {:.4} rms)",
        result.gamma,
        result.u_gamma,
        result.fringes.pixels,
        result.fringes.gamma,
        result.fringes.offset,
        result.fringes.gain,
        result.fringes.residual_rms
    );
    for (name, wave) in [("as drawn", &result.before), ("with the table", &result.after)] {
        println!(
            "{name}: harmonics 2 … 5: {}; {}-step phase error {:.5} rad rms, {:.5} rad peak",
            percent(&wave.harmonics),
            wave.phase_error.steps,
            wave.phase_error.rms_rad,
            wave.phase_error.peak_rad
        );
    }
    let correction = correction(seen, TableSource::Fringes, result.gamma, None, result.lut.clone());
    Ok((result, correction))
}

fn evaluate(args: &Args, seen: &ResponseFrames) -> Result<FringeResult> {
    let [white, black] = seen.white_black.as_ref().context("no white and black")?;
    let steps: Vec<_> = seen.sine.iter().map(Frame::view).collect();
    let set = Fringes { steps: &steps, white: white.view(), black: black.view() };
    let fringes = FringeResponse::fit(&set, args.roi)?;
    let gamma = fringes.gamma * args.encoded_gamma;
    let lut = LevelTable::sample(1 << args.bits, |light| pow(light, 1.0 / gamma))?;
    let top = f64::from((1_u32 << args.bits) - 1);
    let rounded = |level: f64| (level * top).round() / top;
    let light = |level: f64| fringes.offset + fringes.gain * pow(level, gamma);
    Ok(FringeResult {
        method: "fringes",
        projector: seen.projector.clone(),
        camera: seen.camera.clone(),
        corrected: seen.corrected,
        gamma,
        u_gamma: fringes.u_gamma * args.encoded_gamma,
        encoded_gamma: args.encoded_gamma,
        before: Waveform::of(args.steps, |level| light(rounded(pow(level, 1.0 / args.encoded_gamma))))?,
        after: Waveform::of(args.steps, |level| light(rounded(lut.at(level))))?,
        fringes,
        lut,
    })
}
