//! Poses from pairs of oriented points: where nothing is known, the surfaces' own shape proposes how they may lie.
//!
//! B. Drost, M. Ulrich, N. Navab, S. Ilic, Model globally, match locally, CVPR 2010: two places with their normals are
//! described by their distance and three angles, which no motion changes. Pairs of the reference are filed by this
//! description; pairs of the cloud that look up the same entry give poses. Instead of voting, every pose is counted out
//! at once on a grid ([`Near`]), which serves flat parts too: there most pairs look alike and votes smear.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::near::Near;
use super::oriented::{Sample, Samples};
use fringe::geometry::pose::Pose;
use fringe::math;
use fringe::math::random::Key;

/// Steps of an angle: 15°, more than normals scatter and less than what distinguishes shapes.
const ANGLE_BINS: usize = 12;

/// Steps of a distance.
const DISTANCE_BINS: usize = 32;

/// Pairs drawn from the cloud.
const DRAWS: u64 = 3000;

/// Most poses that one pair of the cloud proposes; of more, every k-th.
const MOST_POSES: usize = 100;

/// Distances of a pair, in diagonals of the cloud: short ones fix no direction, long ones are few.
const DISTANCES: std::ops::Range<f64> = 0.15..0.75;

/// Sine above which a direction lies well enough across another one.
const ACROSS: f64 = 0.35;

/// Share of samples that a pose must reach to be kept, in parts of the best one's.
const KEPT_SHARE: f64 = 0.6;

/// Poses kept in all.
const MOST_KEPT: usize = 1500;

/// Pairs of the reference by their description.
struct Filed {
    step_mm: f64,
    /// Where each entry begins; one more than there are entries.
    begins: Vec<u32>,
    pairs: Vec<[u16; 2]>,
}

/// The description of a pair: distance in steps, angles in steps.
fn describe(a: &Sample, b: &Sample, step_mm: f64) -> Option<[f64; 4]> {
    let along = b.place - a.place;
    let distance_mm = along.norm();
    let direction = along / distance_mm;
    if distance_mm <= 0.0 || distance_mm / step_mm >= DISTANCE_BINS as f64 - 1.0 {
        return None;
    }
    let angle =
        |cosine: f64| math::acos(cosine.clamp(-1.0, 1.0)) * (ANGLE_BINS as f64 / std::f64::consts::PI);
    let (first, second) = (a.normal.dot(&direction), b.normal.dot(&direction));
    Some([distance_mm / step_mm, angle(first), angle(second), angle(a.normal.dot(&b.normal))])
}

/// Whether both places may lie in one plane: such a pair defines a plane and a point of it, and most parts are full of them.
fn in_one_plane(a: &Sample, b: &Sample) -> bool {
    let along = b.place - a.place;
    a.normal.dot(&b.normal).abs() > 0.95 && a.normal.dot(&along).abs() < 0.12 * along.norm()
}

fn slot(bins: [usize; 4]) -> usize {
    bins[1..].iter().fold(bins[0], |sum, bin| sum * ANGLE_BINS + bin)
}

impl Filed {
    /// Files the pairs of samples within the distances that the cloud has.
    fn new(samples: &[Sample], step_mm: f64, range_mm: &std::ops::Range<f64>, flat: bool) -> Self {
        let bin = |value: f64| (value as usize).min(ANGLE_BINS - 1);
        let of = |i: usize| {
            let a = &samples[i];
            let others = samples.iter().zip(0_u16..).filter(move |(_, j)| usize::from(*j) != i);
            others.filter_map(move |(b, j)| {
                let far = (b.place - a.place).norm();
                if !range_mm.contains(&far) || (!flat && in_one_plane(a, b)) {
                    return None;
                }
                let [d, x, y, z] = describe(a, b, step_mm)?;
                Some((slot([d as usize, bin(x), bin(y), bin(z)]) as u32, [i as u16, j]))
            })
        };
        let mut keyed: Vec<(u32, [u16; 2])> = (0..samples.len()).into_par_iter().flat_map_iter(of).collect();
        keyed.par_sort_unstable();
        let mut begins = vec![0_u32; DISTANCE_BINS * ANGLE_BINS.pow(3) + 1];
        for (key, _) in &keyed {
            begins[*key as usize + 1] += 1;
        }
        for i in 1..begins.len() {
            begins[i] += begins[i - 1];
        }
        Self { step_mm, begins, pairs: keyed.into_iter().map(|(_, pair)| pair).collect() }
    }

    /// Pairs that look like this one: in each of the four numbers the step it lies in and the nearer neighbour.
    fn like(&self, a: &Sample, b: &Sample) -> Vec<[u16; 2]> {
        let Some(values) = describe(a, b, self.step_mm) else { return Vec::new() };
        let steps =
            values.map(|v| [v.floor(), if v.fract() < 0.5 { v.floor() - 1.0 } else { v.floor() + 1.0 }]);
        let mut found = Vec::new();
        for choice in 0..16_usize {
            let picked: [f64; 4] = std::array::from_fn(|i| steps[i][choice >> i & 1]);
            let inside = |i: usize| {
                let limit = if i == 0 { DISTANCE_BINS } else { ANGLE_BINS };
                picked[i] >= 0.0 && picked[i] < limit as f64
            };
            if (0..4).all(inside) {
                let slot = slot(picked.map(|v| v as usize));
                found.extend(&self.pairs[self.begins[slot] as usize..self.begins[slot + 1] as usize]);
            }
        }
        found
    }
}

/// A frame of a pair: first axis the first normal, second across it towards the second normal or place.
fn frame(a: &Sample, b: &Sample, by_normal: bool) -> Option<Matrix3<f64>> {
    let towards = if by_normal { b.normal } else { (b.place - a.place).normalize() };
    let across = towards - a.normal * towards.dot(&a.normal);
    let length = across.norm();
    if length < 0.5 * ACROSS {
        return None;
    }
    let second = across / length;
    Some(Matrix3::from_columns(&[a.normal, second, a.normal.cross(&second)]))
}

/// The motion that brings one pair onto another.
fn motion(from: [&Sample; 2], to: [&Sample; 2]) -> Option<Pose> {
    let by_normal = from[0].normal.cross(&from[1].normal).norm() > ACROSS;
    let rotation = frame(to[0], to[1], by_normal)? * frame(from[0], from[1], by_normal)?.transpose();
    let middle = |pair: [&Sample; 2]| (pair[0].place + pair[1].place) * 0.5;
    Some(Pose { rotation, translation: middle(to) - rotation * middle(from) })
}

/// A pose with the number of samples that lie on the reference there.
#[derive(Clone, Copy)]
pub(super) struct Proposal {
    pub pose: Pose,
    pub count: usize,
}

/// What proposals are drawn from and counted on.
pub(super) struct Proposer<'a> {
    /// The cloud's samples, and a few of them, evenly spread, on which poses are counted.
    pub cloud: &'a Samples,
    pub few: &'a [Sample],
    /// The reference's samples, one every `spacing_mm`.
    pub reference: &'a Samples,
    pub spacing_mm: f64,
    pub near: &'a Near<'a>,
    /// Whether the signs of the normals count.
    pub signed: bool,
}

impl Proposer<'_> {
    /// Poses in which many samples lie on the reference, best first.
    pub fn propose(&self) -> Vec<Proposal> {
        let diagonal_mm = self.cloud.diagonal_mm();
        let range_mm = DISTANCES.start * diagonal_mm..DISTANCES.end * diagonal_mm;
        let step_mm = range_mm.end / (DISTANCE_BINS as f64 - 2.0);
        let (mut draws, flat) = self.draws(&range_mm);
        let samples = &self.reference.list[..self.reference.list.len().min(usize::from(u16::MAX))];
        let filed = Filed::new(samples, step_mm, &range_mm, flat);
        // Without signs each pair is one of four.
        let signs: &[[f64; 2]] =
            if self.signed { &[[1.0, 1.0]] } else { &[[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] };
        draws.truncate(DRAWS as usize / signs.len());
        let of = |[i, j]: &[usize; 2]| -> Vec<Proposal> {
            signs.iter().flat_map(|signs| self.of_pair(&filed, *i, *j, *signs)).collect()
        };
        let mut found: Vec<Proposal> = draws.par_iter().flat_map_iter(of).collect();
        found.sort_by_key(|p| std::cmp::Reverse(p.count));
        let least = found.first().map_or(0, |best| (KEPT_SHARE * best.count as f64) as usize);
        found.retain(|p| p.count >= least);
        found.truncate(MOST_KEPT);
        found
    }

    /// Pairs of the cloud, and whether pairs within one plane had to be taken since there are no others.
    fn draws(&self, range_mm: &std::ops::Range<f64>) -> (Vec<[usize; 2]>, bool) {
        let (key, count) = (Key::new(20_100), self.cloud.list.len() as u64);
        let draw = |number: u64| {
            let pick = |k: u64| (key.bits(2 * number + k) % count.max(1)) as usize;
            [pick(0), pick(1)]
        };
        let of = |pair: &[usize; 2]| pair.map(|i| &self.cloud.list[i]);
        let within = |pair: &[usize; 2]| {
            let [a, b] = of(pair);
            range_mm.contains(&(b.place - a.place).norm())
        };
        let apart = |pair: &[usize; 2]| {
            let [a, b] = of(pair);
            !in_one_plane(a, b)
        };
        let tried = || (0..40 * DRAWS).map(draw).filter(within);
        let telling: Vec<[usize; 2]> = tried().filter(apart).take(DRAWS as usize).collect();
        if telling.len() as u64 >= DRAWS / 4 {
            (telling, false)
        } else {
            (tried().take(DRAWS as usize).collect(), true)
        }
    }

    /// The poses of one pair that count.
    fn of_pair(&self, filed: &Filed, i: usize, j: usize, signs: [f64; 2]) -> Vec<Proposal> {
        let with_sign = |i: usize, sign: f64| {
            let sample = self.cloud.list[i];
            Sample { normal: sample.normal * sign, ..sample }
        };
        let (a, b) = (with_sign(i, signs[0]), with_sign(j, signs[1]));
        let alike = filed.like(&a, &b);
        let step = alike.len().div_ceil(MOST_POSES).max(1);
        let mut best = Vec::new();
        let mut most = self.few.len() / 5;
        for pair in alike.iter().skip((i + j) % step).step_by(step) {
            let [c, d] = pair.map(|k| &self.reference.list[usize::from(k)]);
            let Some(pose) = motion([&a, &b], [c, d]) else { continue };
            let least = (KEPT_SHARE * most as f64) as usize;
            let count = self.near.count(self.few, &pose, self.spacing_mm, least.max(1));
            if count > 0 {
                most = most.max(count);
                best.push(Proposal { pose, count });
            }
        }
        best
    }
}

/// Mean distance between where two poses put samples, mm.
pub(super) fn apart_mm(samples: &[Sample], a: &Pose, b: &Pose) -> f64 {
    let sum: f64 = samples.iter().map(|s| (a.point(&s.place) - b.point(&s.place)).norm()).sum();
    sum / samples.len().max(1) as f64
}

/// A place of a sample after a motion.
pub(super) fn moved(sample: &Sample, pose: &Pose) -> (Vector3<f64>, Vector3<f64>) {
    (pose.point(&sample.place), pose.rotation * sample.normal)
}
