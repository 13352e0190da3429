//! Which candidate is whose neighbour: an edge of the board runs from one to the other.

use super::raster::{Grey, Raster};
use super::saddle::Saddle;
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// Cosine of the largest angle between an edge at a corner and the way to the next corner: 18°, more than any lens bends
/// within a square.
const ALIGNED: f64 = 0.95;
/// Where along the way the edge is looked at.
const STATIONS: [f64; 5] = [0.3, 0.4, 0.5, 0.6, 0.7];
/// Least difference across the edge, as a fraction of the contrast of the weaker corner (2 would be all of it).
const ACROSS: f64 = 0.6;

/// Neighbours along +first, +second, −first, −second axis.
type Links = [Option<usize>; 4];

/// Grids of candidates: lattice position and index into `saddles`, the largest first.
///
/// From u to v the image turns as from x to y; where u + v is even, the square between +u and +v is light.
pub(crate) fn grids(saddles: &[Saddle], smooth: &Raster) -> Vec<BTreeMap<(i32, i32), usize>> {
    let links: Vec<Links> = (0..saddles.len()).map(|i| neighbours(saddles, smooth, i)).collect();
    let mut taken = vec![false; saddles.len()];
    let mut grids = Vec::new();
    for seed in 0..saddles.len() {
        if !taken[seed] {
            let grid = component(saddles, &links, seed, &mut taken);
            // Fewer cannot be distinguished from clutter.
            if grid.len() >= 4 {
                grids.push(grid);
            }
        }
    }
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.len()));
    grids
}

/// The nearest candidate in each direction that an edge leads to. Candidates are sorted from top to bottom: once all directions have
/// one, those further up or down than the farthest are not looked at.
fn neighbours(saddles: &[Saddle], smooth: &Raster, from: usize) -> Links {
    let here = &saddles[from];
    let mut links = [None; 4];
    let mut nearest = [f64::INFINITY; 4];
    // Whether candidates further that way may be nearer than those found.
    let mut look = |index: usize| {
        let there = &saddles[index];
        let way = there.pixel - here.pixel;
        let (length, farthest) = (way.norm(), nearest.iter().copied().fold(0.0, f64::max));
        if length >= 3.0
            && let Some(direction) = direction(here, &way, length)
        {
            let axis = direction % 2;
            // Colours change from corner to corner: what is the first axis here is the second there.
            let aligned = there.axes[1 - axis].dot(&way).abs() > ALIGNED * length;
            if length < nearest[direction] && aligned && is_edge(smooth, here, there, &way, axis) {
                nearest[direction] = length;
                links[direction] = Some(index);
            }
        }
        way.y.abs() < farthest
    };
    for index in from + 1..saddles.len() {
        if !look(index) {
            break;
        }
    }
    for index in (0..from).rev() {
        if !look(index) {
            break;
        }
    }
    links
}

/// 0 … 3 for +first, +second, −first, −second axis.
fn direction(here: &Saddle, way: &Vector2<f64>, length: f64) -> Option<usize> {
    let along = here.axes.map(|axis| axis.dot(way) / length);
    let axis = usize::from(along[1].abs() > along[0].abs());
    (along[axis].abs() > ALIGNED).then(|| if along[axis] > 0.0 { axis } else { axis + 2 })
}

/// Whether light lies on the proper side all along.
fn is_edge(smooth: &Raster, here: &Saddle, there: &Saddle, way: &Vector2<f64>, axis: usize) -> bool {
    let length = way.norm();
    let aside = Vector2::new(-way.y, way.x) / length * (0.15 * length).clamp(1.2, 4.0);
    // Turning on from the first axis it is light, from the second dark.
    let sign = if axis == 0 { 1.0 } else { -1.0 };
    let least = ACROSS * here.contrast_dn.min(there.contrast_dn);
    STATIONS.iter().all(|station| {
        let at = here.pixel + way * *station;
        let difference =
            smooth.sample(at + aside).zip(smooth.sample(at - aside)).map(|(a, b)| f64::from(a - b));
        difference.is_some_and(|d| sign * d > least)
    })
}

/// All that hangs together with a seed through links that both ends agree on.
fn component(
    saddles: &[Saddle],
    links: &[Links],
    seed: usize,
    taken: &mut [bool],
) -> BTreeMap<(i32, i32), usize> {
    let mut grid = BTreeMap::from([((0, 0), seed)]);
    taken[seed] = true;
    let mut queue = vec![(seed, (0, 0), saddles[seed].axes)];
    let mut next = 0;
    while let Some((index, at, frame)) = queue.get(next).copied() {
        next += 1;
        for (direction, link) in links[index].iter().enumerate() {
            let Some(other) = link.filter(|other| !taken[*other] && links[*other].contains(&Some(index)))
            else {
                continue;
            };
            // The frame (u, v) at this corner names its axes; its own order changes with the colour.
            let axis = saddles[index].axes[direction % 2] * if direction < 2 { 1.0 } else { -1.0 };
            let along = frame.map(|f| f.dot(&axis));
            let step = if along[0].abs() > along[1].abs() {
                (along[0].signum() as i32, 0)
            } else {
                (0, along[1].signum() as i32)
            };
            let place = (at.0 + step.0, at.1 + step.1);
            if grid.contains_key(&place) {
                continue;
            }
            grid.insert(place, other);
            taken[other] = true;
            queue.push((other, place, carried(&frame, &saddles[other])));
        }
    }
    grid
}

/// The frame at the next corner: its own axes, named and signed as at this one.
fn carried(frame: &[Vector2<f64>; 2], there: &Saddle) -> [Vector2<f64>; 2] {
    let direct = frame[0].dot(&there.axes[0]).abs() + frame[1].dot(&there.axes[1]).abs();
    let crossed = frame[0].dot(&there.axes[1]).abs() + frame[1].dot(&there.axes[0]).abs();
    let named = if direct > crossed { there.axes } else { [there.axes[1], there.axes[0]] };
    [0, 1].map(|i| if frame[i].dot(&named[i]) < 0.0 { -named[i] } else { named[i] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point2;
    use proptest::prelude::*;

    const PITCH_PX: f64 = 12.0;
    const SIDE: i32 = 7;

    /// A checkerboard turned about the middle of a picture, and those of its corners that are kept, from top to bottom.
    fn scene(turn: f64, kept: &[bool]) -> (Vec<Saddle>, Raster) {
        let (width, height) = (160_usize, 160_usize);
        let (sin, cos) = fringe::math::sincos(turn);
        let (u, v) = (Vector2::new(cos, sin), Vector2::new(-sin, cos));
        let middle = Vector2::new(80.0, 80.0);
        let value = |index: usize| {
            let d = Vector2::new((index % width) as f64, (index / width) as f64) - middle;
            let square = [u, v].map(|axis| (axis.dot(&d) / PITCH_PX).floor() as i64);
            if (square[0] + square[1]).rem_euclid(2) == 0 { 150.0 } else { 50.0 }
        };
        let values = (0..width * height).map(value).collect();
        let half = SIDE / 2;
        let places = (-half..=half).flat_map(|j| (-half..=half).map(move |i| (i, j)));
        let saddle = |((i, j), _): ((i32, i32), &bool)| Saddle {
            pixel: Point2::from(middle + (u * f64::from(i) + v * f64::from(j)) * PITCH_PX),
            axes: if (i + j) % 2 == 0 { [u, v] } else { [v, -u] },
            contrast_dn: 50.0,
        };
        let mut saddles: Vec<Saddle> = places.zip(kept).filter(|(_, kept)| **kept).map(saddle).collect();
        saddles.sort_by(|a, b| a.pixel.y.total_cmp(&b.pixel.y).then(a.pixel.x.total_cmp(&b.pixel.x)));
        (saddles, Raster { width, height, values })
    }

    /// The distances of the neighbours, by a look at all candidates.
    fn by_all(saddles: &[Saddle], smooth: &Raster, from: usize) -> [f64; 4] {
        let (here, mut nearest) = (&saddles[from], [f64::INFINITY; 4]);
        for there in saddles {
            let way = there.pixel - here.pixel;
            let length = way.norm();
            let Some(direction) = direction(here, &way, length).filter(|_| length >= 3.0) else { continue };
            let axis = direction % 2;
            let aligned = there.axes[1 - axis].dot(&way).abs() > ALIGNED * length;
            if aligned && is_edge(smooth, here, there, &way, axis) {
                nearest[direction] = nearest[direction].min(length);
            }
        }
        nearest
    }

    proptest! {
        /// Proves: leaving out the rows that lie too far away leaves out no neighbour.
        #[test]
        fn the_nearest_rows_have_the_neighbours_of_all(
            turn in 0.0_f64..6.3,
            kept in prop::collection::vec(prop::bool::weighted(0.8), (SIDE * SIDE) as usize),
        ) {
            let (saddles, smooth) = scene(turn, &kept);
            for from in 0..saddles.len() {
                let length = |link: Option<usize>| {
                    link.map_or(f64::INFINITY, |to| (saddles[to].pixel - saddles[from].pixel).norm())
                };
                prop_assert_eq!(neighbours(&saddles, &smooth, from).map(length), by_all(&saddles, &smooth, from));
            }
        }
    }

    #[test]
    fn a_whole_board_hangs_together() {
        let (saddles, smooth) = scene(0.3, &[true; (SIDE * SIDE) as usize]);
        let sizes: Vec<usize> = grids(&saddles, &smooth).iter().map(BTreeMap::len).collect();
        assert_eq!(sizes, [(SIDE * SIDE) as usize]);
    }
}
