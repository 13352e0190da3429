//! Curves as SVG, and sheets of them: for measurements that are no cycle of the cell.

use super::number::{self, fixed};
use super::page::{Page, Text};
use super::svg::{self, Anchor};
use files::atomic;
use files::error::FileError;
use std::path::Path;

const COLOURS: [&str; 4] = ["#0b5cad", "#c4570c", "#17693a", "#7a3b9a"];

const LEFT: f64 = 84.0;
const RIGHT: f64 = 980.0;
const TOP: f64 = 22.0;
const BASE: f64 = 290.0;

/// Decades below the largest value that a logarithmic axis shows at most.
const MOST_DECADES: i32 = 6;

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line through the points.
    Line,
    /// A dot at each point.
    Dots,
    /// Bars from the bottom; the bars of several series stand side by side at each whole x.
    Bars,
}

/// Points of one kind.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// How they are drawn.
    pub mark: Mark,
    /// x and y; what is not finite is left out.
    pub points: Vec<(f64, f64)>,
}

/// A diagram with its axes and series.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Heading of the diagram.
    pub title: String,
    /// Quantity and unit along x.
    pub x_label: String,
    /// Quantity and unit along y.
    pub y_label: String,
    /// Whether y is logarithmic; values that are not positive are left out then.
    pub log_y: bool,
    /// What is drawn, in this order.
    pub series: Vec<Series>,
    /// Positions along x that are marked with a name.
    pub marks: Vec<(f64, String)>,
    /// Text below the diagram.
    pub note: String,
}

/// A page of diagrams.
#[derive(Debug, Clone)]
pub struct Sheet {
    /// Title of the page.
    pub title: String,
    /// Text below the title.
    pub subtitle: String,
    /// Names and values at the top of the page.
    pub facts: Vec<(String, String)>,
    /// Diagrams in their order.
    pub plots: Vec<Plot>,
    /// Remarks at the end of the page.
    pub notes: Vec<String>,
}

/// Writes a sheet as one HTML file; it is complete or absent.
///
/// # Errors
/// The file cannot be written.
pub fn write_sheet(path: &Path, sheet: &Sheet) -> Result<(), FileError> {
    atomic::write(path, sheet_html(sheet).as_bytes())
}

/// A sheet as text.
pub fn sheet_html(sheet: &Sheet) -> String {
    let mut page = Page::begin(&sheet.title);
    page.put(format_args!(
        "<header><h1>{}</h1>\n<p class=\"sub\">{}</p>\n<dl class=\"meta\">\n",
        Text(&sheet.title),
        Text(&sheet.subtitle)
    ));
    for (name, value) in &sheet.facts {
        page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(name), Text(value)));
    }
    page.put(format_args!("</dl></header>\n"));
    for plot in &sheet.plots {
        page.section(&plot.title);
        draw(&mut page, plot);
        page.small(&plot.note);
        page.end_section();
    }
    if !sheet.notes.is_empty() {
        page.section("Definitions and remarks");
        sheet.notes.iter().for_each(|note| page.small(note));
        page.end_section();
    }
    page.end()
}

/// Ends of an axis and the way from values to places.
struct Axis {
    low: f64,
    high: f64,
    log: bool,
}

impl Axis {
    fn linear(values: impl Iterator<Item = f64>, pad: f64, floor: Option<f64>) -> Self {
        let (mut low, mut high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if low == high {
            (low, high) = (low - 0.5 * low.abs().max(1e-9), high + 0.5 * high.abs().max(1e-9));
        }
        let pad = pad * (high - low);
        Self { low: floor.map_or(low - pad, |f| f.min(low)), high: high + pad, log: false }
    }

    fn decades(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) =
            values.filter(|v| *v > 0.0).fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        let power = |v: f64| fringe::math::ln(v) / std::f64::consts::LN_10;
        if high <= 0.0 {
            return Self { low: 0.0, high: 1.0, log: true };
        }
        let top = (power(high) + 0.05).ceil();
        let bottom = (power(low) - 0.05).floor().max(top - f64::from(MOST_DECADES)).min(top - 1.0);
        Self { low: bottom, high: top, log: true }
    }

    /// 0 … 1 along the axis.
    fn share(&self, value: f64) -> Option<f64> {
        let value = if self.log {
            if value <= 0.0 {
                return None;
            }
            fringe::math::ln(value) / std::f64::consts::LN_10
        } else {
            value
        };
        let share = (value - self.low) / (self.high - self.low);
        share.is_finite().then(|| share.clamp(0.0, 1.0))
    }

    fn ticks(&self, wanted: usize) -> Vec<(f64, String)> {
        if self.log {
            let text = |i: i32| {
                if (-4..=4).contains(&i) {
                    fixed(10.0_f64.powi(i), (-i).max(0) as usize)
                } else {
                    format!("1e{i}")
                }
            };
            return (self.low as i32..=self.high as i32).map(|i| (10.0_f64.powi(i), text(i))).collect();
        }
        let (values, digits) = number::ticks(self.low, self.high, wanted);
        values.into_iter().map(|v| (v, fixed(v, digits))).collect()
    }
}

pub(crate) fn draw(page: &mut Page, plot: &Plot) {
    let bars = plot.series.iter().filter(|s| s.mark == Mark::Bars).count();
    let all = || plot.series.iter().flat_map(|s| &s.points).filter(|(x, y)| x.is_finite() && y.is_finite());
    let side = if bars > 0 { 0.5 } else { 0.0 };
    let x =
        Axis::linear(all().flat_map(|(x, _)| [x - side, x + side]), if bars > 0 { 0.0 } else { 0.02 }, None);
    let y = if plot.log_y {
        Axis::decades(all().map(|(_, y)| *y))
    } else {
        Axis::linear(all().map(|(_, y)| *y), 0.05, (bars > 0).then_some(0.0))
    };
    legend(page, plot);
    page.put(format_args!("<div class=\"chart\">"));
    svg::open(page, "", [1000.0, 340.0], &plot.title);
    axes(page, plot, &x, &y);
    let mut bar = 0;
    for (series, colour) in plot.series.iter().zip(COLOURS.iter().cycle()) {
        let place = |(px, py): &(f64, f64)| {
            let (sx, sy) = (x.share(*px)?, y.share(*py)?);
            Some([LEFT + (RIGHT - LEFT) * sx, BASE - (BASE - TOP) * sy])
        };
        let places: Vec<[f64; 2]> = series.points.iter().filter_map(place).collect();
        match series.mark {
            Mark::Line => svg::line(page, places, &format!("stroke=\"{colour}\" stroke-width=\"1.6\"")),
            Mark::Dots => dots(page, &places, colour),
            Mark::Bars => {
                let unit = (RIGHT - LEFT) / (x.high - x.low);
                let width = 0.7 * unit / bars as f64;
                let first = -0.35 * unit + width * f64::from(bar);
                bar += 1;
                for [at, top] in &places {
                    let size = [width * 0.92, (BASE - top).max(0.5)];
                    svg::rectangle(page, [at + first, *top], size, colour, "");
                }
            }
        }
    }
    svg::close(page);
    page.put(format_args!("</div>\n"));
}

fn legend(page: &mut Page, plot: &Plot) {
    page.put(format_args!("<ul class=\"legend\">"));
    for (series, colour) in plot.series.iter().zip(COLOURS.iter().cycle()) {
        page.put(format_args!("<li><i style=\"background:{colour}\"></i>{}</li>", Text(&series.name)));
    }
    page.put(format_args!("</ul>\n"));
}

fn dots(page: &mut Page, places: &[[f64; 2]], colour: &str) {
    let radius = if places.len() > 80 { 2.0 } else { 3.2 };
    for [x, y] in places {
        page.put(format_args!("<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{colour}\"/>"));
    }
    page.put(format_args!("\n"));
}

fn axes(page: &mut Page, plot: &Plot, x: &Axis, y: &Axis) {
    for (value, text) in y.ticks(5) {
        let at = BASE - (BASE - TOP) * y.share(value).unwrap_or(0.0);
        svg::grid_line(page, [LEFT, RIGHT], at, 13.0, &text);
    }
    // Bars stand for whole numbers, so nothing is written between them.
    let bars = plot.series.iter().any(|s| s.mark == Mark::Bars);
    let whole = |value: f64| (value - value.round()).abs() < 1e-9;
    let ticks = x.ticks(10).into_iter().filter(|(value, _)| !bars || whole(*value));
    for (value, text) in ticks {
        let text = if bars { fixed(value, 0) } else { text };
        let at = LEFT + (RIGHT - LEFT) * x.share(value).unwrap_or(0.0);
        svg::mark_below(page, [at, BASE], 5.0, 13.0, &text);
    }
    for (value, name) in &plot.marks {
        let Some(share) = x.share(*value) else { continue };
        let at = LEFT + (RIGHT - LEFT) * share;
        // Above the diagram, so that no curve crosses the name.
        let anchor = if share > 0.9 { Anchor::End } else { Anchor::Middle };
        svg::line(page, [[at, TOP], [at, BASE]], "stroke=\"#ad1f1f\" stroke-dasharray=\"3 2\"");
        svg::styled_text(page, [at, TOP - 6.0], 12.5, anchor, "style=\"fill:#ad1f1f\"", name);
    }
    let frame = [[LEFT, TOP], [LEFT, BASE], [RIGHT, BASE]];
    svg::line(page, frame, &format!("stroke=\"{}\"", svg::INK));
    svg::text(page, [532.0, 333.0], 13.0, Anchor::Middle, &plot.x_label);
    svg::upright_text(page, [16.0, 0.5 * (TOP + BASE)], 13.0, &plot.y_label);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(log_y: bool, mark: Mark, points: Vec<(f64, f64)>) -> Sheet {
        let series = vec![Series { name: "<a>".into(), mark, points }];
        let plots = vec![Plot {
            title: "t".into(),
            x_label: "x".into(),
            y_label: "y".into(),
            log_y,
            series,
            marks: vec![(1.0, "here".into())],
            note: String::new(),
        }];
        Sheet { title: "s".into(), subtitle: String::new(), facts: Vec::new(), plots, notes: Vec::new() }
    }

    #[test]
    fn what_cannot_be_drawn_leaves_no_number_that_is_none() {
        let odd =
            [vec![], vec![(1.0, 1.0)], vec![(0.0, f64::NAN), (1.0, -3.0), (2.0, 0.0), (f64::INFINITY, 1.0)]];
        for points in odd {
            for (log_y, mark) in
                [(false, Mark::Line), (true, Mark::Dots), (true, Mark::Bars), (false, Mark::Bars)]
            {
                let html = sheet_html(&plot(log_y, mark, points.clone()));
                assert!(!html.contains("NaN") && !html.contains("inf\""), "{html}");
                assert!(html.contains("&lt;a&gt;") && !html.contains("<a>"));
            }
        }
    }

    #[test]
    fn a_decade_is_a_step_of_its_axis() {
        let axis = Axis::decades([0.002, 0.3].into_iter());
        assert_eq!((axis.low, axis.high), (-3.0, 0.0));
        assert!((axis.share(0.01).unwrap() - 1.0 / 3.0).abs() < 1e-12);
        assert_eq!(axis.ticks(9).len(), 4);
    }
}
