//! What the cameras see of the part, which has a length standard, along both axes.

use super::super::accuracy::Bench;
use super::super::calibrated::Calibrated;
use super::super::calibration::board::{Cell, moved};
use super::super::scan::{decode_with, tolerant, views};
use super::{PARTNERS, VIEW};
use crate::numbers::within;
use anyhow::{Context, Result};
use cell::executor::PairMatcher;
use characterise::health::{HealthSettings, Match, Partner, check_pair, match_projector, match_views};
use fringe::decode::DecodeSettings;
use fringe::geometry::camera::Camera;
use fringe::matching::MatchSettings;
use fringe::pattern::{Axis, PatternSet};
use fringe::phase::{PhaseMap, PhaseView};
use metrology::inspection::evaluate;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use twin::{Twin, TwinSettings};

/// The length standard: spheres of the part, certified.
pub(super) const LENGTH: &str = "sphere_spacing";
/// Standard uncertainty of a certified length, mm.
pub const U_LENGTH_MM: f64 = 0.0005;
/// Places of the part, one for each recording of a correction: turns about x, y, z (°), shifts (mm).
pub(super) const PLACES: [([f64; 3], [f64; 3]); 9] = [
    ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ([30.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ([0.0, 30.0, 0.0], [0.0, 0.0, 0.0]),
    ([-30.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ([0.0, -30.0, 0.0], [0.0, 0.0, 0.0]),
    ([20.0, 20.0, 0.0], [0.0, 0.0, 25.0]),
    ([-20.0, -20.0, 0.0], [0.0, 0.0, -25.0]),
    ([20.0, -20.0, 0.0], [20.0, 0.0, -25.0]),
    ([-20.0, 20.0, 0.0], [0.0, 20.0, 25.0]),
];

/// What the view has with each partner: the partner's number, that of the projector that lights both, and whether the rig has the pair.
const LINKS: [(usize, usize, bool); 8] = [
    (0, 1, true),
    (1, 1, true),
    (2, 2, true),
    // Cameras that the rig does not pair with the view.
    (3, 1, false),
    (4, 1, false),
    (0, 2, false),
    (3, 2, false),
    (4, 2, false),
];

/// Of [`LINKS`] the pair that the rig measures with.
const MEASURES: (usize, usize) = (0, 1);

/// One recording of the part, along both axes.
pub struct Recorded {
    /// Of both cameras of the pair that measures.
    maps: [Vec<PhaseMap>; 2],
    /// Matches of each of [`LINKS`], the view on the right.
    matches: Vec<Vec<Match>>,
    world_from_part: Isometry3<f64>,
}

impl Recorded {
    /// The demo's part in one of its places, with noise of its own.
    pub fn part(bench: &Bench, cell: &Cell, fringes: &Fringes, place: usize, cycle: u64) -> Result<Self> {
        let (sequence, settings) = (fringes.sequence(), fringes.settings());
        let (turn_deg, shift_mm) = PLACES[place];
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(turn_deg.map(f64::to_radians)));
        let world_from_part = Isometry3::from_parts(Vector3::from(shift_mm).into(), turn);
        let twin = Twin::new(&bench.scene, TwinSettings::default(), &moved(&cell.rig, &world_from_part))?;
        let maps = |camera: &str, projector: &str| {
            decode_with(&twin, (camera, projector), &cell.rig, &sequence, cycle, &settings)
                .with_context(|| format!("{camera} under {projector}, place {place}, cycle {cycle}"))
        };
        let [one, two, other] = [maps("cam1", "proj1")?, maps(VIEW, "proj1")?, maps(VIEW, "proj2")?];
        let matches = LINKS.iter().map(|(partner, projector, _)| {
            let [vx, vy] = both(if PARTNERS[*projector] == "proj1" { &two } else { &other })?;
            if partner == projector {
                let found = match_projector([&vx, &vy])?.matches;
                return Ok(found.into_iter().map(Match::turned).collect());
            }
            let further;
            let theirs = if (*partner, *projector) == MEASURES {
                &one
            } else {
                further = maps(PARTNERS[*partner], PARTNERS[*projector])?;
                &further
            };
            let [x, y] = both(theirs)?;
            Ok(match_views([&x, &y], [&vx, &vy])?.matches)
        });
        let matches = matches.collect::<Result<_>>()?;
        Ok(Self { maps: [one, two], matches, world_from_part })
    }

    /// Whether all pairs of the view that the rig has are healthy with it in a state.
    pub fn healthy(&self, calibrated: &Calibrated, view: &Camera, settings: &HealthSettings) -> Result<bool> {
        for ((partner, _, _), matches) in LINKS.iter().zip(&self.matches).filter(|((.., own), _)| *own) {
            let name = PARTNERS[*partner];
            let covariance = calibrated.covariance(name, VIEW)?;
            if !check_pair(calibrated.device(name)?, view, matches, Some(&covariance), settings)?.healthy {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The partners of the view with their matches; the rig measures with the first.
    pub fn partners<'a>(&'a self, calibrated: &'a Calibrated) -> Result<Vec<Partner<'a>>> {
        let one = |(i, (partner, projector, _)): (usize, &(usize, usize, bool))| {
            let lit_by = Some((calibrated.device(PARTNERS[*projector])?, *projector));
            Ok(Partner {
                fixed: calibrated.device(PARTNERS[*partner])?,
                device: *partner,
                matches: &self.matches[i],
                lit_by: lit_by.filter(|_| partner != projector),
                measures: (*partner, *projector) == MEASURES,
            })
        };
        LINKS.iter().enumerate().map(one).collect()
    }

    /// The length standard as the pair measures it with the view in a state, with the uncertainty by its points, mm.
    pub fn length(
        &self,
        bench: &Bench,
        calibrated: &Calibrated,
        view: &Camera,
    ) -> Result<Option<(f64, f64)>> {
        let mut rig = calibrated.rig.clone();
        rig.cameras[1].camera = view.clone();
        // As seen from the part, where its plan lies.
        let rig = moved(&rig, &self.world_from_part);
        let mut matcher = PairMatcher::new(&rig, &rig.pairs[0], 0, &MatchSettings::default())?;
        let cloud = matcher.cloud(&views(&self.maps[0]), &views(&self.maps[1]))?.0;
        let plan = bench.plan.clone().with_viewpoints(rig.viewpoints(&rig.pairs));
        let result = evaluate(&plan, &cloud);
        let feature = result.features.iter().find(|feature| feature.name == LENGTH);
        Ok(feature.and_then(|feature| Some((feature.value?, feature.u_noise?))))
    }
}

/// The maps of columns and rows.
fn both(maps: &[PhaseMap]) -> Result<[PhaseView<'_>; 2]> {
    let along = |axis| maps.iter().find(|map| map.info.axis == axis).map(PhaseMap::view);
    Ok([along(Axis::X).context("columns were decoded")?, along(Axis::Y).context("rows were decoded")?])
}

/// How a recording is made and decoded.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct Fringes {
    /// Projector columns of a fringe, of which half is a stripe that eight bits can number; rows of a fringe are an eighth more.
    #[arg(long, value_name = "PX", default_value_t = 8.0, value_parser = |text: &str| within(text, 6.0..=64.0))]
    period_px: f64,
    /// Steps of each axis.
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = clap::value_parser!(u32).range(4..=64))]
    steps: u32,
    /// Footprint of the cameras that the decoder takes, standard deviation; 0 leaves it to each recording.
    #[arg(long, value_name = "PX", default_value_t = 0.577, value_parser = |text: &str| within(text, 0.0..=1.0))]
    footprint_px: f64,
}

impl Fringes {
    /// Fringes along both axes, with a code of half fringes.
    fn sequence(&self) -> Vec<PatternSet> {
        let mut sets = Vec::new();
        for (axis, period_px) in [(Axis::X, self.period_px), (Axis::Y, 1.125 * self.period_px)] {
            sets.push(PatternSet::sine(axis, period_px, self.steps));
            sets.push(PatternSet::gray(axis, 8, 0.5 * period_px));
        }
        sets.extend([PatternSet::White {}, PatternSet::Black {}]);
        sets
    }

    /// Settings of the decoder.
    fn settings(&self) -> DecodeSettings {
        let footprint_px = (self.footprint_px > 0.0).then_some(self.footprint_px);
        DecodeSettings { footprint_px, ..tolerant() }
    }
}
