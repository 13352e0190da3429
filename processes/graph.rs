//! From the configuration to the graph of the cell and its schedule.

use crate::schedule::{CameraNode, Graph, PairNode, ProjectorNode, Right, Schedule};
use anyhow::{Context, Result, anyhow};
use fringe::decode::DecodeSettings;
use fringe::fusion::FusionSettings;
use fringe::inspection::Plan;
use fringe::matching::MatchSettings;
use fringe::pattern::{Axis, PatternSet, frame_count};
use rig::config::{Config, DEFAULT_RECIPE, TextFile};
use rig::cycle_record::Kept;
use rig::hash::sha256_hex;
use std::collections::BTreeSet;
use std::path::Path;

/// A configuration with everything that follows from it.
#[derive(Debug, Clone)]
pub struct Cell {
    /// Name, which an option may have replaced.
    pub name: String,
    /// As read.
    pub config: Config,
    /// What the schedule was made from.
    pub graph: Graph,
    /// The plan of a cycle.
    pub schedule: Schedule,
    /// Settings of the decoder.
    pub decode: DecodeSettings,
    /// Settings of the matcher.
    pub matching: MatchSettings,
    /// Settings of the fusion.
    pub fusion: FusionSettings,
    /// What is inspected where no recipe is named: the plan of the first recipe.
    pub plan: Option<Plan>,
    /// All that a request may choose; at least one.
    pub recipes: Vec<Recipe>,
}

/// A way to inspect a part.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Name.
    pub name: String,
    /// What is inspected; absent: nothing, the cloud alone is wanted.
    pub plan: Option<Plan>,
}

impl Cell {
    /// SHA-256 of the inspection plan, if there is one.
    pub fn plan_sha256(&self) -> Option<String> {
        self.config.plan.as_ref().map(|plan| sha256_hex(plan.text.as_bytes()))
    }
}

/// What a command adds to the configuration.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Another name, to run one configuration several times at once.
    pub cell: Option<String>,
    /// Whether the supervisor watches frames, phases and the fused cloud.
    pub watch: bool,
    /// Whether a recording is written.
    pub record: bool,
    /// Which bytes a cycle record keeps.
    pub kept: Kept,
}

/// Reads a configuration and plans its cell.
///
/// # Errors
/// Anything that would keep the cell from running: every setting is parsed here, before a process starts.
pub fn load(path: &Path, options: &Options) -> Result<Cell> {
    let config = Config::load(path)?;
    let graph = graph(&config, options)?;
    let schedule = Schedule::new(&graph).with_context(|| path.display().to_string())?;
    let document = &config.document;
    let recipes = recipes(&config)?;
    Ok(Cell {
        name: options.cell.clone().unwrap_or_else(|| config.name.clone()),
        decode: document.typed("decode", config.decode.clone())?,
        matching: document.typed("matching", config.matching.clone())?,
        fusion: document.typed("fusion", config.fusion.clone())?,
        plan: recipes.first().and_then(|recipe| recipe.plan.clone()),
        recipes,
        graph,
        schedule,
        config,
    })
}

/// The plan of the configuration first, then its further recipes; without either one that measures nothing.
fn recipes(config: &Config) -> Result<Vec<Recipe>> {
    let parse = |file: &TextFile| {
        Plan::from_toml(&file.text).map(Some).with_context(|| file.path.display().to_string())
    };
    let first = match &config.plan {
        Some(file) => Some(parse(file)?),
        None => config.recipes.is_empty().then_some(None),
    };
    let first = first.map(|plan| Ok(Recipe { name: DEFAULT_RECIPE.to_owned(), plan }));
    let further = config
        .recipes
        .iter()
        .map(|recipe| Ok(Recipe { name: recipe.name.clone(), plan: parse(&recipe.plan)? }));
    first.into_iter().chain(further).collect()
}

fn graph(config: &Config, options: &Options) -> Result<Graph> {
    let camera = |name: &str| {
        let found = config.cameras.iter().position(|c| c.name == name);
        found.ok_or_else(|| anyhow!("camera \"{name}\" has no [[camera]] in the configuration"))
    };
    let projectors = config.projectors.iter().map(|p| {
        let cameras = p.cameras.iter().map(|name| camera(name)).collect::<Result<Vec<_>>>()?;
        let frames = frame_count(&p.sequence);
        Ok(ProjectorNode { name: p.name.clone(), frames, axes: sine_axes(&p.sequence), cameras })
    });
    let pairs = config.rig.pairs.iter().map(|pair| {
        let projector = config.projectors.iter().position(|p| p.name == pair.projector);
        let projector = projector.ok_or_else(|| {
            anyhow!("pair \"{}\": projector \"{}\" has no [[projector]]", pair.name, pair.projector)
        })?;
        let right = match config.rig.camera(&pair.right) {
            Some(_) => Right::Camera(camera(&pair.right)?),
            None => Right::Projector,
        };
        Ok(PairNode { name: pair.name.clone(), left: camera(&pair.left)?, right, projector })
    });
    let node = |c: &rig::config::CameraConfig| CameraNode {
        name: c.name.clone(),
        width_px: c.width_px,
        height_px: c.height_px,
    };
    Ok(Graph {
        cameras: config.cameras.iter().map(node).collect(),
        projectors: projectors.collect::<Result<_>>()?,
        pairs: pairs.collect::<Result<_>>()?,
        cores: config.schedule.cores as usize,
        in_flight: in_flight(config, options),
        record: options.record,
        watch: options.watch,
        kept: options.kept,
        rate_hz: config.recording.as_ref().map(|r| r.rate_hz),
        cycle_deadline_ms: config.limits.cycle_deadline_ms,
    })
}

/// A record that keeps bytes takes them cycle by cycle, so that a crash loses one cycle and not all that follow.
fn in_flight(config: &Config, options: &Options) -> usize {
    match options.kept {
        Kept::Hashes => config.schedule.cycles_in_flight as usize,
        Kept::Frames | Kept::All => 1,
    }
}

fn sine_axes(sequence: &[PatternSet]) -> Vec<Axis> {
    let sines = sequence.iter().filter(|set| matches!(set, PatternSet::Sine { .. }));
    let axes: BTreeSet<Axis> = sines.filter_map(PatternSet::axis).collect();
    axes.into_iter().collect()
}
