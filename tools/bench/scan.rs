//! One measurement of the twin in memory: no files, no processes, the same kernels.

use crate::simulate::Buffer;
use anyhow::{Context, Result};
use cell::executor::{PairMatcher, PhaseMethod, ViewDecoder, Views};
use fringe::cloud::Point;
use fringe::decode::DecodeSettings;
use fringe::fusion::{Fuser, FusionReport, FusionSettings};
use fringe::geometry::rig::{Rig, pictures};
use fringe::matching::MatchSettings;
use fringe::pattern::{PatternSet, frame_count};
use fringe::phase::PhaseMap;
use twin::{Twin, View};

/// The fused cloud of all pairs.
pub struct Scan {
    /// Points of the fused cloud.
    pub points: Vec<Point>,
    /// What fusion kept and removed.
    pub fusion: FusionReport,
}

/// Renders, decodes, matches and fuses all pairs of a rig.
pub fn scan(twin: &Twin, rig: &Rig, sequence: &[PatternSet], cycle: u64) -> Result<Scan> {
    scan_with(twin, rig, sequence, cycle, &tolerant())
}

/// The same with settings of the decoder.
pub fn scan_with(
    twin: &Twin,
    rig: &Rig,
    sequence: &[PatternSet],
    cycle: u64,
    settings: &DecodeSettings,
) -> Result<Scan> {
    joined(&decoded(twin, rig, sequence, cycle, &|_| settings.clone())?, rig)
}

/// The phases that both cameras of a pair see.
pub type PairMaps = [Vec<PhaseMap>; 2];

/// Renders and decodes what the cameras of all pairs see, in the order of the rig's pairs; each camera has settings of its own.
pub fn decoded(
    twin: &Twin,
    rig: &Rig,
    sequence: &[PatternSet],
    cycle: u64,
    settings: &impl Fn(&str) -> DecodeSettings,
) -> Result<Vec<PairMaps>> {
    Ok(decoded_often(twin, rig, sequence, (cycle, 1), settings)?.swap_remove(0))
}

/// The same of a number of recordings of a cycle, each with noise of its own.
pub fn decoded_often(
    twin: &Twin,
    rig: &Rig,
    sequence: &[PatternSet],
    (cycle, recordings): (u64, u64),
    settings: &impl Fn(&str) -> DecodeSettings,
) -> Result<Vec<Vec<PairMaps>>> {
    let mut all: Vec<Vec<PairMaps>> = (0..recordings).map(|_| Vec::new()).collect();
    for pair in &rig.pairs {
        let [left, right] = [&pair.left, &pair.right].map(|camera| {
            let view = twin.view_lit_by(camera, &[&pair.projector], cycle)?;
            let settings = settings(camera);
            let maps =
                |number| maps(landed(twin, (&view, number), &pair.projector, rig, sequence, &settings)?);
            (0..recordings).map(maps).collect::<Result<Vec<_>>>()
        });
        for (pairs, (left, right)) in all.iter_mut().zip(left?.into_iter().zip(right?)) {
            pairs.push([left, right]);
        }
    }
    Ok(all)
}

/// Matches and fuses the maps of all pairs of a rig.
pub fn joined(maps: &[PairMaps], rig: &Rig) -> Result<Scan> {
    let pairs = rig.pairs.iter().zip(maps).enumerate();
    let clouds = pairs.map(|(index, (pair, [left, right]))| {
        let mut matcher = PairMatcher::new(rig, pair, index, &MatchSettings::default())?;
        Ok(matcher.cloud(&views(left), &views(right))?.0)
    });
    let clouds = clouds.collect::<Result<Vec<Vec<Point>>>>()?;
    let slices: Vec<&[Point]> = clouds.iter().map(Vec::as_slice).collect();
    let mut points = Vec::new();
    let mut fuser = Fuser::of_pictures(pictures(&rig.pairs));
    let fusion = fuser.fuse(&slices, &FusionSettings::default(), &mut points).clone();
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
    decode_with(twin, (camera, projector), rig, sequence, cycle, &tolerant())
}

/// Settings that refuse no part or board for its edges, which are contradictions of code and phase, however many they are.
pub fn tolerant() -> DecodeSettings {
    DecodeSettings { max_contradiction: 1e6, ..DecodeSettings::default() }
}

/// The same with settings of the decoder.
pub fn decode_with(
    twin: &Twin,
    (camera, projector): (&str, &str),
    rig: &Rig,
    sequence: &[PatternSet],
    cycle: u64,
    settings: &DecodeSettings,
) -> Result<Vec<PhaseMap>> {
    let view = twin.view_lit_by(camera, &[projector], cycle)?;
    maps(landed(twin, (&view, 0), projector, rig, sequence, settings)?)
}

/// The phase maps of a decoder in which all frames have landed, one per axis.
fn maps(mut decoder: ViewDecoder) -> Result<Vec<PhaseMap>> {
    let finished = decoder.axes().into_iter().map(|axis| {
        let mut map = PhaseMap::new(decoder.info(axis)?);
        decoder.finish(axis, &mut map.view_mut())?;
        Ok(map)
    });
    finished.collect()
}

/// The phases of a camera as a matcher takes them.
pub fn views(maps: &[PhaseMap]) -> Views<'_> {
    Views::of(maps.iter().map(PhaseMap::view))
}

/// A decoder in which all frames of a view have landed, of the recording with this number, which has noise of its own.
pub fn landed(
    twin: &Twin,
    (view, number): (&View, u64),
    projector: &str,
    rig: &Rig,
    sequence: &[PatternSet],
    settings: &DecodeSettings,
) -> Result<ViewDecoder> {
    let mut decoder =
        ViewDecoder::new(&seen(view, projector, rig, sequence)?, settings, PhaseMethod::default())?;
    let mut renderer = twin.renderer(projector, sequence)?;
    renderer.expose(number, 1.0);
    let mut buffer = Buffer::new(view);
    for frame in 0..frame_count(sequence) {
        renderer.render(view, frame, buffer.pixels_mut())?;
        decoder.push(frame, &buffer.frame(view))?;
    }
    Ok(decoder)
}

/// What a camera of the twin sees of a projector.
pub fn seen<'a>(
    view: &View,
    projector: &str,
    rig: &Rig,
    sequence: &'a [PatternSet],
) -> Result<cell::executor::View<'a>> {
    let lamp = rig.projector(projector).context("the twin's rig has the projector")?;
    Ok(cell::executor::View {
        sequence,
        extent_px: [lamp.width_px, lamp.height_px],
        size_px: [view.width_px(), view.height_px()],
        full_scale_dn: view.full_scale_dn(),
        exposures_ms: &[],
    })
}
