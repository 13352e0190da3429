//! Pictures of the last scan as PNG.

use super::model::ShownScan;
use crate::feed::RasterHeader;
use anyhow::{Result, bail};
use cell::Cell;
use cell::executor::decoder_of_size;
use fringe::math::log10;
use fringe::phase::{PhaseMap, PhaseView};
use report::ColourMap;
use report::picture::{Range, Scalar, grey_png, modulation_png, scalar_png, wrapped_phase_png};

/// A picture of one camera: grey values, or a plane of its phase map.
///
/// # Errors
/// There is no such picture, or no such camera.
pub fn png(cell: &Cell, shown: &ShownScan, camera: u32, projector: u32, layer: &str) -> Result<Vec<u8>> {
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
        "risk" => risk_png(cell, camera as usize, projector as usize, &map)?,
        _ => bail!("no layer \"{layer}\"; known layers: grey, modulation, phase, noise, risk"),
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
    coloured(map, &values, Range::Inner, "mrad")
}

/// Decades of the probability that the picture of the order risk tells apart.
const DECADES: f64 = 9.0;

/// Probability that noise makes the order of a pixel wrong, as a power of ten.
fn risk_png(cell: &Cell, camera: usize, projector: usize, map: &PhaseView) -> Result<Vec<u8>> {
    // The risk of a pixel depends on the sequence alone, so the decoder need not have the size of the camera.
    let decoder = decoder_of_size(cell, projector, camera, [map.info.width_px, map.info.height_px])?;
    let Some(chances) = decoder.order_risk(map.info.axis, map.sigma_rad)? else {
        bail!("this sequence decides no fringe order");
    };
    let values: Vec<f32> = chances.iter().map(|chance| log10(*chance).max(-DECADES) as f32).collect();
    coloured(map, &values, Range::Fixed(-DECADES, 0.0), "power of ten")
}

fn coloured(map: &PhaseView, values: &[f32], range: Range, unit: &str) -> Result<Vec<u8>> {
    Ok(scalar_png(&Scalar {
        width_px: map.info.width_px,
        height_px: map.info.height_px,
        values,
        valid: Some(map.valid),
        map: ColourMap::Sequential,
        range,
        unit,
    })?)
}
