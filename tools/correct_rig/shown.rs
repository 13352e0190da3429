//! The recordings that a correction rests on, and the places that the drifted view shares with others in them.

use super::Args;
use crate::check_rig::{Examined, PairCheck, check_pairs, examine, suspects};
use anyhow::{Result, bail};
use characterise::health::{HealthError, HealthSettings, Lit, Match};
use files::document::Document;
use files::plan_file::read_plan;
use files::recording::Recording;
use files::rig_file::{Covariance, RigFile};
use fringe::geometry::rig::Pair;
use metrology::inspection::Plan;
use std::collections::BTreeSet;

/// A recording with what was found in it.
pub struct Shown {
    /// The recording with its frames.
    pub recording: Recording,
    /// Inspection of the length standard in it.
    pub plan: Option<Plan>,
    /// The plan as written.
    pub plan_text: Option<Document>,
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
    /// Another view that counts and measures places together with the partner: the projector that lights both, or a second camera where it is the projector
    /// that drifted.
    pub second: &'a str,
    /// Whether the rig file does not pair it with the view.
    pub further: bool,
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
    let plans: Vec<(Plan, Document)> =
        args.length.iter().map(|path| Ok(read_plan(path)?)).collect::<Result<_>>()?;
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
        let plan = plans.get(if plans.len() > 1 { index } else { 0 });
        let (plan, plan_text) = plan.cloned().unzip();
        all.push(Shown { recording, plan, plan_text, checks });
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
        [] => bail!("{}: {}", rig_file.path.display(), none_alone(checks)),
        several => bail!(
            "{}: {} may have drifted, and the pairs do not tell which; name one with --view, or record more pairs",
            rig_file.path.display(),
            several.join(" or ")
        ),
    }
}

/// Why no view alone is suspected, in words.
fn none_alone<'a, I: Iterator<Item = &'a PairCheck>>(checks: impl Fn() -> I) -> String {
    let [only] = &suspects(checks().filter(|check| !check.health.healthy))[..] else {
        return "no single view is common to all unhealthy pairs: more than one has drifted; calibrate again"
            .to_owned();
    };
    let has = |check: &&PairCheck| check.left == *only || check.right == *only;
    let healthy =
        checks().filter(has).find(|check| check.health.healthy).map_or("", |check| check.name.as_str());
    format!(
        "\"{only}\" is in all unhealthy pairs, but in the healthy pair \"{healthy}\" as well: where that pair is known too badly to show the drift, name \
         \"{only}\" with --view; otherwise more than one has drifted: calibrate again"
    )
}

/// Of each recording the view with cameras that the rig file does not pair with it under the same projector: they say where it stands as well, and
/// from other sides. Those that a pair without the view shows to have moved say nothing.
pub fn further(
    view: &str,
    shown: &[Shown],
    rig_file: &RigFile,
    covariance: Option<&Covariance>,
    settings: &HealthSettings,
) -> Result<Vec<Vec<Examined>>> {
    let has = |check: &PairCheck, name: &str| check.left == name || check.right == name;
    let checks = || shown.iter().flat_map(|shown| &shown.checks).map(|(check, _)| check);
    let moved =
        |name: &str| checks().any(|check| has(check, name) && !has(check, view) && !check.health.healthy);
    let in_recording = |shown: &Shown| {
        let checks = || shown.checks.iter().map(|(check, _)| check);
        // Which camera saw which projector along both axes: all of these are in a pair that was checked.
        let seen: BTreeSet<(&str, &str)> = checks()
            .flat_map(|check| {
                [&check.left, &check.right].map(|name| (check.projector.as_str(), name.as_str()))
            })
            .filter(|(_, name)| rig_file.rig.camera(name).is_some())
            .collect();
        let known = |projector: &str, camera: &str| {
            checks().any(|check| check.projector == projector && has(check, camera) && has(check, view))
        };
        let wanted = seen.iter().filter(|(projector, camera)| {
            *camera != view
                && seen.contains(&(*projector, view))
                && !known(projector, camera)
                && !moved(camera)
        });
        let pair = |(projector, camera): &(&str, &str)| Pair {
            name: format!("{camera}-{view} under {projector}"),
            left: (*camera).to_owned(),
            right: view.to_owned(),
            projector: (*projector).to_owned(),
        };
        let pairs: Vec<Pair> = wanted.map(pair).collect();
        if pairs.is_empty() {
            return Ok(Vec::new());
        }
        // Decoded anew: the phases of all recordings at once may not fit the memory.
        let found = check_pairs(&shown.recording, rig_file, &pairs, covariance, settings)?;
        found.into_iter().filter(|one| !shows_little(one)).collect::<Result<Vec<_>>>()
    };
    shown.iter().map(in_recording).collect()
}

/// Whether two cameras have too few places in common to say anything.
fn shows_little(found: &Result<Examined>) -> bool {
    let error = found.as_ref().err().and_then(|error| error.downcast_ref());
    matches!(error, Some(HealthError::TooFew { .. } | HealthError::Degenerate))
}

/// The pairs of a view in all recordings, and those with further cameras, with the view on the right.
pub fn links<'a>(view: &str, shown: &'a [Shown], further: &'a [Vec<Examined>]) -> Vec<Link<'a>> {
    let own = shown.iter().map(|shown| &shown.checks).enumerate().map(|of| (of, false));
    let all = own.chain(further.iter().enumerate().map(|of| (of, true)));
    let link = |((recording, checks), further): ((usize, &'a Vec<Examined>), bool)| {
        let cameras = &shown[recording].checks;
        checks.iter().filter_map(move |examined| link(view, (recording, cameras), examined, further))
    };
    all.flat_map(link).collect()
}

fn link<'a>(
    view: &str,
    (recording, checks): (usize, &'a [Examined]),
    (check, matches): &'a Examined,
    further: bool,
) -> Option<Link<'a>> {
    let (partner, mut matches) = if check.right == view {
        (&check.left, matches.clone())
    } else if check.left == view {
        (&check.right, matches.iter().copied().map(Match::turned).collect())
    } else {
        return None;
    };
    let mut second = &check.projector;
    if second == view
        && let Some((other, seen)) = checks
            .iter()
            .find(|(other, _)| other.left == *partner && other.right != view && other.projector == view)
    {
        second = &other.right;
        add_second_camera(&mut matches, seen);
    }
    Some(Link { recording, check, partner, second, further, matches })
}

/// Adds to the places that a camera and its projector share where a second camera sees them. `seen`: those of both cameras, by the same windows of the
/// first.
fn add_second_camera(matches: &mut [Match], seen: &[Match]) {
    let mut seen = seen.iter().peekable();
    let order = |a: &Match, b: &Match| a.left.y.total_cmp(&b.left.y).then(a.left.x.total_cmp(&b.left.x));
    for own in matches {
        while seen.next_if(|other| order(other, own).is_lt()).is_some() {}
        let Some(other) = seen.next_if(|other| order(other, own).is_eq()) else { continue };
        // What the first camera measures wrongly of the projector leads to another place of the second one.
        own.lit = other.lit.map(|lit| Lit {
            pixel: other.right,
            covariance_px2: other.covariance_px2,
            with_right_px2: lit.with_right_px2.transpose(),
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Point2};

    /// Of three windows of the first camera the second one sees the middle one, and one that the projector's places lack.
    #[test]
    fn places_of_a_second_camera_belong_to_the_same_window_of_the_first() {
        let at = |x: f64, y: f64, right: f64| Match {
            left: Point2::new(x, y),
            right: Point2::new(right, right),
            covariance_px2: Matrix2::identity() * 0.01,
            lit: None,
        };
        let lit = Lit {
            pixel: Point2::new(1.0, 2.0),
            covariance_px2: Matrix2::identity(),
            with_right_px2: Matrix2::new(1.0, 2.0, 3.0, 4.0),
        };
        let mut matches = [at(7.0, 2.0, 1.0), at(2.0, 7.0, 2.0), at(7.0, 7.0, 3.0)];
        let seen =
            [(2.0, 2.0), (2.0, 7.0), (9.0, 9.0)].map(|(x, y)| Match { lit: Some(lit), ..at(x, y, 50.0) });
        add_second_camera(&mut matches, &seen);
        let found = matches
            .map(|own| own.lit.map(|lit| (lit.pixel.x, lit.covariance_px2.m11, lit.with_right_px2.m12)));
        assert_eq!(found, [None, Some((50.0, 0.01, 3.0)), None]);
    }
}
