//! Footprint and noise of the cameras, from the pictures of a calibration.

use super::detections::{Gathered, for_all};
use crate::pipeline::RecordedView;
use anyhow::Result;
use characterise::calibration::{Calibration, DeviceKind};
use characterise::sensor::{FootprintEstimate, NoiseEstimate, footprint, photon_transfer};
use characterise::target::BlurredEdge;
use files::recording::Recording;
use files::rig_file::is_in_focus;
use fringe::decode::{DecodeSettings, NoiseSource};
use fringe::pattern::{PatternSet, frame_count};
use fringe::sensor::Sensor;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// So many recordings of a camera tell its noise.
const RECORDINGS: usize = 4;
/// Fewest steps whose residuals are noise, not the second harmonic.
const LEAST_STEPS: u32 = 5;

/// What was found of a camera.
#[derive(Debug, Clone, Copy)]
pub struct Characterised {
    /// As the rig file states it.
    pub sensor: Sensor,
    /// What the footprint rests on.
    pub footprint: Option<FootprintEstimate>,
    /// Number of recordings behind the noise.
    pub noise_recordings: usize,
}

/// The lines of variance against grey value that the first recordings of each camera show.
pub fn noise_lines(recordings: &[Recording]) -> Result<Vec<(String, NoiseEstimate)>> {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    let mut views = Vec::new();
    for recording in recordings {
        for projector in &recording.projectors {
            let stepped =
                |set: &PatternSet| matches!(set, PatternSet::Sine { steps, .. } if *steps >= LEAST_STEPS);
            let Some(set) = projector.sequence.iter().position(stepped) else { continue };
            for camera in &projector.cameras {
                let count = counts.entry(&camera.name).or_default();
                *count += 1;
                if *count <= RECORDINGS {
                    views.push((RecordedView { recording, projector, camera }, set));
                }
            }
        }
    }
    let read = for_all("reading noise", &views, |(view, set)| noise_line(*view, *set));
    let named = views.iter().zip(read).map(|((view, _), line)| Ok((view.camera.name.clone(), line?)));
    named.filter_map(|line: Result<_>| line.map(|(name, line)| Some((name, line?))).transpose()).collect()
}

/// The noise of one sine set, decoded as if one period were all of the projector: the order does not matter.
fn noise_line(view: RecordedView, set: usize) -> Result<Option<NoiseEstimate>> {
    let sequence = &view.projector.sequence;
    let PatternSet::Sine { period_px, .. } = sequence[set] else { return Ok(None) };
    let first = frame_count(&sequence[..set]);
    let frames = first..first + frame_count(&sequence[set..=set]);
    let settings =
        DecodeSettings { max_contradiction: 1e6, repair_spikes: false, ..DecodeSettings::default() };
    let extent_px = [(period_px.floor() as u32).max(1); 2];
    let decoded = view.decode_sets((&sequence[set..=set], frames), extent_px, &settings, &mut || {})?;
    let noise = decoded.first().map(|decoded| decoded.report.noise);
    Ok(noise.and_then(|noise| match noise.source {
        NoiseSource::Estimated { pixels } => {
            Some(NoiseEstimate { read_variance_dn2: noise.read_variance_dn2, gain_dn: noise.gain_dn, pixels })
        }
        _ => None,
    }))
}

/// Footprint and noise of all calibrated cameras that showed them.
pub fn characterise(gathered: &Gathered, calibration: &Calibration) -> BTreeMap<String, Characterised> {
    let cameras = calibration.devices.iter().filter(|device| device.kind == DeviceKind::Camera);
    let all = cameras.map(|device| {
        let edges: Vec<Vec<BlurredEdge>> = gathered.edges_of(&device.name);
        let found = footprint(&edges, [device.camera.width_px, device.camera.height_px]);
        let lines: Vec<NoiseEstimate> =
            gathered.noise.iter().filter(|(name, _)| *name == device.name).map(|(_, line)| *line).collect();
        let noise = photon_transfer(&lines);
        let sensor = Sensor {
            footprint: found.map(|found| found.footprint).filter(is_in_focus),
            noise: noise.map(|(noise, _)| noise),
            noise_u_dn: noise.map(|(_, u)| u),
        };
        (device.name.clone(), Characterised { sensor, footprint: found, noise_recordings: lines.len() })
    });
    all.filter(|(_, found)| !found.sensor.is_unknown() || found.footprint.is_some()).collect()
}

/// Standard deviation of a pixel whose whole area sees light, px: a footprint is the blur of the lens besides.
const PIXEL_PX: f64 = 0.288_675;
/// A footprint contradicts what it should be from so many standard uncertainties on.
const CONTRADICTED: f64 = 3.0;

/// What to look at in cameras whose edges are blurred as by no lens in focus, a line each.
pub fn notes(sensors: &BTreeMap<String, Characterised>) -> Vec<String> {
    let mut notes = Vec::new();
    for (name, found) in sensors {
        let Some(estimate) = &found.footprint else { continue };
        let ([x, y], u) = (estimate.footprint.sigma_px, estimate.footprint.u_px.unwrap_or_default());
        if found.sensor.footprint.is_none() {
            notes.push(format!(
                "{name}: edges are blurred by {x:.2}, {y:.2} px, which is out of focus: no footprint goes into the rig file; focus the camera and \
                 record the board again"
            ));
        } else if x + CONTRADICTED * u[0] < PIXEL_PX || y + CONTRADICTED * u[1] < PIXEL_PX {
            notes.push(format!(
                "{name}: edges are blurred by {x:.3}, {y:.3} px, less than the {PIXEL_PX:.3} px of a pixel alone: does the camera sharpen its \
                 pictures? Switch that off, and record the board again"
            ));
        }
        if let Some(across_px2) = estimate.across_px2 {
            notes.push(format!(
                "{name}: the blur changes by {across_px2:.3} px² (variance) from one side of the picture to the other, which a footprint in a rig file \
                 cannot state: it counts as uncertainty; is the lens tilted, or was the focus changed between the pictures?"
            ));
        }
    }
    notes
}

/// A line per camera.
pub fn print(sensors: &BTreeMap<String, Characterised>) {
    for (name, line) in lines(sensors) {
        println!("{name}: {line}");
    }
}

/// The same by the name of the camera.
pub fn lines(sensors: &BTreeMap<String, Characterised>) -> Vec<(String, String)> {
    let mut lines = Vec::new();
    for (name, found) in sensors {
        let mut parts = Vec::new();
        if let Some(estimate) = found.footprint.as_ref().filter(|_| found.sensor.footprint.is_some()) {
            let ([x, y], [ux, uy]) =
                (estimate.footprint.sigma_px, estimate.footprint.u_px.unwrap_or_default());
            let mut part =
                format!("footprint {x:.3}, {y:.3} px (u {ux:.3}, {uy:.3}) from {} edges", estimate.edges);
            if estimate.footprint.field_px2 != 0.0 {
                let _ = write!(
                    part,
                    ", its variance {:+.3} px² from the middle to the corner",
                    estimate.footprint.field_px2
                );
            }
            parts.push(part);
        }
        if let Some((noise, [u_read, u_gain])) = found.sensor.noise.zip(found.sensor.noise_u_dn) {
            parts.push(format!(
                "read noise {:.3} DN (u {u_read:.3}), gain {:.5} DN per electron (u {u_gain:.5}) from {} recordings",
                noise.read_noise_dn, noise.gain_dn, found.noise_recordings
            ));
        }
        if !parts.is_empty() {
            lines.push((name.clone(), parts.join("; ")));
        }
    }
    lines
}

/// Keys of a camera in the result.
pub fn json(found: Option<&Characterised>) -> serde_json::Value {
    let sensor = found.map(|found| found.sensor).unwrap_or_default();
    serde_json::json!({
        "footprint_px": sensor.footprint.map(|footprint| footprint.sigma_px),
        "u_footprint_px": sensor.footprint.and_then(|footprint| footprint.u_px),
        "footprint_field_px2": sensor.footprint.map(|footprint| footprint.field_px2),
        "footprint_edges": found.and_then(|found| Some(found.footprint?.edges)),
        "noise": sensor.noise.map(|noise| serde_json::json!({
            "read_dn": noise.read_noise_dn,
            "gain_dn": noise.gain_dn,
            "u_read_dn": sensor.noise_u_dn.map(|u| u[0]),
            "u_gain_dn": sensor.noise_u_dn.map(|u| u[1]),
        })),
    })
}
