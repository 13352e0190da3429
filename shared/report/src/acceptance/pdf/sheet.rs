//! Sheets of A4 that fill from the top. Lengths in points (1/72 inch), y down from the upper edge.

use super::font::{encode, width, wrap};
use crate::acceptance::drawing::{Anchor, Drawing, Shape, Tone};
use pdf_writer::{Content, Name, Str};

/// Size of a sheet A4, points of 1/72 inch.
pub const PAPER: [f64; 2] = [595.0, 842.0];
/// Left and right of the text.
pub const MARGIN: f64 = 44.0;
/// Width of the text.
pub const WIDTH: f64 = PAPER[0] - 2.0 * MARGIN;
const TOP: f64 = 44.0;
const BOTTOM: f64 = PAPER[1] - 52.0;

/// Names of the fonts in the resources.
pub const REGULAR: Name<'static> = Name(b"F1");
/// Resource name of the bold font.
pub const BOLD: Name<'static> = Name(b"F2");

/// How a word looks.
#[derive(Debug, Clone, Copy)]
pub struct Style {
    /// Size of the letters, points.
    pub size: f64,
    /// Whether the letters are bold.
    pub bold: bool,
    /// Colour of the letters.
    pub tone: Tone,
}

impl Style {
    /// A style of ink.
    pub const fn new(size: f64, bold: bool, tone: Tone) -> Self {
        Self { size, bold, tone }
    }

    /// From one line to the next.
    pub fn leading(&self) -> f64 {
        1.3 * self.size
    }
}

/// All sheets, the last one open.
pub struct Sheets {
    pages: Vec<Content>,
    /// Where the next thing goes.
    pub y: f64,
}

impl Sheets {
    /// Starts with one empty sheet.
    pub fn new() -> Self {
        Self { pages: vec![Content::new()], y: TOP }
    }

    /// A new sheet where less than `height` is left; returns whether.
    pub fn need(&mut self, height: f64) -> bool {
        let full = self.y + height > BOTTOM && self.y > TOP;
        if full {
            self.pages.push(Content::new());
            self.y = TOP;
        }
        full
    }

    /// Returns the contents of all sheets.
    pub fn into_pages(self) -> Vec<Content> {
        self.pages
    }

    fn page(&mut self) -> &mut Content {
        if self.pages.is_empty() {
            self.pages.push(Content::new());
        }
        let last = self.pages.len() - 1;
        &mut self.pages[last]
    }

    /// Draws a filled rectangle.
    pub fn area(&mut self, [x, y, w, h]: [f64; 4], tone: Tone) {
        area(self.page(), [x, y, w, h], tone);
    }

    /// Draws a straight line.
    pub fn line(&mut self, ends: [[f64; 2]; 2], width: f64, tone: Tone) {
        line(self.page(), ends, width, tone);
    }

    /// Encoded text on a base line.
    pub fn show(&mut self, bytes: &[u8], at: [f64; 2], anchor: Anchor, style: Style) {
        show(self.page(), bytes, at, anchor, style);
    }

    /// A paragraph at `x`, as wide as `widest`; the cursor goes below it.
    pub fn paragraph(&mut self, text: &str, x: f64, widest: f64, style: Style) {
        for bytes in wrap(text, style.bold, style.size, widest) {
            self.need(style.leading());
            let at = [x, self.y + style.size];
            self.show(&bytes, at, Anchor::Start, style);
            self.y += style.leading();
        }
    }

    /// A drawing with its upper left corner at a point; the cursor stays.
    pub fn drawing(&mut self, drawing: &Drawing, [left, top]: [f64; 2]) {
        let page = self.page();
        let place = |[x, y]: [f64; 2]| [left + x, top + y];
        for shape in &drawing.shapes {
            match shape {
                Shape::Line { ends: [a, b], width, tone } => {
                    line(page, [place(*a), place(*b)], *width, *tone);
                }
                Shape::Area([x, y, w, h], tone) => area(page, [left + x, top + y, *w, *h], *tone),
                Shape::Dot { at, radius, tone } => dot(page, place(*at), *radius, *tone),
                Shape::Word { at, size, anchor, bold, tone, text } => {
                    show(page, &encode(text), place(*at), *anchor, Style::new(*size, *bold, *tone));
                }
            }
        }
    }
}

fn up(y: f64) -> f32 {
    (PAPER[1] - y) as f32
}

fn rgb(tone: Tone) -> [f32; 3] {
    tone.rgb().map(|byte| f32::from(byte) / 255.0)
}

fn area(page: &mut Content, [x, y, w, h]: [f64; 4], tone: Tone) {
    let [r, g, b] = rgb(tone);
    page.set_fill_rgb(r, g, b).rect(x as f32, up(y + h), w as f32, h as f32).fill_nonzero();
}

fn line(page: &mut Content, [a, b]: [[f64; 2]; 2], width: f64, tone: Tone) {
    let [red, green, blue] = rgb(tone);
    page.set_stroke_rgb(red, green, blue).set_line_width(width as f32);
    page.move_to(a[0] as f32, up(a[1])).line_to(b[0] as f32, up(b[1])).stroke();
}

/// A circle of four Bézier arcs, 0.03 % round.
fn dot(page: &mut Content, [x, y]: [f64; 2], radius: f64, tone: Tone) {
    const ARM: f64 = 0.552_284_75;
    let [r, g, b] = rgb(tone);
    page.set_fill_rgb(r, g, b);
    let corner = |dx: f64, dy: f64| ((x + radius * dx) as f32, up(y + radius * dy));
    let (x0, y0) = corner(1.0, 0.0);
    page.move_to(x0, y0);
    for ([ax, ay], [bx, by], [cx, cy]) in [
        ([1.0, ARM], [ARM, 1.0], [0.0, 1.0]),
        ([-ARM, 1.0], [-1.0, ARM], [-1.0, 0.0]),
        ([-1.0, -ARM], [-ARM, -1.0], [0.0, -1.0]),
        ([ARM, -1.0], [1.0, -ARM], [1.0, 0.0]),
    ] {
        let (a, b, c) = (corner(ax, ay), corner(bx, by), corner(cx, cy));
        page.cubic_to(a.0, a.1, b.0, b.1, c.0, c.1);
    }
    page.fill_nonzero();
}

/// Encoded text on a base line of a page.
pub fn show(page: &mut Content, bytes: &[u8], [x, y]: [f64; 2], anchor: Anchor, style: Style) {
    let length = width(bytes, style.bold, style.size);
    let x = match anchor {
        Anchor::Start => x,
        Anchor::Middle => x - length / 2.0,
        Anchor::End => x - length,
    };
    let [r, g, b] = rgb(style.tone);
    let font = if style.bold { BOLD } else { REGULAR };
    page.set_fill_rgb(r, g, b).begin_text().set_font(font, style.size as f32);
    page.next_line(x as f32, up(y)).show(Str(bytes)).end_text();
}
