//! The report of a flatness: of each repeat a map of the deviations with axes in mm, and their histogram (thesis figures 3.16, 3.17).

use super::charts;
use super::colour::ColourMap;
use super::error::ReportError;
use super::number::{self, fixed};
use super::page::{Page, Text, data_uri};
use super::picture::{Ends, Range, Scalar, scalar_raster};
use super::statistics::summary;
use super::svg::{self, Anchor};
use files::atomic;
use std::path::Path;

/// Columns of a map at most; fewer where the points lie farther apart.
const MOST_COLUMNS: f64 = 600.0;
/// Cells of a map are so many times the mean distance of the points: next to none stays empty.
const CELL_DISTANCES: f64 = 1.5;
/// Drawn width of a map, and what stands around it.
const WIDTH: f64 = 860.0;
const LEFT: f64 = 90.0;
const BELOW: f64 = 76.0;
const ABOVE: f64 = 10.0;

/// One measurement of the surface.
#[derive(Debug, Clone)]
pub struct FlatnessRepeat {
    /// Name of the repeat.
    pub name: String,
    /// Places along the two axes of the map, mm.
    pub across_mm: Vec<[f64; 2]>,
    /// Signed distance of each from the fitted plane, mm.
    pub deviations_mm: Vec<f64>,
    /// Text below the map.
    pub caption: String,
}

/// Content of the report.
#[derive(Debug, Clone)]
pub struct FlatnessInput {
    /// Title of the report.
    pub title: String,
    /// Labels and texts of the header.
    pub details: Vec<(String, String)>,
    /// Head and rows of the table of repeats.
    pub table: Vec<Vec<String>>,
    /// In the order of measurement.
    pub repeats: Vec<FlatnessRepeat>,
    /// Names of the two axes.
    pub axes: [&'static str; 2],
    /// End of the colour bar, mm; if `None`, the 99th percentile of all magnitudes, rounded up.
    pub half_range_mm: Option<f64>,
    /// Definitions at the end, a paragraph each.
    pub notes: Vec<String>,
}

/// Writes the report; the file is complete or absent.
///
/// # Errors
/// See [`ReportError`].
pub fn write_flatness(path: &Path, input: &FlatnessInput) -> Result<(), ReportError> {
    Ok(atomic::write(path, html(input)?.as_bytes())?)
}

fn html(input: &FlatnessInput) -> Result<String, ReportError> {
    let mut page = Page::begin(&input.title);
    page.put(format_args!("<header>\n<h1>Flatness</h1>\n<p class=\"sub\">{}</p>\n", Text(&input.title)));
    page.put(format_args!("<dl class=\"meta\">\n"));
    for (label, text) in &input.details {
        page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(label), Text(text)));
    }
    page.put(format_args!("</dl>\n</header>\n"));
    table(&mut page, &input.table);
    let all = input.repeats.iter().flat_map(|repeat| repeat.deviations_mm.iter().copied());
    let from_data = || number::round_up(summary(all).magnitude_99.unwrap_or(0.0)).max(1e-3);
    let half_range_mm = input.half_range_mm.unwrap_or_else(from_data);
    maps(&mut page, input, half_range_mm)?;
    page.section("Distribution of the deviations");
    for repeat in &input.repeats {
        page.put(format_args!("<h3>{}</h3>\n", Text(&repeat.name)));
        let numbers = summary(repeat.deviations_mm.iter().copied());
        charts::histogram(&mut page, &repeat.deviations_mm, &numbers, half_range_mm);
    }
    page.small("Dashed: normal distribution of the same mean, standard deviation and count. Line: mean.");
    page.end_section();
    page.section("Definitions and remarks");
    input.notes.iter().for_each(|note| page.small(note));
    page.end_section();
    Ok(page.end())
}

fn table(page: &mut Page, rows: &[Vec<String>]) {
    page.section("Repeats");
    page.put(format_args!("<div class=\"scroll\"><table>\n"));
    for (number, row) in rows.iter().enumerate() {
        let tag = if number == 0 { "th" } else { "td" };
        page.put(format_args!("<tr>"));
        for (column, cell) in row.iter().enumerate() {
            let class = if column == 0 { "" } else { " class=\"n\"" };
            page.put(format_args!("<{tag}{class}>{}</{tag}>", Text(cell)));
        }
        page.put(format_args!("</tr>\n"));
    }
    page.put(format_args!("</table></div>\n"));
    page.end_section();
}

fn maps(page: &mut Page, input: &FlatnessInput, half_range_mm: f64) -> Result<(), ReportError> {
    page.section("Deviation from the fitted plane");
    page.put(format_args!("<div class=\"pictures wide\">\n"));
    for repeat in &input.repeats {
        map(page, input, repeat, half_range_mm)?;
    }
    page.put(format_args!("</div>\n<div class=\"bar\">"));
    let high = half_range_mm * 1e3;
    charts::colour_bar(page, ColourMap::Diverging, Ends { low: -high, high }, "Deviation, µm", true);
    page.put(format_args!("</div>\n"));
    page.small(
        "Each cell of a map shows the mean deviation of its points; numbers and histograms are of single points.",
    );
    page.end_section();
    Ok(())
}

/// Mean deviations over even cells.
struct Grid {
    low_mm: [f64; 2],
    cell_mm: f64,
    size: [usize; 2],
    /// µm, row by row, the highest row first; NaN where there is no point.
    values_um: Vec<f32>,
}

fn grid(repeat: &FlatnessRepeat) -> Grid {
    let end = |axis: usize, pick: fn(f64, f64) -> f64, start: f64| {
        repeat.across_mm.iter().map(|at| at[axis]).fold(start, pick)
    };
    let low_mm = [0, 1].map(|axis| end(axis, f64::min, f64::INFINITY));
    let extent_mm = [0, 1].map(|axis| (end(axis, f64::max, f64::NEG_INFINITY) - low_mm[axis]).max(1e-6));
    let distance_mm = (extent_mm[0] * extent_mm[1] / repeat.across_mm.len().max(1) as f64).sqrt();
    let widest_mm = extent_mm[0].max(extent_mm[1]);
    let cell_mm = (CELL_DISTANCES * distance_mm).max(widest_mm / MOST_COLUMNS);
    let size = extent_mm.map(|extent| (extent / cell_mm) as usize + 1);
    let mut sums = vec![(0.0, 0_u32); size[0] * size[1]];
    for (at, deviation) in repeat.across_mm.iter().zip(&repeat.deviations_mm) {
        let [column, row] =
            [0, 1].map(|axis| (((at[axis] - low_mm[axis]) / cell_mm) as usize).min(size[axis] - 1));
        let sum = &mut sums[(size[1] - 1 - row) * size[0] + column];
        *sum = (sum.0 + deviation * 1e3, sum.1 + 1);
    }
    let mean =
        |(sum, count): &(f64, u32)| if *count == 0 { f32::NAN } else { (sum / f64::from(*count)) as f32 };
    Grid { low_mm, cell_mm, size, values_um: sums.iter().map(mean).collect() }
}

fn map(
    page: &mut Page,
    input: &FlatnessInput,
    repeat: &FlatnessRepeat,
    half_range_mm: f64,
) -> Result<(), ReportError> {
    let of = |source| ReportError::Picture { what: format!("deviation map of {}", repeat.name), source };
    let grid = grid(repeat);
    let high = half_range_mm * 1e3;
    let scalar = Scalar {
        width_px: grid.size[0] as u32,
        height_px: grid.size[1] as u32,
        values: &grid.values_um,
        valid: None,
        map: ColourMap::Diverging,
        range: Range::Fixed(-high, high),
        unit: "µm",
    };
    let png = scalar_raster(&scalar).and_then(|(raster, _)| raster.to_png()).map_err(of)?;
    let scale = WIDTH / grid.size[0] as f64;
    let height = scale * grid.size[1] as f64;
    page.put(format_args!("<figure>"));
    svg::open(page, "", [LEFT + WIDTH + 20.0, ABOVE + height + BELOW], "deviation map");
    page.put(format_args!(
        "<image x=\"{LEFT}\" y=\"{ABOVE}\" width=\"{WIDTH}\" height=\"{height:.1}\" preserveAspectRatio=\"none\" \
         style=\"image-rendering:pixelated\" href=\"{}\"/>\n\
         <rect x=\"{LEFT}\" y=\"{ABOVE}\" width=\"{WIDTH}\" height=\"{height:.1}\" fill=\"none\" stroke=\"#5b6875\"/>\n",
        data_uri(&png)
    ));
    axes(page, input.axes, &grid, scale, height);
    svg::close(page);
    page.put(format_args!(
        "<figcaption>{}: {}</figcaption></figure>\n",
        Text(&repeat.name),
        Text(&repeat.caption)
    ));
    Ok(())
}

fn axes(page: &mut Page, names: [&str; 2], grid: &Grid, scale: f64, height: f64) {
    let base = ABOVE + height;
    let px_per_mm = scale / grid.cell_mm;
    let ends = |axis: usize| (grid.low_mm[axis], grid.low_mm[axis] + grid.cell_mm * grid.size[axis] as f64);
    let ticks = |axis: usize| number::ticks(ends(axis).0, ends(axis).1, 6);
    let (values, digits) = ticks(0);
    for value in values {
        let x = LEFT + (value - grid.low_mm[0]) * px_per_mm;
        svg::mark_below(page, [x, base], 8.0, 24.0, &fixed(value, digits));
    }
    let (values, digits) = ticks(1);
    for value in values {
        let y = base - (value - grid.low_mm[1]) * px_per_mm;
        svg::line(page, [[LEFT - 8.0, y], [LEFT, y]], &format!("stroke=\"{}\"", svg::INK));
        svg::text(page, [LEFT - 13.0, y + 8.0], 24.0, Anchor::End, &fixed(value, digits));
    }
    svg::text(page, [LEFT + 0.5 * WIDTH, base + 66.0], 24.0, Anchor::Middle, &format!("{}, mm", names[0]));
    svg::upright_text(page, [24.0, ABOVE + 0.5 * height], 24.0, &format!("{}, mm", names[1]));
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ramp of deviations over a square: means of the cells, highest row first, and an empty cell.
    #[test]
    fn a_map_holds_the_means_of_its_cells() {
        let all = (0..40).flat_map(|y| (0..40).map(move |x| [f64::from(x), f64::from(y)]));
        let across_mm: Vec<[f64; 2]> = all.filter(|at| at[0] > 5.0 || at[1] > 5.0).collect();
        let deviations_mm: Vec<f64> = across_mm.iter().map(|at| 1e-3 * at[1]).collect();
        let (name, caption) = ("a <b>".to_owned(), "c".to_owned());
        let repeat = FlatnessRepeat { name, across_mm, deviations_mm, caption };
        let grid = grid(&repeat);
        let [columns, rows] = grid.size;
        assert_eq!(grid.values_um.len(), columns * rows);
        assert!(grid.values_um[(rows - 1) * columns].is_nan(), "the corner without points");
        for row in 0..rows {
            let found = f64::from(grid.values_um[row * columns + columns / 2]);
            let expected = grid.cell_mm * (rows as f64 - 0.5 - row as f64);
            assert!((found - expected).abs() < grid.cell_mm, "row {row}: {found} and {expected} µm");
        }
        let input = FlatnessInput {
            title: "t".into(),
            details: vec![("k".into(), "v".into())],
            table: vec![vec!["h".into()], vec!["1".into()]],
            repeats: vec![repeat],
            axes: ["x", "y"],
            half_range_mm: None,
            notes: vec!["n".into()],
        };
        let text = html(&input).unwrap();
        assert!(text.contains("x, mm") && text.contains("y, mm") && text.contains("Deviation, µm"));
        assert!(text.contains("a &lt;b&gt;") && !text.contains("a <b>"));
        assert!(!text.contains("NaN"), "an empty cell has no number");
    }
}
