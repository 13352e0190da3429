//! Q-DAS ASCII transfer format (AQDEF): K-fields of part and characteristics, then the values, one file.
//!
//! Fields: K0100 number of characteristics; K1001, K1002 part; K1900 remark; per characteristic i K2001 number, K2002
//! name, K2022 decimals, K2101 nominal, K2110 and K2111 limits, K2142 unit, K2900 remark; per value K0001 value, K0002
//! attribute (0: valid), K0009 text. Characteristics have different numbers of values, so each value names its own
//! (`K0001/i`). Where the limit differs with the length the fields of limits stay empty, because each holds for all values of
//! its characteristic; the remark states it. ASCII only, fields as long as AQDEF allows, lines end in CR LF.

use super::words::differing_limits;
use crate::number::decimals;
use crate::qdas::{NAME, NUMBER, PART, REMARK, field, value};
use metrology::acceptance::{Characteristic, TestReport};

/// Renders the file in the Q-DAS transfer format.
pub fn render(report: &TestReport) -> String {
    let mut text = String::new();
    let set = &report.rule_set;
    field(&mut text, "K0100", &report.characteristics.len().to_string(), NUMBER);
    field(&mut text, "K1001", &set.id, PART);
    let reduced = if report.reduced.is_empty() { "" } else { "REDUCED TEST, " };
    let simulated = if report.simulated { "SIMULATED, " } else { "" };
    field(&mut text, "K1002", &format!("{simulated}{reduced}{}", set.standard), NAME);
    let verdict = super::words::verdict_word(Some(report.verdict));
    field(&mut text, "K1900", &format!("{simulated}{reduced}{}; verdict {verdict}", set.wording), REMARK);
    for (index, one) in report.characteristics.iter().enumerate() {
        describe(&mut text, index + 1, one);
    }
    for (index, one) in report.characteristics.iter().enumerate() {
        values(&mut text, index + 1, one);
    }
    text
}

fn describe(text: &mut String, i: usize, one: &Characteristic) {
    field(text, &format!("K2001/{i}"), &i.to_string(), NUMBER);
    field(text, &format!("K2002/{i}"), &format!("{} {}", one.symbol, one.name), NAME);
    let digits = decimals(one.test_value_u).clamp(4, 6);
    field(text, &format!("K2022/{i}"), &digits.to_string(), NUMBER);
    // All are errors: nominally zero.
    field(text, &format!("K2101/{i}"), "0", NUMBER);
    if let Some(limit) = one.common_limit() {
        field(text, &format!("K2110/{i}"), &(-limit).to_string(), NUMBER);
        field(text, &format!("K2111/{i}"), &limit.to_string(), NUMBER);
    }
    field(text, &format!("K2142/{i}"), &one.unit, NUMBER);
    let remark = differing_limits(one).map_or_else(String::new, |limits| format!("{limits}. "));
    field(text, &format!("K2900/{i}"), &format!("{remark}{}", one.definition), REMARK);
}

fn values(text: &mut String, i: usize, one: &Characteristic) {
    for position in &one.positions {
        value(text, i, position.value);
        let again = if position.replaced { ", replaced by a retest" } else { "" };
        let place = format!("{} repeat {}{again}", position.position, position.repeat);
        field(text, &format!("K0009/{i}"), &place, REMARK);
    }
    if one.positions.is_empty() {
        value(text, i, one.value);
    }
}
