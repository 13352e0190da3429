//! Q-DAS ASCII transfer format (AQDEF) of measured parts.
//!
//! Fields: K0100 number of characteristics; K1002 what was measured; K1900 remark; per characteristic i K2001 number, K2002
//! name, K2022 decimals, K2101 nominal, K2110 and K2111 limits, K2120 and K2121 kind of the limits (0: none, 1: limit), K2142 unit; per value K0001 value, K0002
//! attribute (0: valid), K0004 date and time, K0014 identification of the part.

use super::DfqInput;
use crate::number::decimals;
use crate::qdas::{NAME, NUMBER, PART, REMARK, field, limits, plain_number, value};
use metrology::spc::Study;

pub fn render(input: &DfqInput<'_>) -> String {
    let mut text = String::new();
    field(&mut text, "K0100", &input.studies.len().to_string(), NUMBER);
    field(&mut text, "K1002", "Parts measured by fringecell", NAME);
    field(&mut text, "K1900", input.remark, REMARK);
    for (index, study) in input.studies.iter().enumerate() {
        describe(&mut text, index + 1, study);
    }
    for (index, study) in input.studies.iter().enumerate() {
        values(&mut text, index + 1, study);
    }
    text
}

fn describe(text: &mut String, i: usize, study: &Study) {
    let series = &study.series;
    let recipe = series.recipe.as_ref().map_or(String::new(), |recipe| format!(" ({recipe})"));
    field(text, &format!("K2001/{i}"), &i.to_string(), NUMBER);
    field(text, &format!("K2002/{i}"), &format!("{}{recipe}", series.name), NAME);
    field(text, &format!("K2022/{i}"), &decimals(study.u_rms).clamp(4, 6).to_string(), NUMBER);
    if let Some(nominal) = series.nominal {
        field(text, &format!("K2101/{i}"), &plain_number(nominal), NUMBER);
    }
    limits(text, i, series.limits.lower, series.limits.upper);
    field(text, &format!("K2142/{i}"), &series.unit, NUMBER);
}

fn values(text: &mut String, i: usize, study: &Study) {
    let series = &study.series;
    for (index, &measured) in series.values.iter().enumerate() {
        value(text, i, measured);
        if let Some(date) = series.dates.get(index).and_then(|date| crate::qdas::date(date)) {
            field(text, &format!("K0004/{i}"), &date, NUMBER);
        }
        if let Some(part) = series.parts.get(index) {
            field(text, &format!("K0014/{i}"), part, PART);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use metrology::spc::{Limits, Series, StudySettings, study};

    #[test]
    fn each_value_carries_date_and_part_and_nothing_leaves_its_line() {
        let series = Series {
            name: "length\r\nK0100 9".into(),
            unit: "mm".into(),
            values: vec![10.0, 10.5],
            parts: vec!["a".into(), "b\r\nK0001/1 99".into()],
            dates: vec!["2026-01-31T08:00:00Z".into(), "yesterday".into()],
            limits: Limits { lower: None, upper: Some(10.1 + 0.9 + 1e-15) },
            ..Series::default()
        };
        let studies = [study(series, StudySettings { subgroup: 1, confidence: 0.95 })];
        let text = render(&DfqInput { studies: &studies, remark: "store" });
        let lines: Vec<&str> = text.split("\r\n").collect();
        assert_eq!(lines[0], "K0100 1");
        assert!(lines.contains(&"K0004/1 31.01.2026/08:00:00") && lines.contains(&"K2111/1 11"), "{text}");
        assert!(lines.contains(&"K2120/1 0") && lines.contains(&"K2121/1 1"), "{text}");
        assert_eq!(lines.iter().filter(|line| line.starts_with("K0001/1")).count(), 2, "{text}");
        assert_eq!(lines.iter().filter(|line| line.starts_with("K0100")).count(), 1, "{text}");
        assert!(text.is_ascii());
    }
}
