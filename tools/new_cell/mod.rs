//! `fringetool new-cell`: finds the cameras on the network and writes the configuration of a cell, with comments.

mod ask;
mod text;

use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail, ensure};
use ask::Answers;
use cell::Options;
use cell::pixel_format::PixelFormat;
use characterise::nominal::Intended;
use devices::{FoundCamera, LoadedCell, Place, ProbedCamera};
use files::rig_file::{read_rig, write_rig};
use fringe::geometry::rig::Rig;
use fringe::text::is_cell_name;
use std::net::{IpAddr, SocketAddr};
use std::path::{Path, PathBuf};

/// Most cameras of a new cell.
const MOST_CAMERAS: usize = 64;

#[derive(clap::Args)]
pub struct Args {
    /// Configuration to write (TOML); a rig that is meant, not calibrated, comes beside it as `<FILE>.rig.toml`.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Name of the cell: a–z, 0–9, `-` and `_`.
    #[arg(long, value_name = "NAME", default_value = "cell")]
    name: String,
    /// Addresses of the cameras, in the order of the views; by default all that answer, in the order of their addresses.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    cameras: Vec<IpAddr>,
    /// Calibrated rig file instead of one that is meant; its cameras are cam1, cam2 …, its projector proj1.
    #[arg(long, value_name = "FILE")]
    rig: Option<PathBuf>,
    /// Inspection plan of the parts.
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Columns and rows of the projector, px.
    #[arg(long, value_name = "SIZE", default_value = "1920x1080")]
    projector_size: String,
    /// Address and port of the program that shows the patterns.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:3957")]
    projector: SocketAddr,
    /// Time from pattern to pattern, ms, of a projector that shows its sequence by itself and fires the cameras; without it, the cell
    /// steps the patterns.
    #[arg(long, value_name = "MS")]
    period_ms: Option<f64>,
    /// Distance from the devices to the part, mm.
    #[arg(long, value_name = "MM", default_value_t = 500.0)]
    distance_mm: f64,
    /// Width of what a camera sees at that distance, mm.
    #[arg(long, value_name = "MM", default_value_t = 240.0)]
    field_mm: f64,
    /// Ask nothing, also at a terminal.
    #[arg(long)]
    yes: bool,
    /// Write what was found and written as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// A camera of the new cell.
pub(crate) struct NewCamera {
    /// Where the device is.
    pub place: Place,
    /// What it said of itself.
    pub probed: ProbedCamera,
    /// The format that the cell shall use: the one with most bits that it has.
    pub format: PixelFormat,
}

/// Finds, asks, writes, and checks that `fringecell schedule` accepts what was written.
pub fn run(args: &Args) -> Result<Outcome> {
    ensure!(is_cell_name(&args.name), "--name {:?}: {}", args.name, fringe::text::CELL_NAME);
    let rig_path = args.rig.clone().unwrap_or_else(|| args.out.with_extension("rig.toml"));
    check_files(args, &rig_path)?;
    let answers = Answers::of(args)?;
    let cameras = cameras(&args.cameras)?;
    for (number, camera) in cameras.iter().enumerate() {
        let ProbedCamera { model, serial, width_px, height_px, .. } = &camera.probed;
        println!("cam{}: {model} {serial} at {}, {width_px} × {height_px} px", number + 1, camera.place);
    }
    let rig = match &args.rig {
        Some(path) => calibrated(path, &cameras)?,
        None => Intended {
            cameras_px: cameras.iter().map(|c| [c.probed.width_px, c.probed.height_px]).collect(),
            projector_px: answers.projector_px,
            distance_mm: answers.distance_mm,
            field_mm: answers.field_mm,
        }
        .rig(),
    };
    let text = text::configuration(args, &answers, &cameras, &rig, &rig_path)?;
    let cell = write(args, &rig_path, &rig, &text).inspect_err(|_| {
        // What no cell can be made of must not look like one.
        let _ = std::fs::remove_file(&args.out);
        if args.rig.is_none() {
            let _ = std::fs::remove_file(&rig_path);
        }
    })?;
    let result = serde_json::json!({
        "config": args.out,
        "rig": rig_path,
        "calibrated": args.rig.is_some(),
        "frames": cell.graph.projectors.iter().map(|p| p.frames).sum::<usize>(),
        "cameras": cameras.iter().enumerate().map(|(number, camera)| camera.json(number)).collect::<Vec<_>>(),
    });
    emit(args.json.as_deref(), &result)?;
    Ok(Outcome::Done)
}

/// Inputs are there, and outputs are not: a person may have written into them since.
fn check_files(args: &Args, rig_path: &Path) -> Result<()> {
    let mut outputs = vec![("--out", Some(args.out.as_path())), ("--json", args.json.as_deref())];
    if args.rig.is_none() {
        outputs.push(("--out", Some(rig_path)));
    }
    let inputs: Vec<&Path> = args.rig.iter().chain(&args.plan).map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs, None)?;
    if let Some(path) = inputs.iter().find(|path| !path.exists()) {
        bail!("{}: there is no such file", path.display());
    }
    let written = outputs.iter().filter(|(flag, _)| *flag == "--out").filter_map(|(_, path)| *path);
    match written.into_iter().find(|path| path.exists() && !files::guard::replaces_anything()) {
        Some(path) => {
            bail!("--out {}: a file is there; name another one, or add --force to replace it", path.display())
        }
        None => Ok(()),
    }
}

/// Writes rig and configuration, and reads them as the cell will.
fn write(args: &Args, rig_path: &Path, rig: &Rig, text: &str) -> Result<LoadedCell> {
    if args.rig.is_none() {
        let mut provenance = toml::Table::new();
        provenance.insert("made_by".into(), "fringetool new-cell: as it is meant, not calibrated".into());
        write_rig(rig_path, rig, &provenance, None)?;
    }
    files::atomic::write(&args.out, text.as_bytes())?;
    let cell = devices::load(&args.out, &Options::default())?;
    devices::check(&cell)?;
    if args.rig.is_none() {
        println!(
            "{}: as it is meant; calibrate it before the first measurement (fringetool calibrate)",
            rig_path.display()
        );
    }
    println!("{}: next, fringetool doctor {0} and fringecell schedule {0}", args.out.display());
    Ok(cell)
}

impl NewCamera {
    fn json(&self, number: usize) -> serde_json::Value {
        serde_json::json!({
            "name": format!("cam{}", number + 1),
            "address": self.place.address(),
            "model": self.probed.model,
            "serial": self.probed.serial,
            "width_px": self.probed.width_px,
            "height_px": self.probed.height_px,
            "pixel_format": self.format.name(),
        })
    }
}

/// The cameras at these addresses, else all that answer.
fn cameras(addresses: &[IpAddr]) -> Result<Vec<NewCamera>> {
    if let Some(twice) =
        (1..addresses.len()).find(|number| addresses[..*number].contains(&addresses[*number]))
    {
        bail!("--cameras: {} stands there twice", addresses[twice]);
    }
    let mut places: Vec<Place> = addresses.iter().copied().map(Place::Gige).collect();
    if places.is_empty() {
        places.extend(devices::find_cameras()?.iter().map(FoundCamera::place));
    }
    if places.is_empty() {
        bail!(
            "no camera answers; power the cameras, see `fringetool doctor`, or name their addresses with --cameras"
        );
    }
    ensure!(
        places.len() <= MOST_CAMERAS,
        "{} cameras answer; name those of the cell with --cameras",
        places.len()
    );
    let probe = |place: Place| {
        let probed = devices::probe_camera(&place).with_context(|| {
            format!("camera at {place}: it does not answer, or another program controls it; see `fringetool doctor`")
        })?;
        let mut formats: Vec<PixelFormat> = PixelFormat::ALL
            .into_iter()
            .filter(|format| probed.pixel_formats.iter().any(|name| name == format.name()))
            .collect();
        // Of two with as many bits the first one is the simpler.
        formats.sort_by_key(|format| std::cmp::Reverse(format.full_scale_dn()));
        let Some(format) = formats.first().copied() else {
            let known = PixelFormat::ALL.map(PixelFormat::name).join(", ");
            bail!("camera at {place}: it sends {}; a cell takes {known}", probed.pixel_formats.join(", "));
        };
        Ok(NewCamera { place, probed, format })
    };
    places.into_iter().map(probe).collect()
}

/// A calibrated rig that has the cameras, with their sizes.
fn calibrated(path: &Path, cameras: &[NewCamera]) -> Result<Rig> {
    let rig = read_rig(path)?.rig;
    for (number, camera) in cameras.iter().enumerate() {
        let name = format!("cam{}", number + 1);
        let Some(known) = rig.camera(&name) else {
            bail!("{}: it has no camera \"{name}\", and {} cameras answer", path.display(), cameras.len());
        };
        let ProbedCamera { width_px, height_px, .. } = camera.probed;
        ensure!(
            [known.width_px, known.height_px] == [width_px, height_px],
            "{}: camera \"{name}\" has {} × {} px, the device at {} is set to {width_px} × {height_px} px",
            path.display(),
            known.width_px,
            known.height_px,
            camera.place
        );
    }
    Ok(rig)
}
