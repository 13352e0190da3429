//! Which projectors show at the same time, what that saves, and which light meets: for `fringecell schedule`.

use anyhow::{Context, Result, bail};
use cell::Cell;
use cell::configuration::{Configuration, ProjectorConfig};
use cell::together::{frames_of, groups};
use devices::LoadedCell;
use files::config::meetings;
use files::recording::{RecordedProjector, Recording};
use fringe::frame::Frame;
use fringe::pattern::PatternSet;
use std::fmt::Write as _;
use std::path::Path;

/// Light of a projector in a trial: white less black, as a fraction of full scale.
const LIT: f64 = 0.02;

/// So much of a picture may be lit by noise alone.
const STRAY: f64 = 1e-4;

/// The groups that a cell shows, and light that meets within one on the scene of its twin. False: it meets.
///
/// # Errors
/// A scene that cannot be used.
pub fn shown(cell: &LoadedCell) -> Result<(String, bool)> {
    let config = &cell.file.cell;
    if config.together.is_empty() {
        return Ok((String::new(), true));
    }
    let mut text = format!("{}\n", saving(&cell.graph.groups, config));
    let Some(twin) = &cell.file.twin else { return Ok((text, true)) };
    let mut apart = true;
    for meeting in meetings(&cell.file.document, config, twin)? {
        let [own, other] = meeting.projectors;
        if !config.together.iter().any(|group| group.contains(&own) && group.contains(&other)) {
            continue;
        }
        apart = false;
        let names = [own, other].map(|p| config.projectors[p].name.as_str());
        let [lit, seen] = meeting.pixels.map(|count| count as f64);
        let _ = writeln!(
            text,
            "{} and {} meet: {} looks at {} and sees light of {} on {:.1} % of the part; put them into different groups",
            names[0],
            names[1],
            meeting.camera,
            names[0],
            names[1],
            100.0 * lit / seen.max(1.0)
        );
    }
    Ok((text, apart))
}

/// The groups, and how many patterns are shown one after another with and without them.
fn saving(groups: &[Vec<usize>], config: &Configuration) -> String {
    let frames: Vec<usize> = config.projectors.iter().map(ProjectorConfig::frames).collect();
    let (alone, together) = (frames.iter().sum::<usize>(), frames_of(&frames, groups));
    let name = |p: &usize| config.projectors[*p].name.as_str();
    let names = |group: &Vec<usize>| group.iter().map(name).collect::<Vec<_>>().join(" + ");
    let list: Vec<String> = groups.iter().map(names).collect();
    format!(
        "projectors together: {}: {together} patterns one after another instead of {alone}, {:.0} % of the acquisition saved",
        list.join(", "),
        100.0 * (alone - together) as f64 / alone.max(1) as f64
    )
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
    let found = groups(&frames, &|a, b| meet[a][b]);
    let quoted = |p: &usize| format!("\"{}\"", config.projectors[*p].name);
    let lists: Vec<String> = found
        .iter()
        .map(|group| format!("[{}]", group.iter().map(quoted).collect::<Vec<_>>().join(", ")))
        .collect();
    let _ = writeln!(text, "{}", saving(&found, config));
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
