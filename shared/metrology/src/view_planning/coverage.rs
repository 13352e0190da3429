//! Areas and medians of what pairs see.

use super::elements::Element;
use super::seeing::{Cause, Seeing};
use serde::Serialize;

/// Light of the first bounce beyond which it counts as a risk: a twentieth of the direct light moves a phase by up to 0.05 rad.
pub const BOUNCE_RISK: f64 = 0.05;

/// An area and why it is not seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CauseArea {
    /// The cause as a word.
    pub cause: Cause,
    /// Area of that cause, mm².
    pub area_mm2: f64,
}

/// What one pair sees.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairCoverage {
    /// Area that it sees, mm².
    pub seen_mm2: f64,
    /// Area that it does not see, by cause.
    pub lost: Vec<CauseArea>,
    /// Median of the incidence over the seen area, degrees.
    pub incidence_median_deg: Option<f64>,
    /// Median of the modulation over the seen area, DN.
    pub modulation_median_dn: Option<f64>,
    /// Median of the standard uncertainty of a point over the seen area, mm.
    pub sigma_median_mm: Option<f64>,
    /// The same for 95 % of the area, mm.
    pub sigma_p95_mm: Option<f64>,
    /// Median share of light that bounces, over the seen area.
    pub bounce_median: Option<f64>,
    /// Seen area on which light that bounces exceeds a twentieth of the direct light, mm².
    pub bounce_risk_mm2: Option<f64>,
}

/// What all pairs see.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Coverage {
    /// Area of the part but what lies within other bodies, mm².
    pub area_mm2: f64,
    /// Area within other bodies of the part, which counts nowhere else, mm².
    pub buried_mm2: f64,
    /// Area that so many pairs see, from none to all of them, mm².
    pub by_pairs_mm2: Vec<f64>,
    /// What no pair sees, by what is nearest to seeing it.
    pub never: Vec<CauseArea>,
    /// Each pair, in the order of the rig.
    pub pairs: Vec<PairCoverage>,
}

/// Adds up areas; `seeing` has all pairs of each element.
pub fn coverage(elements: &[Element], seeing: &[Seeing], pairs: usize) -> Coverage {
    let of = || elements.iter().zip(seeing.chunks(pairs.max(1)));
    let open = || of().filter(|(element, _)| !element.buried);
    let area = |buried: bool| {
        elements.iter().filter(|element| element.buried == buried).map(|element| element.area_mm2).sum()
    };
    let mut by_pairs_mm2 = vec![0.0; pairs + 1];
    let mut never = Areas::default();
    for (element, seeing) in open() {
        let seen = seeing.iter().filter(|seeing| seeing.is_seen()).count();
        by_pairs_mm2[seen] += element.area_mm2;
        let best = seeing.iter().map(|seeing| seeing.cause).max();
        if let (0, Some(cause)) = (seen, best) {
            never.add(cause, element.area_mm2);
        }
    }
    let pair = |pair: usize| pair_coverage(open().map(|(element, seeing)| (element, &seeing[pair])));
    Coverage {
        area_mm2: area(false),
        buried_mm2: area(true),
        by_pairs_mm2,
        never: never.list(),
        pairs: (0..pairs).map(pair).collect(),
    }
}

fn pair_coverage<'a>(all: impl Iterator<Item = (&'a Element, &'a Seeing)>) -> PairCoverage {
    let mut lost = Areas::default();
    let mut seen = Vec::new();
    for (element, seeing) in all {
        if seeing.is_seen() {
            seen.push((element.area_mm2, *seeing));
        } else {
            lost.add(seeing.cause, element.area_mm2);
        }
    }
    let quantile = |share: f64, of: fn(&Seeing) -> f32| {
        let values = seen.iter().map(|(area, seeing)| (f64::from(of(seeing)), *area));
        by_area(values.filter(|(value, _)| value.is_finite()).collect(), share)
    };
    let bounce: fn(&Seeing) -> f32 = |seeing| seeing.bounce;
    let bounce_median = quantile(0.5, bounce);
    let risky = seen.iter().filter(|(_, seeing)| f64::from(seeing.bounce) > BOUNCE_RISK);
    PairCoverage {
        seen_mm2: seen.iter().map(|(area, _)| area).sum(),
        lost: lost.list(),
        incidence_median_deg: quantile(0.5, |seeing| seeing.incidence_rad).map(f64::to_degrees),
        modulation_median_dn: quantile(0.5, |seeing| seeing.modulation_dn),
        sigma_median_mm: quantile(0.5, |seeing| seeing.sigma_mm),
        sigma_p95_mm: quantile(0.95, |seeing| seeing.sigma_mm),
        bounce_median,
        bounce_risk_mm2: bounce_median.map(|_| risky.map(|(area, _)| area).sum()),
    }
}

/// Sums of areas by their cause.
#[derive(Default)]
struct Areas([f64; Cause::ALL.len()]);

impl Areas {
    fn add(&mut self, cause: Cause, area_mm2: f64) {
        self.0[cause as usize] += area_mm2;
    }

    fn list(&self) -> Vec<CauseArea> {
        let all = Cause::ALL.into_iter().zip(self.0);
        all.filter(|(_, area)| *area > 0.0).map(|(cause, area_mm2)| CauseArea { cause, area_mm2 }).collect()
    }
}

/// The value below which a share of the area lies.
fn by_area(mut values: Vec<(f64, f64)>, share: f64) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = share * values.iter().map(|(_, area)| area).sum::<f64>();
    let mut sum = 0.0;
    let found = values.iter().find(|(_, area)| {
        sum += area;
        sum >= wanted
    });
    found.or(values.last()).map(|(value, _)| *value)
}
