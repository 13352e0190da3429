//! `fringetool vdi2634`: an acceptance test, from its plan to the verdict.

use crate::Outcome;
use crate::acceptance_report::{Files, emit_master};
use crate::reconstruct::{Method, fused_cloud, surface_settings};
use crate::report::check_outputs;
use anyhow::{Context, Result, anyhow, bail};
use files::acceptance_file::{parse_rules, parse_test_plan};
use files::document::Document;
use files::hash::sha256_hex;
use files::recording::Recording;
use files::rig_file::{RigFile, read_rig};
use fringe::cloud::Point;
use fringe::surface::SurfaceSettings;
use metrology::acceptance::{Characteristic, Evaluator, Input, RuleSet, TestPlan, TestReport, ViewPlan};
use metrology::verdict::Verdict;
use report::acceptance::write_all;
use std::path::{Path, PathBuf};

/// Rule sets that come with the program.
const RULE_SETS: [(&str, &str); 4] = [
    ("vdi2634-1", include_str!("../configs/rules/vdi2634-1.toml")),
    ("vdi2634-2", include_str!("../configs/rules/vdi2634-2.toml")),
    ("vdi2634-3", include_str!("../configs/rules/vdi2634-3.toml")),
    ("iso10360-13", include_str!("../configs/rules/iso10360-13.toml")),
];

#[derive(clap::Args)]
pub struct Args {
    /// Plan of the test (TOML, docs/formats.md): rule set, conditions, artefacts, limits, positions.
    plan: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    files: Files,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let outputs = args.files.outputs();
    let mut wanted = outputs.flags().to_vec();
    wanted.push(("--json", args.json.as_deref()));
    check_outputs(&wanted, &[&args.plan], None)?;
    let report = evaluate(&args.plan)?;
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
    let rules = rule_set(&plan.rule_set, folder).with_context(named)?;
    let mut evaluator = Evaluator::new(&plan, &rules).with_context(named)?;
    let sources = Sources::new(&plan, folder).with_context(named)?;
    let mut inputs = Vec::new();
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
        evaluator.add(position, &clouds).with_context(named)?;
    }
    let mut conditions = sources.conditions();
    conditions.push(("plan".into(), format!("sha256 {}", sha256_hex(document.text.as_bytes()))));
    conditions.push(("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION"))));
    evaluator.finish(conditions, inputs).with_context(named)
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

/// A rule set by its name, or from a file beside the plan.
fn rule_set(name: &str, folder: &Path) -> Result<RuleSet> {
    if let Some((_, text)) = RULE_SETS.iter().find(|(known, _)| *known == name) {
        return Ok(parse_rules(&Document { path: name.into(), text: (*text).to_owned() })?);
    }
    if Path::new(name).extension().is_none_or(|extension| extension != "toml") {
        let known: Vec<&str> = RULE_SETS.iter().map(|(name, _)| *name).collect();
        bail!("rule_set = \"{name}\": there are {}; or name a rule set file, NAME.toml", known.join(", "));
    }
    Ok(parse_rules(&Document::read(&folder.join(name))?)?)
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

    fn cloud(&self, view: &ViewPlan) -> Result<Vec<Point>> {
        let path = self.folder.join(view.source());
        if view.cloud.is_some() {
            return Ok(crate::surface::read_cloud_in_mm(&path)?.points);
        }
        let (rig, method, surface) = self.rig.as_ref().context("a recording needs [measurement]")?;
        fused_cloud(&Recording::open(&path)?, rig, *method, surface)
            .with_context(|| path.display().to_string())
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
    for (label, text) in &report.conditions {
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
