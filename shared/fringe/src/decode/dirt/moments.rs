//! Which frame of a set of three or four does not show its step: from variances and covariances of the frames over whole fringes.
//!
//! So few frames leave a pixel nothing, or one number that every frame may have caused. Over whole fringes they tell more: in a tile, frames that
//! show cos(φ − δ) have one variance, and covariances in proportion to the cosine of the difference of their steps, beside what the
//! reflectance of the part adds to all of them. If one frame is wrong, the others alone follow that, and its covariances with them
//! tell its contrast and its step.

use super::finding::Fault;
use super::rows::{BLACK, BLURRED, MOVED_RAD};
use super::samples::Samples;
use crate::math::{atan2, sincos, wrap_rad};
use nalgebra::{Matrix2, Vector2};

/// Most frames of a set that is looked at in this way.
pub(super) const MOST_STEPS: usize = 4;
/// Tiles along each side.
const TILES: usize = 4;
/// Fewest pixels of a tile.
const LEAST_IN_TILE: f64 = 100.0;
/// Sectors of the ellipse on which two frames run through a fringe, and the least of an equal share that each must hold: a tile of less
/// than one fringe proves nothing.
const SECTORS: usize = 12;
const LEAST_SECTOR: f64 = 0.1;
/// Most correlated frames that still run through an ellipse: in a part of a fringe they run along a line.
const MOST_CORRELATION: f64 = 0.9;
/// Pixels nearer to the middle than half the usual distance are on no ellipse; at most this part may be.
const MOST_INSIDE: f64 = 0.1;
/// Frames that run through an ellipse have at least this part of the others' standard deviation.
const LEAST_DEVIATION: f64 = 0.3;
/// Fewest tiles of whole fringes.
const LEAST_TILES: usize = 4;
/// Misfit over the variance of a frame from which the frames contradict each other.
const CONTRADICTION: f64 = 0.15;
/// With the wrong frame left aside, the misfit is at most this part of it.
const EXPLAINED: f64 = 0.3;
/// A frame is wrong that is so in this share of the tiles.
const SHARE: f64 = 0.25;

/// Variances and covariances of four frames.
type Covariances = [[f64; MOST_STEPS]; MOST_STEPS];

/// Sums over the pixels of a tile.
#[derive(Debug, Clone, Copy, Default)]
struct Tile {
    count: f64,
    sums: [f64; MOST_STEPS],
    products: Covariances,
    sectors: [f64; SECTORS],
    /// Pixels near the middle of the ellipse.
    inside: f64,
}

/// The frame that is wrong in many tiles, and what is wrong with it; no frame where two explain it equally well.
pub(super) fn wrong_frame(samples: &Samples) -> Option<(Option<usize>, Fault)> {
    let shifts_rad = samples.shifts_rad();
    let tiles = tiles(samples);
    let (mut whole, mut votes) = (0, [0; MOST_STEPS]);
    let mut faults = [[None; TILES * TILES]; MOST_STEPS];
    for tile in tiles.iter().filter(|tile| tile.is_whole()) {
        let found = tile.faults(shifts_rad);
        for ((votes, faults), fault) in votes.iter_mut().zip(&mut faults).zip(found) {
            faults[whole] = fault;
            *votes += usize::from(fault.is_some());
        }
        whole += 1;
    }
    let most = *votes.iter().max()?;
    if whole < LEAST_TILES || (most as f64) < SHARE * whole as f64 {
        return None;
    }
    let step = votes.iter().position(|votes| *votes == most)?;
    let rival = (0..MOST_STEPS).any(|other| other != step && 2 * votes[other] > most);
    // A hand covers some tiles; a frame that is blurred, shifted or black is so everywhere.
    let fault =
        if 4 * most < 3 * whole { Some(Fault::Strange) } else { middle_fault(&mut faults[step][..whole]) };
    Some(((!rival).then_some(step), fault?))
}

/// The fault in the middle of those of many tiles.
fn middle_fault(faults: &mut [Option<Fault>]) -> Option<Fault> {
    let size = |fault: &Option<Fault>| fault.map_or(f64::INFINITY, |fault| fault.size());
    faults.sort_unstable_by(|a, b| size(a).total_cmp(&size(b)));
    let found = faults.iter().flatten().count();
    faults[found / 2]
}

fn tiles(samples: &Samples) -> [Tile; TILES * TILES] {
    let (steps, (width, height)) = (samples.steps(), samples.size_px());
    let mut tiles = [Tile::default(); TILES * TILES];
    let home = |place: usize| {
        let (x, y) = (place % width * TILES / width, place / width * TILES / height);
        (y * TILES + x).min(TILES * TILES - 1)
    };
    samples.each_dn(|place, values| {
        let tile = &mut tiles[home(place)];
        tile.count += 1.0;
        for i in 0..steps {
            tile.sums[i] += values[i];
            for j in 0..steps {
                tile.products[i][j] += values[i] * values[j];
            }
        }
    });
    let ellipses = tiles.map(|tile| tile.ellipse(steps));
    samples.each_dn(|place, values| {
        if let Some(ellipse) = &ellipses[home(place)] {
            let tile = &mut tiles[home(place)];
            match ellipse.sector(values) {
                Some(sector) => tile.sectors[sector] += 1.0,
                None => tile.inside += 1.0,
            }
        }
    });
    tiles
}

/// Two frames of a tile that are least alike, and what makes a circle of the ellipse on which they run.
#[derive(Debug, Clone, Copy)]
struct Ellipse {
    frames: [usize; 2],
    means: [f64; 2],
    deviations: [f64; 2],
    correlation: f64,
}

impl Ellipse {
    /// The sector of a pixel; none near the middle.
    fn sector(&self, values: &[f64]) -> Option<usize> {
        let [u, v] = [0, 1].map(|k| (values[self.frames[k]] - self.means[k]) / self.deviations[k]);
        let across = (v - self.correlation * u) / (1.0 - self.correlation * self.correlation).sqrt();
        let turns = atan2(across, u) / std::f64::consts::TAU + 0.5;
        // Half of the root mean square of the distance, which is √2.
        let outside = u * u + across * across > 0.5;
        outside.then_some(((turns * SECTORS as f64) as usize).min(SECTORS - 1))
    }
}

impl Tile {
    fn covariance(&self, i: usize, j: usize) -> f64 {
        self.products[i][j] / self.count - self.sums[i] / self.count * (self.sums[j] / self.count)
    }

    fn ellipse(&self, steps: usize) -> Option<Ellipse> {
        if self.count < LEAST_IN_TILE {
            return None;
        }
        let deviations: [f64; MOST_STEPS] = std::array::from_fn(|i| self.covariance(i, i).max(0.0).sqrt());
        let least = LEAST_DEVIATION * middle(deviations, steps);
        let pairs = (0..steps).flat_map(|i| (0..i).map(move |j| [i, j]));
        let moving = pairs.filter(|pair| pair.iter().all(|i| deviations[*i] > least));
        let correlation = |[i, j]: [usize; 2]| self.covariance(i, j) / (deviations[i] * deviations[j]);
        let frames = moving.min_by(|a, b| correlation(*a).abs().total_cmp(&correlation(*b).abs()))?;
        (correlation(frames).abs() < MOST_CORRELATION).then(|| Ellipse {
            frames,
            means: frames.map(|i| self.sums[i] / self.count),
            deviations: frames.map(|i| deviations[i]),
            correlation: correlation(frames),
        })
    }

    fn is_whole(&self) -> bool {
        let least = LEAST_SECTOR * self.count / SECTORS as f64;
        let on_ellipse = self.inside <= MOST_INSIDE * self.count;
        self.count >= LEAST_IN_TILE && on_ellipse && self.sectors.iter().all(|sector| *sector >= least)
    }

    /// The faults of the frames that may be wrong here: those without which the others fit.
    fn faults(&self, shifts_rad: &[f64]) -> [Option<Fault>; MOST_STEPS] {
        let steps = shifts_rad.len();
        let mut faults = [None; MOST_STEPS];
        let means = self.sums.map(|sum| sum / self.count);
        let covariances: Covariances =
            std::array::from_fn(|i| std::array::from_fn(|j| self.covariance(i, j)));
        let usual = middle(means, steps);
        let levels = means.map(|mean| mean / usual);
        let scale = middle(std::array::from_fn(|i| covariances[i][i]), steps);
        let Some((reflectance, fringes)) = shared(&covariances, &levels, shifts_rad, None) else {
            return faults;
        };
        let mut before = 0.0;
        for i in 0..steps {
            for j in 0..=i {
                let told =
                    reflectance * levels[i] * levels[j] + fringes * sincos(shifts_rad[i] - shifts_rad[j]).1;
                before += (covariances[i][j] - told) * (covariances[i][j] - told);
            }
        }
        let before = before.sqrt() / scale;
        if before < CONTRADICTION {
            return faults;
        }
        for (step, slot) in faults[..steps].iter_mut().enumerate() {
            if let Some((fault, left)) = without(&covariances, &levels, shifts_rad, step)
                && left / scale < EXPLAINED * before
            {
                *slot = fault;
            }
        }
        faults
    }
}

/// Reflectance and fringes in the covariances of all frames but one, by least squares over their pairs.
fn shared(
    covariances: &Covariances,
    levels: &[f64; MOST_STEPS],
    shifts_rad: &[f64],
    but: Option<usize>,
) -> Option<(f64, f64)> {
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    let used = |i: &usize| Some(*i) != but;
    for i in (0..shifts_rad.len()).filter(used) {
        for j in (0..=i).filter(used) {
            let row = Vector2::new(levels[i] * levels[j], sincos(shifts_rad[i] - shifts_rad[j]).1);
            normal += row * row.transpose();
            right += row * covariances[i][j];
        }
    }
    let solved = normal.try_inverse()? * right;
    (solved.y > 0.0).then_some((solved.x, solved.y))
}

/// What one frame shows if the others are right, if that is a fault; and what is left of all covariances.
fn without(
    covariances: &Covariances,
    levels: &[f64; MOST_STEPS],
    shifts_rad: &[f64],
    wrong: usize,
) -> Option<(Option<Fault>, f64)> {
    let others = || (0..shifts_rad.len()).filter(|i| *i != wrong);
    let (reflectance, fringes) = shared(covariances, levels, shifts_rad, Some(wrong))?;
    let column = |i: usize| {
        let (s, c) = sincos(shifts_rad[i]);
        Vector2::new(c, s)
    };
    let told = |i: usize, j: usize| reflectance * levels[i] * levels[j] + fringes * column(i).dot(&column(j));
    let mut left = 0.0;
    let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
    for i in others() {
        let with = (covariances[wrong][i] - reflectance * levels[wrong] * levels[i]) / fringes;
        normal += column(i) * column(i).transpose();
        right += column(i) * with;
        for j in others().filter(|j| *j <= i) {
            left += (covariances[i][j] - told(i, j)) * (covariances[i][j] - told(i, j));
        }
    }
    let shown = normal.try_inverse()? * right;
    for i in others() {
        let told = reflectance * levels[wrong] * levels[i] + fringes * shown.dot(&column(i));
        left += (covariances[wrong][i] - told) * (covariances[wrong][i] - told);
    }
    let own = reflectance * levels[wrong] * levels[wrong] + fringes * shown.norm_squared();
    left += (covariances[wrong][wrong] - own) * (covariances[wrong][wrong] - own);
    Some((fault(levels[wrong], shown, shifts_rad[wrong]), left.sqrt()))
}

/// What a frame shows that it should not.
fn fault(level: f64, shown: Vector2<f64>, shift_rad: f64) -> Option<Fault> {
    let contrast = shown.norm();
    let off_rad = wrap_rad(atan2(shown.y, shown.x) - shift_rad);
    if level < BLACK && contrast < BLACK {
        Some(Fault::Black)
    } else if !(BLURRED..=1.0 / BLURRED).contains(&contrast) {
        Some(Fault::Blurred(contrast))
    } else if off_rad.abs() > MOVED_RAD {
        Some(Fault::Moved(off_rad))
    } else {
        None
    }
}

/// The value in the middle of the first so many.
fn middle(mut values: [f64; MOST_STEPS], count: usize) -> f64 {
    values[..count].sort_unstable_by(f64::total_cmp);
    values[count / 2]
}
