//! The report as one HTML file.

use super::blocks::{Block, Cell, Document, Table};
use super::chart::{Size, chart};
use super::drawing::Tone;
use crate::page::{Page, Text};

/// Size of the charts in the HTML report.
const CHART: Size = Size { width: 540.0, height: 250.0, letter: 12.0 };

/// Renders the report as one HTML page.
pub fn render(document: &Document<'_>) -> String {
    let mut page = Page::begin(&format!("{} – {}", document.title, document.word));
    head(&mut page, document);
    let mut open = false;
    for block in &document.blocks {
        if let Block::Heading(heading) = block {
            if open {
                page.end_section();
            }
            open = true;
            page.section(heading);
        } else {
            body(&mut page, block);
        }
    }
    if open {
        page.end_section();
    }
    page.end()
}

fn head(page: &mut Page, document: &Document<'_>) {
    page.put(format_args!("<header>\n<h1>{}</h1>\n", Text(&document.title)));
    page.put(format_args!(
        "<p class=\"sub\"><b>{}</b><br>{}</p>\n</header>\n",
        Text(&document.wording),
        Text(&document.rule_set)
    ));
    if !document.reduced.is_empty() {
        page.put(format_args!(
            "<div class=\"reduced\" role=\"alert\"><strong>REDUCED TEST</strong>\n<p>This is no full acceptance test: it \
             breaks conditions of its rule set.</p>\n<ul>\n"
        ));
        for line in &document.reduced {
            page.put(format_args!("<li>{}</li>\n", Text(line)));
        }
        page.put(format_args!("</ul></div>\n"));
    }
    page.put(format_args!(
        "<div class=\"verdict {}\"><span class=\"word\">{}</span><div>\n",
        document.class,
        Text(&document.word)
    ));
    for sentence in &document.sentences {
        page.put(format_args!("<p>{}</p>\n", Text(sentence)));
    }
    page.put(format_args!("</div></div>\n"));
}

fn body(page: &mut Page, block: &Block<'_>) {
    match block {
        Block::Heading(_) => {}
        Block::Text(text) => page.put(format_args!("<p>{}</p>\n", Text(text))),
        Block::Small(text) => page.small(text),
        Block::Steps(steps) => {
            page.put(format_args!("<ol>\n"));
            for step in steps {
                page.put(format_args!("<li>{}</li>\n", Text(step)));
            }
            page.put(format_args!("</ol>\n"));
        }
        Block::Pairs(pairs) => {
            page.put(format_args!("<dl class=\"meta\">\n"));
            for (label, text) in pairs {
                page.put(format_args!("<div><dt>{}</dt><dd>{}</dd></div>\n", Text(label), Text(text)));
            }
            page.put(format_args!("</dl>\n"));
        }
        Block::Table(block) => table(page, block),
        Block::Charts(all, guard_factor) => {
            page.put(format_args!("<div class=\"pictures wide\">\n"));
            for one in all {
                page.put(format_args!("<figure>{}</figure>\n", chart(one, *guard_factor, CHART).svg()));
            }
            page.put(format_args!("</div>\n"));
        }
        Block::Signatures(labels) => {
            page.put(format_args!("<div class=\"signatures\">\n"));
            for label in labels {
                page.put(format_args!("<div>{}</div>\n", Text(label)));
            }
            page.put(format_args!("</div>\n"));
        }
    }
}

fn table(page: &mut Page, table: &Table) {
    page.put(format_args!("<div class=\"scroll\"><table>\n<thead><tr>"));
    for (title, _, right) in &table.columns {
        let class = if *right { " class=\"n\"" } else { "" };
        page.put(format_args!("<th{class}>{}</th>", Text(title)));
    }
    page.put(format_args!("</tr></thead>\n<tbody>\n"));
    for row in &table.rows {
        page.put(format_args!("<tr>"));
        for (cell, (_, _, right)) in row.iter().zip(&table.columns) {
            put_cell(page, cell, *right);
        }
        page.put(format_args!("</tr>\n"));
    }
    page.put(format_args!("</tbody></table></div>\n"));
}

fn put_cell(page: &mut Page, cell: &Cell, right: bool) {
    let class = match cell.tone {
        Tone::Pass => "pass",
        Tone::Doubt => "indeterminate",
        Tone::Fail => "fail",
        _ => "",
    };
    let n = if right { "n " } else { "" };
    page.put(format_args!("<td class=\"{n}{class}\">"));
    let (open, close) = if cell.bold { ("<b class=\"mark\">", "</b>") } else { ("", "") };
    page.put(format_args!("{open}{}{close}", Text(&cell.text)));
    if !cell.detail.is_empty() {
        page.put(format_args!("<span class=\"detail\">{}</span>", Text(&cell.detail)));
    }
    page.put(format_args!("</td>"));
}
