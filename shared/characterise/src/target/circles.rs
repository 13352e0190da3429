//! A declared grid of circles among the areas of an image.

use super::attempts::{Sighting, first};
use super::blobs::{Blob, NEIGHBOURHOODS, candidates};
use super::detection::{Ambiguity, DetectedPoint, Detection};
use super::disc::{Disc, refine};
use super::error::TargetError;
use super::lattice::{Lattice, Place, bounds_of};
use super::raster::Image;
use super::settings::TargetSettings;
use super::spec::{TargetKind, TargetSpec};
use fringe::math::statistics::median;
use nalgebra::{Point2, Vector2};
use std::collections::BTreeMap;

const WHAT: &str = "grid of circles";
/// Candidates of one image, the first from the top: more are texture.
const MOST: usize = 4000;
/// A neighbour may lie this far from where it is expected, as a fraction of the step.
const STRAY: f64 = 0.25;
/// Sine of the smallest angle between the two steps of a lattice.
const OPEN: f64 = 0.35;
/// Ratio of the areas of neighbouring circles.
const AREAS: f64 = 2.0;
/// Largest residual of the model over its contrast.
const MISFIT: f64 = 0.25;
/// Margin of the window, px: beyond, there is only ground.
const WIDEST_MARGIN_PX: f64 = 6.0;

type Discs = BTreeMap<Place, Disc>;

impl Lattice for Discs {
    fn pixel(&self, place: Place) -> Option<Point2<f64>> {
        self.get(&place).map(|disc| disc.pixel)
    }
}

/// Finds the declared grid: dark circles first, then light ones.
pub(crate) fn detect(
    image: &Image,
    full_scale_dn: f64,
    spec: &TargetSpec,
    settings: &TargetSettings,
) -> Result<Detection, TargetError> {
    let least_dn = settings.min_contrast_fraction * full_scale_dn;
    let attempts = [true, false].into_iter().flat_map(|dark| NEIGHBOURHOODS.map(|part| (dark, part)));
    // Circles that a neighbourhood is too small for are found in the next.
    first(attempts, WHAT, spec.count(), |(dark, part)| {
        let blobs = candidates(image, dark, part, least_dn);
        let sign = if dark { 1.0 } else { -1.0 };
        let fitted =
            |grid: &BTreeMap<Place, usize>| discs(image, full_scale_dn, &blobs, grid, sign * least_dn);
        let mut sighting = Sighting { found: Vec::new(), refused: Vec::new(), candidates: blobs.len() };
        for grid in grids(&blobs, 4 * spec.count()) {
            let discs = fitted(&grid);
            let numberings = numberings(&discs, spec);
            if numberings.is_empty() {
                sighting.refused.extend(extent(&discs, spec).filter(|[a, b]| *a > 2 && *b > 2));
            } else {
                let points = discs.len();
                sighting.found.push(((discs, numberings), points));
            }
        }
        let (discs, numberings) = sighting.only(WHAT, spec, settings)?;
        Ok(numbered(&discs, &numberings, spec))
    })
}

/// Lattices of areas, the largest first.
fn grids(blobs: &[Blob], most: usize) -> Vec<BTreeMap<Place, usize>> {
    let blobs = &blobs[..blobs.len().min(MOST)];
    let mut taken = vec![false; blobs.len()];
    let mut grids = Vec::new();
    for seed in 0..blobs.len() {
        if taken[seed] {
            continue;
        }
        let Some(basis) = basis(blobs, seed) else { continue };
        let grid = grown(blobs, seed, basis, &taken, most);
        if grid.len() >= 6 {
            for index in grid.values() {
                taken[*index] = true;
            }
            grids.push(grid);
        }
    }
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.len()));
    grids
}

/// The two shortest steps from an area that lead to others on both sides; the second turns as y from x.
fn basis(blobs: &[Blob], seed: usize) -> Option<[Vector2<f64>; 2]> {
    let here = &blobs[seed];
    let mut ways: Vec<Vector2<f64>> = blobs
        .iter()
        .filter(|b| alike(b, here))
        .map(|b| b.pixel - here.pixel)
        .filter(|w| w.norm() > 2.0)
        .collect();
    ways.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
    ways.truncate(12);
    let both = |way: &&Vector2<f64>| ways.iter().any(|other| (*way + other).norm() < STRAY * way.norm());
    let first = ways.iter().find(both)?;
    let open = |way: &&Vector2<f64>| first.perp(way).abs() > OPEN * first.norm() * way.norm();
    let second = ways.iter().filter(both).find(open)?;
    Some(if first.perp(second) > 0.0 { [*first, *second] } else { [*first, -*second] })
}

fn alike(a: &Blob, b: &Blob) -> bool {
    let ratio = (a.moments.determinant() / b.moments.determinant()).sqrt();
    (1.0 / AREAS..AREAS).contains(&ratio)
}

/// Steps from area to area, each with the steps that led there.
fn grown(
    blobs: &[Blob],
    seed: usize,
    basis: [Vector2<f64>; 2],
    taken: &[bool],
    most: usize,
) -> BTreeMap<Place, usize> {
    let mut grid = BTreeMap::from([((0, 0), seed)]);
    let mut used = taken.to_vec();
    used[seed] = true;
    let mut queue = vec![(seed, (0, 0), basis)];
    let mut next = 0;
    while let Some((index, at, basis)) = queue.get(next).copied() {
        next += 1;
        for (axis, sign) in [(0, 1), (1, 1), (0, -1), (1, -1)] {
            let place = if axis == 0 { (at.0 + sign, at.1) } else { (at.0, at.1 + sign) };
            if grid.contains_key(&place) || grid.len() >= most {
                continue;
            }
            let here = &blobs[index];
            let expected = here.pixel + basis[axis] * f64::from(sign);
            let free = blobs.iter().enumerate().filter(|(i, b)| !used[*i] && alike(b, here));
            let nearest = free
                .map(|(i, b)| (i, (b.pixel - expected).norm()))
                .filter(|(_, far)| *far < STRAY * basis[axis].norm())
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((found, _)) = nearest {
                let mut steps = basis;
                steps[axis] = (blobs[found].pixel - here.pixel) * f64::from(sign);
                used[found] = true;
                grid.insert(place, found);
                queue.push((found, place, steps));
            }
        }
    }
    grid
}

/// Fits the areas of a grid; `least_dn` is negative for light circles. What does not fit or lies off its row is dropped.
fn discs(image: &Image, full: f64, blobs: &[Blob], grid: &BTreeMap<Place, usize>, least_dn: f64) -> Discs {
    let starts =
        super::board::Starts(grid.iter().map(|(place, index)| (*place, blobs[*index].pixel)).collect());
    let mut discs = Discs::new();
    for (place, index) in grid {
        let Some(steps) = starts.steps(*place) else { continue };
        let blob = &blobs[*index];
        // Half the gap to the nearest circle, so that each ground pixel belongs to one circle.
        let nearest = [steps[0], steps[1], steps[0] + steps[1], steps[0] - steps[1]];
        let nearest = nearest.iter().map(Vector2::norm).fold(f64::INFINITY, f64::min);
        let radius = 2.0 * blob.moments.determinant().max(0.0).sqrt().sqrt();
        let margin_px = (0.5 * nearest - radius).clamp(2.0, WIDEST_MARGIN_PX);
        let Some(disc) = refine(image, full, blob.pixel, &blob.moments, margin_px) else { continue };
        let contrast = disc.contrast_dn * least_dn.signum();
        let sound = contrast > least_dn.abs()
            && disc.residual_dn < MISFIT * contrast
            && (disc.pixel - blob.pixel).norm() < 0.5 * radius.max(2.0);
        if sound {
            discs.insert(*place, disc);
        }
    }
    let strays: Vec<Place> =
        discs.iter().filter(|(place, disc)| is_stray(&discs, **place, disc)).map(|d| *d.0).collect();
    discs.retain(|place, _| !strays.contains(place));
    discs
}

fn is_stray(discs: &Discs, place: Place, disc: &Disc) -> bool {
    let Some((expected, steps)) = discs.predicted(place).zip(discs.steps(place)) else { return true };
    (disc.pixel - expected).norm() > STRAY * steps[0].norm().min(steps[1].norm())
}

/// A change of basis from the lattice of an image to that of the target, in pitches.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Numbering {
    x: [i32; 2],
    y: [i32; 2],
    origin: Place,
}

impl Numbering {
    fn of(&self, place: Place) -> Place {
        let x = self.x[0] * place.0 + self.x[1] * place.1 - self.origin.0;
        let y = self.y[0] * place.0 + self.y[1] * place.1 - self.origin.1;
        (x, y)
    }

    /// Column and row; `None` off the pattern.
    fn index(&self, place: Place, spec: &TargetSpec) -> Option<(u32, u32)> {
        let (x, y) = self.of(place);
        let (column, row) = match spec.kind {
            TargetKind::AsymmetricCircles if (x + y).rem_euclid(2) == 1 => return None,
            TargetKind::AsymmetricCircles => ((x - y.rem_euclid(2)).div_euclid(2), y),
            _ => (x, y),
        };
        let inside = (0..spec.columns as i32).contains(&column) && (0..spec.rows as i32).contains(&row);
        inside.then_some((column as u32, row as u32))
    }
}

/// All changes of basis that keep the turn from x to y, with the least place at the origin.
fn bases(discs: &Discs, spec: &TargetSpec) -> Vec<Numbering> {
    let asymmetric = spec.kind == TargetKind::AsymmetricCircles;
    let entries = -2..=2;
    let mut bases = Vec::new();
    for (a, b) in entries.clone().flat_map(|a| entries.clone().map(move |b| (a, b))) {
        for (c, d) in entries.clone().flat_map(|c| entries.clone().map(move |d| (c, d))) {
            if a * d - b * c != 1 {
                continue;
            }
            // The circles of an asymmetric grid are the lattice of the steps (1, 1) and (−1, 1).
            let (x, y) = if asymmetric { ([a - c, b - d], [a + c, b + d]) } else { ([a, b], [c, d]) };
            let raw = Numbering { x, y, origin: (0, 0) };
            let places: Vec<Place> = discs.keys().map(|place| raw.of(*place)).collect();
            if let Some(bounds) = bounds_of(places.iter()) {
                bases.push(Numbering { origin: bounds.least, ..raw });
            }
        }
    }
    bases
}

/// Places along x and y that the discs take in a numbering.
fn lengths(numbering: &Numbering, discs: &Discs) -> [i32; 2] {
    let places: Vec<Place> = discs.keys().map(|place| numbering.of(*place)).collect();
    bounds_of(places.iter()).map_or([0, 0], |bounds| bounds.lengths())
}

/// The numberings that give the declared pattern with its full extent.
fn numberings(discs: &Discs, spec: &TargetSpec) -> Vec<Numbering> {
    let far = spec.lattice_of(i64::from(spec.columns) - 1, 0).0;
    let shifted = i64::from(spec.kind == TargetKind::AsymmetricCircles);
    let declared = [(far + shifted + 1) as i32, spec.rows as i32];
    let mut numberings = bases(discs, spec);
    numberings.retain(|numbering| {
        lengths(numbering, discs) == declared && discs.keys().all(|p| numbering.index(*p, spec).is_some())
    });
    // A hidden part can allow a sheared numbering beside the true one: then none is certain.
    let turned = |a: &Numbering| {
        numberings.iter().any(|b| (b.x, b.y) == (a.x.map(i32::wrapping_neg), a.y.map(i32::wrapping_neg)))
    };
    let square = spec.columns == spec.rows && spec.kind == TargetKind::Circles;
    match numberings.len() {
        0 | 1 => numberings,
        2 if numberings.iter().all(turned) => numberings,
        4 if square && numberings.iter().all(turned) => numberings,
        _ => Vec::new(),
    }
}

/// Columns and rows of a grid that is not the declared one, in its most compact numbering.
fn extent(discs: &Discs, spec: &TargetSpec) -> impl Iterator<Item = [u32; 2]> {
    let all = bases(discs, spec).into_iter().map(|numbering| lengths(&numbering, discs));
    let best = all.min_by_key(|[a, b]| i64::from(*a) * i64::from(*b));
    let asymmetric = spec.kind == TargetKind::AsymmetricCircles;
    best.map(|[a, b]| if asymmetric { [(a as u32).div_ceil(2), b as u32] } else { [a as u32, b as u32] })
        .into_iter()
}

/// Numbers the circles so that the columns run as nearly as possible with the image's x.
fn numbered(discs: &Discs, numberings: &[Numbering], spec: &TargetSpec) -> Detection {
    let rightness = |numbering: &Numbering| {
        let centred = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            values.iter().map(|v| v - mean).collect::<Vec<f64>>()
        };
        let x = centred(&discs.keys().map(|p| f64::from(numbering.of(*p).0)).collect::<Vec<f64>>());
        x.iter().zip(discs.values()).map(|(x, disc)| x * disc.pixel.x).sum::<f64>()
    };
    let best = numberings.iter().max_by(|a, b| rightness(a).total_cmp(&rightness(b)));
    let ambiguity = match numberings.len() {
        1 => Ambiguity::None,
        2 => Ambiguity::HalfTurn,
        _ => Ambiguity::QuarterTurn,
    };
    let points = discs.iter().filter_map(|(place, disc)| {
        Some(DetectedPoint {
            index: best?.index(*place, spec)?,
            pixel: disc.pixel,
            covariance_px2: disc.covariance_px2,
            blur_px: disc.blur_px,
            edges: None,
            contrast_dn: disc.contrast_dn.abs(),
            residual_dn: disc.residual_dn,
        })
    });
    Detection::new(spec, points.collect(), ambiguity).with_radius(radius_per_pitch(discs, spec))
}

/// Median of r/√(area of a square pitch), which no tilt changes.
fn radius_per_pitch(discs: &Discs, spec: &TargetSpec) -> f64 {
    let pitches = if spec.kind == TargetKind::AsymmetricCircles { 2.0 } else { 1.0 };
    let mut radii: Vec<f64> = discs
        .iter()
        .filter_map(|(place, disc)| {
            let [e, f] = discs.steps(*place)?;
            Some(disc.radius_px() * (pitches / e.perp(&f).abs()).sqrt())
        })
        .collect();
    median(&mut radii).unwrap_or(f64::NAN)
}
