//! Pictures of the report: rasters as embedded PNG, labels and scales as text above or below them.

use fringe::phase::PhaseView;

use super::colour::Colouring;
use super::colour::{ColourMap, hex, pair_colour};
use super::number::{self, count, fixed, optional, signed};
use super::page::{Page, Text, data_uri};
use super::picture::{self, Ends, Scalar};
use super::raster::{PictureError, Raster, grey_to_png};
use super::splat::{View, render};
use super::statistics::{Summary, summary};
use super::{GreyPicture, ReportError, ReportInput, charts, svg};

/// Pictures are reduced by a whole factor until they are at most this wide: wider than any sheet shows them.
const MAX_WIDTH_PX: usize = 1200;

/// End of the colour bar if all deviations are zero, mm.
const SMALLEST_HALF_RANGE_MM: f64 = 0.001;

fn of(what: &str) -> impl FnOnce(PictureError) -> ReportError + use<'_> {
    move |source| ReportError::Picture { what: what.to_owned(), source }
}

/// Deviation map, colour bar, histogram.
///
/// # Errors
/// A deviation of a point that does not exist.
pub fn deviations(page: &mut Page, input: &ReportInput<'_>) -> Result<(), ReportError> {
    if input.deviations.is_empty() {
        return Ok(());
    }
    let values_mm: Vec<f64> = input.deviations.iter().map(|(_, d)| f64::from(*d)).collect();
    let summary = summary(values_mm.iter().copied());
    let half_range_mm = half_range(input.deviation_half_range_mm, &summary);
    let colouring = Colouring::Deviation { values: input.deviations, half_range_mm };
    page.section("Deviation map");
    page.put(format_args!("<div class=\"pictures wide\">\n"));
    for view in [View::oblique(960, 700), View::top(960, 700)] {
        cloud(page, input, &view, &colouring, "deviation map")?;
    }
    let high = half_range_mm * 1e3;
    page.put(format_args!("</div>\n<div class=\"bar\">"));
    charts::colour_bar(page, ColourMap::Diverging, Ends { low: -high, high }, "Deviation, µm", true);
    page.put(format_args!("</div>\n"));
    page.small(&input.deviation_meaning);
    page.small("Each pixel shows the mean deviation of the points in front; numbers and histogram are of single points.");
    page.small(&deviation_numbers(&values_mm, &summary, half_range_mm, input.cloud.len()));
    page.put(format_args!("<h3>Histogram of deviations</h3>\n"));
    charts::histogram(page, &values_mm, &summary, half_range_mm);
    page.small("Dashed: normal distribution of the same mean, standard deviation and count. Line: mean.");
    page.end_section();
    Ok(())
}

fn half_range(wanted_mm: Option<f64>, summary: &Summary) -> f64 {
    let wanted = wanted_mm.filter(|r| r.is_finite() && *r > 0.0);
    let from_data = || number::round_up(summary.magnitude_99.unwrap_or(0.0)).max(SMALLEST_HALF_RANGE_MM);
    wanted.unwrap_or_else(from_data)
}

fn deviation_numbers(values_mm: &[f64], summary: &Summary, half_range_mm: f64, points: usize) -> String {
    let um = |value: Option<f64>| value.map(|v| v * 1e3);
    let with_sign = |value: Option<f64>| um(value).map_or_else(|| number::NONE.to_owned(), |v| signed(v, 1));
    let beyond = values_mm.iter().filter(|d| d.is_finite() && d.abs() > half_range_mm).count();
    let mut sentences = vec![format!(
        "{} of {} points evaluated: mean {} µm, sd {} µm, 95th percentile of the magnitudes {} µm, smallest {} µm, \
         largest {} µm.",
        count(summary.count as u64),
        count(points as u64),
        with_sign(summary.mean),
        optional(um(summary.sd), 1),
        optional(um(summary.magnitude_95), 1),
        with_sign(summary.min),
        with_sign(summary.max)
    )];
    if beyond > 0 {
        sentences
            .push(format!("{} are beyond the colour bar and have its end colours.", count(beyond as u64)));
    }
    if summary.not_finite > 0 {
        sentences.push(format!("{} could not be evaluated.", count(summary.not_finite as u64)));
    }
    if summary.count < points {
        sentences.push("Points without a deviation are grey.".to_owned());
    }
    sentences.join(" ")
}

/// Views of the cloud, shaded and by pair.
///
/// # Errors
/// None that the input could cause.
pub fn clouds(page: &mut Page, input: &ReportInput<'_>) -> Result<(), ReportError> {
    page.section("Point cloud");
    if input.cloud.is_empty() {
        page.small("The cloud is empty.");
        page.end_section();
        return Ok(());
    }
    let pairs = points_by_pair(input);
    page.put(format_args!("<h3>Shaded by the surface normal</h3>\n<div class=\"pictures\">\n"));
    for view in views() {
        cloud(page, input, &view, &Colouring::Normal, "point cloud")?;
    }
    page.put(format_args!("</div>\n<h3>Coloured by pair</h3>\n<ul class=\"legend\">"));
    for (pair, points) in pairs.iter().enumerate().filter(|(_, n)| **n > 0) {
        let unnamed = format!("pair {pair}");
        let name = input.pair_names.get(pair).unwrap_or(&unnamed);
        page.put(format_args!(
            "<li><i style=\"background:{}\"></i>{} ({} points)</li>",
            hex(pair_colour(pair)),
            Text(name),
            count(*points)
        ));
    }
    let seen = pairs.iter().filter(|n| **n > 0).count();
    if seen == 2 && pairs[0] > 0 && pairs[1] > 0 {
        let (a, b) = (pair_colour(0), pair_colour(1));
        let mixed = [0, 1, 2].map(|k| a[k].midpoint(b[k]));
        page.put(format_args!("<li><i style=\"background:{}\"></i>both, mixed</li>", hex(mixed)));
    }
    page.put(format_args!("</ul>\n<div class=\"pictures\">\n"));
    for view in views() {
        cloud(page, input, &view, &Colouring::Pair, "point cloud")?;
    }
    page.put(format_args!("</div>\n"));
    page.small(&format!("{} points. Parallel projection; each pixel shows the mean of the points in front, so where pairs overlap \
         their colours mix.", count(input.cloud.len() as u64)));
    page.end_section();
    Ok(())
}

fn views() -> [View; 3] {
    [View::oblique(720, 540), View::front(720, 540), View::top(720, 540)]
}

/// Number of points of each pair; the last entry takes pair numbers beyond all sense.
fn points_by_pair(input: &ReportInput<'_>) -> Vec<u64> {
    const MOST: usize = 64;
    let mut points = vec![0; MOST];
    for point in input.cloud {
        points[(point.pair as usize).min(MOST - 1)] += 1;
    }
    points
}

fn cloud(
    page: &mut Page,
    input: &ReportInput<'_>,
    view: &View,
    colouring: &Colouring<'_>,
    what: &str,
) -> Result<(), ReportError> {
    let rendered = render(input.cloud, view, colouring).map_err(of(what))?;
    let png = rendered.raster.to_png().map_err(of(what))?;
    let (width, height) = (rendered.raster.width, rendered.raster.height);
    page.put(format_args!("<figure>"));
    svg::open(page, "framed", [width as f64, height as f64], &format!("{what}, {}", view.name));
    page.put(format_args!("<image width=\"{width}\" height=\"{height}\" href=\"{}\"/>\n", data_uri(&png)));
    if let Some(bar_mm) = rendered.scale_bar_mm() {
        let length = bar_mm / rendered.mm_per_px;
        svg::scale_bar(page, [22.0, height as f64 - 18.0], length, 22.0, &format!("{bar_mm} mm"));
    }
    svg::triad(page, [width as f64 - 78.0, height as f64 - 64.0], rendered.axes, 20.0);
    svg::close(page);
    page.put(format_args!("<figcaption>{}</figcaption></figure>\n", Text(&view.name)));
    Ok(())
}

/// Camera views and phase maps.
///
/// # Errors
/// A picture whose data do not fit its size.
pub fn views_and_maps(page: &mut Page, input: &ReportInput<'_>) -> Result<(), ReportError> {
    if !input.camera_views.is_empty() {
        page.section("Camera views");
        // Four pictures fill two rows of two, not one of three and one.
        let class = if matches!(input.camera_views.len(), 2 | 4) { "pictures wide" } else { "pictures" };
        page.put(format_args!("<div class=\"{class}\">\n"));
        for view in &input.camera_views {
            let png = grey(view).map_err(of(&view.caption))?;
            image(page, &png, &view.caption);
            page.put(format_args!("</figure>\n"));
        }
        page.put(format_args!("</div>\n"));
        page.end_section();
    }
    if !input.phase_maps.is_empty() {
        page.section("Phase maps");
        page.put(format_args!("<div class=\"pictures wide\">\n"));
        for map in &input.phase_maps {
            phase(page, map.caption, &map.phase).map_err(of(map.caption))?;
        }
        page.put(format_args!("</div>\n"));
        page.end_section();
    }
    Ok(())
}

fn grey(view: &GreyPicture) -> Result<Vec<u8>, PictureError> {
    let (width, height) = (view.width_px as usize, view.height_px as usize);
    if width <= MAX_WIDTH_PX {
        return grey_to_png(width, height, &view.values);
    }
    super::raster::check_plane("grey picture", width, height, view.values.len())?;
    let colours = view.values.iter().map(|v| [*v; 3]).collect();
    let small = reduced(Raster { width, height, pixels: colours })?;
    let values: Vec<u8> = small.pixels.iter().map(|p| p[0]).collect();
    grey_to_png(small.width, small.height, &values)
}

fn reduced(raster: Raster) -> Result<Raster, PictureError> {
    match raster.width.div_ceil(MAX_WIDTH_PX) {
        0 | 1 => Ok(raster),
        // A strip of few rows cannot be reduced and is small anyway.
        factor if raster.height < factor => Ok(raster),
        factor => raster.reduced(factor),
    }
}

fn image(page: &mut Page, png: &[u8], caption: &str) {
    page.put(format_args!(
        "<figure><img src=\"{}\" alt=\"{1}\"><figcaption>{1}</figcaption>",
        data_uri(png),
        Text(caption)
    ));
}

fn phase(page: &mut Page, caption: &str, phase: &PhaseView<'_>) -> Result<(), PictureError> {
    let wrapped = picture::wrapped(phase);
    let period = fixed(phase.info.period_px, 2);
    let absolute = format!("{caption}: absolute phase, {period} projector px per 2π");
    scalar(page, &picture::absolute(phase), &absolute, "Absolute phase, rad")?;
    let caption = format!("{caption}: wrapped phase");
    scalar(page, &picture::wrapped_scalar(phase, &wrapped), &caption, "Wrapped phase, rad")
}

fn scalar(page: &mut Page, scalar: &Scalar<'_>, caption: &str, title: &str) -> Result<(), PictureError> {
    let (raster, ends) = picture::scalar_raster(scalar)?;
    image(page, &reduced(raster)?.to_png()?, caption);
    charts::colour_bar(page, scalar.map, ends, title, false);
    page.put(format_args!("</figure>\n"));
    Ok(())
}
