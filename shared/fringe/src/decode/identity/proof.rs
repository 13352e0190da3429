//! Whether the frames of a sequence can prove their order, known before any frame is taken.

use super::event::OrderEvent;
use super::templates::{Arrangement, SUSPECT, Templates, has_check};
use crate::decode::error::DecodeError;
use crate::math::random::Key;
use crate::pattern::{Axis, PatternSet, frame_count};

/// Coordinates of the finest period: half as many as in frames with noise, for all events are tried.
const PER_PERIOD: f64 = 16.0;
/// Coordinates that are tried.
const TRIED: u64 = 48;
/// An event that moves no coordinate by more than this part of a period is as good as none.
const HARMLESS: f64 = 1.0 / 16.0;

/// Refuses a sequence with a check whose frames could be in another order without anybody seeing it.
///
/// # Errors
/// [`DecodeError::OrderNotProven`] names the event that would stay unseen.
pub fn prove(sequence: &[PatternSet], extent_px: [u32; 2]) -> Result<(), DecodeError> {
    if !has_check(sequence) {
        return Ok(());
    }
    let axes = [(Axis::X, extent_px[0]), (Axis::Y, extent_px[1])];
    let axes: Vec<(Axis, Templates, Arrangement)> = axes
        .into_iter()
        .filter_map(|(axis, extent_px)| {
            let templates = Templates::new(sequence, axis, extent_px, PER_PERIOD)?;
            let straight = templates.arrangement(None);
            Some((axis, templates, straight))
        })
        .collect();
    for event in OrderEvent::all(frame_count(sequence)) {
        let mut harmed = None;
        let mut seen = false;
        for (axis, templates, straight) in &axes {
            let look = look(templates, straight, event);
            seen |= look.seen;
            // An axis that only a check varies along gives no coordinate.
            if look.harmed && is_decoded(sequence, *axis) {
                harmed.get_or_insert(*axis);
            }
        }
        if let Some(axis) = harmed.filter(|_| !seen) {
            return Err(DecodeError::OrderNotProven { axis, event });
        }
    }
    Ok(())
}

/// What an event does along an axis.
struct Look {
    /// A frame stays unexplained.
    seen: bool,
    /// A coordinate is moved.
    harmed: bool,
}

fn look(templates: &Templates, straight: &Arrangement, event: OrderEvent) -> Look {
    let arrangement = templates.arrangement(Some(event));
    let rows = templates.frames.len();
    let (mut sums, mut counts, mut harmed) = (vec![0.0; rows], vec![0_u32; rows], false);
    let most_px = (templates.finest_px * HARMLESS).max(2.0 * templates.step_px);
    for number in 0..TRIED {
        // At no even distance, which could be that of stripes.
        let place = (Key::new(0).bits(number) % templates.places().max(1) as u64) as usize;
        // What the sequence does not say is the worst that could be: what should be there.
        let values: Vec<f32> =
            (0..rows).map(|row| templates.level(arrangement.shows[row].unwrap_or(row), place)).collect();
        let explained = templates.explain(straight, &values);
        let off_px = (explained.place as f64 - place as f64).abs() * templates.step_px;
        harmed |= off_px > most_px && !alike(templates, place, explained.place);
        for (row, misfit) in explained.misfit.iter().enumerate() {
            if let Some(misfit) = misfit {
                sums[row] += misfit;
                counts[row] += 1;
            }
        }
    }
    let seen = sums.iter().zip(&counts).any(|(sum, count)| *count > 0 && sum / *count as f32 >= SUSPECT);
    Look { seen, harmed }
}

fn is_decoded(sequence: &[PatternSet], axis: Axis) -> bool {
    let decoded = |set: &PatternSet| set.axis() == Some(axis) && !matches!(set, PatternSet::Check { .. });
    sequence.iter().any(decoded)
}

/// Whether all frames show the same at two coordinates, as a code without fringes does within a stripe.
fn alike(templates: &Templates, one: usize, other: usize) -> bool {
    (0..templates.frames.len())
        .all(|row| (templates.level(row, one) - templates.level(row, other)).abs() < 0.02)
}
