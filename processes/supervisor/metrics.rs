//! Metrics of a cell in the Prometheus text format, version 0.0.4. Pure.
//!
//! Names follow the conventions of Prometheus: base units, `_total` for counters, one help and one type line per family.

use super::profile::{BOUNDS_NS, Profile, StageProfile, Timing};
use super::protocol::{LastPart, StageStatus, Status};
use devices::CameraState;
use metrology::inspection::FeatureResult;
use metrology::verdict::Verdict;
use std::fmt::Write as _;

/// Content type of the text format.
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// One metric family of the Prometheus text format.
struct Family<'a> {
    text: &'a mut String,
    name: &'static str,
    cell: &'a str,
}

impl<'a> Family<'a> {
    fn new(text: &'a mut String, cell: &'a str, name: &'static str, kind: &str, help: &str) -> Self {
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        Self { text, name, cell }
    }

    fn sample(&mut self, suffix: &str, labels: &[(&str, &str)], value: f64) {
        let _ = write!(self.text, "{}{suffix}{{cell=\"{}\"", self.name, escape(self.cell));
        for (key, label) in labels {
            let _ = write!(self.text, ",{key}=\"{}\"", escape(label));
        }
        let _ = writeln!(self.text, "}} {value}");
    }

    fn histogram(&mut self, labels: &[(&str, &str)], timing: &Timing) {
        let mut below = 0;
        for (place, count) in timing.buckets.iter().enumerate() {
            below += count;
            let bound = BOUNDS_NS.get(place).map_or_else(|| "+Inf".to_owned(), |ns| seconds(*ns).to_string());
            let mut all = labels.to_vec();
            all.push(("le", &bound));
            self.sample("_bucket", &all, below as f64);
        }
        self.sample("_sum", labels, seconds(timing.sum_ns));
        self.sample("_count", labels, timing.count() as f64);
    }
}

/// All metrics of a cell.
pub fn render(status: &Status, profile: &Profile) -> String {
    let mut text = String::new();
    cycles(&mut text, status, profile);
    stages(&mut text, status);
    cameras(&mut text, status);
    if let Some(last) = &status.last {
        features(&mut text, &status.cell, last);
    }
    for (name, help, pick) in [
        (
            "fringecell_stage_wait_seconds",
            "Waiting for input, per cycle that is ok.",
            wait as fn(&StageProfile) -> &Timing,
        ),
        ("fringecell_stage_compute_seconds", "Computing, per cycle that is ok.", compute),
        ("fringecell_stage_send_seconds", "Sending outputs, per cycle that is ok.", send),
    ] {
        let mut family = Family::new(&mut text, &status.cell, name, "histogram", help);
        for stage in &profile.stages {
            family.histogram(&[("stage", &stage.sum.name)], pick(stage));
        }
    }
    text
}

fn wait(stage: &StageProfile) -> &Timing {
    &stage.wait
}

fn compute(stage: &StageProfile) -> &Timing {
    &stage.compute
}

fn send(stage: &StageProfile) -> &Timing {
    &stage.send
}

fn cycles(text: &mut String, status: &Status, profile: &Profile) {
    let cell = status.cell.as_str();
    let outcomes = &status.outcomes;
    let mut family = Family::new(text, cell, "fringecell_cycles_total", "counter", "Cycles by outcome.");
    for (outcome, count) in [
        ("pass", outcomes.pass),
        ("indeterminate", outcomes.indeterminate),
        ("fail", outcomes.fail),
        ("no_verdict", outcomes.no_verdict),
        ("not_ok", outcomes.not_ok),
    ] {
        family.sample("", &[("outcome", outcome)], count as f64);
    }
    Family::new(
        text,
        cell,
        "fringecell_deadline_misses_total",
        "counter",
        "Cycles that exceeded their deadline.",
    )
    .sample("", &[], status.deadline_misses as f64);
    Family::new(text, cell, "fringecell_cycle_running", "gauge", "1 while a cycle is in progress.").sample(
        "",
        &[],
        f64::from(u8::from(status.cycle.is_some())),
    );
    if let Some(rate) = status.cycles_per_minute {
        Family::new(text, cell, "fringecell_cycles_per_minute", "gauge", "Rate of the last cycles.").sample(
            "",
            &[],
            rate,
        );
    }
    for (name, help, timing) in [
        ("fringecell_cycle_seconds", "Duration from start to outcome of cycles that are ok.", &profile.cycle),
        ("fringecell_latency_seconds", "Duration from the last frame to the verdict.", &profile.latency),
    ] {
        Family::new(text, cell, name, "histogram", help).histogram(&[], timing);
    }
}

fn stages(text: &mut String, status: &Status) {
    type Pick = fn(&StageStatus) -> f64;
    let families: [(&'static str, &str, &str, Pick); 9] = [
        ("fringecell_stage_up", "gauge", "1 while the stage is up.", |s| {
            f64::from(u8::from(s.state == "up"))
        }),
        ("fringecell_stage_restarts_total", "counter", "Restarts of the stage.", |s| f64::from(s.restarts)),
        ("fringecell_stage_activations_total", "counter", "Completed activations.", |s| {
            f64::from(s.total.activations)
        }),
        ("fringecell_stage_sent_bytes_total", "counter", "Bytes of the outputs.", |s| s.total.bytes as f64),
        ("fringecell_stage_cpu_seconds_total", "counter", "Processor time in cycles.", |s| {
            seconds(s.total.cpu_ns)
        }),
        ("fringecell_stage_minor_page_faults_total", "counter", "Page faults without disk access.", |s| {
            s.total.minor_faults as f64
        }),
        ("fringecell_stage_major_page_faults_total", "counter", "Page faults with disk access.", |s| {
            s.total.major_faults as f64
        }),
        ("fringecell_stage_voluntary_switches_total", "counter", "Context switches while waiting.", |s| {
            s.total.voluntary_switches as f64
        }),
        ("fringecell_stage_involuntary_switches_total", "counter", "Context switches by preemption.", |s| {
            s.total.involuntary_switches as f64
        }),
    ];
    for (name, kind, help, pick) in families {
        let mut family = Family::new(text, &status.cell, name, kind, help);
        for stage in &status.stages {
            family.sample("", &[("stage", &stage.name)], pick(stage));
        }
    }
}

/// Temperature and link of the cameras that tell them.
fn cameras(text: &mut String, status: &Status) {
    type Pick = fn(&CameraState) -> Option<f64>;
    let families: [(&'static str, &str, &str, Pick); 6] = [
        ("fringecell_camera_temperature_celsius", "gauge", "Temperature of the camera.", |s| s.temperature_c),
        ("fringecell_camera_packets_total", "counter", "Packets that arrived.", |s| {
            s.link.map(|link| link.packets as f64)
        }),
        ("fringecell_camera_lost_packets_total", "counter", "Packets that were lost for good.", |s| {
            s.link.map(|link| link.lost_packets as f64)
        }),
        (
            "fringecell_camera_resent_packets_total",
            "counter",
            "Packets that came after they were asked for again.",
            |s| s.link.map(|link| link.resent_packets as f64),
        ),
        (
            "fringecell_camera_dropped_packets_total",
            "counter",
            "Packets that a full receive buffer dropped.",
            |s| s.link.map(|link| link.dropped_packets as f64),
        ),
        (
            "fringecell_camera_incomplete_frames_total",
            "counter",
            "Frames closed without all their packets.",
            |s| s.link.map(|link| link.incomplete_frames as f64),
        ),
    ];
    for (name, kind, help, pick) in families {
        if status.cameras.iter().all(|camera| pick(&camera.state).is_none()) {
            continue;
        }
        let mut family = Family::new(text, &status.cell, name, kind, help);
        for camera in &status.cameras {
            if let Some(value) = pick(&camera.state) {
                family.sample("", &[("camera", &camera.name)], value);
            }
        }
    }
}

/// The features of the last cycle; none where it measured none, so that no old value passes for a new one.
fn features(text: &mut String, cell: &str, last: &LastPart) {
    type Pick = fn(&FeatureResult) -> Option<f64>;
    let families: [(&'static str, &str, Pick); 5] = [
        ("fringecell_feature_value", "Measured value of the feature in the last cycle.", |f| f.value),
        ("fringecell_feature_deviation", "Measured less nominal value.", |f| f.deviation),
        ("fringecell_feature_uncertainty", "Standard uncertainty of the value.", |f| f.u),
        ("fringecell_feature_lower_limit", "Lower limit of the value.", |f| f.lower),
        ("fringecell_feature_upper_limit", "Upper limit of the value.", |f| f.upper),
    ];
    let recipe = last.recipe.as_deref().unwrap_or_default();
    for (name, help, pick) in families {
        if last.features.iter().all(|feature| pick(feature).is_none()) {
            continue;
        }
        let mut family = Family::new(text, cell, name, "gauge", help);
        for feature in &last.features {
            if let Some(value) = pick(feature) {
                let unit = feature.unit.to_string();
                family.sample("", &[("feature", &feature.name), ("recipe", recipe), ("unit", &unit)], value);
            }
        }
    }
    verdicts(text, cell, last, recipe);
}

/// One sample for each possible verdict: 1 for the one that holds.
fn verdicts(text: &mut String, cell: &str, last: &LastPart, recipe: &str) {
    let all = [Some(Verdict::Pass), Some(Verdict::Indeterminate), Some(Verdict::Fail), None];
    let word = |verdict: Option<Verdict>| match verdict {
        Some(Verdict::Pass) => "pass",
        Some(Verdict::Indeterminate) => "indeterminate",
        Some(Verdict::Fail) => "fail",
        None => "none",
    };
    let holds = |one: Option<Verdict>, other: Option<Verdict>| f64::from(u8::from(one == other));
    let help = "1 for the verdict over the part of the last cycle.";
    let mut family = Family::new(text, cell, "fringecell_part_verdict", "gauge", help);
    for verdict in all {
        let labels = [("recipe", recipe), ("verdict", word(verdict))];
        family.sample("", &labels, holds(last.verdict, verdict));
    }
    if last.features.is_empty() {
        return;
    }
    let help = "1 for the verdict over the feature in the last cycle.";
    let mut family = Family::new(text, cell, "fringecell_feature_verdict", "gauge", help);
    for feature in &last.features {
        for verdict in all {
            let labels = [("feature", feature.name.as_str()), ("recipe", recipe), ("verdict", word(verdict))];
            family.sample("", &labels, holds(feature.verdict, verdict));
        }
    }
}

fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}

/// Escapes a label value.
fn escape(label: &str) -> String {
    label.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use metrology::inspection::Unit;

    /// Names come from a plan that anybody may write.
    #[test]
    fn features_are_gauges_whatever_their_names() {
        let feature = FeatureResult {
            name: "a \"b\"\\c\nd".into(),
            value: Some(20.5),
            deviation: Some(0.5),
            u: Some(0.001),
            upper: Some(20.1),
            verdict: Some(Verdict::Fail),
            unit: Unit::Mm,
            ..FeatureResult::default()
        };
        let last = LastPart {
            recipe: Some("r".into()),
            verdict: Some(Verdict::Fail),
            features: vec![feature],
            ..LastPart::default()
        };
        let mut text = String::new();
        features(&mut text, "c", &last);
        let labels = r#"cell="c",feature="a \"b\"\\c\nd",recipe="r""#;
        for line in [
            format!(r#"fringecell_feature_value{{{labels},unit="mm"}} 20.5"#),
            format!(r#"fringecell_feature_deviation{{{labels},unit="mm"}} 0.5"#),
            format!(r#"fringecell_feature_uncertainty{{{labels},unit="mm"}} 0.001"#),
            format!(r#"fringecell_feature_upper_limit{{{labels},unit="mm"}} 20.1"#),
            format!(r#"fringecell_feature_verdict{{{labels},verdict="fail"}} 1"#),
            format!(r#"fringecell_feature_verdict{{{labels},verdict="pass"}} 0"#),
            r#"fringecell_part_verdict{cell="c",recipe="r",verdict="fail"} 1"#.to_owned(),
        ] {
            assert!(text.lines().any(|found| found == line), "{line} is not in\n{text}");
        }
        assert!(!text.contains("lower_limit"), "a limit that the plan does not set");
    }

    #[test]
    fn a_cycle_without_features_has_no_old_values() {
        let mut text = String::new();
        features(&mut text, "c", &LastPart { outcome: "stage fusion died".into(), ..LastPart::default() });
        assert!(!text.contains("fringecell_feature"), "{text}");
        assert!(text.contains(r#"verdict="none"} 1"#), "{text}");
    }
}
