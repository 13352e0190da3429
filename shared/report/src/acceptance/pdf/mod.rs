//! The report as PDF, A4: the same blocks as in HTML, with the fonts that every reader has. No clock, no random number.

mod blocks;
mod font;
mod sheet;

use super::blocks::Document;
use super::drawing::{Anchor, Tone};
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, TextStr};
use sheet::{BOLD, MARGIN, PAPER, REGULAR, Sheets, Style, WIDTH};

/// Renders the report as a PDF file.
pub fn render(document: &Document<'_>) -> Vec<u8> {
    let mut sheets = Sheets::new();
    head(&mut sheets, document);
    for block in &document.blocks {
        blocks::put(&mut sheets, block);
    }
    let mut pages = sheets.into_pages();
    let count = pages.len();
    for (index, page) in pages.iter_mut().enumerate() {
        foot(page, document, index + 1, count);
    }
    file(document, pages)
}

fn head(sheets: &mut Sheets, document: &Document<'_>) {
    sheets.paragraph(&document.title, MARGIN, WIDTH, Style::new(19.0, true, Tone::Ink));
    sheets.paragraph(&document.wording, MARGIN, WIDTH, Style::new(10.5, true, Tone::Ink));
    sheets.paragraph(&document.rule_set, MARGIN, WIDTH, Style::new(8.5, false, Tone::Soft));
    sheets.y += 6.0;
    if !document.reduced.is_empty() {
        let mut lines =
            vec!["This is no full acceptance test: it breaks conditions of its rule set.".to_owned()];
        lines.extend(document.reduced.iter().map(|line| format!("• {line}")));
        blocks::banner(sheets, "REDUCED TEST", &lines, Tone::Doubt, Tone::DoubtArea);
    }
    let ground = match document.tone {
        Tone::Pass => Tone::PassArea,
        Tone::Fail => Tone::FailArea,
        _ => Tone::DoubtArea,
    };
    blocks::banner(sheets, &document.word, &document.sentences, document.tone, ground);
}

fn foot(page: &mut Content, document: &Document<'_>, number: usize, count: usize) {
    let y = PAPER[1] - 28.0;
    let style = Style::new(7.0, false, Tone::Soft);
    let short: String = document.sha256.chars().take(16).collect();
    let left = format!("{} · {} · result SHA-256 {short}…", document.title, document.rule_set);
    let right = format!("Page {number} of {count}");
    sheet::show(page, &font::encode(&left), [MARGIN, y], Anchor::Start, style);
    sheet::show(page, &font::encode(&right), [PAPER[0] - MARGIN, y], Anchor::End, style);
    if !document.reduced.is_empty() {
        // On every page, so that no sheet taken alone looks like a full test.
        let style = Style::new(9.0, true, Tone::Doubt);
        sheet::show(page, b"REDUCED TEST", [PAPER[0] - MARGIN, 30.0], Anchor::End, style);
    }
}

fn file(document: &Document<'_>, pages: Vec<Content>) -> Vec<u8> {
    let mut pdf = Pdf::new();
    let mut next = 1;
    let mut fresh = || {
        next += 1;
        Ref::new(next - 1)
    };
    let (catalog, tree, info, regular, bold) = (fresh(), fresh(), fresh(), fresh(), fresh());
    pdf.catalog(catalog).pages(tree);
    pdf.document_info(info).title(TextStr(&document.title)).producer(TextStr("fringecell"));
    for (id, name) in [(regular, &b"Helvetica"[..]), (bold, b"Helvetica-Bold")] {
        pdf.type1_font(id).base_font(Name(name)).encoding_predefined(Name(b"WinAnsiEncoding"));
    }
    let ids: Vec<(Ref, Ref)> = pages.iter().map(|_| (fresh(), fresh())).collect();
    pdf.pages(tree).kids(ids.iter().map(|(page, _)| *page)).count(ids.len() as i32);
    for (content, (id, stream)) in pages.into_iter().zip(ids) {
        let mut page = pdf.page(id);
        page.parent(tree).contents(stream);
        page.media_box(Rect::new(0.0, 0.0, PAPER[0] as f32, PAPER[1] as f32));
        page.resources().fonts().pair(REGULAR, regular).pair(BOLD, bold);
        page.finish();
        pdf.stream(stream, &content.finish());
    }
    pdf.finish()
}
