//! Corners of a checkerboard: found and located to a fraction of a pixel, one image a repetition.

use super::Bench;
use anyhow::{Context, Result, ensure};
use characterise::target::{TargetKind, TargetSettings, TargetSpec, detect};
use fringe::frame::FrameView;
use serde_json::json;

/// Inner corners along a row and along a column.
const BOARD: [u32; 2] = [15, 10];

const SQUARE_MM: f64 = 8.0;
const IMAGES: usize = 3;

/// Detects the boards of all images in turn.
pub(super) fn corners(bench: &mut Bench) -> Result<()> {
    let (width_px, height_px) = bench.image_size()?;
    let spec = TargetSpec {
        format: None,
        kind: TargetKind::Checkerboard,
        columns: BOARD[0],
        rows: BOARD[1],
        pitch_mm: SQUARE_MM,
        diameter_mm: None,
        dictionary: None,
        marker_mm: None,
        first_marker: None,
    };
    let settings = TargetSettings::default();
    let (mut images, mut truths): (Vec<Vec<u8>>, Vec<Vec<[f64; 2]>>) = (Vec::new(), Vec::new());
    for number in 0..IMAGES {
        let (shape, pixels) = bench.bytes(&format!("board{number}"))?;
        ensure!(
            shape == [height_px as usize, width_px as usize],
            "board{number}.npy has shape {shape:?} where {height_px} x {width_px}, the rows and columns of --size, is needed"
        );
        images.push(pixels);
        let corners = bench.matrix(&format!("corners{number}"), (BOARD[0] * BOARD[1]) as usize, 2)?;
        truths.push(corners.as_chunks::<2>().0.to_vec());
    }
    let frame = |number: usize| FrameView::from_bytes(width_px, height_px, 255, &images[number]);
    let (mut found, mut errors_px) = (0, Vec::new());
    for (number, truth) in truths.iter().enumerate() {
        let view = frame(number).context("frame size")?;
        let Ok(detection) = detect(&view, &spec, &settings) else { continue };
        found += 1;
        let rms = |turned: bool| {
            let squares = detection.points.iter().map(|p| {
                let place = (p.index.1 * BOARD[0] + p.index.0) as usize;
                let place = if turned { truth.len() - 1 - place } else { place };
                (p.pixel.x - truth[place][0]).powi(2) + (p.pixel.y - truth[place][1]).powi(2)
            });
            (squares.sum::<f64>() / detection.points.len() as f64).sqrt()
        };
        errors_px.push(rms(false).min(rms(true)));
    }
    let mut turn = 0;
    let row = bench.time("corners, per image", 1, || {
        let view = frame(turn % IMAGES).context("frame size")?;
        turn += 1;
        // What is not found is counted above.
        let _ = detect(&view, &spec, &settings);
        Ok(())
    })?;
    row.with(json!({
        "found": format!("{found}/{IMAGES}"),
        "rms_px": (found > 0).then(|| errors_px.iter().sum::<f64>() / f64::from(found)),
    }));
    Ok(())
}
