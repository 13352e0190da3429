//! `fringetool vdi2634`: an acceptance test, from its plan to the verdict.

use crate::Outcome;
use crate::acceptance_report::{Files, emit_master};
use crate::reconstruct::{Method, fused_cloud, surface_settings};
use crate::report::check_outputs;
use anyhow::{Context, Result, anyhow, bail};
use files::acceptance_file::{bundled_rules, own_rules, parse_test_plan};
use files::bundled::RULE_SETS;
use files::document::Document;
use files::hash::sha256_hex;
use files::recording::Recording;
use files::rig_file::{RigFile, read_rig};
use fringe::cloud::Point;
use fringe::pattern::{Axis, PatternSet};
use fringe::planning::geometry::middle_mm;
use fringe::planning::resolution::Seen;
use fringe::planning::step_edge::Crossing;
use fringe::surface::SurfaceSettings;
use metrology::acceptance::{
    Characteristic, Evaluator, Input, LateralResolution, RuleSet, TestPlan, TestReport, ViewPlan,
};
use metrology::verdict::Verdict;
use nalgebra::Point3;
use report::acceptance::{read_master, write_all};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Blur of lens and pixel together where the rig file states none, standard deviation in pixels: as `plan-patterns` assumes it.
const USUAL_FOOTPRINT_PX: f64 = 0.58;
/// Label of the condition; on the screen it stands below the values.
const RESOLUTION: &str = "lateral resolution";

#[derive(clap::Args)]
pub struct Args {
    /// Plan of the test (TOML, docs/formats.md): rule set, conditions, artefacts, limits, positions.
    plan: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Compare with an earlier result of the same plan (its --json file): another one, or a changed one, is an error.
    #[arg(long, value_name = "FILE")]
    verify: Option<PathBuf>,
    #[command(flatten)]
    files: Files,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = args.files.outputs();
    let mut wanted = outputs.flags().to_vec();
    wanted.push(("--json", args.json.as_deref()));
    let inputs: Vec<&Path> = [&args.plan].into_iter().chain(&args.verify).map(PathBuf::as_path).collect();
    check_outputs(&wanted, &inputs, None)?;
    let report = evaluate(&args.plan)?;
    if let Some(earlier) = &args.verify {
        verify(earlier, &report)?;
    }
    write_all(&report, &outputs)?;
    emit_master(args.json.as_deref(), &report)?;
    print(&report);
    let limited = report.characteristics.iter().any(|c| c.limit.is_some());
    // What is not proven is not accepted; without any limit there is nothing to prove.
    let passed = report.verdict == Verdict::Pass || !limited;
    Ok(if passed { Outcome::Done } else { Outcome::LimitFailed })
}

/// Evaluates the recordings of a test plan.
pub fn evaluate(plan_path: &Path) -> Result<TestReport> {
    let named = || plan_path.display().to_string();
    let document = Document::read(plan_path)?;
    let plan = parse_test_plan(&document)?;
    let folder = plan_path.parent().unwrap_or(Path::new(""));
    let (rules, rules_sha256) = rule_set(&plan.rule_set, folder).with_context(named)?;
    let mut evaluator = Evaluator::new(&plan, &rules).with_context(named)?;
    let sources = Sources::new(&plan, folder).with_context(named)?;
    let (mut inputs, mut not_finite) = (Vec::new(), 0);
    for position in &plan.positions {
        for view in &position.views {
            inputs.push(Input {
                position: position.name.clone(),
                repeat: position.repeat,
                view: view.name.clone(),
                source: view.source().to_owned(),
                sha256: sha256_of(&folder.join(view.source())).with_context(named)?,
            });
        }
        let clouds = position.views.iter().map(|view| sources.cloud(view)).collect::<Result<Vec<_>>>();
        let clouds = clouds.with_context(|| format!("{}: position \"{}\"", named(), position.name))?;
        let (clouds, dropped): (Vec<_>, Vec<usize>) = clouds.into_iter().unzip();
        not_finite += dropped.iter().sum::<usize>();
        evaluator.add(position, &clouds).with_context(named)?;
    }
    let mut conditions = sources.conditions();
    conditions.push(("plan".into(), format!("sha256 {}", sha256_hex(document.text.as_bytes()))));
    conditions.push(("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION"))));
    let resolution = sources.resolution(&plan);
    if not_finite > 0 {
        conditions.push((
            "points without coordinates".into(),
            format!("{not_finite}: NaN or infinite in the clouds"),
        ));
    }
    let mut report = evaluator.finish(conditions, inputs).with_context(named)?;
    report.lateral_resolution = report.lateral_resolution.or(resolution);
    if let Some(resolution) = &report.lateral_resolution {
        report.conditions.push((RESOLUTION.into(), resolution.words()));
    }
    if let Some(sha256) = rules_sha256 {
        state_own_rules(&mut report, &sha256);
    }
    Ok(report)
}

/// Refuses an earlier result that the recordings do not bear: a master may be written by hand, so that it agrees with itself.
fn verify(path: &Path, report: &TestReport) -> Result<()> {
    let earlier = serde_json::to_value(read_master(path)?)?;
    let now = serde_json::to_value(report)?;
    match difference("", &earlier, &now) {
        None => Ok(()),
        Some((key, says, gives)) => bail!(
            "{}: {key} is {says}, the recordings of the plan give {gives}: it is no result of this plan, was changed, or was made \
             by another version of this program; evaluate the plan anew",
            path.display()
        ),
    }
}

/// The first key at which two results differ, with both values.
fn difference(key: &str, a: &Value, b: &Value) -> Option<(String, String, String)> {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            let absent = &Value::Null;
            keys.into_iter().find_map(|inner| {
                let at = if key.is_empty() { inner.clone() } else { format!("{key}.{inner}") };
                difference(&at, a.get(inner).unwrap_or(absent), b.get(inner).unwrap_or(absent))
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let pairs = a.iter().zip(b).enumerate();
            pairs.into_iter().find_map(|(i, (a, b))| difference(&format!("{key}[{}]", i + 1), a, b))
        }
        _ => (a != b).then(|| {
            let text = |value: &Value| -> String { value.to_string().chars().take(80).collect() };
            (key.to_owned(), text(a), text(b))
        }),
    }
}

/// SHA-256 of a file; of a folder: of the list of its files, each with its own, in the order of their names.
fn sha256_of(path: &Path) -> Result<String> {
    let read = |path: &Path| std::fs::read(path).with_context(|| path.display().to_string());
    if !path.is_dir() {
        return Ok(sha256_hex(&read(path)?));
    }
    let mut folders = vec![path.to_owned()];
    let mut lines = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
            let inner = entry.with_context(|| folder.display().to_string())?.path();
            if inner.is_dir() {
                folders.push(inner);
            } else {
                let name = inner.strip_prefix(path).unwrap_or(&inner).display().to_string();
                lines.push(format!("{name} {}\n", sha256_hex(&read(&inner)?)));
            }
        }
    }
    lines.sort_unstable();
    Ok(sha256_hex(lines.concat().as_bytes()))
}

/// A rule set by its name, or from a file beside the plan; of a file also its SHA-256.
fn rule_set(name: &str, folder: &Path) -> Result<(RuleSet, Option<String>)> {
    if let Some(rules) = bundled_rules(name)? {
        return Ok((rules, None));
    }
    if Path::new(name).extension().is_none_or(|extension| extension != "toml") {
        let known: Vec<&str> = RULE_SETS.iter().map(|(name, _)| *name).collect();
        bail!("rule_set = \"{name}\": there are {}; or name a rule set file, NAME.toml", known.join(", "));
    }
    let document = Document::read(&folder.join(name))?;
    let sha256 = sha256_hex(document.text.as_bytes());
    Ok((own_rules(&document)?, Some(sha256)))
}

/// Says of rules that do not come with the program that they do not: the standard that they name did not write them.
fn state_own_rules(report: &mut TestReport, sha256: &str) {
    let set = &mut report.rule_set;
    if bundled_rules(&set.id).is_ok_and(|known| known.is_some()) {
        return;
    }
    set.wording = format!(
        "evaluated following a rule set of the operator, \"{}\", named after {}, edition {}",
        set.id, set.standard, set.edition
    );
    report.conditions.push(("rule set file".into(), format!("sha256 {sha256}")));
}

/// Period of the finest fringes across the columns that a projector shows in a recording, else across its rows, projector pixels.
fn finest_px(recording: &Recording, projector: &str) -> Option<f64> {
    let sequence = &recording.projector(projector)?.sequence;
    let period = |set: &PatternSet| match set {
        PatternSet::Sine { period_px, .. } => Some(*period_px),
        PatternSet::Micro { periods_px, .. } => periods_px.iter().copied().min_by(f64::total_cmp),
        _ => None,
    };
    let finest = |axis| {
        let sets = sequence.iter().filter(|set| set.axis() == Some(axis));
        sets.filter_map(period).min_by(f64::total_cmp)
    };
    finest(Axis::X).or_else(|| finest(Axis::Y))
}

/// Where clouds come from.
struct Sources<'a> {
    folder: &'a Path,
    rig: Option<(RigFile, Method, SurfaceSettings)>,
}

impl<'a> Sources<'a> {
    fn new(plan: &TestPlan, folder: &'a Path) -> Result<Self> {
        let Some(measurement) = &plan.measurement else { return Ok(Self { folder, rig: None }) };
        let method = <Method as clap::ValueEnum>::from_str(&measurement.method, false).map_err(|_| {
            anyhow!("measurement: method = \"{}\": there are phase, projector", measurement.method)
        })?;
        let rig = read_rig(&folder.join(&measurement.rig))?;
        Ok(Self { folder, rig: Some((rig, method, surface_settings(measurement.smoothing_px))) })
    }

    /// The points of a view, and how many more have no finite coordinates.
    fn cloud(&self, view: &ViewPlan) -> Result<(Vec<Point>, usize)> {
        let path = self.folder.join(view.source());
        if view.cloud.is_some() {
            let cloud = crate::surface::read_cloud_in_mm(&path)?;
            return Ok((cloud.points, cloud.dropped));
        }
        let (rig, method, surface) = self.rig.as_ref().context("a recording needs [measurement]")?;
        let points = fused_cloud(&Recording::open(&path)?, rig, *method, surface)
            .with_context(|| path.display().to_string())?;
        Ok((points, 0))
    }

    /// What the clouds of recordings resolve in the middle of the volume; of several pairs the one that resolves least.
    fn resolution(&self, plan: &TestPlan) -> Option<LateralResolution> {
        let (RigFile { rig, .. }, method, surface) = self.rig.as_ref()?;
        let mut views = plan.positions.iter().flat_map(|position| &position.views);
        let recorded = views.find(|view| view.cloud.is_none());
        let recording = recorded.and_then(|view| Recording::open(&self.folder.join(view.source())).ok());
        let found = rig.pairs.iter().filter_map(|pair| {
            let left = rig.camera(&pair.left)?;
            let second = rig.camera(&pair.right).filter(|_| matches!(method, Method::Phase));
            let known = rig.sensor(&pair.left).footprint.map(|footprint| footprint.variance_px2().0.sqrt());
            let seen = Seen {
                footprint_px: known.unwrap_or(USUAL_FOOTPRINT_PX),
                matched: second.is_some(),
                smoothing_px: surface.smoothing_px,
            };
            let other = second.or_else(|| rig.projector(&pair.projector))?;
            let at = plan.volume.center_mm.map(Point3::from).or_else(|| middle_mm(left, other))?;
            let source = match known {
                Some(px) => format!("computed from the calibrated footprint of {} ({px:.2} px)", pair.left),
                None => format!("computed from an assumed footprint of {USUAL_FOOTPRINT_PX} px"),
            };
            let light = rig.projector(&pair.projector);
            let crossing = light.and_then(|light| {
                let period_px = finest_px(recording.as_ref()?, &pair.projector);
                Crossing::new([left, other], (light, period_px), &at)
            });
            Some((seen.resolution(left, crossing, &at), source))
        });
        let least = found.max_by(|a, b| a.0.step_mm.total_cmp(&b.0.step_mm));
        least.map(|(found, source)| LateralResolution {
            step_mm: found.step_mm,
            step_across_mm: found.step_across_mm,
            hidden_step_mm: Some(found.hidden_step_mm),
            source,
        })
    }

    fn conditions(&self) -> Vec<(String, String)> {
        let Some((rig, method, surface)) = &self.rig else { return Vec::new() };
        let method = match method {
            Method::Phase => "phase: two cameras, matched by absolute phase",
            Method::Projector => "projector: camera against calibrated projector",
        };
        let smoothing = match surface.smoothing_px {
            1 => "none; ".to_owned(),
            side => format!("a quadratic over {side} × {side} pixels; "),
        };
        let trimmed = format!("points nearer than {} pixels to a rim left out", surface.edge_px);
        vec![
            ("rig file".into(), format!("sha256 {}", rig.sha256)),
            ("method".into(), method.into()),
            ("smoothing of points".into(), smoothing + &trimmed),
        ]
    }
}

fn print(report: &TestReport) {
    let mut reduced =
        if report.reduced.is_empty() { "" } else { " — REDUCED TEST, not the standard's" }.to_owned();
    if report.simulated {
        reduced.push_str(" — SIMULATED, no instrument was tested");
    }
    println!("{}{reduced}", report.rule_set.wording);
    for violation in &report.reduced {
        println!("  breaks a rule: {}", violation.text);
    }
    for assumed in &report.rule_set.assumed {
        println!("  assumed, not read in the standard: {assumed}");
    }
    for (label, text) in report.conditions.iter().filter(|(label, _)| label != RESOLUTION) {
        println!("  {label}: {text}");
    }
    let wide = report.characteristics.iter().map(|c| c.symbol.chars().count()).max().unwrap_or(0).max(14);
    println!(
        "{:wide$} {:>10} {:>9} {:>9} {:>9} {:>9}  {:14} worst at",
        "characteristic", "worst [mm]", "limit", "U (k = 2)", "repeats", "positions", "verdict"
    );
    for one in &report.characteristics {
        println!("{}", line(one, wide));
    }
    match &report.lateral_resolution {
        Some(resolution) => {
            println!("lateral resolution, beside which a form is to be read: {}", resolution.words());
        }
        None => println!(
            "lateral resolution: not stated, so a form error does not tell how much was smoothed; write lateral_resolution_mm \
             in [conditions] of the plan"
        ),
    }
    println!("verdict: {}{reduced}", word(report.verdict));
}

fn line(one: &Characteristic, wide: usize) -> String {
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |v| format!("{v:.4}"));
    let worst = one.positions.iter().find(|p| p.value == one.value && !p.replaced);
    let place = worst.map_or_else(String::new, |p| {
        let views = if p.views.len() > 1 { format!("{} views", p.views.len()) } else { p.views.join("") };
        format!("{} ({views}; {} points, {} rejected)", p.position, p.points, p.rejected)
    });
    let verdict = match (one.verdict, one.decides) {
        (Some(verdict), _) => word(verdict),
        (None, true) => "no limit",
        (None, false) => "",
    };
    format!(
        "{:wide$} {:>+10.4} {:>9} {:>9} {:>9} {:>9}  {verdict:14} {place}",
        one.symbol,
        one.value,
        number(one.limit),
        number(one.test_value_u),
        number(one.repeatability),
        number(one.between_positions),
    )
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Pass => "pass",
        Verdict::Indeterminate => "indeterminate",
        Verdict::Fail => "fail",
    }
}
