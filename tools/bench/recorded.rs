//! Phase methods on real frames, where no truth is known: each method gets some of the steps and is compared with the phase of
//! all steps, or with another recording of the same scene.
//!
//! The difference shows what the method adds: its noise, the harmonics that its number of steps lets through, what it
//! loses at edges. It cannot show what all frames have in common (the lens, interreflections, harmonics of the orders N ± 1 of all N
//! steps). The quality of the reference itself is estimated from its two halves: the even and the odd steps are different frames.

use super::shown::{Cell, Evaluated, Taken, counting};
use crate::progress::Progress;
use anyhow::{Context, Result, anyhow, bail};
use cell::executor::PhaseMethod;
use files::recording::Recording;
use fringe::decode::{DecodeSettings, OrderMethod};
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::PhaseMap;
use fringe::wrapped::Method;
use serde::Serialize;
use std::f64::consts::TAU;
use std::path::Path;

/// Which steps of each sine set a method is given.
#[derive(Clone, Copy)]
enum Steps {
    /// All steps of the set.
    All,
    /// So many, evenly spread, beginning with one.
    Even(usize, usize),
    /// So many, 90° apart.
    Quarters(usize),
    /// Five at unequal distances.
    Uneven,
}

/// A row of the table.
pub struct Row {
    /// Name as printed in the table.
    pub name: &'static str,
    steps: Steps,
    settings: DecodeSettings,
    method: PhaseMethod,
    /// The Gray code without its last bit.
    whole_stripes: bool,
}

/// A column of the table: what stands as reference.
#[derive(Serialize)]
pub struct Reference {
    /// Recording, camera and axis.
    pub case: String,
    /// What the reference is, for the output.
    kind: String,
    /// Number of valid pixels.
    valid: usize,
    /// Root mean square of its stated uncertainty, rad of the finest sine.
    stated_rad: f64,
    /// Half the root mean square difference of the phases of the even and the odd steps, rad; `None` below six steps.
    halves_rad: Option<f64>,
}

/// All rows of a view.
pub struct View {
    taken: Taken,
    axis: Axis,
    map: PhaseMap,
    /// What is known of the reference.
    pub reference: Reference,
}

/// Methods and orders, each of which a recording may allow or not.
pub fn rows() -> Vec<Row> {
    let row = |name, steps, method| Row { name, steps, settings: counting(), method, whole_stripes: false };
    let own = PhaseMethod::default();
    let by = |method| PhaseMethod { method: Some(method), ..own };
    let order = |name, order, fuse| Row {
        name,
        steps: Steps::All,
        settings: DecodeSettings { order, fuse, ..counting() },
        method: own,
        whole_stripes: false,
    };
    let three = Steps::Even(3, 0);
    vec![
        row("6 steps", Steps::Even(6, 0), own),
        row("4 steps", Steps::Even(4, 0), own),
        row("5 uneven steps", Steps::Uneven, own),
        row("3 steps", three, own),
        row("three-step", three, by(Method::ThreeStep)),
        row("3 steps, harmonics removed", three, PhaseMethod { remove_harmonics: true, ..own }),
        row("3 steps, windowed filter", three, PhaseMethod { window_px: Some(4.0), ..own }),
        row("Carré", Steps::Quarters(4), by(Method::Carre)),
        row("Hariharan", Steps::Quarters(5), by(Method::Hariharan)),
        row("Fourier, rows", three, by(Method::FourierRows)),
        row("Fourier, plane", three, by(Method::Fourier)),
        order("all steps, Gray", OrderMethod::Gray, false),
        Row { whole_stripes: true, ..order("all steps, Gray, last bit left out", OrderMethod::Gray, false) },
        order("all steps, hierarchical", OrderMethod::Hierarchical, false),
        order("all steps, heterodyne", OrderMethod::Heterodyne, false),
        order("all steps, coprime", OrderMethod::NumberTheoretical, false),
        order("all steps, coprime, fused", OrderMethod::NumberTheoretical, true),
    ]
}

/// Reads and decodes every view of a recording, along each axis that has fringes.
///
/// # Errors
/// A recording without fringes or without an absolute phase.
pub fn views(folder: &Path, reference: Option<&Path>) -> Result<Vec<View>> {
    let recording = Recording::open(folder)?;
    let other = reference.map(Recording::open).transpose()?;
    let stem = folder.file_name().unwrap_or_default().to_string_lossy();
    let mut found = Vec::new();
    for projector in &recording.projectors {
        for camera in &projector.cameras {
            let place = || format!("{}: camera \"{}\"", folder.display(), camera.name);
            for axis in [Axis::X, Axis::Y] {
                let fringes =
                    |set: &PatternSet| matches!(set, PatternSet::Sine { axis: a, .. } if *a == axis);
                if !projector.sequence.iter().any(fringes) {
                    continue;
                }
                let taken = load(&recording, &projector.name, &camera.name)?;
                let case = format!("{stem} {} {axis:?}", camera.name).to_lowercase();
                found.push(View::new(taken, axis, case, other.as_ref()).with_context(place)?);
            }
        }
    }
    if found.is_empty() {
        bail!("{}: has no sine set, so no phase method applies", folder.display());
    }
    Ok(found)
}

fn load(recording: &Recording, projector: &str, camera: &str) -> Result<Taken> {
    let lamp = recording.projector(projector).with_context(|| format!("no projector \"{projector}\""))?;
    let seen = lamp.camera(camera).with_context(|| format!("no camera \"{camera}\""))?;
    let mut progress = Progress::new(seen.frames.len(), "reading");
    let frames = (0..seen.frames.len()).map(|frame| {
        progress.step();
        recording.load(projector, camera, frame)
    });
    let frames = frames.collect::<Result<_, _>>()?;
    Ok(Taken { frames, sequence: lamp.sequence.clone(), extent_px: [lamp.width_px, lamp.height_px] })
}

impl View {
    fn new(taken: Taken, axis: Axis, case: String, other: Option<&Recording>) -> Result<Self> {
        let plain = (as_seen(&DecodeSettings::default()), PhaseMethod::default());
        let (own, _) = taken.decode(axis, &plain.0, plain.1)?;
        let period_px = own.info.period_px;
        let (map, kind) = match other {
            None => (own, "the least-squares phase of all steps".to_owned()),
            Some(recording) => {
                let file = &recording.document.path;
                let projector = recording.projectors.first().context("a recording has projectors")?;
                let camera = projector.cameras.first().context("a projector has cameras")?;
                let (map, _) = load(recording, &projector.name, &camera.name)?
                    .decode(axis, &plain.0, plain.1)
                    .with_context(|| file.display().to_string())?;
                if (map.info.width_px, map.info.height_px) != (own.info.width_px, own.info.height_px) {
                    bail!(
                        "--reference {}: has {} x {} px, the recording {} x {} px; it must be of the same scene and camera",
                        file.display(),
                        map.info.width_px,
                        map.info.height_px,
                        own.info.width_px,
                        own.info.height_px
                    );
                }
                (map, format!("{}, of the same scene", file.display()))
            }
        };
        let sigma = map.sigma_rad.iter().filter(|s| s.is_finite()).map(|s| f64::from(*s));
        let (count, sum) = sigma.fold((0, 0.0), |(n, sum), s| (n + 1, sum + s * s));
        let reference = Reference {
            case,
            kind,
            valid: count,
            stated_rad: (sum / count.max(1) as f64).sqrt() * map.info.period_px / period_px,
            halves_rad: None,
        };
        let mut view = Self { taken, axis, map, reference };
        view.reference.halves_rad = view.halves_rad().ok();
        Ok(view)
    }

    /// Half the difference of two phases that have no frame of a sine in common: the noise of their mean.
    fn halves_rad(&self) -> Result<f64> {
        let half = |first| {
            let half = self.taken.with_steps(|n| Steps::Even(n / 2, first).of(n))?;
            Ok::<_, anyhow::Error>(half.decode(self.axis, &as_seen(&counting()), PhaseMethod::default())?.0)
        };
        let (even, odd) = (half(0)?, half(1)?);
        let differences = differences_rad(&even, &odd);
        Ok(0.5 * Evaluated::new(&even, &differences, even.info.len(), 0.0).rms_rad)
    }

    /// One cell of the table.
    pub fn cell(&self, row: &Row) -> Cell {
        let evaluated = self.evaluate(row);
        let refused = evaluated.as_ref().err().map(|error| format!("{error:#}"));
        Cell { method: row.name, case: self.reference.case.clone(), refused, evaluated: evaluated.ok() }
    }

    fn evaluate(&self, row: &Row) -> Result<Evaluated> {
        let mut taken = self.taken.with_steps(|n| row.steps.of(n))?;
        if row.whole_stripes {
            taken.leave_out_last_bit(self.axis)?;
        }
        let (map, seconds) = taken.decode(self.axis, &as_seen(&row.settings), row.method)?;
        Ok(Evaluated::new(&map, &differences_rad(&map, &self.map), self.reference.valid, seconds))
    }
}

/// Phases as they are seen: what is taken off for the footprint depends on what the noise lets through.
fn as_seen(settings: &DecodeSettings) -> DecodeSettings {
    DecodeSettings { footprint_px: Some(0.0), ..settings.clone() }
}

/// One map less another where both are valid, rad of the first one's sine; NaN elsewhere.
fn differences_rad(one: &PhaseMap, other: &PhaseMap) -> Vec<f32> {
    let scale = other.info.period_px / one.info.period_px;
    let pairs = one.phase_rad.iter().zip(&other.phase_rad).zip(one.valid.iter().zip(&other.valid));
    pairs
        .map(|((a, b), valid)| match valid {
            (1, 1) => (f64::from(*a) - f64::from(*b) * scale) as f32,
            _ => f32::NAN,
        })
        .collect()
}

impl Steps {
    /// Numbers of the chosen ones of n even steps.
    fn of(self, n: usize) -> Result<Vec<usize>> {
        let spread = |count: usize, distance: usize, first: usize| {
            (0..count).map(|i| first + i * distance).collect::<Vec<_>>()
        };
        match self {
            Self::All => Ok(spread(n, 1, 0)),
            Self::Even(count, first) if count >= 3 && n.is_multiple_of(count) => {
                Ok(spread(count, n / count, first))
            }
            Self::Even(count, _) => {
                Err(anyhow!("{count} even steps cannot be chosen from the {n} of a sine set"))
            }
            Self::Quarters(count) if n.is_multiple_of(4) && (count - 1) * (n / 4) < n => {
                Ok(spread(count, n / 4, 0))
            }
            Self::Quarters(count) => {
                Err(anyhow!("no {count} of the {n} steps of a sine set are 90 degrees apart"))
            }
            Self::Uneven if n >= 9 => Ok(vec![0, 1, 3, 6, 8]),
            Self::Uneven => {
                Err(anyhow!("five uneven steps are chosen from nine and more, a sine set has {n}"))
            }
        }
    }
}

impl Taken {
    /// The same with some of the steps of each sine set: `choose` selects from n.
    fn with_steps(&self, choose: impl Fn(usize) -> Result<Vec<usize>>) -> Result<Self> {
        let mut out = Self { frames: Vec::new(), sequence: Vec::new(), extent_px: self.extent_px };
        let mut first = 0;
        for set in &self.sequence {
            let numbers = match set {
                PatternSet::Sine { steps, shifts_rad, .. } if shifts_rad.is_empty() => {
                    choose(*steps as usize)?
                }
                _ => (0..set.frames()).collect(),
            };
            out.sequence.push(thinned(set, &numbers));
            out.frames.extend(numbers.iter().map(|number| self.frames[first + number].clone()));
            first += set.frames();
        }
        Ok(out)
    }

    /// Makes a Gray code of half periods one of whole periods: its last, finest bit is left out.
    fn leave_out_last_bit(&mut self, wanted: Axis) -> Result<()> {
        let mut first = 0;
        for set in &mut self.sequence {
            let frames = set.frames();
            if let PatternSet::Gray { axis, bits, stripe_px, shift_px, .. } = set
                && *axis == wanted
                && *bits > 1
                && *shift_px == 0.0
            {
                (*bits, *stripe_px) = (*bits - 1, 2.0 * *stripe_px);
                self.frames.remove(first + frames - 1);
                return Ok(());
            }
            first += frames;
        }
        bail!("there is no Gray code whose last bit could be left out")
    }
}

/// A set with the chosen frames only; a sine whose chosen steps are even stays one of even steps.
fn thinned(set: &PatternSet, numbers: &[usize]) -> PatternSet {
    let mut out = set.clone();
    if let PatternSet::Sine { steps, first_step_rad, shifts_rad, .. } = &mut out
        && numbers.len() != set.frames()
    {
        let step_rad = |number: usize| TAU * number as f64 / set.frames() as f64;
        let even = numbers.windows(2).all(|pair| (pair[1] - pair[0]) * numbers.len() == set.frames());
        *steps = numbers.len() as u32;
        if even {
            *first_step_rad += step_rad(numbers[0]);
        } else {
            *shifts_rad = numbers.iter().map(|number| step_rad(*number)).collect();
        }
    }
    out
}

/// What the references are.
pub fn print(views: &[View]) {
    for Reference { case, kind, valid, stated_rad, halves_rad } in views.iter().map(|view| &view.reference) {
        let halves = halves_rad.map_or("no two halves of three steps and more".to_owned(), |halves| {
            format!("{:.1} mrad by its halves", halves * 1e3)
        });
        println!(
            "{case}: compared with {kind}: {valid} pixels, {:.1} mrad stated, {halves}",
            stated_rad * 1e3
        );
    }
}
