//! `fringetool preview`: the live picture of a camera, in the terminal, as a file or in a browser.

// The address and the connections of the live page, which is another program.
#[allow(dead_code)]
#[path = "../../processes/monitor/connection.rs"]
mod connection;
#[allow(dead_code)]
#[path = "../../processes/monitor/guard.rs"]
mod guard;
mod page;

use crate::Outcome;
use crate::live::Live;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, bail, ensure};
use characterise::exposure::{ExposureState, PixelLight, SeenRange, clipped_dn, sharpness};
use files::atomic;
use fringe::frame::FrameView;
use fringe::pattern::{PatternSet, locate};
use ipc::os;
use page::Page;
use report::live::{LivePicture, histogram, histogram_line};
use serde::Serialize;
use std::io::IsTerminal;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

/// Columns of a picture in a browser.
const PAGE_COLUMNS: usize = 1280;

#[derive(clap::Args)]
pub struct Args {
    /// Configuration of the cell.
    #[arg(value_name = "CONFIG")]
    config: PathBuf,
    /// Camera to look through; by default the first one.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Frame of its projector's sequence that is shown, from 1; by default white, else the first one.
    #[arg(long, value_name = "K")]
    frame: Option<usize>,
    /// Show the whole sequence and draw what each pixel sees of it: modulation from teal (none) to yellow (half of the full scale, the most there can
    /// be), red where a frame is clipped, blue without light.
    #[arg(long)]
    modulation: bool,
    /// End after so many pictures; by default 1 where nobody looks, else at Ctrl-C.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    frames: Option<u64>,
    /// Write the last picture to this file.
    #[arg(long, value_name = "FILE.png")]
    png: Option<PathBuf>,
    /// Serve the picture to browsers at this address, for example 127.0.0.1:8081; port 0: any free port.
    #[arg(long, value_name = "ADDRESS:PORT")]
    serve: Option<SocketAddr>,
    /// Allow --serve at an address that other machines can reach: everybody there sees the picture.
    #[arg(long)]
    allow_remote: bool,
    /// Write the figures of the last picture as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The figures of a picture.
#[derive(Debug, Clone, Serialize)]
struct Figures {
    camera: String,
    projector: String,
    /// Frame that was shown, from 1.
    frame: usize,
    /// Pictures that were taken.
    pictures: u64,
    width_px: u32,
    height_px: u32,
    full_scale_dn: u16,
    /// Mean grey value, DN.
    mean_dn: f64,
    /// Clipped pixels over all pixels.
    clipped_fraction: f64,
    /// Pixels that see no light of the sequence, over all; null unless asked for.
    unlit_fraction: Option<f64>,
    /// Median modulation of the pixels with light over the full scale; null unless asked for, or where none has light.
    modulation_median: Option<f64>,
    /// Pixels with a modulation below 5 % of the full scale, over those with light; null likewise.
    weak_fraction: Option<f64>,
    /// Larger is sharper, for the same scene and pattern.
    sharpness: f64,
    /// Pixels by grey value, dark to full scale.
    histogram: Vec<u32>,
}

/// Shows pictures until their number or Ctrl-C.
pub fn run(args: &Args) -> Result<Outcome> {
    if let Some(address) = args.serve.filter(|address| !address.ip().is_loopback() && !args.allow_remote) {
        bail!(
            "--serve {address}: other machines can reach this address; use 127.0.0.1, or add --allow-remote"
        );
    }
    let name = match &args.camera {
        Some(name) => name.clone(),
        None => devices::load(&args.config, &cell::Options::default())?.config.cameras[0].name.clone(),
    };
    let mut live = Live::open(&args.config, Some(&name))?;
    let outputs = [("--png", args.png.as_deref()), ("--json", args.json.as_deref())];
    check_outputs(&outputs, &live.cell.file.paths(), None)?;
    let (camera, _) = live.cameras().first().cloned().context("no camera is open")?;
    let projectors = &live.cell.graph.projectors;
    let projector = projectors.iter().position(|p| p.cameras.contains(&camera));
    let projector = projector.with_context(|| format!("--camera {name}: no projector lights it"))?;
    let frame = frame_number(args, &live, projector)?;
    let page = args.serve.map(Page::serve).transpose()?;
    if let Some(page) = &page {
        println!("http://{}/ shows camera \"{name}\" until Ctrl-C", page.address);
    }
    let terminal = std::io::stdout().is_terminal()
        && !cli::is_quiet()
        && args.json.as_deref().is_none_or(|path| path != "-");
    let most = args.frames.unwrap_or(if terminal || page.is_some() { u64::MAX } else { 1 });
    os::catch_termination()?;
    let mut shown = None;
    for pictures in 1..=most {
        let (picture, mut figures) = look(&mut live, (camera, projector, frame), args.modulation)?;
        let picture = Arc::new(picture);
        figures.pictures = pictures;
        if let Some(page) = &page {
            page.show(picture.clone(), picture.to_jpeg(PAGE_COLUMNS)?, serde_json::to_string(&figures)?);
        }
        print(&picture, &figures, terminal)?;
        shown = Some((picture, figures));
        if os::is_terminated() {
            break;
        }
    }
    let (picture, figures) = shown.context("no picture was taken")?;
    if let Some(path) = &args.png {
        atomic::write(path, &picture.to_png()?)?;
        println!("{}", path.display());
    }
    emit(args.json.as_deref(), &figures)?;
    Ok(Outcome::Done)
}

/// The frame to show, from 0.
fn frame_number(args: &Args, live: &Live, projector: usize) -> Result<usize> {
    let count = live.cell.graph.projectors[projector].frames;
    let sequence = &live.cell.config.projectors[projector].sequence;
    let is_white = |frame: &usize| {
        locate(sequence, *frame).is_some_and(|(set, _)| matches!(sequence[set], PatternSet::White {}))
    };
    match args.frame {
        None => Ok((0..count).find(is_white).unwrap_or(0)),
        Some(frame) => {
            ensure!(
                (1..=count).contains(&frame),
                "--frame {frame}: the sequence has the frames 1 to {count}"
            );
            Ok(frame - 1)
        }
    }
}

/// Takes one picture; for its modulation the whole sequence.
fn look(
    live: &mut Live,
    (camera, projector, number): (usize, usize, usize),
    modulation: bool,
) -> Result<(LivePicture, Figures)> {
    let count = live.cell.graph.projectors[projector].frames;
    let frames = if modulation { 0..count } else { number..number + 1 };
    let mut range: Option<SeenRange> = None;
    let mut kept = None;
    live.show(projector, frames, |_, taken, frame| {
        if modulation {
            range.get_or_insert_with(|| SeenRange::new(frame.pixels.len(), frame.full_scale_dn)).take(&frame);
        }
        if taken == number {
            kept = Some(fringe::frame::Frame::from(frame));
        }
        Ok(())
    })?;
    let frame = kept.context("the frame did not come")?;
    let seen = range.as_ref().map(SeenRange::pixels).unwrap_or_default();
    let clipped = clipped_dn(frame.full_scale_dn);
    let picture = LivePicture::new(&frame.view(), clipped as f32, &seen)?;
    let mut figures = figures(&frame.view(), clipped, &seen, range.and_then(|range| range.state()));
    figures.camera.clone_from(&live.cell.config.cameras[camera].name);
    figures.projector.clone_from(&live.cell.config.projectors[projector].name);
    figures.frame = number + 1;
    Ok((picture, figures))
}

fn figures(
    frame: &FrameView<'_>,
    clipped_dn: f64,
    seen: &[PixelLight],
    state: Option<ExposureState>,
) -> Figures {
    let values = || (0..frame.pixels.len()).map(|place| f64::from(frame.pixels.get(place)));
    let count = frame.pixels.len().max(1) as f64;
    Figures {
        camera: String::new(),
        projector: String::new(),
        frame: 0,
        pictures: 0,
        width_px: frame.width_px,
        height_px: frame.height_px,
        full_scale_dn: frame.full_scale_dn,
        mean_dn: values().sum::<f64>() / count,
        clipped_fraction: values().filter(|value| *value >= clipped_dn).count() as f64 / count,
        unlit_fraction: (!seen.is_empty())
            .then(|| seen.iter().filter(|light| **light == PixelLight::Unlit).count() as f64 / count),
        modulation_median: state.map(|state| state.modulation_median),
        weak_fraction: state.map(|state| state.weak_fraction),
        sharpness: sharpness(frame),
        histogram: histogram(frame).to_vec(),
    }
}

fn print(picture: &LivePicture, figures: &Figures, terminal: bool) -> Result<()> {
    if terminal {
        let (rows, columns) = console::Term::stdout().size();
        let room = usize::from(rows).saturating_sub(3).max(1);
        // From the top of the screen, without what was below.
        print!("\x1b[H\x1b[J{}", picture.half_blocks(usize::from(columns).max(1), room)?);
    }
    let Figures {
        camera,
        projector,
        frame,
        mean_dn,
        full_scale_dn,
        clipped_fraction,
        sharpness,
        histogram,
        ..
    } = figures;
    let unlit = figures
        .unlit_fraction
        .map_or(String::new(), |unlit| format!(", {:.1} % without light", 100.0 * unlit));
    let modulation =
        figures.modulation_median.zip(figures.weak_fraction).map_or(String::new(), |(median, weak)| {
            format!(
                ", modulation {:.1} % of the full scale (median), {:.1} % weak",
                100.0 * median,
                100.0 * weak
            )
        });
    println!(
        "{camera} under {projector}, frame {frame}: mean {mean_dn:.1} of {full_scale_dn} DN, {:.2} % clipped{unlit}{modulation}, sharpness {sharpness:.3}\n|{}|",
        100.0 * clipped_fraction,
        histogram_line(histogram)
    );
    Ok(())
}
