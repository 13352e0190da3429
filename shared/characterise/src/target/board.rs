//! A grid of candidates becomes a board: corners fitted, holes and margins filled, what does not fit dropped.

use super::corner::{Corner, Expected, View, refine};
use super::lattice::{Lattice, Place, bounds_of};
use super::window::{Band, Window};
use fringe::math::statistics::median;
use nalgebra::{Point2, Vector2};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};

/// A corner may be this far from the place predicted by its neighbours, as a fraction of the pitch: perspective and lens stay below a
/// tenth a square, a wrong corner lies elsewhere.
const STRAY: f64 = 0.25;
/// Least contrast of a corner, as a fraction of its neighbours'.
const FAINT: f64 = 0.3;
/// Largest residual of the model, as a fraction of the contrast: at the rim of a board or at an occlusion it exceeds half.
const MISFIT: f64 = 0.25;
/// Largest residual over contrast, as a multiple of the board's median: what covers a part of a window shows there first.
const OUTSTANDING: f64 = 4.0;
/// A narrower window must leave this part of the residual at most, else the wider one is better.
const CLEARER: f64 = 0.6;
/// Below this part of the contrast a residual is texture or sharpening, not something that covers the corner.
const TEXTURE: f64 = 0.06;
/// Largest blur, as a fraction of the pitch: beyond, the next edges reach into this one.
const BLUR: f64 = 0.3;
/// Cosine of the largest turn of an edge against the direction of its neighbours: 18°.
const TURN: f64 = 0.95;

/// Corners on their lattice; where u + v is even the square between +u and +v is light.
pub(crate) type Board = BTreeMap<Place, Corner>;

impl Lattice for Board {
    fn pixel(&self, place: Place) -> Option<Point2<f64>> {
        self.get(&place).map(|corner| corner.pixel)
    }
}

/// Start positions by place.
#[derive(Debug, Default)]
pub(crate) struct Starts(pub BTreeMap<Place, Point2<f64>>);

impl Lattice for Starts {
    fn pixel(&self, place: Place) -> Option<Point2<f64>> {
        self.0.get(&place).copied()
    }
}

/// Fits all corners of a grid and grows it as far as corners go, at most `most` rows or columns.
pub(crate) fn board(view: &View, starts: &Starts, most: i32) -> Board {
    let corner = |(place, pixel): (&Place, &Point2<f64>)| {
        Some((*place, fitted(view, *place, *pixel, starts.steps(*place)?, None)?))
    };
    let mut board: Board = starts.0.par_iter().filter_map(corner).collect();
    drop_strays(&mut board);
    grow(view, &mut board, most);
    drop_strays(&mut board);
    straighten(view, &mut board);
    drop_covered(&mut board);
    board
}

/// Fits one corner of a grid whose steps differ, first roughly, then to the noise limit; `along` are the shortest steps there.
pub(crate) fn single(
    view: &View,
    place: Place,
    pixel: Point2<f64>,
    along: [Vector2<f64>; 2],
) -> Option<Corner> {
    let corner = fitted(view, place, pixel, along, None)?;
    fitted(view, place, corner.pixel, along, Some((&corner, [0.0; 2])))
}

/// Whether two boards share a corner: pieces of one board, that grew together.
pub(crate) fn overlap(a: &Board, b: &Board) -> bool {
    a.values().any(|p| b.values().any(|q| (p.pixel - q.pixel).norm() < 2.0))
}

/// Drops corners whose model fits much worse than that of the others.
fn drop_covered(board: &mut Board) {
    let mut misfits: Vec<f64> = board.values().map(misfit).collect();
    let Some(median) = median(&mut misfits) else { return };
    board.retain(|_, corner| misfit(corner) <= (OUTSTANDING * median).max(TEXTURE));
}

/// A corner at a place, if the image holds one of the proper colour there; `second`: the corner that a first fit gave, and the
/// curvature of the lines through it.
///
/// Markers or dirt in its squares may disturb the fit. Then only the nearest neighbourhood of the edges is used.
fn fitted(
    view: &View,
    place: Place,
    pixel: Point2<f64>,
    along: [Vector2<f64>; 2],
    second: Option<(&Corner, [f64; 2])>,
) -> Option<Corner> {
    let pitch = along[0].norm().min(along[1].norm());
    let light = (place.0 + place.1).rem_euclid(2) == 0;
    let curvature = second.map_or([0.0; 2], |(_, curvature)| curvature);
    let expected = Expected { pixel, along, curvature, light, leash_px: STRAY * pitch };
    let fit = |band: Band, first: Option<&Corner>| {
        let window = Window { band, ..view.window };
        let corner = refine(view, &expected, window, first)?;
        is_sound(view, &corner, &expected).then_some(corner)
    };
    let wide = fit(Band::WIDE, second.map(|(corner, _)| corner))?;
    let clear = if misfit(&wide) > TEXTURE { fit(Band::NARROW, Some(&wide)) } else { None };
    let best = clear.filter(|narrow| misfit(narrow) < CLEARER * misfit(&wide)).unwrap_or(wide);
    (misfit(&best) < MISFIT).then_some(best)
}

/// Residual over contrast of a corner.
fn misfit(corner: &Corner) -> f64 {
    corner.residual_dn / corner.contrast_dn.abs()
}

/// Whether a corner has the colours, the directions, the contrast and the sharpness that are expected.
fn is_sound(view: &View, corner: &Corner, expected: &Expected) -> bool {
    let along = expected.along;
    let contrast = if expected.light { corner.contrast_dn } else { -corner.contrast_dn };
    let aligned = (0..2).all(|i| {
        let (sin, cos) = fringe::math::sincos(corner.angle_rad[i]);
        Vector2::new(cos, sin).dot(&along[i]) > TURN * along[i].norm()
    });
    let pitch = along[0].norm().min(along[1].norm());
    contrast > view.min_contrast_dn && corner.blur_px < BLUR * pitch && aligned
}

/// Tries each empty place beside the board once.
fn grow(view: &View, board: &mut Board, most: i32) {
    let mut tried = BTreeSet::new();
    loop {
        let places: BTreeSet<Place> = board
            .keys()
            .flat_map(|(u, v)| [(u + 1, *v), (u - 1, *v), (*u, v + 1), (*u, v - 1)])
            .filter(|place| !board.contains_key(place) && !tried.contains(place))
            .collect();
        let Some(bounds) = bounds_of(board.keys()) else { return };
        if places.is_empty() || bounds.lengths().iter().any(|length| *length > most) {
            return;
        }
        for place in places {
            tried.insert(place);
            let corner = board.predicted(place).zip(board.steps(place)).and_then(|(pixel, along)| {
                fitted(view, place, pixel, along, None).filter(|corner| !is_faint(board, place, corner))
            });
            if let Some(corner) = corner {
                board.insert(place, corner);
            }
        }
    }
}

/// Whether a corner is much fainter than those beside it.
fn is_faint(board: &Board, (u, v): Place, corner: &Corner) -> bool {
    let beside = [(u + 1, v), (u - 1, v), (u, v + 1), (u, v - 1)];
    let strongest =
        beside.iter().filter_map(|p| board.get(p)).map(|c| c.contrast_dn.abs()).fold(0.0, f64::max);
    corner.contrast_dn.abs() < FAINT * strongest
}

/// Drops corners that their neighbours contradict, the worst first.
fn drop_strays(board: &mut Board) {
    loop {
        let worst = board
            .iter()
            .filter_map(|(place, corner)| {
                let pitch = board.steps(*place)?.iter().map(Vector2::norm).fold(f64::INFINITY, f64::min);
                let error = (board.predicted(*place)? - corner.pixel).norm() / pitch;
                (error > STRAY || is_faint(board, *place, corner)).then_some((*place, error))
            })
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let Some((place, _)) = worst else { return };
        board.remove(&place);
    }
}

/// Fits all corners again with the curvature of the board's lines through them, which the lens gives to straight edges:
/// within the window an edge bent by κ moves by κ·reach²/6.
fn straighten(view: &View, board: &mut Board) {
    let refitted = |(place, corner): (&Place, &Corner)| {
        let curvature = [0, 1].map(|axis| board.mean_curvature(*place, axis));
        let along = board.steps(*place)?;
        Some((*place, fitted(view, *place, corner.pixel, along, Some((corner, curvature)))?))
    };
    let straight: Board = board.par_iter().filter_map(refitted).collect();
    *board = straight;
}
