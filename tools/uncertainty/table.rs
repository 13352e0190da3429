//! The budget as a table for a terminal.

use files::budget::BudgetFile;
use metrology::uncertainty::{Comparison, Evaluation, MonteCarloResult, Validation};
use report::number::{decimals, fixed, significant, unit};
use report::uncertainty::{comparison_line, degrees, estimate, monte_carlo_lines};
use std::fmt::Write as _;

/// Everything that the command prints.
pub fn text(
    file: &BudgetFile,
    evaluation: &Evaluation,
    monte_carlo: Option<(&MonteCarloResult, Validation)>,
    comparison: Option<&Comparison>,
) -> String {
    let mut text = match file.remark.as_str() {
        "" => format!("{}\n", file.name),
        remark => format!("{} ({remark})\n", file.name),
    };
    if let Some(model) = &file.model {
        let _ = writeln!(text, "{} = {model}", file.symbol);
    }
    text.push('\n');
    text.push_str(&columns(&cells(file, evaluation)));
    text.push('\n');
    text.push_str(&summary(file, evaluation));
    for note in &evaluation.notes {
        let _ = writeln!(text, "note: {note}");
    }
    let lines = monte_carlo.map(|(m, validation)| monte_carlo_lines(file, m, validation));
    let comparison = comparison.and_then(|c| comparison_line(file, c));
    for line in lines.unwrap_or_default().into_iter().chain(comparison) {
        let _ = writeln!(text, "{line}");
    }
    text
}

fn cells(file: &BudgetFile, evaluation: &Evaluation) -> Vec<Vec<String>> {
    let contribution = format!("|c|·u /{}", unit(&file.unit));
    let head = [
        "quantity",
        "estimate",
        "type",
        "distribution",
        "value",
        "divisor",
        "u",
        "unit",
        "sensitivity",
        &contribution,
        "share %",
        "dof",
    ];
    let mut cells = vec![head.map(str::to_owned).to_vec()];
    for row in &evaluation.rows {
        cells.push(vec![
            row.name.clone(),
            estimate(row),
            format!("{:?}", row.method),
            row.distribution.name().to_owned(),
            significant(row.value, 3),
            fixed(row.divisor, 3),
            significant(row.standard_uncertainty, 3),
            unit(&row.unit).to_owned(),
            significant(row.sensitivity, 3),
            significant(row.contribution, 3),
            fixed(100.0 * row.share, 1),
            degrees(row.dof),
        ]);
    }
    if evaluation.correlation_share != 0.0 {
        let mut row = vec![String::new(); head.len()];
        "correlation".clone_into(&mut row[0]);
        row[10] = fixed(100.0 * evaluation.correlation_share, 1);
        cells.push(row);
    }
    cells
}

fn summary(file: &BudgetFile, evaluation: &Evaluation) -> String {
    let unit = unit(&file.unit);
    let digits = decimals(Some(evaluation.expanded_uncertainty));
    format!(
        "combined standard uncertainty u_c = {} {unit}, effective degrees of freedom {}, coverage factor k = {}\n\
         {} = ({} ± {}) {unit}, k = {}, coverage {} %\n",
        significant(evaluation.combined_standard_uncertainty, 3),
        degrees(evaluation.effective_dof),
        fixed(evaluation.coverage_factor, 2),
        file.symbol,
        fixed(evaluation.estimate, digits),
        fixed(evaluation.expanded_uncertainty, digits),
        fixed(evaluation.coverage_factor, 2),
        fixed(100.0 * evaluation.covered_probability, 2),
    )
}

/// Columns as wide as their widest cell, separated by two blanks; text is left-aligned, numbers are right-aligned.
fn columns(rows: &[Vec<String>]) -> String {
    const WORDS: [usize; 4] = [0, 2, 3, 7];
    let count = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..count).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (column, (cell, width)) in row.iter().zip(&widths).enumerate() {
            let _ = if WORDS.contains(&column) {
                write!(line, "{cell:<width$}  ")
            } else {
                write!(line, "{cell:>width$}  ")
            };
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}
