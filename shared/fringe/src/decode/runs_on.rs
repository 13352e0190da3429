//! Whether the wrapped phase runs on between two pixels whose orders do not follow each other.
//!
//! Where a frame of the code is wrong it does: a surface goes on, and the orders jump. From one surface to another both phases differ by
//! anything, and are alike by chance, as often as the share of a turn that counts as alike. So every meeting that is none takes away the chance
//! meetings which go with it: what is left are the jumps upon surfaces.

use super::block::state;
use std::f32::consts::TAU;

/// Phases are alike within an eighth of a turn of each other, to either side: a quarter of all chance meetings.
const ALIKE: f32 = 0.125;
/// What a meeting counts: three thirds …
pub(super) const MEETS: i32 = 3;
/// … of which one is taken away for each of the three that go with every chance meeting.
const PARTS: i32 = -1;

/// [`MEETS`] where the phase runs on to a pixel from the last valid one along a row or a column, so many steps before; else what it takes away.
pub(super) fn meeting(phase_rad: &[f32], valid: &[u8], place: usize, (steps, stride): (usize, usize)) -> i32 {
    let before = place - steps * stride;
    let slope = |at: usize| {
        let known = |at: usize| (valid.get(at) == Some(&state::SURE)).then(|| phase_rad[at]);
        Some(wrapped(known(at + stride)? - known(at)?))
    };
    // How the phase rises on either side.
    let slopes = [before.checked_sub(stride).and_then(slope), slope(place)];
    let (sum, count) = slopes.iter().flatten().fold((0.0, 0.0_f32), |(sum, count), s| (sum + s, count + 1.0));
    let expected_rad = steps as f32 * TAU * sum / count.max(1.0);
    let off = wrapped(phase_rad[place] - phase_rad[before] - expected_rad);
    if off.abs() < ALIKE { MEETS } else { PARTS }
}

/// Turns, the nearest whole ones taken away.
fn wrapped(phase_rad: f32) -> f32 {
    let turns = phase_rad / TAU;
    turns - turns.round()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Key;

    /// Two surfaces of other slopes: one after the other, with whole turns between them, and with any difference.
    #[test]
    fn chance_meetings_cancel_and_jumps_of_the_order_stay() {
        let key = Key::new(3);
        let (mut jumps, mut rims, count) = (0, 0, 4000);
        for i in 0..count {
            let (slope, other) = (key.open(3 * i) as f32 - 0.5, key.open(3 * i + 1) as f32 - 0.5);
            let rim = 40.0 * key.open(3 * i + 2) as f32;
            let line = |second: [f32; 2], jump: f32| {
                [0.0, slope, jump + second[0], jump + second[1]].map(|turns| turns * TAU)
            };
            jumps += meeting(&line([2.0 * slope, 3.0 * slope], 7.0), &[1; 4], 2, (1, 1));
            rims += meeting(&line([0.0, other], rim), &[1; 4], 2, (1, 1));
        }
        assert_eq!(jumps, MEETS * count as i32);
        // Four standard deviations: of a count whose variance is three.
        assert!(f64::from(rims).abs() < 4.0 * (3.0 * count as f64).sqrt(), "{rims}");
    }

    #[test]
    fn a_gap_is_passed_over_with_the_slope_of_both_sides() {
        let turns = [0.0, 0.3, 9.9, 9.9, 5.2, 5.5].map(|turns: f32| turns * TAU);
        assert_eq!(meeting(&turns, &[1, 1, 0, 0, 1, 1], 4, (3, 1)), MEETS);
        assert_eq!(meeting(&turns, &[0, 1, 0, 0, 1, 0], 4, (3, 1)), MEETS);
        let off = turns.map(|phase| if phase > 30.0 { phase + 1.5 } else { phase });
        assert_eq!(meeting(&off, &[1, 1, 0, 0, 1, 1], 4, (3, 1)), PARTS);
    }
}
