//! `fringetool correct-rig`: mends a rig of which one view has drifted, from fringes on any object.

mod length;
mod write;

use crate::Outcome;
use crate::check_rig::{Examined, PairCheck, examine, pair_covariance, suspects};
use crate::report::{check_outputs, emit_made_with};
use crate::software::FRINGETOOL;
use anyhow::{Context, Result, bail};
use characterise::health::{HealthSettings, Match, Partner, ViewCorrection, check_pair, correct_view};
use files::provenance::Provenance;
use files::recording::{RECORDING_FILE, Recording};
use files::rig_file::{Covariance, RigFile, read_rig};
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Folder of the recording (docs/formats.md): any object with smooth faces, lit with fringes along both axes.
    recording: PathBuf,
    /// Rig file to correct (TOML, docs/formats.md); it stays as it is.
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Rig file to write, with its covariance beside it. Nothing is written where nothing has drifted.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The view that drifted; default: the one that all unhealthy pairs have in common.
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Inspection plan of a length standard in the same recording, whose distances of centres are certified: needed where the baseline of
    /// the only pair has changed.
    #[arg(long, value_name = "PLAN")]
    length: Option<PathBuf>,
    /// Probability that a healthy pair is reported as unhealthy.
    #[arg(long, value_name = "P", default_value_t = HealthSettings::default().false_alarm)]
    false_alarm: f64,
    /// Smooth systematic errors of the phase (footprint, blur, stray light), rms in px.
    #[arg(long, value_name = "PX", default_value_t = HealthSettings::default().phase_error_px)]
    phase_error_px: f64,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A pair of the view to correct: its partner, and the matches with the view on the right.
struct Link {
    check: PairCheck,
    partner: String,
    matches: Vec<Match>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let recording_file = args.recording.join(RECORDING_FILE);
    let inputs: Vec<_> =
        [&args.rig, &recording_file].into_iter().chain(&args.length).map(PathBuf::as_path).collect();
    check_outputs(&[("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())], &inputs, None)?;
    let settings = HealthSettings {
        false_alarm: args.false_alarm,
        phase_error_px: args.phase_error_px,
        ..HealthSettings::default()
    };
    settings.check()?;
    let recording = Recording::open(&args.recording)?;
    let rig_file = read_rig(&args.rig)?;
    let covariance = rig_file.read_covariance()?;
    let (checks, _) = examine(&recording, &rig_file, covariance.as_ref(), &settings)?;
    let provenance = Provenance::now(&FRINGETOOL).rig(&rig_file.sha256);
    if checks.iter().all(|(check, _)| check.health.healthy) {
        println!("nothing has drifted: no rig is written");
        emit_made_with(args.json.as_deref(), &write::json(args, None, &[]), provenance)?;
        return Ok(Outcome::Done);
    }
    let view = drifted(args, &rig_file, &checks)?;
    let links = links(&view, checks);
    let judge =
        Judge { rig_file: &rig_file, covariance: covariance.as_ref(), settings: &settings, view: &view };
    let (found, scaled) = judge.correct(args, &recording, &links)?;
    let after = judge.health(&found.camera, &links)?;
    write::write(args, &recording, &judge, &found, scaled)?;
    let lines = write::report(&view, &found, scaled, &links, &after);
    for line in &lines {
        println!("{line}");
    }
    println!("{}", args.out.display());
    emit_made_with(
        args.json.as_deref(),
        &write::json(args, Some((&view, &found, scaled)), &after),
        provenance,
    )?;
    Ok(Outcome::Done)
}

/// The view that drifted, as named or as the pairs show it.
fn drifted(args: &Args, rig_file: &RigFile, checks: &[Examined]) -> Result<String> {
    let known = |name: &String| checks.iter().any(|(check, _)| check.left == *name || check.right == *name);
    if let Some(name) = &args.view {
        if known(name) {
            return Ok(name.clone());
        }
        bail!("--view {name}: no pair of {} was recorded along both axes with it", rig_file.path.display());
    }
    match suspects(checks.iter().map(|(check, _)| check)).as_slice() {
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

/// The pairs of a view, all with the view on the right.
fn links(view: &str, checks: Vec<Examined>) -> Vec<Link> {
    let turned = |m: Match| Match { left: m.right, right: m.left, ..m };
    let link = |(check, matches): Examined| {
        if check.right == view {
            return Some(Link { partner: check.left.clone(), check, matches });
        }
        let own = check.left == view;
        // Both views see alike: the covariance of the place is taken for that in the other picture.
        own.then(|| Link {
            partner: check.right.clone(),
            check,
            matches: matches.into_iter().map(turned).collect(),
        })
    };
    checks.into_iter().filter_map(link).collect()
}

/// What decides whether a corrected view is healthy.
struct Judge<'a> {
    rig_file: &'a RigFile,
    covariance: Option<&'a Covariance>,
    settings: &'a HealthSettings,
    view: &'a str,
}

/// A camera or projector of a rig.
fn camera<'r>(rig: &'r Rig, name: &str) -> Result<&'r Camera> {
    rig.camera(name)
        .or_else(|| rig.projector(name))
        .with_context(|| format!("\"{name}\" is not in the rig file"))
}

impl Judge<'_> {
    /// The least correction that makes all pairs of the view healthy, and the factor on its baseline by the length standard.
    fn correct(
        &self,
        args: &Args,
        recording: &Recording,
        links: &[Link],
    ) -> Result<(ViewCorrection, Option<length::Scale>)> {
        let rig = &self.rig_file.rig;
        let (path, start) = (self.rig_file.path.display(), camera(rig, self.view)?);
        let partners: Vec<Partner> = links
            .iter()
            .map(|link| Ok(Partner { fixed: camera(rig, &link.partner)?, matches: &link.matches }))
            .collect::<Result<_>>()?;
        let turned = correct_view(start, &partners, false, self.settings)?;
        if self.healthy(&turned.camera, links)? {
            return Ok((turned, None));
        }
        let moved = correct_view(start, &partners, true, self.settings)?;
        if !self.healthy(&moved.camera, links)? {
            bail!(
                "{path}: no rotation, shift and focal length of \"{}\" explains the residuals: a lens changed, or more than one view \
                 drifted; calibrate again",
                self.view
            );
        }
        let mut others: Vec<&str> = links.iter().map(|link| link.partner.as_str()).collect();
        others.sort_unstable();
        others.dedup();
        match (&args.length, others.as_slice()) {
            (None, [only]) => bail!(
                "{path}: \"{}\" has been shifted, and its only partner \"{only}\" does not show how far along their baseline: lengths are \
                 at stake; record a length standard and name its plan with --length",
                self.view
            ),
            (Some(plan), [only]) => {
                let (camera, scale) = length::scaled(plan, recording, self, &moved.camera, only)?;
                Ok((ViewCorrection { camera, ..moved }, Some(scale)))
            }
            _ => Ok((moved, None)),
        }
    }

    /// Whether all pairs are healthy with the view in this state.
    fn healthy(&self, view: &Camera, links: &[Link]) -> Result<bool> {
        Ok(self.health(view, links)?.iter().all(|after| after.1))
    }

    /// Of each pair its name, whether it is healthy with the view in this state, and the rms of the drift left, px.
    fn health(&self, view: &Camera, links: &[Link]) -> Result<Vec<(String, bool, f64)>> {
        let one = |link: &Link| {
            let pair = Pair {
                name: link.check.name.clone(),
                left: link.partner.clone(),
                right: self.view.to_owned(),
                projector: link.check.projector.clone(),
            };
            let covariance = self.covariance.and_then(|covariance| pair_covariance(covariance, &pair));
            let partner = camera(&self.rig_file.rig, &link.partner)?;
            let health = check_pair(partner, view, &link.matches, covariance.as_ref(), self.settings)?;
            Ok((pair.name, health.healthy, health.drift.rms_px))
        };
        links.iter().map(one).collect()
    }

    /// The rig with the view in a new state.
    fn rig_with(&self, view: &Camera) -> Rig {
        let mut rig = self.rig_file.rig.clone();
        for named in rig.cameras.iter_mut().chain(&mut rig.projectors).filter(|named| named.name == self.view)
        {
            named.camera = view.clone();
        }
        rig
    }
}
