//! `fringetool explore`: which patterns a folder of frames shows, and the recording that it could be.

mod proposal;
mod relief;
mod self_calibration;
mod series;

use crate::Outcome;
use crate::progress::Progress;
use crate::report::{check_outputs, emit};
use anyhow::{Context, Result, ensure};
use characterise::explore::{Exploration, FoundSet, explore};
use files::atomic;
use files::image_file::Channel;
use fringe::frame::{Frame, FrameView};
use report::ColourMap;
use report::picture::{Range, Scalar, scalar_png};
use series::Series;
use std::path::PathBuf;

#[derive(clap::Args)]
pub struct Args {
    /// Folder of frames, or of one folder a camera, in the order of their numbers; or a recording, whose sequence is tested.
    frames: PathBuf,
    /// Columns and rows of the projector, such as `1920x1080`: the lengths of the proposal rest on it.
    #[arg(long, value_name = "SIZE")]
    projector_size: Option<String>,
    /// Channel of colour pictures: grey (all channels equal), red, green, blue or luminance.
    #[arg(long, value_name = "NAME", default_value = "grey", value_parser = channel)]
    channel: Channel,
    /// New folder for the proposed recording (docs/formats.md): frames in the order of projection, `recording.toml` with what is
    /// uncertain, pictures of saturation and modulation, phase and relief of each camera.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Write the result as JSON to this file; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn channel(text: &str) -> Result<Channel, String> {
    Channel::by_name(text).ok_or_else(|| "grey, red, green, blue or luminance".to_owned())
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    check_outputs(&[("--json", args.json.as_deref())], &[&args.frames], args.out.as_deref())?;
    let given_px = args.projector_size.as_deref().map(size).transpose()?;
    let cameras = series::find(&args.frames)?;
    let (mut explored, mut maps) = (Vec::new(), Vec::new());
    let count = cameras.iter().map(|camera| camera.files.len()).sum();
    let mut progress = Progress::new(count, "reading");
    for camera in &cameras {
        let frames = load(camera, args.channel, &mut progress)?;
        let views: Vec<FrameView> = frames.iter().map(Frame::view).collect();
        let found = explore(&views, given_px.or(camera.projector_px))
            .with_context(|| format!("{}: camera \"{}\"", args.frames.display(), camera.name))?;
        print_camera(camera, &found);
        if args.out.is_some() {
            maps.extend(paint_maps(&camera.name, &views)?);
        }
        explored.push(found);
    }
    conclude(args, &cameras, &explored, &maps)?;
    Ok(Outcome::Done)
}

/// Prints, and writes, what all cameras together show.
fn conclude(
    args: &Args,
    cameras: &[Series],
    explored: &[Exploration],
    maps: &[(String, Vec<u8>)],
) -> Result<()> {
    let best = best_of(explored);
    let differing: Vec<&str> = cameras
        .iter()
        .zip(explored)
        .filter(|(_, found)| !alike(found, &explored[best]))
        .map(|(camera, _)| camera.name.as_str())
        .collect();
    if !differing.is_empty() {
        println!(
            "\nThe cameras differ: {} from \"{}\", whose sequence is proposed.",
            differing.join(", "),
            cameras[best].name
        );
    }
    let proposed = &explored[best];
    println!("\nProposed sequence:");
    for found in &proposed.sets {
        println!("  {}", files::recording::set_text(&found.set));
    }
    for line in proposal::doubts(proposed) {
        println!("  uncertain: {line}");
    }
    for camera in cameras {
        print_declared(camera, proposed);
    }
    let mut pairs = Vec::new();
    if let Some(out) = &args.out {
        ensure!(
            !proposed.sets.is_empty(),
            "{}: no set was found, so there is no recording to propose",
            args.frames.display()
        );
        proposal::write(out, &args.frames, cameras, proposed, args.channel)?;
        for (name, png) in maps {
            atomic::write(&out.join(name), png)?;
        }
        relief::write(out)?;
        pairs = self_calibration::write(out)?;
        println!("\n{}: the proposed recording; next: fringetool decode {0} --out DIR", out.display());
    }
    let result: Vec<_> = cameras
        .iter()
        .zip(explored)
        .map(|(camera, found)| serde_json::json!({ "camera": camera.name, "files": camera.files, "found": found }))
        .collect();
    emit(
        args.json.as_deref(),
        &serde_json::json!({ "cameras": result, "proposed": cameras[best].name, "differing": differing, "self_calibration": pairs }),
    )
}

fn load(camera: &Series, channel: Channel, progress: &mut Progress) -> Result<Vec<Frame>> {
    let mut frames: Vec<Frame> = Vec::with_capacity(camera.files.len());
    for file in &camera.files {
        let frame = files::image_file::read_channel(file, camera.full_scale_dn, channel)?;
        if frames.is_empty() {
            let pixels = u64::from(frame.width_px) * u64::from(frame.height_px);
            // Grey values of up to two bytes, and the smallest and largest of each pixel.
            let needed = pixels * (2 * camera.files.len() as u64 + 8);
            files::memory::check(file, &format!("{} frames", camera.files.len()), needed)?;
        }
        frames.push(frame);
        progress.step();
    }
    Ok(frames)
}

/// The exploration that explains most frames, with the fewest doubts.
fn best_of(explored: &[Exploration]) -> usize {
    let rank = |found: &Exploration| {
        (found.unexplained.len(), found.sets.iter().map(|s| s.doubts.len()).sum::<usize>())
    };
    (0..explored.len()).min_by_key(|index| rank(&explored[*index])).unwrap_or_default()
}

/// Whether two cameras show the same sets in the same frames.
fn alike(a: &Exploration, b: &Exploration) -> bool {
    let shown = |found: &FoundSet| (found.set.name(), found.set.axis(), found.frames.clone());
    a.sets.iter().map(shown).eq(b.sets.iter().map(shown))
}

fn print_camera(camera: &Series, found: &Exploration) {
    println!(
        "\ncamera \"{}\": {} frames, {:.0} % of the picture lit by patterns",
        camera.name,
        camera.files.len(),
        100.0 * found.lit_share
    );
    println!(
        "{:>5}  {:24} {:>7} {:>7} {:>7} {:>7} {:>9}  looks like",
        "frame", "file", "mean", "bright", "edges x", "edges y", "saturated"
    );
    for (number, figures) in found.frames.iter().enumerate() {
        let name = camera.files[number].file_name().unwrap_or_default().to_string_lossy().into_owned();
        println!(
            "{:>5}  {name:24} {:>7.1} {:>5.0} % {:>7.4} {:>7.4} {:>7.2} %  {}",
            number + 1,
            figures.mean_dn,
            100.0 * figures.bright_share,
            figures.edges_x,
            figures.edges_y,
            100.0 * figures.saturated_share,
            looks_like(found, number)
        );
    }
}

/// The set of a frame and its place in it.
fn looks_like(found: &Exploration, frame: usize) -> String {
    for set in &found.sets {
        if let Some(place) = set.frames.iter().position(|f| *f == frame) {
            let axis = set.set.axis().map_or(String::new(), |axis| format!(" along {axis:?}").to_lowercase());
            return if set.frames.len() == 1 {
                set.set.name().to_owned()
            } else {
                format!("{}{axis}, {} of {}", set.set.name(), place + 1, set.frames.len())
            };
        }
    }
    "nothing known".to_owned()
}

/// Whether a recording's own sequence is what its frames show.
fn print_declared(camera: &Series, found: &Exploration) {
    let Some(declared) = &camera.declared else { return };
    let kinds = |sets: &[fringe::pattern::PatternSet]| {
        let kind = |set: &fringe::pattern::PatternSet| {
            let inverse = matches!(set, fringe::pattern::PatternSet::Gray { invert: true, .. });
            (set.name(), set.axis(), set.frames(), inverse)
        };
        sets.iter().map(kind).collect::<Vec<_>>()
    };
    let agree = kinds(declared) == kinds(&found.sequence());
    println!(
        "camera \"{}\": {}",
        camera.name,
        if agree {
            "the frames show the sets of recording.toml"
        } else {
            "the frames do NOT show the sets of recording.toml"
        }
    );
}

/// Pictures of how often each pixel is full, and of half of how much it changes, with their file names.
fn paint_maps(camera: &str, frames: &[FrameView]) -> Result<Vec<(String, Vec<u8>)>> {
    let pixels = frames[0].pixels.len();
    let full = f32::from(frames[0].full_scale_dn);
    let over = |pixel: usize| frames.iter().map(move |frame| frame.pixels.get(pixel));
    let share = |pixel: usize| over(pixel).filter(|v| *v >= full).count() as f32 / frames.len() as f32;
    let half_range = |pixel: usize| {
        let (low, high) = over(pixel).fold((f32::INFINITY, 0.0_f32), |(l, h), v| (l.min(v), h.max(v)));
        (high - low) / 2.0
    };
    let saturation: Vec<f32> = (0..pixels).map(|pixel| 100.0 * share(pixel)).collect();
    let modulation: Vec<f32> = (0..pixels).map(half_range).collect();
    let paint = |(what, values, unit): (&str, &Vec<f32>, &str)| {
        let most = f64::from(values.iter().copied().fold(1.0, f32::max));
        let scalar = Scalar {
            width_px: frames[0].width_px,
            height_px: frames[0].height_px,
            values,
            valid: None,
            map: ColourMap::Sequential,
            range: Range::Fixed(0.0, most),
            unit,
        };
        Ok((format!("{camera}-{what}.png"), scalar_png(&scalar)?))
    };
    [("saturation", &saturation, "%"), ("modulation", &modulation, "DN")].into_iter().map(paint).collect()
}

/// `1920x1080` as columns and rows.
fn size(text: &str) -> Result<[u32; 2]> {
    let parts =
        text.split_once(['x', '×']).and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    let size =
        parts.with_context(|| format!("--projector-size {text:?}: columns and rows, such as 1920x1080"))?;
    ensure!(size.iter().all(|s| (1..=65_535).contains(s)), "--projector-size {text}: 1 … 65535 a side");
    Ok(size)
}
