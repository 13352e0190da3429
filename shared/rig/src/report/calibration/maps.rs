//! Maps of the predicted uncertainty on three planes of the working volume.

use fringe::calibration::{MapGrid, SpacingSettings, UncertaintyMap, Volume};

use super::super::charts::colour_bar;
use super::super::colour::ColourMap;
use super::super::page::{Page, Text, data_uri};
use super::super::picture::{Ends, Range, Scalar, scalar_raster};
use super::super::{PictureError, ReportError};
use super::CalibrationReport;

/// Places of a map: a spacing has 13 directions at each, so it has fewer.
const FINE: MapGrid = MapGrid { across: 36, planes: 3 };
const COARSE: MapGrid = MapGrid { across: 16, planes: 3 };

/// A row of three maps.
struct Row {
    name: String,
    maps: Vec<UncertaintyMap>,
}

/// The section.
///
/// # Errors
/// None that the input could cause.
pub fn section(page: &mut Page, report: &CalibrationReport<'_>) -> Result<(), ReportError> {
    let calibration = report.calibration;
    let Some(volume) = calibration.volume() else { return Ok(()) };
    let half = volume.half_mm * 2.0;
    page.section("Predicted uncertainty over the working volume");
    page.small(&format!(
        "The volume is the box about all poses of the target, {:.0} × {:.0} × {:.0} mm. Three planes through it: bottom, middle and top \
         (z along the mean normal of the target). Standard uncertainties (k = 1) by the calibration alone; grey: not seen.",
        half.x, half.y, half.z
    ));
    let devices = calibration.devices.iter().enumerate();
    let projection: Vec<Row> = devices
        .map(|(i, d)| Row { name: d.name.clone(), maps: calibration.projection_maps(i, &volume, &FINE) })
        .collect();
    group(page, "Projection into each device, px", &projection, 1.0, &volume)?;
    let mut points = Vec::new();
    let mut bars = Vec::new();
    let spacing = SpacingSettings { spacing_mm: report.spacing_mm, ..SpacingSettings::default() };
    for (name, pair) in report.pairs {
        for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
            let maps = calibration.point_maps(*pair, axis, &volume, &FINE);
            points.push(Row { name: format!("{name}, along {letter}"), maps });
        }
        bars.push(Row {
            name: name.clone(),
            maps: calibration.spacing_maps(*pair, &volume, &COARSE, &spacing),
        });
    }
    group(page, "A measured point along each axis, µm", &points, 1e3, &volume)?;
    let title = format!(
        "Distance of two spheres, {:.0} mm, about each place in its worst direction, µm",
        report.spacing_mm
    );
    group(page, &title, &bars, 1e3, &volume)?;
    if report.pairs.is_empty() {
        page.small(
            "No pair is defined, so nothing is said about points and distances; name one with --pair.",
        );
    }
    page.end_section();
    Ok(())
}

fn group(
    page: &mut Page,
    title: &str,
    rows: &[Row],
    factor: f64,
    volume: &Volume,
) -> Result<(), ReportError> {
    let values = rows.iter().flat_map(|r| &r.maps).flat_map(|m| &m.values).filter(|v| v.is_finite());
    let high = values.copied().fold(0.0, f64::max) * factor;
    if high <= 0.0 {
        return Ok(());
    }
    let ends = Ends { low: 0.0, high };
    page.put(format_args!("<h3>{}</h3>\n<div class=\"maps\">\n", Text(title)));
    for row in rows {
        page.put(format_args!("<div class=\"name\">{}</div>", Text(&row.name)));
        for map in &row.maps {
            let png = picture(map, factor, high)
                .map_err(|source| ReportError::Picture { what: row.name.clone(), source })?;
            let seen = || map.values.iter().copied().filter(|v| v.is_finite());
            let (low, top) =
                (seen().fold(f64::INFINITY, f64::min) * factor, seen().fold(0.0, f64::max) * factor);
            let range =
                if low.is_finite() { format!("{low:.3} … {top:.3}") } else { "not seen".to_owned() };
            page.put(format_args!(
                "<figure><img src=\"{}\" style=\"aspect-ratio:{:.3}\" alt=\"{2}\"><figcaption>z {3:+.0} mm: {range}</figcaption></figure>",
                data_uri(&png),
                volume.half_mm.x / volume.half_mm.y.max(1e-9),
                Text(title),
                map.z_mm,
            ));
        }
        page.put(format_args!("\n"));
    }
    page.put(format_args!("</div>\n"));
    colour_bar(page, ColourMap::Sequential, ends, title, false);
    Ok(())
}

/// y upwards, enlarged by the page.
fn picture(map: &UncertaintyMap, factor: f64, high: f64) -> Result<Vec<u8>, PictureError> {
    let values: Vec<f32> =
        map.values.chunks(map.columns.max(1)).rev().flatten().map(|v| (v * factor) as f32).collect();
    let scalar = Scalar {
        width_px: map.columns as u32,
        height_px: (map.values.len() / map.columns.max(1)) as u32,
        values: &values,
        valid: None,
        map: ColourMap::Sequential,
        range: Range::Fixed(0.0, high),
        unit: "",
    };
    scalar_raster(&scalar)?.0.to_png()
}
