//! Which projectors show at the same time, what that saves, and which light meets: for `fringecell schedule`.

use anyhow::{Context, Result, bail};
use cell::Cell;
use cell::configuration::{Configuration, ProjectorConfig};
use cell::together::{frames_of, groups};
use devices::LoadedCell;
use files::config::{Meeting, meetings};
use files::recording::{RecordedProjector, Recording};
use fringe::frame::Frame;
use fringe::pattern::{Axis, PatternSet, are_apart, first_harmonic, periods_apart, stepping};
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt::{self, Write as _};
use std::path::Path;

/// Light of a projector in a trial: white less black, as a fraction of full scale.
const LIT: f64 = 0.02;

/// So much of a picture may be lit by noise alone.
const STRAY: f64 = 1e-4;

/// The projectors that show at the same time.
#[derive(Debug, Serialize)]
pub struct Together {
    /// Names of the projectors of each group, in the order of projection.
    groups: Vec<Vec<String>>,
    /// Patterns that are shown one after another in a cycle.
    patterns: usize,
    /// Those of one projector after another.
    patterns_alone: usize,
    /// Light that meets within a group on the scene of the twin; null: nothing tells.
    meetings: Option<Vec<Meets>>,
    /// Remedies for light that meets and is not told apart, by projector.
    #[serde(skip)]
    advice: Vec<String>,
}

/// A camera that looks at one projector of a group and sees light of another one.
#[derive(Debug, Serialize)]
struct Meets {
    camera: String,
    looks_at: String,
    sees: String,
    /// Part of what the camera sees of the part that the other projector lights, 0 … 1.
    lit_share: f64,
    /// Whether the steps of both projectors tell their light apart.
    told_apart: bool,
}

impl Together {
    /// The groups of a cell, and light that meets within one on the scene of its twin; none where the configuration asks for none.
    ///
    /// # Errors
    /// A scene that cannot be used.
    pub fn of(cell: &LoadedCell) -> Result<Option<Self>> {
        let config = &cell.file.cell;
        if config.together.is_empty() {
            return Ok(None);
        }
        let Some(twin) = &cell.file.twin else {
            return Ok(Some(Self::new(&cell.graph.groups, config, None)));
        };
        let grouped = |own: usize, other: usize| {
            config.together.iter().any(|group| group.contains(&own) && group.contains(&other))
        };
        let met = meetings(&cell.file.document, config, twin)?;
        let met = met.into_iter().filter(|m| grouped(m.projectors[0], m.projectors[1])).collect();
        Ok(Some(Self::new(&cell.graph.groups, config, Some(met))))
    }

    fn new(groups: &[Vec<usize>], config: &Configuration, met: Option<Vec<Meeting>>) -> Self {
        let frames: Vec<usize> = config.projectors.iter().map(ProjectorConfig::frames).collect();
        let name = |p: &usize| config.projectors[*p].name.clone();
        let apart = |[own, other]: [usize; 2]| {
            are_apart(&config.projectors[own].sequence, &config.projectors[other].sequence)
        };
        let mixed = met.iter().flatten().map(|m| m.projectors).filter(|both| !apart(*both));
        let mixed: BTreeSet<usize> = mixed.flatten().collect();
        let row = |meeting: Meeting| Meets {
            looks_at: name(&meeting.projectors[0]),
            sees: name(&meeting.projectors[1]),
            lit_share: meeting.pixels[0] as f64 / meeting.pixels[1].max(1) as f64,
            told_apart: apart(meeting.projectors),
            camera: meeting.camera,
        };
        Self {
            groups: groups.iter().map(|group| group.iter().map(name).collect()).collect(),
            patterns: frames_of(&frames, groups),
            patterns_alone: frames.iter().sum(),
            advice: groups.iter().filter_map(|group| advice(config, group, &mixed)).collect(),
            meetings: met.map(|met| met.into_iter().map(row).collect()),
        }
    }

    /// Whether no light of a group meets that is not told apart.
    pub fn is_fine(&self) -> bool {
        self.meetings.iter().flatten().all(|meets| meets.told_apart)
    }
}

impl fmt::Display for Together {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list: Vec<String> = self.groups.iter().map(|group| group.join(" + ")).collect();
        let (together, alone) = (self.patterns, self.patterns_alone);
        writeln!(
            f,
            "projectors together: {}: {together} patterns one after another instead of {alone}, {:.0} % of the acquisition saved",
            list.join(", "),
            100.0 * (alone - together) as f64 / alone.max(1) as f64
        )?;
        for Meets { camera, looks_at, sees, lit_share, told_apart } in self.meetings.iter().flatten() {
            let remedy =
                if *told_apart { "their steps tell them apart" } else { "put them into different groups" };
            writeln!(
                f,
                "{looks_at} and {sees} meet: {camera} looks at {looks_at} and sees light of {sees} on {:.1} % of the part; {remedy}",
                100.0 * lit_share
            )?;
        }
        self.advice.iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

/// Which steps would tell the projectors of a group apart whose light mixes; none where only other patterns would.
fn advice(config: &Configuration, group: &[usize], mixed: &BTreeSet<usize>) -> Option<String> {
    let members: Vec<usize> = group.iter().copied().filter(|p| mixed.contains(p)).collect();
    let steps = |p: &usize| -> Option<u32> {
        let mut steps = config.projectors[*p].sequence.iter().map(|set| match set {
            PatternSet::Sine { steps, .. } => Some(*steps),
            _ => None,
        });
        let first = steps.next()??;
        steps.all(|other| other == Some(first)).then_some(first)
    };
    let first = steps(members.first()?)?;
    if members.iter().any(|p| steps(p) != Some(first)) {
        return None;
    }
    let periods = periods_apart(first, members.len())?;
    let shifts = members.iter().zip(&periods).map(|(p, periods)| {
        let set = stepping(Axis::X, 16.0, first, *periods);
        let shifts: Vec<String> =
            (0..first as usize).map(|step| format!("{:.6}", set.step_rad(step))).collect();
        format!("{} shifts_rad = [{}]", config.projectors[*p].name, shifts.join(", "))
    });
    Some(format!(
        "or let their steps pass different numbers of periods, in each of their sets: {}; the first harmonic that mixes is then number {}",
        shifts.collect::<Vec<_>>().join("; "),
        first_harmonic(first, &periods)
    ))
}

/// The groups that a trial recording allows, as a line for the configuration.
///
/// # Errors
/// A recording without the light of each projector in all cameras.
pub fn of_trial(cell: &Cell, folder: &Path) -> Result<String> {
    let (config, trial) = (&cell.config, Recording::open(folder)?);
    let mut meet = vec![vec![false; config.projectors.len()]; config.projectors.len()];
    let mut text = String::new();
    for (light, projector) in config.projectors.iter().enumerate() {
        let recorded = trial.projectors.iter().find(|p| p.name == projector.name);
        let recorded = recorded.with_context(|| {
            format!("--trial {}: has no projector \"{}\"", folder.display(), projector.name)
        })?;
        for (own, other) in config.projectors.iter().enumerate().filter(|(own, _)| *own != light) {
            for camera in &other.cameras {
                let share = lit_share(&trial, recorded, camera)
                    .with_context(|| format!("--trial {}", folder.display()))?;
                if share > STRAY {
                    (meet[own][light], meet[light][own]) = (true, true);
                    let _ = writeln!(
                        text,
                        "{} and {} meet: {camera} looks at {} and sees light of {} in {:.2} % of its picture",
                        other.name,
                        projector.name,
                        other.name,
                        projector.name,
                        100.0 * share
                    );
                }
            }
        }
    }
    let frames: Vec<usize> = config.projectors.iter().map(ProjectorConfig::frames).collect();
    let apart =
        |a: usize, b: usize| are_apart(&config.projectors[a].sequence, &config.projectors[b].sequence);
    let found = groups(&frames, &|a, b| meet[a][b] && !apart(a, b));
    let quoted = |p: &usize| format!("\"{}\"", config.projectors[*p].name);
    let lists: Vec<String> = found
        .iter()
        .map(|group| format!("[{}]", group.iter().map(quoted).collect::<Vec<_>>().join(", ")))
        .collect();
    let _ = write!(text, "{}", Together::new(&found, config, None));
    let _ = writeln!(text, "together = [{}]", lists.join(", "));
    Ok(text)
}

/// Part of a camera's picture that a projector lights.
fn lit_share(trial: &Recording, projector: &RecordedProjector, camera: &str) -> Result<f64> {
    if projector.cameras.iter().all(|c| c.name != camera) {
        bail!(
            "no frames of camera \"{camera}\" in the light of \"{}\": record all cameras with each projector",
            projector.name
        );
    }
    let load = |wanted: fn(&PatternSet) -> bool, name: &str| -> Result<Frame> {
        let mut first = 0;
        for set in &projector.sequence {
            if wanted(set) {
                return Ok(trial.load(&projector.name, camera, first)?);
            }
            first += set.frames();
        }
        bail!("projector \"{}\" shows no {name}; record white and black with each projector", projector.name)
    };
    let white = load(|set| matches!(set, PatternSet::White {}), "white")?;
    let black = load(|set| matches!(set, PatternSet::Black {}), "black")?;
    let (bright, dark) = (white.view(), black.view());
    let least = (LIT * f64::from(white.full_scale_dn)) as f32;
    let count = bright.pixels.len();
    let lit = (0..count).filter(|i| bright.pixels.get(*i) - dark.pixels.get(*i) > least).count();
    Ok(lit as f64 / count.max(1) as f64)
}
