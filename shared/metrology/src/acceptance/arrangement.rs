//! Where the artefacts were measured to be: no measurement twice, apart, inside the volume, in every direction of it.

use nalgebra::{Point3, Vector3};

use super::AcceptanceError;
use super::conform::measured;
use super::copies::Neighbourhoods;
use super::plan::TestPlan;
use super::result::{Violation, Volume};
use super::rules::{Kind, Quantity, Rule, RuleSet};
use crate::fit::Form;
use fringe::cloud::Point;
use fringe::math;

/// Axes that differ by less are one direction.
const SAME_DIRECTION_DEG: f64 = 15.0;

/// Standard deviations of residuals that differ by less than this part of themselves, and ranges by ten times as much, are
/// those of the same points: rounding to single precision changes them by less, no second measurement so little.
const SAME_FORM: f64 = 1e-5;

/// Forms below this say nothing about whether points are the same, mm.
const LEAST_FORM_MM: f64 = 1e-6;

/// A cloud that has more of its neighbourhoods in common with another is a copy of it.
const COPIED: f64 = 0.3;

/// Neighbourhoods tell clouds apart only where fewer of them occur three times in one cloud: by chance two clouds then have no
/// more than a fifth in common.
const ALIKE: f64 = 0.02;

/// More points than this share that lie on others to the last digit were written twice.
const TWINS: f64 = 0.01;

/// Repeats lie nearer to their position than this over the body diagonal, where no rule says how far positions lie apart.
const REPEAT_REACH: f64 = 0.05;

/// Where an artefact was at a position.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    /// Name of the position; repeats have the same.
    pub position: String,
    /// Kind of the artefact.
    pub kind: Kind,
    /// Centres of its spheres; of a plane two points above and below its middle.
    pub centres: Vec<Point3<f64>>,
}

/// Every measurement so far.
#[derive(Debug, Default)]
pub(super) struct Arrangement {
    placed: Vec<Placed>,
    clouds: Vec<(Fingerprint, String)>,
    forms: Vec<(Vec<Form>, String)>,
    neighbourhoods: Vec<(Neighbourhoods, String)>,
}

/// Count and two sums over mixed bits of coordinates: the same for the same points in any order.
type Fingerprint = (usize, u64, u64);

fn fingerprint(cloud: &[Point]) -> Fingerprint {
    let mix = |seed: u64, value: u64| {
        // The finaliser of SplitMix64 (Steele, Lea, Flood 2014).
        let mut z = (seed ^ value).wrapping_add(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let of_point =
        |seed: u64, p: &Point| p.position_mm.iter().fold(seed, |so_far, v| mix(so_far, v.to_bits()));
    let sum = |seed: u64| cloud.iter().fold(0_u64, |sum, p| sum.wrapping_add(of_point(seed, p)));
    (cloud.len(), sum(1), sum(2))
}

impl Arrangement {
    /// Takes note of a cloud.
    ///
    /// # Errors
    /// A cloud that has been there: one measurement must not count twice.
    pub fn cloud(&mut self, place: &str, cloud: &[Point]) -> Result<(), AcceptanceError> {
        let print = fingerprint(cloud);
        if let Some((_, other)) = self.clouds.iter().find(|(known, _)| *known == print) {
            return Err(twice(place, other, "holds the same points as"));
        }
        self.clouds.push((print, place.to_owned()));
        Ok(())
    }

    /// Takes note of the forms of the elements of a view.
    ///
    /// # Errors
    /// Forms that have been there to the last digit: a measurement that was moved to another place.
    pub fn forms(&mut self, place: &str, forms: Vec<Form>) -> Result<(), AcceptanceError> {
        let near = |a: f64, b: f64, part: f64| (a - b).abs() <= part * a.abs().max(b.abs());
        let same = |a: &Form, b: &Form| {
            a.points == b.points
                && a.form_sigma_mm > LEAST_FORM_MM
                && near(a.form_sigma_mm, b.form_sigma_mm, SAME_FORM)
                && near(a.form_range_mm, b.form_range_mm, 10.0 * SAME_FORM)
        };
        let alike =
            |known: &[Form]| known.len() == forms.len() && known.iter().zip(&forms).all(|(a, b)| same(a, b));
        if let Some((_, other)) = self.forms.iter().find(|(known, _)| alike(known)) {
            return Err(twice(place, other, "has the count of points and the residuals, to five digits, of"));
        }
        self.forms.push((forms, place.to_owned()));
        Ok(())
    }

    /// Takes note of the points of an element of a view.
    ///
    /// # Errors
    /// Points that are there twice; points of another cloud, moved, in another order or changed at some places.
    pub fn points(&mut self, place: &str, points: &[Point3<f64>]) -> Result<(), AcceptanceError> {
        let new = Neighbourhoods::new(points);
        let twins = new.share_twins();
        if twins > TWINS {
            let message = format!(
                "{:.1} % of the points lie on another one to the last digit, at most {:.1} %: points that count twice hide \
                 others; evaluate the cloud as it was measured",
                100.0 * twins,
                100.0 * TWINS
            );
            return Err(AcceptanceError::Plan { place: place.to_owned(), message });
        }
        if new.share_alike() <= ALIKE {
            let shares = self.neighbourhoods.iter().map(|(known, other)| (new.share_in(known), other));
            if let Some((share, other)) =
                shares.max_by(|a, b| a.0.total_cmp(&b.0)).filter(|(s, _)| *s > COPIED)
            {
                let how = format!(
                    "has {:.0} % of its points, with the distances of each from its neighbours, in common with",
                    100.0 * share
                );
                return Err(twice(place, other, &how));
            }
        }
        self.neighbourhoods.push((new, place.to_owned()));
        Ok(())
    }

    /// Takes note of a place.
    pub fn place(&mut self, placed: Placed) {
        self.placed.push(placed);
    }

    /// The rules that the places break.
    pub fn violations(&self, plan: &TestPlan, rules: &RuleSet) -> Vec<Violation> {
        let volume = Volume::new(plan.volume.total_mm);
        let mut list = self.outside(plan, &volume);
        for kind in [Kind::Sphere, Kind::BallBar, Kind::Plane] {
            let mut of_kind: Vec<&Placed> = Vec::new();
            for one in self.placed.iter().filter(|one| one.kind == kind) {
                match of_kind.iter().find(|known| known.position == one.position) {
                    Some(first) => list.extend(repeat_elsewhere(first, one, rules, &volume)),
                    None => of_kind.push(one),
                }
            }
            if let Some((what, apart_mm)) = closest(&of_kind) {
                let quantity = (kind, Quantity::ApartOverDiagonal);
                list.extend(measured(rules, &volume, quantity, &what, apart_mm / volume.body_diagonal_mm));
            }
            if of_kind.is_empty() {
                continue;
            }
            let (all, name) = (format!("all positions of {}", kind.name()), kind.name());
            list.extend(measured(
                rules,
                &volume,
                (kind, Quantity::Directions),
                name,
                directions(&of_kind) as f64,
            ));
            let extent = extent(&of_kind, &volume);
            list.extend(measured(rules, &volume, (kind, Quantity::ExtentOverVolume), &all, extent));
        }
        list
    }

    /// Centres outside the total volume.
    fn outside(&self, plan: &TestPlan, volume: &Volume) -> Vec<Violation> {
        let Some(middle) = plan.volume.center_mm.map(Point3::from) else { return Vec::new() };
        let far = |placed: &Placed| {
            let beyond = |axis: usize| {
                let off = placed.centres.iter().map(|c| (c[axis] - middle[axis]).abs()).fold(0.0, f64::max);
                (off > 0.5 * volume.size_mm[axis]).then_some((axis, off))
            };
            let (axis, actual) = (0..3).find_map(beyond)?;
            let (required, name) = (0.5 * volume.size_mm[axis], ["x", "y", "z"][axis]);
            let text = format!(
                "positions in the total volume: position {} lies {actual:.3} mm from center_mm along {name}, at most \
                 {required:.3} mm",
                placed.position
            );
            let rule = "positions in the total volume".to_owned();
            Some(Violation { rule, required, actual, unit: "mm".into(), text })
        };
        self.placed.iter().filter_map(far).collect()
    }
}

/// A repeat, and a retest, stands where its position stands: elsewhere it would be another position.
fn repeat_elsewhere(first: &Placed, again: &Placed, rules: &RuleSet, volume: &Volume) -> Option<Violation> {
    let apart = |rule: &&Rule| rule.artefact == first.kind && rule.quantity == Quantity::ApartOverDiagonal;
    let reach = rules.rules.iter().find(apart).and_then(|rule| rule.least).unwrap_or(REPEAT_REACH);
    let (required, actual) = (reach * volume.body_diagonal_mm, apart_mm(first, again));
    let rule = "repeats at the place of their position".to_owned();
    let text = format!(
        "{rule}: a repeat of position {} lies {actual:.3} mm from its first measurement, less than {required:.3} mm",
        first.position
    );
    (actual >= required).then_some(Violation { rule, required, actual, unit: "mm".into(), text })
}

fn twice(place: &str, other: &str, how: &str) -> AcceptanceError {
    let message =
        format!("{how} {other}: one measurement must not count twice; measure each position and repeat anew");
    AcceptanceError::Plan { place: place.to_owned(), message }
}

/// How far two positions lie apart: the larger way of the two ends, which look alike.
fn apart_mm(a: &Placed, b: &Placed) -> f64 {
    let ends = |p: &Placed| (p.centres.first().copied(), p.centres.last().copied());
    let ((Some(a1), Some(a2)), (Some(b1), Some(b2))) = (ends(a), ends(b)) else { return f64::INFINITY };
    let straight = (a1 - b1).norm().max((a2 - b2).norm());
    let turned = (a1 - b2).norm().max((a2 - b1).norm());
    straight.min(turned)
}

fn closest(placed: &[&Placed]) -> Option<(String, f64)> {
    let pairs = placed.iter().enumerate().flat_map(|(i, a)| placed[..i].iter().map(move |b| (*b, *a)));
    let distances = pairs
        .map(|(a, b)| (format!("the pair of positions {} and {}", a.position, b.position), apart_mm(a, b)));
    distances.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Axes that differ by at least [`SAME_DIRECTION_DEG`] from all counted before.
fn directions(placed: &[&Placed]) -> usize {
    let near = math::cos(SAME_DIRECTION_DEG.to_radians());
    let mut known: Vec<Vector3<f64>> = Vec::new();
    for one in placed {
        let (Some(first), Some(last)) = (one.centres.first(), one.centres.last()) else { continue };
        let Some(axis) = (last - first).try_normalize(0.0) else { continue };
        if known.iter().all(|other| other.dot(&axis).abs() <= near) {
            known.push(axis);
        }
    }
    known.len()
}

/// Extent of all centres over the edge of the volume, the least of the three axes.
fn extent(placed: &[&Placed], volume: &Volume) -> f64 {
    let along = |axis: usize| {
        let values = || placed.iter().flat_map(|p| &p.centres).map(|c| c[axis]);
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        (high - low) / volume.size_mm[axis]
    };
    (0..3).map(along).fold(f64::INFINITY, f64::min)
}
