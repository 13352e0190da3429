//! A tolerance band on the deviations of a surface: how much of it lies outside, and what is proven.

use crate::reference::Deviation;
use crate::verdict::Verdict;
use fringe::cloud::Point;
use serde::Serialize;

/// Guard band of a deviation in standard uncertainties: a coverage of 95 %.
pub const GUARD_FACTOR: f64 = 2.0;

/// Limits of the deviation, and the share of the points that may lie outside.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Tolerance {
    /// Smallest deviation allowed, mm.
    pub lower_mm: f64,
    /// Largest deviation allowed, mm.
    pub upper_mm: f64,
    /// Share of the points that may lie outside, 0 … 1.
    pub allowed_share: f64,
}

/// Points inside and outside of a tolerance band. Points farther from the reference than the largest distance that is compared
/// lie outside; points beside the reference, and where it has no surface, are not judged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Conformity {
    /// The limits that decide.
    #[serde(flatten)]
    pub tolerance: Tolerance,
    /// Number of points that are judged.
    pub judged: usize,
    /// Number of points that are not: beside the reference, or where it has no surface.
    pub not_judged: usize,
    /// Number of points below the lower limit.
    pub below: usize,
    /// Number of points above the upper limit.
    pub above: usize,
    /// Number of points farther away than the largest distance that is compared.
    pub too_far: usize,
    /// Share of the judged points that lies outside, 0 … 1.
    pub outside_share: f64,
    /// Share that lies outside by more than the guard band: proven.
    pub proven_outside_share: f64,
    /// Share that does not lie inside by the guard band: possibly outside.
    pub possibly_outside_share: f64,
    /// Guard band in standard uncertainties of a deviation.
    pub guard_factor: f64,
    /// Largest guard band of a deviation, mm; 0 where neither cloud states uncertainties.
    pub largest_guard_mm: f64,
    /// By ISO 14253-1, of the shares.
    pub verdict: Verdict,
}

impl Conformity {
    /// Whether any deviation has an uncertainty: else the verdict is a simple acceptance.
    pub fn has_guard_band(&self) -> bool {
        self.largest_guard_mm > 0.0
    }
}

impl Tolerance {
    /// Judges the deviations of some points from a reference whose standard uncertainty there is known, mm; `None` where no point is judged.
    pub fn judge(
        self,
        points: &[Point],
        reference_sigmas_mm: &[f32],
        deviations: &[Deviation],
    ) -> Option<Conformity> {
        let (mut below, mut above, mut too_far, mut not_judged) = (0, 0, 0, 0);
        let (mut proven, mut possible, mut largest_guard_mm) = (0_usize, 0_usize, 0.0_f64);
        let sigmas = points.iter().map(|point| point.sigma_mm).zip(reference_sigmas_mm);
        for ((of_point, of_reference), deviation) in sigmas.zip(deviations) {
            // An uncertainty that is no number proves nothing.
            let (one, other) = (f64::from(of_point), f64::from(*of_reference));
            let known = one >= 0.0 && other >= 0.0;
            let guard_mm =
                if known { GUARD_FACTOR * (one * one + other * other).sqrt() } else { f64::INFINITY };
            match deviation {
                Deviation::Mm(mm) => {
                    largest_guard_mm = largest_guard_mm.max(guard_mm);
                    below += usize::from(*mm < self.lower_mm);
                    above += usize::from(*mm > self.upper_mm);
                    let outside_by = (self.lower_mm - mm).max(mm - self.upper_mm);
                    proven += usize::from(outside_by > guard_mm);
                    possible += usize::from(outside_by > -guard_mm);
                }
                Deviation::TooFar => too_far += 1,
                Deviation::BeyondEdge | Deviation::NoSurface => not_judged += 1,
            }
        }
        let judged = points.len() - not_judged;
        if judged == 0 {
            return None;
        }
        let share = |count: usize| count as f64 / judged as f64;
        let (proven_outside_share, possibly_outside_share) =
            (share(proven + too_far), share(possible + too_far));
        let verdict = if proven_outside_share > self.allowed_share {
            Verdict::Fail
        } else if possibly_outside_share <= self.allowed_share {
            Verdict::Pass
        } else {
            Verdict::Indeterminate
        };
        Some(Conformity {
            tolerance: self,
            judged,
            not_judged,
            below,
            above,
            too_far,
            outside_share: share(below + above + too_far),
            proven_outside_share,
            possibly_outside_share,
            guard_factor: GUARD_FACTOR,
            largest_guard_mm,
            verdict,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(deviations: &[Deviation], sigma_mm: f32, allowed_share: f64) -> Option<Conformity> {
        let point = Point { sigma_mm, ..bytemuck::Zeroable::zeroed() };
        let points = vec![point; deviations.len()];
        let exact = vec![0.0; deviations.len()];
        Tolerance { lower_mm: -0.1, upper_mm: 0.2, allowed_share }.judge(&points, &exact, deviations)
    }

    #[test]
    fn points_are_counted_on_their_side_of_the_band() {
        let deviations = [
            Deviation::Mm(0.0),
            Deviation::Mm(-0.11),
            Deviation::Mm(0.21),
            Deviation::Mm(0.5),
            Deviation::TooFar,
            Deviation::BeyondEdge,
            Deviation::NoSurface,
        ];
        let found = judged(&deviations, 0.0, 0.0).unwrap();
        assert_eq!((found.judged, found.not_judged), (5, 2));
        assert_eq!((found.below, found.above, found.too_far), (1, 2, 1));
        assert_eq!(found.outside_share, 0.8);
        assert_eq!(found.verdict, Verdict::Fail);
        assert_eq!(judged(&deviations, 0.0, 0.8).unwrap().verdict, Verdict::Pass);
        assert_eq!(judged(&deviations[5..], 0.0, 0.0), None, "nothing is judged, nothing passes");
    }

    /// Limits −0.1 … 0.2 with a guard band of 0.02 at each point.
    #[test]
    fn what_lies_within_the_guard_band_is_not_proven() {
        let of = |mm: f64| judged(&[Deviation::Mm(mm)], 0.01, 0.0).unwrap().verdict;
        assert_eq!(
            [of(0.17), of(0.19), of(0.21), of(0.23)],
            [Verdict::Pass, Verdict::Indeterminate, Verdict::Indeterminate, Verdict::Fail]
        );
        assert_eq!([of(-0.07), of(-0.09), of(-0.13)], [Verdict::Pass, Verdict::Indeterminate, Verdict::Fail]);
        for unknown in [f32::INFINITY, f32::NAN, -1.0] {
            let found = judged(&[Deviation::Mm(0.0), Deviation::Mm(9.0)], unknown, 0.0).unwrap();
            assert_eq!(found.verdict, Verdict::Indeterminate, "{unknown}");
        }
    }

    /// A reference of 0.04 mm beside points of 0.03 mm: a guard band of 0.1 mm.
    #[test]
    fn a_measured_reference_widens_the_guard_band() {
        let point = Point { sigma_mm: 0.03, ..bytemuck::Zeroable::zeroed() };
        let of = |mm: f64, reference: f32| {
            let band = Tolerance { lower_mm: -0.2, upper_mm: 0.2, allowed_share: 0.0 };
            band.judge(&[point], &[reference], &[Deviation::Mm(mm)]).unwrap()
        };
        assert!((of(0.0, 0.04).largest_guard_mm - 0.1).abs() < 1e-8);
        assert_eq!(
            [of(0.11, 0.0), of(0.11, 0.04), of(0.11, f32::NAN)].map(|found| found.verdict),
            [Verdict::Pass, Verdict::Indeterminate, Verdict::Indeterminate]
        );
        assert_eq!(
            [of(0.27, 0.0), of(0.27, 0.04)].map(|found| found.verdict),
            [Verdict::Fail, Verdict::Indeterminate]
        );
    }

    #[test]
    fn an_allowed_share_is_held_against_both_shares() {
        let mut deviations = vec![Deviation::Mm(0.0); 98];
        deviations.extend([Deviation::Mm(0.3), Deviation::Mm(0.19)]);
        assert_eq!(judged(&deviations, 0.01, 0.02).unwrap().verdict, Verdict::Pass);
        assert_eq!(judged(&deviations, 0.01, 0.01).unwrap().verdict, Verdict::Indeterminate);
        assert_eq!(judged(&deviations, 0.01, 0.005).unwrap().verdict, Verdict::Fail);
    }
}
