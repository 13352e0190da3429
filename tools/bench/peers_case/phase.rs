//! Spatial unwrapping of the largest region of a decoded map.

use super::Bench;
use super::frames::Camera18;
use anyhow::Result;
use fringe::math;
use fringe::unwrap::{Method, UnwrapSettings, Wrapped, unwrap};
use serde_json::json;
use std::f64::consts::TAU;

/// Unwraps what `frames0` decodes to.
pub(super) fn unwrapping(bench: &mut Bench) -> Result<()> {
    let mut camera = Camera18::read(bench, 0)?;
    camera.decode()?;
    let map = &camera.map;
    let keep = largest_region(&map.valid, map.info.width_px as usize);
    let wrapped_rad: Vec<f32> = map
        .phase_rad
        .iter()
        .zip(&keep)
        .map(|(p, k)| if *k == 1 { math::wrap_rad(f64::from(*p)) as f32 } else { f32::NAN })
        .collect();
    let wrapped = Wrapped {
        width_px: map.info.width_px,
        height_px: map.info.height_px,
        phase_rad: &wrapped_rad,
        valid: &keep,
        modulation: None,
    };
    let settings = UnwrapSettings::new(Method::Reliability);
    for threads in [1, 2] {
        let mut phase_rad = Vec::new();
        bench.time("unwrap 2D", threads, || {
            phase_rad = unwrap(&wrapped, None, &settings)?.phase_rad;
            Ok(())
        })?;
        let turns = phase_rad.iter().zip(&map.phase_rad).zip(&keep).filter(|(_, k)| **k == 1);
        let mut turns: Vec<f64> =
            turns.map(|((got, truth), _)| (f64::from(got - truth) / TAU).round()).collect();
        let pixels = turns.len();
        let usual = math::statistics::median(&mut turns).unwrap_or(0.0);
        let wrong = turns.iter().filter(|t| **t != usual).count();
        let Some(row) = bench.rows.last_mut() else { continue };
        row.with(json!({ "wrong_pixels": wrong, "valid": pixels as f64 / keep.len().max(1) as f64 }));
    }
    Ok(())
}

/// The largest region of valid pixels that share sides: no method joins islands.
fn largest_region(valid: &[u8], width: usize) -> Vec<u8> {
    let mut label = vec![0_u32; valid.len()];
    let (mut best, mut best_size, mut next) = (0, 0, 0);
    let mut stack = Vec::new();
    for start in 0..valid.len() {
        if valid[start] == 0 || label[start] != 0 {
            continue;
        }
        next += 1;
        label[start] = next;
        stack.push(start);
        let mut size = 0;
        while let Some(pixel) = stack.pop() {
            size += 1;
            let column = pixel % width;
            let neighbours = [
                (column > 0).then(|| pixel - 1),
                (column + 1 < width).then_some(pixel + 1),
                pixel.checked_sub(width),
                (pixel + width < valid.len()).then_some(pixel + width),
            ];
            for other in neighbours.into_iter().flatten() {
                if valid[other] == 1 && label[other] == 0 {
                    label[other] = next;
                    stack.push(other);
                }
            }
        }
        if size > best_size {
            (best, best_size) = (next, size);
        }
    }
    label.iter().map(|l| u8::from(*l == best && best != 0)).collect()
}
