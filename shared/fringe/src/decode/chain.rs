//! How the order is found: a chain of ever finer coordinates, from one that covers the projector to the finest sine.
//!
//! Every member of the chain is an integer combination of the measured phases, φ = Σ aⱼ φⱼ, which varies with the period
//! P = 1 / Σ (aⱼ / pⱼ): a sine itself (a = 1), or a beat of sines (a = +1, −1, +1 −2 +1, …). One rule joins two members,
//! and the code to the first one: with the coarse coordinate c and the fine wrapped coordinate x_w,
//! m = round((c − x_w) / P). It fails when the noise of c − x_w exceeds half a period P (less half a stripe for a code).
//! Of all chains the one whose weakest step survives the most noise is taken (a widest path), so hierarchical sets,
//! heterodyne sets and mixtures are one case.

use std::f64::consts::TAU;

/// A sine set as the search sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sine {
    /// Projector pixels per 2π.
    pub period_px: f64,
    /// Number of phase steps N.
    pub steps: u32,
}

/// One step of the chain: c → c' = x_w + m P.
#[derive(Debug, Clone, PartialEq)]
pub struct Stage {
    /// Period P of this member, projector pixels.
    pub period_px: f64,
    /// (index of the sine, aⱼ): the combination.
    pub terms: Vec<(usize, i32)>,
    /// Standard deviation of (c − x) / P for a phase noise of 1 rad of the finest sine.
    pub noise_turns_per_rad: f64,
    /// What each sine contributes to it, with its sign: their root of squares is the standard deviation.
    pub parts_turns_per_rad: Vec<f64>,
}

/// Where the chain begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// At a binary or Gray code.
    Code,
    /// In the middle of the projector: the first member covers it.
    Centre,
    /// At the coordinate given by the residues of all periods.
    Residues,
}

/// A way from nothing to the finest coordinate.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Where the chain begins.
    pub start: Start,
    /// Its members; the last one is the finest sine.
    pub stages: Vec<Stage>,
}

impl Chain {
    /// The finest sine alone, after the residues have given the coordinate.
    pub fn of_residues(period_px: f64) -> Self {
        let stage = Stage {
            period_px,
            terms: vec![(0, 1)],
            noise_turns_per_rad: 0.0,
            parts_turns_per_rad: Vec::new(),
        };
        Self { start: Start::Residues, stages: vec![stage] }
    }

    /// Coordinate of wrapped phases (one per sine, finest first) from a coarse one, projector pixels.
    pub fn coordinate_px(&self, phases_rad: &[f64], coarse_px: f64) -> f64 {
        self.stages.iter().fold(coarse_px, |c, stage| {
            let scale = stage.period_px / TAU;
            let x: f64 = stage.terms.iter().map(|(j, a)| f64::from(*a) * phases_rad[*j] * scale).sum();
            x + ((c - x) / stage.period_px).round() * stage.period_px
        })
    }
}

#[derive(Debug, Clone)]
struct Node {
    coefficients: Vec<i32>,
    period_px: f64,
}

/// Largest Σ |aⱼ| of a beat: enough for beats of beats (1, −2, 1) and (1, −1, −1, 1).
pub const MOST_PHASES: i32 = 4;
/// Periods and extents that agree to this are equal.
const EQUAL: f64 = 1.0 + 1e-9;

/// Finds the chain with the widest margin; `None` when nothing covers `extent_px`.
///
/// `sines[0]` is the finest; `stripe_px` is the stripe of a code that covers the projector.
pub fn widest(sines: &[Sine], stripe_px: Option<f64>, extent_px: f64) -> Option<Chain> {
    widest_of(sines, stripe_px, extent_px, MOST_PHASES)
}

/// The same with beats of at most `most_phases` sines; 1 allows no beats.
pub fn widest_of(sines: &[Sine], stripe_px: Option<f64>, extent_px: f64, most_phases: i32) -> Option<Chain> {
    let finest = sines.first()?;
    let nodes = combinations(sines, finest.period_px, most_phases);
    let goal = nodes.iter().position(|n| n.coefficients[0] == 1 && weight(&n.coefficients) == 1)?;
    // Width of the best way to each node, and the node before it (the node itself for a start).
    let mut best: Vec<(f64, Option<usize>, Start)> =
        nodes.iter().map(|n| begin(n, sines, stripe_px, extent_px)).collect();
    let mut done = vec![false; nodes.len()];
    loop {
        let mut next: Option<usize> = None;
        for (i, way) in best.iter().enumerate() {
            if !done[i] && way.0 >= 0.0 && next.is_none_or(|n| way.0 > best[n].0) {
                next = Some(i);
            }
        }
        let from = next?;
        done[from] = true;
        if from == goal {
            return Some(unroll(&nodes, &best, sines, goal));
        }
        for to in 0..nodes.len() {
            if !done[to] && nodes[to].period_px * EQUAL < nodes[from].period_px {
                let width = best[from].0.min(0.5 / step_noise(Some(&nodes[from]), &nodes[to], sines));
                if width > best[to].0 {
                    best[to] = (width, Some(from), best[from].2);
                }
            }
        }
    }
}

/// Longest period that any combination reaches, for messages.
pub fn longest_px(sines: &[Sine]) -> f64 {
    let finest = sines.first().map_or(0.0, |s| s.period_px);
    combinations(sines, finest, MOST_PHASES).iter().map(|n| n.period_px).fold(0.0, f64::max)
}

fn weight(coefficients: &[i32]) -> i32 {
    coefficients.iter().map(|a| a.abs()).sum()
}

/// All combinations with a period of at least the finest one.
fn combinations(sines: &[Sine], finest_px: f64, most_phases: i32) -> Vec<Node> {
    let mut vectors = vec![Vec::new()];
    for _ in sines {
        let mut longer = Vec::new();
        for vector in &vectors {
            for a in [0, 1, -1, 2, -2] {
                let mut next: Vec<i32> = vector.clone();
                next.push(a);
                if weight(&next) <= most_phases && next.iter().filter(|a| **a != 0).count() <= 4 {
                    longer.push(next);
                }
            }
        }
        vectors = longer;
    }
    let mut nodes = Vec::new();
    for coefficients in vectors {
        let frequency: f64 = coefficients.iter().zip(sines).map(|(a, s)| f64::from(*a) / s.period_px).sum();
        let period_px = 1.0 / frequency;
        // A vanishing or negative frequency gives no information (the latter has its positive twin in the list).
        if frequency > 1e-9 && period_px * EQUAL >= finest_px {
            nodes.push(Node { coefficients, period_px });
        }
    }
    nodes
}

fn begin(node: &Node, sines: &[Sine], stripe_px: Option<f64>, extent_px: f64) -> (f64, Option<usize>, Start) {
    if node.period_px * EQUAL >= extent_px {
        return (f64::INFINITY, None, Start::Centre);
    }
    match stripe_px {
        Some(stripe_px) if stripe_px <= node.period_px * EQUAL => {
            let margin = (0.5 - 0.5 * stripe_px / node.period_px).max(0.0);
            (margin / step_noise(None, node, sines), None, Start::Code)
        }
        _ => (-1.0, None, Start::Code),
    }
}

/// Standard deviation of (c − x_w) / P per rad of phase noise of the finest sine, other sines scaled by √(N₀/N).
fn step_noise(coarse: Option<&Node>, fine: &Node, sines: &[Sine]) -> f64 {
    step_parts(coarse, fine, sines).iter().map(|part| part * part).sum::<f64>().sqrt()
}

/// The part of each sine in that.
fn step_parts(coarse: Option<&Node>, fine: &Node, sines: &[Sine]) -> Vec<f64> {
    let part = |(j, sine): (usize, &Sine)| {
        let c = coarse.map_or(0.0, |n| f64::from(n.coefficients[j]) * n.period_px);
        let difference = c - f64::from(fine.coefficients[j]) * fine.period_px;
        difference * (f64::from(sines[0].steps) / f64::from(sine.steps)).sqrt() / (TAU * fine.period_px)
    };
    sines.iter().enumerate().map(part).collect()
}

fn unroll(nodes: &[Node], best: &[(f64, Option<usize>, Start)], sines: &[Sine], goal: usize) -> Chain {
    let mut order = vec![goal];
    while let Some(before) = best[order[order.len() - 1]].1 {
        order.push(before);
    }
    order.reverse();
    let stages = order
        .iter()
        .enumerate()
        .map(|(i, &n)| Stage {
            period_px: nodes[n].period_px,
            terms: nodes[n]
                .coefficients
                .iter()
                .enumerate()
                .filter(|(_, a)| **a != 0)
                .map(|(j, a)| (j, *a))
                .collect(),
            noise_turns_per_rad: step_noise(i.checked_sub(1).map(|b| &nodes[order[b]]), &nodes[n], sines),
            parts_turns_per_rad: step_parts(i.checked_sub(1).map(|b| &nodes[order[b]]), &nodes[n], sines),
        })
        .collect();
    Chain { start: best[goal].2, stages }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sines(periods: &[f64]) -> Vec<Sine> {
        periods.iter().map(|p| Sine { period_px: *p, steps: 12 }).collect()
    }

    fn periods(chain: &Chain) -> Vec<f64> {
        chain.stages.iter().map(|s| (s.period_px * 1e6).round() / 1e6).collect()
    }

    #[test]
    fn three_close_periods_are_joined_through_their_beats() {
        let chain = widest(&sines(&[24.0, 26.0, 28.0]), None, 1280.0).unwrap();
        assert_eq!(chain.start, Start::Centre);
        assert_eq!(periods(&chain).first(), Some(&2184.0));
        assert_eq!(periods(&chain).last(), Some(&24.0));
        assert!(chain.stages.len() >= 3);
        assert_eq!(widest(&sines(&[26.0, 28.0]), None, 1280.0), None);
        assert!((longest_px(&sines(&[26.0, 28.0])) - 364.0).abs() < 1e-9);
    }

    #[test]
    fn a_hierarchy_goes_down_set_by_set() {
        let chain = widest(&sines(&[16.0, 128.0, 1024.0]), None, 1024.0).unwrap();
        assert_eq!(periods(&chain), [1024.0, 128.0, 16.0]);
        assert_eq!(chain.start, Start::Centre);
    }

    #[test]
    fn a_code_starts_the_chain_at_the_period_it_resolves() {
        let direct = widest(&sines(&[16.0]), Some(8.0), 608.0).unwrap();
        assert_eq!((direct.start, periods(&direct)), (Start::Code, vec![16.0]));
        assert_eq!(periods(&widest(&sines(&[16.0]), Some(16.0), 608.0).unwrap()), [16.0]);
        assert_eq!(widest(&sines(&[16.0]), Some(32.0), 608.0), None);
        // A stripe as long as the finest period has no margin; the second sine gives one.
        assert_eq!(periods(&widest(&sines(&[16.0, 64.0]), Some(16.0), 608.0).unwrap()), [64.0, 16.0]);
    }

    #[test]
    fn one_period_over_the_projector_needs_no_order() {
        let chain = widest(&sines(&[608.0]), None, 608.0).unwrap();
        assert_eq!((chain.start, chain.stages.len()), (Start::Centre, 1));
    }
}
