//! What the report of a part says, block by block, for HTML and PDF.

use super::PartInput;
use crate::acceptance::blocks::{Block, Cell, Document, Table};
use crate::acceptance::drawing::Tone;
use crate::acceptance::tone_of;
use crate::number::{NONE, decimals, fixed, limit, limit_decimals, signed};
use metrology::inspection::{ConstructedResult, ElementResult, FeatureResult};
use metrology::verdict::Verdict;

/// The report of a part.
pub fn document<'a>(input: &PartInput<'_>) -> Document<'a> {
    let result = input.result;
    let mut blocks = vec![Block::Heading("Features".into()), Block::Table(features(input))];
    blocks.push(Block::Small(format!(
        "u: standard uncertainty. A feature passes inside its limits by {} u and fails outside by as much; between, neither \
         is proven (ISO 14253-1). Lengths in mm, angles in degrees.",
        input.guard_factor
    )));
    blocks.push(Block::Heading("Where the uncertainty comes from".into()));
    blocks.push(Block::Table(shares(input)));
    let knows_calibration = result.features.iter().any(|f| f.u_calibration.is_some());
    blocks.push(Block::Small(if knows_calibration {
        "Standard uncertainties by the scatter of the points, by the calibration of the rig and the footprints of its cameras, and what the plan states \
                    besides (u_system). u is the root of the sum of their squares."
            .into()
    } else {
        "Standard uncertainties by the scatter of the points, and what the plan states for everything else (u_system). The \
                 calibration of the rig is not part of u, unless the plan states it; where neither does, u describes repeatability only."
            .into()
    }));
    blocks.push(Block::Heading("Elements".into()));
    blocks.push(Block::Table(elements(&result.elements)));
    if !result.constructed.is_empty() {
        blocks.push(Block::Heading("Elements made of others".into()));
        blocks.push(Block::Table(constructed(&result.constructed)));
    }
    blocks.push(Block::Heading("Made with".into()));
    blocks.push(Block::Pairs(input.made_with.to_vec()));
    blocks.push(Block::Signatures(["Measured by", "Date", "Approved by", "Date"]));
    Document {
        title: match input.part {
            Some(part) => format!("Measurement report: {}, part {part}", result.plan),
            None => format!("Measurement report: {}", result.plan),
        },
        wording: format!("Measured on {}", input.date),
        rule_set: format!("ISO 14253-1, guard factor {}", input.guard_factor),
        reduced: Vec::new(),
        word: result.verdict.word().to_owned(),
        class: result.verdict.key(),
        tone: tone_of(Some(result.verdict)),
        sentences: sentences(input),
        blocks,
        sha256: input.sha256.to_owned(),
    }
}

fn sentences(input: &PartInput<'_>) -> Vec<String> {
    let features = &input.result.features;
    let count = |verdict: Option<Verdict>| features.iter().filter(|f| f.verdict == verdict).count();
    let mut all = vec![format!(
        "{} features: {} pass, {} indeterminate, {} fail, {} not measured.",
        features.len(),
        count(Some(Verdict::Pass)),
        count(Some(Verdict::Indeterminate)),
        count(Some(Verdict::Fail)),
        count(None)
    )];
    all.extend(input.result.alignment_failure.iter().map(|why| format!("The part was not found: {why}")));
    all
}

/// Digits after the point that uncertainty and limits of a feature need.
pub fn digits(feature: &FeatureResult) -> usize {
    let limits = limit_decimals(feature.lower).max(limit_decimals(feature.upper));
    decimals(feature.u).max(limits).clamp(3, 6)
}

fn features(input: &PartInput<'_>) -> Table {
    let names = [
        ("Feature", 2.8, false),
        ("Value", 1.6, true),
        ("u", 1.0, true),
        ("Nominal", 1.2, true),
        ("Deviation", 1.2, true),
        ("Lower", 1.1, true),
        ("Upper", 1.1, true),
        ("Verdict", 1.9, false),
    ];
    let columns = names.map(|(name, width, right)| (name.to_owned(), width, right)).to_vec();
    let row = |f: &FeatureResult| {
        let d = digits(f);
        let number = |value: Option<f64>| value.map_or_else(|| NONE.to_owned(), |v| fixed(v, d));
        let detail = f.reason.as_deref().or(f.detail.as_deref()).unwrap_or_default();
        let verdict = f.verdict.map_or("not measured", Verdict::word);
        vec![
            Cell::plain(&f.name).with_detail(detail),
            Cell::plain(f.value.map_or_else(|| NONE.to_owned(), |v| format!("{} {}", fixed(v, d), f.unit))),
            Cell::plain(number(f.u)),
            Cell::plain(fixed(f.nominal, d)),
            Cell::plain(f.deviation.map_or_else(|| NONE.to_owned(), |v| signed(v, d))),
            Cell::plain(limit(f.lower, d)),
            Cell::plain(limit(f.upper, d)),
            Cell::bold(verdict, f.verdict.map_or(Tone::Doubt, |verdict| tone_of(Some(verdict)))),
        ]
    };
    Table { columns, rows: input.result.features.iter().map(row).collect() }
}

/// What the uncertainty of each feature is made of.
fn shares(input: &PartInput<'_>) -> Table {
    let names = [
        ("Feature", 2.8, false),
        ("Points", 1.2, true),
        ("Calibration", 1.2, true),
        ("Plan (u_system)", 1.4, true),
        ("u", 1.2, true),
        ("Unit", 0.8, false),
    ];
    let columns = names.map(|(name, width, right)| (name.to_owned(), width, right)).to_vec();
    let row = |f: &FeatureResult| {
        let d = digits(f) + 1;
        let number = |value: Option<f64>| Cell::plain(value.map_or_else(|| NONE.to_owned(), |v| fixed(v, d)));
        let parts = [f.u_noise, f.u_calibration, Some(f.u_system), f.u].map(number);
        let mut cells = vec![Cell::plain(&f.name)];
        cells.extend(parts);
        cells.push(Cell::plain(f.unit.to_string()));
        cells
    };
    Table { columns, rows: input.result.features.iter().map(row).collect() }
}

fn elements(all: &[ElementResult]) -> Table {
    let names = [
        ("Element", 1.7, false),
        ("Kind, association", 1.9, false),
        ("Point", 1.9, true),
        ("Direction", 1.9, true),
        ("Size", 1.3, true),
        ("Points", 0.8, true),
        ("Form range", 1.0, true),
        ("Form sigma", 1.0, true),
    ];
    let columns = names.map(|(name, width, right)| (name.to_owned(), width, right)).to_vec();
    let row = |e: &ElementResult| {
        let criterion = e.criterion.unwrap_or_default();
        let name = Cell::plain(&e.name).with_detail(e.reason.as_deref().unwrap_or_default());
        let Some(fit) = &e.fit else {
            let mut cells = vec![name];
            cells.resize_with(columns.len(), || Cell::plain(NONE));
            return cells;
        };
        let form = fit.form();
        vec![
            name,
            Cell::plain(fit.kind()).with_detail(&format!("{} ({})", criterion.key(), criterion.symbol())),
            Cell::plain(three(Some(fit.place().into()), 4)),
            Cell::plain(three(fit.direction(), 6)),
            Cell::plain(fit.sizes().join(", ")),
            Cell::plain(form.points.to_string()),
            Cell::plain(fixed(form.form_range_mm, 4)),
            Cell::plain(fixed(form.form_sigma_mm, 4)),
        ]
    };
    let rows = all.iter().map(row).collect();
    Table { columns, rows }
}

/// Three numbers, or none.
fn three(v: Option<[f64; 3]>, digits: usize) -> String {
    v.map_or_else(|| NONE.to_owned(), |v| v.map(|x| fixed(x, digits)).join(", "))
}

fn constructed(all: &[ConstructedResult]) -> Table {
    let names = [
        ("Element", 2.0, false),
        ("Kind", 1.2, false),
        ("Point", 2.4, true),
        ("Direction", 2.4, true),
        ("Size", 1.3, true),
    ];
    let columns = names.map(|(name, width, right)| (name.to_owned(), width, right)).to_vec();
    let row = |c: &ConstructedResult| {
        vec![
            Cell::plain(&c.name).with_detail(c.reason.as_deref().unwrap_or_default()),
            Cell::plain(c.shape.clone().unwrap_or(NONE.into())),
            Cell::plain(three(c.point_mm, 4)),
            Cell::plain(three(c.direction, 6)),
            Cell::plain(c.diameter_mm.map_or_else(String::new, |d| format!("⌀ {}", fixed(d, 4)))),
        ]
    };
    Table { columns, rows: all.iter().map(row).collect() }
}
