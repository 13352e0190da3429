//! The report of a cycle: from the output folder where it is kept, else made of what the monitor knows.

use super::model::Model;
use crate::feed::Ended;
use crate::run_files::{self, RunFiles};
use crate::supervisor::history::History;
use crate::supervisor::snapshot::CameraImage;
use anyhow::Result;
use files::result::{CycleResult, read_json};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The report of a cycle, as HTML; `None` where nothing is known of it.
///
/// # Errors
/// A file of the output folder is damaged.
pub fn html(model: &Model, number: u64) -> Result<Option<String>> {
    if let Some(kept) = model.out.as_deref().and_then(|out| kept_report(out, number)) {
        return Ok(Some(kept));
    }
    match known(model, number)? {
        Some(ended) => made(model, &ended),
        None => Ok(None),
    }
}

/// The result of a cycle; `None` where nothing is known of it.
///
/// # Errors
/// As [`html`].
pub fn result(model: &Model, number: u64) -> Result<Option<CycleResult>> {
    Ok(known(model, number)?.map(|ended| ended.result))
}

/// The report that a serving cell writes beside the part.
fn kept_report(out: &Path, number: u64) -> Option<String> {
    let prefix = format!("{number:04}");
    let of_cycle =
        |name: &str| name.strip_prefix(&prefix).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'));
    let mut parts = fs::read_dir(out.join("parts")).ok()?.filter_map(Result::ok);
    let part = parts.find(|part| of_cycle(&part.file_name().to_string_lossy()))?;
    fs::read_to_string(part.path().join("report.html")).ok()
}

/// A cycle from memory, else from the results on the disk.
fn known(model: &Model, number: u64) -> Result<Option<Ended>> {
    if let Some(ended) = model.ended(number) {
        return Ok(Some((*ended).clone()));
    }
    let Some(out) = &model.out else { return Ok(None) };
    let file = out.join("results").join(format!("{number:04}.json"));
    if !file.is_file() {
        return Ok(None);
    }
    Ok(Some(Ended { result: read_json(&file)?, spans: Vec::new() }))
}

/// Makes the report with pictures and cloud where the last scan is of this cycle.
fn made(model: &Model, ended: &Ended) -> Result<Option<String>> {
    let shown = model.known().scan.clone();
    let scan = shown.as_ref().map(|shown| &shown.scan);
    let number = ended.result.number;
    let pictures = scan.into_iter().flat_map(|scan| scan.header.pictures.iter().zip(&scan.pictures));
    let images: BTreeMap<(u32, u32), CameraImage> = pictures
        .map(|(header, values)| {
            let (cycle, width_px, height_px) = (header.number, header.width_px, header.height_px);
            let image = CameraImage { cycle, width_px, height_px, values: values.clone() };
            ((header.camera, header.projector), image)
        })
        .collect();
    let points = scan.filter(|scan| scan.header.cloud_number == number).map(|scan| scan.points.as_slice());
    let history = History { spans: ended.spans.clone().into(), ..History::default() };
    run_files::report_text(&RunFiles {
        cell: &model.cell,
        results: std::slice::from_ref(&ended.result),
        history: &history,
        images: &images,
        maps: &BTreeMap::new(),
        points,
        truth: None,
    })
}
