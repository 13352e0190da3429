//! Reports to write: complete, reduced, and with hostile texts.

use metrology::acceptance::{
    ArtefactRecord, Characteristic, Input, LateralResolution, PositionValue, RuleSetId, TestReport,
    Violation, Volume,
};
use metrology::verdict::Verdict;

pub(super) fn positions(name: &str, values: &[f64], views: usize) -> Vec<PositionValue> {
    let position = |(index, value): (usize, &f64)| PositionValue {
        position: format!("{name}-{}", index + 1),
        repeat: 1,
        value: *value,
        length_mm: None,
        limit: None,
        test_value_u: Some(U_MM),
        verdict: None,
        replaced: false,
        points: 48_211 + index,
        rejected: 144,
        excluded: 0,
        views: (1..=views).map(|v| format!("v{v}")).collect(),
    };
    values.iter().enumerate().map(position).collect()
}

pub(super) fn characteristic(
    symbol: &str,
    name: &str,
    limit: Option<f64>,
    positions: Vec<PositionValue>,
) -> Characteristic {
    let value = positions.iter().map(|p| p.value).max_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(0.0);
    let mut one = Characteristic {
        symbol: symbol.into(),
        name: name.into(),
        definition: "difference of the largest and smallest radial distance to the least-squares sphere of free radius".into(),
        unit: "mm".into(),
        value,
        decides: limit.is_some(),
        limit,
        test_value_u: Some(U_MM),
        verdict: None,
        positions,
        repeatability: Some(0.0007),
        between_positions: Some(0.0031),
    };
    decide(&mut one);
    one
}

/// Expanded uncertainty of the test values.
pub(super) const U_MM: f64 = 0.0021;

/// Guard factor of the test.
pub(super) const GUARD: f64 = 2.0;

/// Verdicts that follow from the values.
pub(super) fn decide(one: &mut Characteristic) {
    let verdicts: Vec<_> = one.positions.iter().map(|p| one.verdict_at(p, GUARD)).collect();
    one.positions.iter_mut().zip(verdicts).for_each(|(p, verdict)| p.verdict = verdict);
    one.verdict = one.verdict_over_positions(GUARD);
}

pub(super) fn artefacts() -> Vec<ArtefactRecord> {
    vec![
        ArtefactRecord {
            id: "sphere-20".into(),
            kind: "sphere".into(),
            certificate: "K-2024-117".into(),
            validity: "from 2026-01-10, until 2027-01-09".into(),
            values: vec![("diameter".into(), 20.001_37, Some(0.0004))],
        },
        ArtefactRecord {
            id: "bar-145".into(),
            kind: "ball-bar".into(),
            certificate: "K-2024-118".into(),
            validity: String::new(),
            values: vec![("spacing".into(), 145.055_09, Some(0.0006)), ("length".into(), 300.0, None)],
        },
    ]
}

fn resolution() -> LateralResolution {
    LateralResolution {
        step_mm: 0.358,
        step_across_mm: Some(0.463),
        hidden_step_mm: Some(0.457),
        source: "computed".into(),
    }
}

/// A test as the twin gives it.
pub(super) fn report() -> TestReport {
    let sphere = |values: &[f64]| positions("sphere", values, 5);
    let characteristics = vec![
        characteristic(
            "PF_range",
            "probing form error (range)",
            Some(0.04),
            sphere(&[0.0312, 0.0297, 0.0341]),
        ),
        characteristic(
            "PF_sigma",
            "probing form (standard deviation)",
            None,
            sphere(&[0.0061, 0.0058, 0.0066]),
        ),
        characteristic("PS", "probing size error", Some(0.03), sphere(&[-0.0121, 0.0087, -0.0291])),
        characteristic(
            "SD",
            "sphere spacing error",
            Some(0.03),
            positions("bar", &[0.0121, -0.0187, 0.0412, 0.0034, -0.0051, 0.0009, 0.0177], 1),
        ),
    ];
    TestReport {
        rule_set: RuleSetId {
            id: "own-3".into(),
            standard: "VDI/VDE 2634 part 3".into(),
            edition: "2008-12".into(),
            wording: "evaluated following VDI/VDE 2634 part 3, edition 2008-12".into(),
            assumed: vec!["at most 3 % of the points left out".into()],
        },
        reduced: Vec::new(),
        guard_factor: GUARD,
        simulated: false,
        inputs: vec![Input {
            position: "sphere-1".into(),
            repeat: 1,
            view: "v1".into(),
            source: "s1v1.ply".into(),
            sha256: "0123456789abcdef".repeat(4),
        }],
        conditions: vec![
            ("Operator".into(), "M. Messtechnik".into()),
            ("date".into(), "2026-11-20".into()),
            ("Temperature".into(), "20.3 °C ± 0.2 °C".into()),
            ("Warm-up".into(), "60 min".into()),
            ("Operating mode".into(), "1 exposure, 3 periods of 16/15/14 px, 8 steps, no averaging".into()),
            ("Rig file (SHA-256)".into(), "7d0a5f3bb2c96a9d41c2".into()),
            ("Software".into(), "fringecell 0.1.0".into()),
        ],
        lateral_resolution: Some(resolution()),
        sensor_volume: Volume::new([150.0, 120.0, 80.0]),
        total_volume: Volume::new([150.0, 120.0, 100.0]),
        artefacts: artefacts(),
        characteristics,
        verdict: Verdict::Fail,
    }
}

pub(super) fn reduced() -> TestReport {
    let violation = Violation {
        rule: "ball bar length".into(),
        required: 145.0,
        actual: 120.055,
        unit: "mm".into(),
        text: "The longest sphere spacing has to be 2/3 of the body diagonal.".into(),
    };
    TestReport { reduced: vec![violation], ..report() }
}

/// Signs that end elements, strings, fields and lines somewhere.
pub(super) const HOSTILE: &str = "<b>&\"x'\u{1b}[31m\r\nK0100 7;,\u{0}]]> =1 \u{2028}µ±汉";

pub(super) fn hostile() -> TestReport {
    let mut report = reduced();
    report.conditions.push((HOSTILE.into(), HOSTILE.into()));
    report.artefacts[0].certificate = HOSTILE.into();
    report.reduced[0].text = HOSTILE.into();
    let one = &mut report.characteristics[0];
    (one.symbol, one.name, one.definition) = (HOSTILE.into(), "=cmd()".into(), HOSTILE.into());
    one.positions[0].position = HOSTILE.into();
    one.positions[0].views = vec![HOSTILE.into()];
    report
}
