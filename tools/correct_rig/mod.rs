//! `fringetool correct-rig`: mends a rig of which one view has drifted, from fringes on any object.

mod length;
mod refusals;
mod shown;
mod write;

use crate::Outcome;
use crate::check_rig::{moved_alike, pair_covariance};
use crate::numbers::within;
use crate::report::{check_outputs, emit_made_with};
use crate::software::FRINGETOOL;
use anyhow::{Context, Result, bail};
use characterise::health::{
    Choice, HealthSettings, KNOWN_LENGTH, LengthReading, PairCovariance, Partner, ThreeViews, ViewCorrection,
    ViewCovariance, ViewEstimate, check_pair, estimate_view,
};
use files::provenance::Provenance;
use files::recording::RECORDING_FILE;
use files::rig_file::{Covariance, RigFile, covariance_beside, read_rig};
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use refusals::contradict_all;
use shown::{Link, Shown};
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Folders of recordings (docs/formats.md): any object with smooth faces, lit with fringes along both axes. Several, with the object
    /// tilted between them, distinguish a shift from a turn or a change of the focal length.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Rig file to correct (TOML, docs/formats.md); it stays as it is.
    #[arg(long, value_name = "FILE")]
    rig: PathBuf,
    /// Rig file to write, with its covariance beside it. Nothing is written where nothing has drifted.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The view that drifted; default: the one that all unhealthy pairs have in common.
    #[arg(long, value_name = "NAME")]
    view: Option<String>,
    /// Inspection plan of a length standard in the recordings, whose distances of centres are certified (`nominal_mm`, with the
    /// certificate's standard uncertainty as `u_system_mm`): needed where the residuals leave lengths open. One for all recordings, or one
    /// for each in their order.
    #[arg(long, value_name = "PLAN")]
    length: Vec<PathBuf>,
    /// Probability that a healthy pair is reported as unhealthy.
    #[arg(long, value_name = "P", default_value_t = HealthSettings::default().false_alarm, value_parser = |text: &str| within(text, 1e-9..=0.1))]
    false_alarm: f64,
    /// Smooth systematic errors of the phase (footprint, blur, stray light), rms in px.
    #[arg(long, value_name = "PX", default_value_t = HealthSettings::default().phase_error_px, value_parser = |text: &str| within(text, 0.0..=1.0))]
    phase_error_px: f64,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let settings = HealthSettings {
        false_alarm: args.false_alarm,
        phase_error_px: args.phase_error_px,
        ..HealthSettings::default()
    };
    settings.check()?;
    let rig_file = read_rig(&args.rig)?;
    check_places(args, &rig_file)?;
    if let Some(view) = &args.view {
        camera(&rig_file.rig, view).with_context(|| {
            format!("--view {view}: name a camera or projector of {}", args.rig.display())
        })?;
    }
    let covariance = rig_file.read_covariance()?;
    let shown = shown::shown(args, &rig_file, covariance.as_ref(), &settings)?;
    let provenance = Provenance::now(&FRINGETOOL).rig(&rig_file.sha256);
    if shown.iter().flat_map(|shown| &shown.checks).all(|(check, _)| check.health.healthy) {
        // A shift along the baseline shows in lengths only.
        let wrong = length::wrong(args, &shown, (&rig_file, KNOWN_LENGTH))?;
        if let Some(wrong) = wrong.first().filter(|_| args.view.is_none()) {
            bail!(
                "{wrong}; all pairs are healthy, so that a view moved along its baseline, or the plan states another length: check the \
                 certificate, then name the view with --view, or calibrate again"
            );
        }
        if wrong.is_empty() {
            println!("nothing has drifted: no rig is written");
            emit_made_with(args.json.as_deref(), &write::json(args, None, &[]), provenance)?;
            return Ok(Outcome::Done);
        }
    }
    let view = shown::drifted(args, &rig_file, &shown)?;
    let further = shown::further(&view, &shown, &rig_file, covariance.as_ref(), &settings)?;
    let links = shown::links(&view, &shown, &further);
    let judge =
        Judge { rig_file: &rig_file, covariance: covariance.as_ref(), settings: &settings, view: &view };
    let found = judge.correct(args, &shown, &links)?;
    let after = judge.health(&found.view.camera, &links)?;
    judge.refuse_unhealthy(args, &after)?;
    judge.refuse_other_lengths(args, &shown, &found.view)?;
    write::write(args, &shown, &judge, &found)?;
    let lines = write::report(&view, &found, &shown, &after);
    for line in &lines {
        println!("{line}");
    }
    println!("{}", args.out.display());
    emit_made_with(args.json.as_deref(), &write::json(args, Some((&view, &found)), &after), provenance)?;
    Ok(Outcome::Done)
}

/// Refuses outputs that would overwrite each other or an input, of which the covariance beside the rig file is one.
fn check_places(args: &Args, rig_file: &RigFile) -> Result<()> {
    let files: Vec<PathBuf> = args.recordings.iter().map(|folder| folder.join(RECORDING_FILE)).collect();
    let known = rig_file.covariance.as_ref().map(|named| rig_file.path.with_file_name(&named.file));
    let all = std::iter::once(&args.rig).chain(&files).chain(&args.length).chain(&known);
    let inputs: Vec<&Path> = all.map(PathBuf::as_path).collect();
    let covariance = covariance_beside(&args.out);
    let outputs = [
        ("--out", Some(args.out.as_path())),
        ("the covariance of --out", Some(covariance.as_path())),
        ("--json", args.json.as_deref()),
    ];
    Ok(check_outputs(&outputs, &inputs, None)?)
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
    rig.device(name).with_context(|| format!("\"{name}\" is not in the rig file"))
}

/// The partners by name, each once.
fn devices<'a>(links: &[Link<'a>]) -> Vec<&'a str> {
    let mut names: Vec<&str> = links.iter().map(|link| link.partner).collect();
    names.sort_unstable();
    names.dedup();
    names
}

/// What was found of the view.
pub struct Found {
    /// The model that was chosen.
    pub view: ViewCorrection,
    /// All models, the simple ones first.
    pub models: Vec<ViewCorrection>,
    /// New length of the baseline to a measuring partner over the rig file's, with its standard uncertainty, where a length
    /// standard confirms it.
    pub baseline: Option<Baseline>,
    /// Relative standard uncertainty of the scale by the certified lengths alone.
    pub u_scale: Option<f64>,
    /// Certified lengths that count as exact, in words.
    pub exact: Vec<String>,
    /// What else than a drift looks the same, in words.
    pub alike: Option<String>,
    /// Of each recording how many certified lengths were measured in it.
    pub lengths: Vec<usize>,
    /// The simplest model without the lengths, where they contradict it.
    pub doubted: Option<ViewCorrection>,
    /// Partners that measure places together with the projector that lights them.
    pub places: Vec<PlacesOf>,
}

/// Two fixed views that measure places together.
pub struct PlacesOf {
    /// Name of the partner.
    pub partner: String,
    /// Name of the other one: the projector that lights both, or a camera where it is the projector that drifted.
    pub second: String,
    /// Whether their places count, and why.
    pub three: ThreeViews,
}

/// A pair of the view in one recording with the view in a new state.
pub struct PairAfter {
    /// Name of the pair.
    pub name: String,
    /// Number of the recording.
    pub recording: usize,
    /// Whether it is none of the rig file, but the view with a further camera.
    pub further: bool,
    /// Whether the pair is healthy.
    pub healthy: bool,
    /// Root mean square of the drift before, px.
    pub before_px: f64,
    /// The same that is left, px.
    pub rms_px: f64,
}

/// Change of a baseline.
#[derive(Debug, Clone, Copy, serde::Serialize)]
pub struct Baseline {
    /// New length over that of the rig file.
    pub factor: f64,
    /// Standard uncertainty of the factor.
    pub u: f64,
}

impl Judge<'_> {
    /// The simplest correction that the residuals do not contradict, with the length standard where there is one.
    fn correct(&self, args: &Args, shown: &[Shown], links: &[Link]) -> Result<Found> {
        let rig = &self.rig_file.rig;
        let (path, start) = (self.rig_file.path.display(), camera(rig, self.view)?);
        let devices = devices(links);
        let partners: Vec<Partner> = links
            .iter()
            .map(|link| {
                Ok(Partner {
                    fixed: camera(rig, link.partner)?,
                    device: devices.iter().position(|name| *name == link.partner).unwrap_or_default(),
                    matches: &link.matches,
                    lit_by: self.lit_by(link, &devices),
                    measures: rig.pairs.iter().any(|pair| pair.name == link.check.name),
                })
            })
            .collect::<Result<_>>()?;
        let named = |three: &ThreeViews| PlacesOf {
            partner: devices[three.device].to_owned(),
            second: devices[three.second].to_owned(),
            three: *three,
        };
        let mut estimate =
            estimate_view(start, &partners, self.calibration(&devices).as_ref(), self.settings)?;
        if !self.health(&estimate.camera(), links)?.iter().all(|after| after.healthy) {
            bail!(
                "{path}: no rotation, shift and focal length of \"{}\" explains the residuals: a lens changed, or more than one view \
                 drifted; calibrate again",
                self.view
            );
        }
        let readings = length::readings(args, shown, self, &estimate)?;
        let all: Vec<LengthReading> = readings.iter().flatten().copied().collect();
        let without_lengths = estimate.models().into_iter().find(ViewCorrection::is_possible);
        estimate = self.with_lengths(args, estimate, &all)?;
        let models = estimate.models();
        let view = match estimate.choose() {
            Some(Choice::Clear(view)) => *view,
            Some(Choice::LengthsOpen { models, apart }) => {
                bail!(self.lengths_open(links, &models, (apart, estimate.u_scale)))
            }
            None if !all.is_empty() && without_lengths.is_some() => {
                let what = format!("the residuals of \"{}\"", self.view);
                bail!(self.lengths_contradict(args, &all, &what))
            }
            None => bail!(
                "{path}: the residuals of \"{}\" contradict every model of its drift; calibrate again",
                self.view
            ),
        };
        let baseline = (!all.is_empty()).then(|| baseline(&view, start, &partners)).flatten();
        let lengths = readings.iter().map(Vec::len).collect();
        let (u_scale, exact) = (estimate.u_scale, length::exact(shown));
        let contradicted = |simple: &ViewCorrection| {
            models.iter().any(|model| model.changes == simple.changes && !model.is_possible())
        };
        let doubted = without_lengths.filter(|simple| !all.is_empty() && contradicted(simple));
        let places = estimate.three_views.iter().map(named).collect();
        let alike = (shown.len() == 1).then(|| moved_alike(rig, [self.view])).flatten();
        Ok(Found { view, models, baseline, u_scale, exact, alike, lengths, doubted, places })
    }

    /// The estimate with the certified lengths that were measured.
    fn with_lengths(
        &self,
        args: &Args,
        estimate: ViewEstimate,
        all: &[LengthReading],
    ) -> Result<ViewEstimate> {
        if all.is_empty() {
            return Ok(estimate);
        }
        let estimate = estimate.with_lengths(all);
        if contradict_all(&estimate.three_views) {
            let what = "what fixed views measure together that have no single one in common";
            bail!(self.lengths_contradict(args, all, what));
        }
        Ok(estimate)
    }

    fn covariance_of(&self, link: &Link) -> Option<PairCovariance> {
        pair_covariance(self.covariance?, &self.pair(link))
    }

    /// The view that measures places together with a partner, and its number. Only where the calibration states what it leaves open of both, since places
    /// of views that count as exact would carry the drifted one with them.
    fn lit_by(&self, link: &Link, devices: &[&str]) -> Option<(&Camera, usize)> {
        let known = &self.covariance?.devices;
        let stated = |name: &str| known.iter().any(|device| device == name);
        let usable = link.second != link.partner && stated(link.second) && stated(link.partner);
        let device = devices.iter().position(|name| *name == link.second).filter(|_| usable)?;
        Some((self.rig_file.rig.device(link.second)?, device))
    }

    /// What the calibration leaves open of the partners, then of the view; views that it did not include count as exact.
    fn calibration(&self, devices: &[&str]) -> Option<ViewCovariance> {
        let covariance = self.covariance?;
        let all = devices.iter().copied().chain([self.view]).enumerate();
        let (blocks, names): (Vec<usize>, Vec<&str>) =
            all.filter(|(_, name)| covariance.devices.iter().any(|device| device == name)).unzip();
        Some(ViewCovariance {
            blocks,
            names: covariance.parameters.clone(),
            matrix: covariance.part(&names)?,
        })
    }

    /// The pair of a link, the view on the right.
    fn pair(&self, link: &Link) -> Pair {
        Pair {
            name: link.check.name.clone(),
            left: link.partner.to_owned(),
            right: self.view.to_owned(),
            projector: link.check.projector.clone(),
        }
    }

    /// What each pair shows with the view in this state.
    fn health(&self, view: &Camera, links: &[Link]) -> Result<Vec<PairAfter>> {
        let one = |link: &Link| {
            let pair = self.pair(link);
            let covariance = self.covariance_of(link);
            let partner = camera(&self.rig_file.rig, link.partner)?;
            let health = check_pair(partner, view, &link.matches, covariance.as_ref(), self.settings)?;
            Ok(PairAfter {
                name: pair.name,
                recording: link.recording,
                further: link.further,
                healthy: health.healthy,
                before_px: link.check.health.drift.rms_px,
                rms_px: health.drift.rms_px,
            })
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

/// The baseline to the first partner that measures, new over old.
fn baseline(found: &ViewCorrection, start: &Camera, partners: &[Partner]) -> Option<Baseline> {
    let fixed = partners.iter().find(|partner| partner.measures)?.fixed;
    let apart = |view: &Camera| (view.centre_mm() - fixed.centre_mm()).norm();
    let factor = apart(&found.camera) / apart(start);
    // The centre moves by Rᵀ of a shift, and by it alone.
    let along = found.camera.camera_from_world.rotation
        * (found.camera.centre_mm() - fixed.centre_mm()).try_normalize(1e-12)?;
    let shift = |i: usize| (0..3).map(|j| along[i] * found.covariance[3 + i][3 + j] * along[j]).sum::<f64>();
    let variance = (0..3).map(shift).sum::<f64>();
    Some(Baseline { factor, u: variance.max(0.0).sqrt() / apart(start) })
}
