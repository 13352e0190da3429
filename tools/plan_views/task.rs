//! Part, rig, patterns and plan: from files and options, or from the configuration of a cell.

use super::{Args, AxisName};
use crate::reconstruct::surface_settings;
use crate::surface::{read_reference, start};
use anyhow::{Context, Result, bail};
use cell::Settings;
use files::config::Config;
use files::hash::sha256_hex;
use files::plan_file::read_plan;
use files::rig_file::{RigFile, read_rig};
use fringe::pattern::Axis;
use fringe::sensor::CameraNoise;
use metrology::inspection::Plan;
use metrology::reference::Reference;
use metrology::register::InitialPose;
use metrology::spatial::TriangleMesh;
use metrology::view_planning::{Conditions, Fringes, Planner};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;
use std::path::Path;

/// What is planned, with which rig.
pub(super) struct Task {
    /// Part, rig and conditions.
    pub(super) planner: Planner,
    /// The rig, with where it was read from.
    pub(super) rig_file: RigFile,
    /// The fringes of each projector; those under the empty name are of all others.
    pub(super) fringes: BTreeMap<String, Vec<Fringes>>,
    /// Of matcher and fusion.
    pub(super) settings: Settings,
    /// The plan, and the SHA-256 of its file.
    pub(super) plan: Option<(Plan, String)>,
    /// Whether the mesh ends somewhere.
    pub(super) is_open: bool,
}

/// Rig, patterns, settings and the plan of a configuration.
struct Cell {
    rig_file: RigFile,
    fringes: BTreeMap<String, Vec<Fringes>>,
    settings: Settings,
    plan: Option<(Plan, String)>,
}

/// The task that the command line describes.
pub(super) fn task(args: &Args) -> Result<Task> {
    let Cell { rig_file, fringes, mut settings, plan } = match (&args.config, &args.rig) {
        (Some(config), _) => of_cell(config)?,
        (None, Some(rig)) => of_rig(args, rig)?,
        (None, None) => bail!("--rig or --config is missing"),
    };
    let plan = match &args.plan {
        Some(path) => {
            let (plan, document) = read_plan(path)?;
            Some((plan, sha256_hex(document.text.as_bytes())))
        }
        None => plan,
    };
    if args.smoothing_px.is_some() {
        settings.matching.surface = surface_settings(args.smoothing_px);
    }
    settings.matching.check().context("--smoothing-px")?;
    let mut placed = plan;
    let world_from_part = match &args.world_from_part {
        Some(path) => match start(&path.to_string_lossy())? {
            InitialPose::Given(pose) => pose.isometry(),
            InitialPose::Search => bail!("--world-from-part: a file with a 4 × 4 matrix is needed"),
        },
        None => placed.as_ref().map_or_else(Isometry3::identity, |(plan, _)| plan.world_from_part),
    };
    if let Some((plan, _)) = &mut placed {
        plan.world_from_part = world_from_part;
    }
    let mesh = mesh(args, &world_from_part)?;
    let is_open = mesh.border_edges() > 0;
    let conditions = conditions(args, &settings);
    let named = || args.part.display().to_string();
    let planner = Planner::new(mesh, &rig_file.rig, &fringes, conditions).with_context(named)?;
    Ok(Task { planner, rig_file, fringes, settings, plan: placed, is_open })
}

fn of_rig(args: &Args, path: &Path) -> Result<Cell> {
    let rig_file = read_rig(path)?;
    if !(2.0..=65_535.0).contains(&args.period_px) {
        bail!("--period-px {}: must be 2 to 65535 projector pixels", args.period_px);
    }
    if !(3..=1000).contains(&args.steps) {
        bail!("--steps {}: must be 3 to 1000", args.steps);
    }
    let axis = match args.axis {
        AxisName::X => Axis::X,
        AxisName::Y => Axis::Y,
    };
    let own = vec![Fringes { axis, period_px: args.period_px, steps: args.steps }];
    let fringes = BTreeMap::from([(String::new(), own)]);
    Ok(Cell { rig_file, fringes, settings: Settings::default(), plan: None })
}

fn of_cell(path: &Path) -> Result<Cell> {
    let found = crate::bundled::find(path)?;
    let config = Config::load(&found.path)?;
    let rig_file = RigFile { rig: config.cell.rig.clone(), ..read_rig(&config.rig_path)? };
    let projectors = config.cell.projectors.iter();
    let fringes = projectors.map(|p| (p.name.clone(), Fringes::of_sequence(&p.sequence))).collect();
    let first = config.cell.recipes.first().and_then(|recipe| recipe.plan.clone());
    let sha256 = config.plans.first().map(|plan| sha256_hex(plan.text.as_bytes()));
    Ok(Cell { rig_file, fringes, settings: config.cell.settings, plan: first.zip(sha256) })
}

/// The mesh in the world frame.
fn mesh(args: &Args, world_from_part: &Isometry3<f64>) -> Result<TriangleMesh> {
    let path = &args.part;
    let Reference::Mesh(mesh) = read_reference(path, &args.chord, Vector3::z(), None)? else {
        bail!("{}: is a cloud; CAD is needed (STEP, STL, PLY with faces, OBJ)", path.display())
    };
    if *world_from_part == Isometry3::identity() {
        return Ok(mesh);
    }
    let moved = |corner: &Point3<f64>| world_from_part * corner;
    let corners: Vec<_> = mesh.triangles().iter().map(|t| t.corners.each_ref().map(moved)).collect();
    TriangleMesh::new(&corners).with_context(|| path.display().to_string())
}

fn conditions(args: &Args, settings: &Settings) -> Conditions {
    Conditions {
        element_mm: args.element_mm,
        white_dn: args.white_dn,
        black_dn: args.black_dn,
        full_scale_dn: args.full_scale_dn,
        noise: CameraNoise {
            read_noise_dn: args.noise.first().copied().unwrap_or(0.0),
            gain_dn: args.noise.get(1).copied().unwrap_or(0.0),
        },
        projector_blur_px: args.blur_px,
        camera_blur_px: args.camera_blur_px,
        albedo: args.albedo,
        bounce_rays: args.bounce_rays,
        surface: settings.matching.surface,
        decode: settings.decode.clone(),
    }
}
