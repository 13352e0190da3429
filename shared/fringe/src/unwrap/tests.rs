//! Properties of all methods, and what each of them is for.

use super::edges::Edge;
use super::forest::{Forest, Labels};
use super::*;
use crate::math::random::{Key, Normal};
use crate::math::{atan2, sin};
use proptest::prelude::*;
use std::f64::consts::PI;

const METHODS: [Method; 9] = [
    Method::Itoh,
    Method::Goldstein,
    Method::Quality(QualityMap::Modulation),
    Method::Quality(QualityMap::PhaseDerivativeVariance),
    Method::Quality(QualityMap::PseudoCorrelation),
    Method::Quality(QualityMap::MaximumGradient),
    Method::Reliability,
    Method::LeastSquares,
    Method::WeightedLeastSquares(QualityMap::MaximumGradient),
];

struct Map {
    width: usize,
    height: usize,
    truth: Vec<f64>,
    phase: Vec<f32>,
    valid: Vec<u8>,
    modulation: Vec<f32>,
}

impl Map {
    fn new(width: usize, height: usize, truth: impl Fn(f64, f64) -> f64) -> Self {
        let truth: Vec<f64> =
            (0..width * height).map(|i| truth((i % width) as f64, (i / width) as f64)).collect();
        let phase = truth.iter().map(|t| crate::math::wrap_rad(*t) as f32).collect();
        let n = width * height;
        Self { width, height, truth, phase, valid: vec![1; n], modulation: vec![50.0; n] }
    }

    fn noisy(mut self, sigma_rad: f64, seed: u64) -> Self {
        let normal = Normal::default();
        let key = Key::new(seed);
        for (i, (truth, phase)) in self.truth.iter_mut().zip(&mut self.phase).enumerate() {
            *truth += sigma_rad * f64::from(normal.draw(key.bits(i as u64)));
            *phase = crate::math::wrap_rad(*truth) as f32;
        }
        self
    }

    fn masked(mut self, share: f64, seed: u64) -> Self {
        let key = Key::new(seed).with(9);
        for (i, valid) in self.valid.iter_mut().enumerate() {
            *valid = u8::from(key.symmetric(i as u64) >= 2.0 * share - 1.0);
        }
        self
    }

    fn view(&self) -> Wrapped<'_> {
        Wrapped {
            width_px: self.width as u32,
            height_px: self.height as u32,
            phase_rad: &self.phase,
            valid: &self.valid,
            modulation: Some(&self.modulation),
        }
    }

    fn unwrap(&self, method: Method) -> Unwrapped {
        unwrap(&self.view(), None, &UnwrapSettings::new(method)).unwrap()
    }

    /// Valid pixels whose turns differ from those of most of their component.
    fn wrong(&self, result: &Unwrapped) -> usize {
        let mut off: Vec<(u32, i64)> = (0..self.truth.len())
            .filter(|i| self.valid[*i] == 1)
            .map(|i| {
                (result.component[i], ((f64::from(result.phase_rad[i]) - self.truth[i]) / TAU).round() as i64)
            })
            .collect();
        off.sort_unstable();
        let worst = |group: &[(u32, i64)]| {
            group.len() - group.chunk_by(|a, b| a == b).map(<[_]>::len).max().unwrap_or(0)
        };
        off.chunk_by(|a, b| a.0 == b.0).map(worst).sum()
    }
}

fn hill(width: usize, height: usize, turns: f64) -> Map {
    let (cx, cy) = (width as f64 / 2.0, height as f64 / 2.0);
    Map::new(width, height, move |x, y| {
        let r2 = ((x - cx) / cx).powi(2) + ((y - cy) / cy).powi(2);
        TAU * turns * (1.0 - r2) + 0.05 * x
    })
}

/// Joins along edges in this order; each edge that closes a loop is left out.
fn grow(angles: &Angles<'_>, edges: impl IntoIterator<Item = Edge>) -> Labels {
    let mut forest = Forest::new(angles.turn.len());
    for (a, b) in edges {
        forest.join(a, b, angles.step(a, b));
    }
    forest.labels(&angles.valid)
}

/// Turns along the least spanning tree: by the jumps that residues tell of, and by sorting all edges; by reliability and by a
/// quality, many of whose edges are equal.
fn trees(map: &Map) -> [[Labels; 2]; 2] {
    let angles = Angles::new(&map.view());
    let grid = Grid::new(map.width, map.height, &angles.valid);
    let reliable = reliability::key(&angles, &grid);
    let best = best_pixels_first((0..angles.turn.len()).map(|i| (i * 7919 % 13) as f32).collect());
    [&reliable as &(dyn Fn(Edge) -> u32 + Sync), &best].map(|key| {
        let keyed = grid.edges().map(|(number, edge)| u64::from(key(edge)) << 32 | u64::from(number));
        let mut sorted: Vec<u64> = keyed.collect();
        sorted.sort_unstable();
        let sorted = grow(&angles, sorted.into_iter().map(|edge| grid.edge(edge as u32)));
        let (found, jumps) = along_tree(&angles, &grid, || key);
        assert_eq!(jumps, edges::discontinuities(&grid, &angles, &found.turns));
        [found, sorted]
    })
}

/// Whether both ways find the same turns.
fn agree(map: &Map) -> bool {
    trees(map).iter().all(|[found, sorted]| equal(found, sorted))
}

fn equal(a: &Labels, b: &Labels) -> bool {
    a.turns == b.turns && a.component == b.component
}

/// Half a turn may be taken either way, but always the same one.
#[test]
fn half_turns_go_one_way_whatever_the_order() {
    for seed in 0..20 {
        let key = Key::new(seed);
        let turn = |x: f64, y: f64| TAU / 2.0 * (key.symmetric((y * 80.0 + x) as u64) > 0.0) as u8 as f64;
        assert!(agree(&Map::new(80, 70, turn)), "seed {seed}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn what_was_wrapped_comes_back(
        width in 1_usize..40, height in 1_usize..40,
        a in -2.0_f64..2.0, b in -2.0_f64..2.0, c in -0.9_f64..0.9,
        masked in 0.0_f64..0.6, seed in any::<u64>(),
    ) {
        // Slopes stay below π: |a| + |c| per pixel.
        let map = Map::new(width, height, |x, y| a * x + b * y + c * sin(x * 0.7 + y * 0.3)).masked(masked, seed);
        for method in METHODS {
            let found = map.unwrap(method);
            prop_assert_eq!(map.wrong(&found), 0, "{:?}", method);
            prop_assert_eq!(found.report.discontinuities, 0);
        }
    }

    #[test]
    fn whole_turns_in_the_input_change_nothing(seed in any::<u64>(), sigma in 0.0_f64..1.5) {
        let mut map = hill(31, 23, 4.0).noisy(sigma, seed).masked(0.1, seed);
        let key = Key::new(seed);
        // Phases in the middle of the grid's steps: elsewhere the rounding of the sum may move a decision.
        for phase in &mut map.phase {
            *phase = (((f64::from(*phase) / TAU * 64.0).floor() + 0.5) / 64.0 * TAU) as f32;
        }
        for method in METHODS {
            let plain = map.unwrap(method);
            let mut turned = map.phase.clone();
            for (i, phase) in turned.iter_mut().enumerate() {
                *phase += (TAU * (3.0 * key.symmetric(i as u64)).round()) as f32;
            }
            let view = Wrapped { phase_rad: &turned, ..map.view() };
            let after = unwrap(&view, None, &UnwrapSettings::new(method)).unwrap();
            prop_assert_eq!(&plain.component, &after.component);
            for (a, b) in plain.phase_rad.iter().zip(&after.phase_rad) {
                prop_assert!((a - b).abs() < 1e-3 || a.is_nan() && b.is_nan(), "{method:?}: {a} and {b}");
            }
        }
    }

    #[test]
    fn nothing_is_filled_and_each_pixel_keeps_its_phase(
        seed in any::<u64>(), sigma in 0.0_f64..3.0, masked in 0.0_f64..1.0,
    ) {
        let mut map = hill(29, 17, 3.0).noisy(sigma, seed).masked(masked, seed);
        map.phase[40] = f32::NAN;
        map.phase[90] = f32::INFINITY;
        map.modulation[33] = f32::NAN;
        for method in METHODS {
            let found = map.unwrap(method);
            for i in 0..map.phase.len() {
                let usable = map.valid[i] == 1 && map.phase[i].is_finite();
                prop_assert_eq!(found.phase_rad[i].is_finite(), usable);
                prop_assert_eq!(found.component[i] != NO_COMPONENT, usable);
                if usable {
                    let turns = f64::from(found.phase_rad[i] - map.phase[i]) / TAU;
                    prop_assert!((turns - turns.round()).abs() < 1e-5, "{method:?}: {turns}");
                }
            }
            let pixels: usize = found.report.components.iter().map(|c| c.pixels).sum();
            prop_assert_eq!(pixels, found.report.valid);
        }
    }

    /// The jumps found from the residues are those of the tree that sorting all edges finds, with holes that carry charges, too.
    #[test]
    fn residues_and_sorting_find_one_tree(
        seed in any::<u64>(), sigma in 0.0_f64..3.0, masked in 0.0_f64..0.6, width in 1_usize..90, height in 1_usize..70,
    ) {
        prop_assert!(agree(&hill(width, height, 9.0).noisy(sigma, seed).masked(masked, seed)));
    }

    /// Runs of pixels give what pixels give: rows first, then from row to row.
    #[test]
    fn runs_join_as_pixels_do(
        seed in any::<u64>(), sigma in 0.0_f64..6.0, masked in 0.0_f64..0.9, width in 1_usize..40,
    ) {
        let map = hill(width, 31, 2.0).noisy(sigma, seed).masked(masked, seed);
        let angles = Angles::new(&map.view());
        let grid = Grid::new(map.width, map.height, &angles.valid);
        let pixels = || 0..angles.valid.len();
        let edges = pixels().filter_map(|i| grid.right(i)).chain(pixels().filter_map(|i| grid.down(i)));
        prop_assert!(equal(&along_rows(&angles, &grid, &[]), &grow(&angles, edges)));
    }

    /// Cuts balance every charge: then, and only then, all ways that cross none agree.
    #[test]
    fn only_cuts_hide_differences(
        seed in any::<u64>(), sigma in 0.5_f64..6.0, masked in 0.0_f64..0.5, reach_px in 1_u32..12,
    ) {
        let map = hill(41, 33, 6.0).noisy(sigma, seed).masked(masked, seed);
        let settings = UnwrapSettings { reach_px, ..UnwrapSettings::new(Method::Goldstein) };
        let found = unwrap(&map.view(), None, &settings).unwrap();
        let residues = found.report.residues.unwrap();
        prop_assert!(found.report.discontinuities <= residues.cut_edges, "{:?}", found.report);
        let angles = Angles::new(&map.view());
        let grid = Grid::new(map.width, map.height, &angles.valid);
        let cuts = cuts::Cuts::new(&faces::Faces::new(faces::Charges::new(&angles, &grid), &grid), &grid, reach_px);
        for (number, (a, b)) in grid.edges() {
            let jump = (f64::from(found.phase_rad[b]) - f64::from(found.phase_rad[a])).abs() > PI + 1e-3;
            prop_assert!(!jump || cuts.is_closed(number));
        }
    }

    /// No shift of any single pixel lowers the sum of squares.
    #[test]
    fn least_squares_are_least(seed in any::<u64>(), sigma in 0.0_f64..3.0) {
        let map = hill(19, 14, 3.0).noisy(sigma, seed).masked(0.1, seed);
        let settings = UnwrapSettings {
            congruent: false, tolerance: 1e-9, max_iterations: 500, ..UnwrapSettings::new(Method::LeastSquares)
        };
        let found = unwrap(&map.view(), None, &settings).unwrap();
        prop_assert!(found.report.convergence.unwrap().converged);
        let angles = Angles::new(&map.view());
        let grid = Grid::new(map.width, map.height, &angles.valid);
        let mut slope = vec![0.0; map.phase.len()];
        for (_, (a, b)) in grid.edges() {
            let off = f64::from(found.phase_rad[b]) - f64::from(found.phase_rad[a])
                - TAU * f64::from(angle::turns(angles.difference(a, b)));
            slope[a] -= off;
            slope[b] += off;
        }
        // The phases are single precision.
        prop_assert!(slope.iter().all(|s| s.abs() < 1e-4), "{slope:?}");
    }
}

#[test]
fn a_rectangle_without_weights_is_solved_directly() {
    let map = hill(64, 48, 9.0).noisy(0.3, 1);
    let convergence = map.unwrap(Method::LeastSquares).report.convergence.unwrap();
    assert!(convergence.converged && convergence.iterations == 1, "{convergence:?}");
}

#[test]
fn a_single_residue_pair_is_cut_between() {
    // The gradient of a pair of opposite vortices, 10 px apart.
    let map = Map::new(40, 30, |x, y| atan2(y - 14.5, x - 14.5) - atan2(y - 14.5, x - 24.5));
    let found = map.unwrap(Method::Goldstein);
    let residues = found.report.residues.unwrap();
    assert_eq!((residues.positive, residues.negative, residues.cut_edges), (1, 1, 10));
    assert_eq!(found.report.discontinuities, 10);
    assert_eq!(found.report.components.len(), 1);
}

/// A vortex whose core is masked leaves no residue, but a hole that carries its charge.
#[test]
fn a_charged_hole_is_led_to_the_border() {
    let mut map = Map::new(40, 30, |x, y| atan2(y - 14.5, x - 20.5));
    for (i, valid) in map.valid.iter_mut().enumerate() {
        let (x, y) = ((i % 40) as f64 - 20.5, (i / 40) as f64 - 14.5);
        *valid = u8::from(x * x + y * y > 30.0);
    }
    let found = map.unwrap(Method::Goldstein);
    let residues = found.report.residues.unwrap();
    assert_eq!((residues.positive, residues.negative, residues.charged_holes), (0, 0, 1));
    // From the hole's rim, 5 px off the core, straight to the border, 15 px off.
    assert_eq!(residues.cut_edges, found.report.discontinuities);
    assert!((9..=11).contains(&residues.cut_edges), "{residues:?}");
}

/// Noise that the baseline drags along its rows stays where it is in the others.
#[test]
fn noise_spreads_in_the_baseline_only() {
    let map = hill(160, 120, 8.0).noisy(0.6, 3);
    let wrong = |method| map.wrong(&map.unwrap(method));
    let baseline = wrong(Method::Itoh);
    assert!(baseline > 1000, "{baseline}");
    for method in [Method::Goldstein, Method::Reliability, Method::Quality(QualityMap::MaximumGradient)] {
        assert!(wrong(method) * 10 < baseline, "{method:?}: {} of {baseline}", wrong(method));
    }
}

#[test]
fn the_anchor_makes_components_absolute() {
    let mut map = hill(60, 40, 5.0);
    // Two halves; the right one stands two turns higher, as behind a step.
    for i in 0..map.valid.len() {
        map.valid[i] = u8::from(i % 60 != 30);
        if i % 60 > 30 {
            map.truth[i] += 2.0 * TAU;
        }
    }
    let mut absolute = vec![f32::NAN; map.truth.len()];
    // Coarse, known here and there, and in one place wrong.
    for i in (0..absolute.len()).step_by(97) {
        absolute[i] = (map.truth[i] + 1.5 * sin(i as f64)) as f32;
    }
    absolute[97] += 40.0;
    for method in METHODS {
        let anchor = Anchor { absolute_rad: &absolute };
        let found = unwrap(&map.view(), Some(&anchor), &UnwrapSettings::new(method)).unwrap();
        assert_eq!(found.report.components.len(), 2);
        assert!(found.report.components.iter().all(Component::is_absolute));
        for i in (0..absolute.len()).filter(|i| map.valid[*i] == 1) {
            assert!((f64::from(found.phase_rad[i]) - map.truth[i]).abs() < 1e-3, "{method:?}");
        }
        let c = found.report.components[0];
        assert_eq!(c.agreeing + usize::from(c.anchored > c.agreeing), c.anchored);
    }
}

#[test]
fn degenerate_maps_have_defined_results() {
    for method in METHODS {
        for (width, height) in [(1, 1), (1, 50), (50, 1), (2, 2)] {
            let map = Map::new(width, height, |x, y| 1.3 * (x + y));
            assert_eq!(map.wrong(&map.unwrap(method)), 0);
            let constant = Map::new(width, height, |_, _| 1.0).unwrap(method);
            assert!(constant.phase_rad.iter().all(|p| (p - 1.0).abs() < 1e-6));
            let none = Map::new(width, height, |_, _| 1.0).masked(1.1, 0).unwrap(method);
            assert!(none.phase_rad.iter().all(|p| p.is_nan()) && none.report.components.is_empty());
        }
    }
    let huge = Map { phase: vec![f32::MAX; 12], ..Map::new(4, 3, |_, _| 0.0) };
    assert!(huge.unwrap(Method::Reliability).phase_rad.iter().all(|p| p.is_finite()));
}

#[test]
fn impossible_input_is_named() {
    let map = hill(5, 4, 1.0);
    let settings = UnwrapSettings::new(Method::Itoh);
    let of = |view: Wrapped<'_>, settings: UnwrapSettings| unwrap(&view, None, &settings).unwrap_err();
    assert!(matches!(of(Wrapped { width_px: 0, ..map.view() }, settings), UnwrapError::Size { .. }));
    assert!(matches!(
        of(Wrapped { valid: &[1; 3], ..map.view() }, settings),
        UnwrapError::Plane { plane: "valid", .. }
    ));
    assert!(matches!(
        of(
            Wrapped { modulation: None, ..map.view() },
            UnwrapSettings::new(Method::Quality(QualityMap::Modulation))
        ),
        UnwrapError::Modulation
    ));
    assert!(matches!(
        of(map.view(), UnwrapSettings { tolerance: f64::NAN, ..settings }),
        UnwrapError::Tolerance { .. }
    ));
    assert!(matches!(
        of(map.view(), UnwrapSettings { max_iterations: 0, ..settings }),
        UnwrapError::Iterations { .. }
    ));
}
