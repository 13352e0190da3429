//! All values of a characteristic beside its limit: zones of conformity, of doubt and of non-conformity.

use super::drawing::{Anchor, Drawing, Shape, Tone};
use super::words::{differing_limits, digits, judgement, verdict_key};
use crate::number::{fixed, signed, ticks};
use metrology::acceptance::{Characteristic, TestVerdict};

/// How large a chart is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Of the sheet.
    pub width: f64,
    /// Of the sheet.
    pub height: f64,
    /// Of the letters.
    pub letter: f64,
}

/// Room beyond the outermost value or limit, as a fraction.
const MARGIN: f64 = 0.18;

struct Frame {
    size: Size,
    left: f64,
    right: f64,
    top: f64,
    base: f64,
    low: f64,
    high: f64,
}

impl Frame {
    fn new(one: &Characteristic, size: Size) -> Self {
        let widest =
            one.positions.iter().filter_map(|p| one.limit_of(p)).fold(one.limit.unwrap_or(0.0), f64::max);
        let outermost = widest + guard(one);
        let largest = one.positions.iter().fold(one.value.abs().max(outermost), |m, p| m.max(p.value.abs()));
        let end = if largest > 0.0 { largest * (1.0 + MARGIN) } else { 1.0 };
        let signed = one.positions.iter().any(|p| p.value < 0.0) || one.value < 0.0;
        let letter = size.letter;
        Self {
            left: 5.0 * letter,
            right: size.width - 7.6 * letter,
            top: 2.4 * letter,
            base: size.height - 2.9 * letter,
            low: if signed { -end } else { 0.0 },
            high: end,
            size,
        }
    }

    fn y(&self, value: f64) -> f64 {
        let share = ((value - self.low) / (self.high - self.low)).clamp(0.0, 1.0);
        self.base - (self.base - self.top) * share
    }

    fn word(&self, at: [f64; 2], anchor: Anchor, tone: Tone, text: String) -> Shape {
        Shape::Word { at, size: self.size.letter, anchor, bold: false, tone, text }
    }

    fn across(&self, [from, to]: [f64; 2], value: f64, width: f64, tone: Tone) -> Shape {
        let y = self.y(value);
        Shape::Line { ends: [[from, y], [to, y]], width, tone }
    }

    fn band(&self, [left, right]: [f64; 2], from: f64, to: f64, tone: Tone) -> Shape {
        let (top, bottom) = (self.y(from.max(to)), self.y(from.min(to)));
        Shape::Area([left, top, right - left, bottom - top], tone)
    }

    /// Width of a position's place.
    fn slot(&self, numbers: &[usize]) -> f64 {
        (self.right - self.left) / numbers.last().copied().unwrap_or(1).max(1) as f64
    }
}

/// From where to where each limit holds: over the whole width where it is the same at all positions.
fn spans(frame: &Frame, one: &Characteristic) -> Vec<([f64; 2], f64)> {
    if let (Some(limit), true) = (one.limit, differing_limits(one).is_none()) {
        return vec![([frame.left, frame.right], limit)];
    }
    let numbers = numbers(one);
    let slot = frame.slot(&numbers);
    let place = |number: usize| frame.left + slot * (number as f64 - 1.0);
    let mut spans: Vec<([f64; 2], f64)> = Vec::new();
    for (position, number) in one.positions.iter().zip(numbers) {
        let Some(limit) = one.limit_of(position) else { continue };
        match spans.last_mut() {
            Some((ends, last)) if *last == limit => ends[1] = place(number + 1),
            _ => spans.push(([place(number), place(number + 1)], limit)),
        }
    }
    spans
}

/// Half width of the zone of doubt: the stated uncertainty, which never reaches beyond zero.
fn guard(one: &Characteristic) -> f64 {
    one.test_value_u.unwrap_or(0.0).min(one.limit.unwrap_or(0.0))
}

/// The chart.
pub fn chart(one: &Characteristic, size: Size) -> Drawing {
    let frame = Frame::new(one, size);
    let mut shapes = Vec::new();
    zones(&mut shapes, &frame, one);
    axis(&mut shapes, &frame);
    limits(&mut shapes, &frame, one);
    points(&mut shapes, &frame, one);
    let letter = size.letter;
    shapes.push(Shape::Word {
        at: [0.4 * letter, 1.2 * letter],
        size: 1.1 * letter,
        anchor: Anchor::Start,
        bold: true,
        tone: Tone::Ink,
        text: format!("{}, mm", one.symbol),
    });
    shapes.push(Shape::Word {
        at: [frame.right, 1.2 * letter],
        size: 1.1 * letter,
        anchor: Anchor::End,
        bold: true,
        tone: tone_of(one.verdict),
        text: judgement(one).to_owned(),
    });
    let label = format!("values of {} at all positions, verdict {}", one.symbol, verdict_key(one.verdict));
    Drawing { width: size.width, height: size.height, shapes, label }
}

/// The colour of a verdict.
pub fn tone_of(verdict: Option<TestVerdict>) -> Tone {
    match verdict {
        Some(TestVerdict::Pass) => Tone::Pass,
        Some(TestVerdict::Indeterminate) => Tone::Doubt,
        Some(TestVerdict::Fail) => Tone::Fail,
        None => Tone::Soft,
    }
}

fn zones(shapes: &mut Vec<Shape>, frame: &Frame, one: &Characteristic) {
    let guard = guard(one);
    for (ends, limit) in spans(frame, one) {
        shapes.push(frame.band(ends, frame.low, frame.high, Tone::FailArea));
        shapes.push(frame.band(ends, -limit - guard, limit + guard, Tone::DoubtArea));
        shapes.push(frame.band(ends, guard - limit, limit - guard, Tone::PassArea));
    }
}

/// Lines of the limits; the last stands in numbers beside them.
fn limits(shapes: &mut Vec<Shape>, frame: &Frame, one: &Characteristic) {
    let (digits, spans) = (digits(one), spans(frame, one));
    for (index, (ends, limit)) in spans.iter().enumerate() {
        for value in [*limit, -limit].into_iter().filter(|value| *value >= frame.low) {
            shapes.push(frame.across(*ends, value, 1.2, Tone::Fail));
            if index + 1 == spans.len() {
                let letter = frame.size.letter;
                let at = [frame.right + 0.4 * letter, frame.y(value) + 0.35 * letter];
                shapes.push(frame.word(
                    at,
                    Anchor::Start,
                    Tone::Fail,
                    format!("{} MPE", signed(value, digits)),
                ));
            }
        }
    }
}

fn axis(shapes: &mut Vec<Shape>, frame: &Frame) {
    let letter = frame.size.letter;
    let whole = [frame.left, frame.right];
    let (values, digits) = ticks(frame.low, frame.high, 7);
    for value in values {
        shapes.push(frame.across(whole, value, 0.5, Tone::Line));
        let at = [frame.left - 0.5 * letter, frame.y(value) + 0.35 * letter];
        let text = if frame.low < 0.0 { signed(value, digits) } else { fixed(value, digits) };
        shapes.push(frame.word(at, Anchor::End, Tone::Soft, text));
    }
    shapes.push(frame.across(whole, 0.0, 1.0, Tone::Ink));
}

/// Values over the number of the position; repeats of a position stand side by side over its number.
fn points(shapes: &mut Vec<Shape>, frame: &Frame, one: &Characteristic) {
    let numbers = numbers(one);
    let slot = frame.slot(&numbers);
    let letter = frame.size.letter;
    let every = ((1.6 * letter / slot).ceil() as usize).max(1);
    for (index, position) in one.positions.iter().enumerate() {
        let number = numbers[index];
        let same = numbers.iter().filter(|n| **n == number).count();
        let before = numbers[..index].iter().filter(|n| **n == number).count();
        let step = (slot * 0.6 / same as f64).min(1.2 * letter);
        let middle = frame.left + slot * (number as f64 - 0.5);
        let x = middle + step * (before as f64 - (same as f64 - 1.0) / 2.0);
        let y = frame.y(position.value);
        let ends = [[x, frame.y(0.0)], [x, y]];
        shapes.push(Shape::Line { ends, width: 0.7, tone: Tone::Soft });
        shapes.push(Shape::Dot { at: [x, y], radius: 0.34 * letter, tone: Tone::Ink });
        if before == 0 && (number - 1).is_multiple_of(every) {
            let at = [middle, frame.base + 1.2 * letter];
            shapes.push(frame.word(at, Anchor::Middle, Tone::Soft, number.to_string()));
        }
    }
    let at = [f64::midpoint(frame.left, frame.right), frame.size.height - 0.4 * letter];
    shapes.push(frame.word(at, Anchor::Middle, Tone::Soft, "Number of the position".to_owned()));
}

/// Numbers of positions from 1, in the order of the plan: equal name and views, equal number.
pub fn numbers(one: &Characteristic) -> Vec<usize> {
    let mut known: Vec<(&str, &[String])> = Vec::new();
    let mut numbers = Vec::with_capacity(one.positions.len());
    for position in &one.positions {
        let key = (position.position.as_str(), position.views.as_slice());
        let at = known.iter().position(|k| *k == key).unwrap_or_else(|| {
            known.push(key);
            known.len() - 1
        });
        numbers.push(at + 1);
    }
    numbers
}
