//! `fringetool reference-plane`: height from the phase difference to a plane, without a characterised camera or projector.

mod calibrate;
mod measure;

use crate::Outcome;
use crate::pipeline::decode_views;
use anyhow::{Result, bail};
use files::recording::Recording;
use fringe::decode::DecodeSettings;
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use std::collections::BTreeMap;
use std::path::Path;

#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(clap::Subcommand)]
enum What {
    /// Give each pixel its polynomial from planes at known heights.
    Calibrate(calibrate::Args),
    /// Measure the heights of an object over the reference plane.
    Measure(measure::Args),
}

/// Runs the command; the outcome becomes the exit code.
pub fn run(args: &Args) -> Result<Outcome> {
    match &args.what {
        What::Calibrate(args) => calibrate::run(args),
        What::Measure(args) => measure::run(args),
    }
}

/// Which view of a recording, along which axis.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Which {
    projector: String,
    camera: String,
    axis: Axis,
}

/// Decodes one view along one axis.
fn decode(folder: &Path, which: &Which) -> Result<PhaseMap> {
    let recording = Recording::open(folder)?;
    let views =
        decode_views(&recording, &DecodeSettings::default(), &BTreeMap::new(), |projector, camera| {
            projector == which.projector && camera == which.camera
        })?;
    let maps = views.into_iter().flat_map(|view| view.maps).map(|decoded| decoded.map);
    match maps.into_iter().find(|map| map.info.axis == which.axis) {
        Some(map) => Ok(map),
        None => bail!(
            "{}: camera \"{}\" under projector \"{}\" has no phase along {:?}; measure with the view that was calibrated",
            recording.document.path.display(),
            which.camera,
            which.projector,
            which.axis
        ),
    }
}
