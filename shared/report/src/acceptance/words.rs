//! The words of the report, once for all formats.

use crate::number::{NONE, decimals, limit, limit_decimals, signed};
use metrology::acceptance::{Characteristic, TestReport};
use metrology::verdict::Verdict;

/// As a banner shows it.
pub fn verdict_word(verdict: Option<Verdict>) -> &'static str {
    verdict.map_or(NONE, Verdict::word)
}

/// As the master and style sheets name it.
pub fn verdict_key(verdict: Option<Verdict>) -> &'static str {
    verdict.map_or("none", Verdict::key)
}

/// What the table of characteristics states.
pub fn judgement(one: &Characteristic) -> &'static str {
    match (one.verdict, one.decides) {
        (None, true) => "no limit given",
        (None, false) => "for information",
        (verdict, _) => verdict_word(verdict),
    }
}

/// Digits after the point of a characteristic: two significant ones of its uncertainty, those of its limit at least.
pub fn digits(one: &Characteristic) -> usize {
    decimals(one.test_value_u).max(limit_decimals(one.limit)).clamp(3, 6)
}

/// The limit as people write it.
pub fn limit_text(one: &Characteristic) -> String {
    match one.limit {
        Some(_) => format!("±{}", limit(one.limit, digits(one))),
        None => NONE.to_owned(),
    }
}

/// Where the limit differs with the length: what stands in the place of one limit for all.
pub fn differing_limits(one: &Characteristic) -> Option<String> {
    (one.limit.is_some() && one.common_limit().is_none()).then(|| {
        format!(
            "MPE grows with the length, {} mm at the worst value; no one limit holds for all",
            limit_text(one)
        )
    })
}

/// Where the worst value occurred.
pub fn worst_position(one: &Characteristic) -> String {
    let worst = one.positions.iter().find(|p| p.value == one.value && !p.replaced);
    worst.map_or_else(
        || "derived".to_owned(),
        |p| {
            let many = one.positions.iter().any(|q| q.repeat > 1);
            if many { format!("{}, repeat {}", p.position, p.repeat) } else { p.position.clone() }
        },
    )
}

/// The verdict in plain words, a sentence each.
pub fn sentences(report: &TestReport) -> Vec<String> {
    let evaluated: Vec<_> =
        report.characteristics.iter().filter(|c| c.decides || c.limit.is_some()).collect();
    let with = |verdict| evaluated.iter().filter(move |c| c.limit.is_some() && c.verdict == Some(verdict));
    let list = |verdict| with(verdict).map(|c| with_numbers(c)).collect::<Vec<_>>().join("; ");
    let mut text = Vec::new();
    match report.verdict {
        Verdict::Pass => text.push(format!(
            "Every value at every position keeps its limit, for all {} characteristics that decide.",
            evaluated.len()
        )),
        Verdict::Fail => text.push(format!(
            "Beyond the limit, {} of {} characteristics: {}.",
            with(Verdict::Fail).count(),
            evaluated.len(),
            list(Verdict::Fail)
        )),
        Verdict::Indeterminate => {
            text.push(
                "The test proves neither that the limits are kept nor that they are broken.".to_owned(),
            );
        }
    }
    if with(Verdict::Indeterminate).count() > 0 {
        text.push(format!("Nearer to the limit than the guard band: {}.", list(Verdict::Indeterminate)));
    }
    let open: Vec<_> = evaluated.iter().filter(|c| c.limit.is_none()).map(|c| c.symbol.as_str()).collect();
    if !open.is_empty() {
        text.push(format!("No limit was given for {}.", open.join(", ")));
    }
    if report.characteristics.iter().any(|c| c.positions.iter().any(|p| p.replaced)) {
        text.push(
            "A retest took the place of values that broke their limit; they stand in the table.".to_owned(),
        );
    }
    if report.simulated {
        text.push("The recordings are simulated: no instrument was tested.".to_owned());
    }
    text
}

fn with_numbers(one: &Characteristic) -> String {
    let value = signed(one.value, digits(one));
    format!("{} {value} mm at {}, limit {} mm", one.symbol, worst_position(one), limit_text(one))
}

/// Without line ends and control characters: a space each.
pub fn one_line(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() || matches!(c, '\u{2028}' | '\u{2029}') { ' ' } else { c })
        .collect()
}

/// ASCII that means the same as far as it can; `?` for the rest.
pub fn plain(text: &str) -> String {
    let mut ascii = String::with_capacity(text.len());
    for sign in text.chars() {
        match sign {
            ' '..='~' => ascii.push(sign),
            '\u{a0}' | '\u{2009}' | '\u{202f}' => ascii.push(' '),
            '–' | '—' | '−' | '\u{2010}' | '\u{2011}' => ascii.push('-'),
            '‘' | '’' => ascii.push('\''),
            '“' | '”' | '„' => ascii.push('"'),
            '…' => ascii.push_str("..."),
            '±' => ascii.push_str("+-"),
            '×' | '·' => ascii.push('*'),
            '≤' => ascii.push_str("<="),
            '≥' => ascii.push_str(">="),
            '√' => ascii.push_str("sqrt"),
            '²' => ascii.push('2'),
            '³' => ascii.push('3'),
            'µ' | 'μ' => ascii.push('u'),
            '°' => ascii.push_str("deg"),
            'ä' => ascii.push_str("ae"),
            'ö' => ascii.push_str("oe"),
            'ü' => ascii.push_str("ue"),
            'Ä' => ascii.push_str("Ae"),
            'Ö' => ascii.push_str("Oe"),
            'Ü' => ascii.push_str("Ue"),
            'ß' => ascii.push_str("ss"),
            _ => ascii.push('?'),
        }
    }
    ascii
}
