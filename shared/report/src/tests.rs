//! The whole report, from rich to empty input.

use std::f64::consts::TAU;

use fringe::cloud::Point;
use fringe::pattern::Axis;
use fringe::phase::{PhaseInfo, PhaseMap};

use super::*;
use files::result::{CycleResult, StageResult};
use fringe::fusion::Overlap;
use metrology::inspection::FeatureResult;

fn cap() -> Vec<Point> {
    let places = (0..400).map(|i| (f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5));
    places
        .map(|(x, y)| {
            let z = (400.0 - x * x - y * y).sqrt();
            Point {
                position_mm: [x, y, z],
                normal: [x as f32 / 20.0, y as f32 / 20.0, z as f32 / 20.0],
                sigma_mm: 0.01,
                modulation: 60.0,
                pair: u32::from(x > 0.0),
                pixel: 0,
                shared_mm: 0.0,
            }
        })
        .collect()
}

fn ramp() -> PhaseMap {
    let info = PhaseInfo { width_px: 32, height_px: 8, axis: Axis::X, period_px: 16.0 };
    let mut map = PhaseMap::new(info);
    for i in 0..info.len() {
        map.phase_rad[i] = ((i % 32) as f64 * TAU / 16.0) as f32;
        map.valid[i] = u8::from(i % 7 != 0);
        map.modulation[i] = 40.0;
    }
    map
}

fn measured(name: &str, value: f64, verdict: Option<Verdict>) -> FeatureResult {
    FeatureResult {
        name: name.to_owned(),
        detail: Some("2 311 points".to_owned()),
        value: Some(value),
        u: Some(0.003),
        lower: Some(60.15),
        upper: Some(60.25),
        verdict,
        ..FeatureResult::default()
    }
}

fn row(feature: FeatureResult) -> FeatureRow {
    FeatureRow { feature, truth: Some(60.194) }
}

fn feature(name: &str, value: f64, verdict: Verdict) -> FeatureRow {
    row(measured(name, value, Some(verdict)))
}

fn overlaps() -> Vec<Overlap> {
    vec![Overlap {
        a: 0,
        b: 1,
        count: 1234,
        mean_mm: -0.0021,
        sd_mm: 0.0123,
        max_mm: 0.1,
        sd_over_sigma: None,
    }]
}

fn cycles() -> Vec<CycleResult> {
    let stage = |compute_ns| StageResult {
        name: "decode cam1".to_owned(),
        wait_ns: 3_000_000,
        compute_ns,
        ..StageResult::default()
    };
    vec![CycleResult {
        number: 2,
        outcome: "ok".to_owned(),
        verdict: Some(Verdict::Pass),
        latency_ns: Some(41_500_000),
        points: Some(400),
        stages: vec![stage(5_000_000), stage(7_000_000)],
        ..CycleResult::default()
    }]
}

/// What the report only looks at, so that it outlives it.
struct Inputs {
    cloud: Vec<Point>,
    map: PhaseMap,
    deviations: Vec<(u32, f32)>,
    overlaps: Vec<Overlap>,
    cycles: Vec<CycleResult>,
}

impl Inputs {
    fn new() -> Self {
        Self { cloud: cap(), map: ramp(), deviations: Vec::new(), overlaps: overlaps(), cycles: cycles() }
    }

    fn with(deviations: Vec<(u32, f32)>) -> Self {
        Self { deviations, ..Self::new() }
    }
}

fn rich(seen: &Inputs) -> ReportInput<'_> {
    let Inputs { cloud, map, deviations, overlaps, cycles } = seen;
    let span = |stage: &str, activity, start_ns, end_ns| Span {
        stage: stage.to_owned(),
        activity,
        start_ns,
        end_ns,
    };
    ReportInput {
        cell: "demo".to_owned(),
        part: "artefact".to_owned(),
        date: "2026-01-02 03:04 UTC".to_owned(),
        software_version: "fringecell 0.1.0".to_owned(),
        rig_hash: "ab12".to_owned(),
        plan_id: "plan-7".to_owned(),
        details: vec![("Operator".to_owned(), "N. N.".to_owned())],
        verdict: Some(Verdict::Pass),
        coverage_factor: Some(2.0),
        features: vec![feature("hemisphere diameter", 60.1966, Verdict::Pass)],
        camera_views: vec![GreyPicture {
            caption: "cam1".to_owned(),
            width_px: 4,
            height_px: 2,
            values: vec![9; 8],
        }],
        phase_maps: vec![PhasePicture { caption: "cam1 / proj1", phase: map.view() }],
        cloud,
        pair_names: vec!["left pair".to_owned(), "right pair".to_owned()],
        deviations,
        deviation_meaning: "Distance from the sphere.".to_owned(),
        overlaps,
        timeline: vec![
            span("decode cam1", Activity::Wait, 1_000_000, 4_000_000),
            span("decode cam1", Activity::Compute, 4_000_000, 9_000_000),
            span("fusion", Activity::Compute, 9_000_000, 8_000_000),
        ],
        marks: vec![Mark { name: "last frame".to_owned(), at_ns: 5_000_000 }],
        cycles,
        notes: vec!["A remark.".to_owned()],
        ..ReportInput::default()
    }
}

fn waves() -> Vec<(u32, f32)> {
    (0..399_u16).map(|i| (u32::from(i), (f32::from(i % 21) - 10.0) * 1e-3)).collect()
}

#[test]
fn a_full_report_says_what_it_was_given() {
    let seen = Inputs::with(waves());
    let html = html(&rich(&seen)).unwrap();
    let said = [
        "PASS",
        "1 feature with limits: all within.",
        // Expanded uncertainty 0.0060 mm: four digits; error against the truth with its sign.
        "<b>60.1966</b></td><td class=\"n\">0.0060</td>",
        "+0.0026",
        "the scene of the simulator",
        "U <small>(k&#8239;=&#8239;2)</small>",
        "left pair (200 points)",
        "−2.1",
        "mean 0.00 µm",
        "last frame",
        "decode cam1: compute 5.00 ms",
        "41.50",
        "A remark.",
    ];
    for words in said {
        assert!(html.contains(words), "{words:?} is not in the report");
    }
}

/// A report without the data of its pictures: encoded, they hold any three letters by chance.
fn without_pictures(html: &str) -> String {
    let mut parts = html.split("base64,");
    let first = parts.next().unwrap_or_default();
    let others = parts.map(|part| part.split_once('"').expect("the end of a picture").1);
    std::iter::once(first).chain(others).collect()
}

#[test]
fn the_file_needs_nothing_else() {
    let seen = Inputs::with(waves());
    let html = html(&rich(&seen)).unwrap();
    for attribute in ["src=\"", "href=\""] {
        let targets: Vec<&str> = html.split(attribute).skip(1).collect();
        assert!(!targets.is_empty());
        assert!(targets.iter().all(|t| t.starts_with("data:image/png;base64,")));
    }
    let text = without_pictures(&html);
    for reference in ["<script", "<link", "@import", "http:", "https:", "//"] {
        assert!(!text.contains(reference), "{reference} leads out of the file");
    }
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let seen = Inputs::with(waves());
    let input = rich(&seen);
    assert_eq!(html(&input).unwrap(), html(&input.clone()).unwrap());
}

#[test]
fn text_from_outside_stays_text() {
    let evil = "\"><script>alert(1)</script>";
    let mut seen = Inputs::new();
    evil.clone_into(&mut seen.cycles[0].outcome);
    evil.clone_into(&mut seen.cycles[0].stages[0].name);
    let mut input = rich(&seen);
    for text in [&mut input.cell, &mut input.part, &mut input.date, &mut input.rig_hash, &mut input.reason] {
        evil.clone_into(text);
    }
    input.details = vec![(evil.to_owned(), evil.to_owned())];
    input.features[0].feature.name = evil.to_owned();
    input.features[0].feature.detail = Some(evil.to_owned());
    input.camera_views[0].caption = evil.to_owned();
    input.phase_maps[0].caption = evil;
    input.pair_names[0] = evil.to_owned();
    input.timeline[0].stage = evil.to_owned();
    input.marks[0].name = evil.to_owned();
    input.notes = vec![evil.to_owned()];
    let html = html(&input).unwrap();
    assert!(!html.contains("<script"));
    assert!(html.matches("&quot;&gt;&lt;script&gt;").count() >= 17);
}

#[test]
fn an_empty_input_gives_an_valid_report() {
    let html = html(&ReportInput::default()).unwrap();
    for words in ["NO RESULT", "The measurement gave no result.", "names no feature", "The cloud is empty."] {
        assert!(html.contains(words), "{words:?} is not in the report");
    }
    assert!(!html.contains("NaN") && !html.contains("inf"));
}

#[test]
fn values_that_are_no_numbers_are_shown_as_absent() {
    let mut seen = Inputs::with(vec![(3, f32::NAN)]);
    seen.map.valid.fill(0);
    seen.overlaps[0].mean_mm = f64::NAN;
    seen.cycles.push(CycleResult::default());
    let mut input = rich(&seen);
    input.verdict = Some(Verdict::Fail);
    let failed = |name, value| measured(name, value, Some(Verdict::Fail));
    input.features = [
        FeatureResult {
            value: None,
            reason: Some("12 points, at least 100 needed".into()),
            ..measured("never seen", 0.0, None)
        },
        FeatureResult { u: Some(f64::NAN), ..failed("u unknown", 60.3) },
        FeatureResult { lower: Some(2.0), upper: Some(1.0), ..failed("limits swapped", 1.5) },
        FeatureResult { upper: Some(f64::INFINITY), ..failed("endless", 1.5) },
        FeatureResult { lower: None, upper: None, ..measured("no limits", 1.5, None) },
    ]
    .map(row)
    .to_vec();
    let html = html(&input).unwrap();
    let shown = without_pictures(&html);
    assert!(!shown.contains("NaN") && !shown.contains("inf<") && !shown.contains("inf\""));
    assert!(html.contains("4 features with limits: 0 within, 3 outside, 1 not measured."));
    assert!(html.contains("1 could not be evaluated."));
    assert!(html.contains("12 points, at least 100 needed"), "the reason stands where the value would");
    assert_eq!(html.matches("NO RESULT").count(), 1, "a feature without limits has no verdict");
}

#[test]
fn one_deviation_makes_a_histogram() {
    for deviation in [0.0, 0.004, -7e30] {
        let html = html(&rich(&Inputs::with(vec![(0, deviation)]))).unwrap();
        assert!(html.contains("sd – µm"), "one value has no standard deviation");
        assert!(!without_pictures(&html).contains("NaN"));
    }
}

#[test]
fn a_banner_cannot_contradict_its_table() {
    let seen = Inputs::new();
    let mut input = rich(&seen);
    input.features.push(feature("sphere spacing", 60.26, Verdict::Fail));
    let refused = html(&input).unwrap_err().to_string();
    assert!(refused.contains("sphere spacing"), "{refused}");
    input.verdict = Some(Verdict::Fail);
    assert!(html(&input).is_ok());
}

#[test]
fn pictures_that_do_not_fit_their_size_are_named() {
    let mut seen = Inputs::new();
    let mut input = rich(&seen);
    input.camera_views[0].width_px = 5;
    assert!(matches!(html(&input), Err(ReportError::Picture { what, .. }) if what == "cam1"));
    let outside = Inputs::with(vec![(400, 0.0)]);
    assert!(matches!(html(&rich(&outside)), Err(ReportError::Picture { .. })));
    seen.map.valid.pop();
    assert!(matches!(html(&rich(&seen)), Err(ReportError::Picture { .. })));
}

#[test]
fn a_large_camera_is_reduced_and_a_long_run_is_shortened_aloud() {
    let mut seen = Inputs::new();
    seen.cycles = (0..300)
        .map(|cycle| CycleResult {
            number: cycle + 1,
            outcome: if cycle == 5 { "stage decode cam1 was killed".to_owned() } else { "ok".to_owned() },
            ..CycleResult::default()
        })
        .collect();
    let mut input = rich(&seen);
    let (width_px, height_px) = (2500, 6);
    input.camera_views[0] =
        GreyPicture { caption: "large".to_owned(), width_px, height_px, values: vec![77; 2500 * 6] };
    let html = html(&input).unwrap();
    assert!(html.contains("<td class=\"n\">6</td><td>stage decode cam1 was killed"), "cycles count from 1");
    assert!(html.contains("299 of 300 cycles ended ok.") && html.contains("239 earlier cycles"));
}

#[test]
fn the_file_is_written_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.html");
    let mut input = ReportInput::default();
    write_html(&path, &input).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.ends_with("</html>\n"));
    input.camera_views.push(GreyPicture { width_px: 3, ..GreyPicture::default() });
    assert!(write_html(&folder.path().join("second.html"), &input).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no second file, no remainder");
}

#[test]
fn stand_alone_pictures_decode_and_carry_a_colour_bar() {
    let (cloud, map) = (cap(), ramp());
    let view = map.view();
    let width = |png: Result<Vec<u8>, PictureError>| image::load_from_memory(&png.unwrap()).unwrap().width();
    assert_eq!(width(picture::grey_png(4, 2, &[0; 8])), 4);
    for png in [
        picture::phase_png(&view),
        picture::wrapped_phase_png(&view),
        picture::modulation_png(&view),
        picture::order_png(&view),
    ] {
        assert!(width(png) > 32 + 16, "bar and labels stand beside the map");
    }
    let top = picture::View::top(60, 40);
    assert_eq!(width(picture::cloud_png(&cloud, &top, &picture::Colouring::Pair)), 60);
    let deviations = waves();
    let colouring = picture::Colouring::Deviation { values: &deviations, half_range_mm: 0.01 };
    assert!(width(picture::cloud_png(&cloud, &top, &colouring)) > 60);
    assert_eq!(width(picture::cloud_png(&[], &top, &picture::Colouring::Normal)), 60);
}
