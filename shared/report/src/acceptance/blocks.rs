//! The parts that a report consists of, before they are set as HTML or PDF.

use super::drawing::Tone;
use metrology::acceptance::Characteristic;

/// A part of the report.
pub enum Block<'a> {
    /// The heading of a section.
    Heading(String),
    /// A paragraph of running text.
    Text(String),
    /// A paragraph in small print.
    Small(String),
    /// A numbered list of steps.
    Steps(Vec<String>),
    /// A list of labels, each with its text.
    Pairs(Vec<(String, String)>),
    /// A table with its columns and cells.
    Table(Table),
    /// Charts, side by side where they fit, with the guard factor of the test.
    Charts(Vec<&'a Characteristic>, f64),
    /// Lines to sign on, each with what stands below it.
    Signatures([&'static str; 4]),
}

/// A table of the report.
pub struct Table {
    /// Title, relative width, whether numbers stand right.
    pub columns: Vec<(String, f64, bool)>,
    /// Cells; as many in each row as there are columns.
    pub rows: Vec<Vec<Cell>>,
}

/// One cell of a table.
pub struct Cell {
    /// Text of the cell.
    pub text: String,
    /// Small print below the text; may be empty.
    pub detail: String,
    /// Whether the text is bold.
    pub bold: bool,
    /// Colour of the letters.
    pub tone: Tone,
}

impl Cell {
    pub(crate) fn plain(text: impl Into<String>) -> Self {
        Self { text: text.into(), detail: String::new(), bold: false, tone: Tone::Ink }
    }

    pub(crate) fn bold(text: impl Into<String>, tone: Tone) -> Self {
        Self { bold: true, tone, ..Self::plain(text) }
    }

    pub(crate) fn with_detail(mut self, detail: &str) -> Self {
        detail.clone_into(&mut self.detail);
        self
    }
}

/// The contents of the report, for any output format.
pub struct Document<'a> {
    /// Title of the report.
    pub title: String,
    /// The statement "evaluated following …".
    pub wording: String,
    /// Rule set and edition.
    pub rule_set: String,
    /// What makes it a reduced test; empty: a full one.
    pub reduced: Vec<String>,
    /// The word of the banner.
    pub word: String,
    /// Its class in the style sheet.
    pub class: &'static str,
    /// Colour of the banner.
    pub tone: Tone,
    /// The verdict in plain words.
    pub sentences: Vec<String>,
    /// Parts of the report, in their order.
    pub blocks: Vec<Block<'a>>,
    /// SHA-256 of the master.
    pub sha256: String,
}
