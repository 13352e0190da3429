//! All values of a characteristic beside its limit: zones of conformity, of doubt and of non-conformity.

use super::drawing::{Anchor, Drawing, Shape, Tone};
use super::words::{digits, judgement, verdict_key};
use crate::report::number::{fixed, signed, ticks};
use fringe::acceptance::{Characteristic, TestVerdict};

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
        let outermost = one.limit.unwrap_or(0.0) + guard(one);
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

    fn across(&self, value: f64, width: f64, dashed: bool, tone: Tone) -> Shape {
        let y = self.y(value);
        Shape::Line { ends: [[self.left, y], [self.right, y]], width, dashed, tone }
    }

    fn band(&self, from: f64, to: f64, tone: Tone) -> Shape {
        let (top, bottom) = (self.y(from.max(to)), self.y(from.min(to)));
        Shape::Area([self.left, top, self.right - self.left, bottom - top], tone)
    }
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
    let Some(limit) = one.limit else { return };
    let guard = guard(one);
    shapes.push(frame.band(frame.low, frame.high, Tone::FailArea));
    shapes.push(frame.band(-limit - guard, limit + guard, Tone::DoubtArea));
    shapes.push(frame.band(guard - limit, limit - guard, Tone::PassArea));
}

fn limits(shapes: &mut Vec<Shape>, frame: &Frame, one: &Characteristic) {
    let Some(limit) = one.limit else { return };
    let digits = digits(one);
    for value in [limit, -limit] {
        if value < frame.low {
            continue;
        }
        shapes.push(frame.across(value, 1.2, false, Tone::Fail));
        let letter = frame.size.letter;
        let at = [frame.right + 0.4 * letter, frame.y(value) + 0.35 * letter];
        shapes.push(frame.word(at, Anchor::Start, Tone::Fail, format!("{} MPE", signed(value, digits))));
    }
}

fn axis(shapes: &mut Vec<Shape>, frame: &Frame) {
    let letter = frame.size.letter;
    let (values, digits) = ticks(frame.low, frame.high, 7);
    for value in values {
        shapes.push(frame.across(value, 0.5, false, Tone::Line));
        let at = [frame.left - 0.5 * letter, frame.y(value) + 0.35 * letter];
        let text = if frame.low < 0.0 { signed(value, digits) } else { fixed(value, digits) };
        shapes.push(frame.word(at, Anchor::End, Tone::Soft, text));
    }
    shapes.push(frame.across(0.0, 1.0, false, Tone::Ink));
}

/// Values over the number of the position; repeats of a position stand side by side over its number.
fn points(shapes: &mut Vec<Shape>, frame: &Frame, one: &Characteristic) {
    let numbers = numbers(one);
    let slots = numbers.last().copied().unwrap_or(1).max(1);
    let slot = (frame.right - frame.left) / slots as f64;
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
        shapes.push(Shape::Line { ends, width: 0.7, dashed: false, tone: Tone::Soft });
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
