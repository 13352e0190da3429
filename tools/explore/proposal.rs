//! The recording that the frames could be.

use super::series::Series;
use anyhow::Result;
use characterise::explore::Exploration;
use files::atomic;
use files::image_file::Channel;
use files::recording::{ProjectorRecord, RecordingWriter};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// Name of the projector, which no frame tells.
const PROJECTOR: &str = "proj1";

/// What is uncertain, set by set; the same doubt of several sets once.
pub fn doubts(found: &Exploration) -> Vec<String> {
    let mut lines: Vec<(String, Vec<String>)> = Vec::new();
    for (number, set) in found.sets.iter().enumerate() {
        for doubt in &set.doubts {
            let name = format!("sequence[{number}] ({})", set.set.name());
            match lines.iter_mut().find(|(text, _)| text == doubt) {
                Some((_, sets)) => sets.push(name),
                None => lines.push((doubt.clone(), vec![name])),
            }
        }
    }
    if !found.unexplained.is_empty() {
        let frames: Vec<String> = found.unexplained.iter().map(|f| (f + 1).to_string()).collect();
        lines.push((format!("left out: frames {}", frames.join(", ")), Vec::new()));
    }
    lines
        .into_iter()
        .map(|(text, sets)| if sets.is_empty() { text } else { format!("{}: {text}", sets.join(", ")) })
        .collect()
}

/// Writes frames and `recording.toml`, with the doubts as comments in front.
pub fn write(
    out: &Path,
    source: &Path,
    cameras: &[Series],
    found: &Exploration,
    channel: Channel,
) -> Result<()> {
    let [width_px, height_px] = found.projector_px;
    let record = ProjectorRecord {
        name: PROJECTOR.to_owned(),
        width_px,
        height_px,
        cameras: cameras.iter().map(|camera| camera.name.clone()).collect(),
        sequence: found.sequence(),
        exposures_ms: Vec::new(),
        full_scale_dn: BTreeMap::new(),
    };
    let mut writer = RecordingWriter::create(out, &[record])?;
    for camera in cameras {
        for (place, frame) in found.sets.iter().flat_map(|set| &set.frames).enumerate() {
            let how = (camera.full_scale_dn, channel, None);
            writer.adopt(PROJECTOR, &camera.name, place, &camera.files[*frame], how)?;
        }
    }
    let mut provenance = toml::Table::new();
    provenance.insert("origin".into(), source.display().to_string().into());
    provenance.insert("proposed_by".into(), "fringetool explore".into());
    let path = writer.finish(&provenance)?;
    let mut text =
        "# Proposed by `fringetool explore` from the frames alone. Correct what is uncertain:\n".to_owned();
    for line in doubts(found) {
        let _ = writeln!(text, "# - {line}");
    }
    text.push_str(&std::fs::read_to_string(&path)?);
    atomic::write(&path, text.as_bytes())?;
    Ok(())
}
