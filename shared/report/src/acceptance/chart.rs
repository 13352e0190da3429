//! All values of a characteristic beside its limit: zones of conformity, of doubt and of non-conformity.

use super::drawing::{Anchor, Drawing, Shape, Tone};
use super::words::{digits, judgement, verdict_key};
use crate::number::{fixed, signed, ticks};
use metrology::acceptance::{Characteristic, PositionValue};
use metrology::verdict::Verdict;

/// How large a chart is drawn.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Width of the drawing, in its own units.
    pub width: f64,
    /// Height of the drawing, in its own units.
    pub height: f64,
    /// Height of the letters, in the same units.
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
    fn new(one: &Characteristic, guard_factor: f64, size: Size) -> Self {
        let outermost = one
            .positions
            .iter()
            .filter_map(|p| Some(one.limit_of(p)? + guard_mm(one, p, guard_factor)))
            .fold(one.limit.unwrap_or(0.0), f64::max);
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
        (self.right - self.left) / numbers.iter().copied().max().unwrap_or(1).max(1) as f64
    }
}

/// A limit with its guard band, both mm, and from where to where they hold.
struct Span {
    ends: [f64; 2],
    limit: f64,
    guard: f64,
}

/// Over the whole width where limit and guard band are the same at all positions.
fn spans(frame: &Frame, one: &Characteristic, guard_factor: f64) -> Vec<Span> {
    let numbers = numbers(one);
    let slot = frame.slot(&numbers);
    let last = numbers.iter().copied().max().unwrap_or(0);
    let mut spans: Vec<Span> = Vec::new();
    for number in 1..=last {
        // Repeats of a position have one place: its limit, and the widest of their guard bands.
        let here = || one.positions.iter().zip(&numbers).filter(move |(_, n)| **n == number).map(|(p, _)| p);
        let Some(limit) = here().find_map(|p| one.limit_of(p)) else { continue };
        let guard = here().map(|p| guard_mm(one, p, guard_factor)).fold(0.0, f64::max);
        let left = frame.left + slot * (number as f64 - 1.0);
        match spans.last_mut() {
            Some(span) if span.limit == limit && span.guard == guard => span.ends[1] = left + slot,
            _ => spans.push(Span { ends: [left, left + slot], limit, guard }),
        }
    }
    spans
}

/// The guard band that decides about a value: the guard factor times its standard uncertainty. It never reaches beyond zero.
fn guard_mm(one: &Characteristic, position: &PositionValue, guard_factor: f64) -> f64 {
    let expanded = position.test_value_u.or(one.test_value_u).unwrap_or(0.0);
    (0.5 * guard_factor * expanded).min(one.limit_of(position).unwrap_or(0.0))
}

/// Draws the chart of one characteristic.
pub fn chart(one: &Characteristic, guard_factor: f64, size: Size) -> Drawing {
    let frame = Frame::new(one, guard_factor, size);
    let spans = spans(&frame, one, guard_factor);
    let mut shapes = Vec::new();
    zones(&mut shapes, &frame, &spans);
    axis(&mut shapes, &frame);
    limits(&mut shapes, &frame, one, &spans);
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
pub fn tone_of(verdict: Option<Verdict>) -> Tone {
    match verdict {
        Some(Verdict::Pass) => Tone::Pass,
        Some(Verdict::Indeterminate) => Tone::Doubt,
        Some(Verdict::Fail) => Tone::Fail,
        None => Tone::Soft,
    }
}

fn zones(shapes: &mut Vec<Shape>, frame: &Frame, spans: &[Span]) {
    for Span { ends, limit, guard } in spans {
        let (ends, limit, guard) = (*ends, *limit, *guard);
        shapes.push(frame.band(ends, frame.low, frame.high, Tone::FailArea));
        shapes.push(frame.band(ends, -limit - guard, limit + guard, Tone::DoubtArea));
        shapes.push(frame.band(ends, guard - limit, limit - guard, Tone::PassArea));
    }
}

/// Lines of the limits; the last stands in numbers beside them.
fn limits(shapes: &mut Vec<Shape>, frame: &Frame, one: &Characteristic, spans: &[Span]) {
    let digits = digits(one);
    for (index, Span { ends, limit, .. }) in spans.iter().enumerate() {
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
        // A value that a retest replaced stays, pale; one that does not pass has the colour of its own verdict.
        let tone = match (position.replaced, position.verdict) {
            (true, _) => Tone::Soft,
            (false, Some(Verdict::Pass) | None) => Tone::Ink,
            (false, verdict) => tone_of(verdict),
        };
        shapes.push(Shape::Dot { at: [x, y], radius: 0.34 * letter, tone });
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
