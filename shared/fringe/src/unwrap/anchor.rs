//! The constant of each component: from the first pixel, or from an absolute phase known elsewhere.

use super::NO_COMPONENT;
use super::angle::Angles;
use super::report::Component;
use std::f64::consts::TAU;

/// An absolute phase at some pixels, for instance from a temporal code: exact or coarse, within half a turn in the median.
#[derive(Debug, Clone, Copy)]
pub struct Anchor<'a> {
    /// Phase, rad; NaN where not known.
    pub absolute_rad: &'a [f32],
}

/// Turns of one pixel beyond this come from no projector and would not fit the sums.
const MOST_TURNS: f64 = 1e6;

/// Moves each component by the median of the whole turns between anchor and phase at its pixels.
pub fn place(
    component: &[u32],
    angles: &Angles<'_>,
    anchor: Option<&Anchor<'_>>,
    turns: &mut [i32],
    width: usize,
) -> Vec<Component> {
    let mut components: Vec<Component> = Vec::new();
    // Component and wanted whole turns of each anchored pixel.
    let mut wanted: Vec<(u32, i32)> = Vec::new();
    for (pixel, number) in component.iter().enumerate().filter(|(_, number)| **number != NO_COMPONENT) {
        // Components are numbered in the order of their first pixels.
        if *number as usize == components.len() {
            let first_px = [(pixel % width) as u32, (pixel / width) as u32];
            components.push(Component { pixels: 0, first_px, turns: 0, anchored: 0, agreeing: 0 });
        }
        components[*number as usize].pixels += 1;
        if let Some(absolute_rad) = anchor.map(|a| f64::from(a.absolute_rad[pixel])) {
            let missing = absolute_rad / TAU - angles.fraction(pixel) - f64::from(turns[pixel]);
            if missing.abs() < MOST_TURNS {
                wanted.push((*number, missing.round() as i32));
            }
        }
    }
    wanted.sort_unstable();
    for group in wanted.chunk_by(|a, b| a.0 == b.0) {
        let component = &mut components[group[0].0 as usize];
        component.turns = group[group.len() / 2].1;
        component.anchored = group.len();
        component.agreeing = group.iter().filter(|(_, turns)| *turns == component.turns).count();
    }
    for (turns, number) in turns.iter_mut().zip(component).filter(|(_, number)| **number != NO_COMPONENT) {
        *turns += components[*number as usize].turns;
    }
    components
}
