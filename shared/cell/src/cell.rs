//! A cell: a checked configuration with the graph and the schedule that follow from it.

use crate::error::CellError;
use crate::frame_format::FrameFormat;
use crate::graph::{CameraNode, Graph, PairNode, ProjectorNode, Right};
use crate::schedule::Schedule;
use files::config::{CameraConfig, Config, DEFAULT_RECIPE, TextFile};
use files::cycle_record::{Kept, RecordedRecipe};
use files::hash::sha256_hex;
use fringe::decode::DecodeSettings;
use fringe::fusion::FusionSettings;
use fringe::matching::MatchSettings;
use fringe::pattern::{Axis, PatternSet, frame_count};
use metrology::inspection::Plan;
use std::collections::BTreeSet;

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
    /// All that a request may choose; at least one. The first one counts where none is named.
    pub recipes: Vec<Recipe>,
    /// How frames lie in memory: by projector and camera; absent where the camera does not look at the projector.
    pub formats: Vec<Vec<Option<FrameFormat>>>,
}

/// A way to inspect a part.
#[derive(Debug, Clone)]
pub struct Recipe {
    /// Name.
    pub name: String,
    /// What is inspected; absent: nothing, the cloud alone is wanted.
    pub plan: Option<Plan>,
    /// SHA-256 of the file of the plan.
    pub plan_sha256: Option<String>,
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

impl Cell {
    /// Plans the cell of a configuration.
    ///
    /// # Errors
    /// Anything that would keep the cell from running: every setting is parsed here, before a process starts.
    pub fn new(
        config: Config,
        formats: Vec<Vec<Option<FrameFormat>>>,
        options: &Options,
    ) -> Result<Self, CellError> {
        let graph = graph(&config, options)?;
        let schedule =
            Schedule::new(&graph).map_err(|e| CellError::from(e).at(config.document.path.as_path()))?;
        let document = &config.document;
        let recipes = recipes(&config)?;
        Ok(Self {
            name: options.cell.clone().unwrap_or_else(|| config.name.clone()),
            decode: document.typed("decode", config.decode.clone())?,
            matching: document.typed("matching", config.matching.clone())?,
            fusion: document.typed("fusion", config.fusion.clone())?,
            recipes,
            graph,
            schedule,
            formats,
            config,
        })
    }

    /// How the frames of a camera under a projector lie in memory.
    ///
    /// # Errors
    /// The camera does not look at the projector.
    pub fn format(&self, projector: usize, camera: usize) -> Result<FrameFormat, CellError> {
        let format = self.formats.get(projector).and_then(|cameras| cameras.get(camera).copied().flatten());
        format.ok_or_else(|| {
            let (camera, projector) =
                (&self.config.cameras[camera].name, &self.config.projectors[projector].name);
            CellError::Unknown(format!("camera \"{camera}\" does not look at projector \"{projector}\""))
        })
    }
}

/// The plan of the configuration first, then its further recipes; without either one that measures nothing.
fn recipes(config: &Config) -> Result<Vec<Recipe>, CellError> {
    let recipe = |name: &str, file: &TextFile| {
        let plan = Plan::from_toml(&file.text).map_err(|e| CellError::from(e).at(file.path.as_path()))?;
        let plan_sha256 = Some(sha256_hex(file.text.as_bytes()));
        Ok(Recipe { name: name.to_owned(), plan: Some(plan), plan_sha256 })
    };
    let first = config.plan.iter().map(|plan| (DEFAULT_RECIPE, plan));
    let further = config.recipes.iter().map(|recipe| (recipe.name.as_str(), &recipe.plan));
    let mut recipes =
        first.chain(further).map(|(name, file)| recipe(name, file)).collect::<Result<Vec<_>, CellError>>()?;
    if recipes.is_empty() {
        recipes.push(Recipe { name: DEFAULT_RECIPE.to_owned(), plan: None, plan_sha256: None });
    }
    Ok(recipes)
}

/// The recipes of a cell as a cycle record names them.
pub fn recorded_recipes(cell: &Cell) -> Vec<RecordedRecipe> {
    let recorded = |r: &Recipe| RecordedRecipe { name: r.name.clone(), plan_sha256: r.plan_sha256.clone() };
    cell.recipes.iter().map(recorded).collect()
}

fn graph(config: &Config, options: &Options) -> Result<Graph, CellError> {
    let camera = |name: &str| {
        let found = config.cameras.iter().position(|c| c.name == name);
        found.ok_or_else(|| {
            CellError::Unknown(format!("camera \"{name}\" has no [[camera]] in the configuration"))
        })
    };
    let projectors = config.projectors.iter().map(|p| {
        let cameras = p.cameras.iter().map(|name| camera(name)).collect::<Result<Vec<_>, CellError>>()?;
        let frames = frame_count(&p.sequence);
        Ok(ProjectorNode { name: p.name.clone(), frames, axes: sine_axes(&p.sequence), cameras })
    });
    let pairs = config.rig.pairs.iter().map(|pair| {
        let projector = config.projectors.iter().position(|p| p.name == pair.projector);
        let projector = projector.ok_or_else(|| {
            let (pair, projector) = (&pair.name, &pair.projector);
            CellError::Unknown(format!("pair \"{pair}\": projector \"{projector}\" has no [[projector]]"))
        })?;
        let right = match config.rig.camera(&pair.right) {
            Some(_) => Right::Camera(camera(&pair.right)?),
            None => Right::Projector,
        };
        Ok(PairNode { name: pair.name.clone(), left: camera(&pair.left)?, right, projector })
    });
    let node =
        |c: &CameraConfig| CameraNode { name: c.name.clone(), width_px: c.width_px, height_px: c.height_px };
    Ok(Graph {
        cameras: config.cameras.iter().map(node).collect(),
        projectors: projectors.collect::<Result<_, CellError>>()?,
        pairs: pairs.collect::<Result<_, CellError>>()?,
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
