//! The response from grey levels.

use super::input::ResponseFrames;
use super::{Args, Inverts, Waveform, correction, percent};
use anyhow::{Context, Result};
use characterise::response::recorded::{RecordedWaveform, analyse};
use characterise::response::{COEFFICIENTS, GreyLevel, InversePolynomial, PowerLaw, ResponseCurve, Roi};
use files::correction::{PatternCorrection, TableSource};
use fringe::frame::Frame;
use fringe::pattern::LevelTable;
use serde::Serialize;

/// The result; the keys are those of the JSON file.
#[derive(Debug, Serialize)]
pub struct LevelResult {
    /// How it was measured.
    pub method: &'static str,
    /// Which projector, if it has a name.
    pub projector: Option<String>,
    /// Which camera, if it has a name.
    pub camera: Option<String>,
    /// Whether the patterns were drawn corrected.
    pub corrected: bool,
    /// Evaluated region of the image.
    pub roi: Roi,
    /// Pixels of the region.
    pub pixels: u64,
    /// Of these, left out because they saturate at some level.
    pub saturated_pixels: usize,
    /// Measured levels, in rising order.
    pub levels: Vec<GreyLevel>,
    /// γ of eq. 3.1.
    pub gamma: f64,
    /// Standard uncertainty of the exponent.
    pub u_gamma: f64,
    /// Power law, eq. 3.1 of the thesis.
    pub power_law: PowerLaw,
    /// Inverse polynomial, eq. 3.2 of the thesis.
    pub polynomial: InversePolynomial,
    /// Standard uncertainties of its coefficients.
    pub u_coefficients: [f64; COEFFICIENTS],
    /// What the table inverts.
    pub table_source: &'static str,
    /// Level to project, 0 … 1; entry i of n belongs to the wanted level i / (n − 1).
    pub lut: LevelTable,
    /// As the measured response predicts it, drawn without correction.
    pub before: Waveform,
    /// Drawn with the table.
    pub after: Waveform,
    /// Drawn with the table of the measured response.
    pub after_response: Waveform,
    /// Drawn with the table of the polynomial.
    pub after_polynomial: Waveform,
    /// As recorded fringes show it, drawn as they were.
    pub recorded: Option<RecordedWaveform>,
}

/// Evaluates and prints grey levels.
pub fn run(args: &Args, seen: &ResponseFrames) -> Result<(LevelResult, PatternCorrection)> {
    let result = evaluate(args, seen).with_context(|| seen.source.clone())?;
    print(&result);
    let source = match args.table {
        Inverts::Response => TableSource::Response,
        Inverts::Polynomial => TableSource::InversePolynomial,
    };
    let coefficients = Some(result.polynomial.coefficients.to_vec());
    let correction = correction(seen, source, result.gamma, coefficients, result.lut.clone());
    Ok((result, correction))
}

fn evaluate(args: &Args, seen: &ResponseFrames) -> Result<LevelResult> {
    let stack = seen.stack.as_ref().context("no grey levels")?;
    let levels = stack.levels()?;
    let curve = ResponseCurve::new(&levels, stack.full_scale_dn())?;
    let power_law = PowerLaw::fit(&levels)?;
    let polynomial = InversePolynomial::fit(&levels, curve.range_dn())?;
    let entries = 1_usize << args.bits;
    let by_response = LevelTable::sample(entries, |light| curve.level(light))?;
    let by_polynomial = LevelTable::sample(entries, |light| polynomial.level(light))?;
    let steps = f64::from((1_u32 << args.bits) - 1);
    let drawn = |level: f64| curve.light((level * steps).round() / steps);
    let after_response = Waveform::of(args.steps, |level| drawn(by_response.at(level)))?;
    let after_polynomial = Waveform::of(args.steps, |level| drawn(by_polynomial.at(level)))?;
    let (table_source, lut, after) = match args.table {
        Inverts::Response => (TableSource::Response, by_response, after_response),
        Inverts::Polynomial => (TableSource::InversePolynomial, by_polynomial, after_polynomial),
    };
    Ok(LevelResult {
        method: "grey-levels",
        projector: seen.projector.clone(),
        camera: seen.camera.clone(),
        corrected: seen.corrected,
        roi: stack.roi(),
        pixels: stack.roi().pixels(),
        saturated_pixels: stack.saturated_pixels(),
        gamma: power_law.gamma,
        u_gamma: power_law.u_gamma,
        power_law,
        u_coefficients: polynomial.u_coefficients(),
        polynomial,
        table_source: table_source.name(),
        lut,
        before: Waveform::of(args.steps, drawn)?,
        after,
        after_response,
        after_polynomial,
        recorded: recorded(args, &seen.sine)?,
        levels,
    })
}

/// Fringes recorded with the grey levels, where there are enough steps to determine more than their phase.
fn recorded(args: &Args, sine: &[Frame]) -> Result<Option<RecordedWaveform>> {
    if sine.is_empty() {
        return Ok(None);
    }
    let views: Vec<_> = sine.iter().map(Frame::view).collect();
    Ok(Some(analyse(&views, args.roi, args.steps).context("fringes")?))
}

fn print(result: &LevelResult) {
    let of = |name: &Option<String>| name.clone().unwrap_or_else(|| "–".into());
    println!(
        "{} / {}: {} levels, region {} ({} px, {} saturated left out), {:.2} … {:.2} DN",
        of(&result.projector),
        of(&result.camera),
        result.levels.len(),
        result.roi,
        result.pixels,
        result.saturated_pixels,
        result.levels.first().map_or(f64::NAN, |g| g.mean_dn),
        result.levels.last().map_or(f64::NAN, |g| g.mean_dn),
    );
    println!(
        "gamma {:.4}, u {:.4} (eq. 3.1, residuals {:.3} DN rms)",
        result.gamma, result.u_gamma, result.power_law.residual_rms_dn
    );
    let coefficients: Vec<String> =
        result.polynomial.coefficients.iter().map(|a| format!("{a:.5}")).collect();
    println!("inverse polynomial (eq. 3.2), a0 … a7: {}", coefficients.join(", "));
    println!(
        "  residuals {:.5} rms, {:.5} largest (level 0 … 1){}",
        result.polynomial.residual_rms,
        result.polynomial.residual_max,
        if result.polynomial.monotonic { "" } else { "; it falls somewhere, the table does not" }
    );
    let rows = [
        ("as drawn", &result.before),
        ("table of the response", &result.after_response),
        ("table of the polynomial", &result.after_polynomial),
    ];
    for (name, wave) in rows {
        println!(
            "{name}: harmonics 2 … 5: {}; {}-step phase error {:.5} rad rms, {:.5} rad peak",
            percent(&wave.harmonics),
            wave.phase_error.steps,
            wave.phase_error.rms_rad,
            wave.phase_error.peak_rad
        );
    }
    if let Some(recorded) = &result.recorded {
        print_recorded(recorded);
    }
}

fn print_recorded(recorded: &RecordedWaveform) {
    let shown: Vec<f64> = recorded.harmonics.iter().copied().map_while(|h| h).collect();
    print!(
        "recorded fringes, {} steps, {} px: harmonics from 2: {}",
        recorded.steps_recorded,
        recorded.pixels,
        percent(&shown)
    );
    match &recorded.phase_error {
        Some(error) => println!(
            "; {}-step phase error {:.5} rad rms, {:.5} rad peak",
            error.steps, error.rms_rad, error.peak_rad
        ),
        None => println!("; record at least twice --steps, and a multiple of it, to see the phase error"),
    }
}
