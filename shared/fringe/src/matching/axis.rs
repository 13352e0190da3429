//! Which of several phases determines a pair's disparity: the one that changes along the epipolar lines.

use super::Matcher;
use crate::pattern::Axis;
use crate::phase::PhaseView;
use std::f64::consts::TAU;

/// Every so many pixels in both directions one is asked; a hundred thousand pixels give some thousand answers.
const STRIDE: usize = 7;

impl Matcher {
    /// The axis whose projector coordinate changes most along the left epipolar lines; `None` where no map has a valid
    /// neighbourhood. With equal changes the first map wins.
    pub fn best_axis(&self, maps: &[PhaseView]) -> Option<Axis> {
        let mut best: Option<(f64, Axis)> = None;
        for map in maps {
            let Some(change) = self.change_along_rows(map) else { continue };
            if best.is_none_or(|(most, _)| change > most) {
                best = Some((change, map.info.axis));
            }
        }
        best.map(|(_, axis)| axis)
    }

    /// Mean magnitude of the change of the projector coordinate per step along the epipolar line.
    fn change_along_rows(&self, map: &PhaseView) -> Option<f64> {
        let (width, height) = (map.info.width_px as usize, map.info.height_px as usize);
        if self.directions.pixels() != map.info.len() || map.phase_rad.len() != map.info.len() {
            return None;
        }
        let (mut sum, mut count) = (0.0, 0_u32);
        for row in (1..height.saturating_sub(1)).step_by(STRIDE) {
            for column in (1..width.saturating_sub(1)).step_by(STRIDE) {
                let index = row * width + column;
                let [x, y] = self.directions.at(index);
                let around = [index - 1, index + 1, index - width, index + width];
                if !x.is_finite() || around.iter().any(|i| map.valid[*i] == 0) {
                    continue;
                }
                let phase = |i: usize| f64::from(map.phase_rad[i]);
                let [dx, dy] = self.pair.left.curve(y).at(x).tangent;
                let slope = 0.5 * (phase(around[1]) - phase(around[0])) * dx
                    + 0.5 * (phase(around[3]) - phase(around[2])) * dy;
                // Steps at edges would count for more than the whole surface.
                if slope.is_finite() && slope.abs() / self.pair.focal_px < TAU {
                    sum += slope.abs();
                    count += 1;
                }
            }
        }
        (count > 0).then(|| sum / f64::from(count) * map.info.period_px)
    }
}
