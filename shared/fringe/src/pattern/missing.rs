//! What is left of a sequence when frames of it are missing.

use super::{PatternError, PatternSet, frame_count, locate};
use std::collections::BTreeSet;

/// A sequence without its missing frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Remaining {
    /// The sets that are left; a set may have fewer frames than before.
    pub sequence: Vec<PatternSet>,
    /// Numbers of their frames in the whole sequence, from 0.
    pub frames: Vec<usize>,
    /// What became of each set that misses frames, for people.
    pub notes: Vec<String>,
}

/// What is left of one set: as which set its frames count, and which of them.
struct Part {
    set: PatternSet,
    steps: Vec<usize>,
    became: String,
}

/// Takes frames out of a sequence: sines keep their other steps, a code without its last bits has wider stripes, a code without another bit is left to
/// its inverse, other sets are left out. Whether the rest determines a phase is for the decoder to say.
///
/// # Errors
/// A frame beyond the sequence; steps of a sine that leave its phase open; a code that misses bits and has no whole inverse.
pub fn without(sequence: &[PatternSet], missing: &BTreeSet<usize>) -> Result<Remaining, PatternError> {
    let count = frame_count(sequence);
    if let Some(frame) = missing.iter().find(|frame| **frame >= count) {
        return Err(PatternError::MissingBeyond { frame: *frame, count });
    }
    let mut left = Remaining { sequence: Vec::new(), frames: Vec::new(), notes: Vec::new() };
    let gone: Vec<(usize, usize)> = missing.iter().filter_map(|frame| locate(sequence, *frame)).collect();
    let lacks = |index: usize| -> BTreeSet<usize> {
        gone.iter().filter(|(set, _)| *set == index).map(|(_, step)| *step).collect()
    };
    let mut first = 0;
    for (index, set) in sequence.iter().enumerate() {
        let frames = set.frames();
        let lost = lacks(index);
        if lost.is_empty() {
            left.sequence.push(set.clone());
            left.frames.extend(first..first + frames);
        } else {
            let inverse = sequence
                .iter()
                .enumerate()
                .any(|(other, candidate)| set.is_inverse_of(candidate) && lacks(other).is_empty());
            let part = part(set, &lost, inverse)?;
            let names: Vec<String> = lost.iter().map(|step| (step + 1).to_string()).collect();
            let became = part.as_ref().map_or("the set is left out".to_owned(), |part| part.became.clone());
            let (number, name) = (index + 1, set.name());
            left.notes.push(format!(
                "set {number} (\"{name}\") misses frame {} of {frames}: {became}",
                names.join(", ")
            ));
            if let Some(part) = part {
                part.set.check()?;
                left.sequence.push(part.set);
                left.frames.extend(part.steps.iter().map(|step| first + step));
            }
        }
        first += frames;
    }
    Ok(left)
}

/// What is left of a set; none where it is of no use without the lost frames.
fn part(set: &PatternSet, lost: &BTreeSet<usize>, inverse: bool) -> Result<Option<Part>, PatternError> {
    let steps: Vec<usize> = (0..set.frames()).filter(|step| !lost.contains(step)).collect();
    match set {
        PatternSet::Sine { axis, period_px, direction, .. } => {
            let shifts_rad = steps.iter().map(|step| direction.sign() * set.step_rad(*step)).collect();
            let rest = PatternSet::Sine {
                axis: *axis,
                period_px: *period_px,
                steps: steps.len() as u32,
                first_step_rad: 0.0,
                direction: *direction,
                shifts_rad,
            };
            let became = format!("decoded from the other {} steps", steps.len());
            Ok(Some(Part { set: rest, steps, became }))
        }
        PatternSet::Gray { axis, bits, stripe_px, shift_px, invert, code, threshold } => {
            let kept = steps.len();
            if kept > 0 && steps == (0..kept).collect::<Vec<_>>() {
                let stripe_px = stripe_px * f64::from(1_u32 << (*bits - kept as u32).min(16));
                let rest = PatternSet::Gray {
                    axis: *axis,
                    bits: kept as u32,
                    stripe_px,
                    shift_px: *shift_px,
                    invert: *invert,
                    code: *code,
                    threshold: *threshold,
                };
                let became = format!("decoded as {kept} bits with stripes of {stripe_px} px");
                Ok(Some(Part { set: rest, steps, became }))
            } else if inverse {
                Ok(None)
            } else {
                let lost = lost.iter().next().map_or(0, |bit| bit + 1);
                Err(PatternError::MissingBit { bit: lost, bits: *bits })
            }
        }
        _ => Ok(None),
    }
}

impl PatternSet {
    /// Whether two sets are a code and its inverse, which show the same stripes with light and dark exchanged.
    pub fn is_inverse_of(&self, other: &Self) -> bool {
        match (self, other) {
            (
                Self::Gray { axis: a, bits: b, stripe_px: s, shift_px: h, invert: i, code: c, .. },
                Self::Gray { axis: oa, bits: ob, stripe_px: os, shift_px: oh, invert: oi, code: oc, .. },
            ) => a == oa && b == ob && s == os && h == oh && c == oc && i != oi,
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pattern::{Axis, Code};

    fn code(bits: u32, stripe_px: f64, invert: bool) -> PatternSet {
        PatternSet::Gray {
            axis: Axis::X,
            bits,
            stripe_px,
            shift_px: 0.0,
            invert,
            code: Code::Gray,
            threshold: None,
        }
    }

    #[test]
    fn a_code_without_its_last_bit_has_stripes_of_twice_the_width() {
        let sequence = [PatternSet::sine(Axis::X, 16.0, 4), code(7, 8.0, false), PatternSet::White {}];
        let left = without(&sequence, &BTreeSet::from([10])).unwrap();
        assert_eq!(left.sequence, [sequence[0].clone(), code(6, 16.0, false), PatternSet::White {}]);
        assert_eq!(left.frames, (0..12).filter(|frame| *frame != 10).collect::<Vec<_>>());
        assert!(left.notes[0].contains("set 2 (\"gray\") misses frame 7 of 7"), "{:?}", left.notes);
        // What remains shows the same on each pixel as the frames of the new set do.
        for (new, old) in left.frames.iter().enumerate().filter(|(new, _)| (4..10).contains(new)) {
            for x in 0..608 {
                let level = |set: &PatternSet, step| set.intensity(step, f64::from(x), 608).unwrap();
                assert_eq!(level(&left.sequence[1], new - 4), level(&sequence[1], old - 4), "{x}");
            }
        }
    }

    #[test]
    fn steps_of_a_sine_keep_their_phases() {
        for direction in [crate::pattern::Direction::Forward, crate::pattern::Direction::Backward] {
            let sine = PatternSet::Sine {
                axis: Axis::X,
                period_px: 16.0,
                steps: 6,
                first_step_rad: 0.3,
                direction,
                shifts_rad: Vec::new(),
            };
            let left = without(std::slice::from_ref(&sine), &BTreeSet::from([1, 4])).unwrap();
            assert_eq!(left.frames, [0, 2, 3, 5]);
            for (new, old) in left.frames.iter().enumerate() {
                assert!((left.sequence[0].step_rad(new) - sine.step_rad(*old)).abs() < 1e-12);
            }
            let error = without(&[sine], &BTreeSet::from([0, 1, 2, 3])).unwrap_err();
            assert!(error.to_string().contains("steps = 2"), "{error}");
        }
    }

    #[test]
    fn a_code_that_misses_another_bit_is_left_to_its_inverse_or_refused() {
        let sequence = [code(7, 8.0, false), code(7, 8.0, true), PatternSet::White {}, PatternSet::Black {}];
        let left = without(&sequence, &BTreeSet::from([2])).unwrap();
        assert_eq!(left.sequence, sequence[1..]);
        assert_eq!(left.frames, (7..16).collect::<Vec<_>>());
        let error = without(&sequence[..1], &BTreeSet::from([2])).unwrap_err();
        assert!(error.to_string().contains("bit 3 of 7"), "{error}");
        let error = without(&sequence, &BTreeSet::from([2, 9])).unwrap_err();
        assert!(error.to_string().contains("bit 3 of 7"), "{error}");
        let error = without(&sequence, &BTreeSet::from([16])).unwrap_err();
        assert!(error.to_string().contains("frame 16"), "{error}");
        assert_eq!(without(&sequence, &BTreeSet::from([14])).unwrap().sequence.len(), 3);
    }
}
