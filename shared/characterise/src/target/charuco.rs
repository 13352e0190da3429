//! A ChArUco board: its corners are those of a checkerboard, their numbers come from the markers in its light squares.
//!
//! Each marker alone determines how the lattice of corners is placed on the board (a quarter turn and a shift). The lattice is taken
//! where markers agree; so a part of the board is enough, and half a turn is never in doubt.

use super::attempts::first;
use super::board::Board;
use super::checkerboard::{boards, factors};
use super::detection::{DetectedPoint, Detection};
use super::error::TargetError;
use super::lattice::Place;
use super::lay::{Lay, declared, enough, turned};
use super::markers::{Marker, Rim, read};
use super::raster::Image;
use super::settings::TargetSettings;
use super::spec::{Marking, TargetSpec};
use std::collections::BTreeMap;

const WHAT: &str = "ChArUco board";
/// Markers that must agree: one alone is a misreading in one of some hundred squares of clutter.
const AGREEING: usize = 2;
/// Of the markers read, those that contradict may be at most this part of those that agree.
const CONTRADICTING: f64 = 0.25;

impl Lay {
    /// From a marker in the square between (u, v) and (u + 1, v + 1).
    fn of(marker: Marker, (u, v): Place, spec: &TargetSpec) -> Option<Self> {
        let (column, row) = square(marker.number, spec)?;
        let (a, b) = (turned(marker.turn, (u, v)), turned(marker.turn, (u + 1, v + 1)));
        Some(Self { turn: marker.turn, shift: (column - a.0.min(b.0), row - a.1.min(b.1)) })
    }
}

/// The first inner corner of the square of a marker, which may lie at −1: markers count through the light squares row by row, the
/// first square of the board being dark.
fn square(number: usize, spec: &TargetSpec) -> Option<Place> {
    let number = number.checked_sub(spec.marker_numbers().start)?;
    let squares = (0..=spec.rows as i32).flat_map(|y| (0..=spec.columns as i32).map(move |x| (x, y)));
    squares.filter(|(x, y)| (x + y) % 2 == 1).nth(number).map(|(x, y)| (x - 1, y - 1))
}

/// Finds the declared board, or the part of it that the image shows.
pub(crate) fn detect(
    image: &Image,
    full_scale_dn: f64,
    spec: &TargetSpec,
    settings: &TargetSettings,
) -> Result<Detection, TargetError> {
    let Some(marking) = spec.marking() else { return Err(TargetError::NoMarkers) };
    let min_contrast_dn = settings.min_contrast_fraction * full_scale_dn;
    first(factors(image), WHAT, 0, |factor| {
        let (boards, candidates) = boards(image, full_scale_dn, spec, settings, factor);
        let mut points: BTreeMap<(u32, u32), DetectedPoint> = BTreeMap::new();
        let mut best = TargetError::NoTarget { what: WHAT, candidates };
        for board in boards.iter().filter(|board| board.len() >= 4) {
            match numbered(image, board, spec, marking, min_contrast_dn) {
                Ok(found) => {
                    // Pieces of one board have no corner in common.
                    if found.iter().any(|p| points.contains_key(&p.index)) {
                        let (columns, rows) = (spec.columns, spec.rows);
                        return Err(TargetError::Several { count: 2, columns, rows });
                    }
                    points.extend(found.into_iter().map(|p| (p.index, p)));
                }
                Err(error) if matches!(best, TargetError::NoTarget { .. }) => best = error,
                Err(_) => {}
            }
        }
        enough(points, best, spec, settings)
    })
}

/// The corners of one lattice, by the markers in its squares.
fn numbered(
    image: &Image,
    board: &Board,
    spec: &TargetSpec,
    marking: Marking,
    min_contrast_dn: f64,
) -> Result<Vec<DetectedPoint>, TargetError> {
    let mut votes: BTreeMap<Lay, usize> = BTreeMap::new();
    for (u, v) in board.keys().copied() {
        // Light squares only.
        let corners = [(u, v), (u + 1, v), (u, v + 1), (u + 1, v + 1)].map(|place| board.get(&place));
        let (true, [Some(a), Some(b), Some(c), Some(d)]) = ((u + v).rem_euclid(2) == 0, corners) else {
            continue;
        };
        let corners = [a.pixel, b.pixel, c.pixel, d.pixel];
        let marker = read(image, corners, marking.size, (marking.dictionary, Rim(1)), min_contrast_dn);
        if let Some(lay) = marker.and_then(|marker| Lay::of(marker, (u, v), spec)) {
            *votes.entry(lay).or_default() += 1;
        }
    }
    let read = votes.values().sum::<usize>();
    let unmarked = TargetError::Unmarked { corners: board.len(), read };
    let Some((lay, agreeing)) = votes.into_iter().max_by_key(|(_, count)| *count) else {
        return Err(unmarked);
    };
    if agreeing < AGREEING || (read - agreeing) as f64 > CONTRADICTING * agreeing as f64 {
        return Err(unmarked);
    }
    declared(board, lay, spec)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_marker_in_any_turn_lays_its_square_where_it_belongs() {
        let text = "kind = \"charuco\"\ncolumns = 5\nrows = 4\npitch_mm = 10\ndictionary = \"DICT_4X4_50\"\nmarker_mm = 7";
        let spec = TargetSpec::parse(text).expect("valid");
        // Squares 6 × 5: the light ones of the first row are 1, 3, 5, of the second 0, 2, 4.
        assert_eq!(
            [0, 2, 3, 4].map(|number| square(number, &spec)),
            [Some((0, -1)), Some((4, -1)), Some((-1, 0)), Some((1, 0))]
        );
        for turn in 0..4 {
            let lay = Lay::of(Marker { number: 4, turn }, (7, -3), &spec).expect("in the board");
            let mut corners = [(7, -3), (8, -3), (7, -2), (8, -2)].map(|place| lay.index(place));
            corners.sort_unstable();
            assert_eq!(corners, [(1, 0), (1, 1), (2, 0), (2, 1)]);
        }
    }
}
