//! Quantities that are not independent: groups, matrix, factor.

use super::budget::Budget;
use super::error::UncertaintyError;

/// A variance below this is rounding: entries are at most 1, sums of at most some thousand terms.
const ROUNDING: f64 = 1e-10;

/// Quantities connected by correlation, with a factor L of their correlation matrix, L Lᵀ = R.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Places in the budget, ascending.
    pub members: Vec<usize>,
    /// Columns of L; each has one entry per member.
    pub columns: Vec<Vec<f64>>,
}

/// All groups of more than one member, by their first one.
///
/// # Errors
/// A pair that names itself, an absent quantity, or a pair twice; a coefficient outside −1 … 1; coefficients that
/// contradict each other.
pub fn groups(budget: &Budget) -> Result<Vec<Group>, UncertaintyError> {
    check(budget)?;
    let n = budget.quantities.len();
    let mut group_of: Vec<usize> = (0..n).collect();
    for pair in budget.correlations.iter().filter(|c| c.coefficient != 0.0) {
        let (a, b) = (group_of[pair.first], group_of[pair.second]);
        let (keep, drop) = (a.min(b), a.max(b));
        group_of.iter_mut().filter(|g| **g == drop).for_each(|g| *g = keep);
    }
    let members = |group: usize| (0..n).filter(|i| group_of[*i] == group).collect::<Vec<_>>();
    (0..n)
        .map(members)
        .filter(|members| members.len() > 1)
        .map(|members| {
            let columns = factor(budget, &members)?;
            Ok(Group { members, columns })
        })
        .collect()
}

fn check(budget: &Budget) -> Result<(), UncertaintyError> {
    let name = |i: usize| budget.quantities.get(i).map_or_else(|| format!("number {i}"), |q| q.name.clone());
    for (at, pair) in budget.correlations.iter().enumerate() {
        let refuse = |problem: &str| {
            let (first, second) = (name(pair.first), name(pair.second));
            Err(UncertaintyError::Correlation { first, second, problem: problem.to_owned() })
        };
        if pair.first.max(pair.second) >= budget.quantities.len() {
            return refuse("there is no such quantity");
        }
        if pair.first == pair.second {
            return refuse("a quantity is fully correlated with itself; name two quantities");
        }
        let same = |c: &super::Correlation| {
            (c.first, c.second) == (pair.first, pair.second)
                || (c.second, c.first) == (pair.first, pair.second)
        };
        if budget.correlations[..at].iter().any(same) {
            return refuse("the pair is given twice; keep one");
        }
        if !(-1.0..=1.0).contains(&pair.coefficient) {
            return refuse(&format!("coefficient {} is not allowed: −1 … 1", pair.coefficient));
        }
    }
    Ok(())
}

/// r(x_i, x_j) as given, 1 on the diagonal, 0 otherwise.
fn coefficient(budget: &Budget, i: usize, j: usize) -> f64 {
    if i == j {
        return 1.0;
    }
    let pair = (i.min(j), i.max(j));
    let found = budget.correlations.iter().find(|c| (c.first.min(c.second), c.first.max(c.second)) == pair);
    found.map_or(0.0, |c| c.coefficient)
}

/// Cholesky factor, column by column, with the largest remaining variance first, so that it also exists for a
/// semidefinite matrix (r = ±1).
fn factor(budget: &Budget, members: &[usize]) -> Result<Vec<Vec<f64>>, UncertaintyError> {
    let mut rest: Vec<Vec<f64>> =
        members.iter().map(|i| members.iter().map(|j| coefficient(budget, *i, *j)).collect()).collect();
    let mut columns = Vec::new();
    let mut open: Vec<usize> = (0..members.len()).collect();
    while let Some((place, pivot)) = largest_variance(&open, &rest) {
        let variance = rest[pivot][pivot];
        if variance <= ROUNDING {
            break;
        }
        open.remove(place);
        let root = variance.sqrt();
        let mut column = vec![0.0; members.len()];
        column[pivot] = root;
        for i in &open {
            column[*i] = rest[*i][pivot] / root;
        }
        for i in &open {
            for j in &open {
                rest[*i][*j] -= column[*i] * column[*j];
            }
        }
        columns.push(column);
    }
    // What is left has no variance; then it must have no covariance either.
    for i in &open {
        let covariance = open.iter().map(|j| rest[*i][*j].abs()).fold(0.0, f64::max);
        if covariance > ROUNDING.sqrt() {
            let quantity = budget.quantities[members[*i]].name.clone();
            return Err(UncertaintyError::NotPositiveSemidefinite { quantity, variance: -covariance });
        }
    }
    Ok(columns)
}

/// Place in `open`, and member, of the largest remaining variance; the first one of equals.
fn largest_variance(open: &[usize], rest: &[Vec<f64>]) -> Option<(usize, usize)> {
    let variance = |member: usize| rest[member][member];
    let larger =
        |a: &(usize, usize), b: &(usize, usize)| variance(a.1).total_cmp(&variance(b.1)).then(b.0.cmp(&a.0));
    open.iter().copied().enumerate().max_by(larger)
}

/// Variance of the measurand that a group contributes: Σ c_i c_j u_i u_j r_ij, as a sum of squares and so never negative.
pub fn variance(group: &Group, signed_contributions: &[f64]) -> f64 {
    let square = |column: &Vec<f64>| {
        let sum: f64 = group.members.iter().zip(column).map(|(i, l)| signed_contributions[*i] * l).sum();
        sum * sum
    };
    group.columns.iter().map(square).sum()
}
