//! Comma-separated values (RFC 4180): one line a characteristic and position, numbers with all their digits.

use super::words::verdict_key;
use crate::csv::field;
use metrology::acceptance::{Characteristic, PositionValue, TestReport};
use std::fmt::Write as _;

const HEAD: &str = "rule_set,standard,edition,test,test_verdict,symbol,name,decides,position,repeat,views,value_mm,points,\
                    rejected,worst,limit_mm,expanded_uncertainty_mm,verdict,retest,excluded,guard_factor,simulated";

/// The whole table, with its head. Lines end in CR LF.
pub fn render(report: &TestReport) -> String {
    let mut text = format!("{HEAD}\r\n");
    for one in &report.characteristics {
        for position in &one.positions {
            line(&mut text, report, one, Some(position));
        }
        if one.positions.is_empty() {
            line(&mut text, report, one, None);
        }
    }
    text
}

fn line(text: &mut String, report: &TestReport, one: &Characteristic, position: Option<&PositionValue>) {
    let set = &report.rule_set;
    let test = if report.reduced.is_empty() { "full" } else { "reduced" };
    let number = |value: Option<f64>| value.map_or_else(String::new, |v| v.to_string());
    let count = |value: Option<usize>| value.map_or_else(String::new, |v| v.to_string());
    let value = position.map_or(one.value, |p| p.value);
    let _ = write!(
        text,
        "{},{},{},{test},{},{},{},{},{},{},{},{value},{},{},{},{},{},{},{},{},{},{}\r\n",
        field(&set.id),
        field(&set.standard),
        field(&set.edition),
        verdict_key(Some(report.verdict)),
        field(&one.symbol),
        field(&one.name),
        one.decides,
        position.map_or_else(String::new, |p| field(&p.position)),
        count(position.map(|p| p.repeat as usize)),
        position.map_or_else(String::new, |p| field(&p.views.join(" "))),
        count(position.map(|p| p.points)),
        count(position.map(|p| p.rejected)),
        value == one.value && !position.is_some_and(|p| p.replaced),
        number(position.map_or(one.limit, |p| one.limit_of(p))),
        number(position.map_or(one.test_value_u, |p| p.test_value_u)),
        verdict_key(position.map_or(one.verdict, |p| p.verdict)),
        position.map_or("", |p| if p.replaced { "replaced" } else { "" }),
        count(position.map(|p| p.excluded)),
        report.guard_factor,
        report.simulated,
    );
}
