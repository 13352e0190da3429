//! Checks of a projected sequence, shared by configurations and recordings.

use crate::document::Document;
use crate::error::{FileError, Problem};
use fringe::pattern::{Axis, PatternSet, frame_count};

/// Most frames of one sequence: 64 steps in 16 sets; more is a typing error that would fill the disk.
const FRAMES_LIMIT: usize = 1024;

/// Checks sizes and every set of a sequence under the key of its `[[projector]]`.
pub(crate) fn check_sequence(
    document: &Document,
    key: &str,
    size_px: [u32; 2],
    sequence: &[PatternSet],
) -> Result<(), FileError> {
    for (part, size) in ["width_px", "height_px"].into_iter().zip(size_px) {
        if !(1..=65_535).contains(&size) {
            let problem = Problem::Value { value: size.to_string(), limit: "1 … 65535".into() };
            return Err(document.fault(&format!("{key}.{part}"), problem, ""));
        }
    }
    if sequence.is_empty() {
        let problem = Problem::Missing("a set".into());
        return Err(document.fault(&format!("{key}.sequence"), problem, "name what is projected"));
    }
    for (index, set) in sequence.iter().enumerate() {
        let key = format!("{key}.sequence[{index}]");
        set.check().map_err(|error| document.fault(&key, Problem::Pattern(error), ""))?;
    }
    let frames = frame_count(sequence);
    if !(1..=FRAMES_LIMIT).contains(&frames) {
        let problem =
            Problem::Value { value: format!("{frames} frames"), limit: format!("1 … {FRAMES_LIMIT}") };
        return Err(document.fault(&format!("{key}.sequence"), problem, "split the sequence"));
    }
    Ok(())
}

/// Demands an axis whose absolute phase the sequence can tell.
pub(crate) fn check_absolute(
    document: &Document,
    key: &str,
    size_px: [u32; 2],
    sequence: &[PatternSet],
) -> Result<(), FileError> {
    let key = format!("{key}.sequence");
    let axes = [(Axis::X, size_px[0]), (Axis::Y, size_px[1])];
    let has_sine =
        |axis| sequence.iter().any(|set| matches!(set, PatternSet::Sine { axis: a, .. } if *a == axis));
    if !axes.iter().any(|(axis, _)| has_sine(*axis)) {
        let problem = Problem::Missing("a sine set".into());
        return Err(document.fault(&key, problem, "the phase comes from { set = \"sine\", … }"));
    }
    if !axes.iter().any(|(axis, size)| has_sine(*axis) && is_absolute(*axis, *size, sequence)) {
        let problem = Problem::Missing("an absolute code beside the sines".into());
        let remedy = "add a gray set on the same axis, a second period, or a sine as wide as the projector";
        return Err(document.fault(&key, problem, remedy));
    }
    for (index, set) in sequence.iter().enumerate() {
        let PatternSet::Gray { axis, bits, stripe_px, .. } = set else { continue };
        let size = if *axis == Axis::X { size_px[0] } else { size_px[1] };
        let covered = f64::from(1_u32 << bits) * stripe_px;
        if covered < f64::from(size) {
            let problem = Problem::Disagreement {
                what: "code and projector",
                here: format!("{bits} bits of {stripe_px} px tell {covered} px apart"),
                there: format!("the projector has {size} px along this axis"),
            };
            return Err(document.fault(&format!("{key}[{index}]"), problem, "add bits"));
        }
    }
    Ok(())
}

fn is_absolute(axis: Axis, size_px: u32, sequence: &[PatternSet]) -> bool {
    let on_axis = || sequence.iter().filter(|set| set.axis() == Some(axis));
    let coded = on_axis().any(|set| matches!(set, PatternSet::Gray { .. } | PatternSet::Stair { .. }));
    let periods: Vec<f64> = on_axis()
        .filter_map(|set| if let PatternSet::Sine { period_px, .. } = set { Some(*period_px) } else { None })
        .collect();
    coded || periods.iter().any(|p| *p >= f64::from(size_px)) || periods.iter().any(|p| *p != periods[0])
}
