//! From stores of parts and tables to series.

use super::Args;
use anyhow::{Context, Result, bail, ensure};
use files::csv_table::{CsvRow, CsvTable};
use files::error::Problem;
use files::part_store::{PartRecord, read_parts, store_files};
use metrology::spc::{Limits, Reading, Series};
use std::path::{Path, PathBuf};

/// Everything that was measured.
pub struct Parts {
    /// Series of all features, in the order in which they first occur.
    pub series: Vec<Series>,
    /// Readings of each series with their operators, from tables.
    pub readings: Vec<Vec<Reading>>,
    /// Names of all features, those that are not asked for too.
    pub names: Vec<String>,
    /// Number of parts (rows of a table).
    pub count: usize,
    /// Parts whose cycle was not ok.
    pub not_ok: usize,
}

/// One value of one feature.
#[allow(clippy::struct_field_names, reason = "the column of the table has this name")]
struct Value {
    feature: String,
    recipe: Option<String>,
    unit: String,
    part: String,
    operator: Option<String>,
    date: Option<String>,
    value: Option<f64>,
    u: Option<f64>,
    nominal: Option<f64>,
    limits: Limits,
}

/// The files behind the arguments: those of the store for a folder.
pub fn files(results: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut all: Vec<PathBuf> = Vec::new();
    for path in results {
        if path.is_dir() {
            let store = store_files(path)?;
            ensure!(
                !store.is_empty(),
                "{}: holds no store of parts (parts.jsonl); `fringecell run --out` writes one",
                path.display()
            );
            all.extend(store);
        } else {
            all.push(path.clone());
        }
    }
    // The same measurement counts once.
    let mut seen = Vec::new();
    for path in &all {
        let id = std::fs::canonicalize(path).with_context(|| path.display().to_string())?;
        ensure!(!seen.contains(&id), "{}: is given twice", path.display());
        seen.push(id);
    }
    Ok(all)
}

/// Reads all files and sorts their values by recipe and feature.
pub fn read(args: &Args, files: &[PathBuf]) -> Result<Parts> {
    let mut parts =
        Parts { series: Vec::new(), readings: Vec::new(), names: Vec::new(), count: 0, not_ok: 0 };
    for file in files {
        let is_table = file.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv"));
        if is_table {
            let values = table(file)?;
            parts.count += values.len();
            for value in values {
                parts.add(args, value);
            }
        } else {
            for record in read_parts(file)? {
                parts.record(args, record);
            }
        }
    }
    if let Some(missing) = args.features.iter().find(|name| !parts.series.iter().any(|s| s.name == **name)) {
        bail!("--feature \"{missing}\": no part has it (known: {})", parts.names.join(", "));
    }
    ensure!(!parts.series.is_empty(), "no part has a feature: the cell needs an inspection plan");
    if let Some(last) = args.last {
        parts.series.iter_mut().for_each(|series| keep_last(series, last as usize));
        parts.readings.iter_mut().for_each(|readings| drop_first(readings, last as usize));
    }
    Ok(parts)
}

fn drop_first<T>(values: &mut Vec<T>, last: usize) {
    values.drain(..values.len().saturating_sub(last));
}

fn keep_last(series: &mut Series, last: usize) {
    drop_first(&mut series.values, last);
    drop_first(&mut series.parts, last);
    drop_first(&mut series.dates, last);
    drop_first(&mut series.u, last);
}

impl Parts {
    fn record(&mut self, args: &Args, record: PartRecord) {
        if args.recipe.is_some() && record.recipe != args.recipe {
            return;
        }
        self.count += 1;
        if record.outcome != files::result::OUTCOME_OK {
            self.not_ok += 1;
            return;
        }
        let part = record.part.unwrap_or_else(|| format!("cycle {}", record.number));
        for feature in record.features {
            self.add(
                args,
                Value {
                    feature: feature.name,
                    recipe: record.recipe.clone(),
                    unit: feature.unit.to_string(),
                    part: part.clone(),
                    operator: None,
                    date: Some(record.date.clone()),
                    value: feature.value,
                    u: feature.u,
                    nominal: Some(feature.nominal),
                    // A deviation of form cannot be below zero: that is no limit of the process.
                    limits: Limits {
                        lower: feature.lower.filter(|lower| *lower != 0.0 || feature.nominal != 0.0),
                        upper: feature.upper,
                    },
                },
            );
        }
    }

    fn add(&mut self, args: &Args, value: Value) {
        if !self.names.contains(&value.feature) {
            self.names.push(value.feature.clone());
        }
        if !args.features.is_empty() && !args.features.contains(&value.feature) {
            return;
        }
        let found = self
            .series
            .iter()
            .position(|s| s.name == value.feature && s.recipe == value.recipe && s.unit == value.unit);
        let index = found.unwrap_or_else(|| {
            let (name, recipe, unit) = (value.feature.clone(), value.recipe.clone(), value.unit.clone());
            self.series.push(Series { name, recipe, unit, limits: value.limits, ..Series::default() });
            self.readings.push(Vec::new());
            self.series.len() - 1
        });
        let series = &mut self.series[index];
        series.limits_changed |= series.limits != value.limits;
        series.limits = value.limits;
        series.nominal = value.nominal;
        let Some(number) = value.value else {
            series.missing += 1;
            return;
        };
        series.values.push(number);
        series.u.push(value.u);
        series.parts.push(value.part.clone());
        series.dates.extend(value.date);
        if let Some(operator) = value.operator {
            self.readings[index].push(Reading { part: value.part, operator, value: number });
        }
    }
}

/// Columns of a table; `value` is the only one that must be there.
const COLUMNS: [&str; 9] = ["feature", "part", "operator", "date", "value", "u", "unit", "lower", "upper"];

/// Reads a table with a row for each value.
fn table(path: &Path) -> Result<Vec<Value>> {
    let table = CsvTable::read(path)?;
    let place = path.display();
    if let Some(strange) = table.names.iter().find(|name| !COLUMNS.contains(&name.as_str())) {
        bail!(
            "{place}: the column \"{strange}\" is not known here; rename it or leave it out (known: {})",
            COLUMNS.join(", ")
        );
    }
    ensure!(
        table.column("value").is_some(),
        "{place}: the column \"value\" is missing; name it in the header row, or begin with a header"
    );
    ensure!(!table.rows.is_empty(), "{place}: the table has no rows; write one for each value");
    let value = |(index, row): (usize, &CsvRow)| {
        let text = |column: &str| table.text(row, column).map(str::to_owned);
        let number = |column: &str| table.number(row, column);
        let limits = Limits { lower: number("lower")?, upper: number("upper")? };
        if let (Some(lower), Some(upper)) = (limits.lower, limits.upper)
            && lower >= upper
        {
            let problem =
                Problem::Value { value: lower.to_string(), limit: format!("below \"upper\", {upper}") };
            return Err(table.fault(row, "lower", problem).into());
        }
        Ok(Value {
            feature: text("feature").unwrap_or_else(|| "value".into()),
            recipe: None,
            unit: text("unit").unwrap_or_else(|| "mm".into()),
            part: text("part").unwrap_or_else(|| format!("row {}", index + 1)),
            operator: text("operator"),
            date: text("date"),
            value: number("value")?,
            u: number("u")?,
            nominal: None,
            limits,
        })
    };
    table.rows.iter().enumerate().map(value).collect()
}
