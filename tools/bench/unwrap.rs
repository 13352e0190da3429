//! Spatial unwrapping on maps whose answer is known: wrong pixels and time of every method. The maps are written, so that
//! another program can be compared with them.

use super::scan::decode as decode_scan;
use crate::Outcome;
use crate::bundled;
use crate::pipeline::decode_views;
use crate::report::{check_outputs, emit_bare};
use crate::simulate::load_scene;
use crate::unwrap::Name;
use anyhow::{Context, Result};
use files::npy::{self, Raster};
use files::recording::Recording;
use fringe::decode::DecodeSettings;
use fringe::math;
use fringe::math::random::{Key, Normal};
use fringe::math::statistics::median;
use fringe::unwrap::{NO_COMPONENT, QualityMap, UnwrapSettings, Wrapped, unwrap};
use ipc::os::Usage;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::time::Instant;
use twin::{Twin, TwinSettings};

#[derive(clap::Args)]
pub struct Args {
    /// Folder to write the maps to: `<map>-wrapped.npy` and `<map>-truth.npy`, rad, NaN where masked.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Recordings with a code as further maps (docs/formats.md): their absolute phase is the truth.
    #[arg(long = "recording", value_name = "DIR")]
    recordings: Vec<PathBuf>,
    /// Side of the synthetic maps, px.
    #[arg(long, value_name = "PX", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(16..=8192))]
    side_px: u32,
    /// Number of repeats of each measurement; the median time is reported.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A map and its answer.
struct Map {
    name: String,
    width: usize,
    /// Absolute phase, rad; NaN where masked.
    truth: Vec<f32>,
    modulation: Option<Vec<f32>>,
}

/// One row of the table.
#[derive(Serialize)]
struct Row {
    map: String,
    method: &'static str,
    valid: usize,
    components: usize,
    /// Pixels whose whole turns differ from those of most of their component.
    wrong: usize,
    time_ms: f64,
    /// Processor time of all threads: what a busy machine does not change.
    processor_ms: f64,
    ms_per_megapixel: f64,
}

/// Runs the benchmark, prints its table and writes the result.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[], args.out.as_deref())?;
    let mut maps = synthetic(args.side_px as usize);
    maps.push(demo()?);
    for folder in &args.recordings {
        maps.extend(recorded(folder)?);
    }
    if let Some(folder) = &args.out {
        files::atomic::create_dir(folder)?;
        maps.iter().try_for_each(|map| map.write(folder))?;
    }
    let mut rows = Vec::new();
    for map in &maps {
        for method in Name::ALL {
            let row = map.measure(method, args.repeats)?;
            println!(
                "{:30} {:22} {:8} valid, {:6} components, {:7} wrong, {:9.1} ms, processor {:9.1} ms",
                row.map, row.method, row.valid, row.components, row.wrong, row.time_ms, row.processor_ms
            );
            rows.push(row);
        }
    }
    emit_bare(args.json.as_deref(), &rows)?;
    Ok(Outcome::Done)
}

impl Map {
    fn wrapped(&self) -> Vec<f32> {
        self.truth
            .iter()
            .map(|t| if t.is_nan() { *t } else { math::wrap_rad(f64::from(*t)) as f32 })
            .collect()
    }

    fn write(&self, folder: &Path) -> Result<()> {
        let raster = |values: Vec<f32>| Raster {
            width_px: self.width as u32,
            height_px: (values.len() / self.width) as u32,
            values,
        };
        npy::write(&folder.join(format!("{}-wrapped.npy", self.name)), &raster(self.wrapped()))?;
        Ok(npy::write(&folder.join(format!("{}-truth.npy", self.name)), &raster(self.truth.clone()))?)
    }

    fn measure(&self, method: Name, repeats: u32) -> Result<Row> {
        let phase_rad = self.wrapped();
        let valid: Vec<u8> = phase_rad.iter().map(|p| u8::from(p.is_finite())).collect();
        let wrapped = Wrapped {
            width_px: self.width as u32,
            height_px: (phase_rad.len() / self.width) as u32,
            phase_rad: &phase_rad,
            valid: &valid,
            modulation: self.modulation.as_deref(),
        };
        let settings = UnwrapSettings::new(method.method(QualityMap::PhaseDerivativeVariance));
        let (mut times, mut processor) = (Vec::new(), Vec::new());
        let mut last = None;
        for _ in 0..repeats {
            let (start, usage) = (Instant::now(), Usage::now());
            last = Some(unwrap(&wrapped, None, &settings).with_context(|| self.name.clone())?);
            times.push(start.elapsed().as_secs_f64() * 1e3);
            processor.push(Usage::now().since(usage).cpu_ns as f64 * 1e-6);
        }
        let found = last.context("at least one repeat")?;
        let of = |values: &mut [f64]| median(values).unwrap_or(f64::NAN);
        let (time_ms, processor_ms) = (of(&mut times), of(&mut processor));
        Ok(Row {
            map: self.name.clone(),
            method: method.name(),
            valid: found.report.valid,
            components: found.report.components.len(),
            wrong: self.wrong(&found.phase_rad, &found.component),
            time_ms,
            processor_ms,
            ms_per_megapixel: time_ms * 1e6 / phase_rad.len() as f64,
        })
    }

    fn wrong(&self, phase_rad: &[f32], component: &[u32]) -> usize {
        let mut off: Vec<(u32, i32)> = (0..phase_rad.len())
            .filter(|i| component[*i] != NO_COMPONENT)
            .map(|i| {
                let turns = (f64::from(phase_rad[i]) - f64::from(self.truth[i])) / TAU;
                (component[i], turns.round() as i32)
            })
            .collect();
        off.sort_unstable();
        let right = |group: &[(u32, i32)]| group.chunk_by(|a, b| a == b).map(<[_]>::len).max().unwrap_or(0);
        off.chunk_by(|a, b| a.0 == b.0).map(|group| group.len() - right(group)).sum()
    }
}

/// A hill without and with noise, a step that ends within the map, and a hill with holes and noise.
fn synthetic(side: usize) -> Vec<Map> {
    let unit = move |i: usize| (2.0 * i as f64 / side as f64) - 1.0;
    let hill = move |x: f64, y: f64| 120.0 * math::exp(-3.0 * (x * x + y * y)) + 25.0 * x;
    let normal = Normal::default();
    let map = |name: &str, seed: u64, sigma_rad: f64, shape: &dyn Fn(f64, f64) -> f64| {
        let value = |i: usize| {
            let noise = sigma_rad * f64::from(normal.draw(Key::new(seed).bits(i as u64)));
            (shape(unit(i % side), unit(i / side)) + noise) as f32
        };
        Map { name: name.into(), width: side, truth: (0..side * side).map(value).collect(), modulation: None }
    };
    // A step whose height grows from zero to ten periods: near half a period its order is undetermined.
    let fault = move |x: f64, y: f64| hill(x, y) + if x > 0.0 && y > 0.0 { 10.0 * TAU * y } else { 0.0 };
    let hole = |x: f64, y: f64| {
        let ring = (x * x + y * y).sqrt();
        if (0.3..0.35).contains(&ring) && y > -0.2 || math::sin(9.0 * x) * math::sin(7.0 * y) > 0.8 {
            f64::NAN
        } else {
            hill(x, y)
        }
    };
    vec![
        map("smooth", 1, 0.0, &hill),
        map("noise-0.3", 2, 0.3, &hill),
        map("noise-0.8", 3, 0.8, &hill),
        map("fault-noise-0.1", 4, 0.1, &fault),
        map("masked-noise-0.5", 5, 0.5, &hole),
    ]
}

/// The thesis' part on the twin of the demo cell.
fn demo() -> Result<Map> {
    let config = bundled::load("configs/demo.toml")?;
    let scene = load_scene(None, config.twin.as_ref().context("configs/demo.toml: has no [twin]")?)?;
    let rig = twin::thesis::rig(1124, 750);
    let twin = Twin::new(&scene, TwinSettings::default(), &rig)?;
    let maps = decode_scan(&twin, "cam1", "proj1", &rig, &twin::thesis::sequence(), 0)?;
    let map = maps.into_iter().next().context("one axis was decoded")?;
    let truth = map.phase_rad.iter().zip(&map.valid).map(|(p, v)| if *v == 1 { *p } else { f32::NAN });
    Ok(Map {
        name: "twin-artefact".into(),
        width: 1124,
        truth: truth.collect(),
        modulation: Some(map.modulation),
    })
}

fn recorded(folder: &Path) -> Result<Vec<Map>> {
    let recording = Recording::open(folder)?;
    let views = decode_views(&recording, &DecodeSettings::default(), &BTreeMap::new(), |_, _| true)?;
    let stem = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let maps = views.into_iter().flat_map(|view| {
        let place = format!("{stem}-{}-{}", view.projector, view.camera);
        view.maps.into_iter().map(move |decoded| {
            let map = decoded.map;
            let truth =
                map.phase_rad.iter().zip(&map.valid).map(|(p, v)| if *v == 1 { *p } else { f32::NAN });
            Map {
                name: format!("{place}-{:?}", map.info.axis).to_lowercase(),
                width: map.info.width_px as usize,
                truth: truth.collect(),
                modulation: Some(map.modulation.clone()),
            }
        })
    });
    Ok(maps.collect())
}
