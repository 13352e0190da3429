//! The recordings that a correction rests on, and the places that the drifted view shares with others in them.

use super::Args;
use crate::check_rig::{Examined, PairCheck, examine, suspects};
use anyhow::{Result, bail};
use characterise::health::{HealthSettings, Match};
use files::plan_file::read_plan;
use files::recording::Recording;
use files::rig_file::{Covariance, RigFile};
use metrology::inspection::Plan;

/// A recording with what was found in it.
pub struct Shown {
    /// The recording with its frames.
    pub recording: Recording,
    /// Inspection of the length standard in it.
    pub plan: Option<Plan>,
    /// Every pair that it checks, with its matches.
    pub checks: Vec<Examined>,
}

/// A pair of the view to correct in one recording: its partner, and the matches with the view on the right.
pub struct Link<'a> {
    /// Number of the recording.
    pub recording: usize,
    /// What its residuals say.
    pub check: &'a PairCheck,
    /// The view that counts.
    pub partner: &'a str,
    /// Places in both views.
    pub matches: Vec<Match>,
}

/// Opens and checks all recordings.
pub fn shown(
    args: &Args,
    rig_file: &RigFile,
    covariance: Option<&Covariance>,
    settings: &HealthSettings,
) -> Result<Vec<Shown>> {
    let (recordings, plans) = (args.recordings.len(), args.length.len());
    if plans > 1 && plans != recordings {
        bail!(
            "--length: {plans} plans for {recordings} recordings; name one for all, or one for each in their order"
        );
    }
    // What cannot be read is said before the first frame is decoded.
    let plans: Vec<Plan> = args.length.iter().map(|path| Ok(read_plan(path)?.0)).collect::<Result<_>>()?;
    let recordings: Vec<Recording> =
        args.recordings.iter().map(|folder| Ok(Recording::open(folder)?)).collect::<Result<_>>()?;
    let mut all: Vec<Shown> = Vec::new();
    for (index, recording) in recordings.into_iter().enumerate() {
        let (checks, _) = examine(&recording, rig_file, covariance, settings)?;
        // Noise never repeats, so that equal places are those of the same frames.
        let copied = |shown: &&Shown| {
            checks.iter().any(|(check, matches)| {
                shown.checks.iter().any(|(other, theirs)| other.name == check.name && theirs == matches)
            })
        };
        if let Some(same) = all.iter().find(copied) {
            bail!(
                "{}: has the same frames as {}; a recording counts once: record the object again in another place",
                recording.folder.display(),
                same.recording.folder.display()
            );
        }
        let plan = plans.get(if plans.len() > 1 { index } else { 0 }).cloned();
        all.push(Shown { recording, plan, checks });
    }
    Ok(all)
}

/// The view that drifted, as named or as the pairs of all recordings show it.
pub fn drifted(args: &Args, rig_file: &RigFile, shown: &[Shown]) -> Result<String> {
    let checks = || shown.iter().flat_map(|shown| &shown.checks).map(|(check, _)| check);
    let known = |name: &String| checks().any(|check| check.left == *name || check.right == *name);
    if let Some(name) = &args.view {
        if known(name) {
            let ill = || checks().filter(|check| !check.health.healthy);
            let has = |check: &PairCheck| check.left == *name || check.right == *name;
            if let Some(other) = ill().next().filter(|_| !ill().any(has)) {
                bail!(
                    "--view {name}: all its pairs are healthy, and \"{}\" of \"{}\" and \"{}\" is not; name one of these, or leave --view out",
                    other.name,
                    other.left,
                    other.right
                );
            }
            return Ok(name.clone());
        }
        bail!("--view {name}: no pair of {} was recorded along both axes with it", rig_file.path.display());
    }
    // What one recording shows of a pair another one may be too small to show.
    let unhealthy = |name: &String| checks().any(|check| check.name == *name && !check.health.healthy);
    match suspects(checks().filter(|check| !check.health.healthy || !unhealthy(&check.name))).as_slice() {
        [only] => Ok(only.clone()),
        [] => bail!(
            "{}: no single view is common to all unhealthy pairs: more than one has drifted; calibrate again",
            rig_file.path.display()
        ),
        several => bail!(
            "{}: {} may have drifted, and the pairs do not tell which; name one with --view, or record more pairs",
            rig_file.path.display(),
            several.join(" or ")
        ),
    }
}

/// The pairs of a view in all recordings, with the view on the right.
pub fn links<'a>(view: &str, shown: &'a [Shown]) -> Vec<Link<'a>> {
    let all = shown.iter().enumerate().flat_map(|(k, shown)| shown.checks.iter().map(move |one| (k, one)));
    all.filter_map(|(recording, examined)| link(view, recording, examined)).collect()
}

fn link<'a>(view: &str, recording: usize, (check, matches): &'a Examined) -> Option<Link<'a>> {
    if check.right == view {
        return Some(Link { recording, check, partner: &check.left, matches: matches.clone() });
    }
    let turned = || matches.iter().copied().map(Match::turned).collect();
    (check.left == view).then(|| Link { recording, check, partner: &check.right, matches: turned() })
}
