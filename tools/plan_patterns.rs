//! `fringetool plan-patterns`: which period, steps and code to project.

use crate::Outcome;
use crate::reconstruct::surface_settings;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use files::recording::{ProjectorRecord, recording_text};
use files::rig_file::read_rig;
use fringe::geometry::camera::Camera;
use fringe::geometry::rig::{Pair, Rig};
use fringe::pattern::Axis;
use fringe::planning::geometry::Depth;
use fringe::planning::resolution::{Resolution, Seen};
use fringe::planning::step_edge::Crossing;
use fringe::planning::{Proposal, Requirements, geometry, propose};
use fringe::surface::SurfaceSettings;
use nalgebra::Point3;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Rig file (TOML, docs/formats.md): the projector's size and the geometry of its pairs.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Pair of the rig; by default the first.
    #[arg(long, value_name = "NAME", requires = "rig")]
    pair: Option<String>,
    /// Without a rig: projector pixels along the axis.
    #[arg(long, value_name = "PX", conflicts_with = "rig", required_unless_present = "rig")]
    extent_px: Option<u32>,
    /// Without a rig: displacement of a point per projector pixel, micrometres, after smoothing if any.
    #[arg(long, value_name = "UM", conflicts_with = "rig", required_unless_present = "rig")]
    um_per_px: Option<f64>,
    /// Axis along which the patterns vary.
    #[arg(long, value_enum, default_value_t = AxisName::X)]
    axis: AxisName,
    /// Noise of the camera: read noise in grey values, and grey values per electron (`decode --json` reports both).
    #[arg(long, value_name = "DN,DN_PER_E", value_delimiter = ',', num_args = 1..=2, default_value = "0.4,0.024")]
    noise: Vec<f64>,
    /// Largest grey value of the camera.
    #[arg(long, value_name = "DN", default_value_t = 255.0)]
    full_scale_dn: f64,
    /// Half the difference between white and black on the part, grey values (`decode --json`: contrast_median_dn).
    #[arg(long, value_name = "DN", default_value_t = 60.0)]
    modulation_dn: f64,
    /// Background A, grey values (`decode --json`: threshold_median_dn).
    #[arg(long, value_name = "DN", default_value_t = 80.0)]
    background_dn: f64,
    /// Blur of the projector on the part, standard deviation in projector pixels (`focus` measures it).
    #[arg(long, value_name = "PX", default_value_t = 0.6)]
    blur_px: f64,
    /// With a rig: blur of the camera, lens and area of the pixel together, standard deviation in its pixels.
    #[arg(long, value_name = "PX", default_value_t = 0.58)]
    camera_blur_px: f64,
    /// Exponent of the projector's response; 1 for corrected patterns (`gamma` measures it).
    #[arg(long, value_name = "G", default_value_t = 1.05)]
    projector_gamma: f64,
    /// With a rig: side of the window over which `reconstruct` smooths points, px.
    #[arg(long, value_name = "PX", default_value_t = SurfaceSettings::default().smoothing_px)]
    smoothing_px: u32,
    /// Wanted standard uncertainty of a single point, micrometres.
    #[arg(long, value_name = "UM")]
    want_u_um: Option<f64>,
    /// Longest finest period, projector pixels: the shorter, the less light that bounces between faces moves points.
    #[arg(long, value_name = "PX")]
    most_period_px: Option<f64>,
    /// Largest acceptable probability of a wrong fringe order.
    #[arg(long, value_name = "P", default_value_t = 1e-6)]
    most_wrong_orders: f64,
    /// Number of proposals in the table.
    #[arg(long = "proposals", alias = "rows", value_name = "N", default_value_t = 12)]
    rows: usize,
    /// Write the `[[projector]]` section of the first proposal (TOML, docs/formats.md), for a recording or a configuration.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// An axis on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
enum AxisName {
    X,
    Y,
}

/// What the patterns are for.
struct Target {
    projector: String,
    size_px: [u32; 2],
    cameras: Vec<String>,
    depth: Depth,
    /// Projector pixels per camera pixel; 0 where the camera is not known.
    scale: f64,
    /// How the cloud's detail is seen, where the camera is known.
    sight: Option<Sight>,
}

/// The views of a surface in the middle of what they see.
struct Sight {
    seen: Seen,
    views: [Camera; 2],
    light: Camera,
    at: Point3<f64>,
}

impl Sight {
    /// What the cloud resolves under fringes of this many projector pixels.
    fn resolution(&self, period_px: f64) -> Resolution {
        let [first, second] = &self.views;
        let crossing = Crossing::new([first, second], (&self.light, Some(period_px)), &self.at);
        self.seen.resolution(first, crossing, &self.at)
    }
}

/// Standard deviation of two blurs after each other.
fn both_px(one_px: f64, other_px: f64) -> f64 {
    (one_px * one_px + other_px * other_px).sqrt()
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let inputs: Vec<_> = args.rig.iter().map(PathBuf::as_path).collect();
    check_outputs(&[("--out", args.out.as_deref()), ("--json", args.json.as_deref())], &inputs, None)?;
    for (flag, blur_px) in [("--blur-px", args.blur_px), ("--camera-blur-px", args.camera_blur_px)] {
        if !(0.0..=100.0).contains(&blur_px) {
            bail!("{flag} {blur_px}: must be 0 to 100 pixels");
        }
    }
    let axis = match args.axis {
        AxisName::X => Axis::X,
        AxisName::Y => Axis::Y,
    };
    let target = target(args, axis)?;
    let wanted = Requirements {
        axis,
        extent_px: target.size_px[usize::from(axis == Axis::Y)],
        full_scale_dn: args.full_scale_dn,
        modulation_dn: args.modulation_dn,
        background_dn: args.background_dn,
        read_noise_dn: args.noise.first().copied().unwrap_or(0.0),
        gain_dn: args.noise.get(1).copied().unwrap_or(0.0),
        blur_px: both_px(args.blur_px, args.camera_blur_px * target.scale),
        projector_gamma: args.projector_gamma,
        depth: target.depth,
        most_period_px: args.most_period_px,
        want_u_um: args.want_u_um,
        most_wrong: args.most_wrong_orders,
    };
    let proposals = propose(&wanted)?;
    let Some(first) = proposals.first() else {
        bail!(
            "no code numbers {} projector pixels with any period tried: is the projector that large?",
            wanted.extent_px
        );
    };
    let resolution = target.sight.as_ref().map(|sight| sight.resolution(first.period_px));
    print(&target, resolution, &proposals, args.rows);
    if let Some(path) = &args.out {
        files::atomic::write(path, toml_text(&target, first).as_bytes())?;
        println!("{}: {} frames", path.display(), first.frames);
    }
    let best: Vec<&Proposal> = proposals.iter().take(args.rows).collect();
    let result = serde_json::json!({ "wanted": wanted, "proposals": best, "lateral_resolution": resolution });
    emit(args.json.as_deref(), &result)?;
    if first.meets {
        return Ok(Outcome::Done);
    }
    let want = args.want_u_um.map_or_else(String::new, |want| format!("{want} µm with "));
    println!(
        "none meets {want}at most {:e} wrong orders: the best has {:.2} µm, {:.1e}{}; more light, more steps or a larger base are needed",
        args.most_wrong_orders,
        first.u_point_um,
        first.wrong_order,
        if first.usable {
            ""
        } else {
            ", and its fringes are too faint, too noisy or clipped for the decoder"
        }
    );
    Ok(Outcome::LimitFailed)
}

fn target(args: &Args, axis: Axis) -> Result<Target> {
    let Some(path) = &args.rig else {
        let extent_px = args.extent_px.unwrap_or(0);
        return Ok(Target {
            projector: "proj1".into(),
            size_px: [extent_px; 2],
            cameras: vec!["cam1".into()],
            depth: Depth {
                um_per_px: args.um_per_px.unwrap_or(0.0),
                noise_share: 1.0,
                pattern_cancels: false,
            },
            scale: 0.0,
            sight: None,
        });
    };
    let rig = read_rig(path)?.rig;
    let pair = match &args.pair {
        Some(name) => rig.pairs.iter().find(|pair| pair.name == *name).with_context(|| {
            let known: Vec<&str> = rig.pairs.iter().map(|pair| pair.name.as_str()).collect();
            format!("{}: no pair \"{name}\"; known: {}", path.display(), known.join(", "))
        })?,
        None => rig.pairs.first().with_context(|| format!("{}: has no [[pair]]", path.display()))?,
    };
    of_pair((&rig, pair), axis, args.camera_blur_px, &surface_settings(Some(args.smoothing_px)))
        .with_context(|| format!("{}: pair \"{}\"", path.display(), pair.name))
}

fn of_pair(
    (rig, pair): (&Rig, &Pair),
    axis: Axis,
    footprint_px: f64,
    surface: &SurfaceSettings,
) -> Result<Target> {
    let left = rig.camera(&pair.left).with_context(|| format!("no camera \"{}\" in the rig", pair.left))?;
    let name = if rig.projector(&pair.right).is_some() { &pair.right } else { &pair.projector };
    let projector = rig.projector(name).with_context(|| {
        format!(
            "no projector \"{name}\" in the rig, but its pose is needed; give --extent-px and --um-per-px"
        )
    })?;
    let (depth, cameras) = match rig.camera(&pair.right) {
        Some(right) => (
            geometry::by_phase(left, right, projector, axis, surface),
            vec![pair.left.clone(), pair.right.clone()],
        ),
        None => (geometry::by_projector(left, projector, axis, surface), vec![pair.left.clone()]),
    };
    let second = rig.camera(&pair.right);
    let seen = Seen { footprint_px, matched: second.is_some(), smoothing_px: surface.smoothing_px };
    let views = [left, second.unwrap_or(projector)];
    let sight = geometry::middle_mm(views[0], views[1]).map(|at| Sight {
        seen,
        views: views.map(Clone::clone),
        light: projector.clone(),
        at,
    });
    let depth = depth.with_context(|| {
        format!("patterns along {axis:?} contain no depth: the views do not cross; try the other axis")
    })?;
    Ok(Target {
        projector: name.clone(),
        size_px: [projector.width_px, projector.height_px],
        cameras,
        depth,
        scale: geometry::projector_px_per_camera_px(left, projector).unwrap_or(0.0),
        sight,
    })
}

fn print(target: &Target, resolution: Option<Resolution>, proposals: &[Proposal], rows: usize) {
    let Depth { um_per_px, noise_share, pattern_cancels } = target.depth;
    println!(
        "{}: {um_per_px:.1} µm of a point per projector pixel, {:.0} % of the noise left by smoothing{}",
        target.projector,
        noise_share.sqrt() * 100.0,
        if pattern_cancels { "; two cameras: errors of the pattern cancel" } else { "" }
    );
    if let Some(Resolution { pixel_mm, step_mm, step_across_mm, hidden_step_mm }) = resolution {
        let across = step_across_mm.map_or_else(String::new, |mm| {
            format!("{mm:.2} mm across the base (step of 1 mm, fringes of the first proposal), ")
        });
        println!(
            "lateral resolution (10 to 90 % of an edge): {step_mm:.2} mm, {across}{hidden_step_mm:.2} mm where the step hides in the noise of single \
             points; a pixel is {pixel_mm:.3} mm"
        );
    }
    println!(
        "{:20} {:>9} {:>6} {:>7} {:>7} {:>11} {:>12} {:>9} {:>9} {:>12}  meets",
        "order",
        "period px",
        "steps",
        "frames",
        "B DN",
        "noise mrad",
        "pattern mrad",
        "x mpx",
        "point µm",
        "wrong order"
    );
    for p in proposals.iter().take(rows) {
        println!(
            "{:20} {:>9} {:>6} {:>7} {:>7.1} {:>11.2} {:>12.2} {:>9.2} {:>9.2} {:>12.1e}  {}",
            p.order,
            p.period_px,
            p.steps,
            p.frames,
            p.modulation_dn,
            p.sigma_phase_rad * 1e3,
            p.pattern_error_rad * 1e3,
            p.sigma_coordinate_px * 1e3,
            p.u_point_um,
            p.wrong_order,
            if p.meets { "yes" } else { "no" }
        );
    }
    println!(
        "for smooth faces of that brightness, standing still; edges and interreflections are not included"
    );
    if proposals.len() > rows {
        println!("({} more: --proposals)", proposals.len() - rows);
    }
}

/// The `[[projector]]` table alone, without the head of a recording.
fn toml_text(target: &Target, proposal: &Proposal) -> String {
    let record = ProjectorRecord {
        name: target.projector.clone(),
        width_px: target.size_px[0],
        height_px: target.size_px[1],
        cameras: target.cameras.clone(),
        sequence: proposal.sequence.clone(),
        exposures_ms: Vec::new(),
        full_scale_dn: std::collections::BTreeMap::new(),
    };
    let text = recording_text(&[record], &toml::Table::new());
    let table = text.split_once("\n\n").map_or(text.as_str(), |parts| parts.1);
    format!("# decode with --order {}\n{table}", proposal.order)
}
