//! Maps of the predicted uncertainty on three planes of the working volume.

use characterise::calibration::{MapGrid, SpacingSettings, UncertaintyMap};

use super::super::charts::colour_bar;
use super::super::colour::ColourMap;
use super::super::number::{decimals, round_up, signed};
use super::super::page::{Page, Text, data_uri};
use super::super::picture::{Ends, Range, Scalar, scalar_raster};
use super::super::{PictureError, ReportError};
use super::CalibrationReport;

/// Places of a map: a spacing has 13 directions at each, so it has fewer.
const FINE: MapGrid = MapGrid { across: 36, planes: 3 };
const COARSE: MapGrid = MapGrid { across: 16, planes: 3 };

/// How a plane of the volume is shown.
#[derive(Clone, Copy)]
struct Flat {
    /// Ratio of width to height.
    ratio: f64,
    /// Whether y and z point the other way, so that z points to the devices.
    turned: bool,
}

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
        "The volume is the box about all poses of the target, {:.0} × {:.0} × {:.0} mm; axes as in the drawings of the cell. Standard \
         uncertainties (k = 1) by the calibration alone, on three planes; grey: not seen, or outside of the volume. Places where no pose was, mostly the \
         corners, are known worst: measure away from them, or add poses there.",
        half.x, half.y, half.z
    ));
    let devices = calibration.devices.iter().enumerate();
    let projection: Vec<Row> = devices
        .map(|(i, d)| Row { name: d.name.clone(), maps: calibration.projection_maps(i, &volume, &FINE) })
        .collect();
    let flat = Flat { ratio: half.x / half.y.max(1e-9), turned: super::turned(report, &volume) };
    group(page, "Projection into each device, px", &projection, 1.0, flat)?;
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
    group(page, "A measured point along each axis, µm", &points, 1e3, flat)?;
    let title = format!(
        "Distance of two spheres, {:.0} mm, from each place in its worst direction within the volume, µm",
        report.spacing_mm
    );
    group(page, &title, &bars, 1e3, flat)?;
    if report.pairs.is_empty() {
        page.small(
            "No pair is defined, so uncertainties of points and distances are not predicted; define one with --pair.",
        );
    }
    page.end_section();
    Ok(())
}

fn group(page: &mut Page, title: &str, rows: &[Row], factor: f64, flat: Flat) -> Result<(), ReportError> {
    let mut values: Vec<f64> =
        rows.iter().flat_map(|r| &r.maps).flat_map(|m| m.values.iter().copied()).collect();
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    let Some(largest) = values.last().map(|v| v * factor).filter(|v| *v > 0.0) else { return Ok(()) };
    // A bar up to the largest value of all would show nothing but the corners.
    let high = round_up(values[values.len() * 9 / 10] * factor).min(largest);
    page.put(format_args!("<h3>{}</h3>\n<div class=\"maps\">\n<div></div>", Text(title)));
    for plane in ["far from the devices", "middle", "near the devices"] {
        page.put(format_args!("<div class=\"name\">{plane}</div>"));
    }
    for row in rows {
        page.put(format_args!("<div class=\"name\">{}</div>", Text(&row.name)));
        let mut order: Vec<&UncertaintyMap> = row.maps.iter().collect();
        if flat.turned {
            order.reverse();
        }
        for map in order {
            let png = picture(map, factor, high, flat.turned)
                .map_err(|source| ReportError::Picture { what: row.name.clone(), source })?;
            page.put(format_args!(
                "<figure><img src=\"{}\" style=\"aspect-ratio:{:.3}\" alt=\"{}\"><figcaption>{}</figcaption></figure>",
                data_uri(&png),
                flat.ratio,
                Text(title),
                range(map, factor, flat.turned)
            ));
        }
        page.put(format_args!("\n"));
    }
    page.put(format_args!("</div>\n"));
    let unit = if factor == 1.0 { "px" } else { "µm" };
    let more = if high < largest { "; larger values have the last colour" } else { "" };
    let bar = format!("Standard uncertainty, {unit}{more}");
    colour_bar(page, ColourMap::Sequential, Ends { low: 0.0, high }, &bar, false);
    Ok(())
}

/// Height of the plane, and smallest and largest value on it.
fn range(map: &UncertaintyMap, factor: f64, turned: bool) -> String {
    let z_mm = signed(if turned { -map.z_mm } else { map.z_mm }, 0);
    let seen = || map.values.iter().filter(|v| v.is_finite()).map(|v| v * factor);
    let (low, high) = (seen().fold(f64::INFINITY, f64::min), seen().fold(0.0, f64::max));
    if !low.is_finite() {
        return format!("z {z_mm} mm: not seen");
    }
    let digits = decimals(Some(low));
    format!("z {z_mm} mm: {low:.digits$} to {high:.digits$}")
}

/// y upwards, enlarged by the page.
fn picture(map: &UncertaintyMap, factor: f64, high: f64, turned: bool) -> Result<Vec<u8>, PictureError> {
    let mut lines: Vec<&[f64]> = map.values.chunks(map.columns.max(1)).collect();
    if !turned {
        lines.reverse();
    }
    let values: Vec<f32> = lines.into_iter().flatten().map(|v| (v * factor) as f32).collect();
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
