//! The linear Chebyshev problem: the δ that makes the largest |rᵢ + aᵢ · δ| least.
//!
//! P + 1 rows whose derivatives span the P parameters have a levelled solution in closed form: with Σ λᵢ aᵢ = 0 the
//! residuals are ±h, h = |Σ λᵢ rᵢ| / Σ |λᵢ|, and no δ brings all of them below h (de la Vallée-Poussin). The exchange
//! (Stiefel 1959) takes in the row of largest residual and drops the one that leaves the largest h; h grows with each
//! exchange, so it ends, and at its end h is the optimum: no residual exceeds it.

use nalgebra::SVector;

/// Most exchanges. Each raises h; sets of a million points take some twenty.
const MAX_EXCHANGES: usize = 500;

/// Smallest pivot, relative to the largest entry of scaled columns: below it rows count as dependent.
const SMALLEST_PIVOT: f64 = 1e-10;

/// A row of the linearised problem.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<const P: usize> {
    /// Distance r from the present element, mm.
    pub residual: f64,
    /// a: its derivatives by the parameters.
    pub derivatives: SVector<f64, P>,
}

/// Solution of the linear minimax problem.
#[derive(Debug, Clone)]
pub(super) struct Levelled<const P: usize> {
    /// Step δ of the parameters.
    pub step: SVector<f64, P>,
    /// Largest |r + a · δ| of all rows, mm.
    pub half_width: f64,
    /// The P + 1 rows that hold it.
    pub basis: Vec<usize>,
}

/// Solves the problem; `None` when the rows do not determine δ.
pub(super) fn chebyshev<const P: usize>(rows: &[Row<P>]) -> Option<Levelled<P>> {
    let scale = column_scale(rows)?;
    let scaled: Vec<Row<P>> = rows
        .iter()
        .map(|row| Row { residual: row.residual, derivatives: row.derivatives.component_div(&scale) })
        .collect();
    let mut best = levelled(&scaled, first_basis(&scaled)?)?;
    for _ in 0..MAX_EXCHANGES {
        let (worst, size) = largest(&scaled, &best.step);
        if size <= best.half_width * (1.0 + 1e-14) || best.basis.contains(&worst) {
            break;
        }
        let exchanged = (0..best.basis.len()).filter_map(|place| {
            let mut basis = best.basis.clone();
            basis[place] = worst;
            levelled(&scaled, basis)
        });
        // Of equal ones the first: the order of the basis decides, not chance.
        let next = exchanged.reduce(|a, b| if b.half_width > a.half_width { b } else { a });
        match next {
            Some(next) if next.half_width > best.half_width => best = next,
            _ => break,
        }
    }
    let half_width = best.half_width;
    Some(Levelled { step: best.step.component_div(&scale), half_width, basis: best.basis })
}

/// Largest size of each derivative, so that tilts and lengths weigh alike in the search for pivots.
fn column_scale<const P: usize>(rows: &[Row<P>]) -> Option<SVector<f64, P>> {
    let mut scale = SVector::<f64, P>::zeros();
    for row in rows {
        for i in 0..P {
            scale[i] = scale[i].max(row.derivatives[i].abs());
        }
    }
    scale.iter().all(|s| *s > 0.0 && s.is_finite()).then_some(scale)
}

/// The row of largest |r + a · δ|; of equal ones the first.
fn largest<const P: usize>(rows: &[Row<P>], step: &SVector<f64, P>) -> (usize, f64) {
    let mut worst = (0, -1.0);
    for (index, row) in rows.iter().enumerate() {
        let size = (row.residual + row.derivatives.dot(step)).abs();
        if size > worst.1 {
            worst = (index, size);
        }
    }
    worst
}

/// P rows that span the parameters (each the farthest from the span of those before it), and the row of largest
/// residual beside them.
fn first_basis<const P: usize>(rows: &[Row<P>]) -> Option<Vec<usize>> {
    let mut rest: Vec<SVector<f64, P>> = rows.iter().map(|row| row.derivatives).collect();
    let mut basis = Vec::with_capacity(P + 1);
    for _ in 0..P {
        let (mut index, mut square) = (0, -1.0);
        for (i, vector) in rest.iter().enumerate() {
            if vector.norm_squared() > square {
                (index, square) = (i, vector.norm_squared());
            }
        }
        if square <= SMALLEST_PIVOT * SMALLEST_PIVOT {
            return None;
        }
        let unit = rest[index] / square.sqrt();
        for vector in &mut rest {
            *vector -= unit * unit.dot(vector);
        }
        basis.push(index);
    }
    let mut extra: Option<(usize, f64)> = None;
    for (index, row) in rows.iter().enumerate() {
        if !basis.contains(&index) && extra.is_none_or(|(_, size)| row.residual.abs() > size) {
            extra = Some((index, row.residual.abs()));
        }
    }
    basis.push(extra?.0);
    Some(basis)
}

/// The levelled solution on P + 1 rows; `None` when they do not span the parameters.
fn levelled<const P: usize>(rows: &[Row<P>], basis: Vec<usize>) -> Option<Levelled<P>> {
    let weights = null_vector::<P>(&basis.iter().map(|i| rows[*i].derivatives).collect::<Vec<_>>())?;
    let sum: f64 = weights.iter().zip(&basis).map(|(w, i)| w * rows[*i].residual).sum();
    let size: f64 = weights.iter().map(|w| w.abs()).sum();
    let half_width = sum.abs() / size;
    // The row of largest weight follows from the others, which are independent.
    let left_out = (0..=P).fold(0, |best, i| if weights[i].abs() > weights[best].abs() { i } else { best });
    let mut system = Vec::with_capacity(P);
    for place in (0..=P).filter(|place| *place != left_out) {
        let row = &rows[basis[place]];
        let sign = if weights[place] * sum < 0.0 { -1.0 } else { 1.0 };
        system.push((row.derivatives, sign * half_width - row.residual));
    }
    let step = solve(system)?;
    Some(Levelled { step, half_width, basis })
}

/// λ with Σ λᵢ aᵢ = 0 for P + 1 vectors of rank P: elimination with complete pivoting.
fn null_vector<const P: usize>(vectors: &[SVector<f64, P>]) -> Option<Vec<f64>> {
    let mut columns = vectors.to_vec();
    let mut order: Vec<usize> = (0..columns.len()).collect();
    let mut equations: Vec<usize> = (0..P).collect();
    for k in 0..P {
        let (mut row, mut column, mut size) = (k, k, 0.0);
        for (r, equation) in equations.iter().enumerate().skip(k) {
            for (c, vector) in order.iter().enumerate().skip(k) {
                let here = columns[*vector][*equation].abs();
                if here > size {
                    (row, column, size) = (r, c, here);
                }
            }
        }
        if size <= SMALLEST_PIVOT {
            return None;
        }
        equations.swap(k, row);
        order.swap(k, column);
        let pivot = columns[order[k]][equations[k]];
        for equation in &equations[k + 1..] {
            let factor = columns[order[k]][*equation] / pivot;
            for c in &order[k..] {
                let above = columns[*c][equations[k]];
                columns[*c][*equation] -= factor * above;
            }
        }
    }
    let mut weights = vec![0.0; P + 1];
    weights[order[P]] = 1.0;
    for k in (0..P).rev() {
        let known: f64 = order[k + 1..].iter().map(|c| columns[*c][equations[k]] * weights[*c]).sum();
        weights[order[k]] = -known / columns[order[k]][equations[k]];
    }
    Some(weights)
}

/// Solves P equations a · x = b.
fn solve<const P: usize>(mut system: Vec<(SVector<f64, P>, f64)>) -> Option<SVector<f64, P>> {
    let mut order: Vec<usize> = (0..P).collect();
    for k in 0..P {
        let (mut row, mut column, mut size) = (k, k, 0.0);
        for (r, (equation, _)) in system.iter().enumerate().skip(k) {
            for (c, unknown) in order.iter().enumerate().skip(k) {
                if equation[*unknown].abs() > size {
                    (row, column, size) = (r, c, equation[*unknown].abs());
                }
            }
        }
        if size <= SMALLEST_PIVOT {
            return None;
        }
        system.swap(k, row);
        order.swap(k, column);
        let (above, right) = system[k];
        for (equation, value) in system.iter_mut().skip(k + 1) {
            let factor = equation[order[k]] / above[order[k]];
            *equation -= above * factor;
            *value -= right * factor;
        }
    }
    let mut solution = SVector::<f64, P>::zeros();
    for k in (0..P).rev() {
        let (equation, value) = &system[k];
        let known: f64 = order[k + 1..].iter().map(|c| equation[*c] * solution[*c]).sum();
        solution[order[k]] = (value - known) / equation[order[k]];
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::tests::Noise;

    /// All (P + 1)-subsets: the optimum is the largest of their levelled half widths.
    fn by_all_subsets(rows: &[Row<2>]) -> f64 {
        let mut most: f64 = 0.0;
        for i in 0..rows.len() {
            for j in i + 1..rows.len() {
                for k in j + 1..rows.len() {
                    most = levelled(rows, vec![i, j, k]).map_or(most, |l| most.max(l.half_width));
                }
            }
        }
        most
    }

    #[test]
    fn the_exchange_ends_at_the_largest_of_all_subsets() {
        for seed in 0..200 {
            let mut noise = Noise(seed);
            let rows: Vec<Row<2>> = (0..15)
                .map(|_| Row {
                    residual: noise.normal(),
                    derivatives: SVector::from([1.0, 10.0 * noise.uniform()]),
                })
                .collect();
            let found = chebyshev(&rows).unwrap();
            let expected = by_all_subsets(&rows);
            assert!((found.half_width - expected).abs() < 1e-12, "{seed}: {} {expected}", found.half_width);
            let (_, size) = largest(&rows, &found.step);
            assert!((size - expected).abs() < 1e-12, "{seed}: the step holds {size}");
        }
    }

    #[test]
    fn rows_that_span_nothing_have_no_solution() {
        let row = |residual: f64| Row { residual, derivatives: SVector::from([1.0, 2.0]) };
        assert!(chebyshev(&[row(0.0), row(1.0), row(3.0), row(-2.0)]).is_none());
        assert!(chebyshev::<2>(&[]).is_none());
    }
}
