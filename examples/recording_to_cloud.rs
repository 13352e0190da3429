//! From a recording and a rig file to the cloud of one camera pair:
//!
//!     cargo run --release --example recording_to_cloud -- RECORDING RIG.toml CLOUD.ply

use files::recording::Recording;
use files::rig_file::read_rig;
use fringe::decode::{DecodeSettings, Decoder};
use fringe::matching::{MatchSettings, Matcher};
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recording, rig, out] = arguments.as_slice() else {
        return Err("arguments: RECORDING RIG.toml CLOUD.ply".into());
    };
    let recording = Recording::open(Path::new(recording))?;
    // The rig of the cameras that were recorded; each pair knows the projector that lit it.
    let rig = recording.rig(&read_rig(Path::new(rig))?)?.rig;
    let pair = &rig.pairs[0];
    let left = phase(&recording, &pair.projector, &pair.left)?;
    let right = phase(&recording, &pair.projector, &pair.right)?;

    let camera = |name: &str| rig.camera(name).ok_or(format!("{name} is a projector, not a camera"));
    let mut matcher = Matcher::new(camera(&pair.left)?, camera(&pair.right)?, &MatchSettings::default())?;
    let mut points = vec![bytemuck::Zeroable::zeroed(); matcher.capacity()];
    let report = matcher.run(&left.view(), &right.view(), 0, &mut points)?;
    points.truncate(report.points as usize);
    files::ply::write_cloud(Path::new(out), &points, &[("method", "phase")])?;
    println!("{out}: {} points of {} valid pixels", points.len(), report.valid);
    Ok(())
}

/// The absolute phase along x that one camera saw, with its uncertainty and mask.
fn phase(recording: &Recording, projector: &str, camera: &str) -> Result<PhaseMap, Box<dyn Error>> {
    let lit = recording.projector(projector).ok_or(format!("no projector {projector}"))?;
    let seen = lit.camera(camera).ok_or(format!("{projector} did not light {camera}"))?;
    let (size_px, settings) = ([lit.width_px, lit.height_px], DecodeSettings::default());
    let mut decoder =
        Decoder::new(&lit.sequence, seen.width_px, seen.height_px, seen.full_scale_dn, size_px, &settings)?;
    for frame in 0..seen.frames.len() {
        decoder.push_shared(frame, &recording.load(projector, camera, frame)?.into())?;
    }
    let mut map = PhaseMap::new(decoder.info(Axis::X)?);
    let report = decoder.finish(Axis::X, &mut map.view_mut())?;
    println!("{camera}: {} valid pixels", report.valid);
    Ok(map)
}
