//! A part as comma-separated values (RFC 4180) and in the Q-DAS transfer format, numbers with all their digits.

use super::PartInput;
use super::document::digits;
use crate::acceptance::words::verdict_key;
use crate::csv::field as csv_field;
use crate::qdas::{NAME, NUMBER, PART, REMARK, field, limits, plain_number, value};
use metrology::inspection::FeatureResult;
use std::fmt::Write as _;

const HEAD: &str = "plan,date,part_verdict,feature,value,unit,u,nominal,deviation,lower,upper,verdict,points,rejected,reason,\
                    definition,guard_factor,u_points,u_calibration,u_system";

/// One line a feature, with a head. Lines end in CR LF.
pub fn csv(input: &PartInput<'_>) -> String {
    let mut text = format!("{HEAD}\r\n");
    let number = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    for f in &input.result.features {
        let _ = write!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}\r\n",
            csv_field(&input.result.plan),
            csv_field(input.date),
            verdict_key(Some(input.result.verdict)),
            csv_field(&f.name),
            number(f.value),
            f.unit,
            number(f.u),
            f.nominal,
            number(f.deviation),
            number(f.lower),
            number(f.upper),
            f.verdict.map_or("not-measured", |_| verdict_key(f.verdict)),
            f.points,
            f.rejected,
            csv_field(f.reason.as_deref().unwrap_or_default()),
            csv_field(f.detail.as_deref().unwrap_or_default()),
            input.guard_factor,
            number(f.u_noise),
            number(f.u_calibration),
            f.u_system,
        );
    }
    text
}

/// The Q-DAS transfer format: K-fields of part and characteristics, then the values with their date. Features without a
/// value have the attribute 255 (invalid) and no value counts.
pub fn dfq(input: &PartInput<'_>) -> String {
    let mut text = String::new();
    let features = &input.result.features;
    field(&mut text, "K0100", &features.len().to_string(), NUMBER);
    field(&mut text, "K1001", &input.result.plan, PART);
    field(&mut text, "K1002", &input.result.plan, NAME);
    field(&mut text, "K1900", &format!("verdict {}", input.result.verdict.word()), REMARK);
    for (index, f) in features.iter().enumerate() {
        describe(&mut text, index + 1, f);
    }
    for (index, f) in features.iter().enumerate() {
        let i = index + 1;
        if let Some(measured) = f.value {
            value(&mut text, i, measured);
        } else {
            let _ = write!(text, "K0001/{i} 0\r\nK0002/{i} 255\r\n");
            let reason = f.reason.as_deref().unwrap_or("not measured");
            field(&mut text, &format!("K0009/{i}"), reason, REMARK);
        }
        if let Some(date) = crate::qdas::date(input.date) {
            field(&mut text, &format!("K0004/{i}"), &date, NUMBER);
        }
        field(&mut text, &format!("K0014/{i}"), input.part.unwrap_or_default(), PART);
    }
    text
}

fn describe(text: &mut String, i: usize, f: &FeatureResult) {
    field(text, &format!("K2001/{i}"), &i.to_string(), NUMBER);
    field(text, &format!("K2002/{i}"), &f.name, NAME);
    field(text, &format!("K2022/{i}"), &digits(f).to_string(), NUMBER);
    field(text, &format!("K2101/{i}"), &plain_number(f.nominal), NUMBER);
    limits(text, i, f.lower, f.upper);
    field(text, &format!("K2142/{i}"), &f.unit.to_string(), NUMBER);
    field(text, &format!("K2900/{i}"), f.detail.as_deref().unwrap_or_default(), REMARK);
}
