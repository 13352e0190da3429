//! The statistics as text.

use super::Args;
use super::gauge::GaugeStudy;
use super::input::Parts;
use metrology::spc::{Interval, Study};

/// Most signals that are printed for one feature.
const SIGNALS: usize = 5;

/// Prints all studies with their indices.
pub fn print(parts: &Parts, studies: &[Study], gauges: &[GaugeStudy], args: &Args) {
    println!("{} parts, {} of them without a result", parts.count, parts.not_ok);
    for study in studies {
        print_study(study, args.confidence);
    }
    for gauge in gauges {
        print_gauge(gauge);
    }
    if let Some(least) = args.least_ppk {
        for study in studies.iter().filter(|s| s.capability.is_some()) {
            let low = study.capability.as_ref().and_then(|c| c.ppk).map(|ppk| ppk.low);
            let proven = low.is_some_and(|low| low >= least);
            let word = if proven { "proven" } else { "NOT PROVEN" };
            let low = low.map_or("no value".into(), |low| format!("{low:.2}"));
            println!("{}: Ppk ≥ {least} is {word}: its lower confidence limit is {low}", study.series.name);
        }
    }
}

fn print_study(study: &Study, confidence: f64) {
    let series = &study.series;
    let recipe = series.recipe.as_ref().map_or(String::new(), |recipe| format!(", recipe {recipe}"));
    let missing = match series.missing {
        0 => String::new(),
        n => format!(", {n} parts without a value"),
    };
    println!("\n{} ({}){recipe}: {} values{missing}", series.name, series.unit, series.values.len());
    if series.limits_changed {
        println!("  the limits changed; those of the last part count for all");
    }
    if let Some(chart) = &study.chart {
        let limits = &chart.location;
        println!(
            "  mean {:.5}, control limits {:.5} … {:.5}, σ within {:.5}",
            limits.centre, limits.lower, limits.upper, chart.sigma_within
        );
        for signal in chart.signals.iter().take(SIGNALS) {
            let first = chart.points[signal.point].first;
            println!("  signal at \"{}\": {}", series.parts[first], signal.reason);
        }
        if chart.signals.len() > SIGNALS {
            println!("  {} further signals", chart.signals.len() - SIGNALS);
        }
    }
    if let Some(normality) = &study.normality {
        let word = if normality.p < 0.05 { "NOT normal" } else { "normal" };
        println!("  distribution: {word} (Anderson-Darling, p = {:.3})", normality.p);
    }
    if let (Some(u), Some(share)) = (study.u_rms, study.u_share_percent) {
        if share > 100.0 {
            println!("  stated u {u:.5}: larger than the scatter of the values");
        } else {
            println!("  stated u {u:.5}: {share:.0} % of the variance of the values");
        }
    }
    let Some(capability) = &study.capability else { return };
    let index = |name: &str, value: Option<Interval>| {
        if let Some(value) = value {
            println!(
                "  {name:<4}{:.2}  ({:.2} … {:.2} at {} %)",
                value.value,
                value.low,
                value.high,
                100.0 * confidence
            );
        }
    };
    index("Cp", capability.cp);
    index("Cpk", capability.cpk);
    index("Pp", capability.pp);
    index("Ppk", capability.ppk);
    let out = &capability.outside;
    println!("  outside of the limits: {} of {}", out.below + out.above, capability.count);
}

fn print_gauge(gauge: &GaugeStudy) {
    println!("\ngauge, {} ({}): {}", gauge.feature, gauge.unit, gauge.rating);
    let value = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2}"));
    if let Some(one) = &gauge.type_one {
        println!(
            "  {} readings of {}: mean {:.5}, bias {:+.5}, s {:.5}, Cg {}, Cgk {}",
            one.count,
            one.reference,
            one.mean,
            one.bias,
            one.sd,
            value(one.cg),
            value(one.cgk)
        );
    }
    if let Some(two) = &gauge.type_two {
        println!("  {} parts, {} operators, {} trials", two.parts, two.operators, two.trials);
        println!("  EV {:.5}  AV {:.5}  INT {:.5}  GRR {:.5}", two.ev, two.av, two.interaction, two.grr);
        println!(
            "  PV {:.5}  TV {:.5}  ndc {}",
            two.pv,
            two.tv,
            two.ndc.map_or("-".into(), |n| n.to_string())
        );
        println!(
            "  GRR: {} % of the variation, {} % of the tolerance",
            value(two.grr_of_variation_percent),
            value(two.grr_of_tolerance_percent)
        );
    }
}
