//! Names of the files of a foreign recording: patterns with places for numbers.

use super::RawCamera;
use crate::document::Document;
use crate::error::{FileError, Problem};
use fringe::pattern::{PatternSet, frame_count};

/// Digits of a frame's number in a file name: more than any number has.
const MOST_DIGITS: usize = 20;

/// A place for a number in a pattern: which number, and its least digits.
enum Part<'a> {
    Text(&'a str),
    Number(char, usize),
}

/// The parts of a pattern; `None` where it has no place for a number or a place for something else.
fn parts(pattern: &str) -> Option<Vec<Part<'_>>> {
    let mut parts = Vec::new();
    let mut rest = pattern;
    while let Some((head, tail)) = rest.split_once('{') {
        let (hole, after) = tail.split_once('}')?;
        let letter = hole.chars().next()?;
        let plain = hole.len() <= MOST_DIGITS && "nsi".contains(letter) && hole.chars().all(|c| c == letter);
        if !plain {
            return None;
        }
        parts.extend([Part::Text(head), Part::Number(letter, hole.len())]);
        rest = after;
    }
    let any = !parts.is_empty();
    parts.push(Part::Text(rest));
    any.then_some(parts)
}

/// The names of all frames by a pattern.
pub(super) fn numbered(
    document: &Document,
    key: &str,
    pattern: &str,
    camera: &RawCamera,
    sequence: &[PatternSet],
) -> Result<Vec<String>, FileError> {
    let Some(parts) = parts(pattern) else {
        let problem = Problem::Value {
            value: format!("\"{pattern}\""),
            limit: format!(
                "a pattern has one place for the number: {{n}}, {{nn}}, {{nnn}}, at most {MOST_DIGITS} n; or places for \
                 the number of the set {{s}} and of the frame in it {{i}}"
            ),
        };
        return Err(document.fault(&format!("{key}.files"), problem, "such as \"left/{nn}.png\""));
    };
    let (first, every) = (camera.first.unwrap_or(0), camera.every.unwrap_or(1).max(1));
    let last = every.checked_mul(frame_count(sequence)).and_then(|span| first.checked_add(span));
    let highest = [camera.first_set, camera.first_step].into_iter().flatten().max().unwrap_or(0);
    if last.is_none() || highest > u32::MAX as usize {
        let problem =
            Problem::Value { value: first.max(highest).to_string(), limit: "the number of a file".into() };
        return Err(document.fault(&format!("{key}.first"), problem, ""));
    }
    let mut names = Vec::new();
    for (set, patterns) in sequence.iter().enumerate() {
        for step in 0..patterns.frames() {
            let number = |letter: &char| match letter {
                'n' => first + every * names.len(),
                's' => camera.first_set.unwrap_or(0) + set,
                _ => camera.first_step.unwrap_or(0) + step,
            };
            let name = parts.iter().map(|part| match part {
                Part::Text(text) => (*text).to_owned(),
                Part::Number(letter, digits) => format!("{:0digits$}", number(letter), digits = *digits),
            });
            let name: String = name.collect();
            names.push(name);
        }
    }
    Ok(names)
}
