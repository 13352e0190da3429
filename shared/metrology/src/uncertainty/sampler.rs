//! Draws of all input quantities at one trial, each a function of seed and trial number only.

use super::budget::{Budget, Quantity};
use super::correlation::Group;
use super::distribution::Distribution;
use super::error::UncertaintyError;
use fringe::math::ln;
use fringe::math::random::{Key, normal_quantile};

/// The χ² of groups have streams separate from those of quantities.
const GROUP_STREAM: u64 = 1 << 32;

/// Most degrees of freedom of a group that are drawn one by one; above, the normal distribution differs by less than
/// any tolerance shows.
const MOST_GROUP_DOF: f64 = 10_000.0;

/// A budget's quantities, ready to be drawn.
pub struct Sampler<'a> {
    quantities: &'a [Quantity],
    groups: &'a [Group],
    /// Half-width or standard uncertainty; 0 for members of groups, which are drawn together.
    scales: Vec<f64>,
    key: Key,
}

impl<'a> Sampler<'a> {
    /// Checks that the Supplement defines how to draw each quantity.
    ///
    /// # Errors
    /// t with ν ≤ 2, whose standard deviation does not exist; correlated quantities that are not all normal with one
    /// whole or infinite ν.
    pub fn new(budget: &'a Budget, groups: &'a [Group], seed: u64) -> Result<Self, UncertaintyError> {
        let quantities = &budget.quantities;
        for quantity in quantities.iter().filter(|q| q.value > 0.0) {
            let t = matches!(quantity.distribution, Distribution::Normal { .. });
            if t && quantity.dof <= 2.0 {
                let problem = format!(
                    "its t distribution with ν = {} has no standard deviation; take at least 4 readings, or state the \
                     standard uncertainty from more experience (Supplement 1, 6.4.9)",
                    quantity.dof
                );
                return Err(UncertaintyError::NotDrawable { quantity: quantity.name.clone(), problem });
            }
        }
        groups.iter().try_for_each(|group| check_group(group, quantities))?;
        let member = |i: &usize| groups.iter().any(|g| g.members.contains(i));
        let scale = |(i, q): (usize, &Quantity)| match q.distribution {
            _ if member(&i) => 0.0,
            Distribution::Normal { .. } => q.standard_uncertainty(),
            _ => q.value,
        };
        let scales = quantities.iter().enumerate().map(scale).collect();
        Ok(Self { quantities, groups, scales, key: Key::new(seed) })
    }

    /// Values of all quantities at a trial.
    pub fn draw(&self, trial: u64, values: &mut [f64]) {
        let places = self.quantities.iter().zip(&self.scales).zip(values.iter_mut()).enumerate();
        for (i, ((quantity, scale), value)) in places {
            *value = quantity.estimate;
            if *scale > 0.0 {
                *value += scale * quantity.distribution.draw(self.key.with(i as u64), trial, quantity.dof);
            }
        }
        for (number, group) in self.groups.iter().enumerate() {
            self.draw_group(group, number as u64, trial, values);
        }
    }

    /// Jointly normal, or multivariate t: one χ² widens all members alike (JCGM 102:2011, 5.3.2).
    fn draw_group(&self, group: &Group, number: u64, trial: u64, values: &mut [f64]) {
        let dof = group.members.first().map_or(f64::INFINITY, |i| self.quantities[*i].dof);
        let widening = if dof > MOST_GROUP_DOF {
            1.0
        } else {
            (dof / chi_squared(self.key.with(GROUP_STREAM + number), trial, dof as u64)).sqrt()
        };
        for i in &group.members {
            values[*i] = 0.0;
        }
        for (stream, column) in group.members.iter().zip(&group.columns) {
            let normal = normal_quantile(self.key.with(*stream as u64).open(trial));
            for (i, l) in group.members.iter().zip(column) {
                values[*i] += l * normal;
            }
        }
        for i in &group.members {
            let quantity = &self.quantities[*i];
            values[*i] = quantity.estimate + widening * quantity.standard_uncertainty() * values[*i];
        }
    }
}

fn check_group(group: &Group, quantities: &[Quantity]) -> Result<(), UncertaintyError> {
    let first = group.members.first().map_or(f64::INFINITY, |i| quantities[*i].dof);
    for quantity in group.members.iter().map(|i| &quantities[*i]) {
        let refuse =
            |problem: String| Err(UncertaintyError::NotDrawable { quantity: quantity.name.clone(), problem });
        if !matches!(quantity.distribution, Distribution::Normal { .. }) {
            let name = quantity.distribution.name();
            return refuse(format!(
                "is {name} and correlated; correlated quantities can be drawn as normal ones only (Supplement 1, 6.4.8)"
            ));
        }
        let dof = quantity.dof;
        if dof != first || (dof.is_finite() && dof.fract() != 0.0) {
            return refuse(format!(
                "is correlated and has ν = {dof} beside ν = {first}; correlated quantities can be drawn with one whole or \
                 infinite ν only, that of their simultaneous readings"
            ));
        }
    }
    Ok(())
}

/// χ² with a whole ν: −2 ln of a product of even numbers for each pair, a squared normal value for what is left.
fn chi_squared(key: Key, trial: u64, dof: u64) -> f64 {
    /// So many factors of at least 2⁻⁵³ stay far above the smallest number.
    const FACTORS: u64 = 16;
    let draws = dof.div_ceil(2);
    let counter = |draw: u64| trial.wrapping_mul(draws).wrapping_add(draw);
    let mut sum = 0.0;
    let mut product = 1.0;
    for pair in 0..dof / 2 {
        product *= key.open(counter(pair));
        if pair % FACTORS == FACTORS - 1 {
            sum -= 2.0 * ln(product);
            product = 1.0;
        }
    }
    sum -= 2.0 * ln(product);
    if dof % 2 == 1 {
        let normal = normal_quantile(key.open(counter(draws - 1)));
        sum += normal * normal;
    }
    sum
}
