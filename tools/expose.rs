//! `fringetool expose`: finds the exposure time of each camera from what it sees of the patterns.

use crate::Outcome;
use crate::live::Live;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use cell::configuration::Driver;
use characterise::exposure::{ExposureState, SeenRange};
use devices::LoadedCell;
use files::atomic;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Exposure time that a twin has by its configuration, µs.
const TWIN_US: f64 = 10_000.0;

/// Exposure times that are tried, µs.
const EXPOSURES_US: std::ops::RangeInclusive<f64> = 10.0..=1e6;

#[derive(clap::Args)]
pub struct Args {
    /// Configuration of the cell, with a part in it.
    #[arg(value_name = "CONFIG")]
    config: PathBuf,
    /// Expose only this camera.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Exposure time to begin with, µs; by default that of the configuration, else 10 000.
    #[arg(long, value_name = "US")]
    start_us: Option<f64>,
    /// Most sequences that are shown.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=100))]
    rounds: u32,
    /// Write the configuration with the exposure times found to this file, in the folder of CONFIG.
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What was found for a camera.
#[derive(Debug, Clone, Serialize)]
struct Exposed {
    camera: String,
    /// Exposure time in the end, µs.
    exposure_us: f64,
    /// Whether the brightest pixels are where they should be.
    good: bool,
    /// Sequences that were shown.
    rounds: u32,
    /// What the camera saw at that time; null where no pixel is lit.
    seen: Option<ExposureState>,
    /// Exposure times for a part that is bright here and dark there, µs.
    proposed_us: Vec<f64>,
}

/// Shows the patterns again and again until each camera is exposed well. Exit code 1: a camera is not.
pub fn run(args: &Args) -> Result<Outcome> {
    if let Some(us) = args.start_us.filter(|us| !EXPOSURES_US.contains(us)) {
        bail!("--start-us {us}: must be {} to {} µs", EXPOSURES_US.start(), EXPOSURES_US.end());
    }
    let mut live = Live::open(&args.config, args.camera.as_deref())?;
    let outputs = [("--write", args.write.as_deref()), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &live.cell.file.paths(), None)?;
    if let Some(path) = &args.write {
        check_folder(path, &args.config)?;
        if let Some(twin) = live.cell.config.cameras.iter().find(|camera| camera.driver == Driver::Twin) {
            bail!(
                "--write {}: the exposure of the twin \"{}\" stands under [twin], settings = {{ exposure = … }}; multiply it with the time found over 10 000 µs",
                path.display(),
                twin.name
            );
        }
    }
    let mut exposed: Vec<(usize, Exposed)> = Vec::new();
    for (number, camera) in live.cameras() {
        let start_us = args.start_us.unwrap_or_else(|| configured_us(&live.cell, number));
        let exposure_us = live.set_exposure_us(number, start_us)?;
        let (good, rounds, seen, proposed_us) = (false, 0, None, Vec::new());
        exposed.push((number, Exposed { camera, exposure_us, good, rounds, seen, proposed_us }));
    }
    for _ in 0..args.rounds {
        let seen = look(&mut live)?;
        for (number, exposed) in exposed.iter_mut().filter(|(_, exposed)| !exposed.good) {
            exposed.rounds += 1;
            exposed.seen = seen.get(number).and_then(SeenRange::state);
            exposed.good = exposed.seen.is_some_and(|seen| seen.is_good());
        }
        if exposed.iter().all(|(_, exposed)| exposed.good) {
            break;
        }
        for (number, exposed) in exposed.iter_mut().filter(|(_, exposed)| !exposed.good) {
            // Nothing lit: the light may be there, and too weak.
            let factor = exposed.seen.map_or(4.0, |seen| seen.factor());
            let wanted_us = (exposed.exposure_us * factor).clamp(*EXPOSURES_US.start(), *EXPOSURES_US.end());
            if exposed.rounds < args.rounds {
                exposed.exposure_us = live.set_exposure_us(*number, wanted_us)?;
            }
        }
    }
    let mut cameras: Vec<Exposed> = exposed.into_iter().map(|(_, exposed)| exposed).collect();
    for camera in &mut cameras {
        camera.proposed_us = camera.seen.map_or(Vec::new(), |seen| seen.several_us(camera.exposure_us));
        print(camera);
    }
    if let Some(path) = &args.write {
        let times = cameras.iter().map(|camera| (camera.camera.clone(), camera.exposure_us)).collect();
        write(path, &live.cell, &times)?;
        println!("{}", path.display());
    }
    let good = cameras.iter().all(|camera| camera.good);
    emit(args.json.as_deref(), &serde_json::json!({ "good": good, "cameras": cameras }))?;
    Ok(if good { Outcome::Done } else { Outcome::LimitFailed })
}

fn configured_us(cell: &LoadedCell, camera: usize) -> f64 {
    cell.config.cameras[camera].genicam.as_ref().and_then(|genicam| genicam.exposure_us).unwrap_or(TWIN_US)
}

/// Shows all projectors; the range of each pixel of each camera.
fn look(live: &mut Live) -> Result<BTreeMap<usize, SeenRange>> {
    let mut seen = BTreeMap::new();
    for projector in 0..live.cell.graph.projectors.len() {
        let frames = live.cell.graph.projectors[projector].frames;
        live.show(projector, 0..frames, |camera, _, frame| {
            let range =
                seen.entry(camera).or_insert_with(|| SeenRange::new(frame.pixels.len(), frame.full_scale_dn));
            range.take(&frame);
            Ok(())
        })?;
    }
    Ok(seen)
}

fn print(exposed: &Exposed) {
    let Exposed { camera, exposure_us, good, rounds, seen, proposed_us } = exposed;
    let Some(seen) = seen else {
        println!(
            "{camera}: no pixel sees the patterns, up to {exposure_us:.0} µs; is the part in place, the lens open, the projector on?"
        );
        return;
    };
    let state = if *good { "good" } else { "NOT GOOD" };
    println!(
        "{camera}: {exposure_us:.0} µs, {state} after {rounds} rounds; {:.0} % of the pixels lit, of these {:.2} % clipped, {:.0} % weak; brightest {:.0} %, \
         modulation {:.0} % of full scale (median)",
        100.0 * seen.lit_fraction,
        100.0 * seen.clipped_fraction,
        100.0 * seen.weak_fraction,
        100.0 * seen.brightest,
        100.0 * seen.modulation_median
    );
    if proposed_us.len() > 1 {
        let list: Vec<String> = proposed_us.iter().map(|us| format!("{us:.0}")).collect();
        println!(
            "{camera}: bright here and dark there; several exposures would measure more: {} µs",
            list.join(", ")
        );
    }
}

/// Paths in a configuration are relative to its folder.
fn check_folder(path: &Path, config: &Path) -> Result<()> {
    let folder = |path: &Path| {
        let parent = path.parent().filter(|parent| *parent != Path::new("")).unwrap_or(Path::new("."));
        parent.canonicalize().with_context(|| format!("{}: the folder", path.display()))
    };
    if folder(path)? != folder(config)? {
        bail!(
            "--write {}: must lie in the folder of {}, whose paths are relative",
            path.display(),
            config.display()
        );
    }
    Ok(())
}

/// Writes the text of the configuration with the times of its cameras; everything else stays as it is.
fn write(path: &Path, cell: &LoadedCell, times: &BTreeMap<String, f64>) -> Result<()> {
    let text = with_exposures(&cell.file.document.text, times);
    Ok(atomic::write(path, text.as_bytes())?)
}

/// Sets `exposure_us` of the cameras in the text of a configuration.
fn with_exposures(text: &str, times: &BTreeMap<String, f64>) -> String {
    let lines: Vec<&str> = text.lines().collect();
    let heads = lines.iter().enumerate().filter(|(_, line)| line.trim().starts_with('['));
    let mut heads: Vec<usize> = heads.map(|(number, _)| number).collect();
    heads.push(lines.len());
    let mut written: Vec<String> = lines[..heads[0]].iter().map(|line| (*line).to_owned()).collect();
    for block in heads.windows(2).map(|ends| &lines[ends[0]..ends[1]]) {
        let value = |key: &str| {
            let pairs = block.iter().filter_map(|line| line.split_once('='));
            pairs.map(|(found, value)| (found.trim(), value.trim())).find(|(found, _)| *found == key)
        };
        let name = value("name").and_then(|(_, text)| text.split(['"', '\'']).nth(1));
        let us = name.filter(|_| block[0].trim().starts_with("[[camera]]")).and_then(|name| times.get(name));
        for line in block {
            let key = line.split_once('=').map(|(key, _)| key.trim());
            if us.is_some() && key == Some("exposure_us") {
                continue;
            }
            written.push((*line).to_owned());
            if let Some(us) = us.filter(|_| key == Some("name")) {
                written.push(format!("exposure_us = {us:?}"));
            }
        }
    }
    written.join("\n") + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_are_written_into_the_text_and_nothing_else_changes() {
        let text = "name = \"cell\"\n[[camera]]\nname = \"cam1\" # left\ndriver = \"genicam\"\nexposure_us = 5.0\n\n[[camera]]\nexposure_us = 7.0\nname = \"cam2\"\n[twin]\nname = 1\n";
        let times = BTreeMap::from([("cam1".to_owned(), 12_500.0)]);
        let expected = "name = \"cell\"\n[[camera]]\nname = \"cam1\" # left\nexposure_us = 12500.0\ndriver = \"genicam\"\n\n[[camera]]\nexposure_us = 7.0\nname = \"cam2\"\n[twin]\nname = 1\n";
        assert_eq!(with_exposures(text, &times), expected);
    }
}
