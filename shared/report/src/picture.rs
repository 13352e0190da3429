//! Pictures of rasters and clouds as PNG files that explain themselves: colour bar, values, unit.
//!
//! [`crate`] sets the same rasters without labels and writes the labels as text beside them.

use std::f64::consts::TAU;

use fringe::cloud::Point;
use fringe::math::wrap_positive_rad;
use fringe::phase::PhaseView;

pub use super::colour::Colouring;
use super::colour::{ColourMap, INK, Rgb, WHITE};
use super::glyph::{text_height, text_width, write_text};
use super::number;
pub use super::raster::{PictureError, Raster};
use super::raster::{check_plane, grey_to_png};
pub use super::splat::{Rendered, View, render};
use super::statistics::inner_range;

/// Free space around the parts of a labelled picture, px.
const MARGIN: usize = 10;

/// Width of a colour bar, px.
const BAR: usize = 16;

/// How the ends of a colour bar are found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// From the data, the outermost thousandth of the values at each side left out.
    Inner,
    /// From the first to the second value.
    Fixed(f64, f64),
}

/// A raster of numbers to be coloured.
#[derive(Debug, Clone, Copy)]
pub struct Scalar<'a> {
    /// Number of columns, px.
    pub width_px: u32,
    /// Number of rows, px.
    pub height_px: u32,
    /// width × height values; NaN shows as invalid.
    pub values: &'a [f32],
    /// 0 where a value may not be used; `None` if all may.
    pub valid: Option<&'a [u8]>,
    /// Colour map of the values.
    pub map: ColourMap,
    /// Ends of the colour bar.
    pub range: Range,
    /// Printed at the colour bar: `rad`, `DN`, `px`, `µm`, `mm`.
    pub unit: &'a str,
}

/// The ends of the colour bar of a picture; 0 … 1 if it has no valid value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ends {
    /// Value of the first colour.
    pub low: f64,
    /// Value of the last colour.
    pub high: f64,
}

/// 8-bit grey values, row by row, as a grey PNG.
///
/// # Errors
/// A size that does not fit the number of values.
pub fn grey_png(width_px: u32, height_px: u32, values: &[u8]) -> Result<Vec<u8>, PictureError> {
    grey_to_png(width_px as usize, height_px as usize, values)
}

/// Absolute phase with a colour bar in rad.
///
/// # Errors
/// Planes that do not fit the size of the map.
pub fn phase_png(phase: &PhaseView<'_>) -> Result<Vec<u8>, PictureError> {
    scalar_png(&absolute(phase))
}

/// The phase wrapped into 0 … 2π, with a cyclic colour map.
///
/// # Errors
/// Planes that do not fit the size of the map.
pub fn wrapped_phase_png(phase: &PhaseView<'_>) -> Result<Vec<u8>, PictureError> {
    let values = wrapped(phase);
    scalar_png(&wrapped_scalar(phase, &values))
}

/// Modulation in DN with a colour bar from 0, including invalid pixels.
///
/// # Errors
/// Planes that do not fit the size of the map.
pub fn modulation_png(phase: &PhaseView<'_>) -> Result<Vec<u8>, PictureError> {
    scalar_png(&modulation(phase))
}

/// Fringe order: the number of whole periods in the absolute phase, counted from 0 at the first column.
///
/// # Errors
/// Planes that do not fit the size of the map.
pub fn order_png(phase: &PhaseView<'_>) -> Result<Vec<u8>, PictureError> {
    let orders: Vec<f32> = phase.phase_rad.iter().map(|p| (f64::from(*p) / TAU).floor() as f32).collect();
    scalar_png(&Scalar { values: &orders, unit: "", ..absolute(phase) })
}

/// A labelled picture of any raster of numbers.
///
/// # Errors
/// Planes that do not fit the size.
pub fn scalar_png(scalar: &Scalar<'_>) -> Result<Vec<u8>, PictureError> {
    let (raster, ends) = scalar_raster(scalar)?;
    with_colour_bar(&raster, scalar.map, ends, scalar.unit)?.to_png()
}

/// A cloud from one side, with a scale bar, and with a colour bar in µm where deviations are shown.
///
/// # Errors
/// A size that no picture has.
pub fn cloud_png(points: &[Point], view: &View, colouring: &Colouring<'_>) -> Result<Vec<u8>, PictureError> {
    let mut rendered = render(points, view, colouring)?;
    draw_scale_bar(&mut rendered);
    match colouring {
        Colouring::Deviation { half_range_mm, .. } => {
            let high = half_range_mm * 1e3;
            let ends = Ends { low: -high, high };
            with_colour_bar(&rendered.raster, ColourMap::Diverging, ends, "µm")?.to_png()
        }
        Colouring::Normal | Colouring::Pair | Colouring::Given { .. } => rendered.raster.to_png(),
    }
}

/// The absolute phase of a map as a picture in rad.
pub(crate) fn absolute<'a>(phase: &PhaseView<'a>) -> Scalar<'a> {
    Scalar {
        width_px: phase.info.width_px,
        height_px: phase.info.height_px,
        values: phase.phase_rad,
        valid: Some(phase.valid),
        map: ColourMap::Sequential,
        range: Range::Inner,
        unit: "rad",
    }
}

/// The phase of a map wrapped into 0 … 2π.
pub(crate) fn wrapped(phase: &PhaseView<'_>) -> Vec<f32> {
    phase.phase_rad.iter().map(|p| wrap_positive_rad(f64::from(*p)) as f32).collect()
}

/// Wrapped values as a picture in rad.
pub(crate) fn wrapped_scalar<'a>(phase: &PhaseView<'a>, values: &'a [f32]) -> Scalar<'a> {
    Scalar { values, map: ColourMap::Cyclic, range: Range::Fixed(0.0, TAU), ..absolute(phase) }
}

/// The modulation of a map as a picture in DN.
fn modulation<'a>(phase: &PhaseView<'a>) -> Scalar<'a> {
    let values = phase.modulation;
    let high = inner_range(values.iter().copied()).map_or(1.0, |(_, high)| high);
    Scalar { values, valid: None, range: Range::Fixed(0.0, high), unit: "DN", ..absolute(phase) }
}

/// Colours a raster of numbers; gives the ends of its colour bar too.
///
/// # Errors
/// Planes that do not fit the size.
pub(crate) fn scalar_raster(scalar: &Scalar<'_>) -> Result<(Raster, Ends), PictureError> {
    let (width, height) = (scalar.width_px as usize, scalar.height_px as usize);
    check_plane("plane of values", width, height, scalar.values.len())?;
    if let Some(valid) = scalar.valid {
        check_plane("plane of validity", width, height, valid.len())?;
    }
    let usable = |i: usize| scalar.valid.is_none_or(|valid| valid[i] != 0);
    let shown = |i: usize| if usable(i) { scalar.values[i] } else { f32::NAN };
    let ends = match scalar.range {
        Range::Fixed(low, high) => Ends { low, high },
        Range::Inner => inner_range((0..scalar.values.len()).map(shown))
            .map_or(Ends { low: 0.0, high: 1.0 }, |(low, high)| Ends { low, high }),
    };
    let mut raster = Raster::new(width, height, WHITE)?;
    for (i, pixel) in raster.pixels.iter_mut().enumerate() {
        *pixel = scalar.map.colour(share(f64::from(shown(i)), ends));
    }
    Ok((raster, ends))
}

/// Place of a value on the colour bar, the middle of it where the bar has no length.
pub(crate) fn share(value: f64, ends: Ends) -> f64 {
    let length = ends.high - ends.low;
    if length > 0.0 || value.is_nan() { (value - ends.low) / length } else { 0.5 }
}

/// Sets a colour bar with values and unit at the right of a picture.
pub(crate) fn with_colour_bar(
    picture: &Raster,
    map: ColourMap,
    ends: Ends,
    unit: &str,
) -> Result<Raster, PictureError> {
    let scale = (picture.height / 350).clamp(1, 4);
    let height = picture.height.max(8 * text_height(scale));
    let labels: Vec<(f64, String)> = labels(ends);
    let widest = labels.iter().map(|(_, text)| text_width(text, scale)).max().unwrap_or(0);
    let right = (BAR * scale + 3 * MARGIN + widest).max(text_width(unit, scale) + 2 * MARGIN);
    let mut sheet = Raster::new(picture.width + right, height, WHITE)?;
    sheet.paste(picture, 0, 0);
    let left = picture.width + MARGIN;
    let top = text_height(scale) + 2 * MARGIN;
    let length = height - top - MARGIN;
    write_text(&mut sheet, left, MARGIN, unit, scale, INK);
    for row in 0..length {
        let t = 1.0 - row as f64 / (length - 1).max(1) as f64;
        sheet.fill(left, top + row, BAR * scale, 1, map.colour(t));
    }
    for (value, text) in labels {
        let row = top + ((1.0 - share(value, ends)) * (length - 1) as f64) as usize;
        sheet.fill(left + BAR * scale, row, MARGIN / 2, 1, INK);
        let upper = row.saturating_sub(text_height(scale) / 2);
        write_text(&mut sheet, left + BAR * scale + MARGIN, upper, &text, scale, INK);
    }
    Ok(sheet)
}

/// Round values along a colour bar.
fn labels(ends: Ends) -> Vec<(f64, String)> {
    let (values, decimals) = number::ticks(ends.low, ends.high, 6);
    if values.is_empty() {
        return vec![(ends.low, number::fixed(ends.low, 3))];
    }
    values.into_iter().map(|v| (v, number::fixed(v, decimals))).collect()
}

/// Draws the scale bar of a cloud picture, bottom left.
pub(crate) fn draw_scale_bar(rendered: &mut Rendered) {
    let Some(bar_mm) = rendered.scale_bar_mm() else {
        return;
    };
    let bar_px = (bar_mm / rendered.mm_per_px) as usize;
    let base = rendered.raster.height.saturating_sub(MARGIN + 3);
    let ink: Rgb = INK;
    rendered.raster.fill(MARGIN, base, bar_px, 3, ink);
    let text = format!("{bar_mm} mm");
    write_text(&mut rendered.raster, MARGIN, base.saturating_sub(20), &text, 2, ink);
}
