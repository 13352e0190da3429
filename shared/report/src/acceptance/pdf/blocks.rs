//! How each block of the report stands on paper.

use super::font::wrap;
use super::sheet::{MARGIN, Sheets, Style, WIDTH};
use crate::acceptance::blocks::{Block, Cell, Table};
use crate::acceptance::chart::{Size, chart};
use crate::acceptance::drawing::{Anchor, Tone};
use metrology::acceptance::Characteristic;

const BODY: Style = Style::new(8.0, false, Tone::Ink);
const SMALL: Style = Style::new(7.0, false, Tone::Soft);
const HEAD: Style = Style::new(7.0, true, Tone::Soft);
const GAP: f64 = 12.0;
/// Between the columns of a table.
const GUTTER: f64 = 8.0;
const CHART: Size = Size { width: (WIDTH - GAP) / 2.0, height: 118.0, letter: 6.5 };

/// Sets a block below the last one.
pub fn put(sheets: &mut Sheets, block: &Block<'_>) {
    match block {
        Block::Heading(text) => heading(sheets, text),
        Block::Text(text) => sheets.paragraph(text, MARGIN, WIDTH, BODY),
        Block::Small(text) => {
            sheets.y += 2.0;
            sheets.paragraph(text, MARGIN, WIDTH, SMALL);
            sheets.y += 4.0;
        }
        Block::Steps(steps) => {
            for (index, step) in steps.iter().enumerate() {
                sheets.paragraph(&format!("{}. {step}", index + 1), MARGIN, WIDTH, BODY);
            }
        }
        Block::Pairs(pairs) => pairs_of(sheets, pairs),
        Block::Table(block) => table(sheets, block),
        Block::Charts(all, guard_factor) => charts(sheets, all, *guard_factor),
        Block::Signatures(labels) => signatures(sheets, labels),
    }
}

fn heading(sheets: &mut Sheets, text: &str) {
    // Room for the heading and a row of charts below it.
    sheets.need(CHART.height + 30.0);
    sheets.y += 9.0;
    sheets.paragraph(text, MARGIN, WIDTH, Style::new(10.5, true, Tone::Ink));
    let y = sheets.y + 1.0;
    sheets.line([[MARGIN, y], [MARGIN + WIDTH, y]], 0.6, Tone::Line);
    sheets.y += 5.0;
}

/// A coloured field with one heavy word and lines below it.
pub fn banner(sheets: &mut Sheets, word: &str, lines: &[String], tone: Tone, ground: Tone) {
    const PAD: f64 = 8.0;
    let (big, text) = (Style::new(18.0, true, tone), Style::new(8.5, false, Tone::Ink));
    let widest = WIDTH - 2.0 * PAD - 6.0;
    let count: usize = lines.iter().map(|l| wrap(l, false, text.size, widest).len()).sum();
    let height = 2.0 * PAD + big.leading() + count as f64 * text.leading();
    sheets.need(height);
    sheets.area([MARGIN, sheets.y, WIDTH, height], ground);
    sheets.area([MARGIN, sheets.y, 6.0, height], tone);
    sheets.y += PAD;
    let x = MARGIN + PAD + 6.0;
    sheets.paragraph(word, x, widest, big);
    for line in lines {
        sheets.paragraph(line, x, widest, text);
    }
    sheets.y += PAD + 6.0;
}

/// Two columns of label and text.
fn pairs_of(sheets: &mut Sheets, pairs: &[(String, String)]) {
    let half = (WIDTH - GAP) / 2.0;
    let label_width = 0.4 * half;
    for two in pairs.chunks(2) {
        let lines: Vec<_> = two
            .iter()
            .map(|(label, text)| {
                let text = wrap(text, false, BODY.size, half - label_width);
                (wrap(label, false, BODY.size, label_width - GUTTER), text)
            })
            .collect();
        let most = lines.iter().map(|(a, b)| a.len().max(b.len())).max().unwrap_or(0);
        sheets.need(most as f64 * BODY.leading());
        for (column, (label, text)) in lines.iter().enumerate() {
            let x = MARGIN + column as f64 * (half + GAP);
            column_of(sheets, label, x, Style { tone: Tone::Soft, ..BODY });
            column_of(sheets, text, x + label_width, BODY);
        }
        sheets.y += most as f64 * BODY.leading() + 1.5;
    }
}

/// Lines below each other from the cursor, which stays.
fn column_of(sheets: &mut Sheets, lines: &[Vec<u8>], x: f64, style: Style) {
    for (index, bytes) in lines.iter().enumerate() {
        let y = sheets.y + style.size + index as f64 * style.leading();
        sheets.show(bytes, [x, y], Anchor::Start, style);
    }
}

fn charts(sheets: &mut Sheets, all: &[&Characteristic], guard_factor: f64) {
    for two in all.chunks(2) {
        sheets.need(CHART.height);
        for (column, one) in two.iter().enumerate() {
            let x = MARGIN + column as f64 * (CHART.width + GAP);
            let at = [x, sheets.y];
            sheets.drawing(&chart(one, guard_factor, CHART), at);
        }
        sheets.y += CHART.height + 6.0;
    }
}

fn signatures(sheets: &mut Sheets, labels: &[&str; 4]) {
    sheets.need(50.0);
    sheets.y += 32.0;
    let mut x = MARGIN;
    for (label, share) in labels.iter().zip([0.34, 0.12, 0.34, 0.12]) {
        let (y, end) = (sheets.y, x + share * WIDTH);
        sheets.line([[x, y], [end, y]], 0.6, Tone::Ink);
        sheets.show(label.as_bytes(), [x, y + 9.0], Anchor::Start, SMALL);
        x = end + 0.0266 * WIDTH;
    }
    sheets.y += 14.0;
}

/// Left ends and widths of the columns.
fn columns(table: &Table) -> Vec<(f64, f64)> {
    let total: f64 = table.columns.iter().map(|(_, width, _)| width).sum();
    let mut x = MARGIN;
    let place = |(_, share, _): &(String, f64, bool)| {
        let width = WIDTH * share / total;
        let left = x;
        x += width;
        (left, width - GUTTER)
    };
    table.columns.iter().map(place).collect()
}

fn table(sheets: &mut Sheets, table: &Table) {
    let columns = columns(table);
    // The head never stands alone.
    sheets.need(50.0);
    table_head(sheets, table, &columns);
    for row in &table.rows {
        let height =
            row.iter().zip(&columns).map(|(cell, (_, width))| height(cell, *width)).fold(0.0, f64::max);
        if sheets.need(height + 4.0) {
            table_head(sheets, table, &columns);
        }
        for ((cell, (left, width)), (_, _, right)) in row.iter().zip(&columns).zip(&table.columns) {
            put_cell(sheets, cell, *left, *width, *right);
        }
        sheets.y += height + 3.0;
        let y = sheets.y;
        sheets.line([[MARGIN, y], [MARGIN + WIDTH, y]], 0.4, Tone::Line);
        sheets.y += 1.0;
    }
    sheets.y += 4.0;
}

fn table_head(sheets: &mut Sheets, table: &Table, columns: &[(f64, f64)]) {
    let titles: Vec<_> = table
        .columns
        .iter()
        .zip(columns)
        .map(|((title, _, _), (_, width))| wrap(title, true, HEAD.size, *width))
        .collect();
    let most = titles.iter().map(Vec::len).max().unwrap_or(0);
    for ((lines, (left, width)), (_, _, right)) in titles.iter().zip(columns).zip(&table.columns) {
        aligned(sheets, lines, *left, *width, *right, HEAD, 0.0);
    }
    sheets.y += most as f64 * HEAD.leading() + 2.0;
    let y = sheets.y;
    sheets.line([[MARGIN, y], [MARGIN + WIDTH, y]], 0.7, Tone::Ink);
    sheets.y += 2.0;
}

fn style(cell: &Cell) -> Style {
    Style { bold: cell.bold, tone: cell.tone, ..BODY }
}

fn height(cell: &Cell, width: f64) -> f64 {
    let lines = wrap(&cell.text, cell.bold, BODY.size, width).len() as f64;
    let detail = if cell.detail.is_empty() { 0 } else { wrap(&cell.detail, false, SMALL.size, width).len() };
    lines * BODY.leading() + detail as f64 * SMALL.leading()
}

fn put_cell(sheets: &mut Sheets, cell: &Cell, left: f64, width: f64, right: bool) {
    let lines = wrap(&cell.text, cell.bold, BODY.size, width);
    aligned(sheets, &lines, left, width, right, style(cell), 0.0);
    if !cell.detail.is_empty() {
        let below = lines.len() as f64 * BODY.leading();
        let detail = wrap(&cell.detail, false, SMALL.size, width);
        aligned(sheets, &detail, left, width, right, SMALL, below);
    }
}

/// Lines in a column, left or right, from `below` the cursor, which stays.
fn aligned(
    sheets: &mut Sheets,
    lines: &[Vec<u8>],
    left: f64,
    width: f64,
    right: bool,
    style: Style,
    below: f64,
) {
    for (index, bytes) in lines.iter().enumerate() {
        let y = sheets.y + below + style.size + index as f64 * style.leading();
        let (x, anchor) = if right { (left + width, Anchor::End) } else { (left, Anchor::Start) };
        sheets.show(bytes, [x, y], anchor, style);
    }
}
