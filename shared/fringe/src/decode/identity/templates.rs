//! What every frame of a sequence shows at each coordinate of an axis, and the coordinate that explains a pixel best.

use super::event::OrderEvent;
use crate::pattern::{Axis, PatternSet};

/// A frame is looked at more closely where this share of its variation is unexplained.
pub(super) const SUSPECT: f32 = 0.05;
/// Edges of stripes are blurred by so many projector pixels to either side.
const BLUR_PX: i32 = 1;
/// Fewest frames of a group that tell anything beside their background and contrast.
const LEAST_ROWS: usize = 3;

/// The frames of a sequence that an axis explains, each as one row of levels over the coordinates.
#[derive(Debug)]
pub struct Templates {
    /// Frame number of each row in the sequence.
    pub frames: Vec<usize>,
    /// Rows with the same number share background and contrast: stripes and even light have 0, every set of steps its own.
    groups: Vec<usize>,
    /// Levels 0 … 1 of each row, one for each coordinate.
    levels: Vec<Vec<f32>>,
    /// Rows of light and dark without steps between.
    stripes: Vec<bool>,
    /// Distance of the coordinates, projector pixels.
    pub step_px: f64,
    /// Finest period, or finest stripe where there is no period, projector pixels.
    pub finest_px: f64,
}

/// The rows as they are after an event, with the sums that do not depend on a pixel.
#[derive(Debug)]
pub struct Arrangement {
    /// Row of the templates that each row shows.
    pub shows: Vec<Option<usize>>,
    /// For each group: rows in use, Σ level and Σ level² at each coordinate.
    groups: Vec<(f32, Vec<f32>, Vec<f32>)>,
}

/// The coordinate that explains a pixel best.
#[derive(Debug)]
pub struct Explained {
    /// Number of the coordinate.
    pub place: usize,
    /// Of each row, what stays unexplained: 0 nothing, 1 as much as its pattern varies; `None` where the row tells nothing.
    pub misfit: Vec<Option<f32>>,
}

impl Templates {
    /// The rows of a sequence along an axis, with so many coordinates a period; `None` where nothing varies along it.
    pub fn new(sequence: &[PatternSet], axis: Axis, extent_px: u32, per_period: f64) -> Option<Self> {
        let length = |set: &PatternSet| match set {
            PatternSet::Sine { period_px, .. } | PatternSet::Lines { period_px, .. } => Some(*period_px),
            PatternSet::Micro { periods_px, .. } => periods_px.first().copied(),
            _ => None,
        };
        let stripe = |set: &PatternSet| match set {
            PatternSet::Gray { stripe_px, .. } | PatternSet::Check { stripe_px, .. } => Some(*stripe_px),
            PatternSet::Stair { stair_px, .. } => Some(*stair_px),
            _ => None,
        };
        let along = || sequence.iter().filter(|set| set.axis() == Some(axis));
        let period_px = along().filter_map(length).reduce(f64::min);
        let finest_px = period_px.or_else(|| along().filter_map(stripe).reduce(f64::min))?;
        let step_px = (finest_px / per_period).clamp(0.25, 1.0);
        let places = (f64::from(extent_px) / step_px) as usize;
        let mut templates = Self {
            frames: Vec::new(),
            groups: Vec::new(),
            levels: Vec::new(),
            stripes: Vec::new(),
            step_px,
            finest_px,
        };
        let mut frame = 0;
        for (index, set) in sequence.iter().enumerate() {
            let even = set.axis().is_none() && !matches!(set, PatternSet::Random { .. });
            // A carrier varies along the other axis too.
            let told = set.axis() == Some(axis) && !matches!(set, PatternSet::Modulated { .. });
            for step in 0..set.frames() {
                if even || told {
                    templates.add(index, set, (frame, step), (places, extent_px));
                }
                frame += 1;
            }
        }
        Some(templates)
    }

    fn add(
        &mut self,
        index: usize,
        set: &PatternSet,
        (frame, step): (usize, usize),
        (places, extent_px): (usize, u32),
    ) {
        let stripes = matches!(set, PatternSet::Gray { .. } | PatternSet::Check { .. });
        let plain = stripes || set.axis().is_none();
        let level = |place: usize| {
            let at = |x: f64| set.intensity(step, x.max(0.0), extent_px).unwrap_or(0.0);
            let x = place as f64 * self.step_px;
            if !stripes {
                return at(x) as f32;
            }
            let blur = -BLUR_PX..=BLUR_PX;
            let count = f64::from(2 * BLUR_PX + 1);
            (blur.map(|shift| at(x + f64::from(shift))).sum::<f64>() / count) as f32
        };
        let levels = (0..places).map(level).collect();
        self.levels.push(levels);
        self.frames.push(frame);
        self.groups.push(if plain { 0 } else { index + 1 });
        self.stripes.push(stripes);
    }

    /// Number of coordinates in all.
    pub fn places(&self) -> usize {
        self.levels.first().map_or(0, Vec::len)
    }

    /// Level of a row at a coordinate.
    pub fn level(&self, row: usize, place: usize) -> f32 {
        self.levels[row][place]
    }

    /// The rows after an event; without one as they should be.
    pub fn arrangement(&self, event: Option<OrderEvent>) -> Arrangement {
        let shows: Vec<Option<usize>> = self
            .frames
            .iter()
            .map(|frame| {
                let shown = event.map_or(Some(*frame), |event| event.shown(*frame))?;
                self.frames.iter().position(|other| *other == shown)
            })
            .collect();
        let mut groups =
            vec![(0.0, Vec::new(), Vec::new()); self.groups.iter().max().map_or(0, |last| last + 1)];
        for row in shows.iter().flatten() {
            let (count, sum, squares) = &mut groups[self.groups[*row]];
            *count += 1.0;
            sum.resize(self.places(), 0.0);
            squares.resize(self.places(), 0.0);
            for ((sum, squares), level) in sum.iter_mut().zip(squares.iter_mut()).zip(&self.levels[*row]) {
                *sum += level;
                *squares += level * level;
            }
        }
        Arrangement { shows, groups }
    }

    /// The coordinate that explains the grey values of a pixel best, one value for each row, and what it leaves.
    pub fn explain(&self, arrangement: &Arrangement, values: &[f32]) -> Explained {
        let places = self.places();
        let mut cost = vec![0.0_f32; places];
        let mut product = vec![0.0_f32; places];
        for (group, (count, sum, squares)) in arrangement.groups.iter().enumerate() {
            if *count < LEAST_ROWS as f32 {
                continue;
            }
            let (total, spread) = self.moments(arrangement, group, values);
            product.fill(0.0);
            for (row, value) in self.of_group(arrangement, group, values) {
                for (product, level) in product.iter_mut().zip(&self.levels[row]) {
                    *product += value * level;
                }
            }
            for place in 0..places {
                let variance = squares[place] - sum[place] * sum[place] / count;
                let common = product[place] - total * sum[place] / count;
                let gained = if common > 0.0 && variance > 1e-6 { common * common / variance } else { 0.0 };
                cost[place] += (spread - gained).max(0.0);
            }
        }
        let place = cost.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(place, _)| place);
        Explained { place, misfit: self.misfit(arrangement, values, place) }
    }

    fn of_group<'a>(
        &'a self,
        arrangement: &'a Arrangement,
        group: usize,
        values: &'a [f32],
    ) -> impl Iterator<Item = (usize, f32)> + 'a {
        let shown = arrangement.shows.iter().zip(values).filter_map(|(row, value)| Some(((*row)?, *value)));
        shown.filter(move |(row, _)| self.groups[*row] == group)
    }

    /// Sum of the values of a group, and of their squared distances from the mean.
    fn moments(&self, arrangement: &Arrangement, group: usize, values: &[f32]) -> (f32, f32) {
        let (mut count, mut total, mut squares) = (0.0, 0.0, 0.0);
        for (_, value) in self.of_group(arrangement, group, values) {
            count += 1.0;
            total += value;
            squares += value * value;
        }
        (total, squares - total * total / count)
    }

    fn misfit(&self, arrangement: &Arrangement, values: &[f32], place: usize) -> Vec<Option<f32>> {
        let mut misfit = vec![None; values.len()];
        for (group, (count, sum, squares)) in arrangement.groups.iter().enumerate() {
            if *count < LEAST_ROWS as f32 {
                continue;
            }
            let (sum, squares) = (sum[place], squares[place]);
            let (total, _) = self.moments(arrangement, group, values);
            let product: f32 = self
                .of_group(arrangement, group, values)
                .map(|(row, value)| value * self.levels[row][place])
                .sum();
            let (variance, common) = (squares - sum * sum / count, product - total * sum / count);
            let contrast = if variance > 1e-6 { (common / variance).max(0.0) } else { 0.0 };
            let background = (total - contrast * sum) / count;
            for (index, value) in values.iter().enumerate() {
                let Some(row) = arrangement.shows[index].filter(|row| self.groups[*row] == group) else {
                    continue;
                };
                let level = self.levels[row][place];
                // Beside an edge blur decides what a pixel sees.
                if self.stripes[row] && level > 0.01 && level < 0.99 {
                    continue;
                }
                let left = (value - background - contrast * level).abs();
                misfit[index] = Some((left / (0.5 * contrast).max(1e-3)).min(1.0).powi(2));
            }
        }
        misfit
    }
}

/// Whether a sequence has a check.
pub fn has_check(sequence: &[PatternSet]) -> bool {
    sequence.iter().any(|set| matches!(set, PatternSet::Check { .. }))
}
