//! Planes at known heights become a polynomial per pixel.

use super::{Which, decode};
use crate::Outcome;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail};
use characterise::reference_plane::calibrate;
use files::plane_file::{PlaneFile, write_planes};
use files::recording::{RECORDING_FILE, Recording};
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

#[derive(clap::Args)]
pub struct Args {
    /// A plane: its height in mm and its recording (docs/formats.md), such as `0=plane-00`; repeated for each plane. The first one is the reference.
    #[arg(long = "plane", value_name = "MM=RECORDING", required = true, allow_hyphen_values = true)]
    planes: Vec<Plane>,
    /// Degree of the polynomials, 1 to 3; 1 is K₀ alone (eq. 2.19).
    #[arg(long, value_name = "N", default_value_t = 2)]
    degree: usize,
    /// In each pixel, leave out planes beyond so many robust standard deviations of the residuals over the field; `inf` leaves none out.
    #[arg(long = "reject-sigmas", alias = "reject", value_name = "SIGMAS", default_value_t = 6.0)]
    reject: f64,
    /// Camera of the recordings; required when they have several.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Projector of the recordings; required when they have several.
    #[arg(long, value_name = "NAME")]
    projector: Option<String>,
    /// Axis of the fringes: the one along which camera and projector are separated.
    #[arg(long, value_enum, default_value_t = AxisName::X)]
    axis: AxisName,
    /// Folder to write the calibration to.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// An axis on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum AxisName {
    X,
    Y,
}

/// A plane on the command line.
#[derive(Debug, Clone)]
struct Plane {
    height_mm: f64,
    recording: PathBuf,
}

impl FromStr for Plane {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (height, path) = text.split_once('=').ok_or("must be MM=RECORDING, as in 10=plane-10")?;
        let height_mm = height.trim().parse().map_err(|_| format!("\"{height}\" is not a height in mm"))?;
        Ok(Self { height_mm, recording: path.into() })
    }
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    let files: Vec<PathBuf> = args.planes.iter().map(|plane| plane.recording.join(RECORDING_FILE)).collect();
    let inputs: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    check_outputs(&[("--json", args.json.as_deref())], &inputs, Some(&args.out))?;
    let which = which(args)?;
    let maps: Vec<PhaseMap> =
        args.planes.iter().map(|plane| decode(&plane.recording, &which)).collect::<Result<_>>()?;
    let planes: Vec<_> =
        args.planes.iter().zip(&maps).map(|(plane, map)| (plane.height_mm, map.view())).collect();
    let (calibration, report) = calibrate(&planes, args.degree, args.reject)?;
    if report.calibrated == 0 {
        bail!(
            "no pixel has {} planes or more at different phases; check that the recordings are of one camera",
            args.degree + 1
        );
    }
    let mut provenance = toml::Table::new();
    provenance.insert("software".into(), format!("fringetool {}", env!("CARGO_PKG_VERSION")).into());
    let heights: Vec<toml::Value> = args.planes.iter().map(|plane| plane.height_mm.into()).collect();
    provenance.insert("heights_mm".into(), heights.into());
    let file = PlaneFile { projector: which.projector, camera: which.camera, calibration };
    write_planes(&args.out, &file, &provenance)?;
    print!(
        "{}: {} px calibrated with {} planes, degree {}",
        args.out.display(),
        report.calibrated,
        report.planes,
        report.degree
    );
    if let Some([middle, low, high]) = report.k0_mm_per_rad {
        print!("; K0 {middle:.5} mm/rad in the median, {low:.5} … {high:.5} in the inner eight tenths");
    }
    match report.rms_mm {
        Some(rms_mm) => println!("; residual {rms_mm:.4} mm rms"),
        None => println!("; as many coefficients as planes: no residual"),
    }
    for (plane, count) in args.planes.iter().zip(&report.rejected).filter(|(_, count)| **count > 0) {
        println!(
            "  {}: left out of {count} px, where it contradicts the other planes",
            plane.recording.display()
        );
    }
    if report.inconsistent > 0 {
        println!(
            "  {} px left out: their planes contradict each other, and there is no redundancy",
            report.inconsistent
        );
    }
    emit(args.json.as_deref(), &report)?;
    Ok(Outcome::Done)
}

/// The only view there is, or the one that was named.
fn which(args: &Args) -> Result<Which> {
    let first = Recording::open(&args.planes[0].recording)?;
    let asked = |wanted: &Option<String>, name: &str| wanted.as_deref().is_none_or(|wanted| wanted == name);
    let views: Vec<(String, String)> = first
        .projectors
        .iter()
        .filter(|p| asked(&args.projector, &p.name))
        .flat_map(|p| p.cameras.iter().map(move |c| (p.name.clone(), c.name.clone())))
        .filter(|(_, camera)| asked(&args.camera, camera))
        .collect();
    let axis = if args.axis == AxisName::X { Axis::X } else { Axis::Y };
    match views.as_slice() {
        [(projector, camera)] => Ok(Which { projector: projector.clone(), camera: camera.clone(), axis }),
        [] => bail!("{}: no view of that --projector and --camera", first.document.path.display()),
        many => {
            let names: Vec<String> = many.iter().map(|(p, c)| format!("{p} / {c}")).collect();
            let place = first.document.path.display().to_string();
            Err(anyhow::anyhow!("there are {}; name one with --projector and --camera", names.join(", ")))
                .context(place)
        }
    }
}
