//! The plan that goes with simulated recordings.

use super::layout::{MIDDLE_MM, TestRecording, VOLUME_MM};
use anyhow::{Context, Result};
use files::config::Config;
use fringe::pattern::frame_count;
use metrology::acceptance::{
    Artefact, Conditions, Decision, Kind, LengthLimit, Limit, Measurement, PositionPlan, Reference,
    RegisterBy, Segmentation, TEST_FORMAT, TestPlan, ViewPlan, Volumes,
};

/// Diameters of the reference spheres of the scene, mm.
const REFERENCES_MM: [f64; 4] = [11.0, 13.0, 15.0, 17.0];

/// Limits that the cell is tested against, mm, as a maker would promise them: the range of single points that scatter by
/// 15 µm, 3 % left out, is 4.34 · 15 µm = 65 µm, with a quarter in reserve; size and spacing at a third of it, and the
/// spacing allowed to grow with the length.
const LIMITS: [(&str, Limit); 3] = [
    ("PF_range", Limit::Constant(0.080)),
    ("PS", Limit::Constant(0.020)),
    ("SD", Limit::Length(LengthLimit { a_mm: 0.015, k_um_per_m: 50.0, b_mm: Some(0.030) })),
];

/// Day of the simulated test and of its simulated certificates: a fixed one, so that the same command gives the same bytes.
const DAY: &str = "2026-01-01";

/// The plan as TOML.
pub fn text(recordings: &[TestRecording], reduced: bool, config: &Config) -> Result<String> {
    let frames = config.cell.projectors.first().map_or(0, |p| frame_count(&p.sequence));
    let plan = TestPlan {
        format: TEST_FORMAT.into(),
        name: format!("{} on the digital twin", config.cell.name),
        rule_set: "vdi2634-3".into(),
        allow_reduced: reduced,
        reject_fraction: None,
        conditions: Conditions {
            operator: "fringetool simulate-test".into(),
            date: DAY.into(),
            instrument: Some(format!("digital twin of {}, simulated, no serial number", config.cell.name)),
            temperature_c: 20.0,
            u_temperature_k: 0.1,
            operating_mode: format!("one exposure, {frames} frames a view, no averaging"),
            warm_up: None,
            zero_reason: None,
            cloud_filters: None,
            simulated: true,
            lateral_resolution_mm: None,
        },
        // All cameras of the cell see the volume, so it is both.
        volume: Volumes { sensor_mm: VOLUME_MM, total_mm: VOLUME_MM, center_mm: Some(MIDDLE_MM) },
        decision: Decision::default(),
        limits: LIMITS.iter().map(|(symbol, limit)| ((*symbol).to_owned(), *limit)).collect(),
        measurement: Some(Measurement {
            rig: super::RIG.to_owned(),
            method: "phase".into(),
            smoothing_px: None,
        }),
        segmentation: Segmentation::default(),
        references: REFERENCES_MM.map(|diameter_mm| Reference { diameter_mm }).into(),
        artefacts: artefacts(),
        positions: positions(recordings),
    };
    toml::to_string(&plan).context("the plan")
}

/// Uncertainties of a good laboratory's certificate; the thesis quotes the form deviations, not these.
fn artefacts() -> Vec<Artefact> {
    let sphere = Artefact {
        id: "sphere 1".into(),
        kind: Kind::Sphere,
        certificate: "simulated: configs/sphere.scene.toml".into(),
        certificate_date: Some(DAY.into()),
        certificate_valid_until: Some(DAY.into()),
        diameters_mm: vec![20.00137],
        u_diameter_mm: Some(0.0005),
        spacings_mm: Vec::new(),
        u_spacing_mm: None,
        rod_diameter_mm: None,
        size_mm: None,
        form_mm: 0.00195,
        u_form_mm: 0.0003,
        expansion_per_k: 5.5e-6,
        u_expansion_per_k: 0.5e-6,
        zero_reason: None,
        calibrated_at_c: 20.0,
    };
    let bar = Artefact {
        id: "compliant bar".into(),
        kind: Kind::BallBar,
        certificate: "simulated: configs/compliant-bar.scene.toml".into(),
        diameters_mm: vec![20.00137, 20.00146],
        spacings_mm: vec![150.0421],
        u_spacing_mm: Some(0.0008),
        rod_diameter_mm: Some(8.0),
        expansion_per_k: 0.5e-6,
        u_expansion_per_k: 0.5e-6,
        ..sphere.clone()
    };
    vec![sphere, bar]
}

fn positions(recordings: &[TestRecording]) -> Vec<PositionPlan> {
    let mut positions: Vec<PositionPlan> = Vec::new();
    for recording in recordings {
        let view = ViewPlan {
            name: recording.view.clone(),
            recording: Some(recording.name.clone()),
            cloud: None,
            near_mm: Vec::new(),
            exclude_mm: Vec::new(),
            transform: None,
        };
        match positions.last_mut().filter(|last| last.name == recording.position) {
            Some(position) => position.views.push(view),
            None => positions.push(PositionPlan {
                name: recording.position.clone(),
                repeat: 1,
                retest: false,
                artefact: if recording.bar { "compliant bar" } else { "sphere 1" }.into(),
                register: if recording.bar { RegisterBy::Frame } else { RegisterBy::References },
                views: vec![view],
            }),
        }
    }
    positions
}
