//! `fringetool simulate`: a recording of the digital twin, with the true values in a separate file.

use crate::Outcome;
use crate::bundled;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use crate::rotation_stage::Axis;
use anyhow::{Context, Result, anyhow, bail};
use cell::configuration::ProjectorConfig;
use files::config::{Config, TwinConfig};
use files::document::Document;
use files::recording::{ProjectorRecord, RecordingWriter};
use files::scene_file::parse_scene;
use fringe::frame::{FrameView, Pixels};
use fringe::pattern::{GreyLevels, PatternSet, frame_count};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use twin::{PixelsMut, Scene, Twin, TwinSettings, View};

#[derive(clap::Args)]
pub struct Args {
    /// Cell configuration (TOML, docs/formats.md) whose [twin] is simulated.
    #[arg(default_value = "configs/demo.toml")]
    config: PathBuf,
    /// Folder to write the recording to (docs/formats.md); the true values go to `<DIR>.truth.toml` beside it.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Number of the cycle, which determines the placement of the part.
    #[arg(long, value_name = "N", default_value_t = 0)]
    cycle: u64,
    /// No noise, no blur, 16 bits, regardless of the configuration.
    #[arg(long)]
    ideal: bool,
    /// Scene file (TOML, docs/formats.md) instead of that of the configuration.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Seed instead of that of the configuration.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Separate seed for noise and vibration: the placement of the part does not change.
    #[arg(long, value_name = "N")]
    noise_seed: Option<u64>,
    /// Correct the patterns by this file (from `gamma`; docs/formats.md): for the projector that it names, else for all.
    #[arg(long, value_name = "FILE")]
    pattern_correction: Option<PathBuf>,
    /// Exponent of the projectors' response instead of that of the configuration.
    #[arg(long, value_name = "G")]
    projector_gamma: Option<f64>,
    /// Rays per pixel for first-order interreflections between surfaces (0: none).
    #[arg(long, value_name = "N")]
    bounce_rays: Option<u32>,
    /// Blur of the projector per mm of defocus, projector pixels.
    #[arg(long, value_name = "PX")]
    defocus_px_per_mm: Option<f64>,
    /// Strength of gloss added to all surfaces.
    #[arg(long, value_name = "R")]
    gloss: Option<f64>,
    /// Several exposures of every frame, as factors of that of the configuration: 0.25,1,4.
    #[arg(long, value_name = "F", value_delimiter = ',')]
    exposures: Vec<f64>,
    /// Project this many uniform grey levels, and fringes in 60 steps, instead of the patterns of the configuration: for `gamma`.
    #[arg(long, value_name = "N")]
    grey_levels: Option<u32>,
    /// Angle of a rotation stage that carries the part, degrees.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, requires = "stage_axis")]
    stage_deg: Option<f64>,
    /// Axis of the stage: a point (mm, world frame) and a direction.
    #[arg(long, value_name = "x,y,z,dx,dy,dz", allow_hyphen_values = true, requires = "stage_deg")]
    stage_axis: Option<Axis>,
    /// Write the nominal surface of the scene as a mesh, in the part frame, to this file (STL): the part's CAD.
    #[arg(long, value_name = "FILE.stl")]
    cad: Option<PathBuf>,
    /// Largest depth of a facet of that mesh below a curved face, mm.
    #[arg(long, value_name = "MM", default_value_t = 0.002, requires = "cad")]
    chord_mm: f64,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<&Path> = [Some(&args.config), args.scene.as_ref(), args.pattern_correction.as_ref()]
        .into_iter()
        .flatten()
        .map(PathBuf::as_path)
        .collect();
    let outputs = [("--cad", args.cad.as_deref()), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &inputs, Some(&args.out))?;
    if !(1e-5..=100.0).contains(&args.chord_mm) {
        bail!("--chord-mm {}: must be 0.00001 to 100 mm", args.chord_mm);
    }
    let found = bundled::find(&args.config)?;
    let mut config = Config::load(&found.path)?;
    let Some(twin_config) = &config.twin else {
        bail!("{}: has no [twin]; simulate needs one with a scene", args.config.display());
    };
    let twin_config = twin_config.clone();
    let twin_config = &twin_config;
    if let Some(path) = &args.pattern_correction {
        correct(&mut config, path)?;
    }
    if let Some(levels) = args.grey_levels {
        config.cell.projectors.iter_mut().try_for_each(|p| grey_levels(p, levels))?;
    }
    let scene = load_scene(args.scene.as_deref(), twin_config)?;
    if let Some(path) = &args.cad {
        write_cad(path, &scene, args.chord_mm)?;
    }
    let settings = settings(args, twin_config)?;
    let twin =
        Twin::new(&scene, settings, &twin_config.rig).with_context(|| args.config.display().to_string())?;
    let twin = match args.stage_axis.zip(args.stage_deg) {
        Some((Axis(axis), deg)) if deg.is_finite() => twin.on_stage(axis.turn(deg.to_radians()).isometry()),
        Some((_, deg)) => bail!("--stage-deg {deg}: must be finite"),
        None => twin,
    };
    let truth_path = truth_path(&args.out);
    let truth = truth_text(&scene, &twin, args.cycle);
    let mut progress = Progress::new(frames(&config) * args.exposures.len().max(1), "simulating");
    let place = (args.out.as_path(), truth_path.as_path(), truth.as_str());
    let count = write_recording(place, &config, &twin, args.cycle, &args.exposures, &mut progress)?;
    println!("{}: {count} frames; truth: {}", args.out.display(), truth_path.display());
    let result = serde_json::json!({ "recording": args.out, "truth": truth_path, "frames": count });
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}

/// Writes the nominal surface of the scene.
fn write_cad(path: &Path, scene: &Scene, chord_mm: f64) -> Result<()> {
    let triangles = scene.triangles(chord_mm);
    let corners: Vec<_> = triangles.iter().flatten().copied().collect();
    let numbers: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    files::mesh_file::write_stl(path, &corners, &numbers)?;
    println!("{}: {} triangles", path.display(), triangles.len());
    Ok(())
}

fn settings(args: &Args, twin: &TwinConfig) -> Result<TwinSettings> {
    let written = twin.settings.clone();
    let seed = args.seed.unwrap_or(written.seed);
    if args.ideal {
        let TwinSettings { position_scatter_mm, angle_scatter_deg, .. } = written;
        return Ok(TwinSettings { seed, position_scatter_mm, angle_scatter_deg, ..TwinSettings::ideal() });
    }
    let settings = TwinSettings {
        seed,
        noise_seed: args.noise_seed.or(written.noise_seed),
        projector_gamma: args.projector_gamma.unwrap_or(written.projector_gamma),
        bounce_rays: args.bounce_rays.unwrap_or(written.bounce_rays),
        defocus_px_per_mm: args.defocus_px_per_mm.unwrap_or(written.defocus_px_per_mm),
        gloss: args.gloss.unwrap_or(written.gloss),
        ..written
    };
    // What was written is within its ranges: a flag is not, and is called like its key.
    settings
        .check()
        .map_err(|e| anyhow!("--{} {}: must be {}", e.key.replace('_', "-"), e.value, e.limit))?;
    Ok(settings)
}

/// Puts a correction on the projector that it names, or on all.
fn correct(config: &mut Config, path: &Path) -> Result<()> {
    let correction = files::correction::read_correction(path)?;
    let known = config.cell.projectors.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
    let mut used = false;
    for projector in &mut config.cell.projectors {
        if correction.projector.as_ref().is_none_or(|name| *name == projector.name) {
            projector.level_table = Some(correction.table.clone());
            used = true;
        }
    }
    if !used {
        let name = correction.projector.unwrap_or_default();
        bail!("{}: projector: \"{name}\" is not in the configuration; it has {known}", path.display());
    }
    Ok(())
}

/// Steps of the fringes beside grey levels: a multiple of 3, 4, 5, 6, 10, 12, 15, 20 and 30, for phases of fewer steps.
const FINE_STEPS: u32 = 60;

/// Replaces what a projector shows by grey levels and fringes in fine steps.
fn grey_levels(projector: &mut ProjectorConfig, levels: u32) -> Result<()> {
    let sines = projector.sequence.iter().filter_map(|set| match set {
        PatternSet::Sine { axis, period_px, direction, .. } => Some(PatternSet::Sine {
            axis: *axis,
            period_px: *period_px,
            steps: FINE_STEPS,
            first_step_rad: 0.0,
            direction: *direction,
            shifts_rad: Vec::new(),
        }),
        _ => None,
    });
    let ramp = PatternSet::Ramp { axis: None, levels: Some(GreyLevels::Count(levels)) };
    ramp.check().context("--grey-levels")?;
    projector.sequence = std::iter::once(ramp).chain(sines.take(1)).collect();
    Ok(())
}

/// Reads the scene that the command line or the configuration names.
pub fn load_scene(other: Option<&Path>, config: &TwinConfig) -> Result<Scene> {
    let scene = match other {
        Some(path) => Document::read(path)?,
        None => config.scene.clone(),
    };
    Ok(parse_scene(&scene)?)
}

/// What an exposure factor of 1 is called in a recording, ms.
const NOMINAL_MS: f64 = 10.0;

fn truth_path(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push(".truth.toml");
    out.with_file_name(name)
}

fn records(config: &Config, exposures: &[f64]) -> Vec<ProjectorRecord> {
    let record = |p: &ProjectorConfig| ProjectorRecord {
        name: p.name.clone(),
        width_px: p.width_px,
        height_px: p.height_px,
        cameras: p.cameras.clone(),
        sequence: p.sequence.clone(),
        exposures_ms: exposures.iter().map(|factor| factor * NOMINAL_MS).collect(),
        full_scale_dn: BTreeMap::new(),
    };
    config.cell.projectors.iter().map(record).collect()
}

/// Frames of one recording.
pub fn frames(config: &Config) -> usize {
    config.cell.projectors.iter().map(|p| p.cameras.len() * frame_count(&p.sequence)).sum()
}

/// Renders a recording. The truth (path, text) goes before the file that makes the frames a recording, so that a fault
/// leaves neither.
pub fn write_recording(
    (out, truth_path, truth): (&Path, &Path, &str),
    config: &Config,
    twin: &Twin,
    cycle: u64,
    exposures: &[f64],
    progress: &mut Progress,
) -> Result<usize> {
    if let Some(factor) = exposures.iter().find(|factor| !(1e-4..=1e4).contains(*factor)) {
        bail!("--exposures {factor}: must be 0.0001 to 10000 times the configuration's");
    }
    let records = records(config, exposures);
    let mut writer = RecordingWriter::create(out, &records)?;
    for record in &records {
        let projectors = &config.cell.projectors;
        let number = projectors.iter().position(|p| p.name == record.name);
        let table = number.and_then(|number| projectors[number].level_table.as_ref());
        let mut renderer = twin.corrected_renderer(&record.name, &record.sequence, table)?;
        let group = config.cell.together.iter().find(|group| number.is_some_and(|n| group.contains(&n)));
        let mut lamps = vec![record.name.as_str()];
        for other in group.into_iter().flatten().filter(|other| Some(**other) != number) {
            let other = &projectors[*other];
            renderer.shine_beside(&other.name, &other.sequence, other.level_table.as_ref())?;
            lamps.push(&other.name);
        }
        for camera in &record.cameras {
            let view = twin.view_lit_by(camera, &lamps, cycle)?;
            let mut buffer = Buffer::new(&view);
            let factors = if exposures.is_empty() { &[1.0] } else { exposures };
            for (number, factor) in factors.iter().enumerate() {
                renderer.expose(number as u64, *factor);
                let count = frame_count(&record.sequence);
                for frame in 0..count {
                    renderer.render(&view, frame, buffer.pixels_mut())?;
                    writer.write(&record.name, camera, number * count + frame, &buffer.frame(&view))?;
                    progress.step();
                }
            }
        }
    }
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool simulate {}", env!("CARGO_PKG_VERSION")).into());
    files::correction::note(&mut provenance, config.corrected());
    files::atomic::write(truth_path, truth.as_bytes())?;
    writer.finish(&provenance)?;
    Ok(frames(config) * exposures.len().max(1))
}

/// Pixels of one frame, 8 or 16 bits.
pub enum Buffer {
    Narrow(Vec<u8>),
    Wide(Vec<u16>),
}

impl Buffer {
    /// Buffer for a frame of a view.
    pub fn new(view: &View) -> Self {
        let n = view.width_px() as usize * view.height_px() as usize;
        if view.full_scale_dn() > 255 { Self::Wide(vec![0; n]) } else { Self::Narrow(vec![0; n]) }
    }

    /// To be rendered into.
    pub fn pixels_mut(&mut self) -> PixelsMut<'_> {
        match self {
            Self::Narrow(values) => PixelsMut::Mono8(values),
            Self::Wide(values) => PixelsMut::Mono16(values),
        }
    }

    /// The buffer as a frame.
    pub fn frame(&self, view: &View) -> FrameView<'_> {
        FrameView {
            width_px: view.width_px(),
            height_px: view.height_px(),
            full_scale_dn: view.full_scale_dn(),
            pixels: match self {
                Self::Narrow(values) => Pixels::Mono8(values),
                Self::Wide(values) => Pixels::Mono16(values),
            },
        }
    }
}

/// The truth as TOML: where the part stood, and its true sizes.
pub fn truth_text(scene: &Scene, twin: &Twin, cycle: u64) -> String {
    let pose = twin.pose(cycle);
    let rotation = pose.rotation.to_rotation_matrix();
    let rows: Vec<String> =
        rotation.matrix().row_iter().map(|r| format!("[{:?}, {:?}, {:?}]", r[0], r[1], r[2])).collect();
    let t = pose.translation.vector;
    let mut text = format!(
        "format = \"fringecell-truth/1\"\nscene = {:?}\ncycle = {cycle}\nworld_from_part = {{ rotation = [{}], \
         translation_mm = [{:?}, {:?}, {:?}] }}\n",
        scene.name(),
        rows.join(", "),
        t.x,
        t.y,
        t.z
    );
    for value in &scene.truth().values {
        let _ = write!(
            text,
            "\n[[truth]]\nname = {:?}\nvalue = {:?}\nunit = {:?}\n",
            value.name, value.value, value.unit
        );
    }
    text
}
