//! Checks of a projected sequence, shared by configurations and recordings.

use crate::document::Document;
use crate::error::{FileError, Problem};
use fringe::pattern::{PatternSet, frame_count};

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
