//! A drawing of lines, areas, dots and words, once for SVG and PDF. Origin top left, y down.

use crate::Page;
use crate::svg;
pub use crate::svg::Anchor;

/// Colours, named by what they mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tone {
    /// Colour of text and values.
    Ink,
    /// Words beside the point.
    Soft,
    /// Colour of rules between rows.
    Line,
    /// Colour of conformity, `pass`.
    Pass,
    /// Colour of an `indeterminate` verdict.
    Doubt,
    /// Colour of non-conformity, `fail`.
    Fail,
    /// Background where values pass.
    PassArea,
    /// Background of the guard bands.
    DoubtArea,
    /// Background where values fail.
    FailArea,
}

impl Tone {
    /// Red, green and blue, 0 … 255.
    pub fn rgb(self) -> [u8; 3] {
        match self {
            Self::Ink => [0x1f, 0x29, 0x33],
            Self::Soft => [0x5b, 0x68, 0x75],
            Self::Line => [0xd5, 0xdb, 0xe1],
            Self::Pass => [0x17, 0x69, 0x3a],
            Self::Doubt => [0x8a, 0x5a, 0x00],
            Self::Fail => [0xad, 0x1f, 0x1f],
            Self::PassArea => [0xe3, 0xf3, 0xe8],
            Self::DoubtArea => [0xfb, 0xec, 0xc4],
            Self::FailArea => [0xfb, 0xe6, 0xe4],
        }
    }

    fn hex(self) -> String {
        let [r, g, b] = self.rgb();
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}

/// One element of a drawing.
#[derive(Debug, Clone)]
pub enum Shape {
    /// A straight line between two points.
    Line {
        /// Start and end point.
        ends: [[f64; 2]; 2],
        /// Width of the line.
        width: f64,
        /// Colour of the line.
        tone: Tone,
    },
    /// A filled rectangle: left, top, width, height.
    Area([f64; 4], Tone),
    /// A filled circle, for a value.
    Dot {
        /// Centre of the circle.
        at: [f64; 2],
        /// Radius of the circle.
        radius: f64,
        /// Colour of the circle.
        tone: Tone,
    },
    /// A word; the point lies on its base line.
    Word {
        /// Point on the base line.
        at: [f64; 2],
        /// Height of the letters' body.
        size: f64,
        /// Place relative to the point.
        anchor: Anchor,
        /// Whether the word is bold.
        bold: bool,
        /// Colour of the word.
        tone: Tone,
        /// The text of the word.
        text: String,
    },
}

/// Shapes on a sheet, painted in their order.
#[derive(Debug, Clone)]
pub struct Drawing {
    /// Width of the sheet.
    pub width: f64,
    /// Height of the sheet.
    pub height: f64,
    /// What is on it.
    pub shapes: Vec<Shape>,
    /// What it shows, for who cannot see it.
    pub label: String,
}

impl Drawing {
    /// As an element of an HTML page.
    pub fn svg(&self) -> String {
        let mut page = Page::fragment();
        svg::open(&mut page, "", [self.width, self.height], &self.label);
        self.shapes.iter().for_each(|shape| element(&mut page, shape));
        svg::end_file(page)
    }
}

fn element(page: &mut Page, shape: &Shape) {
    match shape {
        Shape::Line { ends, width, tone } => {
            svg::line(page, *ends, &format!("stroke=\"{}\" stroke-width=\"{width}\"", tone.hex()));
        }
        Shape::Area([x, y, w, h], tone) => svg::rectangle(page, [*x, *y], [*w, *h], &tone.hex(), ""),
        Shape::Dot { at, radius, tone } => {
            svg::circle(page, *at, *radius, &tone.hex(), "stroke=\"#fff\" stroke-width=\"0.6\"");
        }
        Shape::Word { at, size, anchor, bold, tone, text } => {
            let weight = if *bold { "font-weight=\"600\" " } else { "" };
            let style = format!("{weight}style=\"fill:{}\"", tone.hex());
            svg::styled_text(page, *at, *size, *anchor, &style, text);
        }
    }
}
