//! An AprilGrid: tags in rows and columns with small dark squares between their corners (Kalibr's target).
//!
//! Tags, gaps and small squares are a checkerboard whose lines are alternately wide and narrow, so the corners are linked as those of a
//! checkerboard. They are fitted one by one in a window that the narrow gap allows, and numbered by the tags: each tag alone
//! determines a quarter turn and a shift. How the tags stand on the sheet and whether they are counted from its top or from its
//! bottom differs between printers; the way in which all tags agree is the right one.

use super::attempts::first;
use super::board::{Board, single};
use super::checkerboard::{factors, full_pixel, looked_at};
use super::detection::{DetectedPoint, Detection};
use super::error::TargetError;
use super::lattice::Place;
use super::lay::{Lay, declared, enough, turned};
use super::links::grids;
use super::markers::{Rim, read};
use super::raster::Image;
use super::settings::TargetSettings;
use super::spec::{Marking, TargetSpec};
use nalgebra::{Point2, Vector2};
use std::collections::BTreeMap;

const WHAT: &str = "AprilGrid";
/// Tags that must agree.
const AGREEING: usize = 3;
/// Of the tags read, those that contradict may be at most this part of those that agree.
const CONTRADICTING: f64 = 0.25;
/// Grids looked at per image.
const GRIDS: usize = 12;

/// A tag that was read, and the place of its first corner.
struct Tag {
    place: Place,
    number: usize,
    turn: usize,
}

/// Finds the declared grid, or the part of it that the image shows.
pub(crate) fn detect(
    image: &Image,
    full_scale_dn: f64,
    spec: &TargetSpec,
    settings: &TargetSettings,
) -> Result<Detection, TargetError> {
    let Some(marking) = spec.marking() else { return Err(TargetError::NoMarkers) };
    first(factors(image), WHAT, 0, |factor| {
        let (boards, candidates) = boards(image, full_scale_dn, settings, factor);
        let mut points: BTreeMap<(u32, u32), DetectedPoint> = BTreeMap::new();
        let mut best = TargetError::NoTarget { what: WHAT, candidates };
        for board in &boards {
            match numbered(image, board, spec, marking, settings.min_contrast_fraction * full_scale_dn) {
                Ok(found) => {
                    for point in found {
                        points.entry(point.index).or_insert(point);
                    }
                }
                Err(error) if matches!(best, TargetError::NoTarget { .. }) => best = error,
                Err(_) => {}
            }
        }
        enough(points, best, spec, settings)
    })
}

/// The grids of corners at one reduction, each corner fitted in the full image; and the number of single candidates.
fn boards(
    image: &Image,
    full_scale_dn: f64,
    settings: &TargetSettings,
    factor: usize,
) -> (Vec<Board>, usize) {
    let (view, saddles, smooth) = looked_at(image, full_scale_dn, settings, factor);
    let fitted = |grid: &BTreeMap<Place, usize>| -> Board {
        let start = |place: &Place| grid.get(place).map(|i| full_pixel(saddles[*i].pixel, factor));
        let corner = |place: &Place| single(&view, *place, start(place)?, narrow_steps(*place, start)?);
        grid.keys().filter_map(|place| Some((*place, corner(place)?))).collect()
    };
    let boards = grids(&saddles, &smooth).iter().take(GRIDS).map(fitted).filter(|b| b.len() >= 4).collect();
    (boards, saddles.len())
}

/// The way to the nearer neighbour along u and v, which lies across the gap.
fn narrow_steps((u, v): Place, pixel: impl Fn(&Place) -> Option<Point2<f64>>) -> Option<[Vector2<f64>; 2]> {
    let here = pixel(&(u, v))?;
    let nearest = |after: Place, before: Place| {
        let ways = [pixel(&after).map(|p| p - here), pixel(&before).map(|p| here - p)];
        ways.into_iter().flatten().min_by(|a, b| a.norm().total_cmp(&b.norm()))
    };
    Some([nearest((u + 1, v), (u - 1, v))?, nearest((u, v + 1), (u, v - 1))?])
}

/// The corners of one lattice, by the tags in its dark squares.
fn numbered(
    image: &Image,
    board: &Board,
    spec: &TargetSpec,
    marking: Marking,
    min_contrast_dn: f64,
) -> Result<Vec<DetectedPoint>, TargetError> {
    let mut best: Option<(Lay, usize, usize)> = None;
    let mut rival = 0;
    for rim in [2, 1] {
        let tags = tags(image, board, marking, rim, min_contrast_dn);
        for from_bottom in [true, false] {
            for turn in 0..4 {
                let mut votes: BTreeMap<Lay, usize> = BTreeMap::new();
                for lay in tags.iter().filter_map(|tag| laid(tag, turn, from_bottom, spec)) {
                    *votes.entry(lay).or_default() += 1;
                }
                let Some((lay, agreeing)) = votes.into_iter().max_by_key(|(_, count)| *count) else {
                    continue;
                };
                match best {
                    Some((_, most, _)) if agreeing <= most => rival = rival.max(agreeing),
                    _ => {
                        rival = best.map_or(0, |(_, most, _)| most);
                        best = Some((lay, agreeing, tags.len()));
                    }
                }
            }
        }
    }
    let unmarked = |read| TargetError::Unmarked { corners: board.len(), read };
    let Some((lay, agreeing, read)) = best else { return Err(unmarked(0)) };
    // A single row of tags reads the same from the top and from the bottom.
    if agreeing < AGREEING || rival == agreeing || (read - agreeing) as f64 > CONTRADICTING * agreeing as f64
    {
        return Err(unmarked(read));
    }
    // The small squares beyond the outer tags have corners of their own only inside of the sheet.
    declared(board, lay, spec)
}

/// The tags in the dark squares of a lattice.
fn tags(image: &Image, board: &Board, marking: Marking, rim: usize, min_contrast_dn: f64) -> Vec<Tag> {
    let tag = |(u, v): Place| {
        let corner = |du: i32, dv: i32| board.get(&(u + du, v + dv)).map(|corner| corner.pixel);
        let corners = [corner(0, 0)?, corner(1, 0)?, corner(0, 1)?, corner(1, 1)?];
        let marker = read(image, corners, 1.0, (marking.dictionary, Rim(rim)), min_contrast_dn)?;
        Some(Tag { place: (u, v), number: marker.number, turn: marker.turn })
    };
    board.keys().filter(|(u, v)| (u + v).rem_euclid(2) == 1).filter_map(|place| tag(*place)).collect()
}

/// How the lattice lies by one tag, if tags stand turned by so many quarters and are counted from the bottom or the top.
fn laid(tag: &Tag, quarters: usize, from_bottom: bool, spec: &TargetSpec) -> Option<Lay> {
    let (columns, rows) = (spec.columns as usize / 2, spec.rows as usize / 2);
    let number = tag.number.checked_sub(spec.marker_numbers().start)?;
    let (column, row) = (number % columns, number / columns);
    if row >= rows {
        return None;
    }
    let row = if from_bottom { rows - 1 - row } else { row };
    let turn = (tag.turn + quarters) % 4;
    let (u, v) = tag.place;
    let (a, b) = (turned(turn, (u, v)), turned(turn, (u + 1, v + 1)));
    let shift = (2 * column as i32 - a.0.min(b.0), 2 * row as i32 - a.1.min(b.1));
    Some(Lay { turn, shift })
}
