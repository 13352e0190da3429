//! Output of the commands: printed lines and JSON.

use crate::software::FRINGETOOL;
use anyhow::Result;
use cell::executor::{Decoded, Expected, Threshold, median_valid};
use files::provenance::{Provenance, WithProvenance};
use fringe::decode::{CodeShift, Finding, Motion, NoiseSource};
use fringe::phase::PhaseMap;
use serde::Serialize;
use std::fmt;
use std::path::Path;

pub use files::output_check::{check_folder, check_outputs};

/// Writes the result as JSON to a file, or to standard output for `-`, with date and software under `provenance`.
pub fn emit<T: Serialize>(path: Option<&Path>, value: &T) -> Result<()> {
    emit_made_with(path, value, Provenance::now(&FRINGETOOL))
}

/// The same of a result that a rig or a plan stands behind.
pub fn emit_made_with<T: Serialize>(path: Option<&Path>, result: &T, provenance: Provenance) -> Result<()> {
    emit_bare(path, &WithProvenance { result, provenance })
}

/// The same without provenance: of a benchmark, whose result is a list.
pub fn emit_bare<T: Serialize>(path: Option<&Path>, value: &T) -> Result<()> {
    match path {
        Some(path) if cli::is_stdout(path) => cli::json(value)?,
        Some(path) => files::result::write_json(path, value)?,
        None => {}
    }
    Ok(())
}

/// A fault of frames that was found and made up for; sets and frames count from 1.
#[derive(Debug, Clone, Serialize)]
struct FoundFault {
    kind: &'static str,
    set: usize,
    frame: Option<usize>,
    text: String,
}

impl FoundFault {
    fn new(found: &Finding) -> Self {
        let frame = found.step.map(|step| step + 1);
        Self { kind: found.kind(), set: found.set + 1, frame, text: found.to_string() }
    }
}

/// What decoding one view along one axis gave.
#[derive(Debug, Clone, Serialize)]
pub struct DecodeLine {
    projector: String,
    camera: String,
    axis: fringe::pattern::Axis,
    period_px: f64,
    width_px: u32,
    height_px: u32,
    valid: usize,
    saturated: usize,
    recovered: usize,
    dark: usize,
    noisy: usize,
    ambiguous: usize,
    resolved: usize,
    spikes_repaired: usize,
    spikes_masked: usize,
    bounce_raised: usize,
    bounce_masked: usize,
    sigma_median_rad: Option<f32>,
    noise_read_variance_dn2: f64,
    noise_gain_dn: f64,
    noise_source: &'static str,
    footprint_px: Option<f64>,
    footprint_assumed: bool,
    contradiction: f64,
    wraps: usize,
    order_jumps: usize,
    #[serde(flatten)]
    expected: Expected,
    #[serde(flatten)]
    threshold: Option<Threshold>,
    exposures_best_of: Vec<usize>,
    findings: Vec<FoundFault>,
    ignored: Vec<String>,
    motion: Option<Motion>,
    code_shift: Option<CodeShift>,
    warnings: Vec<String>,
}

impl DecodeLine {
    /// Collects the figures of one decoded view.
    pub fn new(projector: &str, camera: &str, decoded: &Decoded) -> Self {
        let (map, report) = (&decoded.map, &decoded.report);
        Self {
            projector: projector.to_owned(),
            camera: camera.to_owned(),
            axis: map.info.axis,
            period_px: map.info.period_px,
            width_px: map.info.width_px,
            height_px: map.info.height_px,
            valid: report.valid,
            saturated: report.saturated,
            recovered: report.recovered,
            dark: report.dark,
            noisy: report.noisy,
            ambiguous: report.ambiguous,
            resolved: report.resolved,
            spikes_repaired: report.spikes_repaired,
            spikes_masked: report.spikes_masked,
            bounce_raised: report.bounced.raised,
            bounce_masked: report.bounced.masked,
            sigma_median_rad: median_sigma(map),
            noise_read_variance_dn2: report.noise.read_variance_dn2,
            noise_gain_dn: report.noise.gain_dn,
            noise_source: match report.noise.source {
                NoiseSource::Estimated { .. } => "estimated",
                NoiseSource::Settings => "settings",
                NoiseSource::Calibration => "calibration",
                NoiseSource::Assumed => "assumed",
            },
            footprint_px: report.footprint_px,
            footprint_assumed: report.footprint_assumed,
            contradiction: report.contradiction(),
            wraps: report.continuity.wraps,
            order_jumps: report.continuity.jumps,
            expected: decoded.expected,
            threshold: decoded.threshold,
            exposures_best_of: decoded.best_of.clone(),
            findings: report.findings.iter().map(FoundFault::new).collect(),
            ignored: report.ignored.to_vec(),
            motion: report.motion,
            code_shift: report.code_shift,
            warnings: report.warnings(camera),
        }
    }
}

impl fmt::Display for DecodeLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let total = self.width_px as usize * self.height_px as usize;
        write!(
            f,
            "{} / {} axis {:?}: {} of {total} px valid, phase noise {} mrad (median, noise {}); masked: {} dark, {} \
             saturated, {} noisy, {} of {} ambiguous",
            self.projector,
            self.camera,
            self.axis,
            self.valid,
            self.sigma_median_rad.map_or_else(|| "–".into(), |s| format!("{:.2}", s * 1e3)),
            self.noise_source,
            self.dark,
            self.saturated,
            self.noisy,
            self.ambiguous - self.resolved.min(self.ambiguous),
            self.ambiguous,
        )?;
        if let Some(footprint_px) = self.footprint_px {
            let assumed = if self.footprint_assumed { " (that of any lens: assumed)" } else { "" };
            write!(f, "; footprint {footprint_px:.3} px{assumed}")?;
        }
        // Less than one pixel in all is not reported.
        let Expected { wrong_orders_expected: wrong, wrong_orders_by_bits: by_bits, .. } = self.expected;
        if wrong >= 1.0 {
            write!(
                f,
                "; some {wrong:.0} wrong orders to be expected from the noise, {by_bits:.0} of them from bits"
            )?;
        }
        if let Some(Threshold {
            threshold_median_dn: level,
            u_threshold_median_dn: u,
            contrast_median_dn: half,
        }) = self.threshold
        {
            write!(f, "; black/white threshold {level:.1} DN, u {u:.2} DN, ± {half:.1} DN (medians)")?;
        }
        if !self.exposures_best_of.is_empty() {
            let list: Vec<String> = self.exposures_best_of.iter().map(ToString::to_string).collect();
            write!(f, "; pixels by exposure: {}", list.join(", "))?;
        }
        if self.recovered > 0 {
            write!(f, "; {} clipped in some frames and decoded from the others", self.recovered)?;
        }
        if self.bounce_raised + self.bounce_masked > 0 {
            let (raised, masked) = (self.bounce_raised, self.bounce_masked);
            write!(f, "; light from other faces: uncertainty raised at {raised} px, {masked} px masked")?;
        }
        let not_used = (!self.ignored.is_empty()).then(|| format!("not used: {}", self.ignored.join(", ")));
        let found = self.findings.iter().map(|found| found.text.clone());
        found.chain(not_used).chain(self.warnings.iter().cloned()).try_for_each(|text| write!(f, "; {text}"))
    }
}

fn median_sigma(map: &PhaseMap) -> Option<f32> {
    median_valid(map, map.sigma_rad.iter().copied())
}
