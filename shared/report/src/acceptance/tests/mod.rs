//! A full test that fails, a reduced one, hostile words, and what must be refused.

mod documents;
mod samples;

use super::*;
use metrology::acceptance::RuleSetId;
use metrology::verdict::Verdict;
use samples::*;

#[test]
fn the_master_comes_back_digit_by_digit_and_gives_the_same_bytes_of_all_formats() {
    let dir = tempfile::tempdir().unwrap();
    let place = |name: &str| dir.path().join(name);
    let write = |report: &TestReport, run: &str| {
        let path = |kind: &str| place(&format!("{run}.{kind}"));
        let paths = ["html", "pdf", "csv", "qif", "dfq"].map(path);
        let [html, pdf, csv, qif, dfq] = paths.each_ref().map(|p| Some(p.as_path()));
        write_all(report, &Outputs { formats: Formats { html, pdf, csv, qif, dfq }, ..Outputs::default() })
            .unwrap();
        paths.map(|p| std::fs::read(p).unwrap())
    };
    for (name, report) in [("full", report()), ("reduced", reduced()), ("hostile", hostile())] {
        let master = place(&format!("{name}.json"));
        write_master(&master, &report).unwrap();
        let back = read_master(&master).unwrap();
        assert_eq!(back, report);
        assert_eq!(write(&report, name), write(&back, &format!("{name}-again")));
        if let Some(keep) = std::env::var_os("KEEP_REPORTS") {
            for kind in ["html", "pdf", "csv", "qif", "dfq"] {
                let file = format!("{name}.{kind}");
                std::fs::copy(place(&file), Path::new(&keep).join(file)).unwrap();
            }
            std::fs::copy(&master, Path::new(&keep).join(format!("{name}.json"))).unwrap();
        }
    }
}

/// A form error is read beside what was smoothed for it; where nobody states that, the report does.
#[test]
fn the_lateral_resolution_stands_below_the_probing_form() {
    let row = |report: &TestReport| {
        let document = content::document(report, "");
        let Some(blocks::Block::Table(table)) = document.blocks.get(1) else { unreachable!("a table") };
        let at = |symbol: &str| table.rows.iter().position(|row| row[0].text == symbol).unwrap();
        assert_eq!(at("Resolution"), at("PF_sigma") + 1);
        let cells = &table.rows[at("Resolution")];
        (cells[1].detail.clone(), cells[2].text.clone(), cells[2].detail.clone())
    };
    let mut report = report();
    let (definition, step, others) = row(&report);
    let stated = "0.46 across the base, step of 1 mm; 0.46 of a step within the noise";
    assert_eq!((step.as_str(), others.as_str()), ("0.36", stated));
    assert!(definition.contains("computed"), "{definition}");
    report.lateral_resolution = None;
    assert!(row(&report).0.starts_with("not stated"));
}

#[test]
fn a_standard_without_edition_is_refused() {
    let refused = |change: &dyn Fn(&mut RuleSetId), key: &str| {
        let mut report = report();
        change(&mut report.rule_set);
        let error = check(&report).unwrap_err().to_string();
        assert!(error.starts_with(&format!("rule_set.{key}: ")), "{error}");
        assert!(write_all(&report, &Outputs::default()).is_err());
        assert!(master_text(&report).is_err());
    };
    refused(&|set| set.edition.clear(), "edition");
    refused(&|set| set.edition = " – ".into(), "edition");
    refused(&|set| set.id.clear(), "id");
    refused(&|set| set.wording = "evaluated following VDI/VDE 2634 part 3".into(), "wording");
    refused(&|set| set.wording = "certified to VDI/VDE 2634 part 3, edition 2008-12".into(), "wording");
}

#[test]
fn what_the_numbers_do_not_bear_is_refused() {
    let refused = |change: &dyn Fn(&mut TestReport), words: &str| {
        let mut report = report();
        change(&mut report);
        let error = check(&report).unwrap_err().to_string();
        assert!(error.contains(words) && !error.contains('\n'), "{error}");
    };
    refused(&|r| r.characteristics.clear(), "there is none");
    refused(&|r| r.characteristics[0].value = f64::NAN, "\"PF_range\" value: value NaN");
    refused(&|r| r.characteristics[1].positions[1].value = f64::INFINITY, "\"sphere-2\"");
    refused(&|r| r.characteristics[0].test_value_u = Some(-1.0), "0 or above");
    refused(&|r| r.characteristics[0].unit = "m\n".into(), "\"m\\n\"");
    refused(&|r| r.total_volume.size_mm[1] = f64::NAN, "total_volume");
    refused(&|r| r.artefacts[0].values[0].1 = f64::NAN, "sphere-20");
    refused(
        &|r| r.verdict = Verdict::Pass,
        "the test is stated as pass although its characteristics give fail",
    );
    refused(&|r| r.verdict = Verdict::Indeterminate, "its characteristics give fail");
    // PS lies within the guard band of its limit: nothing is proven, whatever the master states.
    refused(&|r| r.characteristics[2].verdict = Some(Verdict::Pass), "its positions give indeterminate");
    refused(
        &|r| r.characteristics[2].positions[2].verdict = Some(Verdict::Pass),
        "\"sphere-3\" is stated as pass",
    );
    refused(&|r| r.characteristics[2].positions[2].test_value_u = Some(1e-6), "no position has them");
    refused(&|r| r.guard_factor = 0.0, "guard factor 0 give pass");
    refused(&|r| r.guard_factor = -1.0, "guard_factor");
    refused(&|r| r.characteristics[3].positions[2].replaced = true, "no position has them");
    refused(&|r| r.characteristics[2].value = 0.001, "\"sphere-1\" has -0.0121 mm");
    refused(&|r| r.characteristics[3].verdict = Some(Verdict::Pass), "its positions give fail");
    refused(&|r| r.characteristics[1].verdict = Some(Verdict::Fail), "its positions give none");
}

#[test]
fn foreign_and_damaged_masters_are_told_on_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r.json");
    let text = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let error = read_master(&path).unwrap_err();
        let source = std::error::Error::source(&error).map_or_else(String::new, ToString::to_string);
        let line = format!("{error}: {source}");
        assert!(line.contains("r.json") && !line.contains('\n'), "{line}");
        line
    };
    assert!(text("{").contains("EOF"));
    assert!(text("[1]").contains("r.json"));
    assert!(
        text("{\"format\": \"fringecell-uncertainty/1\"}").contains("expected \"fringecell-acceptance/1\"")
    );
    assert!(text("{}").contains("format is \"\""));
    let master = master_text(&report()).unwrap();
    assert!(text(&master.replace("\"value\": 0.0341,", "\"value\": null,")).contains("null"));
    assert!(text(&master.replace("2008-12\",", "\",")).contains("edition"));
}

#[test]
fn html_says_verdict_and_reduction_first_and_lets_no_text_out_of_its_place() {
    let html = |report: &TestReport| html::render(&content::document(report, "00"));
    let page = html(&report());
    let at = |page: &str, what: &str| page.find(what).unwrap_or_else(|| panic!("{what}"));
    assert!(at(&page, ">FAIL<") < at(&page, "<h2>"));
    assert!(
        page.contains("Beyond the limit, 1 of 3 characteristics: SD +0.0412 mm at bar-3, limit ±0.0300 mm.")
    );
    assert!(page.contains("edition 2008-12") && !page.contains("REDUCED"));
    let page = html(&hostile());
    assert!(at(&page, "REDUCED TEST") < at(&page, ">FAIL (reduced test)<"));
    assert!(page.contains("required 145 mm, this test 120.055 mm"));
    let mut told = reduced();
    told.reduced[0].text = "ball bar length: 120.055 mm for bar, at least 145.000 mm".into();
    assert_eq!(html(&told).matches("ball bar length").count(), 1, "a broken rule is said once");
    assert!(!page.contains("<b>&\"x'") && !page.contains('\u{1b}') && !page.contains("<script"));
    assert!(!page.contains("://"), "needs nothing from elsewhere");
}

#[test]
fn csv_keeps_one_line_a_value_whatever_the_names() {
    let report = hostile();
    let text = csv::render(&report);
    let values: usize = report.characteristics.iter().map(|c| c.positions.len()).sum();
    assert_eq!(text.matches('\n').count(), values + 1);
    assert!(text.contains("\"'=cmd()\""), "{text}");
    let text = csv::render(&super::tests::report());
    let row = text.lines().find(|line| line.contains("bar-3")).unwrap();
    assert_eq!(
        row,
        "own-3,VDI/VDE 2634 part 3,2008-12,full,fail,SD,sphere spacing error,true,bar-3,1,v1,0.0412,48213,144,true,\
         0.03,0.0021,fail,,0,2,false"
    );
    assert_eq!(row.split(',').count(), text.lines().next().unwrap().split(',').count());
}

#[test]
fn dfq_is_ascii_with_one_field_a_line() {
    let text = dfq::render(&report());
    for line in [
        "K0100 4",
        "K1001 own-3",
        "K2002/3 PS probing size error",
        "K2110/3 -0.03",
        "K2111/3 0.03",
        "K2142/3 mm",
        "K0001/3 -0.0291",
        "K0009/3 sphere-3 repeat 1",
    ] {
        assert!(text.split("\r\n").any(|l| l == line), "{line}\n{text}");
    }
    assert!(!text.contains("K2111/2"), "no limit, no field");
    let text = dfq::render(&hostile());
    assert!(text.is_ascii() && text.contains("REDUCED TEST"));
    assert!(text.split("\r\n").filter(|l| !l.is_empty()).all(|l| l.starts_with('K') && !l.contains('\n')));
    assert_eq!(text.split("\r\n").filter(|l| l.starts_with("K0100")).count(), 1);
}

/// Two lengths, each with its own limit; the shorter takes up more of it.
fn two_lengths() -> TestReport {
    let mut report = report();
    let one = &mut report.characteristics[3];
    one.positions.truncate(2);
    for (position, (length, limit, value)) in
        one.positions.iter_mut().zip([(50.0, 0.0175, 0.014), (150.0, 0.0225, -0.016)])
    {
        (position.length_mm, position.limit, position.value) = (Some(length), Some(limit), value);
    }
    (one.value, one.limit) = (0.014, Some(0.0175));
    decide(one);
    report.verdict = Verdict::Indeterminate;
    report
}

/// Transfer formats hold one limit a characteristic: one that differs with the length is left out of the fields and noted.
#[test]
fn limits_that_differ_with_the_length_stand_beside_their_values_only() {
    let report = two_lengths();
    check(&report).unwrap();
    let one = &report.characteristics[3];
    let chart = chart::chart(one, GUARD, chart::Size { width: 540.0, height: 250.0, letter: 12.0 });
    let limits = |s: &&drawing::Shape| matches!(s, drawing::Shape::Line { tone: drawing::Tone::Fail, .. });
    assert_eq!(chart.shapes.iter().filter(limits).count(), 4, "two on either side");
    let rows = csv::render(&report);
    assert!(
        rows.contains(",0.014,48211,144,true,0.0175,") && rows.contains(",-0.016,48212,144,false,0.0225,")
    );
    let text = dfq::render(&report);
    assert!(text.contains("K2111/3 0.03") && !text.contains("K2110/4") && !text.contains("K2111/4"));
    assert!(text.contains("K2900/4 MPE grows with the length"), "{text}");
    let text = String::from_utf8(qif::render(&report, &"ab".repeat(32))).unwrap();
    assert!(!text.contains("0.0175</M") && !text.contains("0.0225</M"));
    assert!(text.contains("MPE grows with the length, ±0.0175 mm at the worst value"), "{text}");
    let mut refused = two_lengths();
    refused.characteristics[3].positions[1].limit = Some(f64::NAN);
    assert!(check(&refused).unwrap_err().to_string().contains("\"bar-2\" limit"));
}

#[test]
fn pdf_is_complete_and_every_page_of_a_reduced_test_says_so() {
    let pdf = |report: &TestReport| pdf::render(&content::document(report, &"ab".repeat(32)));
    let count = |bytes: &[u8], what: &[u8]| bytes.windows(what.len()).filter(|w| *w == what).count();
    let full = pdf(&report());
    assert!(full.starts_with(b"%PDF-1.7") && full.ends_with(b"%%EOF\n") || full.ends_with(b"%%EOF"));
    let pages = count(&full, b"/MediaBox");
    assert!((1..=3).contains(&pages), "{pages} pages");
    assert_eq!(count(&full, b"(REDUCED TEST)"), 0);
    let marked = pdf(&hostile());
    assert!(count(&marked, b"(REDUCED TEST)") > count(&marked, b"/MediaBox"));
    assert!(!full.windows(12).any(|w| w == b"CreationDate"));
}

/// The band was U wide, whatever the guard factor that decided.
#[test]
fn the_band_of_a_chart_is_the_guard_band_that_decides() {
    let report = report();
    for (guard_factor, guard_mm) in [(2.0, U_MM), (1.65, 0.825 * U_MM), (0.0, 0.0)] {
        let size = chart::Size { width: 540.0, height: 250.0, letter: 12.0 };
        let drawing = chart::chart(&report.characteristics[3], guard_factor, size);
        let height = |wanted: drawing::Tone| {
            let area = |shape: &drawing::Shape| match shape {
                drawing::Shape::Area([_, _, _, height], tone) if *tone == wanted => Some(*height),
                _ => None,
            };
            drawing.shapes.iter().find_map(area).unwrap()
        };
        let ratio = height(drawing::Tone::DoubtArea) / height(drawing::Tone::PassArea);
        assert!((ratio - (0.03 + guard_mm) / (0.03 - guard_mm)).abs() < 1e-9, "{guard_factor}: {ratio}");
    }
}
