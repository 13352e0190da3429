//! A declared checkerboard among the boards of an image.

use super::attempts::{Sighting, first};
use super::board::{Board, Starts, board, overlap};
use super::corner::{Corner, View};
use super::detection::{Ambiguity, DetectedPoint, Detection};
use super::error::TargetError;
use super::lattice::{Bounds, Lattice, Place, bounds_of};
use super::links::grids;
use super::raster::{Grey, Image, Raster};
use super::saddle::{Saddle, candidates};
use super::settings::TargetSettings;
use super::spec::TargetSpec;
use super::window::{Band, LEAST_ROOM_PX, Window};
use nalgebra::{Point2, Vector2};

const WHAT: &str = "checkerboard";
/// Images are searched first at the reduction that brings them below this, px: corners there are as sharp as they get and
/// ten times faster to find; they are fitted in the full image.
const SEARCH_PX: usize = 1_500_000;
/// Coarsest reduction: a board of 8 × 8 squares that fills the image still has squares of 20 px in 1300.
const COARSEST: usize = 8;
/// Grids looked at per image: boards, not clutter, which comes in pieces of four to six.
const GRIDS: usize = 12;
/// A board that takes less than this part of the area of another is an image of it: on a screen, in a mirror.
const PICTURE: f64 = 0.05;
/// A line of a grid with fewer points than this part of the declared ones is a stray, not a line of the board.
const STRAY_LINE: f64 = 0.25;

/// Finds the declared board.
pub(crate) fn detect(
    image: &Image,
    full_scale_dn: f64,
    spec: &TargetSpec,
    settings: &TargetSettings,
) -> Result<Detection, TargetError> {
    // Corners that one reduction misses are grown in the full image: any find is enough.
    first(factors(image), WHAT, 0, |factor| {
        let (board, bounds) =
            search(image, full_scale_dn, spec, settings, factor).only(WHAT, spec, settings)?;
        if is_endless(&board, bounds, image) {
            let (columns, rows) = (spec.columns, spec.rows);
            return Err(TargetError::Endless { points: spec.kind.points(), columns, rows });
        }
        Ok(numbered(&board, bounds, spec))
    })
}

/// Reductions to try: the finest below [`SEARCH_PX`], coarser for blurred images, finer for small squares.
pub(crate) fn factors(image: &Image) -> Vec<usize> {
    let pixels = image.width * image.height;
    let powers = [1, 2, 4, COARSEST];
    let first = powers.into_iter().find(|f| pixels / (f * f) <= SEARCH_PX).unwrap_or(COARSEST);
    let large = |f: &usize| image.width.min(image.height) / f >= 120;
    let coarser = powers.into_iter().filter(|f| *f > first && *f <= 4 * first).filter(large);
    let finer = powers.into_iter().rev().filter(|f| *f < first);
    std::iter::once(first).chain(coarser).chain(finer).collect()
}

/// The boards of the declared extent at one reduction.
fn search(
    image: &Image,
    full_scale_dn: f64,
    spec: &TargetSpec,
    settings: &TargetSettings,
    factor: usize,
) -> Sighting<(Board, Bounds)> {
    let (boards, candidates) = boards(image, full_scale_dn, spec, settings, factor);
    let mut found = Vec::new();
    let mut refused = Vec::new();
    for mut board in boards {
        trim(&mut board, spec);
        match bounds_of(board.keys()) {
            Some(bounds) if fits(bounds, spec) => {
                let points = board.len();
                found.push(((board, bounds), points));
            }
            Some(bounds) if board.len() >= 6 => refused.push(bounds.lengths().map(|l| l as u32)),
            _ => {}
        }
    }
    let largest = found.iter().map(|((board, _), _)| extent_px2(board)).fold(0.0, f64::max);
    found.retain(|((board, _), _)| extent_px2(board) > PICTURE * largest);
    Sighting { found, refused, candidates }
}

/// All boards at one reduction, and the number of single candidates.
pub(crate) fn boards(
    image: &Image,
    full_scale_dn: f64,
    spec: &TargetSpec,
    settings: &TargetSettings,
    factor: usize,
) -> (Vec<Board>, usize) {
    let (view, saddles, smooth) = looked_at(image, full_scale_dn, settings, factor);
    let full = |p: Point2<f64>| full_pixel(p, factor);
    let most = spec.columns.max(spec.rows) as i32 + 2;
    let mut boards: Vec<Board> = Vec::new();
    for grid in grids(&saddles, &smooth).iter().take(GRIDS) {
        let starts =
            Starts(grid.iter().map(|(place, index)| (*place, full(saddles[*index].pixel))).collect());
        let board = board(&view, &starts, most);
        if boards.iter().all(|other| !overlap(other, &board)) {
            boards.push(board);
        }
    }
    (boards, saddles.len())
}

/// An image with the settings of its corner fits; the saddles found at one reduction, and the smoothed image they were found in.
pub(crate) fn looked_at<'a>(
    image: &'a Image<'a>,
    full_scale_dn: f64,
    settings: &TargetSettings,
    factor: usize,
) -> (View<'a>, Vec<Saddle>, Raster) {
    let min_contrast_dn = settings.min_contrast_fraction * full_scale_dn;
    let window =
        Window { fraction: settings.window_fraction, limit_px: settings.window_limit_px, band: Band::WIDE };
    let view = View { image, full_scale_dn, min_contrast_dn, window, edge_blur: settings.edge_blur };
    let (saddles, smooth) = if factor == 1 {
        candidates(image, min_contrast_dn)
    } else {
        candidates(&image.reduced(factor), min_contrast_dn)
    };
    (view, saddles, smooth)
}

/// The pixel of the full image at a pixel of the reduced one.
pub(crate) fn full_pixel(reduced: Point2<f64>, factor: usize) -> Point2<f64> {
    ((reduced.coords + Vector2::repeat(0.5)) * factor as f64 - Vector2::repeat(0.5)).into()
}

/// Area of the upright rectangle around a board.
fn extent_px2(board: &Board) -> f64 {
    let first = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    let (least, most) = board.values().fold(first, |(least, most), corner| {
        (least.inf(&corner.pixel.coords), most.sup(&corner.pixel.coords))
    });
    ((most.x - least.x) * (most.y - least.y)).max(0.0)
}

fn fits(bounds: Bounds, spec: &TargetSpec) -> bool {
    let [a, b] = bounds.lengths().map(|l| l as u32);
    (a, b) == (spec.columns, spec.rows) || (b, a) == (spec.columns, spec.rows)
}

/// Whether the board runs out of the image on opposite sides: it may then be a part of a larger one. Its end is seen where
/// the next corner beyond an outer line would lie in the image, and none does.
fn is_endless(board: &Board, bounds: Bounds, image: &Image) -> bool {
    let in_image = |p: Point2<f64>| {
        let room = |at: f64, length: usize| at.min(length as f64 - 1.0 - at);
        room(p.x, image.width).min(room(p.y, image.height)) > LEAST_ROOM_PX
    };
    let ends = |on: fn(&Place) -> i32, at: i32, step: Place| {
        let mut line = board.keys().filter(|place| on(place) == at);
        line.any(|(u, v)| board.predicted((u + step.0, v + step.1)).is_some_and(in_image))
    };
    let (least, most) = (bounds.least, bounds.most);
    !(ends(|p| p.0, least.0, (-1, 0)) || ends(|p| p.0, most.0, (1, 0)))
        || !(ends(|p| p.1, least.1, (0, -1)) || ends(|p| p.1, most.1, (0, 1)))
}

/// Takes outer lines with hardly any point away while the extent is too large.
fn trim(board: &mut Board, spec: &TargetSpec) {
    let (short, long) = (spec.columns.min(spec.rows) as i32, spec.columns.max(spec.rows) as i32);
    while let Some(bounds) = bounds_of(board.keys()) {
        let [a, b] = bounds.lengths();
        if a.min(b) <= short && a.max(b) <= long {
            return;
        }
        let lines =
            [(0, bounds.least.0, b), (0, bounds.most.0, b), (1, bounds.least.1, a), (1, bounds.most.1, a)];
        let on = |place: &Place, axis: i32, at: i32| if axis == 0 { place.0 == at } else { place.1 == at };
        let stray = lines.iter().find(|(axis, at, length)| {
            let count = board.keys().filter(|place| on(place, *axis, *at)).count();
            (count as f64) < STRAY_LINE * f64::from(*length).min(f64::from(long))
        });
        let Some((axis, at, _)) = stray.copied() else { return };
        board.retain(|place, _| !on(place, axis, at));
    }
}

/// Numbers the corners: colours first, then the direction in the image.
fn numbered(board: &Board, bounds: Bounds, spec: &TargetSpec) -> Detection {
    let (least, most) = (bounds.least, bounds.most);
    // Quarter turns: column and row of a place, place of (0, 0), direction of the columns.
    let index = |turn: usize, (u, v): Place| match turn {
        0 => (u - least.0, v - least.1),
        1 => (v - least.1, most.0 - u),
        2 => (most.0 - u, most.1 - v),
        _ => (most.1 - v, u - least.0),
    };
    let origins = [least, (most.0, least.1), most, (least.0, most.1)];
    let [a, b] = bounds.lengths().map(|l| l as u32);
    let fits =
        |turn: usize| if turn.is_multiple_of(2) { (a, b) } else { (b, a) } == (spec.columns, spec.rows);
    let mut turns: Vec<usize> = (0..4).filter(|turn| fits(*turn)).collect();
    let is_dark = |turn: usize| {
        let (u, v) = origins[turn];
        // Between +u and +v it is light where u + v is even; a quarter turn on it is the other colour.
        ((u + v).rem_euclid(2) == 0) == (turn % 2 == 1)
    };
    if turns.iter().any(|turn| is_dark(*turn)) {
        turns.retain(|turn| is_dark(*turn));
    }
    let (along_u, along_v) = mean_steps(board);
    let rightness = [along_u, along_v, -along_u, -along_v];
    let best = turns.iter().copied().max_by(|a, b| rightness[*a].total_cmp(&rightness[*b]).then(b.cmp(a)));
    let turn = best.unwrap_or(0);
    let ambiguity = match turns.len() {
        4 => Ambiguity::QuarterTurn,
        2 => Ambiguity::HalfTurn,
        _ => Ambiguity::None,
    };
    let points = board.iter().map(|(place, corner)| {
        let (column, row) = index(turn, *place);
        point((column as u32, row as u32), corner)
    });
    Detection::new(spec, points.collect(), ambiguity)
}

/// A corner that has its number.
pub(crate) fn point(index: (u32, u32), corner: &Corner) -> DetectedPoint {
    DetectedPoint {
        index,
        pixel: corner.pixel,
        covariance_px2: corner.covariance_px2,
        blur_px: corner.blur_px,
        edges: corner.edges,
        contrast_dn: corner.contrast_dn.abs(),
        residual_dn: corner.residual_dn,
    }
}

/// Mean image x of the steps along u and v, normalised.
fn mean_steps(board: &Board) -> (f64, f64) {
    let mut sums = [Vector2::zeros(); 2];
    for ((u, v), corner) in board {
        for (sum, next) in sums.iter_mut().zip([(u + 1, *v), (*u, v + 1)]) {
            if let Some(other) = board.get(&next) {
                *sum += other.pixel - corner.pixel;
            }
        }
    }
    let [a, b] = sums.map(|s| s.x / s.norm().max(1e-12));
    (a, b)
}
