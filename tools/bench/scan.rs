//! One measurement of the twin in memory: no files, no processes, the same kernels.

use crate::pipeline::match_maps;
use crate::simulate::Buffer;
use anyhow::{Context, Result};
use fringe::cloud::Point;
use fringe::decode::{DecodeSettings, Decoder};
use fringe::fusion::{FusionReport, FusionSettings, fuse};
use fringe::geometry::rig::Rig;
use fringe::matching::{MatchSettings, Matcher};
use fringe::pattern::{Axis, PatternSet, frame_count};
use fringe::phase::PhaseMap;
use twin::Twin;

/// The fused cloud of all pairs.
pub struct Scan {
    /// Points of the fused cloud.
    pub points: Vec<Point>,
    /// What fusion kept and removed.
    pub fusion: FusionReport,
}

/// Renders, decodes, matches and fuses all pairs of a rig.
pub fn scan(twin: &Twin, rig: &Rig, sequence: &[PatternSet], cycle: u64) -> Result<Scan> {
    let clouds = rig
        .pairs
        .iter()
        .enumerate()
        .map(|(index, pair)| {
            let map = |camera: &str| -> Result<PhaseMap> {
                let maps = decode(twin, camera, &pair.projector, rig, sequence, cycle)?;
                maps.into_iter().find(|m| m.info.axis == Axis::X).context("the sequence has fringes along x")
            };
            let (left, right) = (map(&pair.left)?, map(&pair.right)?);
            let camera = |name: &str| rig.camera(name).context("a pair of the rig names its cameras");
            let mut matcher =
                Matcher::new(camera(&pair.left)?, camera(&pair.right)?, &MatchSettings::default())?;
            Ok(match_maps(&mut matcher, &left, &right, index)?.0)
        })
        .collect::<Result<Vec<Vec<Point>>>>()?;
    let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let mut points = Vec::new();
    let fusion = fuse(&slices, &FusionSettings::default(), &mut points);
    Ok(Scan { points, fusion })
}

/// What one camera sees of one projector, decoded: one map per axis of the sequence.
pub fn decode(
    twin: &Twin,
    camera: &str,
    projector: &str,
    rig: &Rig,
    sequence: &[PatternSet],
    cycle: u64,
) -> Result<Vec<PhaseMap>> {
    let view = twin.view_lit_by(camera, &[projector], cycle)?;
    let mut renderer = twin.renderer(projector, sequence)?;
    let mut buffer = Buffer::new(&view);
    let lamp = rig.projector(projector).context("the twin's rig has the projector")?;
    let extent_px = [lamp.width_px, lamp.height_px];
    // The edges of a part or of a board's squares are contradictions of code and phase, however many they are.
    let settings = DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() };
    let (width, height, full) = (view.width_px(), view.height_px(), view.full_scale_dn());
    let mut decoder = Decoder::new(sequence, width, height, full, extent_px, &settings)?;
    for frame in 0..frame_count(sequence) {
        renderer.render(&view, frame, buffer.pixels_mut())?;
        decoder.push(frame, &buffer.frame(&view))?;
    }
    let finished = decoder.axes().into_iter().map(|axis| {
        let mut map = PhaseMap::new(decoder.info(axis)?);
        decoder.finish(axis, &mut map.view_mut())?;
        Ok(map)
    });
    finished.collect()
}
