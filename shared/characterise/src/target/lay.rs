//! How a lattice of corners lies on the declared board, as its markers tell, and the numbered corners that follow.

use super::board::Board;
use super::checkerboard::point;
use super::detection::{Ambiguity, DetectedPoint, Detection};
use super::error::TargetError;
use super::lattice::Place;
use super::settings::TargetSettings;
use super::spec::TargetSpec;
use std::collections::BTreeMap;

/// Of the corners numbered, those beyond the declared board may be at most this part: more, and it is a larger one.
const BEYOND: f64 = 0.1;

/// How a lattice lies on the board: index = turn(place) + shift.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Lay {
    pub turn: usize,
    pub shift: Place,
}

impl Lay {
    /// Column and row of a place; a turn of 0, 1, 2, 3 has the columns along u, v, −u, −v.
    pub fn index(&self, place: Place) -> Place {
        let (x, y) = turned(self.turn, place);
        (x + self.shift.0, y + self.shift.1)
    }
}

/// A place after quarter turns.
pub(crate) fn turned(turn: usize, (u, v): Place) -> Place {
    match turn {
        0 => (u, v),
        1 => (v, -u),
        2 => (-u, -v),
        _ => (-v, u),
    }
}

/// The corners of a lattice that are those of the declared board, numbered.
///
/// # Errors
/// [`TargetError::OtherSize`] where the lattice reaches beyond the board.
pub(crate) fn declared(
    board: &Board,
    lay: Lay,
    spec: &TargetSpec,
) -> Result<Vec<DetectedPoint>, TargetError> {
    let inside = |(column, row): Place| {
        (0..spec.columns as i32).contains(&column) && (0..spec.rows as i32).contains(&row)
    };
    let points: Vec<DetectedPoint> = board
        .iter()
        .map(|(place, corner)| (lay.index(*place), corner))
        .filter(|(index, _)| inside(*index))
        .map(|((column, row), corner)| point((column as u32, row as u32), corner))
        .collect();
    if ((board.len() - points.len()) as f64) > BEYOND * board.len() as f64 {
        return Err(beyond(board, lay, spec));
    }
    Ok(points)
}

/// A detection of the numbered corners, if there are enough of them.
///
/// # Errors
/// The one given where there are none, [`TargetError::Hidden`] where there are too few.
pub(crate) fn enough(
    points: BTreeMap<(u32, u32), DetectedPoint>,
    none: TargetError,
    spec: &TargetSpec,
    settings: &TargetSettings,
) -> Result<Detection, TargetError> {
    let count = spec.count();
    let needed = (settings.min_visible_fraction * count as f64).ceil() as usize;
    match points.len() {
        0 => Err(none),
        found if found < needed => Err(TargetError::Hidden { found, count, needed }),
        _ => Ok(Detection::new(spec, points.into_values().collect(), Ambiguity::None)),
    }
}

/// The extent of a board that reaches beyond the declared one.
fn beyond(board: &Board, lay: Lay, spec: &TargetSpec) -> TargetError {
    let (columns, rows) = (spec.columns, spec.rows);
    let seen = board.keys().map(|place| lay.index(*place));
    let (least, most) = seen.fold(((0, 0), (columns as i32 - 1, rows as i32 - 1)), |(least, most), index| {
        ((index.0.min(least.0), index.1.min(least.1)), (index.0.max(most.0), index.1.max(most.1)))
    });
    let found = vec![((most.0 - least.0 + 1) as u32, (most.1 - least.1 + 1) as u32)];
    TargetError::OtherSize { points: spec.kind.points(), columns, rows, found }
}
