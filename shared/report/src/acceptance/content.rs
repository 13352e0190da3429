//! What the report states, block by block, before it is set as HTML or PDF.

use super::blocks::{Block, Cell, Document, Table};
use super::chart::{numbers, tone_of};
use super::drawing::Tone;
use super::groups::of_same_positions;
use super::words::{
    differing_limits, digits, judgement, limit_text, sentences, verdict_key, verdict_word, worst_position,
};
use crate::number::{NONE, count, fixed, limit, limit_decimals, optional, signed};
use metrology::acceptance::{Characteristic, Input, PositionValue, TestReport, Volume};
use metrology::verdict::Verdict;

/// Everything that the report states.
pub fn document<'a>(report: &'a TestReport, sha256: &str) -> Document<'a> {
    let set = &report.rule_set;
    let reduced = reduced(report);
    let title =
        if reduced.is_empty() { "Acceptance test report" } else { "Acceptance test report: reduced test" };
    let word = verdict_word(Some(report.verdict));
    let word = match (reduced.is_empty(), report.simulated) {
        (true, false) => word.to_owned(),
        (false, false) => format!("{word} (reduced test)"),
        (true, true) => format!("{word} (simulated)"),
        (false, true) => format!("{word} (reduced test, simulated)"),
    };
    let mut blocks = characteristics(report);
    charts(&mut blocks, report);
    conditions(&mut blocks, report);
    artefacts(&mut blocks, report);
    signatures(&mut blocks);
    positions(&mut blocks, report);
    inputs(&mut blocks, report);
    assumed(&mut blocks, report);
    repeat(&mut blocks, report, sha256);
    Document {
        title: title.to_owned(),
        wording: capital(&set.wording),
        rule_set: format!("{}; rule set {}, edition {}", set.standard, set.id, set.edition),
        reduced,
        word,
        class: verdict_key(Some(report.verdict)),
        tone: tone_of(Some(report.verdict)),
        sentences: sentences(report),
        blocks,
        sha256: sha256.to_owned(),
    }
}

fn capital(text: &str) -> String {
    let mut signs = text.chars();
    signs.next().map_or_else(String::new, |first| first.to_uppercase().chain(signs).collect())
}

/// What makes a test a reduced one, a line each: texts that begin with the name of their rule hold its numbers.
fn reduced(report: &TestReport) -> Vec<String> {
    let number = |v: f64| fixed(v, limit_decimals(Some(v)).min(4));
    let line = |v: &metrology::acceptance::Violation| {
        // What is missing has no number.
        let whole = v.text.starts_with(&v.rule) || (v.actual == 0.0 && v.required == 1.0);
        if whole {
            return v.text.clone();
        }
        format!(
            "{}: required {} {unit}, this test {} {unit}. {}",
            v.rule,
            number(v.required),
            number(v.actual),
            v.text,
            unit = v.unit
        )
    };
    report.reduced.iter().map(line).collect()
}

fn column(title: &str, width: f64, right: bool) -> (String, f64, bool) {
    (title.to_owned(), width, right)
}

fn characteristics(report: &TestReport) -> Vec<Block<'_>> {
    let columns = vec![
        column("Symbol", 1.55, false),
        column("Definition", 2.8, false),
        column("Worst value, mm", 1.0, true),
        column("At position", 1.25, false),
        column("MPE, mm", 0.9, true),
        column("U (k = 2), mm", 0.85, true),
        column("Verdict", 1.6, false),
    ];
    let row = |one: &Characteristic| {
        vec![
            Cell::bold(&one.symbol, Tone::Ink),
            Cell::plain(&one.name).with_detail(&one.definition),
            Cell::bold(signed(one.value, digits(one)), Tone::Ink),
            Cell::plain(worst_position(one)),
            Cell::plain(limit_text(one)).with_detail(if differs(one) { "there" } else { "" }),
            Cell::plain(optional(one.test_value_u, digits(one))),
            Cell::bold(judgement(one), tone_of(one.verdict)),
        ]
    };
    let mut rows: Vec<_> = report.characteristics.iter().map(row).collect();
    let forms = report.characteristics.iter().rposition(|one| one.symbol.starts_with("PF"));
    rows.insert(forms.map_or(rows.len(), |last| last + 1), resolution(report));
    vec![
        Block::Heading("Characteristics".to_owned()),
        Block::Table(Table { columns, rows }),
        Block::Small(
            "Worst value: the one farthest from zero over all positions, with its sign; it decides, never a mean. MPE: maximum \
             permissible error, for the absolute value. U: expanded uncertainty of the test value (k = 2), from the artefact \
             and its use; it is no measure of the system's performance."
                .to_owned(),
        ),
    ]
}

/// The row beside the probing form: a form is bought with detail wherever points are smoothed.
fn resolution(report: &TestReport) -> Vec<Cell> {
    let stated = report.lateral_resolution.as_ref();
    let definition = stated.map_or_else(
        || "not stated; a form error without it does not tell how much was smoothed".to_owned(),
        |found| format!("10 to 90 % of a straight step; {}", found.source),
    );
    let length = |mm: Option<f64>| mm.map_or_else(|| NONE.to_owned(), |mm| fixed(mm, 2));
    let of = |mm: Option<f64>, what: &str| mm.map(|mm| format!("{} {what}", fixed(mm, 2)));
    let across = of(stated.and_then(|found| found.step_across_mm), "across the base, step of 1 mm");
    let hidden = of(stated.and_then(|found| found.hidden_step_mm), "of a step within the noise");
    let others: Vec<String> = across.into_iter().chain(hidden).collect();
    vec![
        Cell::plain("Resolution"),
        Cell::plain("lateral resolution").with_detail(&definition),
        Cell::bold(length(stated.map(|found| found.step_mm)), Tone::Ink).with_detail(&others.join("; ")),
        Cell::plain(""),
        Cell::plain(NONE),
        Cell::plain(NONE),
        Cell::plain(""),
    ]
}

fn charts<'a>(blocks: &mut Vec<Block<'a>>, report: &'a TestReport) {
    let shown = |c: &&Characteristic| !c.positions.is_empty() && (c.decides || c.limit.is_some());
    let charts: Vec<_> = report.characteristics.iter().filter(shown).collect();
    if charts.is_empty() {
        return;
    }
    blocks.push(Block::Heading("All positions".to_owned()));
    blocks.push(Block::Charts(charts, report.guard_factor));
    blocks.push(Block::Small(
        "Red lines: MPE. Green: conformity is proven; amber: within the guard band of the limit, where neither is; red: beyond. The \
         guard band is the one that decides, the guard factor times the standard uncertainty of each test value. Repeats of a \
         position stand side by side. Names of the positions: table of values."
            .to_owned(),
    ));
}

fn conditions(blocks: &mut Vec<Block<'_>>, report: &TestReport) {
    blocks.push(Block::Heading("Measuring volumes and conditions".to_owned()));
    let mut pairs = vec![
        ("Sensor measuring volume (one view)".to_owned(), volume(&report.sensor_volume)),
        ("Total measuring volume (all views)".to_owned(), volume(&report.total_volume)),
        ("Guard factor".to_owned(), guard(report.guard_factor)),
    ];
    pairs.extend(report.conditions.iter().map(|(label, text)| (capital(label), text.clone())));
    blocks.push(Block::Pairs(pairs));
}

fn guard(factor: f64) -> String {
    if factor == 0.0 {
        return "0: simple acceptance, as agreed".to_owned();
    }
    format!("{factor} times the standard uncertainty (U / 2) of each test value")
}

fn volume(volume: &Volume) -> String {
    let [x, y, z] = volume.size_mm.map(|edge| fixed(edge, usize::from(edge.fract() != 0.0)));
    format!("{x} × {y} × {z} mm, body diagonal {} mm", fixed(volume.body_diagonal_mm, 1))
}

fn artefacts(blocks: &mut Vec<Block<'_>>, report: &TestReport) {
    blocks.push(Block::Heading("Artefacts and certificates".to_owned()));
    let columns = vec![
        column("Artefact", 1.4, false),
        column("Kind", 1.0, false),
        column("Certificate", 2.0, false),
        column("Calibrated", 1.8, false),
        column("Value, mm", 1.2, true),
        column("u (k = 1), mm", 1.2, true),
    ];
    let mut rows = Vec::new();
    for artefact in &report.artefacts {
        let none = [(NONE.to_owned(), f64::NAN, None)];
        let values = if artefact.values.is_empty() { &none[..] } else { &artefact.values[..] };
        for (index, (name, value, u)) in values.iter().enumerate() {
            let first = |text: &str| Cell::plain(if index == 0 { text } else { "" });
            let digits = |v: f64| limit_decimals(Some(v)).max(4);
            rows.push(vec![
                first(&artefact.id),
                first(&artefact.kind),
                first(if artefact.certificate.trim().is_empty() {
                    "none given"
                } else {
                    &artefact.certificate
                })
                .with_detail(if index == 0 { &artefact.validity } else { "" }),
                Cell::plain(name),
                Cell::plain(fixed(*value, digits(*value))),
                Cell::plain(optional(*u, u.map_or(0, digits))),
            ]);
        }
    }
    if rows.is_empty() {
        blocks.push(Block::Text("No artefact is named: the values are not traceable.".to_owned()));
    } else {
        blocks.push(Block::Table(Table { columns, rows }));
    }
}

fn signatures(blocks: &mut Vec<Block<'_>>) {
    blocks.push(Block::Heading("Signatures".to_owned()));
    blocks.push(Block::Signatures(["Tested by", "Date", "Accepted by", "Date"]));
    blocks.push(Block::Small(
        "This is a test report of the operator and no calibration certificate; it does not claim certification to a standard."
            .to_owned(),
    ));
}

fn positions(blocks: &mut Vec<Block<'_>>, report: &TestReport) {
    let groups = of_same_positions(&report.characteristics);
    if groups.is_empty() {
        return;
    }
    blocks.push(Block::Heading("Values at each position".to_owned()));
    for group in groups {
        blocks.push(Block::Table(values(&group)));
        blocks.extend(scatter(&group).map(Block::Small));
    }
}

fn values(group: &[&Characteristic]) -> Table {
    let mut columns =
        vec![column("No.", 0.45, true), column("Position", 1.5, false), column("Repeat", 0.65, true)];
    columns.extend(group.iter().map(|one| column(&format!("{}, mm", one.symbol), 1.15, true)));
    columns.extend([
        column("Points", 0.85, true),
        column("Left out", 0.75, true),
        column("Excluded by plan", 0.8, true),
        column("Views", 1.4, false),
    ]);
    let Some(first) = group.first() else { return Table { columns, rows: Vec::new() } };
    let numbers = numbers(first);
    let row = |(index, position): (usize, &PositionValue)| {
        let mut row = vec![
            Cell::plain(numbers.get(index).map_or_else(String::new, ToString::to_string)),
            Cell::plain(&position.position),
            Cell::plain(position.repeat.to_string()).with_detail(if position.replaced {
                "replaced by a retest"
            } else {
                ""
            }),
        ];
        row.extend(group.iter().filter_map(|one| one.positions.get(index).map(|p| cell(one, p))));
        row.push(Cell::plain(count(position.points as u64)));
        row.push(Cell::plain(count(position.rejected as u64)));
        row.push(Cell::plain(count(position.excluded as u64)));
        row.push(Cell::plain(position.views.join(", ")));
        row
    };
    Table { columns, rows: first.positions.iter().enumerate().map(row).collect() }
}

/// Whether each length has its own limit.
fn differs(one: &Characteristic) -> bool {
    differing_limits(one).is_some()
}

/// A value with its own uncertainty, limit where it differs, and verdict; the worst value is heavy.
fn cell(one: &Characteristic, position: &PositionValue) -> Cell {
    let digits = digits(one);
    let mut details = Vec::new();
    if let Some(own) = position.limit.filter(|_| differs(one)) {
        details.push(format!("MPE ±{}", limit(Some(own), digits)));
    }
    details.extend(position.test_value_u.map(|u| format!("U {}", fixed(u, digits))));
    details.extend(position.verdict.map(|verdict| verdict_key(Some(verdict)).to_owned()));
    let tone = match position.verdict {
        None | Some(Verdict::Pass) => Tone::Ink,
        verdict => tone_of(verdict),
    };
    let bold = position.value == one.value && !position.replaced;
    Cell { text: signed(position.value, digits), detail: details.join(", "), bold, tone }
}

fn scatter(group: &[&Characteristic]) -> Option<String> {
    let known = |one: &&&Characteristic| one.repeatability.is_some() || one.between_positions.is_some();
    let text = |one: &&Characteristic| {
        format!(
            "{} {} and {}",
            one.symbol,
            optional(one.repeatability, digits(one)),
            optional(one.between_positions, digits(one))
        )
    };
    let list: Vec<_> = group.iter().filter(known).map(text).collect();
    (!list.is_empty()).then(|| {
        format!(
            "Standard deviation of repeats within positions and of the means of positions, mm: {}.",
            list.join("; ")
        )
    })
}

fn inputs(blocks: &mut Vec<Block<'_>>, report: &TestReport) {
    if report.inputs.is_empty() {
        return;
    }
    blocks.push(Block::Heading("Recordings and clouds".to_owned()));
    let columns = vec![
        column("Position", 1.2, false),
        column("Repeat", 0.5, true),
        column("View", 0.9, false),
        column("File or folder", 1.8, false),
        column("SHA-256", 3.4, false),
    ];
    let row = |input: &Input| {
        vec![
            Cell::plain(&input.position),
            Cell::plain(input.repeat.to_string()),
            Cell::plain(&input.view),
            Cell::plain(&input.source),
            Cell::plain(&input.sha256),
        ]
    };
    let rows = report.inputs.iter().map(row).collect();
    blocks.push(Block::Table(Table { columns, rows }));
}

fn assumed(blocks: &mut Vec<Block<'_>>, report: &TestReport) {
    if !report.rule_set.assumed.is_empty() {
        blocks.push(Block::Heading("Assumed values of the rule set".to_owned()));
        blocks.push(Block::Small(format!(
            "No text of the standard confirmed these; agree on them before signing: {}.",
            report.rule_set.assumed.join("; ")
        )));
    }
}

fn repeat(blocks: &mut Vec<Block<'_>>, report: &TestReport, sha256: &str) {
    let names: Vec<_> = report.artefacts.iter().map(|a| format!("{} ({})", a.id, a.certificate)).collect();
    let set = &report.rule_set;
    blocks.push(Block::Heading("How to repeat this test".to_owned()));
    blocks.push(Block::Steps(vec![
        format!("Calibrate the artefacts or take calibrated ones: {}.", names.join(", ")),
        "Bring the system to the conditions above: same operating mode, warm-up, temperature and rig file.".to_owned(),
        "Record the artefacts at the positions and views of the tables above, with as many repeats.".to_owned(),
        format!(
            "Evaluate with fringetool vdi2634 PLAN --json RESULT.json and the rule set {} of edition {}.",
            set.id, set.edition
        ),
        "Write this report again with fringetool report RESULT.json --html REPORT.html --pdf REPORT.pdf; the same result gives \
         the same bytes."
            .to_owned(),
    ]));
    blocks.push(Block::Small(format!("SHA-256 of the result this report comes from: {sha256}")));
}
