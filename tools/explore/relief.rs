//! Phase and relief without a calibration.

use crate::decode::write_pictures;
use crate::pipeline::decode_views;
use anyhow::Result;
use files::atomic;
use files::recording::Recording;
use fringe::decode::DecodeSettings;
use fringe::pattern::Axis;
use fringe::phase::PhaseMap;
use nalgebra::{SMatrix, SVector};
use report::ColourMap;
use report::picture::{Range, Scalar, scalar_png};
use std::collections::BTreeMap;
use std::path::Path;

/// Coefficients of a carrier: a cubic in column and row, as a plane gives it through two pinhole views with some distortion.
const TERMS: usize = 10;

/// Pixels of the fit.
const SAMPLES: usize = 100_000;

/// Decodes the proposed recording and writes phase, modulation, order and relief of each camera; a sequence that gives no absolute
/// phase is told and no failure.
pub fn write(folder: &Path) -> Result<()> {
    let recording = Recording::open(folder)?;
    let views = match decode_views(&recording, &DecodeSettings::default(), &BTreeMap::new(), |_, _| true) {
        Ok(views) => views,
        Err(error) => {
            println!("\nno absolute phase from the proposed sequence: {error:#}");
            return Ok(());
        }
    };
    for view in &views {
        for decoded in &view.maps {
            write_pictures(folder, view, &decoded.map)?;
            let Some(relief) = relief(&decoded.map) else { continue };
            let axis = if decoded.map.info.axis == Axis::X { "x" } else { "y" };
            let scalar = Scalar {
                width_px: decoded.map.info.width_px,
                height_px: decoded.map.info.height_px,
                values: &relief,
                valid: Some(&decoded.map.valid),
                map: ColourMap::Diverging,
                range: Range::Inner,
                unit: "rad",
            };
            let path = folder.join(format!("{}-{}-{axis}-relief.png", view.projector, view.camera));
            atomic::write(&path, &scalar_png(&scalar)?)?;
        }
    }
    Ok(())
}

/// Phase less its carrier, rad: the cubic of column and row that fits it best. `None` with too few valid pixels.
fn relief(map: &PhaseMap) -> Option<Vec<f32>> {
    let width = map.info.width_px as usize;
    let terms = |pixel: usize| -> SVector<f64, TERMS> {
        let u = 2.0 * (pixel % width) as f64 / f64::from(map.info.width_px) - 1.0;
        let v = 2.0 * (pixel / width) as f64 / f64::from(map.info.height_px) - 1.0;
        SVector::from([1.0, u, v, u * u, u * v, v * v, u * u * u, u * u * v, u * v * v, v * v * v])
    };
    let valid: Vec<usize> = (0..map.valid.len()).filter(|pixel| map.valid[*pixel] == 1).collect();
    let (mut normal, mut right) = (SMatrix::<f64, TERMS, TERMS>::zeros(), SVector::<f64, TERMS>::zeros());
    for pixel in valid.iter().copied().step_by(valid.len().div_ceil(SAMPLES).max(1)) {
        let terms = terms(pixel);
        normal += terms * terms.transpose();
        right += terms * f64::from(map.phase_rad[pixel]);
    }
    let carrier = normal.cholesky()?.solve(&right);
    Some(
        (0..map.phase_rad.len())
            .map(|p| (f64::from(map.phase_rad[p]) - terms(p).dot(&carrier)) as f32)
            .collect(),
    )
}
