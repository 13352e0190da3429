//! Pictures of the last scan as PNG.

use super::model::ShownScan;
use crate::feed::RasterHeader;
use anyhow::{Result, bail};
use fringe::phase::{PhaseMap, PhaseView};
use report::ColourMap;
use report::picture::{Range, Scalar, grey_png, modulation_png, scalar_png, wrapped_phase_png};

/// A picture of one camera: grey values, or a plane of its phase map.
///
/// # Errors
/// There is no such picture, or no such camera.
pub fn png(shown: &ShownScan, camera: u32, projector: u32, layer: &str) -> Result<Vec<u8>> {
    let here = |header: &RasterHeader| header.camera == camera && header.projector == projector;
    let scan = &shown.scan;
    if layer == "grey" {
        let Some(at) = scan.header.pictures.iter().position(here) else { bail!("no picture of this camera") };
        let header = &scan.header.pictures[at];
        return Ok(grey_png(header.width_px, header.height_px, &scan.pictures[at])?);
    }
    let Some(at) = scan.header.maps.iter().position(here) else { bail!("no phase map of this camera") };
    let map = view(&scan.maps[at]);
    Ok(match layer {
        "modulation" => modulation_png(&map)?,
        "phase" => wrapped_phase_png(&map)?,
        "noise" => noise_png(&map)?,
        _ => bail!("no layer \"{layer}\"; known layers: grey, modulation, phase, noise"),
    })
}

fn view(map: &PhaseMap) -> PhaseView<'_> {
    PhaseView {
        info: map.info,
        phase_rad: &map.phase_rad,
        sigma_rad: &map.sigma_rad,
        modulation: &map.modulation,
        valid: &map.valid,
    }
}

/// Standard uncertainty of the phase in mrad.
fn noise_png(map: &PhaseView) -> Result<Vec<u8>> {
    let values: Vec<f32> = map.sigma_rad.iter().map(|sigma| 1000.0 * sigma).collect();
    Ok(scalar_png(&Scalar {
        width_px: map.info.width_px,
        height_px: map.info.height_px,
        values: &values,
        valid: Some(map.valid),
        map: ColourMap::Sequential,
        range: Range::Inner,
        unit: "mrad",
    })?)
}
