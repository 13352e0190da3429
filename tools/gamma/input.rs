//! What was seen of the projector: grey levels, fringes, white and black.

use super::Args;
use crate::progress::Progress;
use anyhow::{Context, Result, bail};
use characterise::response::Stack;
use files::recording::{RecordedProjector, Recording};
use fringe::frame::Frame;
use fringe::pattern::{PatternSet, frame_count};
use std::path::PathBuf;

/// Frames of one projector and one camera, for the response.
pub struct ResponseFrames {
    /// Where from, for messages.
    pub source: String,
    /// Which projector, if it has a name.
    pub projector: Option<String>,
    /// Which camera, if it has a name.
    pub camera: Option<String>,
    /// Whether the patterns were drawn corrected.
    pub corrected: bool,
    /// Frames of grey levels.
    pub stack: Option<Stack>,
    /// Fringes of one sine set, in order of their steps; empty if there are none.
    pub sine: Vec<Frame>,
    /// All on and all off; for recordings without grey levels.
    pub white_black: Option<[Frame; 2]>,
}

/// Reads recording or images.
pub fn gather(args: &Args) -> Result<ResponseFrames> {
    match (&args.recording, args.images.is_empty()) {
        (None, true) => bail!("neither a recording nor --images: give one of them"),
        (Some(_), false) => bail!("a recording and --images together: give one of them"),
        (Some(path), true) => {
            let recording = Recording::open(path)?;
            recorded(args, &recording)
        }
        (None, false) => pictures(args),
    }
}

/// Levels 0 … 1 as the user wrote them.
fn levels(text: &str, bits: u8) -> Result<Vec<f64>> {
    let written = crate::numbers::list("--levels", text)?;
    let full = if written.iter().all(|v| *v <= 1.0) { 1.0 } else { f64::from((1_u32 << bits) - 1) };
    match written.iter().find(|v| !(0.0..=full).contains(*v)) {
        Some(value) => {
            bail!("--levels: {value} is beyond 0 … {full}; for a projector of more than 8 bits add --bits")
        }
        None => Ok(written.iter().map(|v| v / full).collect()),
    }
}

fn pictures(args: &Args) -> Result<ResponseFrames> {
    if args.projector.is_some() || args.camera.is_some() {
        bail!("--projector and --camera apply to a recording, not to --images");
    }
    let Some(text) = &args.levels else {
        bail!("--images needs --levels: the projected level of each image, such as 0:255:5");
    };
    let levels = levels(text, args.bits)?;
    let mut files: Vec<PathBuf> = Vec::new();
    for pattern in &args.images {
        files.extend(crate::glob::expand(pattern).with_context(|| format!("--images {pattern}"))?);
    }
    if files.len() != levels.len() {
        bail!(
            "--images: {} images, but --levels: {} levels; give one level for each image",
            files.len(),
            levels.len()
        );
    }
    let mut stack = Stack::new(args.roi);
    let mut progress = Progress::new(files.len(), "reading");
    for (file, level) in files.iter().zip(levels) {
        let frame = files::image_file::read_foreign_frame(file, None)?;
        stack.push(level, &frame.view()).with_context(|| file.display().to_string())?;
        progress.step();
    }
    Ok(ResponseFrames {
        source: args.images.join(" "),
        projector: None,
        camera: None,
        corrected: false,
        stack: Some(stack),
        sine: Vec::new(),
        white_black: None,
    })
}

fn recorded(args: &Args, recording: &Recording) -> Result<ResponseFrames> {
    let source = recording.folder.display().to_string();
    let projector = projector(args, recording).with_context(|| source.clone())?;
    let names = || projector.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
    let camera = match &args.camera {
        None => projector.cameras.first(),
        Some(name) => projector.camera(name),
    };
    let Some(camera) = camera else {
        bail!(
            "{source}: --camera {}: has no images of \"{}\"; known: {}",
            args.camera.as_deref().unwrap_or(""),
            projector.name,
            names()
        );
    };
    let load = |frame: usize| recording.load(&projector.name, &camera.name, frame);
    let grey = grey_frames(args, projector).with_context(|| source.clone())?;
    let mut stack = None;
    if let Some((first, levels)) = grey {
        let mut filled = Stack::new(args.roi);
        let mut progress = Progress::new(levels.len(), "reading");
        for (index, level) in levels.iter().enumerate() {
            let at = || format!("{source}: frame {}", first + index);
            filled.push(*level, &load(first + index)?.view()).with_context(at)?;
            progress.step();
        }
        stack = Some(filled);
    }
    let mut seen = ResponseFrames {
        corrected: files::correction::is_noted(&recording.provenance, &projector.name),
        projector: Some(projector.name.clone()),
        camera: Some(camera.name.clone()),
        source,
        stack,
        sine: Vec::new(),
        white_black: None,
    };
    if let Some((first, count)) = finest_sine(&projector.sequence) {
        seen.sine = (first..first + count).map(load).collect::<Result<_, _>>()?;
    }
    let white = find(&projector.sequence, |set| matches!(set, PatternSet::White {}));
    let black = find(&projector.sequence, |set| matches!(set, PatternSet::Black {}));
    if seen.stack.is_none() {
        let (Some(white), Some(black), false) = (white, black, seen.sine.is_empty()) else {
            bail!(
                "{}: projector \"{}\" shows no grey levels, nor fringes with white and black; record {{ set = \"ramp\", levels = 52 }}, \
                 or give the level of each frame with --levels",
                seen.source,
                projector.name
            );
        };
        seen.white_black = Some([load(white)?, load(black)?]);
    }
    Ok(seen)
}

/// The named projector, or the first one with grey levels, or the first one.
fn projector<'a>(args: &Args, recording: &'a Recording) -> Result<&'a RecordedProjector> {
    let all = &recording.projectors;
    let names = || all.iter().map(|p| p.name.as_str()).collect::<Vec<_>>().join(", ");
    match &args.projector {
        Some(name) => recording
            .projector(name)
            .with_context(|| format!("--projector {name}: not in the recording; known: {}", names())),
        None => all
            .iter()
            .find(|p| p.sequence.iter().any(|set| set.grey_levels().is_some()))
            .or(all.first())
            .context("the recording has no projector"),
    }
}

/// First frame and levels of the grey frames.
fn grey_frames(args: &Args, projector: &RecordedProjector) -> Result<Option<(usize, Vec<f64>)>> {
    let sequence = &projector.sequence;
    let Some(text) = &args.levels else {
        let place = sequence.iter().position(|set| set.grey_levels().is_some());
        return Ok(place.and_then(|p| Some((frame_count(&sequence[..p]), sequence[p].grey_levels()?))));
    };
    let levels = levels(text, args.bits)?;
    let fits = |set: &PatternSet| {
        matches!(set, PatternSet::Ramp { .. } | PatternSet::Random { .. }) && set.frames() == levels.len()
    };
    if let Some(place) = sequence.iter().position(fits) {
        return Ok(Some((frame_count(&sequence[..place]), levels)));
    }
    let frames = frame_count(sequence);
    if frames != levels.len() {
        bail!(
            "--levels: {} levels, but projector \"{}\" has {frames} frames and no set of that many grey ones; give one level for each frame",
            levels.len(),
            projector.name
        );
    }
    Ok(Some((0, levels)))
}

/// First frame and number of frames of the sine set with the most steps.
fn finest_sine(sequence: &[PatternSet]) -> Option<(usize, usize)> {
    let sines = sequence.iter().enumerate().filter(|(_, set)| matches!(set, PatternSet::Sine { .. }));
    // The first one of equals.
    let (place, set) = sines.rev().max_by_key(|(_, set)| set.frames())?;
    Some((frame_count(&sequence[..place]), set.frames()))
}

fn find(sequence: &[PatternSet], is: impl Fn(&PatternSet) -> bool) -> Option<usize> {
    sequence.iter().position(is).map(|place| frame_count(&sequence[..place]))
}
