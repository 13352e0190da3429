//! Elements of drawings, as SVG: they scale, print sharply and carry real text.
//!
//! A drawing stands in a page of the report ([`open`]) or in a file of its own ([`begin_file`]). This module alone writes elements.

use std::fmt;

use super::page::{Page, Text};

/// Colour of lines and text.
pub const INK: &str = "#1f2933";

/// Which part of a text stands at its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// The text begins there.
    Start,
    /// The text is centred there.
    Middle,
    /// The text ends there.
    End,
}

impl fmt::Display for Anchor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Start => "start",
            Self::Middle => "middle",
            Self::End => "end",
        })
    }
}

/// Opens a drawing of a width and a height in drawing units; `class` is a class of the style sheet or empty, `label` states
/// what is drawn.
pub fn open(page: &mut Page, class: &str, [width, height]: [f64; 2], label: &str) {
    page.put(format_args!("<svg"));
    if !class.is_empty() {
        page.put(format_args!(" class=\"{class}\""));
    }
    page.put(format_args!(
        " viewBox=\"0 0 {width:.1} {height:.1}\" role=\"img\" aria-label=\"{}\">\n",
        Text(label)
    ));
}

/// Begins a drawing in a file of its own, with a white background and its size in px; [`end_file`] gives its text.
pub fn begin_file([width, height]: [f64; 2], font_size: f64) -> Page {
    let mut page = Page::fragment();
    page.put(format_args!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.1}\" height=\"{height:.1}\" \
         viewBox=\"0 0 {width:.1} {height:.1}\" font-family=\"sans-serif\" font-size=\"{font_size}\" fill=\"{INK}\">\n"
    ));
    rectangle(&mut page, [0.0, 0.0], [width, height], "#fff", "");
    page
}

/// Ends a drawing of [`begin_file`] and gives its text.
pub fn end_file(mut page: Page) -> String {
    close(&mut page);
    page.put(format_args!("\n"));
    page.into_text()
}

/// Closes the element `svg`.
pub fn close(page: &mut Page) {
    page.put(format_args!("</svg>"));
}

/// A text with its base line at `y`.
pub fn text(page: &mut Page, [x, y]: [f64; 2], size: f64, anchor: Anchor, text: &str) {
    styled_text(page, [x, y], size, anchor, "", text);
}

/// A text with further attributes, such as its weight.
pub fn styled_text(
    page: &mut Page,
    [x, y]: [f64; 2],
    size: f64,
    anchor: Anchor,
    attributes: &str,
    text: &str,
) {
    let space = if attributes.is_empty() { "" } else { " " };
    page.put(format_args!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{space}{attributes}>{}</text>\n",
        Text(text)
    ));
}

/// A centred text that reads upwards.
pub fn upright_text(page: &mut Page, [x, y]: [f64; 2], size: f64, text: &str) {
    let turn = format!("transform=\"rotate(-90 {x:.1} {y:.1})\"");
    styled_text(page, [x, y], size, Anchor::Middle, &turn, text);
}

/// Straight lines through points, with the attributes of the line.
pub fn line(page: &mut Page, points: impl IntoIterator<Item = [f64; 2]>, attributes: &str) {
    page.put(format_args!("<path d=\""));
    for (i, [x, y]) in points.into_iter().enumerate() {
        page.put(format_args!("{}{x:.2} {y:.2}", if i == 0 { 'M' } else { 'L' }));
    }
    page.put(format_args!("\" fill=\"none\" {attributes}/>\n"));
}

/// A filled rectangle from its upper left corner, with further attributes.
pub fn rectangle(page: &mut Page, [x, y]: [f64; 2], [width, height]: [f64; 2], fill: &str, attributes: &str) {
    begin_rectangle(page, [x, y], [width, height], fill, attributes);
    page.put(format_args!("/>"));
}

/// A filled rectangle that shows a text when the pointer rests on it.
pub fn titled_rectangle(
    page: &mut Page,
    [x, y]: [f64; 2],
    [width, height]: [f64; 2],
    fill: &str,
    attributes: &str,
    title: &str,
) {
    begin_rectangle(page, [x, y], [width, height], fill, attributes);
    page.put(format_args!("><title>{}</title></rect>\n", Text(title)));
}

fn begin_rectangle(
    page: &mut Page,
    [x, y]: [f64; 2],
    [width, height]: [f64; 2],
    fill: &str,
    attributes: &str,
) {
    let space = if attributes.is_empty() { "" } else { " " };
    page.put(format_args!(
        "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{width:.2}\" height=\"{height:.2}\" fill=\"{fill}\"{space}{attributes}"
    ));
}

/// A filled circle with further attributes.
pub fn circle(page: &mut Page, [x, y]: [f64; 2], radius: f64, fill: &str, attributes: &str) {
    let space = if attributes.is_empty() { "" } else { " " };
    page.put(format_args!(
        "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{fill}\"{space}{attributes}/>\n"
    ));
}

/// A mark below a horizontal axis with its value.
pub fn mark_below(page: &mut Page, [x, axis]: [f64; 2], length: f64, size: f64, value: &str) {
    line(page, [[x, axis], [x, axis + length]], &format!("stroke=\"{INK}\""));
    text(page, [x, axis + length + 1.15 * size], size, Anchor::Middle, value);
}

/// A horizontal line of a grid with its value at the left end.
pub fn grid_line(page: &mut Page, [left, right]: [f64; 2], y: f64, size: f64, value: &str) {
    line(page, [[left, y], [right, y]], "stroke=\"#e9edf0\"");
    text(page, [left - 0.6 * size, y + 0.35 * size], size, Anchor::End, value);
}

/// The length of a scale bar as a bracket, and its text above.
pub fn scale_bar(page: &mut Page, [left, base]: [f64; 2], length: f64, size: f64, value: &str) {
    let (high, right) = (0.35 * size, left + length);
    let bracket = [[left, base - high], [left, base], [right, base], [right, base - high]];
    line(page, bracket, &format!("stroke=\"{INK}\" stroke-width=\"{:.1}\"", 0.11 * size));
    text(page, [left, base - 0.8 * size], size, Anchor::Start, value);
}

/// The axes x, y, z of a frame, seen in directions of length 0 … 1; one seen end-on is left out.
pub fn triad(page: &mut Page, [x, y]: [f64; 2], directions: [[f64; 2]; 3], size: f64) {
    for ([right, down], name) in directions.into_iter().zip(["x", "y", "z"]) {
        if right * right + down * down > 0.01 {
            let at = |length: f64| [x + length * size * right, y + length * size * down];
            line(page, [[x, y], at(2.0)], &format!("stroke=\"{INK}\" stroke-width=\"{:.1}\"", 0.125 * size));
            let [x, y] = at(2.7);
            text(page, [x, y + 0.35 * size], size, Anchor::Middle, name);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_their_element() {
        let mut page = Page::begin("t");
        open(&mut page, "framed", [10.0, 5.0], "a \"b\"");
        text(&mut page, [1.0, 2.0], 13.0, Anchor::End, "<c>");
        upright_text(&mut page, [1.0, 2.0], 13.0, "d");
        line(&mut page, [[0.0, 0.0], [1.0, 2.5]], "stroke=\"#000\"");
        close(&mut page);
        let html = page.end();
        assert!(html.contains("viewBox=\"0 0 10.0 5.0\" role=\"img\" aria-label=\"a &quot;b&quot;\">"));
        assert!(html.contains("text-anchor=\"end\">&lt;c&gt;</text>"));
        assert!(html.contains("transform=\"rotate(-90 1.0 2.0)\">d</text>"));
        assert!(html.contains("<path d=\"M0.00 0.00L1.00 2.50\" fill=\"none\" stroke=\"#000\"/>"));
    }
}
