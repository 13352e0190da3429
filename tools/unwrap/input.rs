//! Wrapped phases: from a file, or from the finest sine set of each axis of a recording.

use crate::pipeline::RecordedView;
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use files::npy::{self, Raster};
use files::recording::{RecordedCamera, RecordedProjector, Recording};
use fringe::decode::DecodeSettings;
use fringe::math::{atan2, sincos};
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::{PhaseInfo, PhaseMap};
use std::f64::consts::TAU;
use std::path::Path;

/// Columns and rows of a projector that a single period covers.
const WIDE_PX: u32 = 1 << 20;

/// A wrapped phase and where it comes from.
pub struct Item {
    /// For the names of files: `proj1-cam1-x`.
    pub name: String,
    /// Recording, camera and axis, for messages.
    pub place: String,
    /// Phase within 0 … 2π.
    pub map: PhaseMap,
    /// Whether the modulation is known.
    pub measured: bool,
    /// The absolute phase from the code, where it is the anchor.
    pub coded: Option<PhaseMap>,
}

/// Unit of a phase from a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum PhaseUnit {
    /// Radians: one period is 2π.
    Rad,
    /// Degrees: one period is 360.
    Deg,
    /// Whole turns: one period is 1.
    Turn,
}

/// Room for rounding to single precision at the ends of a turn, rad.
const ROUNDING_RAD: f32 = 1e-4;

/// Neighbours of a phase in turns differ by as much where it wraps.
const TURN_JUMP: f32 = 0.9;

/// A phase from a file, in `unit`; without one it must lie within one turn of radians, -π … π or 0 … 2π.
pub fn file(path: &Path, unit: Option<PhaseUnit>) -> Result<Item> {
    let mut raster = npy::read(path)?;
    if let Some(unit) = unit {
        to_one_turn(&mut raster.values, unit);
    } else {
        within_one_turn(path, &raster.values)?;
        no_turns(path, &raster)?;
    }
    let info =
        PhaseInfo { width_px: raster.width_px, height_px: raster.height_px, axis: Axis::X, period_px: 1.0 };
    let mut map = PhaseMap::new(info);
    for (valid, phase_rad) in map.valid.iter_mut().zip(&raster.values) {
        *valid = u8::from(phase_rad.is_finite());
    }
    map.phase_rad = raster.values;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Item { name, place: path.display().to_string(), map, measured: false, coded: None })
}

/// In radians, 0 … 2π.
fn to_one_turn(values: &mut [f32], unit: PhaseUnit) {
    let turn = match unit {
        PhaseUnit::Rad => TAU,
        PhaseUnit::Deg => 360.0,
        PhaseUnit::Turn => 1.0,
    };
    for value in values {
        let turns = f64::from(*value) / turn;
        *value = ((turns - turns.floor()) * TAU) as f32;
    }
}

fn within_one_turn(path: &Path, values: &[f32]) -> Result<()> {
    let finite = || values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = (finite().fold(f32::INFINITY, f32::min), finite().fold(f32::NEG_INFINITY, f32::max));
    let (pi, tau) = (std::f32::consts::PI + ROUNDING_RAD, std::f32::consts::TAU + ROUNDING_RAD);
    if low > high || (low >= -pi && high <= pi) || (low >= -ROUNDING_RAD && high <= tau) {
        return Ok(());
    }
    bail!(
        "{}: its phase reaches from {low} to {high}, a wrapped phase in radians lies within -π … π or 0 … 2π; say --phase-unit \
         deg or turn for another unit, or --phase-unit rad to take radians modulo 2π",
        path.display()
    )
}

/// Refuses what lies within radians and jumps as whole turns do: from one end of a range of 1 to the other.
fn no_turns(path: &Path, raster: &Raster) -> Result<()> {
    let finite = || raster.values.iter().copied().filter(|v| v.is_finite());
    let (low, high) = (finite().fold(f32::INFINITY, f32::min), finite().fold(f32::NEG_INFINITY, f32::max));
    let of_turns = |least: f32| low >= least - ROUNDING_RAD && high <= least + 1.0 + ROUNDING_RAD;
    let width = raster.width_px as usize;
    let jumps = || {
        let rows = raster.values.chunks(width.max(1)).flat_map(|row| row.windows(2).map(|w| w[1] - w[0]));
        let columns = raster.values.iter().zip(raster.values.iter().skip(width)).map(|(a, b)| b - a);
        rows.chain(columns).any(|d| d.abs() > TURN_JUMP)
    };
    if high - low > TURN_JUMP && (of_turns(0.0) || of_turns(-0.5)) && jumps() {
        bail!(
            "{}: its phase reaches from {low} to {high} and jumps by nearly one, as whole turns do; say --phase-unit turn, or \
             --phase-unit rad where it is radians all the same",
            path.display()
        );
    }
    Ok(())
}

/// An absolute phase from a file.
pub fn anchor(path: &Path) -> Result<Raster> {
    Ok(npy::read(path)?)
}

/// Refuses a map with nothing to unwrap.
pub fn has_phase(item: &Item) -> Result<()> {
    if item.map.valid.contains(&1) {
        return Ok(());
    }
    let remedy = if item.measured {
        "are there fringes on the object? leave the view out with --projector and --camera"
    } else {
        "all its values are NaN or infinite; is this the right file?"
    };
    bail!("{}: has no valid pixel, so there is nothing to unwrap; {remedy}", item.place)
}

/// Refuses an anchor that knows no pixel of a phase.
pub fn reaches(absolute_rad: &[f32], item: &Item, anchor: &str) -> Result<()> {
    if absolute_rad.iter().zip(&item.map.valid).any(|(phase, valid)| *valid == 1 && phase.is_finite()) {
        return Ok(());
    }
    bail!(
        "--anchor {anchor}: has no finite value at a valid pixel of {}; give another anchor, or none",
        item.place
    )
}

/// How far an anchor lies beside the phase in the mean, whole turns taken off, rad; `None` where its pixels do not agree on that, as those of a coarse code.
pub fn beside(absolute_rad: &[f32], item: &Item) -> Option<f64> {
    let both = absolute_rad.iter().zip(&item.map.phase_rad).zip(&item.map.valid);
    let known = both.filter(|((anchor, _), valid)| **valid == 1 && anchor.is_finite());
    let (mut sin, mut cos, mut count) = (0.0, 0.0, 0.0);
    for ((anchor, phase), _) in known {
        let (s, c) = sincos(f64::from(*anchor) - f64::from(*phase));
        (sin, cos, count) = (sin + s, cos + c, count + 1.0);
    }
    // Spread evenly over a turn the mean of the unit vectors is zero, all alike it is one.
    (sin * sin + cos * cos > 0.25 * count * count).then(|| atan2(sin, cos))
}

/// The values of an anchor that is as large as the phase.
pub fn fitting<'a>(anchor: &'a Raster, item: &Item, path: &Path) -> Result<&'a [f32]> {
    let info = &item.map.info;
    if (anchor.width_px, anchor.height_px) != (info.width_px, info.height_px) {
        bail!(
            "--anchor {}: has {} × {} px, {} has {} × {} px; they must be of one size",
            path.display(),
            anchor.width_px,
            anchor.height_px,
            item.place,
            info.width_px,
            info.height_px
        );
    }
    Ok(&anchor.values)
}

/// The wrapped phase of each view and axis of a recording.
pub fn recording(
    folder: &Path,
    projector: Option<&str>,
    camera: Option<&str>,
    coded: bool,
) -> Result<Vec<Item>> {
    let recording = Recording::open(folder)?;
    let asked = |wanted: Option<&str>, name: &str| wanted.is_none_or(|wanted| wanted == name);
    let views: Vec<(&RecordedProjector, &RecordedCamera)> = recording
        .projectors
        .iter()
        .filter(|p| asked(projector, &p.name))
        .flat_map(|p| p.cameras.iter().filter(|c| asked(camera, &c.name)).map(move |c| (p, c)))
        .collect();
    if views.is_empty() {
        bail!("{}: no view of that --projector and --camera", recording.document.path.display());
    }
    let frames: usize = views.iter().map(|(_, camera)| camera.frames.len()).sum();
    let mut progress = Progress::new(if coded { 2 * frames } else { frames }, "decoding");
    let mut items = Vec::new();
    for (projector, camera) in views {
        let before = items.len();
        for axis in [Axis::X, Axis::Y] {
            if let Some(number) = finest(&projector.sequence, axis) {
                items.push(item(&recording, (projector, camera), (axis, number), coded, &mut progress)?);
            }
        }
        if items.len() == before {
            bail!(
                "{}: projector \"{}\" has no sine set; there is no phase to unwrap",
                recording.document.path.display(),
                projector.name
            );
        }
    }
    Ok(items)
}

/// The sine set with the shortest period.
fn finest(sequence: &[PatternSet], axis: Axis) -> Option<usize> {
    let period = |set: &PatternSet| match set {
        PatternSet::Sine { axis: of, period_px, .. } if *of == axis => Some(*period_px),
        _ => None,
    };
    let sines = sequence.iter().enumerate().filter_map(|(i, set)| Some((period(set)?, i)));
    sines.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, i)| i)
}

fn item(
    recording: &Recording,
    (projector, camera): (&RecordedProjector, &RecordedCamera),
    (axis, number): (Axis, usize),
    coded: bool,
    progress: &mut Progress,
) -> Result<Item> {
    let set = &projector.sequence[number];
    let first: usize = projector.sequence[..number].iter().map(PatternSet::frames).sum();
    // As if a single period covered the projector: the phase within it is then the wrapped
    // phase. So wide a period that the projector's margin, half a pixel, masks no phase.
    let mut one = set.clone();
    let PatternSet::Sine { period_px: wide_px, .. } = &mut one else {
        bail!("set {number} is not a sine set")
    };
    let period_px = std::mem::replace(wide_px, f64::from(WIDE_PX));
    // Every wrap looks like a jump of the order there, and is none.
    let open = DecodeSettings { max_contradiction: 1.0, repair_spikes: false, ..DecodeSettings::default() };
    let mut decode = |sets: &[PatternSet], frames, extent_px, settings: &DecodeSettings| {
        let mut step = || progress.step();
        let view = RecordedView { recording, projector, camera };
        let maps = view.decode_sets((sets, frames), extent_px, settings, &mut step)?;
        maps.into_iter().map(|decoded| decoded.map).find(|map| map.info.axis == axis).with_context(|| {
            format!("projector \"{}\", camera \"{}\": no phase along {axis:?}", projector.name, camera.name)
        })
    };
    let mut map = decode(&[one], first..first + set.frames(), [WIDE_PX; 2], &open)?;
    map.info.period_px = period_px;
    let coded = coded
        .then(|| {
            let extent_px = [projector.width_px, projector.height_px];
            decode(&projector.sequence, 0..camera.frames.len(), extent_px, &DecodeSettings::default())
        })
        .transpose()
        .context("--anchor code")?;
    let axis = if axis == Axis::X { "x" } else { "y" };
    let name = format!("{}-{}-{axis}", projector.name, camera.name);
    let place = format!("{}: {name}", recording.folder.display());
    Ok(Item { name, place, map, measured: true, coded })
}
